//! Bandwidth of the accelerations of a lone axis.
//!
//! Noise of an encoder and the ringing of a gear or of what the axis carries are in the measured acceleration, but not as
//! the inertia times it in the torque. Least squares with such an acceleration attenuates the inertia, and gravity with
//! it where the motion swings [Fuller 1987]. The acceleration is therefore low-passed, as is usual before the regression
//! [Gautier 1997], here with zero phase and the cut-off with which one regression of the torque on inertia, friction and
//! weight leaves least.

use std::f64::consts::{PI, SQRT_2};

use super::Dataset;
use super::least_squares::least_squares;
use crate::effects::smooth_sign;
use crate::evidence::noise::correlation_time;
use crate::machine::{Joint, Mechanism};

/// Lowest cut-off tried, Hz, and ratio between those tried.
const CUT_OFFS: (f64, f64) = (3.0, 1.26);
/// Highest cut-off tried, relative to the sampling frequency.
const HIGHEST: f64 = 0.4;
/// Ratio of the mean squares left with the cut-off to those without, from which it is used: smaller gains may be those of
/// reversals, which a filter blurs in other recordings.
const MATTERS: f64 = 0.9;
/// Twice the logarithm of the likelihood ratio from which it is used.
const CLEAR: f64 = 2.0;
/// Steepness of friction's change of sign, relative to the reciprocal of the RMS speed.
const STEEPNESS: [f64; 2] = [5.0, 50.0];
/// Delays and time constants of low-passes of the torque that would explain as much, samples.
const LATE: [f64; 6] = [0.5, 1.0, 2.0, 4.0, 8.0, 16.0];

/// Cut-off (Hz) of the accelerations of a lone axis with which its torque follows the motion best; `None` if all of the
/// acceleration shows in the torque, or if torques that are late or low-passed explain as well that some does not.
pub fn bandwidth(mechanism: Mechanism, datasets: &[Dataset]) -> Option<f64> {
    if !matches!(mechanism, Mechanism::Axis(_)) || datasets.iter().all(Dataset::is_empty) {
        return None;
    }
    let revolute = mechanism.joint() == Joint::Revolute;
    let regression = Regression { datasets, revolute };
    let plain = regression.left(&|d| d.joints.iter().map(|j| j.qdd[0]).collect(), None)?;
    let highest = HIGHEST / datasets.iter().map(|d| d.dt).fold(0.0, f64::max);
    let tried = std::iter::successors(Some(CUT_OFFS.0), |f| Some(f * CUT_OFFS.1)).take_while(|f| *f < highest);
    let left = |cut_off: f64| Some((cut_off, regression.left(&|d| low_passed(d, cut_off), None)?));
    let (cut_off, best) = tried.filter_map(left).min_by(|a, b| a.1.mean_square.total_cmp(&b.1.mean_square))?;
    let gained = best.independent * (plain.mean_square / best.mean_square).ln();
    if best.mean_square > MATTERS * plain.mean_square || gained < CLEAR {
        return None;
    }
    let late = |by: &f64| regression.left(&|d| d.joints.iter().map(|j| j.qdd[0]).collect(), Some(*by));
    let rivals = LATE.iter().filter_map(late).map(|left| left.mean_square);
    rivals.fold(f64::INFINITY, f64::min).gt(&best.mean_square).then_some(cut_off)
}

/// Low-passes the accelerations of lone axes at `cut_off`, Hz.
pub fn narrow(datasets: &mut [Dataset], cut_off: f64) {
    for dataset in datasets {
        let smooth = low_passed(dataset, cut_off);
        dataset.joints.iter_mut().zip(smooth).for_each(|(j, qdd)| j.qdd[0] = qdd);
    }
}

/// What a regression leaves.
struct Left {
    mean_square: f64,
    /// Number of independent samples.
    independent: f64,
}

/// Regression of the torques of all recordings on inertia, friction, a constant and, of a turning axis, weight.
struct Regression<'a> {
    datasets: &'a [Dataset],
    revolute: bool,
}

