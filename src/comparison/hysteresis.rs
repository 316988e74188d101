//! Hysteresis of a residual: a force that turns with the direction of motion over a distance, not at once.
//!
//! Friction and backlash of gears and seals build up over the first part of each stroke after a reversal
//! [Swevers 2000]. The residual along the motion, s·r with s the direction, is then a function of the distance since the
//! reversal other than a constant, which would be friction.

use std::ops::Range;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::numerics::median;

/// Number of bins along the distance, with as many samples each.
const BINS: usize = 24;
/// Least number of strokes, of samples of a stroke, and of samples of a bin.
const LEAST: (usize, usize, usize) = (8, 4, 16);
/// Rate, relative to the largest, that a stroke must reach: at rest the direction is noise.
const MOVES: f64 = 0.02;
/// Number of draws in which strokes change the sign of their residual: with all of them below, p < 1/200.
const DRAWS: usize = 199;
const SEED: u64 = 20;

/// Hysteresis of a residual.
pub struct Hysteresis {
    /// Share of the mean square that occurs in every other stroke as in those between.
    pub share: f64,
    /// Residual along the motion in the first bin and far from the reversal.
    pub along: [f64; 2],
    /// Distance over which half of the change has happened, in the unit of the positions.
    pub distance: f64,
    /// Residual without it.
    pub rest: Vec<f64>,
}

/// A stroke between two reversals.
struct Stroke {
    samples: Range<usize>,
    direction: f64,
}

/// Hysteresis of `r` over the `position` with the given `rate`, in segments without gaps; `None` if the residual is not
/// one beyond chance.
///
/// Under the null hypothesis the residual of each stroke may as well have the other sign, whatever memory it has: the
/// share must exceed those of [`DRAWS`] draws of signs.
pub fn hysteresis(position: &[f64], rate: &[f64], r: &[f64], segments: &[Range<usize>]) -> Option<Hysteresis> {
    let strokes = strokes(rate, segments);
    if strokes.len() < LEAST.0 {
        return None;
    }
    let distance = |stroke: &Stroke, k: usize| (position[k] - position[stroke.samples.start]).abs();
    let mut all: Vec<f64> = strokes.iter().flat_map(|s| s.samples.clone().map(move |k| distance(s, k))).collect();
    all.sort_by(f64::total_cmp);
    let edges: Vec<f64> = (1..BINS).map(|b| all[b * all.len() / BINS]).collect();
    let bin = |d: f64| edges.partition_point(|e| *e <= d);
    let sums: Vec<Sums> = strokes.iter().map(|s| Sums::of(s, r, &|k| bin(distance(s, k)))).collect();
    let total: f64 = r.iter().map(|v| v * v).sum();
    let found = common(&sums, &vec![1.0; sums.len()]);
    let share = found.energy / total.max(f64::MIN_POSITIVE);
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let by_chance = |_| {
        let signs: Vec<f64> = sums.iter().map(|_| if rng.random::<bool>() { 1.0 } else { -1.0 }).collect();
        common(&sums, &signs).energy >= found.energy
    };
    if share <= 0.0 || (0..DRAWS).any(by_chance) {
        return None;
    }
    let mut rest = r.to_vec();
    for stroke in &strokes {
        for k in stroke.samples.clone() {
            rest[k] -= stroke.direction * (found.means[bin(distance(stroke, k))] - found.mean);
        }
    }
    let far = median(found.means[BINS / 2..].iter().copied());
    let (first, half) = (found.means[0], 0.5 * (found.means[0] + far));
    let turned = found.means.iter().position(|m| (m - half) * (far - first) > 0.0).unwrap_or(0);
    Some(Hysteresis { share, along: [first, far], distance: edges[turned.min(BINS - 2)], rest })
}

/// Strokes that move, between two reversals each.
fn strokes(rate: &[f64], segments: &[Range<usize>]) -> Vec<Stroke> {
    let fastest = rate.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
    let mut found = Vec::new();
    for segment in segments {
        let reversal = |k: &usize| (rate[k - 1] < 0.0) != (rate[*k] < 0.0);
        // The first part of a segment did not begin at a reversal.
        let ends: Vec<usize> = (segment.start + 1..segment.end).filter(reversal).chain([segment.end]).collect();
        for ends in ends.windows(2) {
            let samples = ends[0]..ends[1];
            let moves = rate[samples.clone()].iter().any(|v| v.abs() > MOVES * fastest);
            if moves && samples.len() >= LEAST.1 {
                found.push(Stroke { direction: if rate[samples.start] < 0.0 { -1.0 } else { 1.0 }, samples });
            }
        }
    }
    found
}

/// Sums of one stroke per bin.
struct Sums {
    along: [f64; BINS],
    counts: [usize; BINS],
}

impl Sums {
    fn of(stroke: &Stroke, r: &[f64], bin: &dyn Fn(usize) -> usize) -> Self {
        let mut sums = Self { along: [0.0; BINS], counts: [0; BINS] };
        for k in stroke.samples.clone() {
            let bin = bin(k);
            sums.along[bin] += stroke.direction * r[k];
            sums.counts[bin] += 1;
        }
        sums
    }
}

