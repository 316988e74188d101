//! The assembled mechanism as a system of differential equations over a flat state.

use nalgebra::{Quaternion, Vector3};

use super::SingularPose;
use super::closed::{Frame, Implicit, Loads, Mechanism, OPEN, OpenVector, Pose, Solution};
use super::context::Context;
use super::integrator::{Stage, System};
use crate::kinematics::Motion;
use crate::machine::bodies::PLATFORM;
use crate::machine::{PerAxis, SixStruts, each, every_axis, six_struts, three_arms};

/// Positions: three arms, rotor, platform position and quaternion, six rolls.
const PSI: usize = 3;
const POSITION: usize = 4;
const ORIENTATION: usize = 7;
const ROLL: usize = 11;
/// Velocities: ν, then six spins.
const NU: usize = 17;
const SPIN: usize = NU + OPEN;
/// Length of positions and velocities.
pub(super) const LENGTH: usize = SPIN + six_struts().end;
/// Place of the velocities.
pub(super) const RATES: std::ops::Range<usize> = NU..LENGTH;

/// The frame of the last evaluation.
#[derive(Default)]
pub(super) struct FrameCache {
    frame: Option<Box<Frame>>,
    /// Time and torque for which frame and wrenches are valid; `None` after any change.
    fresh: Option<(f64, PerAxis<f64>)>,
}

impl FrameCache {
    /// Marks the cached frame as invalid, after a change of state, machine or surroundings.
    pub fn invalidate(&mut self) {
        self.fresh = None;
    }
}

/// Right-hand side of the assembled mechanism for one step.
pub(super) struct Assembled<'a> {
    pub context: &'a mut Context,
    pub mechanism: &'a Mechanism,
    pub cache: &'a mut FrameCache,
}

pub(super) fn pose(y: &[f64]) -> (Pose, OpenVector, SixStruts<f64>) {
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

pub(super) fn store(y: &mut [f64], pose: &Pose, nu: &OpenVector, spin: &SixStruts<f64>) {
    y[three_arms()].copy_from_slice(&pose.phi);
    y[PSI] = pose.psi;
    y[POSITION..ORIENTATION].copy_from_slice(pose.position.as_slice());
    let q = &pose.orientation;
    y[ORIENTATION..ROLL].copy_from_slice(&[q.w, q.i, q.j, q.k]);
    y[ROLL..NU].copy_from_slice(&pose.roll);
    y[NU..SPIN].copy_from_slice(nu.as_slice());
    y[SPIN..LENGTH].copy_from_slice(spin);
}

/// Motion of all bodies at a state, without accelerations.
pub(super) fn motion(mechanism: &Mechanism, y: &[f64]) -> Motion {
    let (pose, nu, spin) = pose(y);
    let mut frame = Frame::empty(&mechanism.geometry);
    mechanism.frame(&pose, &nu, &spin, &mut frame);
    frame.motion
}

impl Assembled<'_> {
    /// Calls `what` with the frame at a state and the wrenches that do not depend on reactions.
    ///
    /// An evaluation and the step that starts from it share both.
    fn with_frame<T>(&mut self, t: f64, y: &[f64], start: bool, what: impl FnOnce(&mut Self, &mut Frame) -> T) -> T {
        let mut frame = self.cache.frame.take().unwrap_or_else(|| Box::new(Frame::empty(&self.mechanism.geometry)));
        let key = (t, self.context.torque.at(t));
        if !(start && self.cache.fresh == Some(key)) {
            let (mut pose, nu, spin) = pose(y);
            pose.orientation /= pose.orientation.norm();
            self.mechanism.frame(&pose, &nu, &spin, &mut frame);
            self.context.prepare(t, y, &frame.motion);
        }
        self.cache.fresh = start.then_some(key);
        let out = what(self, &mut frame);
        self.cache.frame = Some(frame);
        out
    }

    fn solve(&mut self, t: f64, y: &[f64], frame: &Frame, implicit: &Implicit) -> Result<Solution, SingularPose> {
        let (mechanism, tau) = (self.mechanism, self.context.torque.at(t));
        let with_bodies = self.context.forces.read_accelerations();
        let mut solution = Solution::zero();
        self.context.solve(t, y, &frame.motion, |plant, wrenches, answer| {
            let loads = Loads { plant, frame, wrenches, tau: &tau, implicit, gravity: plant.gravity_vector() };
            mechanism.solve(&loads, &mut solution)?;
            solution.write(answer);
            if with_bodies {
                answer.bodies = mechanism.accelerations(frame, &solution);
            }
            Ok(())
        })?;
        Ok(solution)
    }

    /// Motion of all bodies with accelerations, and the solution of the equations of motion, at a state.
    pub fn evaluate(&mut self, t: f64, y: &[f64]) -> Result<(Motion, Solution), SingularPose> {
        self.with_frame(t, y, true, |system, frame| {
            let solution = system.solve(t, y, frame, &Implicit::default())?;
            let mut motion = frame.motion;
            let accelerations = system.mechanism.accelerations(frame, &solution);
            for (body, (linear, angular)) in motion.bodies.iter_mut().zip(accelerations) {
                (body.acceleration, body.angular_acceleration) = (linear, angular);
            }
            Ok((motion, solution))
        })
    }

    /// Implicit terms of a stage.
    fn implicit(&mut self, stage: &Stage, frame: &Frame, base: &OpenVector) -> Implicit {
        let Stage { t, y, sum, g, .. } = *stage;
        self.context.scratch.motors.sums = std::array::from_fn(|i| sum[NU + i]);
        let Context { forces, layout, torque, scratch, .. } = &*self.context;
        let (own, moved) = (&y[layout.own()], &sum[layout.own()]);
        let mut out = Implicit::default();
        for a in every_axis() {
            out.drives[a] = g * scratch.damping.drives[a];
            out.drive_torque[a] = -scratch.damping.drives[a] * sum[NU + a];
        }
        for (arm, inertia, torque) in forces.gear_terms(&torque.at(t), &scratch.motors, own, moved, g) {
            out.drives[arm] += inertia;
            out.drive_torque[arm] += torque;
        }
        for s in six_struts() {
            out.spins[s] = g * scratch.damping.spins[s];
            out.spin_moment[s] = -scratch.damping.spins[s] * sum[SPIN + s];
        }
        if let Some(springs) = &self.mechanism.springs {
            let velocities = OpenVector::from_column_slice(&sum[NU..SPIN]);
            // Increments of the open coordinates: angles, position and, from the quaternion, rotation vector.
            let (mut pose, ..) = pose(sum);
            let turned = pose.orientation;
            pose.orientation = quaternion_of(frame);
            let rotation = (turned * pose.orientation.conjugate()).imag() * 2.0;
            let mut positions = OpenVector::zeros();
            positions.fixed_rows_mut::<3>(0).copy_from_slice(&pose.phi);
            positions[PSI] = pose.psi;
            positions.fixed_rows_mut::<3>(4).copy_from(&pose.position);
            positions.fixed_rows_mut::<3>(7).copy_from(&rotation);
            for s in six_struts() {
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
        frame.motion.bodies[PLATFORM].rotation,
    ))
}

impl System for Assembled<'_> {
    fn stage(&mut self, stage: &Stage, k: &mut [f64]) -> Result<(), SingularPose> {
        self.with_frame(stage.t, stage.y, stage.first, |system, frame| system.stage_at(stage, frame, k))
    }

    fn project(&mut self, y: &mut [f64]) -> Result<(), SingularPose> {
        let (mut pose, mut nu, spin) = pose(y);
        self.context.scratch.corrections += self.mechanism.close(&mut pose, &mut nu)?;
        store(y, &pose, &nu, &spin);
        Ok(())
    }
}

