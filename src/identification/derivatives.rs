//! Joint rates and accelerations from encoder angles.
//!
//! The default is a smoother ([`super::smoother`]) whose process noise is estimated by maximum likelihood per axis.
//! Dry friction changes sign when an axis reverses, and the accelerations of all axes change steeply with it. Only
//! there the smoother permits jumps of q̈, with an intensity estimated from the data.

use std::ops::Range;

use super::filtering::{Kernel, MAX_HALF_WIDTH, MIN_HALF_WIDTH, half_width, noise_level};
use super::smoother::{Likelihood, smooth, width};
use crate::kinematics::JointState;
use crate::machine::AXES;
use crate::numerics::median;
use crate::recording::Rows;

/// Method of differentiation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// [Gnad 2024], section 6.1: forward difference for q̇; for q̈ a differentiating filter applied forward and
    /// backward, here the first difference, which gives (q₊ − 2q + q₋)/T².
    Paper,
    /// Local polynomials [Savitzky 1964] of the smallest width with acceptable encoder noise.
    Polynomial,
    /// Smoother with constant smoothness.
    Smoother,
    /// Smoother with jumps of the acceleration at reversals.
    Reversals,
}

/// Acceptable standard deviation of accelerations due to encoder noise, rad/s²: torques below a tenth of the sensor
/// noise.
const ACCELERATION_NOISE: [f64; AXES] = [0.05, 0.05, 0.05, 0.5];
/// Speed below which an axis may reverse, rad/s; an axis that stays below it nearby is at rest.
const TURNING: f64 = 0.05;
/// Time that counts as nearby, s.
const NEARBY: f64 = 0.02;
/// Shortest and longest time before and after the reversal in which q̈ may jump, s.
const JUMPING: [f64; 2] = [1e-3, 1e-2];
/// Duration, s, and largest frequency, Hz, of the ringing of elastic gears after a reversal.
const RINGING: f64 = 0.08;
const FASTEST_RINGING: f64 = 250.0;
/// Samples discarded at the ends of a segment, in widths of the smoother: inside, standard errors are at most 1.7
/// times those far from the ends.
const MARGIN: f64 = 2.0;

/// Time and intensity of the permitted jumps of q̈.
#[derive(Clone, Copy)]
struct Jumps {
    /// Shortest time after a reversal in which q̈ may jump, s.
    ringing: f64,
    /// Logarithm of the largest intensity of the noise in q⃛.
    most: f64,
}

/// Angles at equally spaced times.
pub struct Angles<'a> {
    q: Rows<'a, AXES>,
    stretches: &'a [Range<usize>],
    dt: f64,
    /// Standard deviation of the noise per axis, rad.
    sigma: [f64; AXES],
}

/// Angle and its first two derivatives with respect to the sample number, of one segment.
struct Smoothed {
    values: Vec<[f64; 3]>,
    /// Number of samples at either end that are not accurate enough.
    margin: usize,
}

impl<'a> Angles<'a> {
    /// Angles `q` of every sample, rad, in segments without gaps, every `dt` seconds.
    pub fn new(q: Rows<'a, AXES>, stretches: &'a [Range<usize>], dt: f64) -> Self {
        let mut out = Self { q, stretches, dt, sigma: [0.0; AXES] };
        out.sigma =
            std::array::from_fn(|i| noise_level(&stretches.iter().map(|s| out.angles(i, s)).collect::<Vec<_>>()));
        out
    }

    /// Half width of the polynomials per axis, samples; [`MIN_HALF_WIDTH`] for angles without noise.
    pub fn half_widths(&self) -> [usize; AXES] {
        std::array::from_fn(|i| half_width(self.sigma[i], self.dt, ACCELERATION_NOISE[i]))
    }

    /// Step of an encoder whose rounding would be as large as the noise of an axis, rad.
    pub fn resolution(&self, axis: usize) -> f64 {
        12f64.sqrt() * self.sigma[axis]
    }

