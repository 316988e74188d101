//! `deltatwin import` and `deltatwin export`.

pub mod export;
pub mod import;

use std::path::Path;

use deltatwin::machine::Mechanism;
use deltatwin::model::Model;
use deltatwin::recording::Recording;
use deltatwin::twin::origin::of_recording;
use serde_json::json;

use crate::kind::alone;
use crate::terminal::{DONE, check_output, input, path, say, warn};
use deltatwin_io::recording::{self, Reading};

/// Reads the recording `from`, of the machine of `model` if it is known, and writes it as `to`; returns the exit status.
fn convert(
    from: &Path,
    model: Option<&Model>,
    how: &Reading,
    to: &Path,
    extensions: &[&str],
    as_json: bool,
) -> miette::Result<u8> {
    let inputs: Vec<&Path> = std::iter::once(from).chain(how.setup).collect();
    check_output(to, &inputs, extensions)?;
    let (recording, mut warnings) = recording::read_as(from, how)?;
    warnings.extend(alone(from, &recording));
    warn(&warnings);
    write(&recording, from, model, to)?;
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
        say(format!("  next: {}", next(from, signals.mechanism, to)))?;
    }
    Ok(DONE)
}

/// Writes a recording that was read from `from` in the format of the name `to`.
fn write(recording: &Recording, from: &Path, model: Option<&Model>, to: &Path) -> miette::Result<()> {
    if is_parquet(to) {
        return write_parquet(recording, to);
    }
    let name = from.file_name().unwrap_or_default().to_string_lossy();
    let mut context = of_recording(&format!("deltatwin import {name}"), model, recording);
    context.provenance.insert("source".into(), name.into_owned());
    context.provenance.insert("source_sha256".into(), input("data", from)?.sha256);
    Ok(recording::write_with(recording, to, &context)?)
}

#[cfg(feature = "studies")]
fn write_parquet(recording: &Recording, to: &Path) -> miette::Result<()> {
    let table = |out: &mut std::io::BufWriter<&std::fs::File>| {
        deltatwin_study::recording::write(recording, out).map_err(std::io::Error::other)
    };
    Ok(deltatwin_io::file::replace(to, table)?)
}

#[cfg(not(feature = "studies"))]
fn write_parquet(_: &Recording, to: &Path) -> miette::Result<()> {
    Err(miette::miette!(
        "{}: this build leaves Parquet out; expected .csv, or a build with `--features studies`",
        to.display()
    ))
}

fn is_parquet(file: &Path) -> bool {
    file.extension().is_some_and(|e| e.eq_ignore_ascii_case("parquet"))
}

/// What makes use of the recording `to`, of which `from` is the origin.
fn next(from: &Path, machine: Mechanism, to: &Path) -> String {
    let name = to.display();
    match machine {
        _ if is_parquet(to) => {
            format!("polars.read_parquet(\"{name}\") in Python; deltatwin itself goes on with {}", from.display())
        }
        Mechanism::Axis(_) => format!("deltatwin new axis {name} -o axis.toml"),
        Mechanism::Delta { .. } => {
            format!("deltatwin check {name} --model MODEL, or deltatwin new delta {name} -o delta.toml")
        }
    }
}