impl Assembled<'_> {
    /// Writes the stage derivative at a frame.
    fn stage_at(&mut self, stage: &Stage, frame: &mut Frame, k: &mut [f64]) -> Result<(), SingularPose> {
        let Stage { t, y, sum, g, first } = *stage;
        let (pose, nu, _) = pose(y);
        // Position rates are ν; with elastic struts, whose stiffness is implicit, ν one step ahead.
        let elastic = g > 0.0 && self.mechanism.springs.is_some();
        let mut rate = nu;
        if elastic {
            rate += OpenVector::from_column_slice(&sum[NU..SPIN]);
        }
        let implicit = if g > 0.0 {
            if first {
                self.context.measure_damping(t, y, &mut frame.motion);
            }
            self.implicit(stage, frame, &rate)
        } else {
            Implicit::default()
        };
        let solution = self.solve(t, y, frame, &implicit)?;
        if elastic {
            rate += solution.nu_rate * g;
        }
        k[three_arms()].copy_from_slice(&rate.as_slice()[three_arms()]);
        k[PSI] = rate[3];
        k[POSITION..ORIENTATION].copy_from_slice(&rate.as_slice()[4..7]);
        let turning = Quaternion::new(0.0, rate[7], rate[8], rate[9]) * pose.orientation * 0.5;
        k[ORIENTATION..ROLL].copy_from_slice(&[turning.w, turning.i, turning.j, turning.k]);
        k[ROLL..NU].copy_from_slice(&frame.roll_rate);
        k[NU..SPIN].copy_from_slice(solution.nu_rate.as_slice());
        // An explicit method runs without loads on the spins; their stiff restraint is omitted, so that they stay at
        // rest.
        let spin_rate = if g > 0.0 { solution.spin_rate } else { each(0.0) };
        k[SPIN..LENGTH].copy_from_slice(&spin_rate);

        frame.motion.qdd.copy_from_slice(&solution.nu_rate.as_slice()[every_axis()]);
        let struts = self.mechanism.spring_power(frame);
        self.context.rest_of_stage(stage, &frame.motion, struts, k);
        Ok(())
    }
}
