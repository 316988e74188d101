//! Whitening with one autoregression per channel, order by BIC, fitted with Burg's recursion over all segments at
//! once.

use std::ops::Range;

/// Smallest innovation variance relative to the variance of the series. An almost noise-free residual is the missing
/// effect itself, which a filter that predicts it would remove.
const LEAST_INNOVATION: f64 = 1e-3;

/// `e(t) = Σ_k a_k e(t−k) + σ w(t)` with white w.
#[derive(Clone, Debug, PartialEq)]
pub struct ArFilter {
    /// Coefficients a_1…a_p.
    pub coefficients: Vec<f64>,
    /// Standard deviation of the innovations; zero marks a channel that is not used.
    pub sigma: f64,
}

impl ArFilter {
    /// Filter of order zero, which divides by `sigma`.
    pub fn scale(sigma: f64) -> Self {
        Self { coefficients: Vec::new(), sigma }
    }

    /// Order of the autoregression.
    pub fn order(&self) -> usize {
        self.coefficients.len()
    }

    /// Whitened samples `range` of `series`; `range.start` is at least the order. A channel that is not used gives zeros.
    pub fn apply(&self, series: &[f64], range: Range<usize>, out: &mut [f64]) {
        if self.sigma.is_nan() || self.sigma <= 0.0 {
            out.fill(0.0);
            return;
        }
        let g = 1.0 / self.sigma;
        for (o, x) in out.iter_mut().zip(&series[range.clone()]) {
            *o = g * x;
        }
        for (k, a) in self.coefficients.iter().enumerate() {
            let c = a * g;
            let past = &series[range.start - k - 1..range.end - k - 1];
            for (o, x) in out.iter_mut().zip(past) {
                *o -= c * x;
            }
        }
    }

    /// Fit by Burg's recursion to the series minus its mean; the order up to `max_order` has the smallest BIC.
    /// Segments too short for the largest order are left out; the order is limited to an eighth of the longest
    /// segment.
    pub fn fit(series: &[f64], segments: &[Range<usize>], max_order: usize) -> Self {
        let longest = segments.iter().map(ExactSizeIterator::len).max().unwrap_or(0);
        let max_order = max_order.min(longest / 8);
        let kept: Vec<&[f64]> =
            segments.iter().filter(|s| s.len() > 2 * max_order).map(|s| &series[s.start..s.end]).collect();
        let n: usize = kept.iter().map(|s| s.len()).sum();
        // A constant belongs to a bias, not to the noise: included, it would give a root near one, which whitens the
        // bias away.
        let mean = kept.iter().flat_map(|s| s.iter()).sum::<f64>() / n.max(1) as f64;
        let mut variance =
            kept.iter().flat_map(|s| s.iter()).map(|x| (x - mean).powi(2)).sum::<f64>() / n.max(1) as f64;
        if variance.is_nan() || variance <= 0.0 {
            return Self::scale(0.0);
        }
        let mut forward: Vec<Vec<f64>> = kept.iter().map(|s| s.iter().map(|x| x - mean).collect()).collect();
        let mut backward = forward.clone();
        let mut a: Vec<f64> = Vec::new();
        let least = LEAST_INNOVATION * variance;
        let mut best = (n as f64 * variance.ln(), Self::scale(variance.sqrt()));
        for order in 1..=max_order {
            let (mut cross, mut power) = (0.0, 0.0);
            for (f, b) in forward.iter().zip(&backward) {
                for (x, y) in f[order..].iter().zip(&b[order - 1..f.len() - 1]) {
                    cross += x * y;
                    power += x * x + y * y;
                }
            }
            if power.is_nan() || power <= 0.0 {
                break;
            }
            // Limit the last reflection to the least innovation.
            let room = (1.0 - least / variance).max(0.0).sqrt();
            let reflection = (2.0 * cross / power).clamp(-room, room);
            let next: Vec<f64> = (0..a.len()).map(|i| a[i] - reflection * a[a.len() - 1 - i]).collect();
            a = next;
            a.push(reflection);
            variance *= 1.0 - reflection * reflection;
            for (f, b) in forward.iter_mut().zip(&mut backward) {
                for t in (order..f.len()).rev() {
                    let (x, y) = (f[t], b[t - 1]);
                    f[t] = x - reflection * y;
                    b[t] = y - reflection * x;
                }
            }
            let bic = n as f64 * variance.ln() + order as f64 * (n as f64).ln();
            if bic < best.0 {
                best = (bic, Self { coefficients: a.clone(), sigma: variance.sqrt() });
            }
        }
        best.1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    /// Standard error of an AR coefficient at n = 20 000 is below 1/√n = 0.007; four of them are allowed.
    #[test]
    fn recovers_second_order() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut x = vec![0.0; 20_000];
        for t in 2..x.len() {
            let w: f64 = StandardNormal.sample(&mut rng);
            x[t] = 1.2 * x[t - 1] - 0.5 * x[t - 2] + 0.3 * w;
        }
        let f = ArFilter::fit(&x, &[0..9_000, 9_000..20_000], 12);
        assert!(f.order() >= 2);
        assert!((f.coefficients[0] - 1.2).abs() < 0.03 && (f.coefficients[1] + 0.5).abs() < 0.03, "{f:?}");
        assert!((f.sigma - 0.3).abs() < 0.006);
    }

    #[test]
    fn a_constant_is_not_whitened_away() {
        let mut rng = ChaCha8Rng::seed_from_u64(6);
        let x: Vec<f64> = (0..5000)
            .map(|_| {
                let w: f64 = StandardNormal.sample(&mut rng);
                20.0 + w
            })
            .collect();
        let f = ArFilter::fit(&x, &[0..5000], 12);
        let mut e = vec![0.0; 4900];
        f.apply(&x, 100..5000, &mut e);
        let mean = e.iter().sum::<f64>() / 4900.0;
        assert!((mean - 20.0).abs() < 2.0, "{mean} {f:?}");
    }

    #[test]
    fn survives_degenerate_series() {
        assert_eq!(ArFilter::fit(&[0.0; 50], &[0..50], 12).sigma, 0.0);
        assert_eq!(ArFilter::fit(&[], &[], 12).sigma, 0.0);
        let constant = ArFilter::fit(&[2.0; 50], &[0..50, 50..50], 12);
        assert!(constant.sigma.is_finite() && constant.coefficients.iter().all(|a| a.is_finite()));
        assert!(ArFilter::fit(&[1.0, 2.0], &[0..2], 12).sigma.is_finite());
    }
}
