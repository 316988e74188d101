//! [`Dataset`]: a recording prepared for the dynamics.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

use super::derivatives::{Accuracy, Angles, Method, Motions};
use super::filtering::MIN_HALF_WIDTH;
use crate::dynamics::{Plant, steady_inverse_dynamics};
use crate::evidence::noise::difference_sigma;
use crate::kinematics::JointState;
use crate::machine::{AXES, Configuration, Mechanism, Part, Setup};
use crate::model::Model;
use crate::recording::{Channel, Loads, Recording, Rows, Series, Signals, is_even};

/// Half width of the differentiation, s, and least rate with a known sign, rad/s or m/s, up to which reversals are resolved:
/// friction changes its sign within ±0.01 rad/s.
const RESOLVED: (f64, f64) = (0.015, 0.01);
/// Sampling period, s, above which reversals are not resolved.
const SLOW: f64 = 4e-3;
/// Sampling period, s, above which readings at unequal times that repeat show that a lone axis sticks.
const STICKS: f64 = 0.015;
/// Time, s, during which a lone axis that stands does not move.
const STANDING: f64 = 0.3;
/// Movement, in resolutions of the angle, up to which an axis stands; the resolution is at least a share of its travel.
const STILL: (f64, f64) = (3.0, 1e-5);
/// Difference of readings, in resolutions of the angle, up to which they are the same or neighbouring steps.
const ROUNDED: f64 = 1.01;
/// Duration of means, s, whose differences still show noise only: a torque is smooth over a few of them.
const SMOOTH: f64 = 2e-3;
/// Time before and after a reversal that coarse angles do not resolve, in time scales of their smoothing.
const REACH: f64 = 4.0;
/// Number of instants at which the influence of an acceleration is computed.
const INSTANTS: usize = 100;
/// Least duration, s, with which samples near reversals that are not resolved are left out.
const LEAST: f64 = 0.25;
/// Least share of the samples in motion with which those at rest are left out; at unequal times, least number of them: ten
/// for each parameter of inertia, friction and weight.
const MOVING: f64 = 0.2;
const ENOUGH: f64 = 50.0;

/// Smoothed joint motion with the measured channels at the same samples.
#[derive(Clone, Debug)]
pub struct Dataset {
    /// Name of the recording.
    pub name: String,
    /// Kind of machine.
    pub mechanism: Mechanism,
    /// Setup of the run.
    pub setup: Setup,
    /// Time of each sample, s.
    pub t: Vec<f64>,
    /// Joint motion at each sample; rad (m for a linear axis), s.
    pub joints: Vec<JointState>,
    /// Encoder angles, from which [`Self::ringing`] is computed; empty for an exact motion and for pieces of one.
    pub readings: EncoderReadings,
    /// Measured channels.
    pub channels: Vec<Channel>,
    /// Loads from outside that were measured.
    pub loads: Option<Arc<Loads>>,
    /// Measured values, one series per channel.
    pub measured: Vec<Series>,
    /// Ranges of samples without gaps.
    pub segments: Vec<Range<usize>>,
    /// Sampling period, s.
    pub dt: f64,
    /// Share of the samples that were left out: a lone axis stands, or coarse angles of a robot do not resolve a reversal.
    pub left_out: f64,
    /// Half width per axis, in samples, of local polynomials whose second derivative has acceptable encoder noise;
    /// the smallest, [`super::filtering::MIN_HALF_WIDTH`], without encoder noise.
    pub half_width: [usize; AXES],
    /// Accuracy of the smoothed motion per axis.
    pub accuracy: [Accuracy; AXES],
}

/// Encoder angles, and the motion including the ringing of elastic gears once it was requested.
#[derive(Clone, Debug, Default)]
pub struct EncoderReadings {
    angles: [Series; AXES],
    ringing: OnceLock<Vec<JointState>>,
}

impl EncoderReadings {
    fn rows(&self) -> Rows<'_, AXES> {
        Rows(self.angles.each_ref().map(|own| &**own))
    }

    fn window(&self, range: &Range<usize>) -> Self {
        let known = self.ringing.get().map(|all| all[range.clone()].to_vec());
        Self {
            angles: self.angles.each_ref().map(|own| if own.is_empty() { own.clone() } else { own.window(range) }),
            ringing: known.map_or_else(OnceLock::new, OnceLock::from),
        }
    }
}

