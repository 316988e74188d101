//! Frisch–Waugh–Lovell projection on Gram matrices, with a tolerance for collinear columns.

use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Relative eigenvalue of the scaled base Gram matrix below which a direction counts as collinear.
const BASE_TOLERANCE: f64 = 1e-9;

/// Share of a candidate direction's energy outside the base below which it counts as inside the span of the base. It
/// exceeds the rounding error that the base tolerance permits (ε / 1e-9 = 2e-7).
pub const SPAN_TOLERANCE: f64 = 1e-6;

/// Pseudo-inverse and rank of a Gram matrix; columns are scaled to unit length first, so the units do not matter.
pub fn pseudo_inverse(gram: &DMatrix<f64>) -> (DMatrix<f64>, usize) {
    let p = gram.nrows();
    let scale = unit_scale(gram);
    let scaled = DMatrix::from_fn(p, p, |i, j| gram[(i, j)] * scale[i] * scale[j]);
    if p == 0 || scaled.iter().any(|x| !x.is_finite()) {
        return (DMatrix::zeros(p, p), 0);
    }
    let eigen = SymmetricEigen::new(scaled);
    let largest = eigen.eigenvalues.max();
    let kept: Vec<usize> =
        (0..p).filter(|&i| largest > 0.0 && eigen.eigenvalues[i] > BASE_TOLERANCE * largest).collect();
    let mut factor = eigen.eigenvectors.select_columns(&kept);
    for (k, &i) in kept.iter().enumerate() {
        factor.column_mut(k).scale_mut(eigen.eigenvalues[i].sqrt().recip());
    }
    for (i, &s) in scale.iter().enumerate() {
        factor.row_mut(i).scale_mut(s);
    }
    (&factor * factor.transpose(), kept.len())
}

/// Reciprocal column norms; zero for zero columns.
fn unit_scale(gram: &DMatrix<f64>) -> Vec<f64> {
    gram.diagonal().iter().map(|&d| if d > 0.0 { d.sqrt().recip() } else { 0.0 }).collect()
}

/// A variant's columns after projection of the base.
#[derive(Clone, Debug)]
pub struct Projected {
    /// Base coefficients that imitate each column (p × m).
    pub imitation: DMatrix<f64>,
    /// Gram matrix of the projected columns (m × m).
    pub gram: DMatrix<f64>,
    /// Column combinations that are orthonormal after projection (m × rank), strongest first.
    pub basis: DMatrix<f64>,
    /// Mean over the columns of the share of energy that no base parameter can imitate.
    pub tolerance: f64,
    /// Whether all columns are zero.
    pub empty: bool,
}

impl Projected {
    /// Projects columns with Gram matrix `own` and products `cross` (p × m) with the base.
    pub fn new(inverse: &DMatrix<f64>, cross: &DMatrix<f64>, own: &DMatrix<f64>) -> Self {
        let m = own.nrows();
        let imitation = inverse * cross;
        let mut gram = own - cross.transpose() * &imitation;
        gram = 0.5 * (&gram + gram.transpose());
        let scale = unit_scale(own);
        let used = scale.iter().filter(|&&s| s > 0.0).count();
        let scaled = DMatrix::from_fn(m, m, |i, j| gram[(i, j)] * scale[i] * scale[j]);
        let tolerance = (scaled.trace() / used.max(1) as f64).clamp(0.0, 1.0);
        let mut basis = DMatrix::zeros(m, 0);
        if used > 0 && scaled.iter().all(|x| x.is_finite()) {
            let eigen = SymmetricEigen::new(scaled);
            let mut kept: Vec<usize> = (0..m).filter(|&i| eigen.eigenvalues[i] > SPAN_TOLERANCE).collect();
            kept.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
            basis = eigen.eigenvectors.select_columns(&kept);
            for (k, &i) in kept.iter().enumerate() {
                basis.column_mut(k).scale_mut(eigen.eigenvalues[i].sqrt().recip());
            }
            for (i, &s) in scale.iter().enumerate() {
                basis.row_mut(i).scale_mut(s);
            }
        }
        Self { imitation, gram, basis, tolerance, empty: used == 0 }
    }

    /// Number of directions outside the base.
    pub fn rank(&self) -> usize {
        self.basis.ncols()
    }

    /// `‖Z⊥ c‖²`.
    pub fn energy(&self, c: &DVector<f64>) -> f64 {
        c.dot(&(&self.gram * c)).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn collinear_base_breaks_nothing() {
        let x = DMatrix::from_fn(50, 4, |i, j| match j {
            0 => 1.0,
            1 => i as f64 * 1e6,
            2 => 3.0 + i as f64,
            _ => 0.0,
        });
        let z = DMatrix::from_fn(50, 2, |i, j| if j == 0 { 5.0 - i as f64 } else { (i * i) as f64 });
        let (inverse, rank) = pseudo_inverse(&(x.transpose() * &x));
        assert_eq!(rank, 2);
        let p = Projected::new(&inverse, &(x.transpose() * &z), &(z.transpose() * &z));
        assert_eq!(p.rank(), 1);
        let left = &z - &x * &p.imitation;
        assert!(left.column(0).norm() < 1e-6 * z.column(0).norm());
        assert!((p.gram[(1, 1)] - left.column(1).norm_squared()).abs() < 1e-6 * p.gram[(1, 1)]);
    }

    #[test]
    fn empty_and_non_finite_columns_have_no_rank() {
        let none = DMatrix::zeros(0, 0);
        assert!(Projected::new(&none, &DMatrix::zeros(0, 1), &DMatrix::zeros(1, 1)).empty);
        assert_eq!(Projected::new(&none, &DMatrix::zeros(0, 0), &none).rank(), 0);
        let bad = DMatrix::from_element(1, 1, f64::NAN);
        assert_eq!(Projected::new(&none, &DMatrix::zeros(0, 1), &bad).rank(), 0);
    }
}
