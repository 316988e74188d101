//! Desired motions of the end effector: their description in a scenario ([`Course`]) and the resulting function of
//! time.

pub mod constant_speed;
pub mod fourier;
pub mod path;
pub mod polynomial;
pub mod static_poses;
pub mod table;

use nalgebra::{Vector3, Vector4};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use thiserror::Error;

use crate::dynamics::Plant;
use crate::kinematics::{JointState, KinematicsError, PlatformState, Target};
use crate::machine::{Geometry, Setup, Unit, every_axis};
use crate::model::Model;

use constant_speed::ConstantSpeed;
use fourier::{FourierMotion, MotionLimits};
use path::Path;
use polynomial::Piecewise;
use static_poses::StaticPoses;
use table::Table;

/// Description of a desired motion.
#[derive(Clone, Debug, PartialEq)]
pub enum Course {
    /// A Fourier series drawn at random within a share of all limits.
    RandomFourier {
        /// Seed of the draw.
        seed: u64,
        /// Base frequency, Hz.
        frequency: f64,
        /// Number of harmonics.
        harmonics: usize,
        /// Share of the limits that may be used.
        share: f64,
    },
    /// A given Fourier series.
    Fourier(FourierMotion),
    /// Travel along waypoints.
    Path(Path),
    /// A look-up table.
    Table(Table),
    /// One axis to and fro at constant speeds.
    ConstantSpeed(ConstantSpeed),
    /// Poses held one after the other.
    StaticPoses(StaticPoses),
}

impl Course {
    /// Kind in words.
    pub fn describe(&self) -> &'static str {
        match self {
            Self::RandomFourier { .. } => "a random Fourier series",
            Self::Fourier(_) => "a Fourier series",
            Self::Path(_) => "travel along waypoints",
            Self::Table(_) => "a look-up table",
            Self::ConstantSpeed(_) => "runs at constant speed",
            Self::StaticPoses(_) => "static poses",
        }
    }

    /// Time at which the motion ends, s; `None` for a Fourier series.
    pub fn length(&self) -> Option<f64> {
        match self {
            Self::RandomFourier { .. } | Self::Fourier(_) => None,
            Self::Path(path) => Some(path.course().length()),
            Self::Table(table) => table.t.last().copied(),
            Self::ConstantSpeed(runs) => Some(runs.course([0.0; 4]).length()),
            Self::StaticPoses(poses) => Some(poses.course().length()),
        }
    }

    /// The same motion in 1/`scale` of the time: speeds times `scale`, accelerations times its square, jerks times its
    /// cube, rests and periods divided by it. A random series keeps its share of the limits.
    pub fn faster(&self, scale: f64) -> Self {
        let mut course = self.clone();
        match &mut course {
            Self::RandomFourier { frequency, .. } => *frequency *= scale,
            Self::Fourier(series) => series.frequency *= scale,
            Self::Path(path) => {
                path.speed *= scale;
                path.acceleration *= scale.powi(2);
                path.jerk *= scale.powi(3);
                path.dwell /= scale;
            }
            Self::Table(table) => table.t.iter_mut().for_each(|t| *t /= scale),
            Self::ConstantSpeed(runs) => {
                runs.speeds.iter_mut().for_each(|v| *v *= scale);
                runs.acceleration *= scale.powi(2);
            }
            Self::StaticPoses(poses) => {
                poses.hold /= scale;
                poses.travel /= scale;
            }
        }
        course
    }

    /// The motion over time for a machine like `planning` in the configuration of `setup`.
    ///
    /// # Errors
    /// A [`MotionError`] if the motion cannot be reached, exceeds a speed or joint limit, or needs an axis or platform
    /// that the machine does not have.
    pub fn on(&self, planning: &Model, setup: &Setup) -> Result<DesiredMotion, MotionError> {
        let plant = Plant::new(planning, setup);
        let motion = self.motion(planning, &plant)?;
        motion.check(planning, &plant.geometry)?;
        Ok(motion)
    }

    /// The motion as by [`Self::on`], but not checked: it may leave the workspace or exceed speeds.
    ///
    /// # Errors
    /// A [`MotionError`] if the motion needs a platform that the machine does not have, or a start that is out of reach.
    pub fn unchecked(&self, planning: &Model, setup: &Setup) -> Result<DesiredMotion, MotionError> {
        self.motion(planning, &Plant::new(planning, setup))
    }

    /// The motion over time on a machine like `plant`, built from `planning`; not yet checked.
    fn motion(&self, planning: &Model, plant: &Plant) -> Result<DesiredMotion, MotionError> {
        let geometry = Box::new(plant.geometry);
        if !plant.assembled {
            return Ok(DesiredMotion::Axes(self.of_axes(planning, plant)?));
        }
        Ok(match self {
            Self::RandomFourier { seed, frequency, harmonics, share } => DesiredMotion::Fourier(FourierMotion::random(
                plant,
                &MotionLimits::of(planning, *share),
                *frequency,
                *harmonics,
                &mut ChaCha8Rng::seed_from_u64(*seed),
            )),
            Self::Fourier(series) => DesiredMotion::Fourier(series.clone()),
            Self::Path(path) => DesiredMotion::Platform(path.course()),
            Self::StaticPoses(poses) => DesiredMotion::Platform(poses.course()),
            Self::Table(table) if table.joints => DesiredMotion::Joints { course: table.course(), geometry },
            Self::Table(table) => DesiredMotion::Platform(table.course()),
            Self::ConstantSpeed(runs) => {
                let [x, y, z, psi] = runs.pose;
                let pose =
                    PlatformState { position: Vector3::new(x, y, z), psi: [psi, 0.0, 0.0], ..PlatformState::default() };
                let joints =
                    geometry.inverse_motion(&pose).map_err(|reason| MotionError::Unreachable { t: 0.0, reason })?;
                DesiredMotion::Joints { course: runs.course(joints.q), geometry }
            }
        })
    }
}

