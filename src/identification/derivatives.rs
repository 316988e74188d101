//! Joint rates and accelerations from encoder angles.
//!
//! The default is a smoother ([`super::smoother`]) whose process noise is estimated by maximum likelihood per axis.
//! Dry friction changes sign when an axis reverses, and the accelerations of all axes change steeply with it; they change
//! back when the controller follows, some milliseconds later. Only there the smoother permits jumps of q̈, with an intensity
//! and for a time estimated from the data.
//!
//! Samples at unequal times are smoothed at the times they have. A missing sample widens a step, and nothing else. Whether
//! the recorded times are those of the samples, or those of a logger that came late to even samples, the angles decide, by
//! the likelihood of either. What the smoother does not determine is left out: samples, and the gaps between them.

use std::ops::Range;

use super::filtering::{Kernel, MAX_HALF_WIDTH, MIN_HALF_WIDTH, half_width, noise_level, uneven_noise_level};
use super::initial::quantum;
use super::smoother::{Likelihood, Samples, WithErrors, smooth, smooth_with_errors, standard_error, width};
use crate::kinematics::JointState;
use crate::machine::{PerAxis, each, every_axis};
use crate::numerics::median;
use crate::recording::{AxisRows, is_even};

/// Method of differentiation. Samples at unequal times are always smoothed, as the filters are for even ones.
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
const ACCELERATION_NOISE: PerAxis<f64> = [0.05, 0.05, 0.05, 0.5];
/// Speed below which an axis may reverse, rad/s; an axis that stays below it nearby is at rest.
pub(super) const TURNING: f64 = 0.05;
/// Time that counts as nearby, s.
pub(super) const NEARBY: f64 = 0.02;
/// Times before and after the reversal in which q̈ may jump, s, shortest first; and the longest for an axis that is slow
/// for longer.
const JUMPING: [f64; 3] = [1e-3, 3e-3, 6e-3];
const LONGEST_JUMPING: f64 = 1e-2;
/// Gain of the logarithm of the likelihood by which a longer time must be better.
const CLEARLY: f64 = 20.0;
/// Duration, s, and largest frequency, Hz, of the ringing of elastic gears after a reversal.
const RINGING: f64 = 0.08;
const FASTEST_RINGING: f64 = 250.0;
/// Samples discarded at the ends of a segment, in widths of the smoother: inside, standard errors are at most 1.7
/// times those far from the ends.
const MARGIN: f64 = 2.0;
/// The same as a ratio of standard errors, from which a sample at unequal times is left out, unless the error is within
/// the RMS of what it is an error of: an estimate that leaves less open than was open without it is worth having.
const UNKNOWN: f64 = 1.7;
/// Rate whose sign is not determined: standard errors of it, and steps of the encoder per time scale of the smoothing, below
/// which the errors of neighbouring readings are equal.
const UNSIGNED: (f64, f64) = (3.0, 2.0);
/// Steps, in sampling periods, from which the middle is looked at, too.
const GAP: f64 = 1.5;

/// Time and intensity of the permitted jumps of q̈.
#[derive(Clone, Copy)]
struct Jumps {
    /// Shortest time after a reversal in which q̈ may jump, s.
    ringing: f64,
    /// Logarithm of the largest intensity of the noise in q⃛.
    most: f64,
}

/// Angles at increasing times.
pub struct Angles<'a> {
    q: AxisRows<'a>,
    stretches: &'a [Range<usize>],
    dt: f64,
    /// Grids of the segments; empty if all samples are equally spaced.
    grids: Vec<Grid>,
    /// Whether the samples are even, and only the recorded times are not.
    late: bool,
    /// Standard deviation of the noise per axis, rad.
    sigma: PerAxis<f64>,
}

/// Instants of a segment at unequal times: its samples, and the middles of the gaps between them.
struct Grid {
    /// Steps, in sampling periods.
    steps: Vec<f64>,
    /// Place of each sample.
    at: Vec<usize>,
}

