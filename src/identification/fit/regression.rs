//! Weighted regression problem of a fit.

use std::cell::Cell;

use nalgebra::DVector;

use super::{Consistency, FitError, Options, Weighing, Work};
use crate::dynamics::{Plant, PlantParameter, set_parameters};
use crate::evidence::{NEVER, Stop};
use crate::identification::estimator::PRIOR_INFORMATION;
use crate::identification::filtering::MIN_HALF_WIDTH;
use crate::identification::normal_equations::{NormalEquations, Weight, used};
use crate::identification::prediction::{Channels, KeptColumns};
use crate::identification::{Dataset, Residuals, regularisation};
use crate::model::Model;
use crate::recording::Series;

/// Regression problem with all quantities that do not depend on the parameters' present values.
pub(super) struct Regression<'a> {
    pub datasets: &'a [Dataset],
    /// The datasets with the columns that their models share.
    kept: Kept<'a>,
    pub sigma: Vec<Vec<f64>>,
    /// Weight of each sample of each dataset.
    uses: Vec<Vec<f64>>,
    /// Whether `sigma` is the noise.
    pub white: bool,
    /// Indices of the estimated parameters.
    pub free: Vec<usize>,
    /// Own size of each estimated parameter.
    pub size: DVector<f64>,
    /// Regularisation values of the estimated parameters.
    pub prior: DVector<f64>,
    /// The consistent machine before the fit.
    pub before: Plant,
    /// Its estimated parameters, in the order of `free`.
    pub parameters: Vec<PlantParameter>,
    pub information: f64,
    /// γ of each estimated parameter.
    pub weights: DVector<f64>,
    pub consistency: Consistency,
    pub stop: Stop<'a>,
    /// Work so far.
    pub work: Cell<Work>,
}

/// Columns of this fit alone, or of several.
enum Kept<'a> {
    Own(Vec<KeptColumns<'a>>),
    Shared(&'a [KeptColumns<'a>]),
}

impl<'a> Kept<'a> {
    fn all(&self) -> &[KeptColumns<'a>] {
        match self {
            Self::Own(own) => own,
            Self::Shared(shared) => shared,
        }
    }
}

impl<'a> Regression<'a> {
    /// Regression problem of `model` in the configuration of the datasets.
    pub fn new(
        model: &Model,
        datasets: &'a [Dataset],
        noise: &[Vec<f64>],
        options: &Options<'a>,
    ) -> Result<Self, FitError> {
        let setup = &datasets[0].setup;
        let plant = Plant::new(model, setup);
        let parameters = plant.parameters();
        let regularised = options.prior.map_or_else(|| parameters.clone(), |p| Plant::new(p, setup).parameters());
        let free = parameters.free(options.fixed);
        if free.is_empty() {
            return Err(FitError::NothingToEstimate);
        }
        let own: Vec<PlantParameter> = free.iter().map(|&k| parameters[k].clone()).collect();
        let information = options.prior_information.unwrap_or(PRIOR_INFORMATION);
        let samples = datasets.iter().map(Dataset::len).sum();
        let weights = regularisation::weights(&own, information, options.weights, samples)?;
        // The prior may be another model; parameters are matched by name.
        let known = |k: usize| regularised.named(&parameters[k].name).map_or(&parameters[k], |i| &regularised[i]);
        let sigma = match options.weighing {
            Weighing::Noise => noise.to_vec(),
            Weighing::Maximum => largest(datasets, noise),
        };
        let are_of_these = |kept: &&[KeptColumns]| {
            kept.len() == datasets.len()
                && kept.iter().zip(datasets).all(|(k, dataset)| std::ptr::eq(k.dataset, dataset))
        };
        let kept = match options.kept.filter(are_of_these) {
            Some(kept) => Kept::Shared(kept),
            None => Kept::Own(KeptColumns::of(datasets)),
        };
        Ok(Self {
            datasets,
            kept,
            sigma,
            uses: datasets.iter().map(|d| used(d, &(0..d.len()))).collect(),
            white: options.weighing == Weighing::Noise,
            size: DVector::from_iterator(free.len(), free.iter().map(|&k| nominal_size(known(k)))),
            prior: DVector::from_iterator(free.len(), free.iter().map(|&k| known(k).value)),
            parameters: own,
            before: plant,
            free,
            information,
            weights: DVector::from_vec(weights),
            consistency: options.consistency,
            stop: options.stop.unwrap_or(NEVER),
            work: Cell::default(),
        })
    }

    /// Present values of the estimated parameters in `model`.
    pub fn values(&self, model: &Model) -> DVector<f64> {
        let parameters = self.datasets[0].plant(model).parameters();
        DVector::from_iterator(self.free.len(), self.free.iter().map(|&k| parameters[k].value))
    }

