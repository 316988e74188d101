//! Noise that wanders: a bias which walks at random, slower than anything the robot does.
//!
//! An autoregression of a few lags does not see it, and blocks of time are not independent under it: a constant that is
//! none is found in every channel that drifts. In a segment of n samples with the orthonormal cosines φ_k, k = 0, 1, …, a
//! random walk has coefficients of variance λ/k² beside the noise, and λ·π²/3 at k = 0 if it began at zero. λ is found
//! from the slowest cosines of what is left with the effect in the model: an effect that is there leaves none.

use std::ops::Range;

use super::dot;

/// Cosines, without the constant, that λ is found from; at 0.13 Hz and 20 s they are hardly faster than motions.
const COSINES: usize = 5;
/// A few coefficients may understate λ: it is taken so many times as large.
const CAUTION: f64 = 2.0;
/// Grid of λ.
const LAMBDA: [f64; 2] = [1e-2, 1e8];

/// Energy, in units of the noise, of what an effect takes from one channel, where what wanders counts for as much as it
/// does in what is left. For a column that is noise, the expected value is its degrees of freedom.
pub fn energy(taken: &[f64], left: &[f64], segments: &[Range<usize>]) -> f64 {
    let n: usize = segments.iter().map(Range::len).sum();
    let variance = segments.iter().map(|s| dot(&left[s.clone()], &left[s.clone()])).sum::<f64>() / n.max(1) as f64;
    if variance.is_nan() || variance <= 0.0 {
        return 0.0;
    }
    let long: Vec<&Range<usize>> = segments.iter().filter(|s| s.len() > 4 * COSINES).collect();
    let coefficient = |x: &[f64], s: &Range<usize>, k: usize| dot(&cosine(s.len(), k), &x[s.clone()]);
    let slow = |s: &&Range<usize>| (1..=COSINES).map(|k| coefficient(left, s, k).powi(2) / variance).collect();
    let lambda = CAUTION * walk(&long.iter().map(slow).collect::<Vec<Vec<f64>>>());
    let all: f64 = segments.iter().map(|s| dot(&taken[s.clone()], &taken[s.clone()])).sum();
    let wandering = long.iter().flat_map(|s| (0..=COSINES).map(move |k| (*s, k))).map(|(s, k)| {
        let share = if k == 0 { std::f64::consts::PI.powi(2) / 3.0 } else { 1.0 / (k * k) as f64 };
        let noise = 1.0 + lambda * share;
        coefficient(taken, s, k).powi(2) * (1.0 - noise.recip())
    });
    (all - wandering.sum::<f64>()) / variance
}

/// The k-th cosine over n samples, of unit length.
fn cosine(n: usize, k: usize) -> Vec<f64> {
    let scale = (if k == 0 { 1.0 } else { 2.0 } / n as f64).sqrt();
    let step = std::f64::consts::PI * k as f64 / n as f64;
    (0..n).map(|t| scale * (step * (t as f64 + 0.5)).cos()).collect()
}

/// Most likely λ for the squares of coefficients 1, 2, … of unit noise, segment by segment.
fn walk(squares: &[Vec<f64>]) -> f64 {
    let cost = |lambda: f64| -> f64 {
        let one = |(i, square): (usize, &f64)| {
            let variance = 1.0 + lambda / ((i + 1) * (i + 1)) as f64;
            variance.ln() + square / variance
        };
        squares.iter().flat_map(|s| s.iter().enumerate().map(one)).sum()
    };
    let [least, most] = LAMBDA;
    let grid = (0..=100).map(|i| least * (most / least).powf(f64::from(i) / 100.0));
    std::iter::once(0.0).chain(grid).min_by(|a, b| cost(*a).total_cmp(&cost(*b))).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    const N: usize = 10_000;

    fn white(seed: u64) -> Vec<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        (0..N).map(|_| StandardNormal.sample(&mut rng)).collect()
    }

    fn less_its_mean(x: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let mean = x.iter().sum::<f64>() / x.len() as f64;
        (vec![mean; x.len()], x.iter().map(|x| x - mean).collect())
    }

    /// The mean of a walk of 0.7 noise standard deviations over the series has an energy of some n·0.7²/3 = 1600.
    #[test]
    fn a_walk_is_no_bias_and_a_bias_is_no_walk() {
        let mut alarms = 0;
        for seed in 0..200 {
            let steps = white(1000 + seed);
            let mut at = 0.0;
            let walk: Vec<f64> = steps
                .iter()
                .map(|s| {
                    at += 0.7 * s / (N as f64).sqrt();
                    at
                })
                .collect();
            let series: Vec<f64> = white(seed).iter().zip(&walk).map(|(e, w)| e + w).collect();
            let (taken, left) = less_its_mean(&series);
            alarms += usize::from(energy(&taken, &left, &[0..N]) > 25.0);
        }
        assert!(alarms <= 6, "{alarms} of 200");
        let biased: Vec<f64> = white(7).iter().map(|e| e + 0.1).collect();
        let (taken, left) = less_its_mean(&biased);
        let found = energy(&taken, &left, &[0..N]);
        assert!(found > 25.0, "{found} of 100");
    }

    #[test]
    fn what_is_faster_counts_in_full() {
        let left: Vec<f64> = white(3);
        let taken: Vec<f64> = (0..N).map(|t| 0.1 * (0.05 * t as f64).sin()).collect();
        let found = energy(&taken, &left, &[0..N]);
        assert!((found / 50.0 - 1.0).abs() < 0.05, "{found}");
        assert_eq!(energy(&taken, &vec![0.0; N], &[0..N]), 0.0);
    }
}
