//! Variance-based sensitivity indices.
//!
//! With the output f of d independent factors, V its variance, and x₋ₖ all factors but the k-th,
//!
//! first order Sₖ = V[E(f | xₖ)] / V, total Tₖ = E[V(f | x₋ₖ)] / V.
//!
//! From n pairs of independent points A, B, and Aₖ = A with the k-th factor of B:
//!
//! - Sₖ ≈ mean(f(B)·(f(Aₖ) − f(A))) / V [Saltelli 2010, table 2 (b)]
//! - Tₖ ≈ mean((f(A) − f(Aₖ))²) / (2 V) [Jansen 1999; Saltelli 2010, table 2 (f)]
//!
//! f is centred first, which changes neither index and removes the error that a mean leaves in Sₖ. V is taken from
//! the 2n values f(A) and f(B). These are the estimators of SALib.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use thiserror::Error;

use super::quantile;

/// An index with the uncertainty of its estimate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Index {
    /// Estimate; that of a small index may be negative.
    pub value: f64,
    /// Standard error from the bootstrap.
    pub error: f64,
    /// 95 % interval: percentiles of the bootstrap.
    pub interval: [f64; 2],
}

/// Indices of all factors.
#[derive(Debug, Clone, PartialEq)]
pub struct SobolIndices {
    /// First-order indices, one per factor: the share of the variance that the factor alone explains.
    pub first: Vec<Index>,
    /// Total indices, one per factor: the share that remains while only this factor is unknown.
    pub total: Vec<Index>,
    /// Variance of the output.
    pub variance: f64,
    /// Number of base points n; the runs are n·(d + 2).
    pub base: usize,
}

/// Reason why there are no indices.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum SobolError {
    /// The number of outputs does not fit the number of factors.
    #[error("{outputs} outputs are not a multiple of {block}, the runs of one base point with {factors} factors")]
    Count {
        /// Outputs.
        outputs: usize,
        /// Factors.
        factors: usize,
        /// Runs of one base point.
        block: usize,
    },
    /// Too few base points.
    #[error("{0} base points are too few for a variance: at least 2")]
    Few(usize),
    /// An output is not a finite number.
    #[error("output {row} is {value}: every run needs a finite value")]
    NotFinite {
        /// Index of the output.
        row: usize,
        /// Its value.
        value: f64,
    },
    /// All outputs are equal.
    #[error("all outputs are equal: there is no variance to share")]
    Constant,
}

/// Points of the runs of one base point: A, then A with each factor of B in turn, then B.
///
/// `base` has 2·d columns between 0 and 1, A before B, such as one point of a Sobol' sequence. The order of the runs
/// is that of SALib.
pub fn sobol_points(base: &[f64]) -> Vec<Vec<f64>> {
    let factors = base.len() / 2;
    let (a, b) = (&base[..factors], &base[factors..2 * factors]);
    let mixed = (0..factors).map(|k| {
        let mut point = a.to_vec();
        point[k] = b[k];
        point
    });
    std::iter::once(a.to_vec()).chain(mixed).chain(std::iter::once(b.to_vec())).collect()
}

/// First-order and total indices from the outputs of n·(d + 2) runs, the blocks of [`sobol_points`] one after another.
///
/// The base points are resampled `resamples` times with `seed` for standard errors and intervals.
///
/// # Errors
/// If the number of outputs does not fit, an output is not finite, or all are equal.
pub fn sobol_indices(outputs: &[f64], factors: usize, resamples: usize, seed: u64) -> Result<SobolIndices, SobolError> {
    let block = factors + 2;
    if factors == 0 || !outputs.len().is_multiple_of(block) {
        return Err(SobolError::Count { outputs: outputs.len(), factors, block });
    }
    let base = outputs.len() / block;
    if base < 2 {
        return Err(SobolError::Few(base));
    }
    if let Some((row, &value)) = outputs.iter().enumerate().find(|(_, v)| !v.is_finite()) {
        return Err(SobolError::NotFinite { row, value });
    }
    let mean = outputs.iter().sum::<f64>() / outputs.len() as f64;
    let centred: Vec<f64> = outputs.iter().map(|v| v - mean).collect();
    if centred.iter().all(|v| v.abs() <= 1e-14 * mean.abs()) {
        return Err(SobolError::Constant);
    }
    let blocks: Vec<&[f64]> = centred.chunks(block).collect();
    let all: Vec<usize> = (0..base).collect();
    let (estimate, variance) = estimate(&blocks, &all);
    if variance <= 0.0 {
        return Err(SobolError::Constant);
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let draws: Vec<Vec<f64>> = (0..resamples)
        .map(|_| (0..base).map(|_| rng.random_range(0..base)).collect::<Vec<usize>>())
        .map(|rows| self::estimate(&blocks, &rows))
        // A resample may by chance contain equal outputs only.
        .filter_map(|(values, variance)| (variance > 0.0).then_some(values))
        .collect();
    let index = |k: usize| with_bootstrap(estimate[k], draws.iter().map(|d| d[k]).collect());
    let first = (0..factors).map(index).collect();
    let total = (factors..2 * factors).map(index).collect();
    Ok(SobolIndices { first, total, variance, base })
}

/// First-order indices, then total ones, of the blocks of the given rows; and the variance.
fn estimate(blocks: &[&[f64]], rows: &[usize]) -> (Vec<f64>, f64) {
    let factors = blocks[0].len() - 2;
    let n = rows.len() as f64;
    let (mut sum, mut squares, mut parts) = (0.0, 0.0, vec![0.0; 2 * factors]);
    for &row in rows {
        let block = blocks[row];
        let (a, b) = (block[0], block[factors + 1]);
        sum += a + b;
        squares += a * a + b * b;
        for k in 0..factors {
            let mixed = block[k + 1];
            parts[k] += b * (mixed - a);
            parts[factors + k] += 0.5 * (a - mixed).powi(2);
        }
    }
    let mean = sum / (2.0 * n);
    let variance = squares / (2.0 * n) - mean * mean;
    (parts.into_iter().map(|p| p / (n * variance)).collect(), variance)
}

fn with_bootstrap(value: f64, draws: Vec<f64>) -> Index {
    let n = draws.len() as f64;
    let mean = draws.iter().sum::<f64>() / n;
    let error = (draws.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
    let end = |p: f64| quantile(&draws, p).unwrap_or(f64::NAN);
    Index { value, error: if n > 1.0 { error } else { f64::NAN }, interval: [end(0.025), end(0.975)] }
}
