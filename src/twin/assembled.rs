//! The assembled mechanism as a system of differential equations over a flat state.

use nalgebra::{Quaternion, Vector3};

use super::SingularPose;
use super::forces::{Damping, Forces, Probe, Scene};
use super::integrator::System;
use super::layout::{Layout, WORK_CONTACT, WORK_EFFECTS, WORK_RESTRAINTS, WORK_STRUTS};
use super::mechanism::{Frame, Implicit, Mechanism, OPEN, OpenVector, Pose, Solution};
use super::torque::Torque;
use super::wrench::{Load, STILL, Twist};
use crate::dynamics::Plant;
use crate::kinematics::{Motion, Reactions, SocketSet};
use crate::model::bodies::{BODIES, STRUT};
use crate::model::{ARMS, AXES, STRUTS};

/// Positions: three arms, rotor, platform position and quaternion, six rolls.
const PSI: usize = 3;
const POSITION: usize = 4;
const ORIENTATION: usize = 7;
const ROLL: usize = 11;
/// Velocities: ν, then six spins.
const NU: usize = 17;
const SPIN: usize = NU + OPEN;
/// Length of positions and velocities.
pub(super) const LENGTH: usize = SPIN + STRUTS;

/// Change of the strut forces at which the iteration over friction that reads them stops, N.
pub(super) const REACTION_TOLERANCE: f64 = 1e-9;
/// Enough for a contraction by two thirds per iteration.
pub(super) const MAX_REACTION_ITERATIONS: usize = 60;

/// Buffers that live as long as the twin.
pub(super) struct Scratch {
    frame: Option<Box<Frame>>,
    /// Time and torque for which frame and wrenches hold; forgotten when anything changes.
    fresh: Option<(f64, [f64; AXES])>,
    /// Reactions of the last evaluation, first guess of the next.
    pub reactions: Reactions,
    /// Largest change in the last iteration over the reactions that did not converge, N; zero if all did.
    pub unconverged: f64,
    /// Wrenches that do not depend on the reactions.
    pub wrenches: [Twist; BODIES],
    /// All wrenches of the last evaluation.
    pub total: [Twist; BODIES],
    /// Power of each effect, W.
    pub powers: Vec<f64>,
    /// Power of the brakes, W.
    pub restraint_power: f64,
    /// W of the present step.
    pub damping: Damping,
    slopes: Vec<f64>,
    fresh_slopes: Vec<f64>,
}

impl Scratch {
    pub fn new(plant: &Plant, forces: &Forces) -> Self {
        Self {
            frame: None,
            fresh: None,
            reactions: Reactions::default(),
            unconverged: 0.0,
            wrenches: [STILL; BODIES],
            total: [STILL; BODIES],
            powers: vec![0.0; plant.effects.len()],
            restraint_power: 0.0,
            damping: Damping::default(),
            slopes: vec![0.0; forces.states()],
            fresh_slopes: vec![0.0; forces.states()],
        }
    }
}

impl Scratch {
    /// State, machine or surroundings are no longer those of the last evaluation.
    pub fn forget(&mut self) {
        self.fresh = None;
    }

    /// Stage derivatives of the effects' own states: (1 − g·J)·k = rate + J·sum with their slopes J.
    pub fn own_rates(
        &mut self,
        forces: &Forces,
        plant: &Plant,
        scene: &Scene,
        (sum, g, first): (&[f64], f64, bool),
        at: std::ops::Range<usize>,
        k: &mut [f64],
    ) {
        forces.state_rates(plant, scene, &self.reactions, &mut k[at.clone()], &mut self.fresh_slopes);
        if first {
            self.slopes.copy_from_slice(&self.fresh_slopes);
        }
        if g > 0.0 {
            forces.gear_rates(scene.own, &sum[at.clone()], g, &mut k[at.clone()]);
            for (slope, i) in self.slopes.iter().zip(at) {
                k[i] = (k[i] + slope * sum[i]) / (1.0 - g * slope);
            }
        }
    }
}

