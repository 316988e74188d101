//! Block scores of a variant and the statistics made of them.

use nalgebra::{Cholesky, DMatrix, DVector};

use super::gram::BlockGram;
use super::project::Projected;
use super::special::f_tail;

/// The residual of the base fit, block by block.
pub struct Remainder {
    /// Base coefficients of the residual series (p).
    pub base: DVector<f64>,
    /// Products of base columns and residual per block (p × B).
    pub base_scores: DMatrix<f64>,
    /// Residual energy.
    pub energy: f64,
    /// Rank of the base.
    pub rank: usize,
    /// Whitened rows.
    pub rows: usize,
}

impl Remainder {
    /// Fit the base to the series that is the last left column.
    pub fn new(grams: &[BlockGram], inverse: &DMatrix<f64>, rank: usize, rows: usize) -> Self {
        let p = inverse.nrows();
        let total = grams.iter().fold(DVector::zeros(p), |s, g| s + g.cross.view((0, p), (p, 1)));
        let base: DVector<f64> = inverse * &total;
        let mut base_scores = DMatrix::zeros(p, grams.len());
        for (b, g) in grams.iter().enumerate() {
            base_scores.set_column(b, &(g.cross.view((0, p), (p, 1)) - g.cross.view((0, 0), (p, p)) * &base));
        }
        let energy = grams.iter().map(|g| g.cross[(p, p)]).sum::<f64>() - total.dot(&base);
        Self { base, base_scores, energy: energy.max(0.0), rank, rows }
    }

    /// Degrees of freedom left.
    pub fn freedom(&self) -> f64 {
        self.rows.saturating_sub(self.rank) as f64
    }
}

/// Scores of one variant in orthonormal coordinates (rank × B).
#[derive(Clone, Debug)]
pub struct Scores {
    /// `Σ_{t∈b} z⊥ r` per block.
    pub blocks: DMatrix<f64>,
    /// Their sum: the least-squares coefficients in orthonormal coordinates.
    pub sum: DVector<f64>,
    /// Block scores scaled by the inverse root of `Σ g gᵀ`, so that T = ‖Σ w_b h_b‖² under signs w.
    pub standard: DMatrix<f64>,
    /// Score statistic, between zero and the number of blocks.
    pub statistic: f64,
    /// Its marginal p.
    pub p: f64,
}

impl Scores {
    /// Scores of the columns `at..at + m` of the pass.
    pub fn new(grams: &[BlockGram], at: usize, projected: &Projected, rest: &Remainder) -> Self {
        let (p, m, count) = (rest.base.len(), projected.basis.nrows(), grams.len());
        let mut blocks = DMatrix::zeros(projected.rank(), count);
        for (b, g) in grams.iter().enumerate() {
            let raw = g.cross.view((p, at), (1, m)).transpose()
                - g.cross.view((0, at), (p, m)).transpose() * &rest.base
                - projected.imitation.transpose() * rest.base_scores.column(b);
            blocks.set_column(b, &(projected.basis.transpose() * raw));
        }
        Self::of(blocks)
    }

    /// The statistics of block scores (rank × B).
    pub fn of(blocks: DMatrix<f64>) -> Self {
        let count = blocks.ncols();
        let sum = blocks.column_sum();
        // With many columns per block T tends to B whatever the data: only the strongest directions are tested then.
        let tested = blocks.nrows().min(count / 4);
        let standard = standardise(blocks.rows(0, tested).into_owned());
        let statistic = standard.column_sum().norm_squared().min(count as f64);
        let p = tail(statistic, standard.nrows(), count);
        Self { blocks, sum, standard, statistic, p }
    }
}

/// Marginal p of the score statistic T on m degrees of freedom from `count` blocks.
pub fn tail(t: f64, m: usize, count: usize) -> f64 {
    if m == 0 || m >= count || t.is_nan() {
        return 1.0;
    }
    let (m, b) = (m as f64, count as f64);
    f_tail((b - m) / m * t / (b - t).max(1e-12 * b), m, b - m)
}

/// `L⁻¹ g` with `L Lᵀ = Σ g gᵀ`; no rows when that matrix is singular.
fn standardise(scores: DMatrix<f64>) -> DMatrix<f64> {
    let none = DMatrix::zeros(0, scores.ncols());
    let spread = &scores * scores.transpose();
    let largest = spread.diagonal().iter().fold(0.0_f64, |a, &b| a.max(b));
    let usable = largest > 0.0 && spread.iter().all(|x| x.is_finite());
    let Some(root) = usable.then(|| Cholesky::new(spread)).flatten() else {
        return none;
    };
    root.l_dirty().solve_lower_triangular(&scores).unwrap_or(none)
}

/// Gram matrices of the projected columns per block, in orthonormal coordinates.
pub fn block_grams(grams: &[BlockGram], group: usize, at: usize, projected: &Projected) -> Vec<DMatrix<f64>> {
    let (p, m) = projected.imitation.shape();
    let one = |g: &BlockGram| {
        let cross = g.cross.view((0, at), (p, m)).transpose() * &projected.imitation;
        let base = projected.imitation.transpose() * g.cross.view((0, 0), (p, p)) * &projected.imitation;
        projected.basis.transpose() * (&g.own[group] - &cross - cross.transpose() + base) * &projected.basis
    };
    grams.iter().map(one).collect()
}

/// Wald p, times the number of variants tried, below which an effect is beyond doubt.
const OBVIOUS: f64 = 1e-6;

/// Whether an effect is beyond doubt, among `tried` variants.
pub fn obvious(scores: &Scores, grams: &[DMatrix<f64>], tried: usize) -> bool {
    wald(scores, grams) * (tried as f64) < OBVIOUS
}

/// Marginal p of the Wald statistic of the full fit, with the covariance of [`sandwich`].
///
/// The score statistic cannot exceed the number of blocks: an effect that dwarfs the noise spreads its own block scores
/// and hides behind them. The full fit's residual does not hold the effect, so its Wald statistic keeps growing. It is
/// too liberal near the usual levels and only trusted far beyond them.
fn wald(scores: &Scores, grams: &[DMatrix<f64>]) -> f64 {
    let (m, count) = scores.blocks.shape();
    if m == 0 || m > count / 4 {
        return 1.0;
    }
    let Some(root) = Cholesky::new(sandwich(scores, grams)) else { return 1.0 };
    let statistic = scores.sum.dot(&root.solve(&scores.sum));
    let (m, b) = (m as f64, count as f64);
    if statistic.is_finite() { f_tail((b - m) / (b * m) * statistic, m, b - m) } else { 1.0 }
}

/// Covariance of the coefficients that holds under autocorrelation within blocks and uneven noise: `Σ s_b s_bᵀ` of the
/// scores of the full fit, as the columns are orthonormal; blocks lie apart, and a factor for few blocks takes the place of
/// the correction of every score that a fit makes.
pub fn sandwich(scores: &Scores, grams: &[DMatrix<f64>]) -> DMatrix<f64> {
    let (m, count) = scores.blocks.shape();
    let mut sum = DMatrix::zeros(m, m);
    for (b, g) in grams.iter().enumerate() {
        let s = scores.blocks.column(b) - g * &scores.sum;
        sum += &s * s.transpose();
    }
    sum * (count as f64 / count.saturating_sub(m).max(1) as f64)
}
