//! The gate: whether recordings may be fitted.

use serde_json::{Value, json};
use thiserror::Error;

use crate::data::Data;
use deltatwin::gate::{Finding, Followed, Problem, Remedy, combined, examine, followed};
use deltatwin::identification::Dataset;
use deltatwin::model::Model;
use deltatwin::recording::Channel;
use deltatwin::text::significant;
use deltatwin_report::component::checks::{self, Outcome};

/// Ratio of residual to noise above which a fit is no answer.
const MUCH: f64 = 10.0;

/// What the gate says about recordings.
#[derive(Clone, Debug, Default)]
pub struct Examined {
    /// Findings about all recordings.
    pub findings: Vec<Finding>,
    /// Warnings about what can be fitted all the same.
    pub warnings: Vec<String>,
    /// Recordings that do not belong to the model, each with its findings and the remedy.
    pub refused: Vec<String>,
}

/// Recordings that do not belong to the model.
#[derive(Clone, Debug, Error)]
#[error("{}\n  Nothing was fitted; --no-gate goes on all the same", .0.join("\n"))]
pub struct Refusal(
    /// What is wrong with each, and the remedy.
    pub Vec<String>,
);

impl Examined {
    /// Findings about all recordings of `data`.
    pub fn of(model: &Model, data: &Data) -> Self {
        let mut all = Self::default();
        for dataset in data.datasets.iter().chain(&data.held_out) {
            let found = examine(model, dataset);
            if found.iter().any(|f| f.severe) {
                let lines: Vec<String> = found.iter().map(|f| format!("\n  {}", line(f))).collect();
                let remedy = match combined(&found) {
                    Some(map) => {
                        let load = |f: &Finding| match f.remedy {
                            Remedy::PayloadMass(_) => format!(" {}", f.remedy),
                            Remedy::Payload(_) => format!(", and {}", f.remedy),
                            Remedy::Map(_) | Remedy::Words(_) => String::new(),
                        };
                        format!("\n  remedy: {map}{}", found.iter().map(load).collect::<String>())
                    }
                    None => format!("\n  remedy: {}", found[0].remedy),
                };
                let what = format!("{}: does not fit the model {}", dataset.name, model.name);
                all.refused.push(format!("{what}:{}{remedy}", lines.concat()));
            } else {
                let one = |f: &Finding| format!("{}: {}; remedy: {}", f.recording, line(f), f.remedy);
                all.warnings.extend(found.iter().map(one));
            }
            all.findings.extend(found);
        }
        all
    }

    /// The findings and the warnings about them, among these the refused recordings if `no_gate`.
    ///
    /// # Errors
    /// [`Refusal`] if a finding makes a fit meaningless, unless `no_gate`.
    pub fn pass(self, no_gate: bool) -> Result<(Vec<Finding>, Vec<String>), Refusal> {
        if !self.refused.is_empty() && !no_gate {
            return Err(Refusal(self.refused));
        }
        Ok((self.findings, self.warnings.into_iter().chain(self.refused).collect()))
    }
}

/// A finding with its numbers, as text.
pub fn line(f: &Finding) -> String {
    let mut text = f.sentence.clone();
    let mut numbers = Vec::new();
    if let Some(l) = &f.evidence.line {
        numbers.push(format!("slope {} ± {}", significant(l.slope, 3), significant(l.slope_std, 1)));
        numbers.push(format!("correlation {:.3}", l.correlation));
    }
    match (f.evidence.rms_before, f.evidence.rms_after) {
        (Some(a), Some(b)) => numbers.push(format!("RMS {} → {}", significant(a, 3), significant(b, 3))),
        (Some(a), None) => numbers.push(format!("RMS {}", significant(a, 3))),
        (None, Some(b)) => numbers.push(format!("RMS with the remedy {}", significant(b, 3))),
        (None, None) => {}
    }
    if !numbers.is_empty() {
        text += &format!(" ({})", numbers.join(", "));
    }
    text
}

/// What is checked of every axis.
pub const CHECKS: [&str; 6] = ["sign", "factor", "order", "zero", "lag", "payload"];
/// The checks that follow only where no finding makes a fit meaningless, and those of a robot.
const LATER: [usize; 2] = [4, 5];
const OF_ROBOTS: [usize; 2] = [2, 5];

