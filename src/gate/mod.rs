//! Plausibility check of a recording against a model before anything is fitted.
//!
//! One regression per axis of the measured on the predicted torque of the unfitted model: sign, factor, order, zero,
//! lag, offset and payload of the recording. Effects missing in the model leave slope and correlation near one and
//! are not reported.

mod alone;
mod arrangement;
mod followed;
mod instants;
mod line;
mod load;
mod low_pass;
mod mild;
mod positions;
mod severe;

use std::fmt;

pub use alone::{carries_weight_alone, folded, inspect};
pub use arrangement::Arrangement;
pub use followed::{Followed, followed};
pub use line::Line;
pub use positions::positions;

use self::instants::{Instants, Predicted, plain};
use crate::identification::Dataset;
use crate::machine::Payload;
use crate::model::Model;

/// Kind of a finding about a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Problem {
    /// A torque has the opposite sign.
    TorqueSign,
    /// Angle and torque of an axis have the opposite sign.
    AxisSign,
    /// An angle has the opposite sign.
    PositionSign,
    /// A torque is scaled by a factor.
    Factor,
    /// A torque refers to the motor side of the gear.
    MotorSide,
    /// The column belongs to another axis.
    Order,
    /// An angle has another zero.
    Zero,
    /// Another machine's model: unreachable poses, or weight and inertia in another ratio.
    AnotherMachine,
    /// The torque does not follow the model's for an unknown reason.
    Unrelated,
    /// Torques, or positions of the end effector, are delayed or advanced relative to the angles.
    Lag,
    /// Torques are low-pass filtered, angles are not.
    LowPass,
    /// A load at the flange that the setup does not state.
    Payload,
    /// A constant torque.
    Offset,
    /// Torques without the weight of the arms.
    GravityRemoved,
    /// A torque without noise: a command or a calculation.
    Noiseless,
    /// Two columns that are one signal.
    Repeated,
    /// Coarse steps of an angle or a torque.
    Quantised,
    /// A line of the torque near half the sampling frequency.
    Alias,
    /// Angles in degrees.
    Degrees,
    /// A torque that only carries the weight of an axis, without inertia and friction.
    WeightAlone,
    /// An axis that stands for part of the time.
    Standstill,
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::TorqueSign => "torque_sign",
            Self::AxisSign => "axis_sign",
            Self::PositionSign => "position_sign",
            Self::Factor => "factor",
            Self::MotorSide => "motor_side",
            Self::Order => "order",
            Self::Zero => "zero",
            Self::AnotherMachine => "another_machine",
            Self::Unrelated => "unrelated",
            Self::Lag => "lag",
            Self::LowPass => "low_pass",
            Self::Payload => "payload",
            Self::Offset => "offset",
            Self::GravityRemoved => "gravity_removed",
            Self::Noiseless => "noiseless",
            Self::Repeated => "repeated",
            Self::Quantised => "quantised",
            Self::Alias => "alias",
            Self::Degrees => "degrees",
            Self::WeightAlone => "weight_alone",
            Self::Standstill => "standstill",
        })
    }
}

/// Numbers of a finding; those that do not apply are `None`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Evidence {
    /// Line of measured over predicted torque in the file's own arrangement.
    pub line: Option<Line>,
    /// Estimate (lag in s, cut-off in Hz, payload in kg, offset in N·m, zero in rad) and its standard error.
    pub value: Option<(f64, f64)>,
    /// RMS of measured − predicted in the file's own arrangement, N·m.
    pub rms_before: Option<f64>,
    /// RMS of measured − predicted with the remedy, N·m.
    pub rms_after: Option<f64>,
}

/// An error of a recording and its remedy.
#[derive(Clone, Debug)]
pub struct Finding {
    /// Name of the recording.
    pub recording: String,
    /// Axis, from 0; `None` if the finding concerns all.
    pub axis: Option<usize>,
    /// Kind of the error.
    pub problem: Problem,
    /// Whether a fit would be meaningless.
    pub severe: bool,
    /// Numbers.
    pub evidence: Evidence,
    /// Description without the numbers of the regression.
    pub sentence: String,
    /// Remedy.
    pub remedy: Remedy,
}

/// Remedy of a finding.
#[derive(Clone, Debug, PartialEq)]
pub enum Remedy {
    /// Assignments for `--map`.
    Map(Vec<String>),
    /// Kilograms for `--payload-mass`.
    PayloadMass(f64),
    /// The payload of a setup, where a mass on the axis does not explain the recording.
    Payload(Payload),
    /// Any other remedy, as text.
    Words(&'static str),
}

impl fmt::Display for Remedy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Map(assignments) => write!(f, "--map \"{}\"", assignments.join(", ")),
            Self::PayloadMass(mass) => write!(f, "--payload-mass {}", rounded(*mass, 3)),
            Self::Payload(load) => {
                let (mass, com, moment) = (load.mass, load.com.as_slice(), load.inertia_zz());
                write!(
                    f,
                    "a setup with the line `payload = {{ mass = {mass:?}, com = {com:?}, inertia_zz = {moment:?} }}`"
                )
            }
            Self::Words(words) => f.write_str(words),
        }
    }
}

/// Largest number of instants examined.
const INSTANTS: usize = 1200;

/// Findings about a recording of a machine like `model`; empty if it may be fitted.
///
/// Findings of lesser severity are searched only if no finding makes a fit meaningless.
pub fn examine(model: &Model, dataset: &Dataset) -> Vec<Finding> {
    let plant = plain(model, dataset);
    let instants = Instants::of(dataset, INSTANTS);
    // A law without a finite value is no error of the recording; the prediction reports it.
    let lawless = || Predicted::new(&plant, &dataset.channels, 0.0, &instants.joints(|j| *j)).lawless;
    if instants.at.is_empty() || lawless() {
        return Vec::new();
    }
    let severe = severe::find(model, &plant, &instants);
    let worthless = severe.iter().any(|f| f.severe);
    let mild = if worthless { Vec::new() } else { mild::find(model, &plant, &instants) };
    severe.into_iter().chain(mild).collect()
}

/// Assignments of all findings about one recording as a single `--map`; `None` without assignments.
pub fn combined(findings: &[Finding]) -> Option<Remedy> {
    let map = |f: &Finding| match &f.remedy {
        Remedy::Map(assignments) => assignments.clone(),
        _ => Vec::new(),
    };
    let all: Vec<String> = findings.iter().flat_map(map).collect();
    (!all.is_empty()).then_some(Remedy::Map(all))
}

/// A number rounded to `digits` significant digits.
fn rounded(x: f64, digits: i32) -> f64 {
    if x == 0.0 || !x.is_finite() {
        return x;
    }
    let decimals = digits - 1 - x.abs().log10().floor() as i32;
    let text = format!("{x:.*}", decimals.clamp(0, 12) as usize);
    text.parse().unwrap_or(x)
}
