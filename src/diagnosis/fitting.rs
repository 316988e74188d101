//! Fits of models to the recordings of a diagnosis within a time limit.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use super::DiagnosisError;
use super::problem::{OwnedColumns, block};
use crate::effects::{ActiveEffect, Effect, Entry, Param};
use crate::identification::fit::{self, Fit, FitError, Options as FitOptions, fit_with};
use crate::identification::{Dataset, KeptColumns, Laps, NoiseLevel, Repeats, Residuals};
use crate::machine::Unit;
use crate::model::Model;

/// Function that returns the share of the permitted time that has passed; 1 or more when it is up, infinity to stop.
pub type Clock<'a> = &'a (dyn Fn() -> f64 + Sync);

/// Prior knowledge and time limit of a diagnosis.
#[derive(Clone, Copy)]
pub struct Options<'a> {
    /// Effects (or `rigid_bodies`) whose parameters are known and not fitted.
    pub fixed: &'a [String],
    /// When the time is up, the best result so far is returned with the steps not tried; infinity stops without a result.
    pub clock: Clock<'a>,
    /// Effects outside the registry that are tried beside it, with names of their own.
    pub candidates: &'a [Arc<dyn Effect>],
    /// The converged fit of the model to the recordings with default options, if there is one already; it is made again
    /// where parameters are fixed.
    pub fitted: Option<&'a Fit>,
}

impl Default for Options<'_> {
    /// All parameters are fitted without a time limit.
    fn default() -> Self {
        Self { fixed: &[], clock: &|| 0.0, candidates: &[], fitted: None }
    }
}

/// Steps of a diagnosis that start only if there is time.
#[derive(Clone, Copy)]
pub(super) enum Stage {
    /// The search for a law outside the library.
    UnknownLaw,
    /// The planning of the next experiment, and the end of all previous steps.
    NextExperiment,
}

/// Most work of a diagnosis, in passes over the data of an axis that compute all columns of a model, so that the same
/// recordings have the same answer on every computer; and the work of a pass that predicts, in such passes.
const MOST_PASSES: f64 = 400.0;
const PREDICTION: f64 = 0.3;
/// Samples below which a pass counts less, and the least share that it counts.
const FULL: f64 = 50_000.0;
const LEAST: f64 = 0.25;

/// Time, s, over which samples are averaged for fits of models whose laws are slower than 50 Hz, and share of it that is
/// hardly a delay.
const MEANS: f64 = 2e-3;
const HARDLY: f64 = 0.1;

/// Share of the time after which no further effect is searched.
const LAST_SEARCH: f64 = 0.6;
/// The share for the first effect, large enough for a slow computer to try it.
const FIRST_SEARCH: f64 = 2.0;
/// The share for effects next to a formula, which are searched once it is known.
const SEARCH_NEXT_TO_FORMULA: f64 = 0.85;

/// Fits of models to the recordings.
pub(super) struct Fitting<'a> {
    pub datasets: &'a [Dataset],
    /// The recordings with the columns that their models share.
    pub kept: Vec<KeptColumns<'a>>,
    /// Their [`means`]; may be empty.
    means: &'a [Dataset],
    kept_means: Vec<KeptColumns<'a>>,
    /// Their noise.
    pub noise: NoiseLevel,
    /// Noise of their means over [`block`] samples by repeated laps, where that differs from white noise; may be empty.
    pub noise_of_means: Vec<Option<f64>>,
    /// Effects whose parameters are held.
    pub fixed: &'a [String],
    /// Effects outside the registry.
    pub candidates: &'a [Arc<dyn Effect>],
    clock: Clock<'a>,
    has_tried: AtomicBool,
    /// Whether a formula is known, next to which effects are searched.
    has_formula: AtomicBool,
    /// Whether a fit ended before it converged, for lack of time.
    was_stopped: AtomicBool,
    work: Mutex<Work>,
    /// Columns of the last fits, each known by its residuals.
    pub columns: Mutex<Vec<(Arc<Residuals>, OwnedColumns)>>,
}

