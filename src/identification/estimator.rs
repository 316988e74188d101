//! Estimates from normal equations: Gauss–Newton step and robust covariance.
//!
//! All matrices are in units of the parameters' own sizes, so that values in kg and in N·m are comparable.

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use statrs::distribution::{ContinuousCDF, StudentsT};

use super::normal_equations::{Block, NormalEquations};

/// Default prior information (1/variance, parameters in units of their own size), which fixes parameters that the
/// data do not determine. An estimate with a standard error of 10 % of its size is shifted by 1e-4 of its distance
/// from the prior.
pub const PRIOR_INFORMATION: f64 = 1e-2;

/// Number of intervals per recording for the scatter of the scores; each is long relative to the correlation time of
/// the noise.
const STRETCHES: usize = 30;

/// Normal equations with the prior, in units of the parameters' own sizes.
#[derive(Clone)]
pub struct Estimator {
    size: DVector<f64>,
    /// YᵀWY.
    data: DMatrix<f64>,
    /// Prior information of each parameter.
    prior: DVector<f64>,
    inverse: DMatrix<f64>,
}

impl Estimator {
    /// Estimator with the prior information `prior` of each parameter, per own size squared; `None` if a matrix is
    /// not positive definite or not finite.
    pub fn new(normal: &NormalEquations, size: &DVector<f64>, prior: &DVector<f64>) -> Option<Self> {
        let n = size.len();
        let data = DMatrix::from_fn(n, n, |i, j| normal.information[(i, j)] * size[i] * size[j]);
        let inverse = (&data + DMatrix::from_diagonal(prior)).cholesky()?.inverse();
        let finite = inverse.iter().all(|x| x.is_finite());
        finite.then(|| Self { size: size.clone(), data, prior: prior.clone(), inverse })
    }

    /// The estimator with the share `all` of the curvature along each parameter in addition, and along each of `some` parameters
    /// the share `more` of the curvature that is left while those not among them follow; `None` without any, or if the sum is
    /// not positive definite.
    pub fn damped(&self, all: f64, more: f64, some: &[usize]) -> Option<Self> {
        if all == 0.0 && more == 0.0 {
            return None;
        }
        let mut added = self.data.diagonal() * all + &self.prior;
        if more > 0.0 && !some.is_empty() {
            // That is the inverse of their part of the inverse, the Schur complement.
            let part = self.inverse.select_rows(some).select_columns(some);
            let left = part.cholesky()?.inverse();
            some.iter().zip(left.diagonal().iter()).for_each(|(&i, left)| added[i] += more * left);
        }
        let inverse = (&self.data + DMatrix::from_diagonal(&added)).cholesky()?.inverse();
        Some(Self { size: self.size.clone(), data: self.data.clone(), prior: self.prior.clone(), inverse })
    }

    /// Gauss–Newton step from parameters with the distance `offset` from their prior; those `held` move by the given
    /// amounts.
    pub fn step(&self, normal: &NormalEquations, offset: &DVector<f64>, held: &[(usize, f64)]) -> DVector<f64> {
        let pull = offset.component_div(&self.size).component_mul(&self.prior);
        let gradient = normal.score.component_mul(&self.size) - pull;
        let mut step = &self.inverse * gradient;
        // Step of least cost with the given amounts d: s − P_h·P_hh⁻¹·(s_h − d), with P the inverse.
        let own = DMatrix::from_fn(held.len(), held.len(), |i, j| self.inverse[(held[i].0, held[j].0)]);
        let excess = |i: usize| step[held[i].0] - held[i].1 / self.size[held[i].0];
        let back = DVector::from_fn(held.len(), |i, _| excess(i));
        if let Some(factor) = own.cholesky() {
            for (share, (h, _)) in factor.solve(&back).iter().zip(held) {
                step -= self.inverse.column(*h) * *share;
            }
        }
        let mut step = step.component_mul(&self.size);
        held.iter().for_each(|(h, by)| step[*h] = *by);
        step
    }

    /// Curvature YᵀWY + prior of the cost, in natural units.
    pub fn curvature(&self) -> DMatrix<f64> {
        let n = self.size.len();
        DMatrix::from_fn(n, n, |i, j| {
            let prior = if i == j { self.prior[i] } else { 0.0 };
            (self.data[(i, j)] + prior) / (self.size[i] * self.size[j])
        })
    }