    /// Joint states of the samples kept of each segment.
    pub fn differentiate(&self, method: Method) -> Vec<(Range<usize>, Vec<JointState>)> {
        let half_widths = self.half_widths();
        let segments = match method {
            Method::Paper => self.joined(|i| self.each(i, paper)),
            Method::Polynomial => self.joined(|i| self.each(i, |x| polynomial(x, half_widths[i]))),
            Method::Smoother | Method::Reversals => {
                let jumps = Jumps { ringing: 0.0, most: JUMP[1] };
                self.smoothed(half_widths, (method == Method::Reversals).then_some(jumps))
            }
        };
        let inside = |(stretch, (mut states, margin)): (&Range<usize>, Segment)| {
            if stretch.len() <= 2 * margin {
                return None;
            }
            states.truncate(stretch.len() - margin);
            states.drain(..margin);
            Some((stretch.start + margin..stretch.end - margin, states))
        };
        self.stretches.iter().zip(segments).filter_map(inside).collect()
    }

    /// Joint states of all samples of every segment from the derivatives of each axis.
    fn joined(&self, axis: impl Fn(usize) -> Vec<Smoothed> + Sync) -> Vec<Segment> {
        let mut segments: Vec<Segment> =
            self.stretches.iter().map(|s| (vec![JointState::default(); s.len()], 0)).collect();
        by_pairs(self.samples() < LONG, axis, |i, smoothed| {
            for ((states, margin), own) in segments.iter_mut().zip(smoothed) {
                *margin = (*margin).max(own.margin);
                for (state, value) in states.iter_mut().zip(own.values) {
                    let [q, qd, qdd]: [f64; 3] = std::array::from_fn(|d| value[d] / self.dt.powi(d as i32));
                    (state.q[i], state.qd[i], state.qdd[i]) = (q, qd, qdd);
                }
            }
        });
        segments
    }

    fn samples(&self) -> usize {
        self.stretches.last().map_or(0, |s| s.end)
    }

    fn angles(&self, axis: usize, stretch: &Range<usize>) -> Vec<f64> {
        match self.q.series(axis) {
            [] => vec![0.0; stretch.len()],
            own => own[stretch.clone()].to_vec(),
        }
    }

    fn each(&self, axis: usize, f: impl Fn(&[f64]) -> Smoothed) -> Vec<Smoothed> {
        self.stretches.iter().map(|s| f(&self.angles(axis, s))).collect()
    }

    /// Joint states of all samples of the segments, including the ringing after each reversal.
    pub fn ringing(&self) -> Vec<JointState> {
        // Noise in q⃛ of intensity w is smoothed over about w^(−1/6) samples.
        let fastest = 6.0 * (std::f64::consts::TAU * FASTEST_RINGING * self.dt).ln();
        let jumps = Jumps { ringing: RINGING, most: fastest.min(JUMP[1]) };
        let segments = self.smoothed(self.half_widths(), Some(jumps));
        let mut states = segments.into_iter().map(|(states, _)| states);
        let mut all = states.next().unwrap_or_default();
        states.for_each(|more| all.extend(more));
        all
    }

    fn smoothed(&self, half_widths: [usize; AXES], jumps: Option<Jumps>) -> Vec<Segment> {
        let most = jumps.map_or(JUMP[1], |j| j.most);
        let smoothed = |i: usize, apart: &[Vec<bool>], turns: &[Vec<bool>], finest: f64| match half_widths[i] {
            m if m > MIN_HALF_WIDTH => Readings::new(self, i).smoothed(apart, turns, most.min(finest)),
            m => self.each(i, |x| polynomial(x, m)),
        };
        let nowhere: Vec<Vec<bool>> = self.stretches.iter().map(|s| no_turns(s.len())).collect();
        let first = |i: usize| smoothed(i, &nowhere, &nowhere, JUMP[1]);
        let Some(jumps) = jumps else { return self.joined(first) };
        // Of the first smoothing only where axes reverse, and how finely, is kept.
        let (mut rates, mut finest) = (vec![Vec::new(); AXES], [0.0; AXES]);
        let known = |i: usize| {
            let all = first(i);
            let rates = |s: &Smoothed| s.values.iter().map(|x| x[1] / self.dt).collect::<Vec<_>>();
            (all.iter().map(rates).collect(), self.finest_jump(i, all.iter().flat_map(|s| &s.values)))
        };
        by_pairs(self.samples() < LONG, known, |i, known| (rates[i], finest[i]) = known);
        let turning = |ringing: f64| -> Vec<Vec<bool>> {
            let of = |s: usize| turns(&std::array::from_fn(|i| rates[i][s].as_slice()), self.dt, ringing);
            (0..self.stretches.len()).map(of).collect()
        };
        let (at_once, later) = (turning(0.0), turning(jumps.ringing));
        drop(rates);
        self.joined(|i| smoothed(i, &at_once, &later, finest[i]))
    }

