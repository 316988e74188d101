//! The machine in absolute coordinates as a system of differential equations: all bodies, six velocities each, every
//! closed joint as constraint rows.
//!
//! Used for a whole run on request, and from the first dislocation on. Poses and velocities of all bodies are
//! integrated, orientations as rotations exp(θ) of the orientation at the start of the step (Runge–Kutta–Munthe-Kaas
//! [Munthe-Kaas 1998]: θ̇ = dexp⁻¹(ω)); after each step the state is projected onto the rows. A disassembled robot has
//! the rows of its bearings only. Elastic struts have one additional velocity each, the rate of their elongation.

use std::ops::Range;

use nalgebra::{Quaternion, Rotation3, UnitQuaternion, Vector3};

use super::SingularPose;
use super::contacts::{Contacts, Resistance};
use super::context::{Answer, Context};
use super::forces::spin_restraint;
use super::integrator::{Stage, System};
use super::maximal::{Added, Extra, MAX_ROWS, MaximalCoordinates, Solution as Constrained, Stretch};
use super::rod::{self, Rod};
use super::state::BodyState;
use super::wrench::{Load, STILL, Twist};
use crate::dynamics::Plant;
use crate::effects::StrutSpring;
use crate::kinematics::{
    Arm, BodyMotion, JointState, Motion, Reactions, Screw, SocketSet, Telescope, without_prestress,
};
use crate::machine::bodies::{END_EFFECTOR, PLATFORM, ROTOR, SLOTS, TELESCOPE_LOWER, arm, strut};
use crate::machine::{PerAxis, PerSocket, PerStrut, StrutList, axes_from, every_axis};
use crate::numerics::with_turns;

/// Per body: position, quaternion at the start of the step, rotation θ since then, velocity, angular velocity (inertial
/// axes).
const BODY: usize = 16;
const TURN: usize = 7;
const VELOCITY: usize = 10;
const OMEGA: usize = 13;

/// Elastic struts at one instant.
type Stretches = StrutList<Stretch>;

/// The joints of a machine in absolute coordinates, and the layout of its state: bodies, then the angles of the axes
/// including full turns, which the orientations do not determine, then the elongations of the struts and their rates.
pub(super) struct Joints {
    solver: MaximalCoordinates,
    rods: Vec<Rod>,
    /// Elastic struts; `None` if they are rigid.
    springs: Option<Vec<StrutSpring>>,
    /// Place of every body in the state; empty without.
    places: [Range<usize>; SLOTS],
}

impl Joints {
    /// Joints of a machine in its configuration.
    pub fn new(plant: &Plant) -> Self {
        let solver = MaximalCoordinates::new(plant);
        let mut places = std::array::from_fn(|_| 0..0);
        solver.bodies().iter().enumerate().for_each(|(k, &b)| places[b] = BODY * k..BODY * (k + 1));
        let struts = if plant.assembled { plant.mechanism.struts() } else { 0 };
        Self {
            rods: (0..struts).map(|s| Rod::new(&plant.bodies[strut(s)], plant.geometry.strut_length(s))).collect(),
            springs: plant.effects.iter().find_map(|a| a.strut_spring()).map(|all| all[..struts].to_vec()),
            solver,
            places,
        }
    }

    /// Number of positions and velocities.
    pub fn length(&self) -> usize {
        self.rates().end
    }

    fn place(&self, body: usize) -> Range<usize> {
        self.places[body].clone()
    }

    fn has(&self, body: usize) -> bool {
        !self.places[body].is_empty()
    }

    /// Angles of the axes.
    fn angles(&self) -> Range<usize> {
        let start = BODY * self.solver.bodies().len();
        axes_from(start)
    }

    /// Elongations of the struts.
    fn elongations(&self) -> Range<usize> {
        let start = self.angles().end;
        start..start + self.rods.len()
    }

    /// Rates of the elongations.
    fn rates(&self) -> Range<usize> {
        let start = self.elongations().end;
        start..start + self.rods.len()
    }

    /// Energy of a state in excess of that with rigid struts, J, without the energy of the springs.
    pub fn stretch_energy(&self, plant: &Plant, motion: &Motion, y: &[f64]) -> f64 {
        self.springs.as_ref().map_or(0.0, |_| rod::stretch_energy(&self.rods, plant, motion, &y[self.rates()]))
    }

