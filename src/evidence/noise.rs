//! Nonparametric noise estimates: from differences, from intervals at rest, and the autocorrelation time.

use std::ops::Range;

use nalgebra::DMatrix;

/// Number of differences over which the noise level is taken as constant.
const STRETCH: usize = 500;

/// Φ⁻¹(3/4): median absolute value of a standard normal variable.
pub const NORMAL_QUARTILE: f64 = 0.674_489_750_196_081_7;

/// Standard deviation of white measurement noise on a smooth signal, from the median absolute difference of the given
/// order; `None` when no segment is longer than the order. It is the RMS over short intervals, because noise may grow
/// with speed and the median over all samples would reflect slow motion only.
///
/// A difference of order d passes frequency f with gain `(2 sin(π f T))^d / √C(2d, d)`: order 6 at 2.5 kHz passes
/// 2e-6 of an 80 Hz component. Jumps, as of Coulomb friction, are few, and the median is robust against them.
///
/// The estimate refers to the noise near half the sampling frequency. For noise with autocorrelation ρ it is `σ·√(Σ_k
/// (−1)^k·C(2d, d + k)·ρ_k / C(2d, d))`: for AR(1) noise with coefficient a about `σ·√((1 − a)/(1 + a))`, 0.92 σ at a
/// = 0.1 and 0.61 σ at a = 0.5 for order 4. [`covariance`] at rest has no such bias.
pub fn difference_sigma(series: &[f64], segments: &[Range<usize>], order: usize) -> Option<f64> {
    let mut differences = Vec::new();
    for s in segments {
        let mut d = series.get(s.clone())?.to_vec();
        for _ in 0..order {
            d = d.windows(2).map(|w| w[1] - w[0]).collect();
        }
        differences.append(&mut d);
    }
    // Σ_k C(d, k)² = C(2d, d)
    let norm = (1..=order).fold(1.0, |c, k| c * (order + k) as f64 / k as f64).sqrt();
    if differences.is_empty() || differences.iter().any(|x| !x.is_finite()) {
        return None;
    }
    let rms = (differences.iter().map(|x| x * x).sum::<f64>() / differences.len() as f64).sqrt() / norm;
    differences.iter_mut().for_each(|x| *x = x.abs());
    let count = (differences.len() / STRETCH).max(1);
    let size = differences.len().div_ceil(count);
    let squares = differences.chunks_mut(size).map(|stretch| {
        let middle = stretch.len() / 2;
        let median = *stretch.select_nth_unstable_by(middle, f64::total_cmp).1;
        stretch.len() as f64 * (median / (norm * NORMAL_QUARTILE)).powi(2)
    });
    let squares: f64 = squares.sum();
    // A signal mostly at rest, or a coarse quantiser, has median zero; its RMS is an upper bound.
    Some(if squares > 0.0 { (squares / differences.len() as f64).sqrt() } else { rms })
}

/// Covariance of white noise on smooth series, robust like [`difference_sigma`]: for x and y in units of their
/// standard deviations, the correlation is (var(x + y) − var(x − y))/4 [Gnanadesikan 1972].
pub fn difference_covariance(series: &[Vec<f64>], segments: &[Range<usize>], order: usize) -> Option<DMatrix<f64>> {
    let sigma: Vec<f64> = series.iter().map(|x| difference_sigma(x, segments, order)).collect::<Option<Vec<f64>>>()?;
    let mut out = DMatrix::zeros(series.len(), series.len());
    for i in 0..series.len() {
        out[(i, i)] = sigma[i] * sigma[i];
        for j in (0..i).filter(|&j| sigma[i] > 0.0 && sigma[j] > 0.0) {
            let variance = |sign: f64| {
                let pairs = series[i].iter().zip(&series[j]);
                let mixed: Vec<f64> = pairs.map(|(x, y)| x / sigma[i] + sign * y / sigma[j]).collect();
                difference_sigma(&mixed, segments, order).map(|s| s * s)
            };
            let correlation = 0.25 * (variance(1.0)? - variance(-1.0)?);
            out[(i, j)] = correlation * sigma[i] * sigma[j];
            out[(j, i)] = out[(i, j)];
        }
    }
    Some(out)
}

