//! Whether recordings demand parameters of their own for every limb.

use std::collections::BTreeMap;

use nalgebra::DVector;

use super::fit::Options;
use super::{BaseParameter, Dataset, Fit, FitError, NoiseLevel, Residuals, check_together, fit_with};
use crate::effects::rigid_bodies;
use crate::evidence::{t_quantile, t_statistic};
use crate::machine::{Configuration, LinkParameters, Unit};
use crate::model::Model;

/// Blocks of time over which the squared errors are compared.
const BLOCKS: usize = 32;
/// One-sided confidence required of the difference of the errors.
const LEVEL: f64 = 0.999;
/// Share of the squared error by which limbs with their own parameters must be better.
const WORTH: f64 = 0.01;
/// Standard errors by which a parameter of one limb must differ from the mean of all to be named.
const APART: f64 = 3.0;

/// Comparison of equal limbs with limbs that have their own parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct LimbTest {
    /// Whether the data demand limbs with their own parameters.
    pub demanded: bool,
    /// Squared error, in units of the noise, with own parameters over that with common ones, on held-out data where given.
    pub error: f64,
    /// Student's t of the difference of the errors over blocks of time; positive if own parameters are better.
    pub t: f64,
    /// Whether held-out data judged.
    pub held_out: bool,
    /// Base parameters of the links that differ among the limbs by more than three standard errors; none if not demanded.
    pub differing: Vec<Differing>,
}

/// A base parameter whose value differs among the limbs.
#[derive(Clone, Debug, PartialEq)]
pub struct Differing {
    /// Printed name without the limb's number, and what it is determined together with.
    pub name: String,
    /// Unit.
    pub unit: Unit,
    /// Value of every limb.
    pub values: Vec<f64>,
}

/// Tests whether the limbs of an assembled robot are alike; `None` for other machines.
///
/// `fitted` is a fit of `model` with `options`, with limbs alike or with their own parameters; the other one is fitted
/// here. The data demand own parameters if the squared error on `held_out` (else on `datasets`) falls by more than 1 %,
/// and the fall is significant at 0.1 % over blocks of time, whose residuals need not be independent within a block.
/// `noise[channel]` are the standard deviations of the channels.
///
/// # Errors
/// As [`fit_with`], also if held-out recordings differ in configuration or channels.
pub fn limb_test(
    fitted: &Fit,
    model: &Model,
    (datasets, held_out): (&[Dataset], &[Dataset]),
    noise: &NoiseLevel,
    options: &Options,
) -> Result<Option<LimbTest>, FitError> {
    let is_whole = datasets.iter().all(|d| d.setup.configuration == Configuration::Assembled);
    if !is_whole || !model.assembled {
        return Ok(None);
    }
    check_together(datasets.iter().chain(held_out))?;
    let links = model.link_parameters;
    let other = Model { link_parameters: LinkParameters { each_limb: !links.each_limb, ..links }, ..model.clone() };
    let other = fit_with(&other, datasets, &noise.of_each, options)?;
    let (own, alike) = if links.each_limb { (fitted, &other) } else { (&other, fitted) };
    let losses = |fit: &Fit| -> Result<DVector<f64>, FitError> {
        if held_out.is_empty() {
            Ok(blockwise(&fit.residuals, noise))
        } else {
            Ok(blockwise(&Residuals::new(&fit.model, held_out)?, &NoiseLevel::of(model, held_out)))
        }
    };
    let (of_own, of_alike) = (losses(own)?, losses(alike)?);
    // On the fitted data, more parameters are better by their number in any case.
    let extra = if held_out.is_empty() { alike.structure.rank as f64 - own.structure.rank as f64 } else { 0.0 };
    let (error, t) = (of_own.sum() / of_alike.sum(), t_statistic(&of_own, &of_alike, extra));
    let demanded = error < 1.0 - WORTH && t > t_quantile(LEVEL, (BLOCKS - 1) as f64);
    let differing = if demanded { differing(own) } else { Vec::new() };
    Ok(Some(LimbTest { demanded, error, t, held_out: !held_out.is_empty(), differing }))
}

