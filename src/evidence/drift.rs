//! Noise with random-walk drift: a bias that varies more slowly than any motion of the robot.
//!
//! A low-order autoregression does not describe it, and blocks of time are not independent under it, so that a
//! spurious constant is found in every drifting channel. In a segment of n samples with the orthonormal cosines φ_k,
//! k = 0, 1, …, a random walk has coefficients of variance λ/k² relative to noise of variance one, and λ·π²/3 at k =
//! 0 if it began at zero. λ is estimated by maximum likelihood from the slowest cosines of the residual with the
//! effect in the model; the faster cosines give the noise level. The gain of an effect is then its gain in
//! generalised least squares with all other parameters refitted: ordinary least squares would fit the drift and bias
//! channels without drift through the shared parameters.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};

use super::dot;
use super::noise::NORMAL_QUARTILE;
use super::project::pseudo_inverse;
use crate::numerics::{median, parallel};

/// Number of cosines, without the constant, from which λ is estimated: up to 0.13 Hz in 20 s, hardly faster than
/// motions.
const COSINES: usize = 5;
/// Factor on the estimated λ, because a few coefficients may underestimate it.
const SAFETY_FACTOR: f64 = 2.0;
/// Share of the noise below which the drift is neglected, and the largest number of cosines.
const MIN_DRIFT_SHARE: f64 = 0.1;
const MAX_COSINES: usize = 100;
/// Grid of λ.
const LAMBDA: [f64; 2] = [1e-2, 1e8];

/// Noise of stacked channels per segment: random-walk drift in addition to stationary noise.
pub struct Noise<'a> {
    segments: &'a [Range<usize>],
    samples: usize,
    channels: Vec<Walk>,
    /// Orthonormal cosines of each segment; empty for a segment too short to separate drift from motion.
    cosines: Vec<Vec<Vec<f64>>>,
}

/// Noise of one channel.
struct Walk {
    /// Standard deviation of the residual over all segments, in the channel's unit.
    sigma: f64,
    /// Drift intensity relative to the stationary noise at low frequency.
    lambda: f64,
}

impl Walk {
    fn new(left: &[f64], segments: &[Range<usize>], cosines: &[Vec<Vec<f64>>]) -> Self {
        let n: usize = segments.iter().map(Range::len).sum();
        let squares: f64 = segments.iter().map(|s| dot(&left[s.clone()], &left[s.clone()])).sum();
        let mut slow = Vec::new();
        let mut others = Vec::new();
        for (segment, cosines) in segments.iter().zip(cosines) {
            // Without the constant, which a fit may have removed.
            for (k, cosine) in cosines.iter().enumerate().skip(1) {
                let square = dot(cosine, &left[segment.clone()]).powi(2);
                if k <= COSINES { slow.push([share(k), square]) } else { others.push(square) }
            }
        }
        let level = median(others) / NORMAL_QUARTILE.powi(2);
        slow.iter_mut().for_each(|[_, square]| *square /= level);
        let lambda = if level > 0.0 { SAFETY_FACTOR * likeliest(&slow) } else { 0.0 };
        Self { sigma: (squares / n.max(1) as f64).sqrt(), lambda }
    }

    /// Number of cosines whose drift exceeds the share [`MIN_DRIFT_SHARE`] of the noise.
    fn last(&self) -> usize {
        ((self.lambda / MIN_DRIFT_SHARE).sqrt() as usize).min(MAX_COSINES)
    }
}

impl<'a> Noise<'a> {
    /// Noise model estimated from the residual of all channels, each of `samples`. The first `alike` channels get at
    /// least their median drift intensity, because a candidate that fits one channel's drift removes it from that
    /// channel only.
    pub fn of(left: &[f64], samples: usize, segments: &'a [Range<usize>], alike: usize) -> Self {
        let all = |i: usize| -> Vec<Vec<f64>> {
            let s = &segments[i];
            let last = if s.len() > 4 * COSINES { MAX_COSINES.min(s.len() / 4) + 1 } else { 0 };
            (0..last).map(|k| cosine(s.len(), k)).collect()
        };
        let cosines = parallel::map(segments.len(), all);
        let parts: Vec<&[f64]> = left.chunks(samples.max(1)).collect();
        let mut channels = parallel::map(parts.len(), |i| Walk::new(parts[i], segments, &cosines));
        let alike = alike.min(channels.len());
        let mut lambdas: Vec<f64> = channels[..alike].iter().map(|c| c.lambda).collect();
        lambdas.sort_by(f64::total_cmp);
        for channel in &mut channels[..alike] {
            channel.lambda = channel.lambda.max(lambdas[(alike - 1) / 2]);
        }
        Self { segments, samples, channels, cosines }
    }

