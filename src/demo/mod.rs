//! The whole loop on one machine: hide an effect in a robot, measure it, and let the model find out.

pub mod command;
mod figures;
mod hidden;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use thiserror::Error;

pub use hidden::{Hidden, perturb};

use crate::comparison::{Comparison, compare};
use crate::diagnosis::{Diagnosis, DiagnosisError, Verdict, diagnose};
use crate::dynamics::Plant;
use crate::identification::{Fit, FitError, Trace, fit};
use crate::model::Model;
use crate::recording::{Payload, Recording, Setup};
use crate::scenario::{FourierMotion, MotionLimits, Sensors};
use crate::twin::{Options, Report, SimulationError, simulate};

/// The demo's machine: the shipped model of the IRB 360-6/1600.
pub const MODEL: &str = include_str!("../../models/irb360-6-1600.toml");

/// Length of each recording, s.
pub const DURATION: f64 = 20.0;

/// Base frequency, Hz, and harmonics of the excitation.
const FOURIER: (f64, usize) = (0.1, 10);

/// Share of the drives' limits the excitation may use.
const SHARE: f64 = 0.45;

/// Why a demo fails.
#[derive(Debug, Error)]
pub enum DemoError {
    /// The twin stopped.
    #[error(transparent)]
    Simulation(#[from] SimulationError),
    /// The model cannot be fitted.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// The diagnosis failed.
    #[error(transparent)]
    Diagnosis(#[from] DiagnosisError),
    /// No such effect to hide.
    #[error("cannot hide `{name}`: expected `none` or one of {}", .known.join(", "))]
    Effect {
        /// What was asked for.
        name: String,
        /// What can be hidden.
        known: Vec<&'static str>,
    },
}

/// A robot with a hidden effect and what was measured on it.
pub struct Campaign {
    /// What is hidden.
    pub hidden: Hidden,
    /// The user's model: right in structure but for the hidden effect, a few percent off in its numbers.
    pub model: Model,
    /// The robot.
    pub robot: Model,
    /// Recording to learn from.
    pub measurement: Recording,
    /// Another motion of the same robot to judge on.
    pub validation: Recording,
    /// What the twin says of the two runs.
    pub reports: [Report; 2],
}

/// Hides `effect` (drawn from the seed if `None`) in a robot and records two motions; `progress` gets the run (0 or 1)
/// and the simulated time.
pub fn campaign(
    model: &Model,
    seed: u64,
    effect: Option<&str>,
    progress: &(dyn Fn(usize, f64) + Sync),
) -> Result<Campaign, DemoError> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let hidden = Hidden::draw(effect, &mut rng)?;
    hide(model, seed, hidden, &mut rng, progress)
}

/// Hides a given effect and records two motions; `rng` draws the model's errors and the motions, `seed` the noise.
pub fn hide(
    model: &Model,
    seed: u64,
    hidden: Hidden,
    mut rng: &mut ChaCha8Rng,
    progress: &(dyn Fn(usize, f64) + Sync),
) -> Result<Campaign, DemoError> {
    let mut robot = model.clone();
    hidden::perturb(&mut robot, rng);
    robot.effects.extend(hidden.active.clone());
    let setup = Setup {
        payload: Payload { mass: 2.5, com: [0.03, -0.02, -0.08].into(), inertia_zz: 0.012 },
        torque_noise: Some([0.4, 0.4, 0.4, 0.05]),
        ..Setup::default()
    };
    let believed = Plant::new(model, &setup);
    let motions: Vec<FourierMotion> = (0..2)
        .map(|_| FourierMotion::random(&believed, &MotionLimits::of(model, SHARE), FOURIER.0, FOURIER.1, &mut rng))
        .collect();
    let run = |k: usize| {
        let options = Options {
            duration: DURATION,
            noise_seed: Some(seed.wrapping_mul(2).wrapping_add(k as u64)),
            sensors: Sensors { strut_upper: [true, false, false, false, false, false], ..Sensors::default() },
            ..Options::default()
        };
        simulate(&robot, &setup, &believed, &|t| motions[k].at(t), &options, &mut |t| {
            progress(k, t);
            true
        })
    };
    let (first, second) = rayon::join(|| run(0), || run(1));
    let ((mut measurement, a), (mut validation, b)) = (first?, second?);
    measurement.name = "measurement".into();
    validation.name = "validation".into();
    Ok(Campaign { hidden, model: model.clone(), robot, measurement, validation, reports: [a, b] })
}

/// What the loop finds.
pub struct Findings {
    /// Trace of the measurement.
    pub measurement: Trace,
    /// Trace of the validation.
    pub validation: Trace,
    /// Model as it came against the measurement.
    pub comparison: Comparison,
    /// Identified parameters of the model as it came.
    pub identified: Fit,
    /// What is missing.
    pub diagnosis: Diagnosis,
    /// Whether the hidden effect was named, alone or in a set that cannot be told apart.
    pub right: bool,
}

/// Compare, identify, diagnose and add, judged on the validation.
pub fn investigate(campaign: &Campaign, progress: &mut dyn FnMut(&str)) -> Result<Findings, DemoError> {
    progress("compare");
    let measurement = Trace::new(&campaign.measurement);
    let validation = Trace::new(&campaign.validation);
    let comparison = compare(&campaign.model, std::slice::from_ref(&measurement), std::slice::from_ref(&validation))?;
    progress("identify");
    let noise = measurement.noise(&campaign.model);
    let identified = fit(&campaign.model, std::slice::from_ref(&measurement), &[noise])?;
    let diagnosis =
        diagnose(&campaign.model, std::slice::from_ref(&measurement), std::slice::from_ref(&validation), progress)?;
    let right = is_right(&campaign.hidden, &diagnosis);
    Ok(Findings { measurement, validation, comparison, identified, diagnosis, right })
}

/// A larger set of effects that cannot be told apart names nothing.
const LARGEST_SET: usize = 3;

fn is_right(hidden: &Hidden, diagnosis: &Diagnosis) -> bool {
    let Some(active) = &hidden.active else { return diagnosis.verdict == Verdict::None };
    let name = active.effect.name();
    diagnosis.effects.first().is_some_and(|e| e.name == name)
        || diagnosis.indistinguishable.iter().any(|set| set.len() <= LARGEST_SET && set.iter().any(|n| n == name))
}