impl Regression<'_> {
    /// What is left with the acceleration that `of` gives; all features go through a low-pass with the time constant
    /// `late`, samples, if there is one.
    fn left(&self, of: &dyn Fn(&Dataset) -> Vec<f64>, late: Option<f64>) -> Option<Left> {
        let count: usize = self.datasets.iter().map(Dataset::len).sum();
        let speed = self.datasets.iter().flat_map(|d| &d.joints).map(|j| j.qd[0].powi(2)).sum::<f64>();
        let speed = (speed / count as f64).sqrt().max(f64::MIN_POSITIVE);
        let mut features: Vec<Vec<f64>> = Vec::new();
        let mut push = |of: &dyn Fn(&Dataset) -> Vec<f64>| {
            let one = |d: &Dataset| late.map_or_else(|| of(d), |late| delayed(d, &of(d), late));
            features.push(self.datasets.iter().flat_map(one).collect());
        };
        push(of);
        push(&|d| d.joints.iter().map(|j| j.qd[0]).collect());
        for steepness in STEEPNESS {
            push(&|d| d.joints.iter().map(|j| smooth_sign(j.qd[0], steepness / speed)).collect());
        }
        if self.revolute {
            push(&|d| d.joints.iter().map(|j| j.q[0].sin()).collect());
            push(&|d| d.joints.iter().map(|j| j.q[0].cos()).collect());
        }
        push(&|d| vec![1.0; d.len()]);
        let torque: Vec<f64> = self.datasets.iter().flat_map(|d| d.borne(0).into_owned()).collect();
        let columns: Vec<&[f64]> = features.iter().map(Vec::as_slice).collect();
        let fit = least_squares(&columns, &torque)?;
        let rest = |k: usize| torque[k] - fit.beta.iter().zip(&columns).map(|(b, f)| b * f[k]).sum::<f64>();
        let mut start = 0;
        let rests: Vec<Vec<f64>> = self
            .datasets
            .iter()
            .flat_map(|d| {
                start += d.len();
                let first = start - d.len();
                d.segments.iter().map(move |s| first + s.start..first + s.end)
            })
            .map(|s| s.map(rest).collect())
            .collect();
        Some(Left { mean_square: fit.mean_square, independent: count as f64 / correlation_time(&rests) })
    }
}

/// A series of a dataset after a first-order low-pass with the time constant `late`, samples, segment by segment.
fn delayed(dataset: &Dataset, series: &[f64], late: f64) -> Vec<f64> {
    let share = 1.0 - (-1.0 / late).exp();
    let mut out = Vec::with_capacity(series.len());
    for segment in &dataset.segments {
        let mut state = series[segment.start];
        out.extend(series[segment.clone()].iter().map(|x| {
            state += share * (x - state);
            state
        }));
    }
    out
}