    /// Elastic struts at a state, without implicit terms; `None` if they are rigid.
    fn stretches(&self, y: &[f64]) -> Option<Stretches> {
        let (elongations, rates) = (&y[self.elongations()], &y[self.rates()]);
        let stretch = |s: usize, spring: &StrutSpring| {
            let (elongation, rate) = (elongations[s], rates[s]);
            let force = -spring.stiffness * elongation - spring.damping * rate;
            Stretch { rod: self.rods[s], elongation, rate, force, added: 0.0 }
        };
        self.springs.as_ref().map(|springs| springs.iter().enumerate().map(|(s, spring)| stretch(s, spring)).collect())
    }

    /// Power of the elastic struts on the bodies, W.
    fn spring_power(&self, y: &[f64]) -> f64 {
        self.stretches(y).iter().flatten().map(|s| s.force * s.rate).sum()
    }

    fn solve(
        &mut self,
        plant: &Plant,
        motion: &Motion,
        closed: SocketSet,
        wrenches: &[Twist; SLOTS],
        extra: Extra,
    ) -> Result<Solution, SingularPose> {
        let found = self.solver.solve_with(plant, &motion.bodies, closed, wrenches, extra)?;
        let Constrained { bodies, stretches, multipliers } = *found;
        let mut reactions = self.solver.axial_forces(&motion.bodies);
        let mut socket_force = self.solver.socket_forces();
        // Rigid struts that are redundant: without prestress, as long as all are held.
        if extra.stretches.is_none() && closed == plant.sockets() && self.solver.is_redundant() {
            let added = without_prestress(&plant.geometry, motion, &reactions.lower).map_err(|_| SingularPose)?;
            for (s, force) in added.into_iter().enumerate().take(self.rods.len()) {
                reactions.upper[s] += force;
                reactions.lower[s] += force;
                socket_force[s] -= motion.strut_axis[s] * force;
                socket_force[self.rods.len() + s] += motion.strut_axis[s] * force;
            }
        }
        Ok(Solution { bodies, stretches, multipliers, reactions, socket_force })
    }

    /// Projects a state onto the rows of the closed joints; returns the number of Newton corrections.
    pub fn close(&mut self, plant: &Plant, y: &mut [f64], closed: SocketSet) -> Result<usize, SingularPose> {
        let mut bodies = [BodyState::REST; SLOTS];
        self.solver.bodies().iter().for_each(|&b| bodies[b] = body_state(&y[self.place(b)]));
        let mut stretches = self.stretches(y);
        let corrections = self.solver.project_elastic(plant, &mut bodies, closed, stretches.as_deref_mut())?;
        for &b in self.solver.bodies() {
            let body = &bodies[b];
            let orientation = UnitQuaternion::new_normalize(body.orientation);
            let omega = orientation * body.angular_velocity;
            store_body(&mut y[self.place(b)], &body.position, &orientation, &body.velocity, &omega);
        }
        let (elongations, rates) = (self.elongations(), self.rates());
        for (s, stretch) in stretches.iter().flatten().enumerate() {
            (y[elongations.start + s], y[rates.start + s]) = (stretch.elongation, stretch.rate);
        }
        let q = self.motion(plant, y).q;
        y[self.angles()].copy_from_slice(&q);
        Ok(corrections)
    }

    /// Multipliers λ of all rows for a motion whose accelerations result from `wrenches` (drives included).
    pub fn multipliers(
        &mut self,
        plant: &Plant,
        motion: &Motion,
        closed: SocketSet,
        wrenches: &[Twist; SLOTS],
    ) -> Result<[f64; MAX_ROWS], SingularPose> {
        let mut y = vec![0.0; self.length()];
        self.store_stretches(&mut y, plant, motion);
        let stretches = self.stretches(&y);
        let extra = Extra { damping: None, stretches: stretches.as_deref() };
        Ok(self.solve(plant, motion, closed, wrenches, extra)?.multipliers)
    }