impl Dataset {
    /// A motion that is known exactly at t = 0, `dt`, 2·`dt`, …, s, with nothing measured yet on `channels`.
    pub fn exact(mechanism: Mechanism, setup: Setup, channels: Vec<Channel>, dt: f64, joints: Vec<JointState>) -> Self {
        let n = joints.len();
        Self {
            name: "motion".into(),
            mechanism,
            setup,
            t: (0..n).map(|k| k as f64 * dt).collect(),
            joints,
            readings: EncoderReadings::default(),
            loads: None,
            measured: vec![vec![0.0; n].into(); channels.len()],
            channels,
            segments: std::iter::once(0..n).collect(),
            dt,
            left_out: 0.0,
            half_width: [MIN_HALF_WIDTH; AXES],
            accuracy: [Accuracy::default(); AXES],
        }
    }

    /// Differentiates the joint angles of a recording by the default method; a few samples at the ends of each
    /// segment are lost.
    pub fn new(recording: &Recording) -> Self {
        Self::with(recording, Method::Reversals)
    }

    /// Differentiates the joint angles of a recording by a given method.
    pub fn with(recording: &Recording, method: Method) -> Self {
        let signals = &recording.signals;
        let (dt, stretches) = (signals.sample_time(), signals.stretches());
        let angles = Angles::new(signals.q(), &signals.t, &stretches, dt);
        let channels = measured_channels(signals, recording.setup.configuration);
        let even = angles.times(&signals.t);
        let t = even.as_ref().unwrap_or(&signals.t);
        let mut dataset = Self {
            name: recording.name.clone(),
            segments: Vec::new(),
            loads: Loads::of(signals, t).map(Arc::new),
            half_width: angles.half_widths(),
            ..Self::exact(signals.mechanism, recording.setup, channels, dt, Vec::new())
        };
        let Motions { pieces, accuracy } = angles.differentiate(method);
        dataset.accuracy = accuracy;
        let total: usize = pieces.iter().map(|(kept, _)| kept.len()).sum();
        let moving = match signals.mechanism {
            Mechanism::Axis(_) => moving(signals, pieces.iter().map(|(kept, _)| kept), angles.resolution(0)),
            Mechanism::Delta { .. } => dataset.resolved(signals, &pieces),
        };
        for ((piece, joints), moving) in pieces.into_iter().zip(&moving) {
            // A recording without gaps and rests, the largest case, is moved and not copied.
            if piece.len() == total && *moving == [piece.clone()] {
                dataset.joints = joints;
            } else {
                let moved = moving.iter().map(|range| &joints[range.start - piece.start..range.end - piece.start]);
                dataset.joints.extend(moved.flatten());
            }
        }
        let kept = moving.concat();
        for range in &kept {
            let first = dataset.t.len();
            dataset.t.extend(&t[range.clone()]);
            dataset.segments.push(first..dataset.t.len());
        }
        dataset.readings.angles = std::array::from_fn(|i| signals.share(Channel::Angle(i)).pieces(&kept));
        dataset.measured = dataset.channels.iter().map(|&c| signals.share(c).pieces(&kept)).collect();
        dataset.left_out = 1.0 - dataset.len() as f64 / total.max(1) as f64;
        dataset
    }

    /// The machine of `model` in the setup of the recording, under the loads that were measured.
    pub fn plant(&self, model: &Model) -> Plant {
        Plant::new(model, &self.setup).under(self.loads.clone())
    }

    /// Joint motion including the ringing of elastic gears after reversals; [`Self::joints`] for an exact motion.
    pub fn ringing(&self) -> &[JointState] {
        let angles = self.readings.rows();
        if angles.is_empty() {
            return &self.joints;
        }
        self.readings.ringing.get_or_init(|| Angles::new(angles, &self.t, &self.segments, self.dt).ringing())
    }

    /// Step of an encoder whose rounding would be as large as the noise of an axis' angles, rad (m for a linear axis); zero
    /// for an exact motion.
    pub fn resolution(&self, axis: usize) -> f64 {
        let angles = self.readings.rows();
        if angles.is_empty() { 0.0 } else { Angles::new(angles, &self.t, &self.segments, self.dt).resolution(axis) }
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.t.len()
    }

    /// Whether no samples are left after filtering.
    pub fn is_empty(&self) -> bool {
        self.t.is_empty()
    }