/// Right-hand side of the assembled mechanism for one step.
pub(super) struct Assembled<'a> {
    pub plant: &'a Plant,
    pub forces: &'a Forces,
    pub mechanism: &'a Mechanism,
    pub layout: Layout,
    pub torque: Torque,
    pub external: &'a Load,
    pub scratch: &'a mut Scratch,
}

pub(super) fn pose(y: &[f64]) -> (Pose, OpenVector, [f64; STRUTS]) {
    (
        Pose {
            phi: [y[0], y[1], y[2]],
            psi: y[PSI],
            position: Vector3::new(y[POSITION], y[POSITION + 1], y[POSITION + 2]),
            orientation: Quaternion::new(y[ORIENTATION], y[ORIENTATION + 1], y[ORIENTATION + 2], y[ORIENTATION + 3]),
            roll: std::array::from_fn(|s| y[ROLL + s]),
        },
        OpenVector::from_column_slice(&y[NU..NU + OPEN]),
        std::array::from_fn(|s| y[SPIN + s]),
    )
}

pub(super) fn store(y: &mut [f64], pose: &Pose, nu: &OpenVector, spin: &[f64; STRUTS]) {
    y[..ARMS].copy_from_slice(&pose.phi);
    y[PSI] = pose.psi;
    y[POSITION..ORIENTATION].copy_from_slice(pose.position.as_slice());
    let q = &pose.orientation;
    y[ORIENTATION..ROLL].copy_from_slice(&[q.w, q.i, q.j, q.k]);
    y[ROLL..NU].copy_from_slice(&pose.roll);
    y[NU..SPIN].copy_from_slice(nu.as_slice());
    y[SPIN..LENGTH].copy_from_slice(spin);
}

