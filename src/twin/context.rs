//! What both formulations share within a step: what acts on the bodies, the reactions that friction reads, and the parts
//! of the state that are not mechanics.

use nalgebra::Vector3;

use super::SingularPose;
use super::forces::{Damping, Evaluation, Forces, Motors, Scene, Sums, spin_restraint};
use super::integrator::Stage;
use super::layout::{Layout, WORK_CONTACT, WORK_EFFECTS, WORK_RESTRAINTS, WORK_STOPS, WORK_STRUTS};
use super::stops::{self, Hit, STOPS};
use super::torque::Torque;
use super::wrench::{Load, STILL, Twist};
use crate::dynamics::Plant;
use crate::kinematics::{KinematicsError, Motion, Reactions, SocketSet};
use crate::machine::bodies::{BODIES, END_EFFECTOR, PLATFORM, STRUT};
use crate::machine::{ARMS, AXES, STRUTS};

/// Change of the answer at which the iteration over laws that read it stops, N, rad/s² or m/s².
const TOLERANCE: f64 = 1e-9;
/// Enough for a contraction by two thirds per iteration.
const MAX_ITERATIONS: usize = 60;

/// What the equations solve for and laws may read.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Answer {
    /// Strut forces, N.
    pub reactions: Reactions,
    /// Accelerations of the drives, rad/s².
    pub drives: [f64; AXES],
    /// Acceleration of the platform, m/s².
    pub platform: Vector3<f64>,
}

/// Buffers that live as long as the twin.
pub(super) struct Scratch {
    /// Answer of the last evaluation, first guess of the next.
    pub answer: Answer,
    /// Largest change in the last iteration over the answer that did not converge, N; zero if all did.
    pub unconverged: f64,
    /// Solutions of the equations of motion so far.
    pub solutions: usize,
    /// Newton corrections that closed the loops so far.
    pub corrections: usize,
    /// Wrenches that do not depend on the answer, without the drives.
    pub wrenches: [Twist; BODIES],
    /// All wrenches of the last evaluation, without the drives.
    pub total: [Twist; BODIES],
    /// W of the present step.
    pub damping: Damping,
    /// What acts on the rotors of elastic gears; of laws that do not read the answer in `resting`.
    pub motors: Motors,
    resting: [f64; ARMS],
    /// The first law that gave no number.
    pub fault: Option<KinematicsError>,
    /// Power of each effect, W.
    powers: Vec<f64>,
    /// Power of the spins' restraint and the brakes, W.
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
            wrenches: [STILL; BODIES],
            total: [STILL; BODIES],
            damping: Damping::default(),
            motors: Motors::default(),
            resting: [0.0; ARMS],
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
    /// Of the drives.
    pub torque: Torque,
    /// Wrenches from outside.
    pub external: Load,
    /// Sockets that hold.
    pub closed: SocketSet,
    pub scratch: Scratch,
}

