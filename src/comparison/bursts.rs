//! Bursts of a residual: short times in which it is much larger than at others.
//!
//! Contacts, slipping and disturbed sensors come in bursts. The energies of short windows of a stationary residual are
//! nearly gamma distributed, with fewer degrees of freedom the longer its memory and the more its level varies. Both
//! parameters are taken from the quartiles of the windows, which bursts hardly reach.

use std::ops::Range;

use statrs::distribution::{ContinuousCDF, Gamma};

use crate::numerics::bisect;

/// Length of a window, s, and its least number of samples.
const WINDOW: (f64, usize) = (0.05, 20);
/// Least number of windows.
const WINDOWS: usize = 40;
/// Probability that one of the windows of a recording without bursts is above the threshold.
const FALSE_BURST: f64 = 1e-4;
/// Factor on the ratio of the quartiles, for their scatter and for a memory as long as a window: with it, 2 % of residuals
/// with such a memory have a false burst.
const SCATTER: f64 = 0.85;
/// Shapes of the gamma distribution: half the degrees of freedom.
const SHAPES: [f64; 2] = [0.05, 500.0];

/// Bursts of a residual.
pub struct Bursts {
    /// Share of the mean square by which they exceed the usual level.
    pub share: f64,
    /// Number of bursts.
    pub count: usize,
    /// Samples of the strongest one, and the RMS there.
    pub strongest: (Range<usize>, f64),
    /// RMS elsewhere.
    pub usual: f64,
}

/// Bursts of `r`, sampled every `dt` seconds, in segments without gaps; `None` without any.
pub fn bursts(r: &[f64], segments: &[Range<usize>], dt: f64) -> Option<Bursts> {
    let length = ((WINDOW.0 / dt).round() as usize).max(WINDOW.1);
    let windows: Vec<Range<usize>> = segments
        .iter()
        .filter(|s| s.len() >= length)
        .flat_map(|s| (s.start..=s.end - length).step_by(length))
        .map(|k| k..k + length)
        .collect();
    if windows.len() < WINDOWS {
        return None;
    }
    let energy: Vec<f64> = windows.iter().map(|w| r[w.clone()].iter().map(|v| v * v).sum::<f64>()).collect();
    let mut sorted = energy.clone();
    sorted.sort_by(f64::total_cmp);
    let [lower, upper] = [1, 3].map(|part| sorted[part * sorted.len() / 4]);
    let threshold = upper * above_quartile(SCATTER * lower / upper, FALSE_BURST / windows.len() as f64)?;
    let loud: Vec<usize> = (0..windows.len()).filter(|&w| energy[w] > threshold).collect();
    let quiet = energy.iter().filter(|e| **e <= threshold);
    let usual = quiet.clone().sum::<f64>() / quiet.count().max(1) as f64;
    let total: f64 = energy.iter().sum();
    let share = loud.iter().map(|&w| energy[w] - usual).sum::<f64>() / total.max(f64::MIN_POSITIVE);
    // Neighbouring windows are one burst.
    let mut groups: Vec<Range<usize>> = Vec::new();
    for &w in &loud {
        match groups.last_mut() {
            Some(group) if group.end == w && windows[w].start == windows[w - 1].end => group.end = w + 1,
            _ => groups.push(w..w + 1),
        }
    }
    let of = |group: &Range<usize>| energy[group.clone()].iter().sum::<f64>();
    let strongest = groups.iter().max_by(|a, b| of(a).total_cmp(&of(b)))?;
    let samples = windows[strongest.start].start..windows[strongest.end - 1].end;
    let rms = |energy: f64, samples: usize| (energy / samples as f64).sqrt();
    let strongest = (samples.clone(), rms(of(strongest), samples.len()));
    Some(Bursts { share, count: groups.len(), strongest, usual: rms(usual, length) })
}

/// Value that a gamma distributed quantity exceeds with the probability `tail`, relative to its upper quartile, if its lower
/// one has the given `quartiles` ratio to that; `None` for a ratio that is none.
fn above_quartile(quartiles: f64, tail: f64) -> Option<f64> {
    let quantile = |shape: f64, p: f64| Gamma::new(shape, 1.0).map(|g| g.inverse_cdf(p)).ok();
    let ratio = |shape: f64| Some(quantile(shape, 0.25)? / quantile(shape, 0.75)?);
    if !(quartiles > 0.0 && quartiles < 1.0) {
        return None;
    }
    // The ratio grows with the shape.
    let [low, high] = bisect(SHAPES.map(f64::ln), 30, |x| ratio(x.exp()).is_some_and(|r| r < quartiles));
    let shape = (0.5 * (low + high)).exp();
    Some(quantile(shape, 1.0 - tail)? / quantile(shape, 0.75)?)
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;

    const N: usize = 20_000;

    /// Noise at 1 kHz with the standard deviation `level` and the memory of 1/(1 − a) samples.
    fn noise(seed: u64, a: f64, level: impl Fn(f64) -> f64) -> Vec<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut last = 0.0;
        (0..N)
            .map(|k| {
                let fresh: f64 = StandardNormal.sample(&mut rng);
                last = a * last + (1.0 - a * a).sqrt() * fresh;
                level(k as f64 * 1e-3) * last
            })
            .collect()
    }

    fn found(r: &[f64]) -> Option<Bursts> {
        bursts(r, std::slice::from_ref(&(0..N)), 1e-3)
    }

    #[test]
    fn the_quantiles_of_a_gamma_distribution() {
        // Shape 1, exponential: quartiles ln(4/3) and ln 4, tail −ln p.
        let upper = 4f64.ln();
        let tail = above_quartile((4.0f64 / 3.0).ln() / upper, 1e-3).unwrap();
        assert!((tail - 1000f64.ln() / upper).abs() < 1e-3, "{tail}");
    }

    #[test]
    fn bursts_are_found_where_they_are() {
        // Three bursts of 0.1 s with five times the level.
        let starts = [3.0, 9.5, 14.2];
        let r = noise(1, 0.5, |t| if starts.iter().any(|s| (*s..s + 0.1).contains(&t)) { 5.0 } else { 1.0 });
        let found = found(&r).expect("bursts");
        assert_eq!(found.count, 3);
        // 0.3 s of 25 beside 19.7 s of 1: 24·0.3/(19.7 + 7.5) = 0.26.
        assert!((0.15..0.4).contains(&found.share) && (found.usual - 1.0).abs() < 0.05, "{}", found.share);
        let start = found.strongest.0.start as f64 * 1e-3;
        assert!(starts.iter().any(|s| (start - s).abs() < 0.051), "{start}");
    }

    #[test]
    fn noise_of_any_memory_and_of_a_level_that_follows_the_speed_has_none() {
        let mut false_alarms = 0;
        for seed in 1..=40 {
            for a in [0.0, 0.9, 0.98] {
                false_alarms += usize::from(found(&noise(seed, a, |_| 1.0)).is_some_and(|b| b.share > 0.02));
                let speed = |t: f64| 1.0 + (3.0 * t).sin().abs();
                false_alarms += usize::from(found(&noise(seed, a, speed)).is_some_and(|b| b.share > 0.02));
            }
        }
        assert!(false_alarms <= 5, "{false_alarms} of 240, above 2 %");
    }
}
