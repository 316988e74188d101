//! Least squares with few features.

use nalgebra::{DMatrix, DVector};

/// Eigenvalue of the scaled normal equations, relative to the largest, below which features are collinear.
const COLLINEAR: f64 = 1e-9;

/// y ≈ Σ β·features.
#[derive(Clone, Debug)]
pub struct LeastSquares {
    /// Coefficients, in the order of the features.
    pub beta: Vec<f64>,
    /// Their standard errors for independent residuals.
    pub std: Vec<f64>,
    /// Mean square of the residual.
    pub mean_square: f64,
}

/// Fit of `y` by `features` of the same length; `None` with fewer samples than twice the features, or without
/// variation.
pub fn least_squares(features: &[&[f64]], y: &[f64]) -> Option<LeastSquares> {
    let (n, k) = (y.len(), features.len());
    if n < 2 * k.max(1) {
        return None;
    }
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let scale: Vec<f64> = features.iter().map(|f| dot(f, f).sqrt().max(f64::MIN_POSITIVE)).collect();
    let normal = DMatrix::from_fn(k, k, |a, b| dot(features[a], features[b]) / (scale[a] * scale[b]));
    let right = DVector::from_fn(k, |a, _| dot(features[a], y) / scale[a]);
    if !normal.iter().chain(right.iter()).all(|v| v.is_finite()) {
        return None;
    }
    let eigen = normal.symmetric_eigen();
    let floor = COLLINEAR * eigen.eigenvalues.max();
    let inverse = eigen.eigenvalues.map(|l| if l > floor { 1.0 / l } else { 0.0 });
    let inverse = &eigen.eigenvectors * DMatrix::from_diagonal(&inverse) * eigen.eigenvectors.transpose();
    let scaled = &inverse * right;
    let beta: Vec<f64> = (0..k).map(|a| scaled[a] / scale[a]).collect();
    let residual = |i: usize| y[i] - (0..k).map(|a| beta[a] * features[a][i]).sum::<f64>();
    let squares: f64 = (0..n).map(|i| residual(i).powi(2)).sum();
    let variance = squares / (n - k) as f64;
    let std = (0..k).map(|a| (variance * inverse[(a, a)].max(0.0)).sqrt() / scale[a]).collect();
    Some(LeastSquares { beta, std, mean_square: squares / n as f64 })
}
