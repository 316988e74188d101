//! What normal equations say about the parameters: step, covariance, and which directions they determine.
//!
//! All matrices here are in units of the parameters' own sizes, so that numbers of kg and of N·m compare.

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use statrs::distribution::{ContinuousCDF, StudentsT};

use super::normal_equations::{Block, NormalEquations};

/// Information (1/variance, parameters in units of their own size) that everyday knowledge has: the weight that keeps
/// parameters near their prior where data are silent. A parameter the data determine to 10 % feels it by 1e-4 of its error.
pub const PRIOR_INFORMATION: f64 = 1e-2;

/// Stretches of a recording: as many as leave each long against the memory of noise.
const STRETCHES: usize = 30;

/// Normal equations in units of the parameters' own sizes, with the prior.
pub struct Estimator {
    size: DVector<f64>,
    /// YᵀWY.
    data: DMatrix<f64>,
    /// Prior information of each parameter.
    prior: DVector<f64>,
    inverse: DMatrix<f64>,
}

impl Estimator {
    /// Estimator with a prior of information `prior`, per own size squared, of each parameter; `None` if the numbers ran away.
    pub fn new(normal: &NormalEquations, size: &DVector<f64>, prior: &DVector<f64>) -> Option<Self> {
        let n = size.len();
        let data = DMatrix::from_fn(n, n, |i, j| normal.information[(i, j)] * size[i] * size[j]);
        let inverse = (&data + DMatrix::from_diagonal(prior)).cholesky()?.inverse();
        let finite = inverse.iter().all(|x| x.is_finite());
        finite.then(|| Self { size: size.clone(), data, prior: prior.clone(), inverse })
    }

    /// Gauss–Newton step from parameters that lie `offset` from their prior; those in `fixed` do not move.
    pub fn step(&self, normal: &NormalEquations, offset: &DVector<f64>, fixed: &[usize]) -> DVector<f64> {
        let pull = offset.component_div(&self.size).component_mul(&self.prior);
        let gradient = normal.score.component_mul(&self.size) - pull;
        let mut step = &self.inverse * gradient;
        // The step of least cost among those that leave the fixed ones where they are: s − P_h·P_hh⁻¹·s_h, P the inverse.
        let own = DMatrix::from_fn(fixed.len(), fixed.len(), |i, j| self.inverse[(fixed[i], fixed[j])]);
        let back = DVector::from_fn(fixed.len(), |i, _| step[fixed[i]]);
        if let Some(factor) = own.cholesky() {
            for (share, &h) in factor.solve(&back).iter().zip(fixed) {
                step -= self.inverse.column(h) * *share;
            }
        }
        step.component_mul(&self.size)
    }

    /// Curvature YᵀWY + prior of the cost, in natural units.
    pub fn curvature(&self) -> DMatrix<f64> {
        let n = self.size.len();
        DMatrix::from_fn(n, n, |i, j| {
            let prior = if i == j { self.prior[i] } else { 0.0 };
            (self.data[(i, j)] + prior) / (self.size[i] * self.size[j])
        })
    }

    /// Covariance of the estimate from the scatter of the scores over stretches of time, which stays right when residuals are
    /// autocorrelated, correlated across channels or of uneven size: H⁻¹ (Σ s̃ s̃ᵀ) H⁻¹. Stretches overlap and are a thirtieth
    /// of a recording, long against the memory of noise; every score is freed of its stretch's own pull on the estimate,
    /// s̃ = (1 − H_s H⁻¹)^(−1/2) s [CR2; Bell & McCaffrey 2002]. The tests of [`crate::evidence`] take scores of blocks that lie
    /// apart, without this correction.
    ///
    /// The prior's own uncertainty is part of it. With `white`, no variance is smaller than independent residuals of the
    /// stated size would give.
    pub fn covariance(&self, normal: &NormalEquations, white: bool) -> DMatrix<f64> {
        let n = self.size.len();
        let Some(root) = self.inverse.clone().cholesky() else { return DMatrix::zeros(n, n) };
        // H⁻¹ = L·Lᵀ: in the coordinates Lᵀ(…)L the curvature is the unit matrix.
        let l = root.l();
        let runs: Vec<Vec<(DMatrix<f64>, DVector<f64>)>> =
            normal.blocks.iter().map(|run| run.iter().map(|b| self.whitened(b, &l)).collect()).collect();
        let mut meat = l.tr_mul(&(DMatrix::from_diagonal(&self.prior) * &l));
        for run in &runs {
            let length = run.len().div_ceil(STRETCHES);
            // Every block counts as often as every other, also at the ends.
            for start in 0..run.len() {
                let members = (start..start + length).map(|b| &run[b % run.len()]);
                let (mut h, mut s) = (DMatrix::zeros(n, n), DVector::zeros(n));
                for (own, score) in members {
                    h += own;
                    s += score;
                }
                let s = freed(h, &s);
                meat.ger(1.0 / length as f64, &s, &s, 1.0);
            }
        }
        // Few stretches make the scatter itself uncertain: wider by Student's t, so that ±1.96 is a 95 % interval.
        let stretches = runs.iter().map(|run| run.len().div_ceil(run.len().div_ceil(STRETCHES).max(1))).sum::<usize>();
        let robust = &l * meat * l.transpose() * widening(stretches).powi(2);
        DMatrix::from_fn(n, n, |i, j| {
            let inflate = |i: usize| {
                let floor = if white { self.inverse[(i, i)] } else { 0.0 };
                if robust[(i, i)] > 0.0 { (floor / robust[(i, i)]).sqrt().max(1.0) } else { 1.0 }
            };
            robust[(i, j)] * inflate(i) * inflate(j) * self.size[i] * self.size[j]
        })
    }

    fn whitened(&self, block: &Block, l: &DMatrix<f64>) -> (DMatrix<f64>, DVector<f64>) {
        let n = self.size.len();
        let h = DMatrix::from_fn(n, n, |i, j| block.information[(i, j)] * self.size[i] * self.size[j]);
        (l.tr_mul(&(h * l)), l.tr_mul(&block.score.component_mul(&self.size)))
    }
}

/// Ratio of the 95 % quantiles of Student's t, for a scatter over so many stretches, and of the normal distribution.
fn widening(stretches: usize) -> f64 {
    let freedom = stretches.saturating_sub(1).max(2) as f64;
    let t = StudentsT::new(0.0, 1.0, freedom).expect("positive degrees of freedom").inverse_cdf(0.975);
    t / 1.959_963_984_540_054
}

/// (1 − M)^(−1/2)·s for symmetric M with eigenvalues from 0 to 1.
fn freed(m: DMatrix<f64>, s: &DVector<f64>) -> DVector<f64> {
    /// A block that alone determines a direction has no scatter there.
    const LARGEST: f64 = 0.99;
    let eigen = SymmetricEigen::new(m);
    let mut along = eigen.eigenvectors.tr_mul(s);
    for (x, lambda) in along.iter_mut().zip(&eigen.eigenvalues) {
        *x /= (1.0 - lambda.clamp(0.0, LARGEST)).sqrt();
    }
    eigen.eigenvectors * along
}