    /// Writes poses and velocities of a motion, and the elongations of its struts.
    pub fn store(&self, y: &mut [f64], plant: &Plant, motion: &Motion) {
        for &b in self.solver.bodies() {
            let m = &motion.bodies[b];
            let orientation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(m.rotation));
            store_body(&mut y[self.place(b)], &m.position, &orientation, &m.velocity, &m.angular_velocity);
        }
        y[self.angles()].copy_from_slice(&motion.q);
        self.store_stretches(y, plant, motion);
    }

    /// Writes the velocities of a motion without changing the poses; struts with an open socket keep their elongation
    /// rates.
    pub fn store_velocities(&self, y: &mut [f64], motion: &Motion, closed: SocketSet) {
        for &b in self.solver.bodies() {
            let (m, at) = (&motion.bodies[b], &mut y[self.place(b)]);
            at[VELOCITY..OMEGA].copy_from_slice(m.velocity.as_slice());
            at[OMEGA..].copy_from_slice(m.angular_velocity.as_slice());
        }
        for (s, rate) in y[self.rates()].iter_mut().enumerate() {
            if closed.contains(s) && closed.contains(self.rods.len() + s) {
                *rate = rod::length_rate(motion, s);
            }
        }
    }

    /// Sets all velocities to zero.
    pub fn stop(&self, y: &mut [f64]) {
        self.solver.bodies().iter().for_each(|&b| y[self.place(b)][VELOCITY..].fill(0.0));
        y[self.rates()].fill(0.0);
    }

    fn store_stretches(&self, y: &mut [f64], plant: &Plant, motion: &Motion) {
        let (elongations, rates) = (self.elongations(), self.rates());
        for s in 0..self.rods.len() {
            y[elongations.start + s] = motion.strut_length[s] - plant.geometry.strut_length(s);
            y[rates.start + s] = rod::length_rate(motion, s);
        }
    }

    /// Axis angles including full turns, rad.
    pub fn coordinates(&self, y: &[f64]) -> PerAxis<f64> {
        let at = self.angles();
        std::array::from_fn(|i| y[at.start + i])
    }

    /// Motion of all bodies at a state, without accelerations.
    pub fn motion(&self, plant: &Plant, y: &[f64]) -> Motion {
        let geometry = &plant.geometry;
        let mut out = Motion::disassembled(geometry, &JointState { q: self.coordinates(y), ..JointState::default() });
        for &b in self.solver.bodies() {
            let at = &y[self.place(b)];
            out.bodies[b] = BodyMotion {
                rotation: orientation(at).to_rotation_matrix().into_inner(),
                position: vector(at),
                velocity: vector(&at[VELOCITY..]),
                angular_velocity: vector(&at[OMEGA..]),
                ..BodyMotion::REST
            };
        }
        for (i, limb) in geometry.limbs.iter().enumerate().filter(|(i, _)| self.has(arm(*i))) {
            let body = &out.bodies[arm(i)];
            let place = Arm::coordinate(limb, body);
            out.q[i] = if limb.actuator.is_revolute() { with_turns(place, out.q[i]) } else { place };
            out.qd[i] = out.arm_screw(i).rate_of(body);
        }
        if self.has(ROTOR) {
            let rotor = &out.bodies[ROTOR];
            out.q[3] = with_turns(rotor.rotation[(1, 0)].atan2(rotor.rotation[(0, 0)]), out.q[3]);
            out.qd[3] = rotor.angular_velocity.z;
        }
        if plant.assembled {
            for (s, elongation) in y[self.elongations()].iter().enumerate() {
                out.strut_axis[s] = out.bodies[strut(s)].rotation.column(0).into_owned();
                out.strut_length[s] = geometry.strut_length(s) + elongation;
            }
            if !self.has(END_EFFECTOR) {
                let platform = out.bodies[PLATFORM];
                let lever = platform.rotation.column(2) * geometry.flange_height;
                out.bodies[END_EFFECTOR] = BodyMotion {
                    position: platform.position + lever,
                    velocity: platform.velocity + platform.angular_velocity.cross(&lever),
                    ..platform
                };
            }
        }
        if self.has(TELESCOPE_LOWER) {
            let lower = &out.bodies[TELESCOPE_LOWER];
            out.telescope = Telescope::between(&lower.position, &lower.velocity, &geometry.upper_hooke());
        }
        out
    }
}