    /// Logarithm of the largest intensity of jumps of q̈ that the encoder of an axis resolves.
    ///
    /// An axis that reverses with the acceleration a stays within one encoder step Δ for √(2Δ/a). The readings of that
    /// time are equal, not independent, and steeper jumps would follow their steps. Noise in q⃛ of intensity w is
    /// smoothed over about w^(−1/6) samples.
    fn finest_jump<'b>(&self, axis: usize, smoothed: impl Iterator<Item = &'b [f64; 3]>) -> f64 {
        let mut before = None;
        let mut turning = Vec::new();
        for [_, rate, acceleration] in smoothed {
            if before.is_some_and(|b: f64| (b < 0.0) != (*rate < 0.0)) {
                turning.push(acceleration.abs());
            }
            before = Some(*rate);
        }
        // Uniform errors have the standard deviation Δ/√12. All quantities are per sample.
        let step = self.resolution(axis);
        let samples = (2.0 * step / median(turning)).sqrt();
        if samples > COARSE { -6.0 * samples.ln() } else { JUMP[1] }
    }
}

/// Joint states of all samples of a segment, and the number of samples at either end that are not accurate enough.
type Segment = (Vec<JointState>, usize);

/// Passes the results of all axes to `take`, made two at a time; one at a time if not `paired`.
fn by_pairs<T: Send>(paired: bool, one: impl Fn(usize) -> T + Sync, mut take: impl FnMut(usize, T)) {
    if !paired {
        return (0..AXES).for_each(|i| take(i, one(i)));
    }
    for i in (0..AXES).step_by(2) {
        let (first, second) = rayon::join(|| one(i), || one(i + 1));
        take(i, first);
        take(i + 1, second);
    }
}

/// Number of samples from which the axes are differentiated one at a time, because each needs much memory.
const LONG: usize = 1_000_000;

/// Derivatives by the method of the paper.
fn paper(x: &[f64]) -> Smoothed {
    let inside = |k: usize| [x[k], x[k + 1] - x[k], x[k + 1] - 2.0 * x[k] + x[k - 1]];
    let last = x.len().saturating_sub(1);
    let values = (0..x.len()).map(|k| if k > 0 && k < last { inside(k) } else { [x[k], 0.0, 0.0] }).collect();
    Smoothed { values, margin: 1 }
}

/// Derivatives of local polynomials of half width `m`.
fn polynomial(x: &[f64], m: usize) -> Smoothed {
    let kernel = Kernel::new(m.min(MAX_HALF_WIDTH));
    let m = kernel.half_width;
    let mut values: Vec<[f64; 3]> = x.iter().map(|x| [*x, 0.0, 0.0]).collect();
    for d in 0..3 {
        for (value, y) in values.iter_mut().skip(m).zip(kernel.apply(d, x)) {
            value[d] = y;
        }
    }
    Smoothed { values, margin: m }
}