    /// Whether any channel has drift in at least its slowest cosine.
    pub fn wanders(&self) -> bool {
        self.channels.iter().any(|c| c.last() > 0)
    }

    /// Series divided by the channel's noise, with the drift whitened; autocorrelation of the stationary noise
    /// remains. A channel without noise gives zeros.
    pub fn whiten(&self, series: &[f64]) -> Vec<f64> {
        let mut out = series.to_vec();
        for (x, walk) in out.chunks_mut(self.samples.max(1)).zip(&self.channels) {
            for (segment, cosines) in self.segments.iter().zip(&self.cosines).filter(|_| walk.last() > 0) {
                let x = &mut x[segment.clone()];
                for (k, cosine) in cosines.iter().enumerate().take(walk.last() + 1) {
                    let excess = dot(cosine, x) * (1.0 - (1.0 + walk.lambda * share(k)).sqrt().recip());
                    x.iter_mut().zip(cosine).for_each(|(x, c)| *x -= excess * c);
                }
            }
            let weight = if walk.sigma > 0.0 { walk.sigma.recip() } else { 0.0 };
            x.iter_mut().for_each(|x| *x *= weight);
        }
        out
    }

    /// Sum of squares of the whitened series.
    pub fn energy(&self, series: &[f64]) -> f64 {
        let white = self.whiten(series);
        dot(&white, &white)
    }

    /// Residual of a series after generalised least squares on `columns` with this noise.
    pub fn least_squares(&self, series: &[f64], columns: &[&[f64]]) -> Vec<f64> {
        let white = parallel::map(columns.len(), |i| self.whiten(columns[i]));
        let target = self.whiten(series);
        let rows: Vec<Vec<f64>> = parallel::map(white.len(), |i| white.iter().map(|b| dot(&white[i], b)).collect());
        let gram = DMatrix::from_fn(rows.len(), rows.len(), |i, j| rows[i][j]);
        let products = DVector::from_iterator(white.len(), white.iter().map(|column| dot(column, &target)));
        let coefficients = pseudo_inverse(&gram).0 * products;
        let mut left = series.to_vec();
        for (column, coefficient) in columns.iter().zip(&coefficients) {
            left.iter_mut().zip(*column).for_each(|(l, x)| *l -= coefficient * x);
        }
        left
    }
}

/// Variance of the k-th cosine coefficient of a random walk, in units of λ.
fn share(k: usize) -> f64 {
    if k == 0 { std::f64::consts::PI.powi(2) / 3.0 } else { 1.0 / (k * k) as f64 }
}

/// The k-th cosine over n samples, of unit length.
fn cosine(n: usize, k: usize) -> Vec<f64> {
    let scale = (if k == 0 { 1.0 } else { 2.0 } / n as f64).sqrt();
    let step = std::f64::consts::PI * k as f64 / n as f64;
    (0..n).map(|t| scale * (step * (t as f64 + 0.5)).cos()).collect()
}

