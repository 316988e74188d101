//! `deltatwin import` and `deltatwin export`.

pub mod export;
pub mod import;

use std::path::Path;

use deltatwin::machine::Mechanism;
use miette::IntoDiagnostic;
use serde_json::json;

use crate::kind::alone;
use crate::terminal::{DONE, check_output, path, say, warn};
use deltatwin_io::recording::{self, Reading};

/// Reads the recording `from` and writes it as `to`; returns the exit status.
fn convert(from: &Path, how: &Reading, to: &Path, extensions: &[&str], as_json: bool) -> miette::Result<u8> {
    let inputs: Vec<&Path> = std::iter::once(from).chain(how.setup).collect();
    check_output(to, &inputs, extensions)?;
    let (recording, mut warnings) = recording::read_as(from, how)?;
    warnings.extend(alone(from, &recording));
    warn(&warnings);
    recording::write(&recording, to).into_diagnostic()?;
    let signals = &recording.signals;
    let duration = signals.t.last().zip(signals.t.first()).map_or(0.0, |(b, a)| b - a);
    if as_json {
        say(json!({
            "input": path(from),
            "output": path(to),
            "samples": signals.len(),
            "duration_s": duration,
            "warnings": warnings,
        }))?;
    } else {
        say(format!("Wrote {}: {} samples, {duration:.3} s", to.display(), signals.len()))?;
        say(format!("  next: {}", next(signals.mechanism, to)))?;
    }
    Ok(DONE)
}

/// The command that makes use of a recording of a machine.
fn next(machine: Mechanism, recording: &Path) -> String {
    let name = recording.display();
    match machine {
        Mechanism::Axis(_) => format!("deltatwin new axis {name} -o axis.toml"),
        Mechanism::Delta { .. } => {
            format!("deltatwin check {name} --model MODEL, or deltatwin new delta {name} -o delta.toml")
        }
    }
}
