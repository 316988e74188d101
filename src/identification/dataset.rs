//! [`Dataset`]: a recording prepared for the dynamics.

mod determined;

use std::borrow::Cow;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

use self::determined::moving;
pub use self::determined::runs;
use super::derivatives::{Accuracy, Angles, Method, Motions};
use super::filtering::MIN_HALF_WIDTH;
use crate::dynamics::Plant;
use crate::kinematics::JointState;
use crate::machine::{Configuration, Mechanism, Part, PerAxis, Setup, each};
use crate::model::Model;
use crate::recording::{AxisRows, Channel, Loads, Recording, Rows, Series, Signals, is_even};

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
    pub half_width: PerAxis<usize>,
    /// Accuracy of the smoothed motion per axis.
    pub accuracy: PerAxis<Accuracy>,
    /// Ranges of samples so close to a reversal that the smoothing blurs what changes there; fits do not use them.
    pub near_reversals: Vec<Range<usize>>,
    /// What a robot did between segments, where its coarse angles do not resolve a reversal; in the order of the samples.
    pub between: Vec<Between>,
}

/// Motion between two segments.
#[derive(Clone, Debug)]
pub struct Between {
    /// First sample after it.
    pub before: usize,
    /// Times, s, and smoothed joint motion of the samples that were left out.
    pub motion: Arc<[(f64, JointState)]>,
}

/// Encoder angles, and the motion including the ringing of elastic gears once it was requested.
#[derive(Clone, Debug, Default)]
pub struct EncoderReadings {
    angles: PerAxis<Series>,
    ringing: OnceLock<Vec<JointState>>,
}