/// The check that a problem belongs to, as index of [`CHECKS`]; `None` if it decides none of them.
fn check_of(problem: Problem) -> Option<usize> {
    match problem {
        Problem::TorqueSign | Problem::AxisSign | Problem::PositionSign => Some(0),
        Problem::Factor | Problem::MotorSide | Problem::Degrees => Some(1),
        Problem::Order | Problem::Repeated => Some(2),
        Problem::Zero | Problem::Offset => Some(3),
        Problem::Lag | Problem::LowPass => Some(4),
        Problem::Payload | Problem::GravityRemoved => Some(5),
        Problem::AnotherMachine
        | Problem::Unrelated
        | Problem::Noiseless
        | Problem::Quantised
        | Problem::Alias
        | Problem::WeightAlone
        | Problem::Standstill => None,
    }
}

/// The outcome of every check of every axis of a recording, from the `findings` about it.
pub fn checks(model: &Model, dataset: &Dataset, findings: &[Finding]) -> Vec<checks::Axis> {
    let machine = dataset.mechanism;
    let severe = findings.iter().any(|f| f.severe);
    let lost = findings.iter().any(|f| f.severe && check_of(f.problem).is_none());
    let axis = |followed: Followed| {
        let concerned = |f: &&Finding| f.axis.is_none_or(|axis| axis == followed.axis);
        let cell = |check: usize| {
            let own = findings.iter().filter(concerned).filter(|f| check_of(f.problem) == Some(check));
            match own.max_by_key(|f| f.severe) {
                Some(f) if f.severe => (Outcome::Failed, words(f)),
                Some(f) => (Outcome::Remark, words(f)),
                None if machine.axes() == 1 && OF_ROBOTS.contains(&check) => (Outcome::Open, "one axis".into()),
                None if lost || severe && LATER.contains(&check) => (Outcome::Open, "not checked".into()),
                None => (Outcome::Passed, "ok".into()),
            }
        };
        let channel = Channel::Torque(followed.axis);
        checks::Axis {
            title: channel.title(machine),
            unit: channel.unit(machine).to_string(),
            slope: followed.line.map(|l| (l.slope, l.slope_std)),
            cells: (0..CHECKS.len()).map(cell).collect(),
            points: followed.predicted.into_iter().zip(followed.measured).map(|(x, y)| [x, y]).collect(),
        }
    };
    followed(model, dataset).into_iter().map(axis).collect()
}

/// A finding in a few words, with its size.
fn words(f: &Finding) -> String {
    let size = f.evidence.value.map(|(value, _)| match f.problem {
        Problem::Lag => format!(" {} ms", significant(1e3 * value, 3)),
        Problem::LowPass => format!(" {} Hz", significant(value, 3)),
        Problem::Payload => format!(" {} kg", significant(value, 3)),
        _ => format!(" {}", significant(value, 3)),
    });
    f.problem.to_string().replace('_', " ") + &size.unwrap_or_default()
}

/// Findings as JSON.
pub fn json(findings: &[Finding]) -> Value {
    let entry = |f: &Finding| {
        let e = &f.evidence;
        json!({
            "recording": f.recording,
            "axis": f.axis.map(|i| i + 1),
            "problem": f.problem.to_string(),
            "severe": f.severe,
            "evidence": {
                "slope": e.line.map(|l| l.slope),
                "slope_std": e.line.map(|l| l.slope_std),
                "correlation": e.line.map(|l| l.correlation),
                "value": e.value.map(|v| v.0),
                "value_std": e.value.map(|v| v.1),
                "rms_before": e.rms_before,
                "rms_after": e.rms_after,
                "sentence": f.sentence,
            },
            "remedy": f.remedy.to_string(),
        })
    };
    findings.iter().map(entry).collect()
}

/// Warnings about channels whose residual exceeds ten times the noise.
pub fn much_is_left(channels: &[Channel], rms: &[f64], noise_floor: &[f64]) -> Vec<String> {
    let much = |c: &usize| rms[*c] > MUCH * noise_floor[*c] && noise_floor[*c] > 0.0;
    let all = channels.len().min(rms.len()).min(noise_floor.len());
    let left: Vec<String> =
        (0..all).filter(much).map(|c| format!("{} ({:.0} times)", channels[c], rms[c] / noise_floor[c])).collect();
    if left.is_empty() {
        return Vec::new();
    }
    let what = "the fit leaves more than ten times the noise on";
    vec![format!("{what} {}: the model does not describe this recording", left.join(", "))]
}