impl Grid {
    fn new(t: &[f64], dt: f64) -> Self {
        let mut grid = Self { steps: Vec::with_capacity(t.len()), at: vec![0; t.len().min(1)] };
        for w in t.windows(2) {
            let step = (w[1] - w[0]) / dt;
            let parts = if step > GAP { 2 } else { 1 };
            grid.steps.extend(std::iter::repeat_n(step / f64::from(parts), parts as usize));
            grid.at.push(grid.steps.len());
        }
        grid
    }

    /// The grid of even samples of the same duration.
    fn even(&self) -> Self {
        let steps = self.at.windows(2).map(|w| (w[1] - w[0], self.steps[w[0]..w[1]].iter().sum::<f64>()));
        let whole = |step: f64| step.round().max(1.0);
        let (periods, duration) = steps.clone().fold((0.0, 0.0), |(n, sum), (_, step)| (n + whole(step), sum + step));
        let one = |(parts, step)| std::iter::repeat_n(whole(step) * duration / periods / parts as f64, parts);
        Self { steps: steps.flat_map(one).collect(), at: self.at.clone() }
    }

    /// Values of the samples, and `missing` in between.
    fn spread<T: Copy>(&self, values: &[T], missing: T) -> Vec<T> {
        let mut out = vec![missing; self.steps.len() + 1];
        self.at.iter().zip(values).for_each(|(at, value)| out[*at] = *value);
        out
    }

    /// Values of the steps between the samples for each part of them.
    fn parts(&self, steps: &[bool]) -> Vec<bool> {
        self.at.windows(2).zip(steps).flat_map(|(w, step)| std::iter::repeat_n(*step, w[1] - w[0])).collect()
    }
}

/// Accuracy of the derivatives of an axis away from reversals.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Accuracy {
    /// Time scale of the smoothing, s.
    pub width: f64,
    /// Least rate whose sign is determined, rad/s.
    pub rate: f64,
    /// Standard error of the acceleration, rad/s².
    pub acceleration: f64,
}

/// Joint motion along angles.
pub struct Motions {
    /// Kept samples with their joint states, in pieces without gaps.
    pub pieces: Vec<(Range<usize>, Vec<JointState>)>,
    /// Accuracy of each axis.
    pub accuracy: PerAxis<Accuracy>,
}

/// Angle and its first two derivatives with respect to the sample number, of one segment.
struct Smoothed {
    values: Vec<[f64; 3]>,
    /// Time scale of the smoothing, in samples, and standard errors of the two derivatives.
    errors: [f64; 3],
    /// Number of samples at either end that are not accurate enough.
    margin: usize,
    /// What the smoother determines; `None` without errors.
    known: Option<Known>,
}

/// Samples of a segment, and steps between them, that the smoother determines.
#[derive(Clone)]
struct Known {
    samples: Vec<bool>,
    steps: Vec<bool>,
}

impl Known {
    fn and(&mut self, other: &Self) {
        self.samples.iter_mut().zip(&other.samples).for_each(|(own, other)| *own &= other);
        self.steps.iter_mut().zip(&other.steps).for_each(|(own, other)| *own &= other);
    }

    /// Runs of samples that are determined with the steps between them.
    fn runs(&self) -> Vec<Range<usize>> {
        let mut runs: Vec<Range<usize>> = Vec::new();
        for k in (0..self.samples.len()).filter(|&k| self.samples[k]) {
            match runs.last_mut() {
                Some(run) if run.end == k && self.steps[k - 1] => run.end += 1,
                _ => runs.push(k..k + 1),
            }
        }
        runs
    }
}

