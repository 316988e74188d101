//! The drives' coordinates as a system of differential equations: arms and rotor of a disassembled robot, a single axis, or an
//! assembled relative of the delta robot with intact sockets.
//!
//! Of a disassembled machine every body rotates about a fixed axis e through its origin, so that the axes are decoupled: with
//! Θ the moment of inertia about e, h the first moment and M the moments of effects and contacts, Θ·q̈ = τ + e·(M + h × g).
//! Of an assembled one, with ξ the twists of all bodies per unit rate of each drive, M_b their inertias and w the applied
//! minus the inertial wrenches at q̈ = 0, (Σ ξᵀ M_b ξ)·q̈ = τ + Σ ξᵀ w.

use nalgebra::{Matrix4, Vector3, Vector4};

use super::SingularPose;
use super::context::Context;
use super::integrator::{Stage, System};
use super::wrench::{STILL, Twist};
use crate::dynamics::{ChannelMap, Plant, balance, ball_forces, rigid_wrenches};
use crate::effects::ActiveEffect;
use crate::kinematics::{Closed, JointState, Motion};
use crate::machine::bodies::SLOTS;
use crate::machine::{PerAxis, PerSocket, axes_from, each, every_axis, rate_place};
use crate::recording::Channel;

/// Place of the rates, after the angles.
pub(super) const RATES: std::ops::Range<usize> = axes_from(rate_place(0));
/// Place of the plate's pose and the passive arms' angle, which follow from the drives: from the integrated ones the closure
/// starts, and each step ends with the closed ones.
const PLATE: std::ops::Range<usize> = RATES.end..RATES.end + Closed::LENGTH;
/// Number of angles, rates and coordinates of the plate.
pub(super) const LENGTH: usize = PLATE.end;

/// The machine at the state of the last evaluation, as far as its poses and rates determine it.
pub(super) struct Work {
    /// Without accelerations.
    motion: Motion,
    /// Rates of plate and passive arms.
    plate: Closed,
    /// Virtual motions of the drives.
    drives: ChannelMap,
    /// Mass matrix of the drives.
    mass: Matrix4<f64>,
    /// Weight minus inertial wrench of every body.
    rigid: [Twist; SLOTS],
    /// Whether the state is still the one of the last evaluation: the step that starts from it shares the work.
    fresh: bool,
    /// Whether a law depends on the forces of the struts.
    loaded: bool,
}

impl Work {
    pub fn new(plant: &Plant) -> Self {
        let reads = |a: &ActiveEffect| a.effect.spec().reads.reactions || a.states_read_reactions();
        Self {
            motion: Motion::REST,
            plate: Closed::default(),
            drives: ChannelMap::without_motion(&Channel::of_drives(plant.mechanism)),
            mass: Matrix4::zeros(),
            rigid: [STILL; SLOTS],
            fresh: false,
            loaded: plant.assembled && plant.effects.iter().any(reads),
        }
    }

    /// Marks the last evaluation as one of another state or machine.
    pub fn invalidate(&mut self) {
        self.fresh = false;
    }
}

/// Right-hand side for one step.
pub(super) struct Axes<'a> {
    pub context: &'a mut Context,
    pub work: &'a mut Work,
}

/// Stores angles and rates of a motion in a state, with the plate where they place it.
///
/// # Errors
/// [`SingularPose`] if the struts reach no common plate.
pub(super) fn store(plant: &Plant, y: &mut [f64], motion: &Motion) -> Result<(), SingularPose> {
    y[every_axis()].copy_from_slice(&motion.q);
    y[RATES].copy_from_slice(&motion.qd);
    close(plant, y, None)
}

/// Sets the plate's pose at the drives of a state, in the assembly of the pose `near`, if it leads there.
fn close(plant: &Plant, y: &mut [f64], near: Option<&Closed>) -> Result<(), SingularPose> {
    if plant.assembled {
        let plate = plant.geometry.closed(&y[every_axis()], near).map_err(|_| SingularPose)?;
        y[PLATE].copy_from_slice(&plate.coordinates());
    }
    Ok(())
}

fn joints(y: &[f64]) -> JointState {
    JointState {
        q: std::array::from_fn(|i| y[i]),
        qd: std::array::from_fn(|i| y[rate_place(i)]),
        ..JointState::default()
    }
}

impl Context {
    /// Motion at a state of [`Axes`], without accelerations; the arms alone where the struts reach no common plate.
    pub fn in_drives(&self, y: &[f64]) -> Motion {
        let (joints, mut motion) = (joints(y), Motion::REST);
        match self.plant.set_motion_near(&joints, Some(&Closed::of(&y[PLATE])), &mut motion) {
            Ok(_) => motion,
            Err(_) => Motion::disassembled(&self.plant.geometry, &joints),
        }
    }
}

/// Implicit terms of a Rosenbrock stage per axis: inertia (kg·m²) and torque (N·m).
type Implicit = PerAxis<(f64, f64)>;

/// Applied minus inertial wrenches, with the accelerations of `motion`.
fn total(plant: &Plant, motion: &Motion, applied: &[Twist; SLOTS]) -> [Twist; SLOTS] {
    let mut all = rigid_wrenches(plant, motion);
    for (sum, (force, moment)) in all.iter_mut().zip(applied) {
        sum.0 += force;
        sum.1 += moment;
    }
    all
}