impl EncoderReadings {
    fn rows(&self) -> AxisRows<'_> {
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
            half_width: each(MIN_HALF_WIDTH),
            accuracy: each(Accuracy::default()),
            near_reversals: Vec::new(),
            between: Vec::new(),
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
            Mechanism::Delta { .. } => dataset.resolved(&pieces),
        };
        for ((piece, joints), moving) in pieces.into_iter().zip(&moving) {
            dataset.keep_between(&piece, &joints, moving, t);
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
        dataset.near_reversals = dataset.find_near_reversals();
        dataset
    }

    /// Keeps the motion of a robot in `piece` of the samples at the times `t` that is in none of the ranges `kept`.
    fn keep_between(&mut self, piece: &Range<usize>, joints: &[JointState], kept: &[Range<usize>], t: &[f64]) {
        let (mut end, mut before) = (piece.start, self.joints.len());
        for range in kept.iter().filter(|_| matches!(self.mechanism, Mechanism::Delta { .. })) {
            if end < range.start {
                let motion = (end..range.start).map(|k| (t[k], joints[k - piece.start])).collect();
                self.between.push(Between { before, motion });
            }
            (end, before) = (range.end, before + range.len());
        }
    }

    /// Times, s, and motion of what was left out just before sample `k`.
    pub fn motion_before(&self, k: usize) -> &[(f64, JointState)] {
        self.between.binary_search_by_key(&k, |between| between.before).map_or(&[], |i| &self.between[i].motion)
    }

    /// Times, s, and motion of the `samples` before sample `k`, and of what was left out before their segment.
    fn run_up(&self, k: usize, samples: usize) -> Vec<(f64, JointState)> {
        let segment = self.segments.iter().rfind(|s| s.start <= k).map_or(k, |s| s.start);
        let first = segment.max(k.saturating_sub(samples));
        let left_out = if first == segment { self.motion_before(segment) } else { &[] };
        left_out.iter().copied().chain((first..k).map(|k| (self.t[k], self.joints[k]))).collect()
    }

    /// The machine of `model` in the setup of the recording, under the loads that were measured.
    pub fn plant(&self, model: &Model) -> Plant {
        Plant::new(model, &self.setup).under(self.loads.clone())
    }

    /// Joint motion including the ringing of elastic gears after reversals; [`Self::joints`] for an exact motion, and where
    /// the angles do not resolve reversals.
    pub fn ringing(&self) -> &[JointState] {
        let angles = self.readings.rows();
        if angles.is_empty() || self.blurs_reversals() {
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
            near_reversals: self.near_reversals.iter().filter_map(clip).collect(),
            between: self.between_at(|k| range.contains(&k).then(|| k - range.start)),
            ..self.empty()
        }
    }

    /// The motion between segments, with the first sample after it at the place that `at` gives; without it left out.
    fn between_at(&self, at: impl Fn(usize) -> Option<usize>) -> Vec<Between> {
        let moved = |own: &Between| Some(Between { before: at(own.before)?, motion: own.motion.clone() });
        self.between.iter().filter_map(moved).collect()
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

    /// The first of every `of` pieces of `length` samples, each a segment of its own, or several if it has gaps, and the motion
    /// during as many samples before each.
    ///
    /// # Panics
    /// If `length` or `of` is zero.
    pub fn sparse(&self, length: usize, of: usize) -> Self {
        let mut sparse = self.empty();
        for start in (0..self.len()).step_by(length * of) {
            let piece = self.window(start..(start + length).min(self.len()));
            let first = sparse.len();
            let run_up = Between { before: 0, motion: self.run_up(start, length).into() };
            let between = std::iter::once(run_up).chain(piece.between.into_iter().filter(|own| own.before > 0));
            let kept = between.filter(|own| !own.motion.is_empty());
            sparse.between.extend(kept.map(|own| Between { before: first + own.before, ..own }));
            sparse.t.extend(piece.t);
            sparse.joints.extend(piece.joints);
            sparse.measured.iter_mut().zip(piece.measured).for_each(|(all, own)| all.extend(own.iter().copied()));
            let shifted = |s: &Range<usize>| first + s.start..first + s.end;
            sparse.segments.extend(piece.segments.iter().map(shifted));
            sparse.near_reversals.extend(piece.near_reversals.iter().map(shifted));
        }
        sparse
    }

    /// Samples at which an axis has another direction than at the one before, within segments.
    pub fn reversals(&self, axis: usize) -> impl Iterator<Item = usize> {
        let rate = move |k: usize| self.joints[k].qd[axis];
        let within = self.segments.iter().flat_map(|s| s.start + 1..s.end);
        within.filter(move |&k| (rate(k - 1) < 0.0) != (rate(k) < 0.0))
    }

    /// Time from sample `k − 1` to sample `k`, s: the sampling period, unless the times within a segment say otherwise.
    pub fn step(&self, k: usize) -> f64 {
        match k.checked_sub(1) {
            Some(before) if !is_even(&self.t[before..=k], self.dt) && !self.starts_segment(k) => {
                self.t[k] - self.t[before]
            }
            _ => self.dt,
        }
    }

    /// Whether sample `k` is the first of a segment.
    fn starts_segment(&self, k: usize) -> bool {
        self.segments.binary_search_by_key(&k, |segment| segment.start).is_ok()
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

    /// Runs of blocks of `block` samples that contain a sample near a reversal, see [`Self::near_reversals`].
    pub fn blocks_near_reversals(&self, block: usize) -> Vec<Range<usize>> {
        let touches = |b: Range<usize>| self.near_reversals.iter().any(|r| r.start < b.end && b.start < r.end);
        runs(&self.blocks(block).map(touches).collect::<Vec<_>>(), 0)
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
            // Angles that are smoothed stay distinct from exact ones.
            half_width: self.half_width.map(|m| (m / block).max(MIN_HALF_WIDTH + usize::from(m > MIN_HALF_WIDTH))),
            near_reversals: self.blocks_near_reversals(block),
            between: self.between_at(|k| blocks.binary_search_by_key(&k, |b| b.start).ok()),
            ..self.empty()
        }
    }

    /// Adds `offset`, rad or m, to the positions of an axis.
    pub fn shift(&mut self, axis: usize, offset: f64) {
        self.joints.iter_mut().for_each(|j| j.q[axis] += offset);
        for own in &mut self.between {
            let moved = |(t, mut joint): (f64, JointState)| {
                joint.q[axis] += offset;
                (t, joint)
            };
            own.motion = own.motion.iter().copied().map(moved).collect();
        }
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

    /// Arms that swing by 0.4 rad within 1 s and stand for 1 s. The encoders of the shipped robot determine when they stand and in
    /// which direction they move; with steps of 1 mrad the rests, at which friction takes any value, and all slow motion are
    /// left out.
    #[test]
    fn slow_motion_is_left_out_where_angles_are_coarse() {
        let swing = |k: usize, step: f64| {
            let phase = (k % 4000) as f64 * 1e-3;
            let part = if phase < 2.0 { phase.min(1.0) } else { 1.0 - (phase - 2.0).min(1.0) };
            (0.2 * (1.0 - (std::f64::consts::PI * part).cos()) / step).round() * step
        };
        let t: Vec<f64> = (0..8000).map(|k| k as f64 * 1e-3).collect();
        let left_out = |step: f64| {
            let q: Vec<[f64; 4]> = (0..8000).map(|k| [swing(k, step), swing(k, step), swing(k, step), 0.0]).collect();
            let mechanism = crate::model::testing::irb360().mechanism;
            let signals = Signals::of_drives(mechanism, t.clone(), &q, &vec![[0.0; 4]; 8000]);
            Dataset::new(&Recording { signals, ..Recording::default() }).left_out
        };
        assert_eq!(left_out(5.8e-6), 0.0);
        assert!((0.55..0.8).contains(&left_out(1e-3)), "{}", left_out(1e-3));
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