/// Maximum-likelihood λ on the grid, given (share of λ, square) of coefficients relative to unit noise.
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

    /// A random walk whose final standard deviation is `size` noise standard deviations, plus the noise.
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
        let left: Vec<f64> = series.iter().map(|x| x - mean).collect();
        let segments = [0..N];
        let noise = Noise::of(&left, N, &segments, 1);
        noise.energy(series) - noise.energy(&left)
    }

    /// The mean of a walk of 0.7 noise standard deviations over the series has an energy of some n·0.7²/3 = 1600.
    #[test]
    #[ignore = "campaign"]
    fn a_walk_is_no_bias_and_a_bias_is_no_walk() {
        let alarms = (0..200).filter(|s| gain_of_the_mean(&walking(0.7, *s)) > 25.0).count();
        assert!(alarms <= 6, "{alarms} of 200");
        let biased = |seed: u64| -> Vec<f64> { white(seed).iter().map(|e| e + 0.1).collect() };
        let found = gain_of_the_mean(&biased(7));
        assert!(found > 50.0, "{found} of 100");
    }

    /// A gain from slow cosines that is lost at other frequencies is no gain.
    #[test]
    fn what_imitates_a_walk_gains_nothing() {
        let series = walking(0.7, 11);
        let mean = series.iter().sum::<f64>() / N as f64;
        let column = |t: usize| 1.0 + 0.7 * (0.05 * t as f64).sin();
        let left: Vec<f64> = series.iter().enumerate().map(|(t, x)| x - 0.8 * mean * column(t)).collect();
        let segments = [0..N];
        let noise = Noise::of(&left, N, &segments, 1);
        assert!(dot(&series, &series) - dot(&left, &left) > 100.0);
        let found = noise.energy(&series) - noise.energy(&left);
        assert!(found < 0.0, "{found}");
    }

    #[test]
    fn what_is_faster_counts_in_full() {
        let (left, drift) = (white(3), walking(0.5, 3));
        let taken = |t: usize| 0.1 * (0.05 * t as f64).sin();
        let before: Vec<f64> = left.iter().enumerate().map(|(t, x)| x + taken(t)).collect();
        let segments = [0..N];
        let noise = Noise::of(&drift, N, &segments, 1);
        assert!(noise.wanders());
        let found = noise.energy(&before) - noise.energy(&left);
        assert!((found / 50.0 - 1.0).abs() < 0.3, "{found}");
        assert_eq!(Noise::of(&vec![0.0; N], N, &segments, 1).energy(&before), 0.0);
    }

    /// A straight line fits the drift of one channel; two further drifting channels reveal it as drift.
    #[test]
    fn channels_alike_walk_alike() {
        let segments = [0..N];
        let line = |t: usize| 0.5 * t as f64 / N as f64;
        let left = [white(21), walking(0.5, 22), walking(0.5, 23)].concat();
        let before: Vec<f64> = (0..3 * N).map(|t| left[t] + if t < N { line(t) } else { 0.0 }).collect();
        let gain = |alike| {
            let noise = Noise::of(&left, N, &segments, alike);
            noise.energy(&before) - noise.energy(&left)
        };
        assert!(gain(0) > 200.0 && gain(3) < 50.0, "{} {}", gain(0), gain(3));
    }

    /// Noise with a correlation time of 50 ms at 2 ms per sample has equal variance at all slow cosines: no drift is
    /// found.
    #[test]
    fn a_memory_is_no_walk() {
        let a = (-2.0f64 / 50.0).exp();
        let walks = (0..50).filter(|seed| {
            let mut now = 0.0;
            let series: Vec<f64> = white(100 + seed)
                .iter()
                .map(|e| {
                    now = a * now + e;
                    now
                })
                .collect();
            let segments = [0..N];
            Noise::of(&series, N, &segments, 1).channels[0].lambda > 20.0
        });
        let walks = walks.count();
        assert!(walks <= 5, "{walks} of 50");
    }

    /// Two channels share a parameter and the first drifts: ordinary least squares bias the second.
    #[test]
    fn what_does_not_walk_decides() {
        let segments = [0..N];
        let column: Vec<f64> = (0..2 * N).map(|t| if t < N { 1.0 } else { (0.02 * t as f64).sin() }).collect();
        let mut series = walking(2.0, 5);
        series.extend(white(6).iter().zip(&column[N..]).map(|(e, x)| e + 0.3 * x));
        let coefficient = |noise: &Noise| {
            let left = noise.least_squares(&series, &[&column]);
            (series[0] - left[0]) / column[0]
        };
        let ordinary = Noise::of(&[white(1), white(2)].concat(), N, &segments, 1);
        let general = Noise::of(&series, N, &segments, 1);
        let (ordinary, general) = (coefficient(&ordinary), coefficient(&general));
        // Standard deviation from the second channel alone: √(2/N).
        assert!((ordinary - 0.3).abs() > 0.1, "{ordinary}");
        assert!((general - 0.3).abs() < 3.0 * (2.0 / N as f64).sqrt(), "{general}");
    }
}