impl<'a> Angles<'a> {
    /// Angles `q` of every sample, rad, at the times `t`, s, in segments; `dt` is the sampling period, s.
    pub fn new(q: AxisRows<'a>, t: &[f64], stretches: &'a [Range<usize>], dt: f64) -> Self {
        let mut out = Self { q, stretches, dt, grids: Vec::new(), late: false, sigma: each(0.0) };
        if stretches.iter().all(|s| is_even(&t[s.clone()], dt)) {
            out.sigma =
                std::array::from_fn(|i| noise_level(&stretches.iter().map(|s| out.angles(i, s)).collect::<Vec<_>>()));
            return out;
        }
        out.grids = stretches.iter().map(|s| Grid::new(&t[s.clone()], dt)).collect();
        for i in every_axis() {
            let angles: Vec<Vec<f64>> = stretches.iter().map(|s| out.angles(i, s)).collect();
            let angles: Vec<&[f64]> = angles.iter().map(Vec::as_slice).collect();
            // Rests show no noise, and rounding alone leaves a uniform density over a step.
            let rounding = quantum(&angles).unwrap_or(0.0) / 12f64.sqrt();
            out.sigma[i] = rounding.max(uneven_noise_level(stretches.iter().map(|s| &t[s.clone()]).zip(angles)));
        }
        let nowhere = out.nowhere();
        let likelihood =
            |angles: &Self| every_axis().map(|i| Axis::new(angles, i).snap(&nowhere).likelihood).sum::<f64>();
        let stamped = likelihood(&out);
        let even = out.grids.iter().map(Grid::even).collect();
        let recorded = std::mem::replace(&mut out.grids, even);
        out.late = likelihood(&out) > stamped;
        if !out.late {
            out.grids = recorded;
        }
        out
    }

    /// Times of the samples, s, if they are even and only the recorded times `t` are not.
    pub fn times(&self, t: &[f64]) -> Option<Vec<f64>> {
        let mut out = t.to_vec();
        for (stretch, grid) in self.stretches.iter().zip(&self.grids) {
            let mut time = t[stretch.start];
            for (k, w) in stretch.clone().skip(1).zip(grid.at.windows(2)) {
                time += self.dt * grid.steps[w[0]..w[1]].iter().sum::<f64>();
                out[k] = time;
            }
        }
        self.late.then_some(out)
    }

    fn nowhere(&self) -> Vec<Vec<bool>> {
        let points = |s: usize| self.grids.get(s).map_or(self.stretches[s].len(), |g| g.steps.len() + 1);
        (0..self.stretches.len()).map(|s| no_turns(points(s))).collect()
    }

    /// Half width of the polynomials per axis, samples; [`MIN_HALF_WIDTH`] for angles without noise at even times.
    pub fn half_widths(&self) -> PerAxis<usize> {
        let least = |sigma: f64| MIN_HALF_WIDTH + usize::from(!self.grids.is_empty() && sigma > 0.0);
        std::array::from_fn(|i| half_width(self.sigma[i], self.dt, ACCELERATION_NOISE[i]).max(least(self.sigma[i])))
    }

    /// Step of an encoder whose rounding would be as large as the noise of an axis, rad.
    pub fn resolution(&self, axis: usize) -> f64 {
        12f64.sqrt() * self.sigma[axis]
    }

    /// Joint states of the samples kept of each segment.
    pub fn differentiate(&self, method: Method) -> Motions {
        let half_widths = self.half_widths();
        let method = if self.grids.is_empty() || method == Method::Reversals { method } else { Method::Smoother };
        let (segments, accuracy) = match method {
            Method::Paper => self.joined(|i| self.each(i, paper)),
            Method::Polynomial => self.joined(|i| self.each(i, |x| polynomial(x, half_widths[i], self.sigma[i]))),
            Method::Smoother | Method::Reversals => {
                let jumps = Jumps { ringing: 0.0, most: JUMP[1] };
                self.smoothed(half_widths, (method == Method::Reversals).then_some(jumps))
            }
        };
        let inside = |(stretch, Segment { mut states, margin, known }): (&Range<usize>, Segment)| {
            if let Some(known) = known {
                let of = |run: Range<usize>| (stretch.start + run.start..stretch.start + run.end, states[run].to_vec());
                return known.runs().into_iter().map(of).collect();
            }
            if stretch.len() <= 2 * margin {
                return Vec::new();
            }
            states.truncate(stretch.len() - margin);
            states.drain(..margin);
            vec![(stretch.start + margin..stretch.end - margin, states)]
        };
        Motions { pieces: self.stretches.iter().zip(segments).flat_map(inside).collect(), accuracy }
    }

