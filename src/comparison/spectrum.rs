//! Spectrum of a residual: frequencies above the white noise level.

use std::ops::Range;

use crate::numerics::fourier;

/// Least number of samples for a spectrum.
const MIN_SAMPLES: usize = 1000;
/// Number of spectral lines on either side that belong to a peak.
const WIDTH: usize = 2;

/// Features of a spectrum.
pub struct Spectrum {
    /// Frequency of the highest line, Hz, and the share of the variance in it and its neighbours above the white
    /// level.
    pub peak: (f64, f64),
    /// Frequency below which nine tenths of the coloured part lies, Hz, and the share of the coloured part.
    pub coloured: (f64, f64),
}

/// Spectrum of the longest of `segments` without its mean; `None` if it is too short.
pub fn spectrum(series: &[f64], segments: &[Range<usize>], dt: f64) -> Option<Spectrum> {
    let segment = segments.iter().max_by_key(|s| s.len())?;
    let mut x = series.get(segment.clone())?.to_vec();
    let n = x.len();
    if n < MIN_SAMPLES || dt <= 0.0 {
        return None;
    }
    let mean = x.iter().sum::<f64>() / n as f64;
    x.iter_mut().for_each(|v| *v -= mean);
    let power = fourier::power(x);
    let total: f64 = power.iter().sum();
    let mut sorted = power.clone();
    let middle = sorted.len() / 2;
    // The median of an exponential distribution is ln 2 times its mean.
    let white = *sorted.select_nth_unstable_by(middle, f64::total_cmp).1 / std::f64::consts::LN_2;
    let at = |line: usize| line as f64 / (n as f64 * dt);
    let excess = (total - white * power.len() as f64).max(0.0);
    let highest = (0..power.len()).max_by(|&a, &b| power[a].total_cmp(&power[b]))?;
    let near = highest.saturating_sub(WIDTH)..(highest + WIDTH + 1).min(power.len());
    let in_peak: f64 = power[near].iter().map(|p| p - white).sum();
    let mut sum = 0.0;
    let edge = power.iter().position(|p| {
        sum += p - white;
        sum >= 0.9 * excess
    })?;
    if total <= 0.0 {
        return None;
    }
    Some(Spectrum { peak: (at(highest), in_peak.max(0.0) / total), coloured: (at(edge), excess / total) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tone_is_found_at_its_frequency() {
        let tone = |k: usize| (2.0 * std::f64::consts::PI * 37.0 * k as f64 * 1e-3).sin();
        // Uniform within ±0.5: variance 1/12 in addition to the tone's 1/2, so the tone has 6/7 of the variance.
        let hash = |k: usize| ((k as f64 * 12.9898).sin() * 43758.5453).rem_euclid(1.0) - 0.5;
        let series: Vec<f64> = (0..8000).map(|k| tone(k) + hash(k) + 3.0).collect();
        let found = spectrum(&series, std::slice::from_ref(&(0..8000)), 1e-3).unwrap();
        assert!((found.peak.0 - 37.0).abs() < 0.2 && (found.peak.1 - 6.0 / 7.0).abs() < 0.03, "{:?}", found.peak);
    }
}
