//! Parts of a step that all formulations share: loads on the bodies, laws that depend on the solution, and states that
//! are not mechanical.

use nalgebra::{SVector, Vector3};

use super::SingularPose;
use super::contacts::Resistance;
use super::forces::{Damping, Evaluation, Forces, Motors, Scene, Sums, spin_restraint};
use super::integrator::Stage;
use super::layout::{Layout, WORK_CONTACT, WORK_EFFECTS, WORK_RESTRAINTS, WORK_STOPS, WORK_STRUTS};
use super::stops::{self, Hit, STOPS};
use super::torque::Torque;
use super::wrench::{Load, STILL, Twist};
use crate::dynamics::{Plant, join_end_effector};
use crate::kinematics::{JointState, KinematicsError, Motion, Reactions, SocketSet};
use crate::machine::bodies::{PLATFORM, SLOTS, strut};
use crate::machine::{PerAxis, axes_from, each, every_axis, every_strut, struts_from};
use crate::numerics::{Anderson, worst};

/// Change of the solution below which the iteration over laws that depend on it stops, N, rad/s² or m/s².
const TOLERANCE: f64 = 1e-9;
/// Iterations sufficient for a contraction factor of 2/3.
const MAX_ITERATIONS: usize = 60;

/// Part of the solution on which laws may depend.
#[derive(Clone, Copy, Debug)]
pub(super) struct Answer {
    /// Strut forces, N.
    pub reactions: Reactions,
    /// Accelerations of the drives, rad/s².
    pub drives: PerAxis<f64>,
    /// Acceleration of the platform, m/s².
    pub platform: Vector3<f64>,
    /// Accelerations of all bodies, m/s² and rad/s²; zero unless a law depends on accelerations.
    pub bodies: [Twist; SLOTS],
}

impl Default for Answer {
    fn default() -> Self {
        Self { reactions: Reactions::default(), drives: each(0.0), platform: Vector3::zeros(), bodies: [STILL; SLOTS] }
    }
}

impl Answer {
    /// The motion with these accelerations.
    fn on(&self, motion: &Motion) -> Motion {
        let mut moving = *motion;
        moving.qdd = self.drives;
        for (body, (linear, angular)) in moving.bodies.iter_mut().zip(&self.bodies) {
            (body.acceleration, body.angular_acceleration) = (*linear, *angular);
        }
        moving
    }

    /// All numbers: forces, then accelerations of drives and bodies.
    fn numbers(&self) -> Numbers {
        let mut out = Numbers::zeros();
        let bodies = self.bodies.iter().flat_map(|(linear, angular)| linear.iter().chain(angular)).copied();
        let all = self.reactions.upper.into_iter().chain(self.reactions.lower).chain(self.drives).chain(bodies);
        out.iter_mut().zip(all).for_each(|(x, value)| *x = value);
        out
    }

    /// The answer with these numbers.
    fn of(numbers: &Numbers) -> Self {
        let numbers = numbers.as_slice();
        let vector = |at: usize| Vector3::from_column_slice(&numbers[BODIES + at..][..3]);
        let bodies: [Twist; SLOTS] = std::array::from_fn(|b| (vector(6 * b), vector(6 * b + 3)));
        Self {
            reactions: Reactions::of(&numbers[..LOWER], &numbers[LOWER..DRIVES]),
            drives: std::array::from_fn(|axis| numbers[DRIVES + axis]),
            platform: bodies[PLATFORM].0,
            bodies,
        }
    }
}

/// The numbers of an [`Answer`].
type Numbers = SVector<f64, { BODIES + 6 * SLOTS }>;
/// First force on a lower ball, and first acceleration of drives and bodies, among the numbers.
const LOWER: usize = every_strut().end;
const DRIVES: usize = struts_from(LOWER).end;
const BODIES: usize = axes_from(DRIVES).end;

/// Buffers that are kept during a run.
pub(super) struct Scratch {
    /// Solution of the last evaluation, initial guess of the next.
    pub answer: Answer,
    /// Largest change in the last iteration of evaluations that did not converge, N, rad/s² or m/s²; zero if all
    /// converged.
    pub unconverged: f64,
    /// Number of solutions of the equations of motion so far.
    pub solutions: usize,
    /// Number of Newton corrections of the loop closure so far.
    pub corrections: usize,
    /// Wrenches that do not depend on the solution, without the drives.
    pub wrenches: [Twist; SLOTS],
    /// All wrenches of the last evaluation, without the drives, where laws depend on the solution.
    total: [Twist; SLOTS],
    /// Damping in W for the present step.
    pub damping: Damping,
    /// Resistance of contacts in W for the present step, and whether there is any: contacts are evaluated at every
    /// stage.
    pub resistances: Box<[Resistance; SLOTS]>,
    pub resisted: bool,
    /// Loads on the rotors of elastic gears; those that do not depend on the solution are in `resting`.
    pub motors: Motors,
    resting: PerAxis<f64>,
    /// The first law whose value was not finite.
    pub fault: Option<KinematicsError>,
    /// Power of each effect, W.
    powers: Vec<f64>,
    /// Power of the restraint of the spins, of the brakes and of known loads, W.
    restraint_power: f64,
    /// Joints beyond their hard stops at the last evaluation.
    pub hits: [Option<Hit>; STOPS],
    /// Power of the hard stops, W.
    stop_power: f64,
    slopes: Vec<f64>,
    fresh_slopes: Vec<f64>,
}

