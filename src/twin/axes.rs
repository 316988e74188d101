//! The drives' coordinates as a system of differential equations: arms and rotor of a disassembled robot, a single axis, or an
//! assembled relative of the delta robot with intact sockets.
//!
//! Of a disassembled machine every body rotates about a fixed axis e through its origin, so that the axes are decoupled: with
//! Θ the moment of inertia about e, h the first moment and M the moments of effects and contacts, Θ·q̈ = τ + e·(M + h × g).
//! Of an assembled one, with ξ the twists of all bodies per unit rate of each drive, M_b their inertias and w the applied
//! minus the inertial wrenches at q̈ = 0, (Σ ξᵀ M_b ξ)·q̈ = τ + Σ ξᵀ w.

use nalgebra::{Vector3, Vector4};

use super::SingularPose;
use super::context::Context;
use super::integrator::{Stage, System};
use crate::dynamics::{ChannelMap, Plant, Twist, balance, ball_forces, rigid_wrenches};
use crate::kinematics::motion::MAX_SOCKETS;
use crate::kinematics::{JointState, Motion};
use crate::machine::AXES;
use crate::machine::bodies::SLOTS;
use crate::recording::Channel;

/// Number of angles and rates, in this order.
pub(super) const LENGTH: usize = 2 * AXES;
/// Place of the rates.
pub(super) const RATES: std::ops::Range<usize> = AXES..LENGTH;

/// Right-hand side for one step.
pub(super) struct Axes<'a> {
    pub context: &'a mut Context,
}

pub(super) fn store(y: &mut [f64], motion: &Motion) {
    y[..AXES].copy_from_slice(&motion.q);
    y[AXES..LENGTH].copy_from_slice(&motion.qd);
}

/// Motion of all bodies at a state, with given axis accelerations.
///
/// # Errors
/// [`SingularPose`] if the struts reach no common plate.
pub(super) fn motion(plant: &Plant, y: &[f64], qdd: [f64; AXES]) -> Result<Motion, SingularPose> {
    let (q, qd) = (std::array::from_fn(|i| y[i]), std::array::from_fn(|i| y[AXES + i]));
    plant.motion(&JointState { q, qd, qdd }).map_err(|_| SingularPose)
}

impl Context {
    /// Motion at a state of [`Axes`], without accelerations; the arms alone where the struts reach no common plate.
    pub fn in_drives(&self, y: &[f64]) -> Motion {
        let joints = JointState {
            q: std::array::from_fn(|i| y[i]),
            qd: std::array::from_fn(|i| y[AXES + i]),
            ..JointState::default()
        };
        self.plant.motion(&joints).unwrap_or_else(|_| Motion::disassembled(&self.plant.geometry, &joints))
    }
}

/// Implicit terms of a Rosenbrock stage per axis: inertia (kg·m²) and torque (N·m).
type Implicit = [(f64, f64); AXES];

/// Applied minus inertial wrenches, with the accelerations of `motion`.
fn total(plant: &Plant, motion: &Motion, applied: &[Twist; SLOTS]) -> [Twist; SLOTS] {
    let mut all = rigid_wrenches(plant, motion);
    for (sum, (force, moment)) in all.iter_mut().zip(applied) {
        sum.0 += force;
        sum.1 += moment;
    }
    all
}

/// Accelerations of the drives of an assembled machine; `motion` is at q̈ = 0.
fn coupled(
    plant: &Plant,
    motion: &Motion,
    applied: &[Twist; SLOTS],
    torque: &[f64; AXES],
    implicit: &Implicit,
) -> Result<[f64; AXES], SingularPose> {
    let axes = plant.mechanism.axes();
    let map = ChannelMap::new(&plant.geometry, motion, true, &Channel::of_drives(plant.mechanism))
        .map_err(|_| SingularPose)?;
    let (mut mass, mut load) = (map.mass(&plant.bodies, motion), [0.0; AXES]);
    for (body, (force, moment)) in total(plant, motion, applied).iter().enumerate() {
        (0..axes).for_each(|c| load[c] -= map.project(c, body, force, moment));
    }
    for axis in 0..AXES {
        let (added, push) = implicit[axis];
        load[axis] += torque[axis] + push;
        mass[(axis, axis)] += if axis < axes { added } else { 1.0 };
    }
    (axes..AXES).for_each(|axis| load[axis] = 0.0);
    let qdd: Vector4<f64> = mass.cholesky().ok_or(SingularPose)?.solve(&load.into());
    if qdd.iter().all(|x| x.is_finite()) { Ok(qdd.into()) } else { Err(SingularPose) }
}