impl Work {
    /// Sets everything at a state.
    ///
    /// # Errors
    /// [`SingularPose`] if the struts reach no common plate.
    fn place(&mut self, plant: &Plant, y: &[f64]) -> Result<(), SingularPose> {
        if self.fresh {
            return Ok(());
        }
        let (near, geometry) = (Closed::of(&y[PLATE]), &plant.geometry);
        self.plate = plant.set_motion_near(&joints(y), Some(&near), &mut self.motion).map_err(|_| SingularPose)?;
        self.drives.set(geometry, &self.motion, plant.assembled).map_err(|_| SingularPose)?;
        self.mass = self.drives.mass(&plant.bodies, &self.motion);
        (self.drives.channels.len()..every_axis().end).for_each(|axis| self.mass[(axis, axis)] = 1.0);
        self.rigid = rigid_wrenches(plant, &self.motion);
        Ok(())
    }

    /// The motion with these accelerations of the drives.
    fn moving(&self, qdd: PerAxis<f64>) -> Motion {
        let mut moving = self.motion;
        moving.qdd = qdd;
        self.drives.accelerate(&mut moving, &qdd);
        moving
    }
}

impl Axes<'_> {
    /// Accelerations of the axes at the state of the last [`Work::place`], rad/s²; with `complete`, strut forces are computed even
    /// if no law depends on them.
    fn solve(&mut self, t: f64, y: &[f64], implicit: &Implicit, complete: bool) -> Result<PerAxis<f64>, SingularPose> {
        let Self { context, work } = self;
        let (work, torque) = (&**work, context.torque.at(t));
        let with_bodies = context.forces.read_accelerations();
        let axes = work.drives.channels.len();
        let mut mass = work.mass;
        (0..axes).for_each(|axis| mass[(axis, axis)] += implicit[axis].0);
        let mass = mass.cholesky().ok_or(SingularPose)?;
        context.solve(t, y, &work.motion, |plant, applied, answer| {
            let mut load = Vector4::zeros();
            for (body, ((force, moment), own)) in applied.iter().zip(&work.rigid).enumerate().take(work.motion.slots())
            {
                let (force, moment) = (force + own.0, moment + own.1);
                (0..axes).for_each(|c| load[c] -= work.drives.project(c, body, &force, &moment));
            }
            (0..axes).for_each(|axis| load[axis] += torque[axis] + implicit[axis].1);
            let qdd: PerAxis<f64> = mass.solve(&load).into();
            if !qdd.iter().all(|x| x.is_finite()) {
                return Err(SingularPose);
            }
            answer.drives = qdd;
            if with_bodies || work.loaded || complete {
                let moving = work.moving(qdd);
                if with_bodies {
                    answer.bodies = moving.bodies.map(|b| (b.acceleration, b.angular_acceleration));
                }
                if plant.assembled {
                    let all = total(plant, &moving, applied);
                    answer.reactions = balance(plant, &moving, &all).map_err(|_| SingularPose)?.reactions;
                }
            }
            Ok(qdd)
        })
    }

    /// Motion of all bodies at a state, with accelerations, and the forces of the balls on the struts, N.
    pub fn evaluate(&mut self, t: f64, y: &[f64]) -> Result<(Motion, PerSocket<Vector3<f64>>), SingularPose> {
        self.work.place(&self.context.plant, y)?;
        self.context.prepare(t, y, &self.work.motion);
        let qdd = self.solve(t, y, &Implicit::default(), true)?;
        self.work.fresh = true;
        let moving = self.work.moving(qdd);
        let Context { plant, scratch, .. } = &*self.context;
        let sockets = match plant.assembled {
            true => ball_forces(&moving, &total(plant, &moving, self.context.loads()), &scratch.answer.reactions),
            false => each(Vector3::zeros()),
        };
        Ok((moving, sockets))
    }

    fn implicit(&mut self, t: f64, y: &[f64], sum: &[f64], g: f64) -> Implicit {
        self.context.scratch.motors.sums = std::array::from_fn(|i| sum[rate_place(i)]);
        let Context { forces, layout, torque, scratch, .. } = &*self.context;
        let damping = scratch.damping.drives;
        let mut out: Implicit = std::array::from_fn(|a| (g * damping[a], -damping[a] * sum[rate_place(a)]));
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
        if !first {
            self.work.invalidate();
        }
        self.work.place(&self.context.plant, y)?;
        self.work.invalidate();
        self.context.prepare(t, y, &self.work.motion);
        let implicit = if g > 0.0 {
            if first {
                self.context.measure_damping(t, y, &mut self.work.motion);
            }
            self.implicit(t, y, sum, g)
        } else {
            Implicit::default()
        };
        k[every_axis()].copy_from_slice(&self.work.motion.qd);
        let qdd = self.solve(t, y, &implicit, false)?;
        k[RATES].copy_from_slice(&qdd);
        k[PLATE].copy_from_slice(&self.work.plate.coordinates());
        let motion = &mut self.work.motion;
        motion.qdd = qdd;
        self.context.rest_of_stage(stage, motion, 0.0, k);
        Ok(())
    }

    /// Closes the loops for the plate.
    fn project(&mut self, y: &mut [f64]) -> Result<(), SingularPose> {
        let near = Closed::of(&y[PLATE]);
        close(&self.context.plant, y, Some(&near))
    }
}
