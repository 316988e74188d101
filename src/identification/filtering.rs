//! Zero-phase local polynomials [Savitzky 1964], and the noise of a series.
//!
//! A polynomial of degree 4 is fitted to the samples −m…m around each sample; its value and derivatives in the middle
//! have zero phase. The half width m is the smallest one with acceptable encoder noise in the acceleration. At the
//! smallest width, m = 3, a polynomial of degree 6 interpolates the samples: central differences of order 6.

use nalgebra::{DMatrix, DVector};

/// Convolution weights for value, first and second derivative with respect to the sample number.
pub struct Kernel {
    /// Half width in samples.
    pub half_width: usize,
    weights: [DVector<f64>; 3],
}

/// Degree of the fitted polynomial.
const DEGREE: usize = 4;
/// Smallest half width, samples.
pub const MIN_HALF_WIDTH: usize = 3;
/// Largest half width of a polynomial, samples.
pub const MAX_HALF_WIDTH: usize = 60;

impl Kernel {
    /// Kernel over 2m + 1 samples with m = `half_width`, but at least [`MIN_HALF_WIDTH`].
    ///
    /// # Panics
    /// Never: the normal matrix of distinct samples is positive definite.
    pub fn new(half_width: usize) -> Self {
        let m = half_width.max(MIN_HALF_WIDTH);
        let n = 2 * m + 1;
        let scale = m as f64;
        let degree = if m == MIN_HALF_WIDTH { 2 * m } else { DEGREE };
        let a = DMatrix::from_fn(n, degree + 1, |i, j| ((i as f64 - scale) / scale).powi(j as i32));
        let pseudo = (a.transpose() * &a).cholesky().expect("distinct samples").solve(&a.transpose());
        let row = |j: usize, factor: f64| pseudo.row(j).transpose() * factor;
        Self { half_width: m, weights: [row(0, 1.0), row(1, 1.0 / scale), row(2, 2.0 / (scale * scale))] }
    }

    /// Standard deviation of the `derivative`-th derivative per unit of white noise, per sample^derivative.
    pub fn noise_gain(&self, derivative: usize) -> f64 {
        self.weights[derivative].norm()
    }

    /// `derivative`-th derivative with respect to the sample number, at samples m…len−m.
    pub fn apply(&self, derivative: usize, x: &[f64]) -> Vec<f64> {
        let w = self.weights[derivative].as_slice();
        // Differences from the middle sample avoid rounding of large angles.
        x.windows(w.len())
            .map(|v| {
                let origin = v[self.half_width];
                let sum: f64 = v.iter().zip(w).map(|(a, b)| (a - origin) * b).sum();
                if derivative == 0 { origin + sum } else { sum }
            })
            .collect()
    }
}

/// Order of the differences that show the noise of a smooth series.
const ORDER: usize = 6;
/// Rounding of interpolated values, relative to the largest.
const ROUNDING: f64 = 64.0 * f64::EPSILON;

/// Standard deviation of white noise on smooth series, from the median of their sixth differences.
///
/// An encoder at rest shows no noise: differences of zero are ignored, and those over samples that differ by rounding.
pub fn noise_level(series: &[Vec<f64>]) -> f64 {
    /// Binomial coefficient C(2n, n): variance gain of n-th differences.
    const GAIN: f64 = 924.0;
    let largest = series.iter().flatten().fold(0.0f64, |most, x| most.max(x.abs()));
    let mut magnitude = Vec::new();
    for x in series {
        let mut d = x.clone();
        for _ in 0..ORDER {
            d = d.windows(2).map(|w| w[1] - w[0]).collect();
        }
        let moves = x.windows(ORDER + 1).map(|w| w.iter().any(|v| (v - w[0]).abs() > ROUNDING * largest));
        magnitude.extend(d.iter().zip(moves).filter(|(v, moves)| **v != 0.0 && *moves).map(|(v, _)| v.abs()));
    }
    if magnitude.is_empty() {
        return 0.0;
    }
    let m = magnitude.len() / 2;
    // The median of |N(0,1)| is 0.6745.
    *magnitude.select_nth_unstable_by(m, f64::total_cmp).1 / 0.6745 / GAIN.sqrt()
}

