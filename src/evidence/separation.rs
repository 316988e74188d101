//! Separability of two effects by measured or planned data.
//!
//! T-optimality with the nuisance parameters profiled out [Atkinson 1975]. With Z̃ c the whitened
//! contribution of effect a at its size c, and R̃ the columns that may imitate it (the parameters of the model and of
//! its rival k), δ²_{a|k} = cᵀ Z̃ᵀ (I − P_R̃) Z̃ c. Only inner products of columns are needed, which add up over
//! recordings.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};

use super::compare::LEVEL;
use super::gram::{Pass, cut};
use super::project::{Projected, SPAN_TOLERANCE, pseudo_inverse};
use super::special::{f_quantile, noncentral_f_tail, t_quantile};
use super::whiten::ArFilter;

/// Number of blocks that are summed in parallel.
const PIECES: usize = 8;

/// Inner products of whitened columns, each stacked over the channels of `filters`; each segment loses as many
/// samples at its start as the filters' largest order.
pub fn information(
    columns: &[&[f64]],
    samples: usize,
    segments: &[Range<usize>],
    filters: &[ArFilter],
) -> DMatrix<f64> {
    let width = columns.len();
    let skip = filters.iter().map(ArFilter::order).max().unwrap_or(0);
    let pass = Pass { columns: columns.to_vec(), left: width, groups: Vec::new() };
    let grams = pass.run(filters, samples, &cut(segments, skip, PIECES));
    grams.iter().fold(DMatrix::zeros(width, width), |sum, g| sum + &g.cross)
}

/// Non-centrality δ² of the contribution Σ cᵢ·column `own[i]` outside the span of the columns `imitators`.
pub fn noncentrality(information: &DMatrix<f64>, own: &[usize], c: &DVector<f64>, imitators: &[usize]) -> f64 {
    what_is_left(information, own, c, imitators).0
}

/// δ² as [`noncentrality`], with the combination w of all columns that remains of the contribution: δ² =
/// wᵀ·information·w. As w minimises δ², w wᵀ is the derivative of δ² with respect to the information.
pub fn what_is_left(
    information: &DMatrix<f64>,
    own: &[usize],
    c: &DVector<f64>,
    imitators: &[usize],
) -> (f64, DVector<f64>) {
    let pick = |rows: &[usize], columns: &[usize]| information.select_rows(rows).select_columns(columns);
    let gram = pick(own, own);
    let whole = c.dot(&(&gram * c));
    let (inverse, _) = pseudo_inverse(&pick(imitators, imitators));
    let projected = Projected::new(&inverse, &pick(imitators, own), &gram);
    let left = projected.energy(c);
    let imitation = &projected.imitation * c;
    let mut w = DVector::zeros(information.nrows());
    imitators.iter().zip(&imitation).for_each(|(&i, x)| w[i] = -x);
    own.iter().zip(c).for_each(|(&i, c)| w[i] = *c);
    // Smaller values are rounding errors.
    (if left > SPAN_TOLERANCE * whole { left } else { 0.0 }, w)
}

/// Probability that the confidence set excludes the wrong one of two effects, given the right one's δ² against it.
///
/// The difference of the two fits' losses has the mean δ² and the standard deviation 2δ, so its t is about δ/2:
/// P(F'(1, B − 1; δ²/4) > F_crit) with B blocks at the level of the confidence set. Zero for effects that agree to
/// rounding (δ² = 0).
pub fn chance(noncentrality: f64, blocks: usize) -> f64 {
    if noncentrality <= 0.0 {
        return 0.0;
    }
    let freedom = blocks.saturating_sub(1).max(1) as f64;
    noncentral_f_tail(t_quantile(LEVEL, freedom).powi(2), 1, freedom, 0.25 * noncentrality)
}

/// Power of the test of an effect with m parameters and this δ² against the base at the level `alpha`: P(F'(m, B − m;
/// δ²) > F_crit).
pub fn chance_to_see(noncentrality: f64, m: usize, blocks: usize, alpha: f64) -> f64 {
    let (m, freedom) = (m.max(1), blocks.saturating_sub(m).max(1) as f64);
    match noncentrality > 0.0 {
        true => noncentral_f_tail(f_quantile(1.0 - alpha, m as f64, freedom), m, freedom, noncentrality),
        false => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    /// Columns with known angles: δ² belongs to the part of a orthogonal to base and rival.
    #[test]
    fn noncentrality_is_what_nothing_imitates() {
        let n = 400;
        let wave =
            |k: f64| -> Vec<f64> { (0..n).map(|i| (k * std::f64::consts::TAU * i as f64 / n as f64).sin()).collect() };
        let (x, y, z) = (wave(1.0), wave(2.0), wave(3.0));
        let sum = |a: &[f64], b: &[f64], f: f64| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| a + f * b).collect() };
        let (a, k) = (sum(&sum(&x, &y, 2.0), &z, 0.5), sum(&y, &x, 3.0));
        let g = information(&[&x, &a, &k], n, &[0..150, 150..n], &[ArFilter::scale(0.1)]);
        let c = DVector::from_element(1, 3.0);
        // Each wave has the energy n/2; the filter divides by 0.1².
        assert_relative_eq!(noncentrality(&g, &[1], &c, &[0]), 9.0 * 4.25 * 200.0 * 100.0, max_relative = 1e-9);
        assert_relative_eq!(noncentrality(&g, &[1], &c, &[0, 2]), 9.0 * 0.25 * 200.0 * 100.0, max_relative = 1e-9);
        assert_eq!(noncentrality(&g, &[2], &c, &[0, 1, 2]), 0.0);
    }

    /// Under the null the one-sided test rejects in one of twenty cases per side.
    #[test]
    fn chance_begins_at_its_level_and_grows_to_one() {
        assert_eq!(chance(0.0, 50), 0.0);
        assert_relative_eq!(chance(1e-9, 50), 0.1, epsilon = 1e-6);
        let values: Vec<f64> = (1..80).map(|i| chance(f64::from(i), 50)).collect();
        assert!(values.windows(2).all(|w| w[0] < w[1]) && values[78] > 0.99);
        // t = δ/2 = 1.677 is the critical value itself: half of the cases.
        assert!((chance(4.0 * 1.677_f64.powi(2), 50) - 0.5).abs() < 0.02);
        assert_eq!(chance(1e9, 50), 1.0);
    }
}