    /// Joint states of all samples of every segment from the derivatives of each axis, and their accuracy.
    fn joined(&self, axis: impl Fn(usize) -> Vec<Smoothed> + Sync) -> (Vec<Segment>, PerAxis<Accuracy>) {
        let empty = |s: &Range<usize>| Segment { states: vec![JointState::default(); s.len()], margin: 0, known: None };
        let mut segments: Vec<Segment> = self.stretches.iter().map(empty).collect();
        let mut accuracy: PerAxis<_> = each(Accuracy::default());
        by_pairs(self.samples() < LONG, axis, |i, smoothed| {
            let [width, rate, acceleration] = smoothed.first().map_or([0.0; 3], |s| s.errors);
            let steps = if width > 0.0 { self.resolution(i) / width } else { 0.0 };
            accuracy[i] = Accuracy {
                width: width * self.dt,
                rate: (UNSIGNED.0 * rate).max(UNSIGNED.1 * steps) / self.dt,
                acceleration: acceleration / self.dt.powi(2),
            };
            for (Segment { states, margin, known }, own) in segments.iter_mut().zip(smoothed) {
                *margin = (*margin).max(own.margin);
                match (known.as_mut(), own.known) {
                    (Some(known), Some(own)) => known.and(&own),
                    (None, own) => *known = own,
                    (Some(_), None) => {}
                }
                for (state, value) in states.iter_mut().zip(own.values) {
                    let [q, qd, qdd]: [f64; 3] = std::array::from_fn(|d| value[d] / self.dt.powi(d as i32));
                    (state.q[i], state.qd[i], state.qdd[i]) = (q, qd, qdd);
                }
            }
        });
        (segments, accuracy)
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
        let (segments, _) = self.smoothed(self.half_widths(), Some(jumps));
        let mut states = segments.into_iter().map(|segment| segment.states);
        let mut all = states.next().unwrap_or_default();
        states.for_each(|more| all.extend(more));
        all
    }