impl Course {
    /// The motion of independent axes, whose coordinates are their angles.
    fn of_axes(&self, planning: &Model, plant: &Plant) -> Result<Series, MotionError> {
        Ok(match self {
            Self::RandomFourier { seed, frequency, harmonics, share } => Series::Fourier(FourierMotion::random_axes(
                plant,
                &MotionLimits::of(planning, *share),
                *frequency,
                *harmonics,
                &mut ChaCha8Rng::seed_from_u64(*seed),
            )),
            Self::Fourier(series) => Series::Fourier(series.clone()),
            Self::StaticPoses(poses) => Series::Pieces(poses.course()),
            Self::Table(table) if table.joints => Series::Pieces(table.course()),
            Self::ConstantSpeed(runs) => Series::Pieces(runs.course(runs.pose)),
            Self::Path(_) | Self::Table(_) => return Err(MotionError::NoPlatform { kind: self.describe() }),
        })
    }
}

/// Platform pose with ψ over time, or angles of independent axes over time.
///
/// Position, velocity and acceleration are continuous, except at the ends of a table that starts or ends in motion.
#[derive(Clone, Debug, PartialEq)]
pub enum DesiredMotion {
    /// A periodic Fourier series; all derivatives are continuous.
    Fourier(FourierMotion),
    /// Polynomials of (x, y, z, ψ).
    Platform(Piecewise),
    /// Polynomials of the joint angles.
    Joints {
        /// (φ1, φ2, φ3, ψ), rad.
        course: Piecewise,
        /// Geometry for the forward kinematics.
        geometry: Box<Geometry>,
    },
    /// Angles of independent axes.
    Axes(Series),
}

/// Four coordinates over time.
#[derive(Clone, Debug, PartialEq)]
pub enum Series {
    /// Periodic.
    Fourier(FourierMotion),
    /// Piecewise polynomials.
    Pieces(Piecewise),
}

impl Series {
    fn joints(&self, t: f64) -> JointState {
        let [q, qd, qdd] = match self {
            Self::Fourier(series) => series.coordinates(t),
            Self::Pieces(course) => course.at(t).map(Into::into),
        };
        JointState { q, qd, qdd }
    }
}

fn platform([p, v, a]: [Vector4<f64>; 3]) -> PlatformState {
    PlatformState { position: p.xyz(), velocity: v.xyz(), acceleration: a.xyz(), psi: [p[3], v[3], a[3]] }
}

