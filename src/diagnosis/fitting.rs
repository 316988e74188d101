//! How models are fitted to the recordings of a diagnosis, and how long it may take.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

use super::problem::{self, Edges};
use crate::effects::ActiveEffect;
use crate::evidence::Problem;
use crate::identification::Dataset;
use crate::identification::dataset::noise_floor;
use crate::identification::fit::{self, Fit, FitError, Options as FitOptions, fit_with};
use crate::model::Model;

/// Returns the share of the time for a diagnosis that has passed; 1 and more once it is up.
pub type Clock<'a> = &'a (dyn Fn() -> f64 + Sync);

/// What is known before a diagnosis, and how long it may take.
#[derive(Clone, Copy)]
pub struct Options<'a> {
    /// Effects (or `rigid_bodies`) whose parameters are known: they are not fitted.
    pub fixed: &'a [String],
    /// Once it says that the time is up, the best answer so far is given, with what was not tried.
    pub clock: Clock<'a>,
}

impl Default for Options<'_> {
    /// Fits all parameters and takes the time it needs.
    fn default() -> Self {
        Self { fixed: &[], clock: &|| 0.0 }
    }
}

/// Steps of a diagnosis that begin only while there is time.
#[derive(Clone, Copy)]
pub(super) enum Stage {
    /// The search for a law outside the library.
    UnknownLaw,
    /// The choice of the next experiment, and the end of everything before it.
    NextExperiment,
}

/// Share of the time after which no further effect is looked for.
const LAST_SEARCH: f64 = 0.6;
/// The same for the first effect: on a slow computer it is tried all the same.
const FIRST_SEARCH: f64 = 2.0;

/// How a model is fitted to the recordings.
pub(super) struct Fitting<'a> {
    pub datasets: &'a [Dataset],
    /// Standard deviation of the noise of each channel.
    pub noise: Vec<f64>,
    /// Effects that keep their parameters.
    pub fixed: &'a [String],
    clock: Clock<'a>,
    has_tried: AtomicBool,
    work: Mutex<Work>,
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

impl<'a> Fitting<'a> {
    pub fn new(model: &Model, datasets: &'a [Dataset], options: &Options<'a>) -> Self {
        let noise = noise_floor(model, datasets);
        Self {
            datasets,
            noise,
            fixed: options.fixed,
            clock: options.clock,
            has_tried: AtomicBool::new(false),
            work: Mutex::default(),
        }
    }

    /// Refits the parameters of `model` that are not fixed.
    pub fn fit(&self, model: &Model) -> Result<Fit, FitError> {
        let weights = vec![self.noise.clone(); self.datasets.len()];
        let stop = || self.is_late();
        let options = FitOptions { fixed: self.fixed, stop: Some(&stop), ..FitOptions::default() };
        let fitted = fit_with(model, self.datasets, &weights, &options)?;
        let mut work = self.work.lock().unwrap_or_else(PoisonError::into_inner);
        work.fits += 1;
        work.fitting += fitted.work;
        Ok(fitted)
    }

    /// Counts assessments of all candidates.
    pub fn count_rankings(&self, rankings: usize) {
        self.work.lock().unwrap_or_else(PoisonError::into_inner).rankings += rankings;
    }

    /// The work so far.
    pub fn work(&self) -> Work {
        *self.work.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether it is too late to look for another effect.
    pub fn is_late(&self) -> bool {
        (self.clock)() >= if self.has_tried.load(Ordering::Relaxed) { LAST_SEARCH } else { FIRST_SEARCH }
    }

    /// Whether a stage may still begin.
    pub fn has_time_for(&self, stage: Stage) -> bool {
        (self.clock)()
            < match stage {
                Stage::UnknownLaw => 0.75,
                Stage::NextExperiment => 0.9,
            }
    }

    /// Says that an effect was tried: from now on the time is as long as it is.
    pub fn tried(&self) {
        self.has_tried.store(true, Ordering::Relaxed);
    }

    /// The linearised problem of a fit, without the parameters that are fixed or held by physical consistency.
    pub fn problem(&self, fit: &Fit, candidates: &[Vec<ActiveEffect>], edges: Edges) -> Result<Problem, FitError> {
        let mut problem = problem::problem(fit, self.datasets, &self.noise, candidates)?;
        problem.base.retain(|c| !self.is_fixed(&c.name));
        problem::along_edges(&mut problem.base, fit, edges);
        Ok(problem)
    }

    /// Whether a parameter, with its effect before its name, keeps its value.
    pub fn is_fixed(&self, parameter: &str) -> bool {
        self.fixed.iter().any(|f| parameter.split('.').next() == Some(f))
    }
}