/// Whether q̈ may jump in each step of a segment: an axis reverses, given the rates of all axes in rad/s, or did so
/// less than `ringing` seconds ago.
fn turns(rates: &[&[f64]; AXES], dt: f64, ringing: f64) -> Vec<bool> {
    let mut turns = no_turns(rates[0].len());
    let steps = turns.len();
    let [shortest, longest, ringing] = [JUMPING[0], JUMPING[1], ringing].map(|t| (t / dt).ceil() as usize);
    let nearby = (NEARBY / dt).ceil() as usize;
    for v in rates {
        for k in (0..steps).filter(|&k| (v[k] < 0.0) != (v[k + 1] < 0.0)) {
            let around = &v[k.saturating_sub(nearby)..(k + nearby).min(v.len())];
            if around.iter().all(|v| v.abs() < TURNING) {
                continue;
            }
            let slow = |k: &usize| v[*k].abs() < TURNING;
            let before = (k.saturating_sub(longest)..=k).rev().take_while(slow).count().max(shortest);
            let after = (k + 1..steps.min(k + longest)).take_while(slow).count().max(shortest).max(ringing);
            turns[k.saturating_sub(before)..(k + after).min(steps)].fill(true);
        }
    }
    turns
}

fn no_turns(samples: usize) -> Vec<bool> {
    vec![false; samples.saturating_sub(1)]
}

/// Angles of one axis minus the first of each segment, in units of their standard deviation.
struct Readings {
    stretches: Vec<Vec<f64>>,
    origins: Vec<f64>,
    sigma: f64,
    dt: f64,
}

/// A part of a segment: the segment's index and the range of samples.
type Piece = (usize, Range<usize>);

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
/// Samples within one encoder step at a reversal above which the encoder, not the sampling, limits the resolution.
const COARSE: f64 = 3.0;
/// Logarithms of the least and largest intensity of the noise in q⃛ at reversals.
const JUMP: [f64; 2] = [-30.0, 30.0];
/// Intensity at which the motions before and after a step are unrelated.
const UNRELATED: f64 = 1e4;
/// Longest time scale of the smoother, s: that of an axis at rest.
const LONGEST: f64 = 0.01;

impl Readings {
    fn new(angles: &Angles, axis: usize) -> Self {
        let sigma = angles.sigma[axis];
        let mut stretches: Vec<Vec<f64>> = angles.stretches.iter().map(|s| angles.angles(axis, s)).collect();
        let origins = stretches.iter().map(|s| s.first().copied().unwrap_or(0.0)).collect::<Vec<_>>();
        for (stretch, origin) in stretches.iter_mut().zip(&origins) {
            stretch.iter_mut().for_each(|x| *x = (*x - origin) / sigma);
        }
        Self { stretches, origins, sigma, dt: angles.dt }
    }

    /// Smooths with the maximum-likelihood intensities: of the noise in q⁗, estimated apart from `apart`, and of the
    /// noise in q⃛ in `turns`, with a logarithm of at most `most`.
    fn smoothed(&self, apart: &[Vec<bool>], turns: &[Vec<bool>], most: f64) -> Vec<Smoothed> {
        let (snap, variance) = self.snap(apart);
        let jump = self.jump(snap, variance, turns, most);
        let margin = (MARGIN * width(snap)).ceil() as usize;
        let stretch = |s: usize| {
            let mut values = smooth(&self.stretches[s], snap, &jerk(&turns[s], jump));
            for value in &mut values {
                *value = value.map(|x| x * self.sigma);
                value[0] += self.origins[s];
            }
            Smoothed { values, margin }
        };
        (0..self.stretches.len()).map(stretch).collect()
    }

    /// Maximum-likelihood intensity of the noise in q⁗, apart from reversals, and variance of the readings.
    fn snap(&self, turns: &[Vec<bool>]) -> (f64, f64) {
        let pieces = self.spread();
        let smoothest = 8.0 * (self.dt / LONGEST).ln();
        if pieces.is_empty() {
            return (smoothest.exp(), 1.0);
        }
        let of = |ln: f64| self.likelihood(&pieces, ln.exp(), turns, UNRELATED);
        let best = |l: Likelihood| l.ln(l.variance());
        let ln = highest([smoothest.min(ROUGHEST), ROUGHEST], |ln| best(of(ln)));
        (ln.exp(), of(ln).variance())
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
            Likelihood::of(&self.stretches[*s][range.clone()], snap, &jerk)
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
