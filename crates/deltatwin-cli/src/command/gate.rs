//! The gate of commands that fit.

use miette::miette;
use serde_json::{Value, json};

use crate::data::{Data, DataArgs};
use crate::terminal::warn;
use deltatwin::dynamics::Channel;
use deltatwin::gate::{Finding, combined, examine};
use deltatwin::model::Model;
use deltatwin::text::significant;

/// Ratio of residual to noise above which a fit is no answer.
const MUCH: f64 = 10.0;

/// Examines all recordings of a command and prints the findings.
///
/// # Errors
/// If a finding makes a fit meaningless, unless `--no-gate` is given.
pub fn guard(model: &Model, data: &Data, args: &DataArgs) -> miette::Result<Vec<Finding>> {
    let mut all = Vec::new();
    let mut refused = Vec::new();
    for dataset in data.datasets.iter().chain(&data.held_out) {
        let found = examine(model, dataset);
        if found.iter().any(|f| f.severe) {
            let lines: Vec<String> = found.iter().map(|f| format!("\n  {}", line(f))).collect();
            let remedy = match combined(&found) {
                Some(map) => format!("\n  remedy: {map}"),
                None => format!("\n  remedy: {}", found[0].remedy),
            };
            refused.push(format!("{}: does not fit the model {}:{}{remedy}", dataset.name, model.name, lines.concat()));
        } else {
            warn(
                &found
                    .iter()
                    .map(|f| format!("{}: {}; remedy: {}", f.recording, line(f), f.remedy))
                    .collect::<Vec<_>>(),
            );
        }
        all.extend(found);
    }
    if refused.is_empty() {
        Ok(all)
    } else if args.no_gate {
        warn(&refused);
        Ok(all)
    } else {
        Err(miette!("{}\n  Nothing was fitted; --no-gate goes on all the same", refused.join("\n")))
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
