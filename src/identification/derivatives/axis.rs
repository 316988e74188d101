//! Smoothing of one axis with the intensities of the noise that are likeliest for its readings.

use std::ops::Range;

use super::{Angles, Grid, Known, Smoothed, no_turns};
use crate::identification::smoother::{
    Likelihood, Samples, WithErrors, smooth, smooth_with_errors, standard_error, width,
};
use crate::numerics::median;

/// Angles of one axis minus the first of each segment, in units of their standard deviation.
pub(super) struct Axis<'a> {
    /// On the grids, if there are any.
    stretches: Vec<Vec<f64>>,
    origins: Vec<f64>,
    sigma: f64,
    dt: f64,
    grids: &'a [Grid],
}

/// Maximum-likelihood noise of the motion.
pub(super) struct Snap {
    /// Intensity of the noise in q⁗.
    intensity: f64,
    /// Variance of the readings.
    variance: f64,
    /// Logarithm of the likelihood.
    pub likelihood: f64,
}

/// A part of a segment: the segment's index and the range of samples.
type Piece = (usize, Range<usize>);

/// Whether q̈ may jump in each step of every segment.
pub(super) type Turns = Vec<Vec<bool>>;

/// Number and length in samples of the pieces, spread over the recording, over which likelihoods are summed …
const PIECES: usize = 24;
const PIECE: usize = 256;
/// … and number of reversals, with the number of samples before and after each.
const REVERSALS: usize = 120;
const BESIDE: usize = 40;
/// Range of the readings of a piece, in standard deviations (three encoder steps), below which it is not used.
const RESTING: f64 = 10.0;
/// Logarithm of the largest intensity of the noise in q⁗, at which readings and motion are unrelated.
const ROUGHEST: f64 = 30.0;
/// Logarithms of the least and largest intensity of the noise in q⃛ at reversals.
pub(super) const JUMP: [f64; 2] = [-30.0, 30.0];
/// Intensity at which the motions before and after a step are unrelated.
const UNRELATED: f64 = 1e4;
/// Longest time scale of the smoother, s: that of an axis at rest; and of samples at unequal times, in sampling periods,
/// as many as that is at 2.5 kHz.
const LONGEST: f64 = 0.01;
const LONGEST_UNEVEN: f64 = 25.0;
/// Gain of the logarithm of the likelihood by which a longer time must be better.
const CLEARLY: f64 = 20.0;
/// Samples discarded at the ends of a segment, in widths of the smoother: inside, standard errors are at most 1.7
/// times those far from the ends.
const MARGIN: f64 = 2.0;
/// The same as a ratio of standard errors, from which a sample at unequal times is left out, unless the error is within
/// the RMS of what it is an error of: an estimate that leaves less open than was open without it is worth having.
const UNKNOWN: f64 = 1.7;

impl<'a> Axis<'a> {
    pub(super) fn new(angles: &'a Angles, axis: usize) -> Self {
        let sigma = angles.sigma[axis];
        let mut stretches: Vec<Vec<f64>> = angles.stretches.iter().map(|s| angles.angles(axis, s)).collect();
        let origins = stretches.iter().map(|s| s.first().copied().unwrap_or(0.0)).collect::<Vec<_>>();
        for (stretch, origin) in stretches.iter_mut().zip(&origins) {
            stretch.iter_mut().for_each(|x| *x = (*x - origin) / sigma);
        }
        for (stretch, grid) in stretches.iter_mut().zip(&angles.grids) {
            *stretch = grid.spread(stretch, f64::NAN);
        }
        Self { stretches, origins, sigma, dt: angles.dt, grids: &angles.grids }
    }

    /// The readings of a part of segment `s`.
    fn samples<'b>(&'b self, s: usize, range: Range<usize>, jerk: &'b [f64]) -> Samples<'b> {
        let steps = self.grids.get(s).map_or(&[][..], |grid| &grid.steps[range.start..range.end - 1]);
        Samples { z: &self.stretches[s][range], steps, jerk }
    }

