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

mod axis;

use std::ops::Range;

use self::axis::{Axis, JUMP, Turns};
use super::filtering::{Kernel, MAX_HALF_WIDTH, MIN_HALF_WIDTH, half_width, noise_level, uneven_noise_level};
use super::initial::quantum;
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
/// Duration, s, and largest frequency, Hz, of the ringing of elastic gears after a reversal.
const RINGING: f64 = 0.08;
const FASTEST_RINGING: f64 = 250.0;
/// Rate whose sign is not determined: standard errors of it, and steps of the encoder per time scale of the smoothing, below
/// which the errors of neighbouring readings are equal.
const UNSIGNED: (f64, f64) = (3.0, 2.0);
/// Samples within one encoder step at a reversal above which the encoder, not the sampling, limits the resolution.
const COARSE: f64 = 3.0;
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
