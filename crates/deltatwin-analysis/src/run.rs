//! The whole loop: check, identify, compare, diagnose, add.

use std::sync::atomic::{AtomicBool, Ordering};

use thiserror::Error;

use crate::data::{Data, Joined};
use crate::gate::{Examined, Refusal};
use crate::identify::Identification;
use crate::progress::Course;
use deltatwin::comparison::{Comparison, compare, compare_with};
use deltatwin::diagnosis::{Clock, Diagnosis, DiagnosisError, Options, diagnose_with};
use deltatwin::evidence::Stop;
use deltatwin::gate::Finding;
use deltatwin::identification::{FitError, HeldOut, NoiseLevel, fit, fit_with};
use deltatwin::model::Model;

/// What a user decides about a run.
#[derive(Clone, Copy)]
pub struct Settings<'a> {
    /// Effects (or `rigid_bodies`) whose parameters the diagnosis does not fit.
    pub hold: &'a [String],
    /// Share of the time that has passed; from 1 on the stages give their best answers so far, infinity stops.
    pub clock: Clock<'a>,
    /// Whether recordings that do not belong to the model are fitted all the same.
    pub no_gate: bool,
}

impl Default for Settings<'_> {
    /// Everything is fitted, without a time limit, and the gate refuses.
    fn default() -> Self {
        Self { hold: &[], clock: &|| 0.0, no_gate: false }
    }
}

/// Stages of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Whether the recordings belong to the model.
    Check,
    /// Fit of the model as it is.
    Identify,
    /// Which effect is missing, and the model with it; at the same time where the delivered and the fitted model fail.
    Diagnose,
}

impl std::fmt::Display for Stage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(match self {
            Self::Check => "check",
            Self::Identify => "identify",
            Self::Diagnose => "diagnose",
        })
    }
}

/// How far a run is.
#[derive(Clone, Copy, Debug)]
pub struct Step<'a> {
    /// The stage that goes on.
    pub stage: Stage,
    /// Share of the run that is done, from experience with recordings of 20 s.
    pub fraction: f64,
    /// What the stage does; may be empty.
    pub what: &'a str,
}

/// Results of a run.
#[derive(Clone)]
pub struct Analysis {
    /// Findings of the gate.
    pub gate: Vec<Finding>,
    /// Zeros of recordings that were joined to that of the first.
    pub zeros: Vec<Joined>,
    /// Warnings about data and results.
    pub warnings: Vec<String>,
    /// The delivered model and what was measured.
    pub delivered: Comparison,
    /// Fit of the delivered model.
    pub identification: Identification,
    /// The fitted model and what was measured.
    pub identified: Comparison,
    /// Stages that ended before they were done, for lack of time.
    pub cut: Vec<Stage>,
    /// Diagnosis of the delivered model, whose numbers are the prior of every fit; its model has the effects added.
    pub diagnosis: Diagnosis,
}

