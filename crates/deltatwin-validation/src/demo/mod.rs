//! The whole loop on one machine: hide an effect in a robot, measure it, and let the model find out.

pub mod figures;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use thiserror::Error;

use crate::exam::judge::Truth;
use crate::exam::{Answer, Campaign, CampaignError, Case, Grade, Hidden, MotionKind, campaign};
use deltatwin::comparison::{Comparison, compare};
use deltatwin::diagnosis::{Diagnosis, DiagnosisError, diagnose};
use deltatwin::effects::Role;
use deltatwin::identification::{Fit, FitError, Trace, fit};
use deltatwin::model::Model;
use deltatwin::text::significant;

/// The demo's machine: the shipped model of the IRB 360-6/1600.
pub const MODEL: &str = include_str!("../../../../models/irb360-6-1600.toml");

/// Length of each recording, s.
pub const DURATION: f64 = 20.0;

/// Effects that are hidden if none is asked for: each shows in these recordings.
const SHOWN: [&str; 12] = [
    "ball_socket_viscous",
    "ball_socket_coulomb",
    "ball_socket_load_dependent",
    "drive_stribeck",
    "drive_coulomb_asymmetry",
    "thermal_friction_drift",
    "torque_ripple",
    "payload_mass_error",
    "strut_length_error",
    "base_tilt",
    "torque_gain_error",
    "signal_delay",
];

/// Why a demo fails.
#[derive(Debug, Error)]
pub enum DemoError {
    /// The campaign cannot be made.
    #[error(transparent)]
    Campaign(#[from] CampaignError),
    /// The model cannot be fitted.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// The diagnosis failed.
    #[error(transparent)]
    Diagnosis(#[from] DiagnosisError),
}

/// Hides `effect` (drawn from the seed if `None`, nothing if `none`) in a robot and records two motions; `progress` gets
/// the run (0 or 1) and the simulated time.
pub fn measure(
    model: &Model,
    seed: u64,
    effect: Option<&str>,
    progress: &(dyn Fn(usize, f64) + Sync),
) -> Result<Campaign, DemoError> {
    let drawn = SHOWN[ChaCha8Rng::seed_from_u64(seed).random_range(0..SHOWN.len())];
    let name = effect.unwrap_or(drawn);
    let effects = if name == "none" { Vec::new() } else { vec![name.to_string()] };
    Ok(campaign(
        model,
        &Case { seed, effects, motion: MotionKind::Fourier, duration: DURATION, ..Case::default() },
        progress,
    )?)
}

/// What is hidden in a campaign.
pub fn hidden(campaign: &Campaign) -> &'static str {
    campaign.hidden.first().map_or("none", |h| h.active.effect.name())
}

/// What is hidden in a campaign, with its values.
pub fn describe(campaign: &Campaign) -> String {
    let Some(Hidden { active, .. }) = campaign.hidden.first() else { return "nothing".into() };
    let values: Vec<String> = active
        .entries()
        .iter()
        .zip(&active.values)
        .filter(|(e, v)| e.parameter.role != Role::Fixed && **v != 0.0)
        .map(|(e, v)| format!("{} = {} {}", e.name, significant(*v, 4), e.parameter.unit))
        .collect();
    format!("{}: {}", active.effect.name(), values.join(", "))
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
    let truth =
        Truth { effects: campaign.hidden.iter().map(|h| h.active.effect.name().into()).collect(), ..Truth::default() };
    let right = Grade::of(&truth, &Answer::from(&diagnosis)) == Grade::Right;
    Ok(Findings { measurement, validation, comparison, identified, diagnosis, right })
}
