//! What a run does: the desired motion of the end effector over time, payload, sensors and noise.

pub mod fourier;
mod read;

pub use fourier::{FourierMotion, MotionLimits};
pub use read::ScenarioError;

use std::path::PathBuf;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use thiserror::Error;

use crate::dynamics::Plant;
use crate::kinematics::KinematicsError;
use crate::model::{Model, STRUTS};
use crate::recording::Setup;
use crate::twin;

/// A run of the twin, as described by a scenario file.
#[derive(Clone, Debug)]
pub struct Scenario {
    /// Name for reports, the file's stem.
    pub name: String,
    /// Model file of the machine.
    pub model: PathBuf,
    /// Model file of the feed-forward, which also plans the motion; the machine's own without it.
    pub controller_model: Option<PathBuf>,
    /// Length, s.
    pub duration: f64,
    /// Seed of the sensor noise.
    pub seed: u64,
    /// Whether sensors are noisy and quantised.
    pub noise: bool,
    /// Integration steps per control period.
    pub substeps: usize,
    /// Desired motion.
    pub motion: Course,
    /// Payload and configuration.
    pub setup: Setup,
    /// Struts that carry a force sensor at the elbow.
    pub strut_sensors: [bool; STRUTS],
}

/// The desired motion of a scenario.
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
}

/// A desired motion that the machine cannot make.
#[derive(Debug, Error)]
pub enum MotionError {
    /// A pose is impossible or outside the joint limits.
    #[error("the desired motion cannot be reached at t = {t:.3} s: {source}")]
    Unreachable {
        /// Time, s.
        t: f64,
        /// What is wrong with the pose.
        source: KinematicsError,
    },
    /// A drive would have to turn too fast.
    #[error("the desired motion needs {speed:.2} rad/s of axis {} at t = {t:.3} s; its limit is {limit:.2} rad/s", .axis + 1)]
    TooFast {
        /// Time, s.
        t: f64,
        /// Axis, from 0.
        axis: usize,
        /// Speed, rad/s.
        speed: f64,
        /// Limit, rad/s.
        limit: f64,
    },
}

/// Instants per period at which a motion is checked, per harmonic.
const GRID: usize = 200;

impl Scenario {
    /// The desired motion for a machine like `planning`, refused if it is out of reach.
    pub fn motion(&self, planning: &Model) -> Result<FourierMotion, MotionError> {
        let plant = Plant::new(planning, &self.setup);
        let motion = match &self.motion {
            Course::Fourier(motion) => motion.clone(),
            Course::RandomFourier { seed, frequency, harmonics, share } => FourierMotion::random(
                &plant,
                &MotionLimits::of(planning, *share),
                *frequency,
                *harmonics,
                &mut ChaCha8Rng::seed_from_u64(*seed),
            ),
        };
        let steps = GRID * motion.sine.len().max(motion.cosine.len()).max(1);
        for k in 0..steps {
            let t = k as f64 / steps as f64 / motion.frequency;
            let platform = motion.at(t);
            let joints =
                plant.geometry.inverse_motion(&platform).map_err(|source| MotionError::Unreachable { t, source })?;
            plant
                .geometry
                .check_limits(&joints.q, &platform.position)
                .map_err(|source| MotionError::Unreachable { t, source })?;
            for (axis, (rate, drive)) in joints.qd.iter().zip(&planning.drives).enumerate() {
                if rate.abs() > drive.max_speed {
                    return Err(MotionError::TooFast { t, axis, speed: rate.abs(), limit: drive.max_speed });
                }
            }
        }
        Ok(motion)
    }

    /// How the twin is to run.
    pub fn options(&self) -> twin::Options {
        twin::Options {
            duration: self.duration,
            substeps: self.substeps,
            noise_seed: self.noise.then_some(self.seed),
            strut_sensors: self.strut_sensors,
            ..twin::Options::default()
        }
    }
}