impl Scratch {
    pub fn new(plant: &Plant, forces: &Forces) -> Self {
        Self {
            answer: Answer::default(),
            unconverged: 0.0,
            solutions: 0,
            corrections: 0,
            wrenches: [STILL; SLOTS],
            total: [STILL; SLOTS],
            damping: Damping::default(),
            resistances: Box::new([Resistance::NONE; SLOTS]),
            resisted: false,
            motors: Motors::default(),
            resting: each(0.0),
            fault: None,
            powers: vec![0.0; plant.effects.len()],
            restraint_power: 0.0,
            hits: [None; STOPS],
            stop_power: 0.0,
            slopes: vec![0.0; forces.states()],
            fresh_slopes: vec![0.0; forces.states()],
        }
    }
}

/// Machine, surroundings and buffers.
pub(super) struct Context {
    pub plant: Plant,
    pub forces: Forces,
    pub layout: Layout,
    /// Drive torques.
    pub torque: Torque,
    /// External wrenches.
    pub external: Load,
    /// Closed sockets.
    pub closed: SocketSet,
    pub scratch: Scratch,
}

impl Context {
    /// All wrenches of the last evaluation, without the drives.
    pub fn loads(&self) -> &[Twist; SLOTS] {
        if self.forces.read_answer() { &self.scratch.total } else { &self.scratch.wrenches }
    }