    /// Cluster-robust covariance of the estimate, H⁻¹ (Σ s̃ s̃ᵀ) H⁻¹, from the scatter of the scores over intervals
    /// of time. It is valid for residuals that are autocorrelated, correlated across channels or heteroscedastic. The
    /// intervals overlap and are a thirtieth of a recording, long relative to the correlation time of the noise.
    /// Every score is corrected for the leverage of its interval, s̃ = (1 − H_s H⁻¹)^(−1/2) s (CR2
    /// [Bell 2002]).
    ///
    /// The uncertainty of the prior is included. With `white`, no variance is smaller than for independent residuals
    /// of the stated noise.
    pub fn covariance(&self, normal: &NormalEquations, white: bool) -> DMatrix<f64> {
        let n = self.size.len();
        let Some(root) = self.inverse.clone().cholesky() else { return DMatrix::zeros(n, n) };
        // H⁻¹ = L·Lᵀ: in the coordinates Lᵀ(…)L the curvature is the identity.
        let l = root.l();
        let runs: Vec<Vec<(DMatrix<f64>, DVector<f64>)>> =
            normal.blocks.iter().map(|run| run.iter().map(|b| self.whitened(b, &l)).collect()).collect();
        let mut meat = l.tr_mul(&(DMatrix::from_diagonal(&self.prior) * &l));
        for run in &runs {
            let length = run.len().div_ceil(STRETCHES);
            // Intervals wrap around at the ends, so every block occurs equally often.
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
        // With few intervals the scatter is uncertain: scaled by Student's t, so that ±1.96 is a 95 % interval.
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

/// Ratio of the 97.5 % quantiles of Student's t, for a scatter over this number of intervals, and the normal
/// distribution.
fn widening(stretches: usize) -> f64 {
    let freedom = stretches.saturating_sub(1).max(2) as f64;
    let t = StudentsT::new(0.0, 1.0, freedom).expect("positive degrees of freedom").inverse_cdf(0.975);
    t / 1.959_963_984_540_054
}

/// (1 − M)^(−1/2)·s for symmetric M with eigenvalues from 0 to 1.
fn freed(m: DMatrix<f64>, s: &DVector<f64>) -> DVector<f64> {
    /// Largest leverage: an interval that alone determines a direction has no scatter there.
    const LARGEST: f64 = 0.99;
    let eigen = SymmetricEigen::new(m);
    let mut along = eigen.eigenvectors.tr_mul(s);
    for (x, lambda) in along.iter_mut().zip(&eigen.eigenvalues) {
        *x /= (1.0 - lambda.clamp(0.0, LARGEST)).sqrt();
    }
    eigen.eigenvectors * along
}

#[cfg(test)]
mod tests {
    use nalgebra::{dmatrix, dvector};

    use super::*;

    /// Curvature [[4, 2], [2, 3]]: 3 − 2·2/4 = 2 is left along the second parameter while the first follows.
    #[test]
    fn damping_of_one_parameter_leaves_the_others_free() {
        let normal = NormalEquations {
            blocks: Vec::new(),
            information: dmatrix![4.0, 2.0; 2.0, 3.0],
            score: dvector![8.0, 8.0],
            residuals: Default::default(),
            rows: Vec::new(),
            stride: 1,
        };
        let at = dvector![0.0, 0.0];
        let estimator = Estimator::new(&normal, &dvector![1.0, 1.0], &dvector![0.0, 0.0]).unwrap();
        // Undamped [[4, 2], [2, 3]]·s = (8, 8), damped [[4, 2], [2, 3 + 3·2]]·s.
        approx::assert_relative_eq!(estimator.step(&normal, &at, &[]), dvector![1.0, 2.0], epsilon = 1e-12);
        let damped = estimator.damped(0.0, 3.0, &[1]).unwrap();
        approx::assert_relative_eq!(damped.step(&normal, &at, &[]), dvector![1.75, 0.5], epsilon = 1e-12);
        assert!(estimator.damped(0.0, 0.0, &[1]).is_none());
    }
}