    /// The dataset without samples.
    pub fn empty(&self) -> Self {
        Self {
            name: self.name.clone(),
            segments: Vec::new(),
            loads: self.loads.clone(),
            left_out: self.left_out,
            half_width: self.half_width,
            accuracy: self.accuracy,
            ..Self::exact(self.mechanism, self.setup, self.channels.clone(), self.dt, Vec::new())
        }
    }

    /// The samples of `range` only.
    ///
    /// # Panics
    /// If `range` exceeds the dataset.
    pub fn window(&self, range: Range<usize>) -> Self {
        let clip = |s: &Range<usize>| {
            let (start, end) = (s.start.max(range.start), s.end.min(range.end));
            (start < end).then(|| start - range.start..end - range.start)
        };
        Self {
            t: self.t[range.clone()].to_vec(),
            joints: self.joints[range.clone()].to_vec(),
            readings: self.readings.window(&range),
            measured: self.measured.iter().map(|m| m.window(&range)).collect(),
            segments: self.segments.iter().filter_map(clip).collect(),
            ..self.empty()
        }
    }

    /// The path of the motion at `factor` times its speed, backwards if negative, at the same times.
    pub fn at_speed(&self, factor: f64) -> Self {
        let faster = |j: &JointState| JointState {
            q: j.q,
            qd: j.qd.map(|rate| factor * rate),
            qdd: j.qdd.map(|acceleration| factor.powi(2) * acceleration),
        };
        Self {
            t: self.t.clone(),
            joints: self.joints.iter().map(faster).collect(),
            measured: self.measured.clone(),
            segments: self.segments.clone(),
            ..self.empty()
        }
    }

    /// The first of every `of` pieces of `length` samples, each a segment of its own, or several if it has gaps.
    ///
    /// # Panics
    /// If `length` or `of` is zero.
    pub fn sparse(&self, length: usize, of: usize) -> Self {
        let mut sparse = self.empty();
        for start in (0..self.len()).step_by(length * of) {
            let piece = self.window(start..(start + length).min(self.len()));
            let first = sparse.len();
            sparse.t.extend(piece.t);
            sparse.joints.extend(piece.joints);
            sparse.measured.iter_mut().zip(piece.measured).for_each(|(all, own)| all.extend(own.iter().copied()));
            sparse.segments.extend(piece.segments.iter().map(|s| first + s.start..first + s.end));
        }
        sparse
    }

    /// Whether the angles of an axis are so coarse, or sampled so slowly, that its reversals are not resolved: friction
    /// jumps there, and its smoothing error resembles effects.
    pub fn blurs_reversals(&self) -> bool {
        self.is_coarse() || self.dt > SLOW
    }

    /// Whether the motion is smoothed at reversals that the dataset contains, while the torques are not.
    pub fn smooths_reversals(&self) -> bool {
        self.blurs_reversals() && (self.dt > SLOW || self.left_out == 0.0 || self.mechanism.axes() == 1)
    }

    /// Whether the angles of an axis are so coarse that its reversals are not resolved.
    fn is_coarse(&self) -> bool {
        let (time, rate) = RESOLVED;
        let is_wide = |m: usize| m > MIN_HALF_WIDTH && m as f64 * self.dt > time;
        self.half_width.iter().zip(&self.accuracy).any(|(m, own)| is_wide(*m) && own.rate > rate)
    }

    /// Ranges of each of `pieces` in which the coarse angles of a robot determine the sign of every rate, or that the axis
    /// stands, and how it accelerates; all of it if they hardly ever do.
    ///
    /// Friction jumps at a reversal, and the accelerations of all axes with it. Both are smoothed over the time scale of the
    /// smoothing, and friction of the wrong sign is an error of twice its size.
    fn resolved(&self, signals: &Signals, pieces: &[(Range<usize>, Vec<JointState>)]) -> Vec<Vec<Range<usize>>> {
        let of = |(piece, joints): &(Range<usize>, Vec<JointState>)| {
            let mut is_resolved = vec![true; piece.len()];
            for axis in (0..AXES).filter(|&axis| self.half_width[axis] > MIN_HALF_WIDTH) {
                let Accuracy { width, rate, .. } = self.accuracy[axis];
                let reach = (REACH * width / self.dt).ceil() as usize;
                let rate_at = |k: usize| joints[k].qd[axis];
                let stands = standing(&signals.q().0[axis][piece.clone()], reach);
                let is_unsigned =
                    |k: &usize| rate_at(*k).abs() < rate || *k > 0 && (rate_at(k - 1) < 0.0) != (rate_at(*k) < 0.0);
                for k in (0..piece.len()).filter(|&k| !stands[k]).filter(is_unsigned) {
                    is_resolved[k.saturating_sub(reach)..(k + reach).min(piece.len())].fill(false);
                }
            }
            let long = |run: &Range<usize>| run.len() > 2 * MIN_HALF_WIDTH;
            runs(&is_resolved, piece.start).into_iter().filter(long).collect()
        };
        let all: Vec<Vec<Range<usize>>> = pieces.iter().map(|(piece, _)| vec![piece.clone()]).collect();
        if !self.is_coarse() {
            return all;
        }
        let resolved: Vec<Vec<Range<usize>>> = pieces.iter().map(of).collect();
        if samples(&resolved) * self.dt < LEAST { all } else { resolved }
    }

