//! The mechanism in absolute coordinates as a system of differential equations: any sockets may be open.
//!
//! Runs from the first dislocation on. Struts are rigid here, whatever their elasticity before.

use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};

use super::SingularPose;
use super::context::{Answer, Context};
use super::integrator::System;
use super::loose::Loose;
use super::state::BodyState;
use super::wrench::Twist;
use crate::dynamics::Plant;
use crate::kinematics::{BodyMotion, Motion, Reactions, SocketSet, Telescope};
use crate::model::bodies::{ARM, BODIES, PLATFORM, ROTOR, STRUT, TELESCOPE_LOWER};
use crate::model::{ARMS, AXES, Geometry, STRUTS};

/// Per body: position, quaternion, velocity, angular velocity (world axes); then the rotor's angle with all its turns.
const BODY: usize = 13;
const PSI: usize = BODY * BODIES;
/// Length of positions and velocities.
pub(super) const LENGTH: usize = PSI + 1;

/// Right-hand side for one step.
pub(super) struct Absolute<'a> {
    pub context: &'a mut Context,
    pub loose: &'a mut Loose,
}

pub(super) fn store(y: &mut [f64], motion: &Motion) {
    for (b, m) in motion.bodies.iter().enumerate() {
        let q = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(m.rotation));
        let at = &mut y[BODY * b..BODY * (b + 1)];
        at[..3].copy_from_slice(m.position.as_slice());
        at[3..7].copy_from_slice(&[q.w, q.i, q.j, q.k]);
        at[7..10].copy_from_slice(m.velocity.as_slice());
        at[10..].copy_from_slice(m.angular_velocity.as_slice());
    }
    y[PSI] = motion.q[3];
}

fn vector(y: &[f64]) -> Vector3<f64> {
    Vector3::new(y[0], y[1], y[2])
}

fn quaternion(y: &[f64]) -> Quaternion<f64> {
    Quaternion::new(y[0], y[1], y[2], y[3])
}

/// Motion of all bodies at a state.
pub(super) fn motion(geometry: &Geometry, y: &[f64]) -> Motion {
    let bodies: [BodyMotion; BODIES] = std::array::from_fn(|b| {
        let at = &y[BODY * b..BODY * (b + 1)];
        BodyMotion {
            rotation: UnitQuaternion::new_normalize(quaternion(&at[3..7])).to_rotation_matrix().into_inner(),
            position: vector(&at[..3]),
            velocity: vector(&at[7..10]),
            angular_velocity: vector(&at[10..]),
            ..BodyMotion::REST
        }
    });
    let mut q = [0.0, 0.0, 0.0, y[PSI]];
    let mut qd = [0.0, 0.0, 0.0, bodies[ROTOR].angular_velocity.z];
    for i in 0..ARMS {
        let x = bodies[ARM + i].rotation.column(0);
        q[i] = (-x.z).atan2(x.dot(&Geometry::radial(i)));
        qd[i] = bodies[ARM + i].angular_velocity.dot(&Geometry::tangential(i));
    }
    let bar = geometry.upper_hooke() - bodies[TELESCOPE_LOWER].position;
    let length = bar.norm();
    let axis = bar / length;
    Motion {
        q,
        qd,
        qdd: [0.0; AXES],
        strut_axis: std::array::from_fn(|s| bodies[STRUT + s].rotation.column(0).into_owned()),
        strut_length: std::array::from_fn(|s| geometry.strut_length[s / 2]),
        telescope: Telescope { axis, length, rate: -axis.dot(&bodies[TELESCOPE_LOWER].velocity) },
        bodies,
    }
}

/// Accelerations of all bodies and the forces in the sockets.
pub(super) struct Solution {
    pub bodies: [Twist; BODIES],
    pub reactions: Reactions,
    pub socket_force: [Vector3<f64>; 2 * STRUTS],
}