    fn smoothed(&self, half_widths: PerAxis<usize>, jumps: Option<Jumps>) -> (Vec<Segment>, PerAxis<Accuracy>) {
        let most = jumps.map_or(JUMP[1], |j| j.most);
        let smoothed = |i: usize, apart: &[Turns], turns: &[Turns], finest: f64| match half_widths[i] {
            m if m > MIN_HALF_WIDTH => Axis::new(self, i).smoothed(apart, turns, most.min(finest)),
            m => self.each(i, |x| polynomial(x, m, self.sigma[i])),
        };
        let nowhere = [self.nowhere()];
        let first = |i: usize| smoothed(i, &nowhere, &nowhere, JUMP[1]);
        let with_known = |i: usize, mut all: Vec<Smoothed>| {
            if !self.grids.is_empty() && half_widths[i] > MIN_HALF_WIDTH {
                all.iter_mut().zip(Axis::new(self, i).known()).for_each(|(s, known)| s.known = Some(known));
            }
            all
        };
        let Some(jumps) = jumps else { return self.joined(|i| with_known(i, first(i))) };
        // Of the first smoothing only where axes reverse, and how finely, is kept.
        let (mut rates, mut finest): (PerAxis<Vec<_>>, PerAxis<f64>) = Default::default();
        let known = |i: usize| {
            let all = first(i);
            let rates = |s: &Smoothed| s.values.iter().map(|x| x[1] / self.dt).collect::<Vec<_>>();
            (all.iter().map(rates).collect(), self.finest_jump(i, all.iter().flat_map(|s| &s.values)))
        };
        by_pairs(self.samples() < LONG, known, |i, known| (rates[i], finest[i]) = known);
        let turning = |shortest: f64, ringing: f64| -> Turns {
            let of = |s: usize| {
                let turns = turns(&std::array::from_fn(|i| rates[i][s].as_slice()), self.dt, shortest, ringing);
                self.grids.get(s).map_or_else(|| turns.clone(), |grid| grid.parts(&turns))
            };
            (0..self.stretches.len()).map(of).collect()
        };
        // Ringing takes longer than any of the times.
        let times = if jumps.ringing > 0.0 { &JUMPING[..1] } else { &JUMPING[..] };
        let at_once: Vec<Turns> = times.iter().map(|time| turning(*time, 0.0)).collect();
        let later: Vec<Turns> = times.iter().map(|time| turning(*time, jumps.ringing)).collect();
        drop(rates);
        self.joined(|i| with_known(i, smoothed(i, &at_once, &later, finest[i])))
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

/// Joint states of all samples of a segment.
struct Segment {
    states: Vec<JointState>,
    /// Number of samples at either end that are not accurate enough.
    margin: usize,
    /// What the smoother determines of all axes; `None` at even times.
    known: Option<Known>,
}

/// Passes the results of all axes to `take`, made two at a time; one at a time if not `paired`.
fn by_pairs<T: Send>(paired: bool, one: impl Fn(usize) -> T + Sync, mut take: impl FnMut(usize, T)) {
    if !paired {
        return every_axis().for_each(|i| take(i, one(i)));
    }
    for i in every_axis().step_by(2) {
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
    Smoothed { values, errors: [0.0; 3], margin: 1, known: None }
}

/// Derivatives of local polynomials of half width `m` of angles with noise `sigma`.
fn polynomial(x: &[f64], m: usize, sigma: f64) -> Smoothed {
    let kernel = Kernel::new(m.min(MAX_HALF_WIDTH));
    let m = kernel.half_width;
    let mut values: Vec<[f64; 3]> = x.iter().map(|x| [*x, 0.0, 0.0]).collect();
    for d in 0..3 {
        for (value, y) in values.iter_mut().skip(m).zip(kernel.apply(d, x)) {
            value[d] = y;
        }
    }
    let [rate, acceleration] = [1, 2].map(|d| kernel.noise_gain(d) * sigma);
    Smoothed { values, errors: [m as f64, rate, acceleration], margin: m, known: None }
}

/// Whether q̈ may jump in each step of a segment: an axis reverses, given the rates of all axes in rad/s, within
/// `shortest` seconds, or did so less than `ringing` seconds ago.
fn turns(rates: &PerAxis<&[f64]>, dt: f64, shortest: f64, ringing: f64) -> Vec<bool> {
    let mut turns = no_turns(rates[0].len());
    let steps = turns.len();
    let [shortest, longest, ringing] = [shortest, LONGEST_JUMPING, ringing].map(|t| (t / dt).ceil() as usize);
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
struct Axis<'a> {
    /// On the grids, if there are any.
    stretches: Vec<Vec<f64>>,
    origins: Vec<f64>,
    sigma: f64,
    dt: f64,
    grids: &'a [Grid],
}

/// Maximum-likelihood noise of the motion.
struct Snap {
    /// Intensity of the noise in q⁗.
    intensity: f64,
    /// Variance of the readings.
    variance: f64,
    /// Logarithm of the likelihood.
    likelihood: f64,
}

/// A part of a segment: the segment's index and the range of samples.
type Piece = (usize, Range<usize>);

/// Whether q̈ may jump in each step of every segment.
type Turns = Vec<Vec<bool>>;

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
/// Longest time scale of the smoother, s: that of an axis at rest; and of samples at unequal times, in sampling periods,
/// as many as that is at 2.5 kHz.
const LONGEST: f64 = 0.01;
const LONGEST_UNEVEN: f64 = 25.0;

impl<'a> Axis<'a> {
    fn new(angles: &'a Angles, axis: usize) -> Self {
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
    fn smoothed(&self, apart: &[Turns], turns: &[Turns], most: f64) -> Vec<Smoothed> {
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
    fn known(&self) -> Vec<Known> {
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
    fn snap(&self, turns: &[Vec<bool>]) -> Snap {
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
