//! Noise that wanders: a bias which walks at random, slower than anything the robot does.
//!
//! An autoregression of a few lags does not see it, and blocks of time are not independent under it: a constant that is
//! none is found in every channel that drifts. In a segment of n samples with the orthonormal cosines φ_k, k = 0, 1, …, a
//! random walk has coefficients of variance λ/k² beside the noise, and λ·π²/3 at k = 0 if it began at zero. λ is found
//! from the slowest cosines of what is left with the effect in the model: an effect that is there leaves none. What an
//! effect gains is then weighed as generalised least squares would: cosine by cosine over the variance that walks there.

use std::ops::Range;

use super::dot;

/// Cosines, without the constant, that λ is found from; at 0.13 Hz and 20 s they are hardly faster than motions.
const COSINES: usize = 5;
/// A few coefficients may understate λ: it is taken so many times as large.
const CAUTION: f64 = 2.0;
/// Share of the noise below which a walk is forgotten, and cosines after which it is anyway.
const LITTLE: f64 = 0.1;
const MOST: usize = 100;
/// Grid of λ.
const LAMBDA: [f64; 2] = [1e-2, 1e8];

/// One channel in units of its noise, segment by segment.
pub struct Series<'a> {
    values: &'a [f64],
    segments: Vec<&'a Range<usize>>,
    variance: f64,
}

impl<'a> Series<'a> {
    /// What is left of a channel; its own variance is its noise.
    pub fn new(values: &'a [f64], segments: &'a [Range<usize>]) -> Self {
        let n: usize = segments.iter().map(Range::len).sum();
        let squares: f64 = segments.iter().map(|s| dot(&values[s.clone()], &values[s.clone()])).sum();
        Self { values, segments: segments.iter().collect(), variance: squares / n.max(1) as f64 }
    }

    fn long(&self) -> impl Iterator<Item = &'a Range<usize>> + '_ {
        self.segments.iter().copied().filter(|s| s.len() > 4 * COSINES)
    }

    /// Squares of the slowest coefficients but for the constants, which a fit may have taken, with their shares of λ.
    fn slow(&self) -> Vec<[f64; 2]> {
        let noisy = self.variance > 0.0;
        let of = |s: &Range<usize>, k: usize| {
            [share(k), dot(&cosine(s.len(), k), &self.values[s.clone()]).powi(2) / self.variance]
        };
        self.long().filter(|_| noisy).flat_map(|s| (1..=COSINES).map(move |k| of(s, k))).collect()
    }

    /// Fall of the energy from `before` to this, in units of the noise that walks with `lambda`. For a column that is noise,
    /// the expected value is its degrees of freedom.
    pub fn gain(&self, before: &[f64], lambda: f64) -> f64 {
        if self.variance.is_nan() || self.variance <= 0.0 {
            return 0.0;
        }
        let energy = |x: &[f64], s: &Range<usize>| dot(&x[s.clone()], &x[s.clone()]);
        let all: f64 = self.segments.iter().map(|s| energy(before, s) - energy(self.values, s)).sum();
        let last = ((lambda / LITTLE).sqrt() as usize).min(MOST);
        let walking = self.long().flat_map(|s| (0..=last.min(s.len() / 4)).map(move |k| (s, k))).map(|(s, k)| {
            let cosine = cosine(s.len(), k);
            let square = |x: &[f64]| dot(&cosine, &x[s.clone()]).powi(2);
            (square(before) - square(self.values)) * (1.0 - (1.0 + lambda * share(k)).recip())
        });
        (all - walking.sum::<f64>()) / self.variance
    }
}

/// λ of a channel from what is left of it.
pub fn walk(left: &[Series]) -> f64 {
    CAUTION * likeliest(&left.iter().flat_map(Series::slow).collect::<Vec<_>>())
}

/// Share of λ in the variance of the k-th coefficient.
fn share(k: usize) -> f64 {
    if k == 0 { std::f64::consts::PI.powi(2) / 3.0 } else { 1.0 / (k * k) as f64 }
}

/// The k-th cosine over n samples, of unit length.
fn cosine(n: usize, k: usize) -> Vec<f64> {
    let scale = (if k == 0 { 1.0 } else { 2.0 } / n as f64).sqrt();
    let step = std::f64::consts::PI * k as f64 / n as f64;
    (0..n).map(|t| scale * (step * (t as f64 + 0.5)).cos()).collect()
}

/// Most likely λ for coefficients of unit noise, given as shares of λ and squares.
fn likeliest(coefficients: &[[f64; 2]]) -> f64 {
    let cost = |lambda: f64| -> f64 {
        let one = |[share, square]: &[f64; 2]| {
            let variance = 1.0 + lambda * share;
            variance.ln() + square / variance
        };
        coefficients.iter().map(one).sum()
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

    /// A walk of `size` noise standard deviations over the series, and the noise.
    fn walking(size: f64, seed: u64) -> Vec<f64> {
        let mut at = 0.0;
        let steps = white(1000 + seed);
        let walk = steps.iter().map(|s| {
            at += size * s / (N as f64).sqrt();
            at
        });
        white(seed).iter().zip(walk).map(|(e, w)| e + w).collect()
    }

    fn gain_of_the_mean(series: &[f64]) -> f64 {
        let mean = series.iter().sum::<f64>() / N as f64;
        let less = |x: &[f64]| -> Vec<f64> { x.iter().map(|x| x - mean).collect() };
        let (left, segments) = (less(series), [0..N]);
        let lambda = walk(&[Series::new(&left, &segments)]);
        Series::new(&left, &segments).gain(series, lambda)
    }

    /// The mean of a walk of 0.7 noise standard deviations over the series has an energy of some n·0.7²/3 = 1600.
    #[test]
    fn a_walk_is_no_bias_and_a_bias_is_no_walk() {
        let alarms = (0..200).filter(|s| gain_of_the_mean(&walking(0.7, *s)) > 25.0).count();
        assert!(alarms <= 6, "{alarms} of 200");
        let biased = |seed: u64| -> Vec<f64> { white(seed).iter().map(|e| e + 0.1).collect() };
        let found = gain_of_the_mean(&biased(7));
        assert!(found > 50.0, "{found} of 100");
    }

    /// What would be gained from slow cosines alone, and is lost elsewhere, is no gain.
    #[test]
    fn what_imitates_a_walk_gains_nothing() {
        let series = walking(0.7, 11);
        let mean = series.iter().sum::<f64>() / N as f64;
        let column = |t: usize| 1.0 + 0.7 * (0.05 * t as f64).sin();
        let left: Vec<f64> = series.iter().enumerate().map(|(t, x)| x - 0.8 * mean * column(t)).collect();
        let segments = [0..N];
        let lambda = walk(&[Series::new(&left, &segments)]);
        let found = Series::new(&left, &segments).gain(&series, lambda);
        assert!(Series::new(&left, &segments).gain(&series, 0.0) > 100.0);
        assert!(found < 0.0, "{found}");
    }

    #[test]
    fn what_is_faster_counts_in_full() {
        let left: Vec<f64> = white(3);
        let segments = [0..N];
        let taken = |t: usize| 0.1 * (0.05 * t as f64).sin();
        let before: Vec<f64> = left.iter().enumerate().map(|(t, x)| x + taken(t)).collect();
        let found = Series::new(&left, &segments).gain(&before, 100.0);
        assert!((found / 50.0 - 1.0).abs() < 0.3, "{found}");
        assert_eq!(Series::new(&vec![0.0; N], &segments).gain(&before, 1.0), 0.0);
    }
}