    /// Samples at which an axis has another direction than at the one before, within segments.
    pub fn reversals(&self, axis: usize) -> impl Iterator<Item = usize> {
        let rate = move |k: usize| self.joints[k].qd[axis];
        let within = self.segments.iter().flat_map(|s| s.start + 1..s.end);
        within.filter(move |&k| (rate(k - 1) < 0.0) != (rate(k) < 0.0))
    }

    /// Time over which the angles are smoothed, s, of the axis with the coarsest ones, where that hides reversals.
    pub fn smoothing(&self) -> Option<f64> {
        let widest = self.accuracy.iter().fold(0.0f64, |most, own| most.max(own.width));
        self.blurs_reversals().then_some(2.0 * REACH * widest)
    }

    /// What became of the reversals of a robot with coarse angles.
    pub fn on_coarse_angles(&self) -> Option<String> {
        let is_cut = matches!(self.mechanism, Mechanism::Delta { .. }) && self.left_out > 0.0;
        let time = self.smoothing().filter(|_| is_cut)?;
        Some(format!(
            "{}: the angles are so coarse that they are smoothed over {:.0} ms; {:.0} % of the samples, near reversals that \
             this hides, left out",
            self.name,
            1e3 * time,
            100.0 * self.left_out
        ))
    }

    /// Time from sample `k − 1` to sample `k`, s: the sampling period, unless the times say otherwise.
    pub fn step(&self, k: usize) -> f64 {
        match k.checked_sub(1) {
            Some(before) if !is_even(&self.t[before..=k], self.dt) => self.t[k] - self.t[before],
            _ => self.dt,
        }
    }

    /// Mean time between the samples of a segment, s: the sampling period, unless the times say otherwise.
    pub fn period(&self, segment: &Range<usize>) -> f64 {
        match &self.t[segment.clone()] {
            t @ [first, .., last] if !is_even(t, self.dt) => (last - first) / (t.len() - 1) as f64,
            _ => self.dt,
        }
    }

    /// What became of the samples of `recording`, of which this is the dataset, if they are at unequal times.
    pub fn on_times(&self, recording: &Recording) -> Option<String> {
        let signals = &recording.signals;
        let (all, stretches) = (signals.len(), signals.stretches());
        if self.is_empty() || stretches.iter().all(|s| is_even(&signals.t[s.clone()], self.dt)) {
            return None;
        }
        let known = (self.len() as f64 / (1.0 - self.left_out)).round() as usize;
        let is_recorded = |t: &f64| signals.t.binary_search_by(|x| x.total_cmp(t)).is_ok();
        let late = match self.t.iter().all(is_recorded) {
            true => "",
            false => "; the angles are those of even samples, only their times are late",
        };
        let left = match all - known.min(all) {
            0 => "all determined by the angles".to_string(),
            n => format!("{n} left out, as the angles do not determine how they move"),
        };
        Some(format!("{}: {all} samples at unequal times, {left}{late}", self.name))
    }

    /// Number of samples per `step` seconds, rounded, at least one. All decimation by a time step uses this rule.
    pub fn stride(&self, step: f64) -> usize {
        ((step / self.dt).round() as usize).max(1)
    }

    /// Consecutive blocks of `block` samples; a shorter rest at the end of a segment is dropped.
    pub fn blocks(&self, block: usize) -> impl Iterator<Item = Range<usize>> {
        let whole = self.segments.iter().filter(move |s| s.len() >= block);
        whole.flat_map(move |s| (s.start..=s.end - block).step_by(block)).map(move |k| k..k + block)
    }

