//! Assessment of one candidate.

use nalgebra::{DMatrix, DVector};

use super::base_fit::BaseFit;
use super::predict::Contribution;
use super::problem::{Column, Problem, Settings, Variant};
use super::project::Projected;
use super::ranking::{Absorption, Assessment, Estimate, Visibility};
use super::score::{Remainder, Scores, sandwich};
use super::special::{ln_chi2_tail, noncentrality};

/// Power at which an effect counts as visible.
const POWER: f64 = 0.95;

/// One variant of one candidate.
pub struct Entry<'a> {
    pub candidate: usize,
    pub index: usize,
    pub variant: &'a Variant,
    pub at: usize,
    pub group: usize,
    pub projected: Projected,
    pub scores: Scores,
}

/// Additional degree of freedom for a shape parameter that was searched over a grid: one or zero.
pub fn searched(problem: &Problem, candidate: usize) -> f64 {
    f64::from(u8::from(problem.candidates[candidate].variants.len() > 1))
}

pub fn f_of(entry: &Entry<'_>, rest: &Remainder) -> f64 {
    let m = entry.projected.rank() as f64;
    let explained = entry.scores.sum.norm_squared();
    let left = (rest.energy - explained).max(0.0) / (rest.freedom() - m).max(1.0);
    match explained > 0.0 && m > 0.0 {
        true => explained / m / left,
        false => 0.0,
    }
}

/// Natural logarithm of the χ² tail of rank × F, with one degree of freedom more for a searched shape parameter.
pub fn ln_p_of(entry: &Entry<'_>, problem: &Problem, rest: &Remainder) -> f64 {
    let rank = entry.projected.rank() as f64;
    if rank > 0.0 { ln_chi2_tail(rank * f_of(entry, rest), rank + searched(problem, entry.candidate)) } else { 0.0 }
}

pub fn contribution<'b>(entry: &Entry<'b>) -> Contribution<'b> {
    let coefficients = &entry.projected.basis * &entry.scores.sum;
    let imitation = &entry.projected.imitation * &coefficients;
    Contribution {
        columns: entry.variant.columns.iter().map(|c| &*c.values).collect(),
        coefficients: coefficients.as_slice().to_vec(),
        imitation: imitation.as_slice().to_vec(),
    }
}

fn estimates(entry: &Entry<'_>, blockwise: &[DMatrix<f64>]) -> Vec<Estimate> {
    let basis = &entry.projected.basis;
    let covariance = basis * sandwich(&entry.scores, blockwise) * basis.transpose();
    let value = basis * &entry.scores.sum;
    let one = |(i, c): (usize, &Column)| Estimate {
        name: c.name.clone(),
        value: value[i],
        standard_error: covariance[(i, i)].max(0.0).sqrt(),
    };
    entry.variant.columns.iter().enumerate().map(one).collect()
}

pub fn base_estimates(fit: &BaseFit<'_>, inverse: &DMatrix<f64>, rest: &Remainder) -> Vec<Estimate> {
    let spread = inverse * &rest.base_scores;
    let one = |(i, c): (usize, &&Column)| Estimate {
        name: c.name.clone(),
        value: fit.theta[i],
        standard_error: spread.row(i).norm(),
    };
    fit.columns.iter().enumerate().map(one).collect()
}

/// Score statistic and p values of a candidate over its variants.
pub struct Chance {
    /// Score statistic of the variant with the smallest p.
    pub score: f64,
    pub p_marginal: f64,
    pub p_adjusted: f64,
}

/// Change of each channel's residual by the fit of a candidate.
pub struct Gain {
    pub sum_of_squares: Vec<f64>,
    pub relevance: Vec<f64>,
    pub explained_share: Option<f64>,
}

/// Assessment of a candidate by its best variant, before the comparison with the winner.
pub fn describe(
    entry: &Entry<'_>,
    problem: &Problem,
    (fit, rest): (&BaseFit<'_>, &Remainder),
    blockwise: &[DMatrix<f64>],
    (chance, gain): (Chance, Gain),
    settings: &Settings,
) -> Assessment {
    let candidate = &problem.candidates[entry.candidate];
    let projected = &entry.projected;
    let known = |c: &Column| c.magnitude != 0.0 && c.magnitude.is_finite();
    let sized = !entry.variant.columns.is_empty() && entry.variant.columns.iter().all(known);
    let smallest = entry.variant.columns.iter().map(|c| if sized { c.magnitude } else { 1.0 });
    let smallest = DVector::from_iterator(entry.variant.columns.len(), smallest);
    let energy = projected.energy(&smallest);
    let visibility = match (projected.empty, projected.rank()) {
        (true, _) => Visibility::Empty,
        (_, 0) => Visibility::InBaseSpan,
        _ if fit.too_few.is_some() => Visibility::TooFewRows,
        (_, m) if sized && energy < noncentrality(m, settings.alpha, POWER) => Visibility::TooWeak,
        _ => Visibility::Visible,
    };
    let change = &projected.imitation * &smallest;
    let mut absorbed_by: Vec<Absorption> = fit
        .columns
        .iter()
        .zip(change.iter())
        .map(|(c, &change)| Absorption {
            parameter: c.name.clone(),
            change,
            percent: known(c).then(|| 100.0 * change / c.magnitude.abs()),
        })
        .collect();
    let weight = |a: &Absorption| a.percent.unwrap_or(0.0).abs();
    absorbed_by.sort_by(|a, b| weight(b).total_cmp(&weight(a)).then(b.change.abs().total_cmp(&a.change.abs())));
    absorbed_by.truncate(5);
    let rank = projected.rank();
    Assessment {
        candidate: entry.candidate,
        name: candidate.name.clone(),
        variant: entry.index,
        label: entry.variant.label.clone(),
        visibility,
        tolerance: projected.tolerance,
        noncentrality: sized.then_some(energy),
        absorbed_by,
        rank,
        f_statistic: f_of(entry, rest),
        ln_p: ln_p_of(entry, problem, rest),
        score: chance.score,
        p_marginal: chance.p_marginal,
        p_adjusted: chance.p_adjusted,
        relevance: gain.relevance,
        explained_share: gain.explained_share,
        coefficients: estimates(entry, blockwise),
        base_change: contribution(entry).imitation.iter().map(|x| -x).collect(),
        sum_of_squares: gain.sum_of_squares,
        t_against_best: 0.0,
        overlap: 0.0,
        indistinguishable: false,
    }
}