/// Squared residuals in units of each recording's noise, summed over [`BLOCKS`] blocks of time.
fn blockwise(residuals: &Residuals, noise: &NoiseLevel) -> DVector<f64> {
    let mut losses = DVector::zeros(BLOCKS);
    for channel in 0..noise.pooled.len() {
        let mut all = Vec::new();
        for (series, sigma) in residuals.series.iter().zip(&noise.of_each) {
            all.extend(series[channel].iter().map(|r| r / sigma[channel]));
        }
        for (k, r) in all.iter().enumerate() {
            losses[k * BLOCKS / all.len()] += r.powi(2);
        }
    }
    losses
}

/// Base parameters of the links that exist for every limb, as the same combination, and differ among the limbs.
fn differing(own: &Fit) -> Vec<Differing> {
    let mut groups: BTreeMap<&str, Vec<&BaseParameter>> = BTreeMap::new();
    for one in own.base.iter().filter(|one| stem(&one.name) != one.name && one.name.starts_with(rigid_bodies::NAME)) {
        groups.entry(stem(&one.name)).or_default().push(one);
    }
    let limbs = own.model.mechanism.arms();
    let differs = |(stem, all): (&str, Vec<&BaseParameter>)| {
        let alike = |other: &&BaseParameter| combination(all[0]) == combination(other);
        if all.len() != limbs || !all.iter().all(alike) {
            return None;
        }
        let mean = all.iter().map(|one| one.value).sum::<f64>() / limbs as f64;
        let is_apart = |k: usize| (all[k].value - mean).abs() > APART * from_mean(own, &all, k);
        (0..limbs).any(is_apart).then(|| Differing {
            name: std::iter::once(stem.to_string()).chain(combination(all[0])).collect::<Vec<_>>().join(" "),
            unit: all[0].unit,
            values: all.iter().map(|one| one.value).collect(),
        })
    };
    groups.into_iter().filter_map(differs).collect()
}

/// A parameter's name without the number of its limb.
fn stem(name: &str) -> &str {
    name.trim_end_matches(|c: char| c.is_ascii_digit()).trim_end_matches('_')
}

/// The parameters that are determined together with a base parameter, each with its factor to three digits.
fn combination(one: &BaseParameter) -> Vec<String> {
    let mut all: Vec<String> = one.others.iter().map(|(name, k)| format!("{k:+.3}·{}", stem(name))).collect();
    all.sort();
    all
}

/// Standard error of the distance of base parameter number `one` from the mean of `all`.
fn from_mean(own: &Fit, all: &[&BaseParameter], one: usize) -> f64 {
    let mut weights = DVector::zeros(own.parameters.len());
    for (k, base) in all.iter().enumerate() {
        let share = f64::from(u8::from(k == one)) - 1.0 / all.len() as f64;
        let parts = base.others.iter().map(|(name, factor)| (name, *factor)).chain([(&base.name, 1.0)]);
        for (name, factor) in parts {
            if let Some(i) = own.parameters.iter().position(|p| p.name == *name) {
                weights[i] += share * factor;
            }
        }
    }
    weights.dot(&(&own.covariance * &weights)).max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn losses_are_sums_of_squares_in_units_of_the_noise() {
        let residuals = Residuals::from(vec![vec![vec![2.0; 64], vec![3.0; 64]]; 2]);
        // Four of 128 samples in each of 32 blocks: 4·((2/1)² + (3/2)²).
        let noise = NoiseLevel { of_each: vec![vec![1.0, 2.0]; 2], pooled: vec![1.0, 2.0] };
        let losses = blockwise(&residuals, &noise);
        assert_eq!((losses.len(), losses[0], losses[31]), (32, 25.0, 25.0));
    }
}
