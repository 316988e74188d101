//! Samples of a recording whose motion the readings determine; the others are left out of its dataset.

use std::ops::Range;

use super::Dataset;
use crate::identification::derivatives::{Accuracy, NEARBY, TURNING};
use crate::identification::filtering::MIN_HALF_WIDTH;
use crate::kinematics::JointState;
use crate::machine::{Mechanism, every_axis};
use crate::numerics::median;
use crate::recording::{Channel, Signals, is_even};

/// Half width of the differentiation, s, and least rate with a known sign, rad/s or m/s, up to which reversals are resolved:
/// friction changes its sign within ±0.01 rad/s, of which half must be seen.
const RESOLVED: (f64, f64) = (0.015, 0.005);
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
/// Time before and after a reversal that coarse angles do not resolve, in time scales of their smoothing.
const REACH: f64 = 4.0;
/// Time before and after a reversal that fine angles do not resolve, in time scales of their smoothing, and largest share of
/// the samples that a fit leaves out for it.
const NEAR: (f64, f64) = (2.0, 0.5);
/// Least duration, s, with which samples near reversals that are not resolved are left out.
const LEAST: f64 = 0.25;
/// Least share of the samples in motion with which those at rest are left out; at unequal times, least number of them: ten
/// for each parameter of inertia, friction and weight.
const MOVING: f64 = 0.2;
const ENOUGH: f64 = 50.0;

impl Dataset {
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
    pub fn is_coarse(&self) -> bool {
        let (time, rate) = RESOLVED;
        let is_wide = |m: usize| m > MIN_HALF_WIDTH && m as f64 * self.dt > time;
        self.half_width.iter().zip(&self.accuracy).any(|(m, own)| is_wide(*m) && own.rate > rate)
    }

    /// Ranges of each of `pieces` in which the coarse angles of a robot determine the sign of every rate, and how it
    /// accelerates; all of it if they hardly ever do.
    ///
    /// Friction jumps at a reversal, and the accelerations of all axes with it. Both are smoothed over the time scale of the
    /// smoothing, and friction of the wrong sign is an error of twice its size. At rest it takes any value up to its limit.
    pub(super) fn resolved(&self, pieces: &[(Range<usize>, Vec<JointState>)]) -> Vec<Vec<Range<usize>>> {
        let of = |(piece, joints): &(Range<usize>, Vec<JointState>)| {
            let mut is_resolved = vec![true; piece.len()];
            for axis in every_axis().filter(|&axis| self.half_width[axis] > MIN_HALF_WIDTH) {
                let Accuracy { width, rate, .. } = self.accuracy[axis];
                let reach = (REACH * width / self.dt).ceil() as usize;
                let rate_at = |k: usize| joints[k].qd[axis];
                let is_unsigned =
                    |k: &usize| rate_at(*k).abs() < rate || *k > 0 && (rate_at(k - 1) < 0.0) != (rate_at(*k) < 0.0);
                for k in (0..piece.len()).filter(is_unsigned) {
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

    /// Ranges of samples at reversals of axes that are in motion, where a fit must not compare torques with the smoothed
    /// motion; none where reversals are not resolved at all.
    ///
    /// Friction, and often the torque, jump at a reversal, and the accelerations of all axes with them. The smoothed
    /// acceleration changes over the time scale of the smoothing, and the smoothed rate changes its sign at another instant.
    /// Both errors have the same sign in the direction of motion before and after: friction at low speed would take them up.
    pub(super) fn find_near_reversals(&self) -> Vec<Range<usize>> {
        if self.blurs_reversals() {
            return Vec::new();
        }
        let mut is_near = vec![false; self.len()];
        for axis in (0..self.mechanism.axes()).filter(|&axis| self.half_width[axis] > MIN_HALF_WIDTH) {
            let reach = self.reach(axis);
            let nearby = (NEARBY / self.dt).ceil() as usize;
            for k in self.reversals(axis) {
                let around = k.saturating_sub(nearby)..(k + nearby).min(self.len());
                if self.joints[around].iter().any(|j| j.qd[axis].abs() >= TURNING) {
                    is_near[k.saturating_sub(reach)..(k + reach).min(self.len())].fill(true);
                }
            }
        }
        let share = is_near.iter().filter(|b| **b).count() as f64 / self.len().max(1) as f64;
        if share > NEAR.1 { Vec::new() } else { runs(&is_near, 0) }
    }

    /// Samples before and after a reversal of an axis that fine angles do not resolve.
    fn reach(&self, axis: usize) -> usize {
        (NEAR.0 * self.accuracy[axis].width / self.dt).ceil() as usize
    }

    /// Angle, rad or m, that an axis turns after a reversal before a fit uses its samples: the median, of the axis with the
    /// largest one.
    pub fn hidden_travel(&self) -> f64 {
        let of = |axis: usize| {
            let is_hidden = |k: &usize| self.near_reversals.iter().any(|near| near.contains(k));
            let end = |k: usize| (k + self.reach(axis)).min(self.len() - 1);
            let travel = |k: usize| (self.joints[end(k)].q[axis] - self.joints[k].q[axis]).abs();
            median(self.reversals(axis).filter(is_hidden).map(travel))
        };
        (0..self.mechanism.axes()).map(of).fold(0.0, f64::max)
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
}

/// Ranges of each of `pieces` in which a lone axis moves; all of it if it hardly ever does.
///
/// The torque of a standing axis is not a function of its state, because static friction takes any value up to its limit.
/// Positions within a few resolutions over [`STANDING`] are rest; and of an axis that is read at unequal times and so
/// rarely that its reversals are not resolved, a reading that its neighbours repeat: it sticks and slips, and the sign of its rate
/// is not determined there.
pub(super) fn moving<'a>(
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

/// Number of samples in ranges.
fn samples(ranges: &[Vec<Range<usize>>]) -> f64 {
    ranges.iter().flatten().map(Range::len).sum::<usize>() as f64
}

/// Runs of `true`, shifted by `offset`.
pub fn runs(flags: &[bool], offset: usize) -> Vec<Range<usize>> {
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
