//! Whether a recording can belong to a model at all, asked before anything is fitted.
//!
//! One regression per axis of the measured on the predicted torque of the model as it is: sign, factor, order, zero, lag,
//! offset and payload of the recording. What the model merely lacks leaves slope and correlation near one and passes.

mod arrangement;
mod instants;
mod line;
mod low_pass;
mod mild;
mod severe;

use std::fmt;

pub use arrangement::Arrangement;
pub use line::Line;

use self::instants::{Instants, Predicted, plain};
use crate::identification::Dataset;
use crate::model::Model;

/// What is wrong with a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Problem {
    /// A torque counts the other way.
    TorqueSign,
    /// Angle and torque of an axis count the other way.
    AxisSign,
    /// An angle counts the other way.
    PositionSign,
    /// A torque is the right one times a factor.
    Factor,
    /// A torque is that of the motor's side of the gear.
    MotorSide,
    /// The column belongs to another axis.
    Order,
    /// An angle counts from elsewhere.
    Zero,
    /// Another machine's model: poses that it cannot take, or weight and inertia of another ratio.
    AnotherMachine,
    /// The torque does not follow the model's, for no reason that is known here.
    Unrelated,
    /// Torques late or early against the angles.
    Lag,
    /// Torques low-passed, angles not.
    LowPass,
    /// A load at the flange that the setup does not state.
    Payload,
    /// A constant torque.
    Offset,
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
        })
    }
}

/// Numbers behind a finding; what does not apply is missing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Evidence {
    /// Line of measured over predicted torque, as the file has it.
    pub line: Option<Line>,
    /// What is estimated (lag in s, cut-off in Hz, payload in kg, offset in N·m, zero in rad) and its standard error.
    pub value: Option<(f64, f64)>,
    /// RMS of measured − predicted as the file has it, N·m.
    pub rms_before: Option<f64>,
    /// The same with the remedy, N·m.
    pub rms_after: Option<f64>,
}

/// Something wrong with a recording, and what mends it.
#[derive(Clone, Debug)]
pub struct Finding {
    /// Name of the recording.
    pub recording: String,
    /// Axis, from 0; none of what concerns all.
    pub axis: Option<usize>,
    /// What is wrong.
    pub problem: Problem,
    /// Whether a fit would be worthless.
    pub severe: bool,
    /// Numbers.
    pub evidence: Evidence,
    /// In words, without the numbers of the regression.
    pub sentence: String,
    /// What mends it.
    pub remedy: Remedy,
}

/// What mends a finding.
#[derive(Clone, Debug, PartialEq)]
pub enum Remedy {
    /// Assignments for `--map`.
    Map(Vec<String>),
    /// Kilograms for `--payload-mass`.
    PayloadMass(f64),
    /// Something else, in words.
    Words(&'static str),
}

impl fmt::Display for Remedy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Map(assignments) => write!(f, "--map \"{}\"", assignments.join(", ")),
            Self::PayloadMass(mass) => write!(f, "--payload-mass {}", rounded(*mass, 3)),
            Self::Words(words) => f.write_str(words),
        }
    }
}

/// Instants that are looked at.
const INSTANTS: usize = 1200;

/// What is wrong with a recording of a machine like `model`; nothing if it may be fitted.
///
/// What would make a fit worthless comes alone; the rest is looked for only where there is nothing of that kind.
pub fn examine(model: &Model, dataset: &Dataset) -> Vec<Finding> {
    let plant = plain(model, dataset);
    let instants = Instants::of(dataset, INSTANTS);
    // A law that gives no number is no fault of the recording; whoever predicts with it names it.
    let lawless = || Predicted::new(&plant, &dataset.channels, 0.0, &instants.joints(|j| *j)).lawless;
    if instants.at.is_empty() || lawless() {
        return Vec::new();
    }
    let severe = severe::find(model, &plant, &instants);
    let worthless = severe.iter().any(|f| f.severe);
    let mild = if worthless { Vec::new() } else { mild::find(model, &plant, &instants) };
    severe.into_iter().chain(mild).collect()
}

/// The assignments of all findings about one recording as one `--map`; none if nothing is mended by one.
pub fn combined(findings: &[Finding]) -> Option<Remedy> {
    let map = |f: &Finding| match &f.remedy {
        Remedy::Map(assignments) => assignments.clone(),
        _ => Vec::new(),
    };
    let all: Vec<String> = findings.iter().flat_map(map).collect();
    (!all.is_empty()).then_some(Remedy::Map(all))
}

/// A number to so many significant digits, in its shortest form.
fn rounded(x: f64, digits: i32) -> f64 {
    if x == 0.0 || !x.is_finite() {
        return x;
    }
    let decimals = digits - 1 - x.abs().log10().floor() as i32;
    let text = format!("{x:.*}", decimals.clamp(0, 12) as usize);
    text.parse().unwrap_or(x)
}