impl DesiredMotion {
    /// Desired state of the machine at time `t` (s).
    ///
    /// # Errors
    /// Those of [`Geometry::forward_motion`] for a motion given by joint angles.
    pub fn state(&self, t: f64) -> Result<Target, KinematicsError> {
        Ok(match self {
            Self::Fourier(series) => series.at(t).into(),
            Self::Platform(course) => platform(course.at(t)).into(),
            Self::Joints { course, geometry } => {
                let [q, qd, qdd] = course.at(t).map(Into::into);
                geometry.forward_motion(&JointState { q, qd, qdd })?.into()
            }
            Self::Axes(series) => series.joints(t).into(),
        })
    }

    /// Desired state of the machine at time `t` (s); NaN where the joint angles do not close the loops.
    pub fn at(&self, t: f64) -> Target {
        let nowhere = Vector3::repeat(f64::NAN);
        let unreachable =
            PlatformState { position: nowhere, velocity: nowhere, acceleration: nowhere, psi: [f64::NAN; 3] };
        self.state(t).unwrap_or(Target::Platform(unreachable))
    }

    fn is_of_platform(&self) -> bool {
        !matches!(self, Self::Axes(_))
    }

    /// Number and spacing (s) of the instants at which the motion is checked.
    fn grid(&self) -> (usize, f64) {
        match self {
            Self::Fourier(series) | Self::Axes(Series::Fourier(series)) => {
                let steps = PER_HARMONIC * series.sine.len().max(series.cosine.len()).max(1);
                (steps, 1.0 / steps as f64 / series.frequency)
            }
            Self::Platform(course) | Self::Joints { course, .. } | Self::Axes(Series::Pieces(course)) => {
                let steps = (course.lap() / SPACING).ceil().clamp(1.0, MAX_INSTANTS);
                (steps as usize, course.lap() / steps)
            }
        }
    }

    /// Checks workspace, joint limits and speeds at all instants of the grid.
    fn check(&self, planning: &Model, geometry: &Geometry) -> Result<(), MotionError> {
        let (steps, spacing) = self.grid();
        for k in 0..=steps {
            let t = k as f64 * spacing;
            let unreachable = |reason| MotionError::Unreachable { t, reason };
            let target = self.state(t).map_err(unreachable)?;
            let joints = target.joints(geometry).map_err(unreachable)?;
            match target {
                Target::Platform(platform) => geometry.check_limits(&joints.q, &platform.position),
                Target::Joints(_) => geometry.check_arms(&joints.q[..planning.mechanism.arms()]),
            }
            .map_err(|reason| match reason {
                KinematicsError::ArmLimit { arm: axis, angle: position, min, max } if !self.is_of_platform() => {
                    let unit = planning.mechanism.unit(Unit::Rad);
                    MotionError::BeyondLimit { t, axis, position, min, max, unit }
                }
                reason => MotionError::Unreachable { t, reason },
            })?;
            if let Some(axis) = (planning.mechanism.axes().max(planning.mechanism.limbs())..every_axis().end)
                .find(|&i| joints.q[i] != 0.0 || joints.qd[i] != 0.0)
            {
                return Err(MotionError::NoAxis { t, axis });
            }
            if let Self::Joints { course, .. } = self {
                // The platform position alone must determine the same angles.
                let wanted = course.at(t)[0];
                if (0..planning.mechanism.arms()).any(|i| (wanted[i] - joints.q[i]).abs() > 1e-6) {
                    let q = wanted.as_slice()[..geometry.limbs.len()].into();
                    return Err(MotionError::Unreachable { t, reason: KinematicsError::Singular { q } });
                }
            }
            let driven = planning.mechanism.axes();
            for (axis, (rate, drive)) in joints.qd.iter().zip(&planning.drives).enumerate().take(driven) {
                if rate.is_nan() || rate.abs() > drive.max_speed {
                    let (speed, limit) = (rate.abs(), drive.max_speed);
                    return Err(MotionError::TooFast {
                        t,
                        axis,
                        speed,
                        limit,
                        unit: planning.mechanism.unit(Unit::RadPerS),
                    });
                }
            }
        }
        Ok(())
    }
}

/// Instants per period and harmonic at which a Fourier series is checked.
const PER_HARMONIC: usize = 200;
/// Spacing (s) of the instants at which other motions are checked; their largest number follows.
const SPACING: f64 = 5e-4;
const MAX_INSTANTS: f64 = 2e6;

