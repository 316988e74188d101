//! Noise of a set of recordings: of each one, and pooled.

use super::Dataset;
use crate::model::Model;

/// Standard deviations of the noise, N·m or N.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NoiseLevel {
    /// Of each channel of each recording: `[recording][channel]`. They weigh the recordings of a fit.
    pub of_each: Vec<Vec<f64>>,
    /// Of each channel over all samples of all recordings, √(Σ n σ² / Σ n): RMS residual of the true model.
    pub pooled: Vec<f64>,
}

impl NoiseLevel {
    /// Noise of `datasets`, all with the same channels; empty without any.
    pub fn of(model: &Model, datasets: &[Dataset]) -> Self {
        let of_each: Vec<Vec<f64>> = datasets.iter().map(|t| t.noise(model)).collect();
        let samples = datasets.iter().map(Dataset::len).sum::<usize>() as f64;
        let pooled = |c: usize| {
            let squares = datasets.iter().zip(&of_each).map(|(t, sigma)| t.len() as f64 * sigma[c].powi(2));
            (squares.sum::<f64>() / samples).sqrt()
        };
        let channels = of_each.first().map_or(0, Vec::len);
        // The root of a square is not quite the number itself.
        let pooled = if let [one] = &of_each[..] { one.clone() } else { (0..channels).map(pooled).collect() };
        Self { of_each, pooled }
    }
}