    /// Means over blocks of `block` samples of a series of the dataset's length.
    pub fn means(&self, series: &[f64], block: usize) -> Vec<f64> {
        self.blocks(block).map(|b| series[b].iter().sum::<f64>() / block as f64).collect()
    }

    /// The joint motion at the middle samples of blocks of `block` samples, with the channels averaged over the
    /// blocks.
    pub fn averaged(&self, block: usize) -> Self {
        let blocks: Vec<Range<usize>> = self.blocks(block).collect();
        let middle = |b: &Range<usize>| b.start + block / 2;
        Self {
            t: blocks.iter().map(|b| self.t[middle(b)]).collect(),
            joints: blocks.iter().map(|b| self.joints[middle(b)]).collect(),
            loads: self.loads.as_ref().map(|loads| Arc::new(loads.averaged(&self.t, &blocks))),
            measured: self.measured.iter().map(|m| self.means(m, block).into()).collect(),
            segments: averaged_segments(std::slice::from_ref(self), block),
            dt: block as f64 * self.dt,
            half_width: self.half_width.map(|m| (m / block).max(MIN_HALF_WIDTH)),
            ..self.empty()
        }
    }

    /// Adds `offset`, rad or m, to the positions of an axis.
    pub fn shift(&mut self, axis: usize, offset: f64) {
        self.joints.iter_mut().for_each(|j| j.q[axis] += offset);
        self.readings.angles[axis].iter_mut().for_each(|q| *q += offset);
        self.readings.ringing = OnceLock::new();
    }

    /// Sets the measured values, one series per channel.
    pub fn set_measured(&mut self, series: Vec<Vec<f64>>) {
        self.measured = series.into_iter().map(Series::from).collect();
    }

    /// Keeps only `channels`, in their order; channels that the dataset lacks are ignored.
    pub fn restrict(&mut self, channels: &[Channel]) {
        let place = |c: &Channel| self.channels.iter().position(|own| own == c);
        let kept: Vec<usize> = channels.iter().filter_map(place).collect();
        self.measured = kept.iter().map(|&i| std::mem::take(&mut self.measured[i])).collect();
        self.channels = kept.iter().map(|&i| self.channels[i]).collect();
    }