/// Intervals of at least `shortest` samples in which every series stays within a band of the width of its
/// `tolerance`.
pub fn rests(series: &[Vec<f64>], segments: &[Range<usize>], tolerance: &[f64], shortest: usize) -> Vec<Range<usize>> {
    let mut out = Vec::new();
    for segment in segments {
        let mut start = segment.start;
        let mut bands = vec![(f64::INFINITY, f64::NEG_INFINITY); series.len()];
        for k in segment.clone() {
            let wider = |(band, x): (&(f64, f64), &Vec<f64>)| (band.0.min(x[k]), band.1.max(x[k]));
            let next: Vec<(f64, f64)> = bands.iter().zip(series).map(wider).collect();
            if next.iter().zip(tolerance).all(|(band, tolerance)| band.1 - band.0 <= *tolerance) {
                bands = next;
            } else {
                out.push(start..k);
                start = k;
                bands = series.iter().map(|x| (x[k], x[k])).collect();
            }
        }
        out.push(start..segment.end);
    }
    out.retain(|r| r.len() >= shortest.max(1));
    out
}

/// Pooled covariance of series about their mean in each interval: Σ (x − x̄)(x − x̄)ᵀ/(samples − intervals).
pub fn covariance(series: &[Vec<f64>], stretches: &[Range<usize>]) -> Option<DMatrix<f64>> {
    let mut sum = DMatrix::zeros(series.len(), series.len());
    let samples: usize = stretches.iter().map(Range::len).sum();
    for stretch in stretches {
        let centred = |x: &Vec<f64>| {
            let x = &x[stretch.clone()];
            let mean = x.iter().sum::<f64>() / x.len() as f64;
            x.iter().map(|v| v - mean).collect::<Vec<f64>>()
        };
        let all: Vec<Vec<f64>> = series.iter().map(centred).collect();
        for i in 0..all.len() {
            for j in 0..=i {
                sum[(i, j)] += super::gram::dot(&all[i], &all[j]);
            }
        }
    }
    sum.fill_upper_triangle_with_lower_triangle();
    (samples > stretches.len()).then(|| sum / (samples - stretches.len()) as f64)
}

