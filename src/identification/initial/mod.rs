//! A first model from recordings alone: what they tell of a machine of which nothing else is known.
//!
//! Every number comes with the way it was found, for the model file and the screen. The numbers are initial values: a
//! fit of the model afterwards is more accurate.

mod axis;
mod delta;
mod quantum;

pub use axis::axis;
pub use delta::delta;
pub use quantum::quantum;

use std::f64::consts::TAU;

use thiserror::Error;

use crate::effects::Unit;
use crate::identification::filtering::noise_level;
use crate::model::Model;
use crate::recording::{Channel, Recording};

/// A model with the origin of its numbers.
#[derive(Clone)]
pub struct Initial {
    /// The model.
    pub model: Model,
    /// Numbers of the model that follow from the recordings, in the order of the file.
    pub numbers: Vec<Number>,
    /// What else the recordings tell, and what they do not, in sentences.
    pub remarks: Vec<String>,
}

/// A number of a model file and how it was found.
#[derive(Clone, Debug)]
pub struct Number {
    /// Table of the file; empty for the keys above all tables.
    pub table: &'static str,
    /// Key in the table.
    pub key: &'static str,
    /// Values: one, or one per axis or end.
    pub values: Vec<f64>,
    /// Unit.
    pub unit: Unit,
    /// Standard errors, as far as the number was estimated.
    pub std: Vec<f64>,
    /// How it was found.
    pub how: String,
}

/// Why recordings give no model.
#[derive(Debug, Error)]
pub enum InitialError {
    /// No samples remain after differentiation.
    #[error("{name}: differentiation leaves no samples; expected a stretch of 5 s without gaps")]
    TooShort {
        /// Name of the recording.
        name: String,
    },
    /// The motion does not distinguish inertia and friction.
    #[error("the recordings do not determine inertia and friction; expected a motion to and fro of at least 5 s")]
    NoMotion,
    /// The torque has another unit than the known load.
    #[error(
        "the recorded torque is {scale} times the load; expected both in one unit: \
         --map \"tau1=tau1*{factor}\" if the load is right"
    )]
    Scale {
        /// Recorded torque per load.
        scale: f64,
        /// Its reciprocal.
        factor: f64,
    },
    /// The template is the model of another machine.
    #[error(
        "the template `{template}` has {expected} axes, the recording {found}; expected a template of the same machine"
    )]
    OtherMachine {
        /// Name of the template.
        template: String,
        /// Number of its axes.
        expected: usize,
        /// Number of axes of the recording.
        found: usize,
    },
}

/// Factor on the largest torque and speed of a recording for the limit of a drive.
const MARGIN: f64 = 1.2;
/// Factor on the value below which acceleration and jerk are most of the time, and that share of the time.
const DERIVED: (f64, f64) = (1.5, 0.999);
/// Share of the travel added at both ends.
const BEYOND: f64 = 0.05;
/// Duration below which a recording is short, s.
const SHORT: f64 = 5.0;
/// Period of the means over which regressions are done, s.
const PERIOD: f64 = 2e-3;

/// Smallest and largest value of series, with [`BEYOND`] of their distance added.
fn widened(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
    let by = BEYOND * (high - low);
    [low - by, high + by]
}

/// Value below which the share `share` of the absolute values is.
fn quantile(values: impl Iterator<Item = f64>, share: f64) -> f64 {
    let mut all: Vec<f64> = values.map(f64::abs).collect();
    if all.is_empty() {
        return 0.0;
    }
    let k = ((all.len() - 1) as f64 * share) as usize;
    *all.select_nth_unstable_by(k, f64::total_cmp).1
}

/// A number rounded up to `digits` significant digits.
fn rounded_up(x: f64, digits: i32) -> f64 {
    if x <= 0.0 || !x.is_finite() {
        return x;
    }
    let unit = 10f64.powi(x.log10().floor() as i32 + 1 - digits);
    crate::model::history::rounded_to((x / unit).ceil() * unit, digits)
}

/// Encoder step of an axis over all recordings, rad or m; `None` if its angles have none.
fn encoder_step(recordings: &[Recording], axis: usize) -> Option<f64> {
    let mut pieces: Vec<&[f64]> = Vec::new();
    for signals in recordings.iter().map(|r| &r.signals) {
        pieces.extend(signals.stretches().into_iter().map(|s| &signals[Channel::Angle(axis)][s]));
    }
    quantum(&pieces)
}

/// Step of an encoder whose rounding would be as large as the noise of the angles of an axis, rad or m; `None` for
/// angles without noise.
fn step_of_noise(recordings: &[Recording], axis: usize) -> Option<f64> {
    let of = |r: &Recording| -> Vec<Vec<f64>> {
        let series = r.signals.stretches().into_iter();
        series.map(|s| r.signals[Channel::Angle(axis)][s].to_vec()).collect()
    };
    let noise = noise_level(&recordings.iter().flat_map(of).collect::<Vec<_>>());
    // The standard deviation of a uniform density over one step.
    (noise > 0.0).then_some(12f64.sqrt() * noise)
}

/// Bits per motor turn of an encoder with `step` at the output of a gear, as the model file counts them.
fn encoder_bits(step: f64, gear_ratio: f64) -> u32 {
    (TAU / (step * gear_ratio)).log2().round().clamp(1.0, 32.0) as u32
}

/// Sampling time of the recordings, s: that of the first, with a remark if others differ.
fn sample_time(recordings: &[Recording], remarks: &mut Vec<String>) -> f64 {
    let times: Vec<f64> = recordings.iter().map(|r| r.signals.sample_time()).collect();
    let first = times.first().copied().unwrap_or(1e-3);
    if times.iter().any(|t| (t / first - 1.0).abs() > 0.01) {
        remarks.push("The recordings differ in their sampling time; the model has that of the first.".into());
    }
    for r in recordings {
        let duration = r.signals.t.last().zip(r.signals.t.first()).map_or(0.0, |(b, a)| b - a);
        // The last sample lasts a period, too.
        if duration + 1.5 * r.signals.sample_time() < SHORT {
            remarks.push(format!("{} lasts {duration:.1} s only; {SHORT} s or more tell more.", r.name));
        }
    }
    // Median steps carry the rounding of the times.
    crate::model::history::rounded_to(first, 6)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_have_their_margins() {
        assert_eq!(widened([0.0, 2.0, -2.0].into_iter()), [-2.2, 2.2]);
        assert_eq!(quantile([1.0, -4.0, 2.0, 3.0].into_iter(), 1.0), 4.0);
        assert_eq!(quantile([1.0, -4.0, 2.0, 3.0].into_iter(), 0.4), 2.0);
        assert_eq!((rounded_up(12.31, 2), rounded_up(0.0101, 2), rounded_up(0.0, 2)), (13.0, 0.011, 0.0));
        // 2^15 steps per motor turn behind a gear of 33.
        assert_eq!(encoder_bits(TAU / 32768.0 / 33.0, 33.0), 15);
    }
}