impl Assembled<'_> {
    /// Runs `what` on the frame at a state, with the wrenches that do not read reactions in place.
    ///
    /// An evaluation and the step that starts from it share both.
    fn with_frame<T>(&mut self, t: f64, y: &[f64], start: bool, what: impl FnOnce(&mut Self, &mut Frame) -> T) -> T {
        let mut frame = self.scratch.frame.take().unwrap_or_else(|| Box::new(Frame::empty()));
        let key = (t, self.torque.at(t));
        if !(start && self.scratch.fresh == Some(key)) {
            let (mut pose, nu, spin) = pose(y);
            pose.orientation /= pose.orientation.norm();
            self.mechanism.frame(&pose, &nu, &spin, &mut frame);
            self.prepare(t, &frame, &y[self.layout.own()]);
        }
        self.scratch.fresh = start.then_some(key);
        let out = what(self, &mut frame);
        self.scratch.frame = Some(frame);
        out
    }

    fn scene<'b>(&self, t: f64, motion: &'b Motion, own: &'b [f64]) -> Scene<'b> {
        Scene { t, motion, own, torque: self.torque.at(t), closed: SocketSet::ALL }
    }

    /// Wrenches of everything that does not read reactions.
    fn prepare(&mut self, t: f64, frame: &Frame, own: &[f64]) {
        let scene = self.scene(t, &frame.motion, own);
        let scratch = &mut *self.scratch;
        scratch.wrenches = if self.external.is_none() { [STILL; BODIES] } else { self.external.at(t) };
        self.forces.add(self.plant, &scene, &scratch.reactions, false, &mut scratch.wrenches, &mut scratch.powers);
        scratch.restraint_power = self.forces.add_brakes(&frame.motion, &mut scratch.wrenches);
        self.restrain(&frame.motion);
    }

    fn restrain(&mut self, motion: &Motion) {
        for s in 0..STRUTS {
            let u = motion.strut_axis[s];
            let spin = motion.bodies[STRUT + s].angular_velocity.dot(&u);
            self.scratch.wrenches[STRUT + s].1 -= u * (self.plant.spin_damping * spin);
        }
    }

    /// Solves for accelerations and reactions, and the friction that depends on them with them.
    fn solve(&mut self, t: f64, frame: &Frame, own: &[f64], implicit: &Implicit) -> Result<Solution, SingularPose> {
        let tau = self.torque.at(t);
        let reads = self.forces.read_reactions();
        let mut iteration = 0;
        loop {
            self.scratch.total = self.scratch.wrenches;
            if reads {
                let scene = self.scene(t, &frame.motion, own);
                let scratch = &mut *self.scratch;
                self.forces.add(self.plant, &scene, &scratch.reactions, true, &mut scratch.total, &mut scratch.powers);
            }
            let solution = self.mechanism.solve(self.plant, frame, &self.scratch.total, &tau, implicit)?;
            let change = change(&solution.reactions, &self.scratch.reactions);
            self.scratch.reactions = solution.reactions;
            iteration += 1;
            if !reads || change < REACTION_TOLERANCE {
                return Ok(solution);
            }
            if iteration == MAX_REACTION_ITERATIONS {
                self.scratch.unconverged = self.scratch.unconverged.max(change);
                return Ok(solution);
            }
        }
    }

    /// Accelerations and reactions at a state: motion of all bodies, and the solution.
    pub fn evaluate(&mut self, t: f64, y: &[f64]) -> Result<(Motion, Solution), SingularPose> {
        self.with_frame(t, y, true, |system, frame| {
            let own = &y[system.layout.own()];
            let solution = system.solve(t, frame, own, &Implicit::default())?;
            let mut motion = frame.motion;
            let accelerations = system.mechanism.accelerations(frame, &solution);
            for (body, (linear, angular)) in motion.bodies.iter_mut().zip(accelerations) {
                (body.acceleration, body.angular_acceleration) = (linear, angular);
            }
            Ok((motion, solution))
        })
    }

    /// Implicit terms of a stage.
    fn implicit(&self, t: f64, frame: &Frame, own: &[f64], sum: &[f64], g: f64, base: &OpenVector) -> Implicit {
        let scratch = &*self.scratch;
        let mut out = Implicit::default();
        for a in 0..AXES {
            out.drives[a] = g * scratch.damping.drives[a];
            out.drive_torque[a] = -scratch.damping.drives[a] * sum[NU + a];
        }
        let (torque, at) = (self.torque.at(t), self.layout.own());
        for (arm, inertia, torque) in self.forces.gear_terms(&torque, own, &sum[at], g) {
            out.drives[arm] += inertia;
            out.drive_torque[arm] += torque;
        }
        for s in 0..STRUTS {
            out.spins[s] = g * scratch.damping.spins[s];
            out.spin_moment[s] = -scratch.damping.spins[s] * sum[SPIN + s];
        }
        if let Some(springs) = &self.mechanism.springs {
            let velocities = OpenVector::from_column_slice(&sum[NU..SPIN]);
            // Changes of the open coordinates: angles, position and (of the quaternion) rotation vector.
            let (mut pose, ..) = pose(sum);
            let turned = pose.orientation;
            pose.orientation = quaternion_of(frame);
            let rotation = (turned * pose.orientation.conjugate()).imag() * 2.0;
            let mut positions = OpenVector::zeros();
            positions.fixed_rows_mut::<3>(0).copy_from_slice(&pose.phi);
            positions[PSI] = pose.psi;
            positions.fixed_rows_mut::<3>(4).copy_from(&pose.position);
            positions.fixed_rows_mut::<3>(7).copy_from(&rotation);
            for s in 0..STRUTS {
                let (k, d) = (springs[s].stiffness, springs[s].damping);
                let along = |x: &OpenVector| frame.along(s, x);
                out.tension[s] = g * d + g * g * k;
                out.tension_force[s] = d * along(&velocities) + k * (along(&positions) + g * along(base));
            }
        }
        out
    }
}

fn quaternion_of(frame: &Frame) -> Quaternion<f64> {
    *nalgebra::UnitQuaternion::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(
        frame.motion.bodies[crate::model::bodies::PLATFORM].rotation,
    ))
}

