//! The mechanism in absolute coordinates as a system of differential equations: any sockets may be open.
//!
//! Runs from the first dislocation on. Struts are rigid here, whatever their elasticity before.

use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};

use super::SingularPose;
use super::assembled::{MAX_REACTION_ITERATIONS, REACTION_TOLERANCE, Scratch, change};
use super::forces::{Forces, Probe, Scene};
use super::integrator::System;
use super::layout::{Layout, WORK_CONTACT, WORK_EFFECTS, WORK_RESTRAINTS, WORK_STRUTS};
use super::loose::Loose;
use super::state::BodyState;
use super::torque::Torque;
use super::wrench::{Load, Twist};
use crate::dynamics::Plant;
use crate::kinematics::{BodyMotion, Motion, Reactions, SocketSet, Telescope};
use crate::model::bodies::{ARM, BODIES, ROTOR, STRUT, TELESCOPE_LOWER};
use crate::model::{ARMS, AXES, Geometry, STRUTS};

/// Per body: position, quaternion, velocity, angular velocity (world axes); then the rotor's angle with all its turns.
const BODY: usize = 13;
const PSI: usize = BODY * BODIES;
/// Length of positions and velocities.
pub(super) const LENGTH: usize = PSI + 1;

/// Right-hand side for one step.
pub(super) struct Absolute<'a> {
    pub plant: &'a Plant,
    pub forces: &'a Forces,
    pub loose: &'a mut Loose,
    pub layout: Layout,
    pub torque: Torque,
    pub external: &'a Load,
    pub closed: SocketSet,
    pub scratch: &'a mut Scratch,
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

/// Damping that keeps strut `s` from spinning, N·m·s/rad: none once it has left both its balls.
fn spin_restraint(plant: &Plant, closed: SocketSet, s: usize) -> f64 {
    if closed.contains(s) || closed.contains(STRUTS + s) { plant.spin_damping } else { 0.0 }
}

/// Accelerations of all bodies and the forces in the sockets.
pub(super) struct Solution {
    pub bodies: [Twist; BODIES],
    pub reactions: Reactions,
    pub socket_force: [Vector3<f64>; 2 * STRUTS],
}

impl Absolute<'_> {
    fn scene<'b>(&self, t: f64, motion: &'b Motion, own: &'b [f64]) -> Scene<'b> {
        Scene { t, motion, own, torque: self.torque.at(t), closed: self.closed }
    }

    /// Solves for accelerations and reactions at a motion; `sum` and `g` are the stage's implicit terms.
    fn solve(
        &mut self,
        t: f64,
        motion: &Motion,
        own: &[f64],
        implicit: Option<(&[f64], f64)>,
    ) -> Result<Solution, SingularPose> {
        let mut base = self.external.at(t);
        let scene = self.scene(t, motion, own);
        let scratch = &mut *self.scratch;
        self.forces.add(self.plant, &scene, &scratch.reactions, false, &mut base, &mut scratch.powers);
        scratch.restraint_power = self.forces.add_brakes(motion, &mut base);
        for s in 0..STRUTS {
            let u = motion.strut_axis[s];
            let spin = motion.bodies[STRUT + s].angular_velocity.dot(&u);
            base[STRUT + s].1 -= u * (spin_restraint(self.plant, self.closed, s) * spin);
        }
        scratch.wrenches = base;
        let mut damping = None;
        for (axis, torque) in self.torque.at(t).into_iter().enumerate() {
            let (body, direction) = Motion::drive(axis);
            base[body].1 += direction * torque;
        }
        if let Some((sum, g)) = implicit {
            let blocks = damping.insert([Matrix3::zeros(); BODIES]);
            let mut restrain = |body: usize, axis: Vector3<f64>, d: f64| {
                let rate = vector(&sum[BODY * body + 10..]).dot(&axis);
                base[body].1 -= axis * (d * rate);
                blocks[body] += axis * axis.transpose() * (g * d);
            };
            for axis in 0..AXES {
                let (body, direction) = Motion::drive(axis);
                restrain(body, direction, scratch.damping.drives[axis]);
            }
            for s in 0..STRUTS {
                let free = self.plant.spin_damping - spin_restraint(self.plant, self.closed, s);
                restrain(STRUT + s, motion.strut_axis[s], scratch.damping.spins[s] - free);
            }
            let (torque, at) = (self.torque.at(t), self.layout.own());
            for (arm, inertia, torque) in self.forces.gear_terms(&torque, own, &sum[at], g) {
                let (body, direction) = Motion::drive(arm);
                base[body].1 += direction * torque;
                blocks[body] += direction * direction.transpose() * inertia;
            }
        }
        let mut iteration = 0;
        loop {
            let mut wrenches = base;
            let reads = self.forces.read_reactions();
            if reads {
                let scene = self.scene(t, motion, own);
                let scratch = &mut *self.scratch;
                self.forces.add(self.plant, &scene, &scratch.reactions, true, &mut wrenches, &mut scratch.powers);
            }
            let solution =
                self.loose.solve(self.plant, &motion.bodies, self.closed, &wrenches, damping.as_ref())?.clone();
            let reactions = self.loose.axial_forces(&motion.bodies);
            let change = change(&reactions, &self.scratch.reactions);
            self.scratch.reactions = reactions;
            iteration += 1;
            if !reads || change < REACTION_TOLERANCE || iteration == MAX_REACTION_ITERATIONS {
                if reads && change >= REACTION_TOLERANCE {
                    self.scratch.unconverged = self.scratch.unconverged.max(change);
                }
                self.scratch.total = wrenches;
                return Ok(Solution { bodies: solution.bodies, reactions, socket_force: self.loose.socket_forces() });
            }
        }
    }

    /// Accelerations and forces at a state; `scratch.total` then holds all wrenches with the drives' torques.
    pub fn evaluate(&mut self, t: f64, y: &[f64]) -> Result<(Motion, Solution), SingularPose> {
        let mut motion = motion(&self.plant.geometry, y);
        let solution = self.solve(t, &motion, &y[self.layout.own()], None)?;
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
        let mut motion = motion(&self.plant.geometry, y);
        let own = &y[self.layout.own()];
        if first {
            let (torque, closed) = (self.torque.at(t), self.closed);
            let scratch = &mut *self.scratch;
            let at = Probe { t, own, torque, closed, reactions: &scratch.reactions };
            self.forces.measure_damping(self.plant, &at, &mut motion, &mut scratch.damping);
        }
        let solution = self.solve(t, &motion, own, Some((sum, g)))?;
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
        let own_at = self.layout.own();
        if !own_at.is_empty() {
            let scene = self.scene(t, &motion, own);
            self.scratch.own_rates(self.forces, self.plant, &scene, (sum, g, first), own_at, k);
        }
        let tau = self.torque.at(t);
        let work = &mut k[self.layout.work()];
        for a in 0..AXES {
            work[a] = tau[a] * motion.qd[a];
        }
        work[WORK_RESTRAINTS] = self.scratch.restraint_power;
        for s in 0..STRUTS {
            let spin = motion.bodies[STRUT + s].angular_velocity.dot(&motion.strut_axis[s]);
            work[WORK_RESTRAINTS] -= spin_restraint(self.plant, self.closed, s) * spin * spin;
        }
        work[WORK_CONTACT] = self.external.power(t, &motion);
        work[WORK_STRUTS] = 0.0;
        work[WORK_EFFECTS..].copy_from_slice(&self.scratch.powers);
        Ok(())
    }

    fn project(&mut self, y: &mut [f64]) -> Result<(), SingularPose> {
        close(self.loose, self.plant, y, self.closed)
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