/// A desired motion that is not feasible.
#[derive(Debug, Error)]
pub enum MotionError {
    /// A pose is impossible or outside the joint limits.
    #[error("the desired motion cannot be reached at t = {t:.3} s: {reason}")]
    Unreachable {
        /// Time, s.
        t: f64,
        /// Why the pose is not feasible.
        reason: KinematicsError,
    },
    /// The motion exceeds the speed limit of a drive.
    #[error("the desired motion needs {speed:.2} {unit} of axis {} at t = {t:.3} s; its limit is {limit:.2} {unit}", .axis + 1)]
    TooFast {
        /// Time, s.
        t: f64,
        /// Axis, from 0.
        axis: usize,
        /// Speed, in `unit`.
        speed: f64,
        /// Limit, in `unit`.
        limit: f64,
        /// Unit of both: rad/s, or m/s for a prismatic axis.
        unit: Unit,
    },
    /// An independent axis leaves its range.
    #[error("the desired motion moves axis {} to {position:.4} {unit} at t = {t:.3} s, outside {min:.4}..{max:.4} {unit}", .axis + 1)]
    BeyondLimit {
        /// Time, s.
        t: f64,
        /// Axis, from 0.
        axis: usize,
        /// Position, in `unit`.
        position: f64,
        /// Lower limit, in `unit`.
        min: f64,
        /// Upper limit, in `unit`.
        max: f64,
        /// Unit of all three: rad, or m for a prismatic axis.
        unit: Unit,
    },
    /// The motion moves an axis that the machine does not have.
    #[error("the desired motion moves axis {} at t = {t:.3} s, which the machine does not have", .axis + 1)]
    NoAxis {
        /// Time, s.
        t: f64,
        /// Axis, from 0.
        axis: usize,
    },
    /// A motion of a platform for a machine without one.
    #[error("{kind} is a motion of the platform; this machine has independent axes, expected one of their angles")]
    NoPlatform {
        /// Kind of motion in words.
        kind: &'static str,
    },
}

#[cfg(test)]
mod testing {
    use super::polynomial::Piecewise;

    /// Largest position, rate and acceleration, sampled within every piece.
    fn scale(course: &Piecewise) -> [f64; 3] {
        let mut times: Vec<f64> = (0..=2000).map(|k| course.lap() * f64::from(k) / 2000.0).collect();
        times.extend(course.joints().windows(2).flat_map(|w| [w[0], 0.5 * (w[0] + w[1])]));
        [0, 1, 2].map(|order| times.iter().map(|&t| course.at(t)[order].norm()).fold(1e-9, f64::max))
    }

    /// Rates and accelerations are the derivatives, all three are continuous.
    pub fn smooth(course: &Piecewise) {
        let scale = scale(course);
        for k in 1..500 {
            let t = course.lap() * k as f64 / 500.0;
            let h = 1e-6 * course.lap();
            // Across a junction of pieces the jerk jumps, which a difference quotient would show as an error.
            if course.joints().iter().any(|joint| (joint - t).abs() <= h) {
                continue;
            }
            let (before, now, after) = (course.at(t - h), course.at(t), course.at(t + h));
            for order in 0..2 {
                let difference = (after[order] - before[order]) / (2.0 * h);
                let error = (difference - now[order + 1]).norm();
                let rounding = 1e-15 * scale[order] / h;
                assert!(error < 1e-3 * scale[order + 1] + 10.0 * rounding, "order {order} at {t}: {error}");
            }
        }
        for t in &course.joints()[1..] {
            let (before, after) = (course.at(t * (1.0 - 1e-15) - 1e-300), course.at(*t));
            for order in 0..3 {
                let jump = (after[order] - before[order]).norm();
                assert!(jump < 1e-6 * scale[order], "order {order} jumps by {jump} at {t}");
            }
        }
    }

    /// Checks smoothness and rest at both ends.
    pub fn check(course: &Piecewise) {
        smooth(course);
        let [_, rate, acceleration] = scale(course);
        for t in [0.0, course.length() * (1.0 - 1e-15), course.length() + 1.0] {
            let [_, v, a] = course.at(t);
            assert!(v.norm() < 1e-6 * rate && a.norm() < 1e-6 * acceleration, "{t}: {v} {a}");
        }
        assert!((course.at(-1.0)[0] - course.at(0.0)[0]).norm() < 1e-12);
    }
}