/// What two halves of the strokes have in common.
struct Common {
    /// Sum over the bins of the product of both halves' means about their own mean.
    energy: f64,
    means: [f64; BINS],
    /// Mean over all bins.
    mean: f64,
}

/// What pairs of strokes have in common with the others, with the residual of each stroke multiplied by its sign. A pair,
/// to and fro, belongs to one half.
fn common(strokes: &[Sums], signs: &[f64]) -> Common {
    let (mut sums, mut counts) = ([[0.0; 2]; BINS], [[0usize; 2]; BINS]);
    for (k, (stroke, sign)) in strokes.iter().zip(signs).enumerate() {
        let half = k / 2 % 2;
        for b in 0..BINS {
            sums[b][half] += sign * stroke.along[b];
            counts[b][half] += stroke.counts[b];
        }
    }
    let used: Vec<usize> = (0..BINS).filter(|&b| counts[b].iter().all(|c| *c >= LEAST.2)).collect();
    let weight = |b: usize| (counts[b][0] + counts[b][1]) as f64;
    let whole: f64 = used.iter().map(|&b| weight(b)).sum::<f64>().max(1.0);
    let of = |b: usize, half: usize| sums[b][half] / counts[b][half] as f64;
    let mean = [0, 1].map(|half| used.iter().map(|&b| weight(b) * of(b, half)).sum::<f64>() / whole);
    let energy = used.iter().map(|&b| weight(b) * (of(b, 0) - mean[0]) * (of(b, 1) - mean[1])).sum();
    let both = 0.5 * (mean[0] + mean[1]);
    let mut means = [both; BINS];
    for &b in &used {
        means[b] = (sums[b][0] + sums[b][1]) / weight(b);
    }
    Common { energy, means, mean: both }
}

#[cfg(test)]
mod tests {
    use rand_distr::{Distribution, StandardNormal};

    use super::*;

    const N: usize = 20_000;

    /// Position and rate of an axis along three sines at 1 kHz.
    fn motion() -> [Vec<f64>; 2] {
        let sum = |of: &dyn Fn(f64, f64) -> f64| of(0.5, 3.1) + of(0.3, 7.3) + of(0.05, 17.0);
        let at = |k: usize| k as f64 * 1e-3;
        let position = (0..N).map(|k| sum(&|a, w| a * (w * at(k)).sin())).collect();
        [position, (0..N).map(|k| sum(&|a, w| a * w * (w * at(k)).cos())).collect()]
    }

    /// Noise with a memory of 50 samples and a standard deviation of 1.
    fn noise(seed: u64) -> Vec<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut last = 0.0;
        let mut next = || {
            let fresh: f64 = StandardNormal.sample(&mut rng);
            last = 0.98 * last + 0.199 * fresh;
            last
        };
        (0..N).map(|_| next()).collect()
    }

    /// The branch of a Prandtl element of yield distance `yield_at`: a spring that slips at ±1.
    fn slipping(position: &[f64], yield_at: f64) -> Vec<f64> {
        let mut state = 0.0;
        let mut last = position[0];
        let next = |q: &f64| {
            state = f64::clamp(state + (q - last) / yield_at, -1.0, 1.0);
            last = *q;
            state
        };
        position.iter().map(next).collect()
    }

    fn found(r: &[f64]) -> Option<Hysteresis> {
        let [position, rate] = motion();
        hysteresis(&position, &rate, r, std::slice::from_ref(&(0..N)))
    }

    #[test]
    fn a_force_that_turns_over_a_distance_is_found_with_its_distance() {
        let [position, _] = motion();
        // From −2 to 2 over 2·0.1 rad: half of it after 0.1 rad.
        let clean = slipping(&position, 0.1);
        let r: Vec<f64> = clean.iter().zip(noise(1)).map(|(h, e)| 2.0 * h + e).collect();
        let found = found(&r).expect("hysteresis");
        assert!((0.05..0.15).contains(&found.distance), "{}", found.distance);
        assert!(found.along[0] < -1.0 && found.along[1] > 1.5, "{:?}", found.along);
        // Beside the constant part, which is friction, and noise of variance 1.
        assert!(found.share > 0.15, "{}", found.share);
        let square = |x: &[f64]| x.iter().map(|v| v * v).sum::<f64>();
        assert!(square(&found.rest) < (1.0 - 0.9 * found.share) * square(&r));
    }

    #[test]
    fn noise_with_memory_and_friction_are_none() {
        let [_, rate] = motion();
        let mut false_alarms = 0;
        for seed in 1..=60 {
            let friction = rate.iter().zip(noise(seed)).map(|(v, e)| e + v.signum()).collect::<Vec<_>>();
            false_alarms += [noise(seed), friction].iter().filter(|r| found(r).is_some_and(|h| h.share > 0.02)).count();
        }
        assert!(false_alarms <= 2, "{false_alarms} of 120");
    }
}