/// [`noise_level`] of series at unequal times, from the lower quartile of their sixth divided differences; `series` are
/// times and values.
///
/// Steps may be so long that a start or a stop of the motion lies within one, which differences show as noise; not so the
/// quieter half of the time.
pub fn uneven_noise_level<'a>(series: impl Iterator<Item = (&'a [f64], &'a [f64])> + Clone) -> f64 {
    /// Lower quartile of |N(0,1)|.
    const QUARTILE: f64 = 0.318_639_363_964_375_2;
    let largest = series.clone().flat_map(|(_, x)| x).fold(0.0f64, |most, x| most.max(x.abs()));
    let mut magnitude = Vec::new();
    for (t, x) in series {
        for (t, x) in t.windows(ORDER + 1).zip(x.windows(ORDER + 1)) {
            let span = t[ORDER] - t[0];
            let apart = |k: usize| (0..=ORDER).filter(|j| *j != k).map(|j| (t[k] - t[j]) / span).product::<f64>();
            let weights: [f64; ORDER + 1] = std::array::from_fn(|k| apart(k).recip());
            let norm = weights.iter().map(|w| w * w).sum::<f64>().sqrt();
            magnitude.push((weights.iter().zip(x).map(|(w, v)| w * (v - x[0])).sum::<f64>() / norm).abs());
        }
    }
    if magnitude.is_empty() {
        return 0.0;
    }
    let place = magnitude.len() / 4;
    let quartile = *magnitude.select_nth_unstable_by(place, f64::total_cmp).1;
    (quartile / QUARTILE).max(ROUNDING * largest)
}

/// Smallest half width with an acceleration noise of at most `tolerance`, rad/s², for the angle noise `sigma`, rad,
/// and the step `dt`, s.
///
/// Above [`MAX_HALF_WIDTH`] it is extrapolated: the noise decreases with the half width to the power of 5/2.
pub fn half_width(sigma: f64, dt: f64, tolerance: f64) -> usize {
    let excess = |m: usize| Kernel::new(m).noise_gain(2) * sigma / (dt * dt) / tolerance;
    (MIN_HALF_WIDTH..=MAX_HALF_WIDTH)
        .find(|&m| excess(m) <= 1.0)
        .unwrap_or_else(|| (MAX_HALF_WIDTH as f64 * excess(MAX_HALF_WIDTH).powf(0.4)) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quartics_are_differentiated_exactly() {
        let kernel = Kernel::new(7);
        let f = |t: f64| 3.0 - 2.0 * t + 0.5 * t * t + 0.1 * t.powi(3) - 0.02 * t.powi(4);
        let x: Vec<f64> = (0..40).map(|k| f64::from(k) * 0.1).map(f).collect();
        for k in 0..26 {
            let t = (k + 7) as f64 * 0.1;
            let second = 1.0 + 0.6 * t - 0.24 * t * t;
            approx::assert_relative_eq!(kernel.apply(2, &x)[k] / 0.01, second, epsilon = 1e-9);
            approx::assert_relative_eq!(kernel.apply(0, &x)[k], f(t), epsilon = 1e-12);
        }
    }

    #[test]
    fn quantisation_is_measured_within_a_factor_of_two() {
        // Rounding to a step s has the standard deviation s/√12, but is not exactly white.
        let step = 5.8e-6;
        let x: Vec<f64> = (0..5000).map(|k| ((f64::from(k) * 4e-4 * 2.0).sin() * 0.7 / step).round() * step).collect();
        let sigma = noise_level(&[x]);
        let ratio = sigma / (step / 12f64.sqrt());
        assert!((0.5..2.0).contains(&ratio), "{ratio}");
    }

    #[test]
    fn smooth_signals_have_no_noise() {
        let x: Vec<f64> = (0..5000).map(|k| (f64::from(k) * 4e-4 * 6.0).sin()).collect();
        let sigma = noise_level(&[x]);
        assert!(sigma < 1e-13);
        assert_eq!(half_width(sigma, 4e-4, 0.05), MIN_HALF_WIDTH);
    }
}