fn store_body(
    at: &mut [f64],
    position: &Vector3<f64>,
    orientation: &UnitQuaternion<f64>,
    velocity: &Vector3<f64>,
    omega: &Vector3<f64>,
) {
    at[..3].copy_from_slice(position.as_slice());
    at[3..TURN].copy_from_slice(&[orientation.w, orientation.i, orientation.j, orientation.k]);
    at[TURN..VELOCITY].fill(0.0);
    at[VELOCITY..OMEGA].copy_from_slice(velocity.as_slice());
    at[OMEGA..].copy_from_slice(omega.as_slice());
}

fn vector(y: &[f64]) -> Vector3<f64> {
    Vector3::new(y[0], y[1], y[2])
}

/// Present orientation: that at the start of the step, rotated by θ.
fn orientation(at: &[f64]) -> UnitQuaternion<f64> {
    let start = UnitQuaternion::new_normalize(Quaternion::new(at[3], at[4], at[5], at[6]));
    UnitQuaternion::from_scaled_axis(vector(&at[TURN..])) * start
}

fn body_state(at: &[f64]) -> BodyState {
    let orientation = orientation(at);
    BodyState {
        position: vector(at),
        orientation: *orientation,
        velocity: vector(&at[VELOCITY..]),
        angular_velocity: orientation.inverse() * vector(&at[OMEGA..]),
    }
}

/// θ̇ of R = exp(θ)·R₀ for the angular velocity ω (inertial axes), up to third order in θ: dexp⁻¹(ω) = ω − ½·θ×ω +
/// 1/12·θ×(θ×ω).
fn turn_rate(turn: &Vector3<f64>, omega: &Vector3<f64>) -> Vector3<f64> {
    let once = turn.cross(omega);
    omega - once * 0.5 + turn.cross(&once) / 12.0
}

/// Rate of a joint on `body`, rad/s or m/s, in a state-like vector.
fn rate_of(joints: &Joints, screw: &Screw, body: usize, y: &[f64]) -> f64 {
    if !joints.has(body) {
        return 0.0;
    }
    let at = &y[joints.place(body)];
    screw.rate(&vector(&at[VELOCITY..]), &vector(&at[OMEGA..]))
}

/// Accelerations of all bodies, and joint forces.
pub(super) struct Solution {
    pub bodies: [Twist; SLOTS],
    /// Second derivatives of the elongations, m/s².
    stretches: PerStrut<f64>,
    /// Multiplier λ of every row, N or N·m.
    pub multipliers: [f64; MAX_ROWS],
    pub reactions: Reactions,
    pub socket_force: PerSocket<Vector3<f64>>,
}

/// Right-hand side for one step.
pub(super) struct Absolute<'a> {
    pub context: &'a mut Context,
    pub joints: &'a mut Joints,
    /// Contacts whose wrenches are taken at every stage.
    pub contacts: Option<&'a mut (dyn Contacts + 'static)>,
}

