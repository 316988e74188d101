//! Confidence intervals of shares and quantiles.

use statrs::distribution::{Binomial, ContinuousCDF, DiscreteCDF, Normal};

/// Standard normal quantile of a probability between 0 and 1.
pub fn normal_quantile(probability: f64) -> f64 {
    Normal::standard().inverse_cdf(probability)
}

/// Standard normal distribution function Φ.
pub(super) fn normal_cdf(x: f64) -> f64 {
    Normal::standard().cdf(x)
}

/// Confidence interval `[low, high]` of the probability behind `count` successes in `of` trials [Wilson 1927]; `[0, 1]`
/// without trials.
///
/// `confidence` is two-sided, such as 0.95.
pub fn wilson(count: usize, of: usize, confidence: f64) -> [f64; 2] {
    if of == 0 {
        return [0.0, 1.0];
    }
    let z = normal_quantile(0.5 + 0.5 * confidence);
    let (n, p) = (of as f64, count as f64 / of as f64);
    let middle = (p + z * z / (2.0 * n)) / (1.0 + z * z / n);
    let half = z / (1.0 + z * z / n) * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
    // Exact at the ends, where the difference of two roundings would remain.
    let low = if count == 0 { 0.0 } else { (middle - half).max(0.0) };
    let high = if count >= of { 1.0 } else { (middle + half).min(1.0) };
    [low, high]
}

/// Quantile of `values` at a probability, linear between order statistics (type 7 of [Hyndman 1996]); `None` without
/// values or with NaN among them.
pub fn quantile(values: &[f64], probability: f64) -> Option<f64> {
    let sorted = sorted(values)?;
    let at = probability.clamp(0.0, 1.0) * (sorted.len() - 1) as f64;
    let (k, rest) = (at.floor() as usize, at.fract());
    let next = sorted[(k + 1).min(sorted.len() - 1)];
    Some(if rest > 0.0 { sorted[k] + rest * (next - sorted[k]) } else { sorted[k] })
}

/// Confidence interval of the quantile of a distribution of which `values` are independent draws, from order
/// statistics alone [David 2003, section 7.1]; an end that the number of draws cannot bound is infinite. `None`
/// without values or with NaN among them.
pub fn order_interval(values: &[f64], probability: f64, confidence: f64) -> Option<[f64; 2]> {
    let sorted = sorted(values)?;
    let below = Binomial::new(probability.clamp(0.0, 1.0), sorted.len() as u64).ok()?;
    let tail = 0.5 - 0.5 * confidence;
    // The k-th smallest value, k from 1, lies above the quantile with the probability of fewer than k draws below it.
    let low = (1..=sorted.len()).rev().find(|k| below.cdf(*k as u64 - 1) <= tail);
    let high = (1..=sorted.len()).find(|k| below.cdf(*k as u64 - 1) >= 1.0 - tail);
    Some([low.map_or(f64::NEG_INFINITY, |k| sorted[k - 1]), high.map_or(f64::INFINITY, |k| sorted[k - 1])])
}

fn sorted(values: &[f64]) -> Option<Vec<f64>> {
    if values.is_empty() || values.iter().any(|v| v.is_nan()) {
        return None;
    }
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    Some(sorted)
}
