//! Noise that wanders: a bias which walks at random, slower than anything the robot does.
//!
//! An autoregression of a few lags does not see it, and blocks of time are not independent under it: a constant that is
//! none would be found in every drifting channel. In a segment of n samples with the orthonormal cosines φ_k, k = 0, 1, …, a
//! random walk has coefficients of variance λ/k² beside the noise, and about λ·π²/3 at k = 0 if it began at zero. λ is
//! found from the residual's slowest cosines, per channel; then x − Σ_k (1 − 1/√(1 + λ_k))·φ_k·(φ_k·x) has white noise there.

use std::borrow::Cow;
use std::ops::Range;

use super::Error;
use super::base_fit::BaseFit;
use super::gram::dot;
use super::problem::{Candidate, Chosen, Column, Problem, Settings, Variant};

/// Cosines, without the constant, that λ is found from; at 0.05 Hz and 20 s they are slower than motions.
const COSINES: usize = 5;
/// A few coefficients may understate λ: it is taken so many times as large.
const CAUTION: f64 = 2.0;
/// Largest λ; beyond, a cosine counts for nothing anyway.
const LARGEST: f64 = 1e8;
/// λ below which there is no drift.
const NONE: f64 = 1e-2;

/// `problem` with the drift of its noise whitened, as the residual of its base and the effects `chosen` shows it.
pub fn whitened<'a>(problem: &'a Problem, chosen: &[Chosen], settings: &Settings) -> Result<Cow<'a, Problem>, Error> {
    let fit = BaseFit::new(problem, chosen, settings)?;
    let n = problem.samples;
    let lambda: Vec<f64> = fit
        .filters
        .iter()
        .enumerate()
        .map(|(c, filter)| {
            // The filter's gain at rest: noise of the slow cosines.
            let slow = filter.sigma / (1.0 - filter.coefficients.iter().sum::<f64>()).abs().max(1e-6);
            let series = &fit.residual[c * n..(c + 1) * n];
            let scaled = |s: &Range<usize>| -> Vec<f64> {
                (1..=COSINES).map(|k| dot(&cosine(s.len(), k), &series[s.clone()]) / slow).collect()
            };
            let segments = problem.segments.iter().filter(|s| s.len() > 4 * COSINES);
            CAUTION * walk(&segments.map(scaled).collect::<Vec<_>>())
        })
        .collect();
    if lambda.iter().all(|l| *l < NONE) {
        return Ok(Cow::Borrowed(problem));
    }
    let series = |x: &[f64]| whiten(x, &lambda, &problem.segments, n);
    let column = |c: &Column| Column { values: series(&c.values), ..c.clone() };
    let variant = |v: &Variant| Variant { columns: v.columns.iter().map(column).collect(), ..v.clone() };
    let candidate = |c: &Candidate| Candidate { variants: c.variants.iter().map(variant).collect(), ..c.clone() };
    Ok(Cow::Owned(Problem {
        y: series(&problem.y),
        base: problem.base.iter().map(column).collect(),
        candidates: problem.candidates.iter().map(candidate).collect(),
        ..problem.clone()
    }))
}

/// The k-th cosine over n samples, of unit length.
fn cosine(n: usize, k: usize) -> Vec<f64> {
    let scale = (if k == 0 { 1.0 } else { 2.0 } / n as f64).sqrt();
    let step = std::f64::consts::PI * k as f64 / n as f64;
    (0..n).map(|t| scale * (step * (t as f64 + 0.5)).cos()).collect()
}

/// Most likely λ for coefficients of unit noise, segment by segment.
fn walk(coefficients: &[Vec<f64>]) -> f64 {
    let squares: Vec<(f64, f64)> = coefficients
        .iter()
        .flat_map(|s| s.iter().enumerate().map(|(i, z)| (((i + 1) as f64).powi(2), z * z)))
        .collect();
    let cost = |lambda: f64| -> f64 {
        let variance = |k2: f64| 1.0 + lambda / k2;
        squares.iter().map(|(k2, z2)| variance(*k2).ln() + z2 / variance(*k2)).sum()
    };
    let grid = (0..=100).map(|i| NONE * (LARGEST / NONE).powf(f64::from(i) / 100.0));
    std::iter::once(0.0).chain(grid).min_by(|a, b| cost(*a).total_cmp(&cost(*b))).unwrap_or(0.0)
}

fn whiten(x: &[f64], lambda: &[f64], segments: &[Range<usize>], n: usize) -> Vec<f64> {
    let mut out = x.to_vec();
    for (c, lambda) in lambda.iter().enumerate().filter(|(_, l)| **l >= NONE) {
        for s in segments {
            let part = &mut out[c * n + s.start..c * n + s.end];
            for k in 0..=COSINES {
                let variance =
                    if k == 0 { lambda * std::f64::consts::PI.powi(2) / 3.0 } else { lambda / (k * k) as f64 };
                let phi = cosine(s.len(), k);
                let change = (1.0 - (1.0 + variance).sqrt().recip()) * dot(&phi, part);
                part.iter_mut().zip(&phi).for_each(|(x, p)| *x -= change * p);
            }
        }
    }
    out
}