    fn scene<'b>(&self, t: f64, y: &'b [f64]) -> Scene<'b> {
        Scene { t, own: &y[self.layout.own()], torque: self.torque.at(t), closed: self.closed }
    }

    /// Writes the wrenches that do not depend on the solution to `scratch.wrenches`.
    pub fn prepare(&mut self, t: f64, y: &[f64], motion: &Motion) {
        let scene = self.scene(t, y);
        let scratch = &mut self.scratch;
        scratch.wrenches = if self.external.is_none() { [STILL; SLOTS] } else { self.external.at(t) };
        let (wrenches, powers) = (&mut scratch.wrenches, &mut scratch.powers);
        let reactions = &scratch.answer.reactions;
        scratch.resting = each(0.0);
        let at = Evaluation { plant: &self.plant, scene: &scene, motion, reactions };
        self.forces.add(&at, false, Sums { wrenches, motors: &mut scratch.resting, powers });
        scratch.fault = scratch.fault.take().or_else(|| self.forces.fault(&at, powers));
        scratch.motors.torque = scratch.resting;
        scratch.restraint_power = self.forces.add_brakes(motion, wrenches);
        scratch.restraint_power += self.plant.add_loads(t, motion, wrenches);
        scratch.hits = stops::hits(&self.plant, motion);
        scratch.stop_power = stops::add(&self.plant, motion, &scratch.hits, wrenches);
        for s in 0..motion.struts() {
            let u = motion.strut_axis[s];
            let spin = motion.bodies[strut(s)].angular_velocity.dot(&u);
            let damping = spin_restraint(&self.plant, self.closed, s);
            wrenches[strut(s)].1 -= u * (damping * spin);
            scratch.restraint_power -= damping * spin * spin;
        }
        join_end_effector(&self.plant.geometry, motion, wrenches);
    }

    /// Solves `equations` for wrenches on the bodies, iterating over the laws that depend on the solution, which they write
    /// to their last argument.
    pub fn solve<S>(
        &mut self,
        t: f64,
        y: &[f64],
        motion: &Motion,
        mut equations: impl FnMut(&Plant, &[Twist; SLOTS], &mut Answer) -> Result<S, SingularPose>,
    ) -> Result<S, SingularPose> {
        if !self.forces.read_answer() {
            let scratch = &mut self.scratch;
            scratch.solutions += 1;
            return equations(&self.plant, &scratch.wrenches, &mut scratch.answer);
        }
        let mut mixing = self.forces.read_accelerations().then(Anderson::default);
        let scene = self.scene(t, y);
        let mut iteration = 0;
        loop {
            let scratch = &mut self.scratch;
            scratch.total = scratch.wrenches;
            let (total, powers) = (&mut scratch.total, &mut scratch.powers);
            let answer = &scratch.answer;
            let moving = mixing.is_some().then(|| answer.on(motion));
            let moved = moving.as_ref().unwrap_or(motion);
            let (reactions, motors) = (&answer.reactions, &mut scratch.motors.torque);
            *motors = scratch.resting;
            let at = Evaluation { plant: &self.plant, scene: &scene, motion: moved, reactions };
            self.forces.add(&at, true, Sums { wrenches: total, motors, powers });
            join_end_effector(&self.plant.geometry, moved, total);
            scratch.fault = scratch.fault.take().or_else(|| self.forces.fault(&at, powers));
            let before = scratch.answer;
            let solution = equations(&self.plant, &scratch.total, &mut scratch.answer)?;
            let answer = scratch.answer;
            let change = change(&answer, &before);
            scratch.solutions += 1;
            iteration += 1;
            if change < TOLERANCE {
                return Ok(solution);
            }
            if iteration == MAX_ITERATIONS {
                scratch.unconverged = worst(scratch.unconverged, change);
                return Ok(solution);
            }
            if let Some(mixing) = &mut mixing {
                scratch.answer = Answer::of(&mixing.next(&before.numbers(), &answer.numbers()));
            }
        }
    }

    /// Rates and accelerations of the encoders, for a motion with accelerations.
    pub fn of_encoders(&self, t: f64, y: &[f64], motion: &Motion) -> [PerAxis<f64>; 2] {
        let motors = self.forces.of_motors(&self.scene(t, y), motion, &self.scratch.motors.torque);
        // The motion behind the encoders, axis by axis: rate and acceleration are those of the encoder times a slope,
        // the acceleration with a term of the rate alone.
        let q = self.forces.encoders(&self.plant, &y[self.layout.own()], &motion.q);
        let behind = |qd: PerAxis<f64>| self.plant.behind_encoders(&JointState { q, qd, qdd: each(0.0) });
        let slope = behind(each(1.0)).qd;
        let rate = std::array::from_fn(|i| motors.qd[i] / slope[i]);
        let own = behind(rate).qdd;
        [rate, std::array::from_fn(|i| (motors.qdd[i] - own[i]) / slope[i])]
    }

    /// Determines the damping in W for the next step; `motion` is unchanged on return.
    pub fn measure_damping(&mut self, t: f64, y: &[f64], motion: &mut Motion) {
        let scene = self.scene(t, y);
        let scratch = &mut self.scratch;
        self.forces.measure_damping(&self.plant, &scene, motion, &scratch.answer.reactions, &mut scratch.damping);
        scratch.motors.damping = scratch.damping.motors;
    }

    /// Writes the stage derivatives of the states that are not mechanical: internal states of the effects, with (1 −
    /// g·J)·k = rate + J·sum and their slopes J at the first stage, and the work.
    ///
    /// `motion` must hold the accelerations of the drives; `struts` is the power of elastic struts, W.
    pub fn rest_of_stage(&mut self, stage: &Stage, motion: &Motion, struts: f64, k: &mut [f64]) {
        let Stage { t, y, sum, g, first } = *stage;
        let scene = self.scene(t, y);
        let own = self.layout.own();
        let scratch = &mut self.scratch;
        if !own.is_empty() {
            let (rates, slopes) = (&mut k[own.clone()], &mut scratch.fresh_slopes);
            let motors = &scratch.motors;
            let reactions = &scratch.answer.reactions;
            let moving = self.forces.read_accelerations().then(|| scratch.answer.on(motion));
            let motion = moving.as_ref().unwrap_or(motion);
            let at = Evaluation { plant: &self.plant, scene: &scene, motion, reactions };
            self.forces.state_rates(&at, &motors.torque, rates, slopes);
            if first {
                scratch.slopes.copy_from_slice(&scratch.fresh_slopes);
            }
            if g > 0.0 {
                self.forces.gear_rates(motors, &motion.qdd, (scene.own, &sum[own.clone()]), g, rates);
                for (slope, i) in scratch.slopes.iter().zip(own) {
                    k[i] = (k[i] + slope * sum[i]) / (1.0 - g * slope);
                }
            }
        }
        let work = &mut k[self.layout.work()];
        for a in every_axis() {
            work[a] = scene.torque[a] * motion.qd[a];
        }
        work[WORK_RESTRAINTS] = scratch.restraint_power;
        work[WORK_CONTACT] = if self.external.is_none() { 0.0 } else { self.external.power(t, motion) };
        work[WORK_STRUTS] = struts;
        work[WORK_STOPS] = scratch.stop_power;
        work[WORK_EFFECTS..].copy_from_slice(&scratch.powers);
    }
}

/// Largest difference of two answers; NaN if one is.
fn change(a: &Answer, b: &Answer) -> f64 {
    let beyond = |least: f64, a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x - y).fold(least, worst);
    let forces = beyond(beyond(0.0, &a.reactions.upper, &b.reactions.upper), &a.reactions.lower, &b.reactions.lower);
    beyond(beyond(forces, &a.drives, &b.drives), a.platform.as_slice(), b.platform.as_slice())
}