    /// Smooths with the maximum-likelihood intensities: of the noise in q⁗, estimated apart from `apart`, and of the
    /// noise in q⃛ in `turns`, with a logarithm of at most `most`. Of several `turns`, each with its `apart`, the likeliest
    /// are used.
    pub(super) fn smoothed(&self, apart: &[Turns], turns: &[Turns], most: f64) -> Vec<Smoothed> {
        let shortest = self.snap(&apart[0]);
        let (turns, Snap { intensity: snap, variance, .. }) = match self.likeliest(&shortest, turns, most) {
            0 => (&turns[0], shortest),
            k => (&turns[k], self.snap(&apart[k])),
        };
        let jump = self.jump(snap, variance, turns, most);
        let margin = (MARGIN * width(snap)).ceil() as usize;
        let [rate, acceleration] = [1, 2].map(|d| self.sigma * variance.sqrt() * standard_error(snap, d));
        let errors = [width(snap), rate, acceleration];
        let stretch = |s: usize| {
            let jerk = jerk(&turns[s], jump);
            let samples = self.samples(s, 0..self.stretches[s].len(), &jerk);
            let mut values = smooth(samples, snap);
            if let Some(grid) = self.grids.get(s) {
                values = grid.at.iter().map(|&k| values[k]).collect();
            }
            for value in &mut values {
                *value = value.map(|x| x * self.sigma);
                value[0] += self.origins[s];
            }
            Smoothed { values, errors, margin, known: None }
        };
        (0..self.stretches.len()).map(stretch).collect()
    }

    /// Place of the likeliest of several `turns`, each longer than those before it, given the noise of the motion.
    fn likeliest(&self, noise: &Snap, turns: &[Turns], most: f64) -> usize {
        let [_, .., longest] = turns else { return 0 };
        let pieces = reversals(longest);
        let likelihood = |turns: &Turns| {
            let jump = self.jump(noise.intensity, noise.variance, turns, most);
            self.likelihood(&pieces, noise.intensity, turns, jump).ln(noise.variance)
        };
        let mut best = (0, likelihood(&turns[0]));
        for (k, turns) in turns.iter().enumerate().skip(1) {
            let ln = likelihood(turns);
            if ln > best.1 + CLEARLY {
                best = (k, ln);
            }
        }
        best.0
    }

    /// What a smoother of constant smoothness determines of each segment.
    pub(super) fn known(&self) -> Vec<Known> {
        let nowhere: Vec<Vec<bool>> = self.stretches.iter().map(|z| no_turns(z.len())).collect();
        let Snap { intensity: snap, variance, .. } = self.snap(&nowhere);
        let scale = variance.sqrt();
        let all = (0..self.stretches.len()).map(|s| {
            let jerk = vec![0.0; self.stretches[s].len() - 1];
            let all = smooth_with_errors(self.samples(s, 0..self.stretches[s].len(), &jerk), snap);
            all.into_iter().map(|(x, errors)| (x, errors.map(|e| scale * e))).collect()
        });
        let all: Vec<Vec<WithErrors>> = all.collect();
        let at_samples = || all.iter().zip(self.grids).flat_map(|(all, grid)| grid.at.iter().map(|&k| all[k]));
        let most: [f64; 2] = std::array::from_fn(|d| {
            let usual = UNKNOWN * median(at_samples().map(|(_, errors)| errors[d]));
            let accurate = at_samples().filter(|(_, errors)| errors[d] <= usual).map(|(x, _)| x[d + 1].powi(2));
            let (sum, count) = accurate.fold((0.0, 0.0), |(sum, count), square| (sum + square, count + 1.0));
            usual.max((sum / f64::max(count, 1.0)).sqrt())
        });
        let known = |(all, grid): (&Vec<WithErrors>, &Grid)| {
            let at = |k: &usize| all[*k].1.iter().zip(&most).all(|(error, most)| error <= most);
            let between = |w: &[usize]| (w[0] + 1..w[1]).all(|k| at(&k));
            Known { samples: grid.at.iter().map(at).collect(), steps: grid.at.windows(2).map(between).collect() }
        };
        all.iter().zip(self.grids).map(known).collect()
    }

    /// Maximum-likelihood intensity of the noise in q⁗, apart from reversals, and variance of the readings.
    pub(super) fn snap(&self, turns: &[Vec<bool>]) -> Snap {
        let pieces = self.spread();
        let longest = if self.grids.is_empty() { LONGEST } else { LONGEST_UNEVEN * self.dt };
        let smoothest = 8.0 * (self.dt / longest).ln();
        if pieces.is_empty() {
            return Snap { intensity: smoothest.exp(), variance: 1.0, likelihood: 0.0 };
        }
        let of = |ln: f64| self.likelihood(&pieces, ln.exp(), turns, UNRELATED);
        let best = |l: Likelihood| l.ln(l.variance());
        let mut range = [smoothest.min(ROUGHEST), ROUGHEST];
        if !self.grids.is_empty() {
            // Starts and stops between samples are noise to a smooth motion and motion to a rough one: two maxima.
            range = around_highest(range, |ln| best(of(ln)));
        }
        let ln = highest(range, |ln| best(of(ln)));
        let found = of(ln);
        Snap { intensity: ln.exp(), variance: found.variance(), likelihood: best(found) }
    }