pub(super) fn change(a: &Reactions, b: &Reactions) -> f64 {
    let worst = |a: &[f64; STRUTS], b: &[f64; STRUTS]| a.iter().zip(b).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
    worst(&a.upper, &b.upper).max(worst(&a.lower, &b.lower))
}

impl System for Assembled<'_> {
    fn stage(
        &mut self,
        t: f64,
        y: &[f64],
        sum: &[f64],
        g: f64,
        first: bool,
        k: &mut [f64],
    ) -> Result<(), SingularPose> {
        self.with_frame(t, y, first, |system, frame| system.stage_at(t, y, frame, sum, g, first, k))
    }

    fn project(&mut self, y: &mut [f64]) -> Result<(), SingularPose> {
        let (mut pose, mut nu, spin) = pose(y);
        self.mechanism.close(&mut pose, &mut nu)?;
        store(y, &pose, &nu, &spin);
        Ok(())
    }
}

impl Assembled<'_> {
    /// The stage at a frame.
    fn stage_at(
        &mut self,
        t: f64,
        y: &[f64],
        frame: &mut Frame,
        sum: &[f64],
        g: f64,
        first: bool,
        k: &mut [f64],
    ) -> Result<(), SingularPose> {
        let (pose, nu, spin) = pose(y);
        let own = &y[self.layout.own()];
        // Position rates are ν, and ν one step ahead where struts are elastic (their stiffness is implicit).
        let elastic = g > 0.0 && self.mechanism.springs.is_some();
        let mut rate = nu;
        if elastic {
            rate += OpenVector::from_column_slice(&sum[NU..SPIN]);
        }
        let implicit = if g > 0.0 {
            if first {
                let torque = self.torque.at(t);
                let scratch = &mut *self.scratch;
                let at = Probe { t, own, torque, closed: SocketSet::ALL, reactions: &scratch.reactions };
                self.forces.measure_damping(self.plant, &at, &mut frame.motion, &mut scratch.damping);
            }
            self.implicit(t, frame, own, sum, g, &rate)
        } else {
            Implicit::default()
        };
        let solution = self.solve(t, frame, own, &implicit)?;
        if elastic {
            rate += solution.nu_rate * g;
        }
        k[..ARMS].copy_from_slice(&rate.as_slice()[..ARMS]);
        k[PSI] = rate[3];
        k[POSITION..ORIENTATION].copy_from_slice(&rate.as_slice()[4..7]);
        let turning = Quaternion::new(0.0, rate[7], rate[8], rate[9]) * pose.orientation * 0.5;
        k[ORIENTATION..ROLL].copy_from_slice(&[turning.w, turning.i, turning.j, turning.k]);
        k[ROLL..NU].copy_from_slice(&frame.roll_rate);
        k[NU..SPIN].copy_from_slice(solution.nu_rate.as_slice());
        // Nothing turns the struts where the method is explicit, and their restraint would be steep: they rest.
        let spin_rate = if g > 0.0 { solution.spin_rate } else { [0.0; STRUTS] };
        k[SPIN..LENGTH].copy_from_slice(&spin_rate);

        let (work_at, own_at) = (self.layout.work(), self.layout.own());
        if !own_at.is_empty() {
            frame.motion.qdd.copy_from_slice(&solution.nu_rate.as_slice()[..AXES]);
            let scene = self.scene(t, &frame.motion, own);
            self.scratch.own_rates(self.forces, self.plant, &scene, (sum, g, first), own_at, k);
        }
        let tau = self.torque.at(t);
        let motion = &frame.motion;
        let work = &mut k[work_at];
        for a in 0..AXES {
            work[a] = tau[a] * motion.qd[a];
        }
        work[WORK_RESTRAINTS] =
            self.scratch.restraint_power - self.plant.spin_damping * spin.iter().map(|x| x * x).sum::<f64>();
        work[WORK_CONTACT] = if self.external.is_none() { 0.0 } else { self.external.power(t, motion) };
        work[WORK_STRUTS] = self.mechanism.spring_power(frame);
        work[WORK_EFFECTS..].copy_from_slice(&self.scratch.powers);
        Ok(())
    }
}
