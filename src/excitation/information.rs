//! Measures of the information matrix of the base parameters along a motion.

use nalgebra::{DMatrix, DVector};

/// Objective to be minimised: a smooth function of the eigenvalues λ of the information matrix S·Yᵀ·Σ⁻¹·Y·S per
/// sample, whose columns are in units of the parameters' own sizes (S) and of the torque noise (Σ).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Objective {
    /// −log det of the information: the volume of the confidence ellipsoid, independent of the units of the
    /// parameters.
    #[default]
    Logdet,
    /// Condition number of the weighted regressor with columns in units of the parameters' own sizes.
    Condition,
}

/// Exponent p of the smooth largest and smallest eigenvalue, (Σλᵖ)^(1/p) and (Σλ⁻ᵖ)^(−1/p).
const POWER: f64 = 4.0;
/// Lower bound of the eigenvalues relative to the largest.
const FLOOR: f64 = 1e-15;

impl Objective {
    /// Value and derivative with respect to the information matrix; `None` if it is empty or not finite.
    ///
    /// The condition number is represented by the logarithm of its smooth bound, ½·log of the ratio of the extreme λ.
    pub fn value(self, information: &DMatrix<f64>) -> Option<(f64, DMatrix<f64>)> {
        if information.iter().any(|x| !x.is_finite()) || information.is_empty() {
            return None;
        }
        let eigen = information.clone().symmetric_eigen();
        let floor = (FLOOR * eigen.eigenvalues.amax()).max(f64::MIN_POSITIVE);
        let lambda = eigen.eigenvalues.map(|l| l.max(floor));
        let (value, slope) = match self {
            Self::Logdet => (-lambda.map(f64::ln).sum(), lambda.map(|l| -1.0 / l)),
            Self::Condition => {
                let (largest, least) = (lambda.max(), lambda.min());
                let high = lambda.map(|l| (l / largest).powf(POWER)).sum();
                let low = lambda.map(|l| (l / least).powf(-POWER)).sum();
                let value = 0.5 * ((largest / least).ln() + (high.ln() + low.ln()) / POWER);
                let slope =
                    lambda.map(|l| 0.5 * ((l / largest).powf(POWER) / high - (l / least).powf(-POWER) / low) / l);
                (value, slope)
            }
        };
        let derivative = &eigen.eigenvectors * DMatrix::from_diagonal(&slope) * eigen.eigenvectors.transpose();
        value.is_finite().then_some((value, derivative))
    }
}

/// Information of a motion about the base parameters.
#[derive(Clone, Debug)]
pub struct Merit {
    /// Ratio of the largest to the smallest singular value of the weighted regressor Σ^(−1/2)·Y·S, columns in units
    /// of the parameters' own sizes.
    pub condition: f64,
    /// Condition number of Σ^(−1/2)·Y with columns in SI units.
    pub condition_si: f64,
    /// Condition number with every column scaled to unit length.
    pub condition_unit: f64,
    /// log det of the information per sample, columns in units of the parameters' own sizes.
    pub log_det: f64,
    /// Standard errors of the base parameters from white torque noise in one sample, in units of their own sizes.
    pub std: Vec<f64>,
}

impl Merit {
    /// Measures of the information per sample, whose columns are in units of the parameters' own sizes `size`.
    pub fn of(information: &DMatrix<f64>, size: &[f64]) -> Self {
        let n = information.nrows();
        let rescaled =
            |s: &dyn Fn(usize) -> f64| condition(&DMatrix::from_fn(n, n, |i, j| information[(i, j)] * s(i) * s(j)));
        let inverse = information.clone().cholesky().map(|c| c.inverse());
        Self {
            condition: condition(information),
            condition_si: rescaled(&|i| 1.0 / size[i]),
            condition_unit: rescaled(&|i| 1.0 / information[(i, i)].max(f64::MIN_POSITIVE).sqrt()),
            log_det: eigenvalues(information).map(|l| l.max(0.0).ln()).sum(),
            std: (0..n).map(|i| inverse.as_ref().map_or(f64::INFINITY, |m| m[(i, i)].max(0.0).sqrt())).collect(),
        }
    }
}

fn eigenvalues(information: &DMatrix<f64>) -> DVector<f64> {
    information.clone().symmetric_eigenvalues()
}

/// Square root of the ratio of the extreme eigenvalues; infinite if the smallest is not positive.
fn condition(information: &DMatrix<f64>) -> f64 {
    let lambda = eigenvalues(information);
    let (low, high) = (lambda.min(), lambda.max());
    if low > 0.0 { (high / low).sqrt() } else { f64::INFINITY }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identification::base_parameters::independent;

    #[test]
    fn slopes_are_those_of_the_values() {
        let root = DMatrix::from_fn(4, 6, |i, j| ((3 * i + 5 * j) as f64).sin() + if i == j { 1.5 } else { 0.0 });
        let information = &root * root.transpose();
        for objective in [Objective::Logdet, Objective::Condition] {
            let (_, slope) = objective.value(&information).unwrap();
            for (i, j) in [(0, 0), (1, 3), (2, 2), (0, 2)] {
                let mut unit = DMatrix::zeros(4, 4);
                unit[(i, j)] += 0.5;
                unit[(j, i)] += 0.5;
                let at = |h: f64| objective.value(&(&information + &unit * h)).unwrap().0;
                let difference = (at(1e-6) - at(-1e-6)) / 2e-6;
                approx::assert_relative_eq!(difference, slope.dot(&unit), max_relative = 1e-6, epsilon = 1e-9);
            }
        }
    }

    #[test]
    fn dependent_and_silent_columns_are_left_out() {
        let y = DMatrix::from_row_slice(4, 4, &[1., 0., 2., 0., 0., 1., 1., 0., 1., 1., 3., 0., 0., 2., 2., 1e-9]);
        let information = y.transpose() * &y;
        assert_eq!(independent(&information, 1e-6).len(), 2);
        assert!(Merit::of(&DMatrix::zeros(2, 2), &[1.0, 1.0]).condition.is_infinite());
        assert_eq!(Merit::of(&DMatrix::from_diagonal_element(2, 2, 4.0), &[1.0, 0.5]).condition, 1.0);
        assert_eq!(Merit::of(&DMatrix::from_diagonal_element(2, 2, 4.0), &[1.0, 0.5]).condition_si, 2.0);
    }
}
