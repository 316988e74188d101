//! Demonstration of the complete workflow: hide an effect in a robot, measure it, and diagnose it.

pub mod figures;

use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use thiserror::Error;

use crate::exam::campaign::{Prepared, prepare};
use crate::exam::judge::Truth;
use crate::exam::{Answer, Campaign, CampaignError, Case, Grade, Hidden, MotionKind, hideable};
use deltatwin::comparison::{Comparison, compare};
use deltatwin::diagnosis::{Diagnosis, DiagnosisError, diagnose};
use deltatwin::effects::Role;
use deltatwin::identification::{Dataset, Fit, FitError, fit};
use deltatwin::model::Model;
use deltatwin::text::significant;

/// The machine of the demo: the shipped model of the IRB 360-6/1600.
pub const MODEL: &str = include_str!("../../../../models/irb360-6-1600.toml");

/// Duration of each recording, s.
pub const DURATION: f64 = 20.0;

/// Reason why a demo fails.
#[derive(Debug, Error)]
pub enum DemoError {
    /// The campaign cannot be prepared.
    #[error(transparent)]
    Campaign(#[from] CampaignError),
    /// The model cannot be fitted.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// The diagnosis failed.
    #[error(transparent)]
    Diagnosis(#[from] DiagnosisError),
}

/// A robot to be measured.
pub struct Robot {
    /// The robot with its hidden effect.
    pub prepared: Prepared,
    /// Effects drawn before it, and why they were left out.
    pub left_out: Vec<(&'static str, &'static str)>,
}

/// Robot with the hidden `effect` (nothing for `none`). If it is `None`, effects that the model lacks are drawn from
/// the seed until one is identifiable: a refit leaves as much of it as of one of medium size. Elastic gears are
/// excluded, because their integration along the motion takes minutes.
///
/// # Errors
/// If there is no such effect, or the model cannot be refitted along the drawn motion.
pub fn hide(model: &Model, seed: u64, effect: Option<&str>) -> Result<Robot, DemoError> {
    let prepared = |name: Option<&str>| {
        let effects = name.map(str::to_string).into_iter().collect();
        let case = Case { seed, effects, motion: MotionKind::Fourier, duration: DURATION, ..Case::default() };
        prepare(model, &case, &[])
    };
    let mut left_out = Vec::new();
    if let Some(name) = effect {
        return Ok(Robot { prepared: prepared(Some(name).filter(|name| *name != "none"))?, left_out });
    }
    let mut all = hideable(model);
    all.shuffle(&mut ChaCha8Rng::seed_from_u64(seed));
    for effect in all {
        let robot = prepared(Some(effect.name()))?;
        let visible = robot.hidden.iter().all(|hidden| hidden.rise.is_visible());
        let slow = robot.hidden.iter().any(|hidden| hidden.active.has_gears());
        if visible && !slow {
            return Ok(Robot { prepared: robot, left_out });
        }
        left_out.push((effect.name(), if visible { "takes minutes to find" } else { "not seen in these motions" }));
    }
    Ok(Robot { prepared: prepared(None)?, left_out })
}

/// Name of the effect hidden in a campaign, or `none`.
pub fn hidden(campaign: &Campaign) -> &'static str {
    campaign.hidden.first().map_or("none", |h| h.active.effect.name())
}

/// Effect hidden in a campaign, with its values.
pub fn describe(campaign: &Campaign) -> String {
    let Some(Hidden { active, .. }) = campaign.hidden.first() else { return "nothing".into() };
    let values: Vec<String> = active
        .entries()
        .iter()
        .zip(&active.values)
        .filter(|(e, v)| e.parameter.role != Role::Fixed && **v != 0.0)
        .map(|(e, v)| format!("{} = {}", e.name, e.parameter.unit.quantity(significant(*v, 4))))
        .collect();
    format!("{}: {}", active.effect.name(), values.join(", "))
}

/// Results of the workflow.
pub struct Findings {
    /// Dataset of the measurement.
    pub measurement: Dataset,
    /// Dataset of the validation.
    pub validation: Dataset,
    /// Comparison of the delivered model with the measurement.
    pub comparison: Comparison,
    /// Fit of the delivered model.
    pub identified: Fit,
    /// Diagnosis of the missing effect.
    pub diagnosis: Diagnosis,
    /// Whether the hidden effect was named, alone or in an indistinguishable set.
    pub right: bool,
}

/// Compares, identifies and diagnoses the delivered model, with validation on the second recording.
///
/// # Errors
/// If the model cannot be fitted or the diagnosis fails.
pub fn investigate(campaign: &Campaign, progress: &mut dyn FnMut(&str)) -> Result<Findings, DemoError> {
    progress("compare");
    let measurement = Dataset::new(&campaign.measurement);
    let validation = Dataset::new(&campaign.validation);
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