impl Context {
    fn scene<'b>(&self, t: f64, y: &'b [f64]) -> Scene<'b> {
        Scene { t, own: &y[self.layout.own()], torque: self.torque.at(t), closed: self.closed }
    }

    /// Puts the wrenches of everything that does not read the answer into `scratch.wrenches`.
    pub fn prepare(&mut self, t: f64, y: &[f64], motion: &Motion) {
        let scene = self.scene(t, y);
        let scratch = &mut self.scratch;
        scratch.wrenches = if self.external.is_none() { [STILL; BODIES] } else { self.external.at(t) };
        let (wrenches, powers) = (&mut scratch.wrenches, &mut scratch.powers);
        let reactions = &scratch.answer.reactions;
        scratch.resting = [0.0; ARMS];
        let at = Evaluation { plant: &self.plant, scene: &scene, motion, reactions };
        self.forces.add(&at, false, Sums { wrenches, motors: &mut scratch.resting, powers });
        scratch.fault = scratch.fault.take().or_else(|| self.forces.fault(&at, powers));
        scratch.motors.torque = scratch.resting;
        scratch.restraint_power = self.forces.add_brakes(motion, wrenches);
        scratch.hits = stops::hits(&self.plant, motion);
        scratch.stop_power = stops::add(&self.plant, motion, &scratch.hits, wrenches);
        for s in 0..STRUTS {
            let u = motion.strut_axis[s];
            let spin = motion.bodies[STRUT + s].angular_velocity.dot(&u);
            let damping = spin_restraint(&self.plant, self.closed, s);
            wrenches[STRUT + s].1 -= u * (damping * spin);
            scratch.restraint_power -= damping * spin * spin;
        }
        if !self.plant.mechanism.has_telescope() {
            // What touches the end effector touches the platform, of which it is a part.
            let lever = motion.bodies[END_EFFECTOR].position - motion.bodies[PLATFORM].position;
            let (force, moment) = std::mem::replace(&mut wrenches[END_EFFECTOR], STILL);
            wrenches[PLATFORM].0 += force;
            wrenches[PLATFORM].1 += moment + lever.cross(&force);
        }
    }

    /// Solves `equations` for wrenches on the bodies, and the laws that depend on their answer with them.
    pub fn solve<S>(
        &mut self,
        t: f64,
        y: &[f64],
        motion: &Motion,
        mut equations: impl FnMut(&Plant, &[Twist; BODIES]) -> Result<(S, Answer), SingularPose>,
    ) -> Result<S, SingularPose> {
        let reads = self.forces.read_answer();
        let mut moving = self.forces.read_accelerations().then_some(*motion);
        let scene = self.scene(t, y);
        let mut iteration = 0;
        loop {
            let scratch = &mut self.scratch;
            scratch.total = scratch.wrenches;
            if reads {
                let (total, powers) = (&mut scratch.total, &mut scratch.powers);
                let answer = &scratch.answer;
                if let Some(moving) = &mut moving {
                    moving.qdd = answer.drives;
                    moving.bodies[PLATFORM].acceleration = answer.platform;
                }
                let motion = moving.as_ref().unwrap_or(motion);
                let (reactions, motors) = (&answer.reactions, &mut scratch.motors.torque);
                *motors = scratch.resting;
                let at = Evaluation { plant: &self.plant, scene: &scene, motion, reactions };
                self.forces.add(&at, true, Sums { wrenches: total, motors, powers });
                scratch.fault = scratch.fault.take().or_else(|| self.forces.fault(&at, powers));
            }
            let (solution, answer) = equations(&self.plant, &scratch.total)?;
            let change = change(&answer, &scratch.answer);
            scratch.answer = answer;
            scratch.solutions += 1;
            iteration += 1;
            if !reads || change < TOLERANCE {
                return Ok(solution);
            }
            if iteration == MAX_ITERATIONS {
                scratch.unconverged = scratch.unconverged.max(change);
                return Ok(solution);
            }
        }
    }

    /// Rates and accelerations of the axes as the motors' encoders see them, for a motion with accelerations.
    pub fn of_motors(&self, t: f64, y: &[f64], motion: &Motion) -> [[f64; AXES]; 2] {
        let seen = self.forces.of_motors(&self.scene(t, y), motion, &self.scratch.motors.torque);
        [seen.qd, seen.qdd]
    }

    /// Chooses the damping in W for the coming step; `motion` is as before when it returns.
    pub fn measure_damping(&mut self, t: f64, y: &[f64], motion: &mut Motion) {
        let scene = self.scene(t, y);
        let scratch = &mut self.scratch;
        self.forces.measure_damping(&self.plant, &scene, motion, &scratch.answer.reactions, &mut scratch.damping);
        scratch.motors.damping = scratch.damping.motors;
    }

    /// Writes the derivatives of what is not mechanics: the effects' own states, (1 − g·J)·k = rate + J·sum with their slopes
    /// J at the first stage, and the work done. `motion` holds the
    /// accelerations of the drives, `struts` is the power of elastic struts, W.
    pub fn rest_of_stage(&mut self, stage: &Stage, motion: &Motion, struts: f64, k: &mut [f64]) {
        let Stage { t, y, sum, g, first } = *stage;
        let scene = self.scene(t, y);
        let own = self.layout.own();
        let scratch = &mut self.scratch;
        if !own.is_empty() {
            let (rates, slopes) = (&mut k[own.clone()], &mut scratch.fresh_slopes);
            let motors = &scratch.motors;
            let reactions = &scratch.answer.reactions;
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
        for a in 0..AXES {
            work[a] = scene.torque[a] * motion.qd[a];
        }
        work[WORK_RESTRAINTS] = scratch.restraint_power;
        work[WORK_CONTACT] = if self.external.is_none() { 0.0 } else { self.external.power(t, motion) };
        work[WORK_STRUTS] = struts;
        work[WORK_STOPS] = scratch.stop_power;
        work[WORK_EFFECTS..].copy_from_slice(&scratch.powers);
    }
}

fn change(a: &Answer, b: &Answer) -> f64 {
    let worst = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
    worst(&a.reactions.upper, &b.reactions.upper)
        .max(worst(&a.reactions.lower, &b.reactions.lower))
        .max(worst(&a.drives, &b.drives))
        .max(worst(a.platform.as_slice(), b.platform.as_slice()))
}