/// Integrated autocorrelation time in samples, at least one (1 for white noise), of a series in segments.
///
/// The sum over lags stops at the first lag beyond five times the running value [Sokal 1997].
pub fn correlation_time(segments: &[Vec<f64>]) -> f64 {
    let covariance = |lag: usize| -> f64 {
        segments.iter().filter(|s| s.len() > lag).map(|s| super::gram::dot(&s[lag..], &s[..s.len() - lag])).sum()
    };
    let n: usize = segments.iter().map(Vec::len).sum();
    let zero = covariance(0);
    if zero.is_nan() || zero <= 0.0 {
        return 1.0;
    }
    let mut time = 1.0;
    for lag in 1..=n / 20 {
        time += 2.0 * covariance(lag) / zero;
        if lag as f64 >= 5.0 * time {
            break;
        }
    }
    time.max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    fn white(n: usize, seed: u64) -> Vec<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        (0..n).map(|_| StandardNormal.sample(&mut rng)).collect()
    }

    /// Torque-like signal: 3 and 60 Hz with jumps. The relative standard error of the median of 50 000 differences of
    /// order 6, whose correlations contribute a factor of about 1.6, is 0.83 %; 3 % is over three standard errors.
    #[test]
    fn difference_sigma_within_three_percent() {
        for seed in 0..10 {
            let noise = white(50_000, seed);
            let y: Vec<f64> = (0..50_000)
                .map(|i| {
                    let t = i as f64 / 2500.0;
                    let jump = if (3.0 * t).sin() > 0.0 { 2.0 } else { -2.0 };
                    40.0 * (19.0 * t).sin() + 5.0 * (377.0 * t).cos() + jump + 0.03 * noise[i]
                })
                .collect();
            let s = difference_sigma(&y, &[0..20_000, 20_000..50_000], 6).unwrap();
            assert!((s / 0.03 - 1.0).abs() < 0.03, "{s}");
        }
        assert_eq!(difference_sigma(&[1.0; 4], &[0..4], 6), None);
        assert_eq!(difference_sigma(&[1.0; 40], &[0..40], 6), Some(0.0));
    }

    /// σ = 2·|sin|, of RMS √2.
    #[test]
    fn noise_that_grows_with_speed_counts_in_full() {
        let wave = |k: usize| (k as f64 * 2e-4).sin().abs();
        let x: Vec<f64> = white(50_000, 3).iter().enumerate().map(|(k, e)| 2.0 * wave(k) * e).collect();
        let sigma = difference_sigma(&x, std::slice::from_ref(&(0..50_000)), 4).unwrap();
        assert!((sigma / 2f64.sqrt() - 1.0).abs() < 0.02, "{sigma}");
    }

    /// Correlated noise at rest and a smooth motion between the rests. Relative standard errors: 1/√(2·8000) = 0.8 % at
    /// rest, about 1 % from differences; correlations 0.011 and 0.02.
    #[test]
    fn covariance_at_rest_and_from_differences_agree() {
        let n = 16_000;
        let noise = [white(n, 21), white(n, 22)];
        let moves = |k: usize| (k / 2000) % 2 == 1;
        let angle = |k: usize| (k / 4000) as f64 + if moves(k) { ((k % 2000) as f64 / 2000.0).powi(2) } else { 0.0 };
        let torque = |k: usize| 30.0 * angle(k);
        let series = vec![
            (0..n).map(|k| torque(k) + 0.4 * noise[0][k]).collect::<Vec<_>>(),
            (0..n).map(|k| -torque(k) + 0.05 * (0.6 * noise[0][k] + 0.8 * noise[1][k])).collect(),
        ];
        let angles = vec![(0..n).map(angle).collect::<Vec<_>>()];
        let rests = rests(&angles, &[0..n], &[1e-4], 200);
        assert_eq!(rests.len(), 4, "{rests:?}");
        let still = covariance(&series, &rests).unwrap();
        let moving = difference_covariance(&series, &[0..n], 4).unwrap();
        for c in [&still, &moving] {
            assert!((c[(0, 0)].sqrt() / 0.4 - 1.0).abs() < 0.04, "{c}");
            assert!((c[(1, 1)].sqrt() / 0.05 - 1.0).abs() < 0.04, "{c}");
            assert!((c[(0, 1)] / (c[(0, 0)] * c[(1, 1)]).sqrt() - 0.6).abs() < 0.06, "{c}");
        }
        assert_eq!(covariance(&series, &[]), None);
    }

    #[test]
    fn differences_see_the_stated_share_of_autocorrelated_noise() {
        for (a, share) in [(0.1, 0.92), (0.5, 0.61)] {
            let mut x = white(100_000, 31);
            for t in 1..x.len() {
                x[t] += a * x[t - 1];
            }
            let sigma = (1.0f64 - a * a).sqrt().recip();
            let ratio = difference_sigma(&x, &[0..x.len()], 4).unwrap() / sigma;
            assert!((ratio / share - 1.0).abs() < 0.02, "{a}: {ratio}");
        }
    }

    /// AR(1) with coefficient a has time (1 + a)/(1 − a) = 9; the estimate's relative error is about √(4·W/n) = 4 %.
    #[test]
    fn correlation_time_of_ar1() {
        let mut x = white(100_000, 3);
        for t in 1..x.len() {
            x[t] += 0.8 * x[t - 1];
        }
        assert!((correlation_time(&[x]) - 9.0).abs() < 1.5);
        assert!((correlation_time(&[white(100_000, 4)]) - 1.0).abs() < 0.1);
        assert_eq!(correlation_time(&[]), 1.0);
    }
}