/// Accelerations of a lone axis after a Butterworth filter of second order, forward and backward. Unequal steps count as
/// one sampling period each.
fn low_passed(dataset: &Dataset, cut_off: f64) -> Vec<f64> {
    // The bilinear transform of 1/(s² + √2·s + 1) at tan(π·f·T).
    let k = (PI * cut_off * dataset.dt).tan();
    let scale = 1.0 / (1.0 + SQRT_2 * k + k * k);
    let (gain, back) = (k * k * scale, [2.0 * (k * k - 1.0) * scale, (1.0 - SQRT_2 * k + k * k) * scale]);
    let pass = |x: &mut [f64]| {
        // At rest with the first value.
        let (mut before, mut after) = ([x[0]; 2], [x[0]; 2]);
        for value in x.iter_mut() {
            let next = gain * (*value + 2.0 * before[0] + before[1]) - back[0] * after[0] - back[1] * after[1];
            (before, after) = ([*value, before[0]], [next, after[0]]);
            *value = next;
        }
    };
    let pad = (3.0 / (cut_off * dataset.dt)).ceil() as usize;
    let mut out = Vec::with_capacity(dataset.len());
    for segment in &dataset.segments {
        let own: Vec<f64> = dataset.joints[segment.clone()].iter().map(|j| j.qdd[0]).collect();
        let pad = pad.min(own.len() - 1);
        // Mirrored through the end points.
        let start = own[1..=pad].iter().rev().map(|x| 2.0 * own[0] - x);
        let last = own[own.len() - 1];
        let end = own[own.len() - 1 - pad..own.len() - 1].iter().rev().map(|x| 2.0 * last - x);
        let mut all: Vec<f64> = start.chain(own.iter().copied()).chain(end).collect();
        for _ in 0..2 {
            pass(&mut all);
            all.reverse();
        }
        out.extend_from_slice(&all[pad..pad + own.len()]);
    }
    out
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;
    use crate::recording::{Recording, Signals};

    /// A pendulum at 500 Hz for 10 s along two sines with 0.05 kg·m² and 1 N·m of weight; its encoder reads a ringing of
    /// `ringing` rad at 30 Hz, too, of which the torque has nothing.
    fn pendulum(ringing: f64) -> Dataset {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut samples = Vec::new();
        for k in 0..5000 {
            let t = f64::from(k) * 2e-3;
            let sum = |of: &dyn Fn(f64, f64) -> f64| of(0.8, 4.1) + of(0.3, 9.3);
            let [q, qd] = [sum(&|a, w| a * (w * t).sin()), sum(&|a, w| a * w * (w * t).cos())];
            let qdd = sum(&|a, w| -a * w * w * (w * t).sin());
            let noise: f64 = StandardNormal.sample(&mut rng);
            let tau = 0.05 * qdd + 0.2 * (20.0 * qd).tanh() + 0.05 * qd + q.sin() + 0.02 * noise;
            samples.push([t, q + ringing * (188.5 * t + (7.0 * t).sin()).sin(), tau]);
        }
        let signals = Signals::of_axis(Joint::Revolute, &samples);
        Dataset::new(&Recording { name: "pendulum".into(), signals, ..Recording::default() })
    }

    fn inertia(dataset: &Dataset) -> f64 {
        let of = |f: &dyn Fn(usize) -> f64| (0..dataset.len()).map(f).collect::<Vec<_>>();
        let j = &dataset.joints;
        let features =
            [of(&|k| j[k].qdd[0]), of(&|k| j[k].qd[0]), of(&|k| (20.0 * j[k].qd[0]).tanh()), of(&|k| j[k].q[0].sin())];
        least_squares(&features.each_ref().map(Vec::as_slice), &dataset.measured[0]).unwrap().beta[0]
    }

    #[test]
    fn ringing_that_the_torque_lacks_is_taken_out() {
        let mechanism = Mechanism::axis(Joint::Revolute);
        assert_eq!(bandwidth(mechanism, &[pendulum(0.0)]), None);
        // 1 mrad at 30 Hz are 36 rad/s², more than the motion has.
        let mut rings = pendulum(1e-3);
        let before = inertia(&rings);
        let cut_off = bandwidth(mechanism, std::slice::from_ref(&rings)).expect("a cut-off");
        assert!((3.0..25.0).contains(&cut_off), "{cut_off} Hz");
        narrow(std::slice::from_mut(&mut rings), cut_off);
        let after = inertia(&rings);
        assert!(before < 0.025 && (after - 0.05).abs() < 0.003, "{before} {after} kg·m²");
    }

    #[test]
    fn the_filter_has_no_phase_and_halves_the_power_twice_at_its_cut_off() {
        let mut dataset = pendulum(0.0);
        let wave = |k: usize| (2.0 * PI * 10.0 * k as f64 * 2e-3).sin();
        dataset.joints.iter_mut().enumerate().for_each(|(k, j)| j.qdd[0] = wave(k));
        let passed = low_passed(&dataset, 10.0);
        let middle = 500..dataset.len() - 500;
        middle.for_each(|k| assert!((passed[k] - 0.5 * wave(k)).abs() < 1e-3, "{k}: {}", passed[k]));
    }
}