    /// Maximum-likelihood intensity of the noise in q⃛ at reversals.
    fn jump(&self, snap: f64, variance: f64, turns: &[Vec<bool>], most: f64) -> f64 {
        let pieces = reversals(turns);
        if pieces.is_empty() {
            return 0.0;
        }
        highest([JUMP[0], most], |ln| self.likelihood(&pieces, snap, turns, ln.exp()).ln(variance)).exp()
    }

    fn likelihood(&self, pieces: &[Piece], snap: f64, turns: &[Vec<bool>], jump: f64) -> Likelihood {
        let one = |(s, range): &Piece| {
            let jerk = jerk(&turns[*s][range.start..range.end - 1], jump);
            Likelihood::of(self.samples(*s, range.clone(), &jerk), snap)
        };
        pieces.iter().map(one).sum()
    }

    /// Pieces in which the axis moves, spread over the recording.
    fn spread(&self) -> Vec<Piece> {
        let all = self.stretches.iter().enumerate().flat_map(|(s, z)| {
            let length = PIECE.min(z.len());
            (0..z.len() / length.max(1)).map(move |p| (s, p * length..(p + 1) * length))
        });
        let moves = |(s, range): &Piece| {
            let z = &self.stretches[*s][range.clone()];
            let (low, high) = z.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(*x), b.max(*x)));
            high - low > RESTING
        };
        thinned(all.filter(moves).collect(), PIECES)
    }
}

/// Intensities of the noise in q⃛.
fn jerk(turns: &[bool], jump: f64) -> Vec<f64> {
    turns.iter().map(|turning| if *turning { jump } else { 0.0 }).collect()
}

/// Pieces around reversals.
fn reversals(turns: &[Vec<bool>]) -> Vec<Piece> {
    let mut pieces: Vec<Piece> = Vec::new();
    for (s, turns) in turns.iter().enumerate() {
        let mut k = 0;
        while let Some(first) = turns[k..].iter().position(|t| *t).map(|p| k + p) {
            let length = turns[first..].iter().take_while(|t| **t).count();
            pieces.push((s, first.saturating_sub(BESIDE)..(first + length + BESIDE).min(turns.len() + 1)));
            k = first + length;
        }
    }
    thinned(pieces, REVERSALS)
}

/// At most `most` of the pieces, equally spaced.
fn thinned(pieces: Vec<Piece>, most: usize) -> Vec<Piece> {
    let n = pieces.len();
    if n <= most { pieces } else { (0..most).map(|k| pieces[k * n / most].clone()).collect() }
}

/// Part of an interval around the highest of 16 values of a function.
fn around_highest([low, high]: [f64; 2], f: impl Fn(f64) -> f64) -> [f64; 2] {
    let step = (high - low) / 15.0;
    let (best, _) = (0..16).map(|k| low + f64::from(k) * step).fold((low, f64::NEG_INFINITY), |(at, most), x| {
        let value = f(x);
        if value > most { (x, value) } else { (at, most) }
    });
    [(best - step).max(low), (best + step).min(high)]
}

/// Maximiser of a unimodal function in an interval, to within 0.2.
fn highest([mut low, mut high]: [f64; 2], f: impl Fn(f64) -> f64) -> f64 {
    const RATIO: f64 = 0.618_033_988_749_895;
    let (mut a, mut b) = (high - RATIO * (high - low), low + RATIO * (high - low));
    let (mut at_a, mut at_b) = (f(a), f(b));
    while high - low > 0.4 {
        if at_a > at_b {
            (high, b, at_b) = (b, a, at_a);
            a = high - RATIO * (high - low);
            at_a = f(a);
        } else {
            (low, a, at_a) = (a, b, at_b);
            b = low + RATIO * (high - low);
            at_b = f(b);
        }
    }
    0.5 * (low + high)
}