/// Reason why a run ends without results.
#[derive(Debug, Error)]
pub enum RunError {
    /// The recordings do not belong to the model; nothing was fitted.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// The model cannot follow a recording or be fitted to it.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// The diagnosis failed.
    #[error(transparent)]
    Diagnosis(#[from] DiagnosisError),
    /// The clock has stopped the run.
    #[error("stopped before anything was diagnosed")]
    Stopped,
}

/// The loop on `model` and the recordings of `data`: the gate, a fit, comparisons of the delivered and the fitted model,
/// and the diagnosis, which adds what it finds. `progress` is called at every step.
///
/// # Errors
/// [`RunError::Refused`] before anything is fitted if a recording does not belong to the model; else why a stage failed,
/// or that it was stopped.
///
/// # Panics
/// If `data` has no recording.
pub fn run(
    model: &Model,
    data: &Data,
    settings: &Settings,
    progress: &mut dyn FnMut(Step),
) -> Result<Analysis, RunError> {
    let mut step = |stage, fraction, what: &str| progress(Step { stage, fraction, what });
    step(Stage::Check, 0.0, "");
    let (gate, mut warnings) = Examined::of(model, data).pass(settings.no_gate)?;
    step(Stage::Identify, 0.03, "");
    let is_cut = AtomicBool::new(false);
    let is_late = || {
        let is_late = (settings.clock)() >= LAST_FIT;
        is_cut.fetch_or(is_late, Ordering::Relaxed);
        is_late
    };
    let identification = identify_until(model, data, Some(&is_late))?;
    stop(settings)?;
    let fitted = &identification.fitted;
    let mut course = Course::default();
    step(Stage::Diagnose, DIAGNOSIS, "");
    let first = Some(fitted).filter(|_| !is_cut.load(Ordering::Relaxed));
    let options = Options { fixed: settings.hold, clock: settings.clock, fitted: first, ..Options::default() };
    // The comparisons need nothing of the diagnosis, much of which is serial.
    let (compared, diagnosis) = std::thread::scope(|scope| {
        let compared = scope.spawn(|| {
            let delivered = compare(model, &data.datasets, &data.held_out)?;
            let identified = compare_with(&fitted.model, &data.datasets, &data.held_out, &fitted.residuals)?;
            Ok::<_, FitError>((delivered, identified))
        });
        let diagnosis = diagnose_with(model, &data.datasets, &data.held_out, &options, &mut |report| {
            course.follow(&report);
            step(Stage::Diagnose, DIAGNOSIS + (1.0 - DIAGNOSIS) * course.span().0, course.text());
        });
        (compared.join(), diagnosis)
    });
    let (delivered, identified) = compared.unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
    let diagnosis = match diagnosis {
        Err(DiagnosisError::Stopped) => return Err(RunError::Stopped),
        other => other?,
    };
    warnings.extend(crate::gate::much_is_left(&diagnosis.channels, &diagnosis.rms_after, &diagnosis.noise_floor));
    let zeros = data.zeros.clone();
    let cut = [(Stage::Identify, is_cut.into_inner()), (Stage::Diagnose, !diagnosis.not_tried.is_empty())];
    let cut: Vec<Stage> = cut.into_iter().filter(|(_, is_cut)| *is_cut).map(|(stage, _)| stage).collect();
    warnings.extend(cut_short(&cut, &diagnosis));
    Ok(Analysis { gate, zeros, warnings, delivered, identification, identified, cut, diagnosis })
}

/// Share of the time after which the fit of the delivered model gives its best parameters so far.
const LAST_FIT: f64 = 0.3;

/// Warning about stages that ended before they were done; `None` if all did.
fn cut_short(cut: &[Stage], diagnosis: &Diagnosis) -> Option<String> {
    let ended = crate::sentence::ended(diagnosis);
    let what = |stage: &Stage| match stage {
        Stage::Diagnose => format!("diagnose, which did not try {}", diagnosis.not_tried.join(", ")),
        other => format!("{other}, which has the best parameters so far"),
    };
    let cut: Vec<String> = cut.iter().map(what).collect();
    (!cut.is_empty()).then(|| format!("{ended}; cut short: {}", cut.join("; ")))
}

/// Fit of `model` with the default options, and the errors that it leaves.
///
/// # Errors
/// If the model cannot be fitted.
///
/// # Panics
/// If `data` has no recording.
pub fn identify(model: &Model, data: &Data) -> Result<Identification, FitError> {
    identify_until(model, data, None)
}

/// As [`identify`]; the fit ends with the best parameters so far once `stop` returns true.
///
/// # Errors
/// As [`identify`].
///
/// # Panics
/// As [`identify`].
pub fn identify_until(model: &Model, data: &Data, stop: Option<Stop>) -> Result<Identification, FitError> {
    let noise = NoiseLevel::measured(model, &data.datasets)?;
    let options = fit::Options { stop, ..fit::Options::default() };
    let fitted = fit_with(model, &data.datasets, &noise.of_each, &options)?;
    let held_out = HeldOut::new(&fitted.model, &data.held_out)?;
    Ok(Identification { fitted, channels: data.channels().to_vec(), noise_floor: noise.pooled, held_out, limbs: None })
}

fn stop(settings: &Settings) -> Result<(), RunError> {
    if (settings.clock)() == f64::INFINITY { Err(RunError::Stopped) } else { Ok(()) }
}

/// Share of a run after which the diagnosis begins.
const DIAGNOSIS: f64 = 0.12;
