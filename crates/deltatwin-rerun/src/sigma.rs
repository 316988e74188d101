//! Residuals as the colours show them: means over 20 ms, in standard deviations of such a mean.

use deltatwin::machine::PerAxis;

/// Duration of the means, s.
pub(crate) const BLOCK: f64 = 0.02;

/// What the colours mean.
pub(crate) const LEGEND: &str = "\n**Colours.** Arms, telescope and trail: mean residual over 20 ms in units of σ, the \
    standard deviation of such a mean without a fault; green up to 1 σ, yellow at 3.5 σ, red from 6 σ. Struts and cups: \
    load against hold, grey up to a half, yellow at three quarters, red at the limit; a strut that is off is red.\n";

/// Means of a series over the `block` samples around each of `frames`.
pub(crate) fn means(series: &[f64], frames: &[usize], block: usize) -> Vec<f64> {
    let mean = |&k: &usize| {
        let start = k.saturating_sub(block / 2).min(series.len().saturating_sub(block));
        let window = &series[start..(start + block).min(series.len())];
        window.iter().sum::<f64>() / window.len() as f64
    };
    frames.iter().map(mean).collect()
}

/// Means of every axis over the frames in units of their standard deviations `sigma`, by frame; zero where it is unknown.
pub(crate) fn in_sigma(means: &[Vec<f64>], sigma: &[f64]) -> Vec<PerAxis<f64>> {
    let frames = means.first().map_or(0, Vec::len);
    let of = |frame: usize, axis: usize| match (means.get(axis), sigma.get(axis)) {
        (Some(means), Some(&sigma)) if sigma > 0.0 => means[frame] / sigma,
        _ => 0.0,
    };
    (0..frames).map(|frame| std::array::from_fn(|axis| of(frame, axis))).collect()
}