impl Absolute<'_> {
    /// Solves for accelerations and reactions at a motion; `implicit` holds the stage's sum and hγ (zero for an
    /// explicit method).
    fn solve(
        &mut self,
        t: f64,
        y: &[f64],
        motion: &Motion,
        implicit: Option<(&[f64], f64)>,
    ) -> Result<Solution, SingularPose> {
        self.context.prepare(t, y, motion);
        if let Some((sum, _)) = implicit {
            let joints = &*self.joints;
            self.context.scratch.motors.sums = std::array::from_fn(|i| {
                let (body, screw) = motion.drive(i);
                rate_of(joints, &screw, body, sum)
            });
        }
        let Context { plant, torque, closed, .. } = &*self.context;
        let (torque, closed) = (torque.at(t), *closed);
        let mut pushes = [STILL; SLOTS];
        for (axis, torque) in torque.into_iter().enumerate() {
            let (body, screw) = motion.drive(axis);
            screw.push(&mut pushes[body], torque);
        }
        let mut stretches = self.joints.stretches(y);
        let mut damping = None;
        match implicit {
            Some((sum, g)) if g > 0.0 => {
                damping = Some(self.implicit_terms((t, y, motion), (sum, g), &mut pushes, stretches.as_deref_mut()));
            }
            Some(_) => {
                // An explicit method runs without loads on the spins; their stiff restraint is omitted, so that they
                // stay at rest.
                for s in 0..self.joints.rods.len() {
                    let u = motion.strut_axis[s];
                    let spin = motion.bodies[strut(s)].angular_velocity.dot(&u);
                    pushes[strut(s)].1 += u * (spin_restraint(plant, closed, s) * spin);
                }
            }
            None => {}
        }
        let joints = &mut *self.joints;
        self.context.solve(t, y, motion, |plant, wrenches, answer| {
            let mut all = *wrenches;
            for (wrench, push) in all.iter_mut().zip(&pushes) {
                wrench.0 += push.0;
                wrench.1 += push.1;
            }
            let solution = joints.solve(
                plant,
                motion,
                closed,
                &all,
                Extra { damping: damping.as_ref(), stretches: stretches.as_deref() },
            )?;
            let drives = std::array::from_fn(|axis| {
                let (body, screw) = motion.drive(axis);
                screw.rate(&solution.bodies[body].0, &solution.bodies[body].1)
            });
            let (reactions, bodies) = (solution.reactions, solution.bodies);
            *answer = Answer { reactions, drives, platform: bodies[PLATFORM].0, bodies };
            Ok(solution)
        })
    }

    /// Adds the implicit terms of a Rosenbrock stage, forces, moments and predicted spring forces; returns the
    /// contribution of damping to the blocks of the mass matrix.
    fn implicit_terms(
        &self,
        (t, y, motion): (f64, &[f64], &Motion),
        (sum, g): (&[f64], f64),
        pushes: &mut [Twist; SLOTS],
        stretches: Option<&mut [Stretch]>,
    ) -> [Added; SLOTS] {
        let Context { forces, layout, torque, scratch, .. } = &*self.context;
        let drives = torque.at(t);
        let mut blocks = [Added::NONE; SLOTS];
        if scratch.resisted {
            for (b, contact) in scratch.resistances.iter().enumerate().filter(|(_, c)| **c != Resistance::NONE) {
                let (m, sum) = (&motion.bodies[b], &sum[self.joints.place(b)]);
                resist(&mut pushes[b], contact, (m, sum), g);
                blocks[b].resisting(contact, g);
            }
        }
        let damped = &scratch.damping;
        let mut restrain = |body: usize, screw: Screw, d: f64| {
            screw.push(&mut pushes[body], -d * rate_of(self.joints, &screw, body, sum));
            blocks[body].along(&screw, g * d);
        };
        for axis in every_axis() {
            let (body, screw) = motion.drive(axis);
            restrain(body, screw, damped.drives[axis]);
        }
        for s in 0..self.joints.rods.len() {
            restrain(strut(s), Screw::turning(motion.strut_axis[s]), damped.spins[s]);
        }
        let (own, moved) = (&y[layout.own()], &sum[layout.own()]);
        for (arm, inertia, torque) in forces.gear_terms(&drives, &scratch.motors, own, moved, g) {
            let (body, screw) = motion.drive(arm);
            screw.push(&mut pushes[body], torque);
            blocks[body].along(&screw, inertia);
        }
        for (s, stretch) in stretches.into_iter().flatten().enumerate() {
            let Some(spring) = self.joints.springs.as_ref().map(|all| &all[s]) else { continue };
            let moved = sum[self.joints.elongations().start + s];
            let changed = sum[self.joints.rates().start + s];
            stretch.force -= spring.damping * changed + spring.stiffness * (moved + g * (stretch.rate + changed));
            stretch.added = g * spring.damping + g * g * spring.stiffness;
        }
        blocks
    }

    /// Accelerations and forces at a state.
    pub fn evaluate(&mut self, t: f64, y: &[f64]) -> Result<(Motion, Solution), SingularPose> {
        let mut motion = self.joints.motion(&self.context.plant, y);
        let solution = self.solve(t, y, &motion, None)?;
        for (body, (linear, angular)) in motion.bodies.iter_mut().zip(solution.bodies) {
            (body.acceleration, body.angular_acceleration) = (linear, angular);
        }
        Ok((motion, solution))
    }
}