impl Absolute<'_> {
    /// Solves for accelerations and reactions at a motion; `implicit` are the stage's sum and hγ.
    fn solve(
        &mut self,
        t: f64,
        y: &[f64],
        motion: &Motion,
        implicit: Option<(&[f64], f64)>,
    ) -> Result<Solution, SingularPose> {
        self.context.prepare(t, y, motion);
        let Context { forces, layout, torque, closed, scratch, .. } = &*self.context;
        let (torque, closed) = (torque.at(t), *closed);
        // Drives, and a Rosenbrock stage's implicit terms: moments and what they add to the inertia.
        let mut moments = [Vector3::zeros(); BODIES];
        let mut damping = implicit.map(|_| [Matrix3::zeros(); BODIES]);
        for (axis, torque) in torque.into_iter().enumerate() {
            let (body, direction) = Motion::drive(axis);
            moments[body] += direction * torque;
        }
        if let (Some((sum, g)), Some(blocks)) = (implicit, &mut damping) {
            let damped = &scratch.damping;
            let mut restrain = |body: usize, axis: Vector3<f64>, d: f64| {
                let rate = vector(&sum[BODY * body + 10..]).dot(&axis);
                moments[body] -= axis * (d * rate);
                blocks[body] += axis * axis.transpose() * (g * d);
            };
            for axis in 0..AXES {
                let (body, direction) = Motion::drive(axis);
                restrain(body, direction, damped.drives[axis]);
            }
            for s in 0..STRUTS {
                restrain(STRUT + s, motion.strut_axis[s], damped.spins[s]);
            }
            for (arm, inertia, torque) in forces.gear_terms(&torque, &y[layout.own()], &sum[layout.own()], g) {
                let (body, direction) = Motion::drive(arm);
                moments[body] += direction * torque;
                blocks[body] += direction * direction.transpose() * inertia;
            }
        }
        let loose = &mut *self.loose;
        self.context.solve(t, y, motion, |plant, wrenches| {
            let mut all = *wrenches;
            for (wrench, moment) in all.iter_mut().zip(&moments) {
                wrench.1 += moment;
            }
            let bodies = loose.solve(plant, &motion.bodies, closed, &all, damping.as_ref())?.bodies;
            let reactions = loose.axial_forces(&motion.bodies);
            let drives = std::array::from_fn(|axis| {
                let (body, direction) = Motion::drive(axis);
                bodies[body].1.dot(&direction)
            });
            let answer = Answer { reactions, drives, platform: bodies[PLATFORM].0 };
            Ok((Solution { bodies, reactions, socket_force: loose.socket_forces() }, answer))
        })
    }

    /// Accelerations and forces at a state.
    pub fn evaluate(&mut self, t: f64, y: &[f64]) -> Result<(Motion, Solution), SingularPose> {
        let mut motion = motion(&self.context.plant.geometry, y);
        let solution = self.solve(t, y, &motion, None)?;
        for (body, (linear, angular)) in motion.bodies.iter_mut().zip(solution.bodies) {
            (body.acceleration, body.angular_acceleration) = (linear, angular);
        }
        Ok((motion, solution))
    }
}

impl System for Absolute<'_> {
    fn stage(
        &mut self,
        t: f64,
        y: &[f64],
        sum: &[f64],
        g: f64,
        first: bool,
        k: &mut [f64],
    ) -> Result<(), SingularPose> {
        let mut motion = motion(&self.context.plant.geometry, y);
        if first {
            self.context.measure_damping(t, y, &mut motion);
        }
        let solution = self.solve(t, y, &motion, Some((sum, g)))?;
        for b in 0..BODIES {
            let at = &mut k[BODY * b..BODY * (b + 1)];
            let m = &motion.bodies[b];
            at[..3].copy_from_slice(m.velocity.as_slice());
            let turning = Quaternion::from_imag(m.angular_velocity) * quaternion(&y[BODY * b + 3..]) * 0.5;
            at[3..7].copy_from_slice(&[turning.w, turning.i, turning.j, turning.k]);
            at[7..10].copy_from_slice(solution.bodies[b].0.as_slice());
            at[10..].copy_from_slice(solution.bodies[b].1.as_slice());
        }
        k[PSI] = motion.qd[3];
        for i in 0..ARMS {
            motion.qdd[i] = solution.bodies[ARM + i].1.dot(&Geometry::tangential(i));
        }
        motion.qdd[3] = solution.bodies[ROTOR].1.z;
        self.context.rest_of_stage(t, y, &motion, 0.0, (sum, g, first), k);
        Ok(())
    }

    fn project(&mut self, y: &mut [f64]) -> Result<(), SingularPose> {
        close(self.loose, &self.context.plant, y, self.context.closed)
    }
}

/// Puts a state back on the rows of the joints that hold.
pub(super) fn close(loose: &mut Loose, plant: &Plant, y: &mut [f64], closed: SocketSet) -> Result<(), SingularPose> {
    let mut bodies: [BodyState; BODIES] = std::array::from_fn(|b| {
        let at = &y[BODY * b..BODY * (b + 1)];
        let orientation = UnitQuaternion::new_normalize(quaternion(&at[3..7]));
        BodyState {
            position: vector(&at[..3]),
            orientation: *orientation,
            velocity: vector(&at[7..10]),
            angular_velocity: orientation.inverse() * vector(&at[10..]),
        }
    });
    loose.project(plant, &mut bodies, closed)?;
    for (b, body) in bodies.iter().enumerate() {
        let orientation = UnitQuaternion::new_normalize(body.orientation);
        let at = &mut y[BODY * b..BODY * (b + 1)];
        at[..3].copy_from_slice(body.position.as_slice());
        at[3..7].copy_from_slice(&[orientation.w, orientation.i, orientation.j, orientation.k]);
        at[7..10].copy_from_slice(body.velocity.as_slice());
        at[10..].copy_from_slice((orientation * body.angular_velocity).as_slice());
    }
    Ok(())
}