    /// Sets the values of the estimated parameters in `model`.
    pub fn set(&self, model: &mut Model, values: &DVector<f64>) {
        let mut all: Vec<f64> = self.datasets[0].plant(model).parameters().values();
        for (i, &k) in self.free.iter().enumerate() {
            all[k] = values[i];
        }
        set_parameters(model, &all);
    }

    /// Normal equations of all samples, linearised at the present parameters of `model`.
    pub fn normal_equations(&self, model: &Model, weight: Weight) -> Result<NormalEquations, FitError> {
        self.count(Work { regressions: 1, ..Work::default() });
        NormalEquations::new(model, self.kept.all(), &self.sigma, &self.free, weight)
    }

    /// Residuals of `model`.
    pub fn residuals(&self, model: &Model) -> Result<Residuals, FitError> {
        self.count(Work { predictions: 1, ..Work::default() });
        Residuals::along(model, self.kept.all())
    }

    /// Adds to the work so far.
    pub fn count(&self, more: Work) {
        let mut work = self.work.get();
        work += more;
        self.work.set(work);
    }

    /// Whether the datasets have no encoder noise. Large residuals then occur only at the few samples around reversals,
    /// where the derivatives are smoothed.
    pub fn is_clean(&self) -> bool {
        self.datasets.iter().all(|t| t.half_width.iter().all(|m| *m == MIN_HALF_WIDTH))
    }

    /// Cost ½Σ w·r²/σ² of weighted residuals plus the cost of the prior.
    pub fn cost(&self, residuals: &Residuals, values: &DVector<f64>, weight: Weight) -> f64 {
        let dataset = |((channels, sigma), uses): ((&Channels, &Vec<f64>), &Vec<f64>)| -> f64 {
            let series = |(c, (r, s)): (usize, (&Vec<f64>, &f64))| {
                r.iter().zip(uses).map(|(x, of)| of * weight(c, x / s) * x * x).sum::<f64>() / (s * s)
            };
            channels.iter().zip(sigma).enumerate().map(series).sum()
        };
        let data: f64 = residuals.series.iter().zip(&self.sigma).zip(&self.uses).map(dataset).sum();
        0.5 * data + self.prior_cost(values)
    }

    /// Part of the cost due to the prior.
    pub fn prior_cost(&self, values: &DVector<f64>) -> f64 {
        let apart = (values - &self.prior).component_div(&self.size);
        0.5 * apart.component_mul(&apart).dot(&self.weights)
    }

    /// Ratio of the mean cost of a residual to that of the stated noise, at least one.
    pub fn scale(&self, cost: f64) -> f64 {
        let residuals: usize = self.datasets.iter().map(|t| t.len() * t.channels.len()).sum();
        (2.0 * cost / residuals.max(1) as f64).max(1.0)
    }

    /// Robust standard deviation of each channel over all datasets, in units of its sigma.
    pub fn scatter(&self, residuals: &Residuals) -> Vec<f64> {
        let channels = self.sigma.iter().map(Vec::len).min().unwrap_or(0);
        let one = |c: usize| {
            let scaled = |(r, s): (&Channels, &Vec<f64>)| r[c].iter().map(|x| (x / s[c]).abs()).collect::<Vec<f64>>();
            let mut magnitude: Vec<f64> = residuals.series.iter().zip(&self.sigma).flat_map(scaled).collect();
            let middle = magnitude.len() / 2;
            (*magnitude.select_nth_unstable_by(middle, f64::total_cmp).1 / 0.6745).max(f64::MIN_POSITIVE)
        };
        (0..channels).map(one).collect()
    }
}

/// Largest measured magnitude of every channel, scaled such that the mean weight of a row is that of the noise.
fn largest(datasets: &[Dataset], noise: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let one = |(dataset, sigma): (&Dataset, &Vec<f64>)| {
        let peak = |m: &Series| m.iter().fold(f64::MIN_POSITIVE, |a, b| a.max(b.abs()));
        let peaks: Vec<f64> = dataset.measured.iter().map(peak).collect();
        let ratio: f64 = sigma.iter().zip(&peaks).map(|(s, p)| (s / p).powi(2)).sum::<f64>() / peaks.len() as f64;
        peaks.into_iter().map(|p| p * ratio.sqrt()).collect()
    };
    datasets.iter().zip(noise).map(one).collect()
}

/// Own size of a parameter for scaling: the magnitude of its value, or its usual magnitude where that is larger.
pub fn nominal_size(p: &PlantParameter) -> f64 {
    p.value.abs().max(p.usual).max(1e-9)
}