/// Adds −K·(s_x + hγ·(v + s_v)) − D·s_v of the contacts of a body with the twist of `m` to its loads; s_x and s_v are
/// the stage's sums of its positions and velocities, `g` is hγ.
fn resist(load: &mut Twist, contacts: &Resistance, (m, sum): (&BodyMotion, &[f64]), g: f64) {
    let twist = [m.velocity, m.angular_velocity];
    let sums = |at: [usize; 2], k: usize| sum[at[k / 3] + k % 3];
    let changed: [f64; 6] = std::array::from_fn(|k| sums([VELOCITY, OMEGA], k));
    let moved: [f64; 6] = std::array::from_fn(|k| sums([0, TURN], k) + g * (twist[k / 3][k % 3] + changed[k]));
    let back = |k: usize| {
        let along = |(i, x): (usize, &f64)| contacts.stiffness[k][i] * x + contacts.damping[k][i] * changed[i];
        moved.iter().enumerate().map(along).sum::<f64>()
    };
    for k in 0..3 {
        load.0[k] -= back(k);
        load.1[k] -= back(3 + k);
    }
}

impl Absolute<'_> {
    /// Takes the wrenches of the contacts at a stage, and at the first one their resistance for the step.
    fn touch(&mut self, motion: &Motion, first: bool) {
        let Some(contacts) = &mut self.contacts else {
            self.context.scratch.resisted = false;
            return;
        };
        self.context.external = Load::constant(*contacts.wrenches(motion, self.context.closed));
        if first {
            let scratch = &mut self.context.scratch;
            let known = contacts.resistances(motion);
            scratch.resisted = known.is_some();
            if let Some(known) = known {
                scratch.resistances.copy_from_slice(known);
                if !self.context.plant.mechanism.has_end_effector() {
                    let lever = motion.bodies[END_EFFECTOR].position - motion.bodies[PLATFORM].position;
                    let own = std::mem::replace(&mut scratch.resistances[END_EFFECTOR], Resistance::NONE);
                    scratch.resistances[PLATFORM].add(&own.seen_from(&lever));
                }
            }
        }
    }
}

impl System for Absolute<'_> {
    fn stage(&mut self, stage: &Stage, k: &mut [f64]) -> Result<(), SingularPose> {
        let Stage { t, y, sum, g, first } = *stage;
        let mut motion = self.joints.motion(&self.context.plant, y);
        self.touch(&motion, first);
        if first && g > 0.0 {
            self.context.measure_damping(t, y, &mut motion);
        }
        let solution = self.solve(t, y, &motion, Some((sum, g)))?;
        // Position rates are the velocities; with elastic struts or contacts, whose stiffness is implicit, those one step
        // ahead.
        let ahead = (self.joints.springs.is_some() || self.context.scratch.resisted) && g > 0.0;
        let rate = |now: Vector3<f64>, at: usize, slope: Vector3<f64>| {
            if ahead { now + vector(&sum[at..]) + slope * g } else { now }
        };
        for &b in self.joints.solver.bodies() {
            let (m, (linear, angular)) = (&motion.bodies[b], solution.bodies[b]);
            let place = self.joints.place(b);
            let velocity = rate(m.velocity, place.start + VELOCITY, linear);
            let omega = rate(m.angular_velocity, place.start + OMEGA, angular);
            let turning = turn_rate(&vector(&y[place.start + TURN..]), &omega);
            let at = &mut k[place];
            at[..3].copy_from_slice(velocity.as_slice());
            at[3..TURN].fill(0.0);
            at[TURN..VELOCITY].copy_from_slice(turning.as_slice());
            at[VELOCITY..OMEGA].copy_from_slice(linear.as_slice());
            at[OMEGA..].copy_from_slice(angular.as_slice());
        }
        k[self.joints.angles()].copy_from_slice(&motion.qd);
        let (elongations, rates) = (self.joints.elongations().start, self.joints.rates());
        for (s, at) in rates.enumerate() {
            let slope = solution.stretches[s];
            let ahead = if ahead { sum[at] + g * slope } else { 0.0 };
            k[elongations + s] = y[at] + ahead;
            k[at] = slope;
        }
        for axis in every_axis() {
            let (body, screw) = motion.drive(axis);
            motion.qdd[axis] = screw.rate(&solution.bodies[body].0, &solution.bodies[body].1);
        }
        let struts = self.joints.spring_power(y);
        self.context.rest_of_stage(stage, &motion, struts, k);
        Ok(())
    }

    fn project(&mut self, y: &mut [f64]) -> Result<(), SingularPose> {
        self.context.scratch.corrections += self.joints.close(&self.context.plant, y, self.context.closed)?;
        Ok(())
    }
}