    /// Measured series of channel `c`; of a single axis under a measured load without it: its residual has the noise of
    /// both sensors.
    pub(crate) fn borne(&self, c: usize) -> Cow<'_, [f64]> {
        let load = self.loads.as_ref().filter(|_| self.mechanism.axes() == 1 && self.channels[c].drive().is_some());
        let Some(load) = load else { return Cow::Borrowed(&self.measured[c]) };
        let of = |(t, torque): (&f64, &f64)| torque - load.of_axis(*t).unwrap_or(0.0);
        Cow::Owned(self.t.iter().zip(&self.measured[c]).map(of).collect())
    }

    /// Noise standard deviation of each channel's residual: of its sensor, and of the accelerations by coarse angles.
    pub fn noise(&self, model: &Model) -> Vec<f64> {
        let of = |(sensor, angles): (f64, f64)| sensor.hypot(angles);
        self.sensor_noise(model).into_iter().zip(self.noise_by_angles(model)).map(of).collect()
    }

    /// RMS error of each predicted channel, N·m or N, by the standard errors of the accelerations.
    ///
    /// A channel changes by h_j = ∂τ/∂q̈_j with the acceleration of axis j, on which it depends linearly.
    fn noise_by_angles(&self, model: &Model) -> Vec<f64> {
        let mut squares = vec![0.0; self.channels.len()];
        let plant = self.plant(model);
        let stride = stride_for(self.len(), INSTANTS);
        let with_struts = self.channels.iter().any(|c| c.drive().is_none());
        let channels = |k: usize, axis: usize, by: f64| {
            let mut joints = self.joints[k];
            joints.qdd[axis] += by;
            let motion = plant.motion(&joints)?;
            steady_inverse_dynamics(&plant, self.t[k], &motion, with_struts)
        };
        let axes = (0..self.mechanism.axes()).filter(|&axis| self.accuracy[axis].acceleration > 0.0);
        for (axis, k) in axes.flat_map(|axis| (0..self.len()).step_by(stride).map(move |k| (axis, k))) {
            let error = self.accuracy[axis].acceleration;
            // A pose that the machine cannot take is reported by the prediction.
            let (Ok(less), Ok(more)) = (channels(k, axis, -error), channels(k, axis, error)) else { continue };
            for (sum, channel) in squares.iter_mut().zip(&self.channels) {
                *sum += (0.5 * (more.of(*channel) - less.of(*channel))).powi(2);
            }
        }
        let instants = self.len().div_ceil(stride).max(1) as f64;
        squares.into_iter().map(|sum| (sum / instants).sqrt()).collect()
    }

    /// Noise standard deviation of each channel's sensor: from the setup, else estimated from the channel's differences, else
    /// from the model.
    fn sensor_noise(&self, model: &Model) -> Vec<f64> {
        let sigma = |c: usize| {
            let drive = self.channels[c].drive();
            let stated = drive.zip(self.setup.torque_noise).map(|(i, stated)| stated[i]).filter(|s| *s > 0.0);
            let stated = stated.filter(|_| self.loads.is_none());
            let seen = || difference_sigma(&self.borne(c), &self.segments, 4).filter(|s| *s > 0.0);
            stated.or_else(seen).unwrap_or(drive.map_or(model.noise.strut_force, |i| model.noise.torque[i]))
        };
        (0..self.channels.len()).map(sigma).collect()
    }

    /// Standard deviation of the noise in means over `block` samples of each channel: σ/√n of white noise of the
    /// [`Self::noise`] σ, n = `block`.
    ///
    /// Noise with memory averages less. Its means over m samples, `SMOOTH` long, scatter by σ_m > σ/√m; a mean over n
    /// samples contains n/m of them and scatters by σ_m·√(m/n). Of a memory as long as m it is a lower bound, as
    /// [`difference_sigma`] sees neighbouring means only: of AR(1) noise a = 0.6 at 2.5 kHz 1.27 σ/√n instead of 2 σ/√n.
    ///
    /// Errors of the accelerations are largest at the inverse of the smoothing's time scale w: a wave of that frequency has
    /// the mean square ½·sinc²(T/2w) in means over T, here 1/(1 + ½·(T/w)²) of it.
    pub fn noise_of_means(&self, model: &Model, block: usize) -> Vec<f64> {
        let inner = self.stride(SMOOTH).min(block);
        let segments = averaged_segments(std::slice::from_ref(self), inner);
        let of = |(c, sigma): (usize, f64)| {
            let seen = difference_sigma(&self.means(&self.borne(c), inner), &segments, 4).unwrap_or(0.0);
            (sigma / (block as f64).sqrt()).max(seen * (inner as f64 / block as f64).sqrt())
        };
        let width = self.accuracy.iter().fold(0.0f64, |most, own| most.max(own.width));
        let waves = block as f64 * self.dt / width.max(f64::MIN_POSITIVE);
        let kept = (1.0 + 0.5 * waves.powi(2)).sqrt().recip();
        let sensor = self.sensor_noise(model).into_iter().enumerate().map(of);
        sensor.zip(self.noise_by_angles(model)).map(|(sensor, angles)| sensor.hypot(kept * angles)).collect()
    }
}

/// Segments of all datasets one after another, after averaging over blocks of `block` samples.
pub fn averaged_segments(datasets: &[Dataset], block: usize) -> Vec<Range<usize>> {
    let mut end = 0;
    let averaged = datasets.iter().flat_map(|t| &t.segments).filter(|s| s.len() >= block).map(|s| {
        let start = end;
        end += s.len() / block;
        start..end
    });
    averaged.collect()
}

/// Smallest stride with which at most `most` of `n` samples remain. It is for sums over a given number of instants,
/// independent of the duration; decimation that depends on frequencies uses [`Dataset::stride`].
pub fn stride_for(n: usize, most: usize) -> usize {
    n.div_ceil(most.max(1)).max(1)
}