impl Axes<'_> {
    /// Accelerations of the axes, rad/s².
    fn solve(&mut self, t: f64, y: &[f64], motion: &Motion, implicit: &Implicit) -> Result<[f64; AXES], SingularPose> {
        let torque = self.context.torque.at(t);
        let with_bodies = self.context.forces.read_accelerations();
        self.context.solve(t, y, motion, |plant, wrenches, answer| {
            if plant.assembled {
                let qdd = coupled(plant, motion, wrenches, &torque, implicit)?;
                let moving = self::motion(plant, y, qdd)?;
                answer.drives = qdd;
                answer.bodies = moving.bodies.map(|b| (b.acceleration, b.angular_acceleration));
                let all = total(plant, &moving, wrenches);
                answer.reactions = balance(plant, &moving, &all).map_err(|_| SingularPose)?.reactions;
                return Ok(qdd);
            }
            let mut qdd = [0.0; AXES];
            for axis in 0..plant.mechanism.axes() {
                let (body, screw) = motion.drive(axis);
                let (inertia, rotation) = (&plant.bodies[body], &motion.bodies[body].rotation);
                let (added, push) = implicit[axis];
                let gravity = plant.gravity_vector();
                let weight = (gravity * inertia.mass, (rotation * inertia.first_moment).cross(&gravity));
                let load = screw.effort(&wrenches[body]) + screw.effort(&weight);
                qdd[axis] = (torque[axis] + push + load) / (screw.inertia(inertia, rotation) + added);
            }
            if qdd.iter().all(|x| x.is_finite()) {
                answer.drives = qdd;
                if with_bodies {
                    let moving = self::motion(plant, y, qdd)?;
                    answer.bodies = moving.bodies.map(|b| (b.acceleration, b.angular_acceleration));
                }
                Ok(qdd)
            } else {
                Err(SingularPose)
            }
        })
    }

    /// Motion of all bodies at a state, with accelerations, and the forces of the balls on the struts, N.
    pub fn evaluate(&mut self, t: f64, y: &[f64]) -> Result<(Motion, [Vector3<f64>; MAX_SOCKETS]), SingularPose> {
        let still = motion(&self.context.plant, y, [0.0; AXES])?;
        self.context.prepare(t, y, &still);
        let qdd = self.solve(t, y, &still, &Implicit::default())?;
        let Context { plant, scratch, .. } = &*self.context;
        let moving = motion(plant, y, qdd)?;
        let all = total(plant, &moving, self.context.loads());
        let sockets = match plant.assembled {
            true => ball_forces(&moving, &all, &scratch.answer.reactions),
            false => [Vector3::zeros(); MAX_SOCKETS],
        };
        Ok((moving, sockets))
    }

    fn implicit(&mut self, t: f64, y: &[f64], sum: &[f64], g: f64) -> Implicit {
        self.context.scratch.motors.sums = std::array::from_fn(|i| sum[AXES + i]);
        let Context { forces, layout, torque, scratch, .. } = &*self.context;
        let damping = scratch.damping.drives;
        let mut out: Implicit = std::array::from_fn(|a| (g * damping[a], -damping[a] * sum[AXES + a]));
        let (own, moved) = (&y[layout.own()], &sum[layout.own()]);
        for (arm, inertia, torque) in forces.gear_terms(&torque.at(t), &scratch.motors, own, moved, g) {
            out[arm].0 += inertia;
            out[arm].1 += torque;
        }
        out
    }
}

impl System for Axes<'_> {
    fn stage(&mut self, stage: &Stage, k: &mut [f64]) -> Result<(), SingularPose> {
        let Stage { t, y, sum, g, first } = *stage;
        let mut motion = motion(&self.context.plant, y, [0.0; AXES])?;
        self.context.prepare(t, y, &motion);
        let implicit = if g > 0.0 {
            if first {
                self.context.measure_damping(t, y, &mut motion);
            }
            self.implicit(t, y, sum, g)
        } else {
            Implicit::default()
        };
        motion.qdd = self.solve(t, y, &motion, &implicit)?;
        k[..AXES].copy_from_slice(&motion.qd);
        k[AXES..LENGTH].copy_from_slice(&motion.qdd);
        self.context.rest_of_stage(stage, &motion, 0.0, k);
        Ok(())
    }

    /// No constraints between the axes.
    fn project(&mut self, _y: &mut [f64]) -> Result<(), SingularPose> {
        Ok(())
    }
}