/// Work of a diagnosis, in counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Models fitted.
    pub fits: usize,
    /// Work of all these fits.
    pub fitting: fit::Work,
    /// Times all candidates were assessed.
    pub rankings: usize,
}

/// Means of the recordings of a robot over [`MEANS`], where its motion determines the torques; empty where the sampling is as
/// slow.
pub(super) fn means(datasets: &[Dataset]) -> Vec<Dataset> {
    let is_fast = |t: &Dataset| t.mechanism.axes() > 1 && t.stride(MEANS) > 1 && !t.blurs_reversals();
    if !datasets.iter().all(is_fast) {
        return Vec::new();
    }
    datasets.iter().map(|t| t.averaged(t.stride(MEANS))).collect()
}

/// Whether an effect changes little between the samples of `means`, and depends on the present motion alone.
fn is_slow(active: &ActiveEffect, means: &[Dataset]) -> bool {
    let step = means.iter().fold(f64::INFINITY, |least, t| least.min(t.dt));
    let is_fast = |(entry, value): (Entry, &f64)| match entry.parameter.unit {
        Unit::GearRatio | Unit::Hz => true,
        Unit::S => active.effect.sensor().is_some() && value.abs() > HARDLY * step,
        _ => false,
    };
    active.states() == 0
        && active.gear_springs().is_none()
        && !active.entries().into_iter().zip(&active.values).any(is_fast)
}

impl<'a> Fitting<'a> {
    pub fn new(model: &Model, datasets: &'a [Dataset], options: &Options<'a>) -> Self {
        let noise = NoiseLevel::of(model, datasets);
        Self {
            datasets,
            kept: KeptColumns::of(datasets),
            means: &[],
            kept_means: Vec::new(),
            noise,
            noise_of_means: Vec::new(),
            fixed: options.fixed,
            candidates: options.candidates,
            clock: options.clock,
            has_tried: AtomicBool::new(false),
            has_formula: AtomicBool::new(false),
            was_stopped: AtomicBool::new(false),
            work: Mutex::default(),
            columns: Mutex::default(),
        }
    }

    /// With the [`means`] of the recordings, to which models without fast laws are fitted.
    pub fn with_means(mut self, means: &'a [Dataset]) -> Self {
        self.means = means;
        self.kept_means = KeptColumns::of(means);
        self
    }

    /// With the noise of repeated laps where it is sharper than that of neighbouring samples.
    ///
    /// # Errors
    /// [`FitError::Kinematics`] if the inverse dynamics of `model` fail at a measured pose.
    pub fn with_repeats(mut self, model: &Model) -> Result<Self, FitError> {
        let Some(laps) = Laps::find(self.datasets) else { return Ok(self) };
        let residuals = Residuals::new(model, self.datasets)?;
        self.noise = self.noise.with_laps(&laps, self.datasets, &residuals).0;
        self.noise_of_means = Repeats::of_means(&laps, self.datasets, &residuals, &self.noise, block(self.datasets));
        Ok(self)
    }

    /// The fit of `model` that `options` have already, or one that is made now.
    pub fn refit(&self, model: &Model, options: &Options) -> Result<Fit, FitError> {
        options.fitted.filter(|_| options.fixed.is_empty()).map_or_else(|| self.fit(model), |fit| Ok(fit.clone()))
    }

    /// Refits the parameters of `model` that are not fixed, an impossible machine corrected approximately: see [`FitOptions::is_approximate`].
    pub fn fit(&self, model: &Model) -> Result<Fit, FitError> {
        self.fit_with(model, true)
    }

    /// [`Self::fit`], which leaves no more than `model` does.
    pub fn fit_possible(&self, model: &Model) -> Result<Fit, FitError> {
        self.fit_with(model, false)
    }