/// Ranges of each of `pieces` in which a lone axis moves; all of it if it hardly ever does.
///
/// Static friction takes any value up to its limit at rest, so the torque of an axis that stands is no function of its
/// state. Positions within a few resolutions over [`STANDING`] are rest; and of an axis that is read at unequal times and so
/// rarely that its reversals are not resolved, a reading that its neighbours repeat: it sticks and slips, and the sign of its rate
/// is not determined there.
fn moving<'a>(
    signals: &Signals,
    pieces: impl Iterator<Item = &'a Range<usize>> + Clone,
    resolution: f64,
) -> Vec<Vec<Range<usize>>> {
    let all: Vec<Vec<Range<usize>>> = pieces.clone().map(|p| vec![p.clone()]).collect();
    let angles = &signals[Channel::Angle(0)];
    let angle = |k: usize| angles[k];
    let (low, high) = angles.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(*x), b.max(*x)));
    let still = STILL.0 * resolution.max(STILL.1 * (high - low));
    let is_uneven = !signals.stretches().iter().all(|s| is_even(&signals.t[s.clone()], signals.sample_time()));
    let window = (STANDING / signals.sample_time()).round().max(2.0) as usize;
    let sticks = is_uneven && signals.sample_time() > STICKS;
    let of = |piece: &Range<usize>| -> Vec<Range<usize>> {
        let mut moves = vec![true; piece.len()];
        for start in piece.start..piece.end.saturating_sub(window) {
            let near = |k: usize| (angle(k) - angle(start)).abs() <= still;
            if (start..=start + window).all(near) {
                moves[start - piece.start..=start + window - piece.start].fill(false);
            }
        }
        for k in (piece.start + 1..piece.end.saturating_sub(1)).filter(|_| sticks) {
            moves[k - piece.start] &=
                (angle(k - 1) - angle(k)).abs().max((angle(k + 1) - angle(k)).abs()) > ROUNDED * resolution;
        }
        let long = |run: &Range<usize>| is_uneven || run.len() > 2 * MIN_HALF_WIDTH;
        runs(&moves, piece.start).into_iter().filter(long).collect()
    };
    let moving: Vec<Vec<Range<usize>>> = pieces.map(of).collect();
    let least = if is_uneven { ENOUGH } else { MOVING * samples(&all) };
    if samples(&moving) < least { all } else { moving }
}

/// Whether the readings do not change from `reach` samples before until `reach` samples after each sample.
fn standing(readings: &[f64], reach: usize) -> Vec<bool> {
    let mut stands = vec![false; readings.len()];
    let mut first = 0;
    for run in readings.chunk_by(|a, b| a == b) {
        let last = first + run.len();
        if run.len() > 2 * reach {
            stands[first + reach..last - reach].fill(true);
        }
        first = last;
    }
    stands
}

/// Number of samples in ranges.
fn samples(ranges: &[Vec<Range<usize>>]) -> f64 {
    ranges.iter().flatten().map(Range::len).sum::<usize>() as f64
}

/// Runs of `true`, shifted by `offset`.
fn runs(flags: &[bool], offset: usize) -> Vec<Range<usize>> {
    let mut found = Vec::new();
    let mut start = None;
    for (k, flag) in flags.iter().chain([&false]).enumerate() {
        match (flag, start) {
            (true, None) => start = Some(k),
            (false, Some(first)) => {
                found.push(first + offset..k + offset);
                start = None;
            }
            _ => {}
        }
    }
    found
}

