//! Which candidates the data cannot tell from the best one: pairwise tests of block losses (Hansen, Lunde & Nason; Vuong).

use nalgebra::{DMatrix, DVector};

use super::score::Scores;
use super::special::t_quantile;

/// Effects that overlap more than this cannot be told apart by any noise-free look at these motions either.
pub const SAME: f64 = 0.999;

/// Level of the pairwise tests.
const LEVEL: f64 = 0.95;

/// Block losses of adding a candidate, relative to adding nothing: `−2 cᵀ g_b + cᵀ S_b c`.
pub fn losses(scores: &Scores, grams: &[DMatrix<f64>]) -> DVector<f64> {
    let c = &scores.sum;
    DVector::from_iterator(
        grams.len(),
        grams.iter().enumerate().map(|(b, s)| c.dot(&(s * c)) - 2.0 * c.dot(&scores.blocks.column(b))),
    )
}

/// t statistic of `rival − best` block losses with a complexity term for `extra` more parameters on `rows` rows.
pub fn t_statistic(best: &DVector<f64>, rival: &DVector<f64>, extra: f64, rows: usize) -> f64 {
    let b = best.len() as f64;
    let d = (rival - best).add_scalar(extra * (rows.max(1) as f64).ln() / b);
    let mean = d.mean();
    let error = (d.map(|x| (x - mean).powi(2)).sum() / (b - 1.0).max(1.0) / b).sqrt();
    match error > 1e-12 * mean.abs() {
        true => mean / error,
        false if mean.abs() <= f64::MIN_POSITIVE => 0.0,
        false => mean.signum() * f64::INFINITY,
    }
}

/// Largest t at which a rival stays in the confidence set.
pub fn critical(blocks: usize) -> f64 {
    t_quantile(LEVEL, blocks.saturating_sub(1).max(1) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_losses_are_equal() {
        let a = DVector::from_fn(20, |i, _| (i as f64).sin());
        assert_eq!(t_statistic(&a, &a, 0.0, 1000), 0.0);
        assert!(t_statistic(&a, &a.add_scalar(1.0), 0.0, 1000) > critical(20));
        assert!(t_statistic(&a, &a, 1.0, 1000) > 0.0);
    }
}