    fn fit_with(&self, model: &Model, is_approximate: bool) -> Result<Fit, FitError> {
        let stop = || {
            let is_late = self.is_late();
            self.was_stopped.fetch_or(is_late, Ordering::Relaxed);
            is_late
        };
        let options = FitOptions { fixed: self.fixed, stop: Some(&stop), is_approximate, ..FitOptions::default() };
        let fitted = if !self.means.is_empty() && model.effects.iter().all(|active| is_slow(active, self.means)) {
            let fit = fit_with(
                model,
                self.means,
                &self.noise_of_the_means(),
                &FitOptions { kept: Some(&self.kept_means), ..options },
            )?;
            Fit { residuals: Arc::new(Residuals::along(&fit.model, &self.kept)?), ..fit }
        } else {
            fit_with(model, self.datasets, &self.noise.of_each, &FitOptions { kept: Some(&self.kept), ..options })?
        };
        let mut work = self.work.lock().unwrap_or_else(PoisonError::into_inner);
        work.fits += 1;
        work.fitting += fitted.work;
        Ok(fitted)
    }

    /// Noise of the means of each recording and channel, N·m or N.
    fn noise_of_the_means(&self) -> Vec<Vec<f64>> {
        let scaled = |((own, mean), sigma): ((&Dataset, &Dataset), &Vec<f64>)| {
            sigma.iter().map(|s| s * (own.dt / mean.dt).sqrt()).collect()
        };
        self.datasets.iter().zip(self.means).zip(&self.noise.of_each).map(scaled).collect()
    }

    /// Counts assessments of all candidates.
    pub fn count_rankings(&self, rankings: usize) {
        self.work.lock().unwrap_or_else(PoisonError::into_inner).rankings += rankings;
    }

    /// The work so far.
    pub fn work(&self) -> Work {
        *self.work.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether a fit ended before it converged, for lack of time.
    pub fn was_stopped(&self) -> bool {
        self.was_stopped.load(Ordering::Relaxed)
    }

    /// Share of the permitted time or work that has passed, the larger one.
    fn passed(&self) -> f64 {
        (self.clock)().max(self.worked())
    }

    /// Share of the permitted work that is done.
    fn worked(&self) -> f64 {
        let fitting = self.work().fitting;
        let passes = fitting.regressions as f64 + PREDICTION * fitting.predictions as f64;
        let axes = self.datasets.first().map_or(1, |dataset| dataset.mechanism.axes());
        let samples: usize = self.datasets.iter().map(Dataset::len).sum();
        axes as f64 * (samples as f64 / FULL).clamp(LEAST, 1.0) * passes / MOST_PASSES
    }

    /// Whether the work, and not the time, ends the search.
    pub fn is_work_spent(&self) -> bool {
        self.worked() > (self.clock)()
    }

    /// Goes on unless the clock has stopped the diagnosis.
    ///
    /// # Errors
    /// [`DiagnosisError::Stopped`].
    pub fn go_on(&self) -> Result<(), DiagnosisError> {
        if (self.clock)() == f64::INFINITY { Err(DiagnosisError::Stopped) } else { Ok(()) }
    }

    /// Whether it is too late to search another effect.
    pub fn is_late(&self) -> bool {
        let has_formula = self.has_formula.load(Ordering::Relaxed);
        self.passed()
            >= match self.has_tried.load(Ordering::Relaxed) {
                _ if has_formula => SEARCH_NEXT_TO_FORMULA,
                true => LAST_SEARCH,
                false => FIRST_SEARCH,
            }
    }

    /// Permits the search for effects next to a formula.
    pub fn search_next_to_formula(&self) {
        self.has_formula.store(true, Ordering::Relaxed);
    }

    /// Whether a stage may still start.
    pub fn has_time_for(&self, stage: Stage) -> bool {
        self.passed()
            < match stage {
                Stage::UnknownLaw => 0.75,
                Stage::NextExperiment => 0.9,
            }
    }

    /// Records that an effect was tried; from then on [`LAST_SEARCH`] limits the time.
    pub fn tried(&self) {
        self.has_tried.store(true, Ordering::Relaxed);
    }

    /// Whether a parameter is fixed.
    pub fn is_fixed(&self, parameter: Param) -> bool {
        self.fixed.iter().any(|effect| effect == parameter.effect)
    }
}