fn measured_channels(signals: &Signals, configuration: Configuration) -> Vec<Channel> {
    let mut channels = Channel::of_drives(signals.mechanism);
    if signals.mechanism.has(Part::Linkage, configuration == Configuration::Assembled) {
        for s in 0..signals.mechanism.struts() {
            channels.extend(
                [Channel::StrutUpper(s), Channel::StrutLower(s)].into_iter().filter(|c| signals.get(*c).is_some()),
            );
        }
    }
    channels
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::Joint;

    /// A lone axis at 1 kHz: at rest for `rest` seconds, then cosine strokes of 0.4 rad and 1 s, `strokes` of them, with a
    /// pause of `pause` seconds after each.
    fn strokes(rest: f64, strokes: usize, pause: f64) -> Dataset {
        let mut angles = vec![0.0; (1e3 * rest) as usize];
        for stroke in 0..strokes {
            let from = 0.4 * (stroke % 2) as f64;
            let way = if from > 0.0 { -0.2 } else { 0.2 };
            angles.extend((0..1000).map(|k| from + way * (1.0 - (std::f64::consts::PI * f64::from(k) * 1e-3).cos())));
            angles.extend(vec![from + 2.0 * way; (1e3 * pause) as usize]);
        }
        let samples: Vec<[f64; 3]> = angles
            .into_iter()
            .enumerate()
            .map(|(k, q): (_, f64)| [k as f64 * 1e-3, (q * 1e5).round() / 1e5, 0.0])
            .collect();
        let signals = Signals::of_axis(Joint::Revolute, &samples);
        Dataset::new(&Recording { signals, ..Recording::default() })
    }

    #[test]
    fn rest_of_a_lone_axis_is_left_out() {
        // 2 s of rest, then four strokes with pauses of 1 s: of 10 s the axis moves for 4.
        let moves = strokes(2.0, 4, 1.0);
        assert_eq!(moves.segments.len(), 4);
        assert!((moves.left_out - 0.6).abs() < 0.03, "{}", moves.left_out);
        // Within 0.3 s nothing is at rest, and a recording of rest alone is kept.
        assert_eq!(strokes(0.0, 4, 0.2).left_out, 0.0);
        assert_eq!(strokes(5.0, 0, 0.0).left_out, 0.0);
    }

    /// Arms that swing by 0.4 rad within 1 s and stand for 1 s, read in steps of 1 mrad: where the readings do not change, the
    /// rate is known to be zero; left out are beginnings and ends of the swings only.
    #[test]
    fn coarse_angles_at_rest_are_kept() {
        let swing = |k: usize| {
            let phase = (k % 4000) as f64 * 1e-3;
            let part = if phase < 2.0 { phase.min(1.0) } else { 1.0 - (phase - 2.0).min(1.0) };
            (200.0 * (1.0 - (std::f64::consts::PI * part).cos())).round() * 1e-3
        };
        let t: Vec<f64> = (0..8000).map(|k| k as f64 * 1e-3).collect();
        let q: Vec<[f64; 4]> = (0..8000).map(|k| [swing(k), swing(k), swing(k), 0.0]).collect();
        let signals = Signals::of_drives(crate::model::testing::irb360().mechanism, t, &q, &vec![[0.0; 4]; 8000]);
        let dataset = Dataset::new(&Recording { signals, ..Recording::default() });
        assert!((0.2..0.35).contains(&dataset.left_out), "{}", dataset.left_out);
        assert!(dataset.joints.iter().filter(|joints| joints.qd[0].abs() < 1e-3).count() > 2500);
    }

    /// White noise of 0.1, and AR(1) noise a = 0.6 of the same σ, whose means scatter by twice as much and whose differences
    /// show 0.53 σ, on a torque of 50 N·m at 3 Hz; the means over 2 ms of the latter show 1.27 of σ/√n (own simulation in
    /// NumPy, ±0.01). Relative standard error of 20 000 differences of order 4: about 1 %.
    #[test]
    fn noise_of_means_follows_the_memory_of_the_noise() {
        use rand::SeedableRng;
        use rand_distr::{Distribution, StandardNormal};
        let block = 50;
        for (memory, ratio) in [(0.0, 1.0), (0.6, 1.27)] {
            let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(11);
            let mut noise = 0.0;
            let mut samples = Vec::new();
            for k in 0..100_000 {
                let drawn: f64 = StandardNormal.sample(&mut rng);
                noise = memory * noise + 0.1 * (1.0f64 - memory * memory).sqrt() * drawn;
                let phase = 19.0 * f64::from(k) * 4e-4;
                samples.push([f64::from(k) * 4e-4, phase.sin(), 50.0 * phase.cos() + noise]);
            }
            let signals = Signals::of_axis(Joint::Revolute, &samples);
            let dataset = Dataset::new(&Recording { signals, ..Recording::default() });
            let sigma = dataset.noise_of_means(&crate::model::testing::slide(), block)[0];
            let expected = 0.1 * ratio / (block as f64).sqrt();
            assert!((sigma / expected - 1.0).abs() < 0.03, "{memory}: {sigma} {expected}");
        }
    }

    #[test]
    fn pieces_are_segments_of_their_own() {
        let whole = strokes(0.0, 4, 1.0);
        let sparse = whole.sparse(300, 3);
        // Pieces begin every 900 samples, and end where the axis comes to rest.
        let pieces: Vec<Dataset> =
            (0..whole.len()).step_by(900).map(|k| whole.window(k..(k + 300).min(whole.len()))).collect();
        assert_eq!(sparse.len(), pieces.iter().map(Dataset::len).sum::<usize>());
        assert_eq!(sparse.segments.len(), pieces.iter().map(|piece| piece.segments.len()).sum::<usize>());
        assert!(sparse.segments.iter().all(|s| s.clone().skip(1).all(|k| sparse.t[k] - sparse.t[k - 1] < 1.5e-3)));
        assert_eq!(sparse.t[300], whole.t[900]);
        assert_eq!((sparse.measured[0].len(), sparse.joints.len()), (sparse.len(), sparse.len()));
        assert!(whole.resolution(0) > 5e-6 && whole.resolution(0) < 2e-5 && sparse.resolution(0) == 0.0);
    }
}
