//! Demonstration of the complete workflow: hide an effect in a robot, measure it, and diagnose it.

use std::path::{Path, PathBuf};

use miette::{IntoDiagnostic, WrapErr};
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use thiserror::Error;

use crate::exam::campaign::{Prepared, prepare};
use crate::exam::judge::Truth;
use crate::exam::{Answer, Campaign, CampaignError, Case, Grade, Hidden, MotionKind, hideable};
use deltatwin::effects::Role;
use deltatwin::identification::Dataset;
use deltatwin::model::Model;
use deltatwin::text::significant;
use deltatwin_analysis::run::RunError;
use deltatwin_analysis::{Analysis, Data, Settings, Step, run};
use deltatwin_io::file::replace_text;
use deltatwin_io::recording;

/// Duration of each recording, s.
pub const DURATION: f64 = 20.0;

/// Reason why a demo fails.
#[derive(Debug, Error)]
pub enum DemoError {
    /// The campaign cannot be prepared.
    #[error(transparent)]
    Campaign(#[from] CampaignError),
}

/// Effects that were drawn and not hidden, and why.
pub type LeftOut = Vec<(&'static str, &'static str)>;

/// A robot to be measured.
pub struct Robot {
    /// The robot with its hidden effect.
    pub prepared: Prepared,
    /// Effects drawn before it, and why they were left out.
    pub left_out: LeftOut,
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

/// Seed of the example to begin with, and the model that belongs to it.
pub const EXAMPLE: (u64, &str) = (5, "irb360-6-1600");

/// Writes the recordings of a campaign to an existing folder: one to fit to, one to hold out, and a text that names what is
/// hidden.
///
/// # Errors
/// If a file cannot be written.
pub fn write_example(campaign: &Campaign, folder: &Path) -> miette::Result<[PathBuf; 3]> {
    let files = ["first.csv", "second.csv", "hidden.txt"].map(|name| folder.join(name));
    for (recorded, file) in [&campaign.measurement, &campaign.validation].into_iter().zip(&files) {
        recording::write(recorded, file)?;
    }
    replace_text(&files[2], &format!("{}\n", describe(campaign)))
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot write {}", files[2].display()))?;
    Ok(files)
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

/// Results of the loop on a robot with a hidden effect.
pub struct Findings {
    /// Datasets of the measurement and, held out, of the validation.
    pub data: Data,
    /// What the loop found.
    pub analysis: Analysis,
    /// Whether the hidden effect was named, alone or in an indistinguishable set.
    pub right: bool,
}

impl Findings {
    /// RMS residuals on the held-out motion of the delivered, the identified and the extended model, N·m or N per
    /// channel.
    pub fn stage_rms(&self) -> [Vec<f64>; 3] {
        let Analysis { delivered, diagnosis, .. } = &self.analysis;
        let first = delivered.judged().0.to_vec();
        [first, diagnosis.rms_before.clone(), diagnosis.rms_after.clone()]
    }
}

/// The whole loop on the delivered model, with validation on the second recording.
///
/// # Errors
/// If the model cannot be fitted or the diagnosis fails.
pub fn investigate(campaign: &Campaign, progress: &mut dyn FnMut(Step)) -> Result<Findings, RunError> {
    let [datasets, held_out] = [&campaign.measurement, &campaign.validation].map(|r| vec![Dataset::new(r)]);
    let data = Data { datasets, held_out, zeros: Vec::new(), warnings: Vec::new() };
    // A hidden effect may look like an error of the recording, so that the gate only warns.
    let settings = Settings { no_gate: true, ..Settings::default() };
    let analysis = run(&campaign.model, &data, &settings, progress)?;
    let truth =
        Truth { effects: campaign.hidden.iter().map(|h| h.active.effect.name().into()).collect(), ..Truth::default() };
    let right = Grade::of(&truth, &Answer::from(&analysis.diagnosis)) == Grade::Right;
    Ok(Findings { data, analysis, right })
}
