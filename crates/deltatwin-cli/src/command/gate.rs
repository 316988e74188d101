//! The gate of commands that fit.

use miette::IntoDiagnostic;

pub use deltatwin_analysis::gate::{Examined, json, line, much_is_left};

use crate::data::{Data, DataArgs};
use crate::terminal::warn;
use deltatwin::gate::Finding;
use deltatwin::model::Model;

/// Examines all recordings of a command and prints the findings.
///
/// # Errors
/// If a finding makes a fit meaningless, unless `--no-gate` is given.
pub fn guard(model: &Model, data: &Data, args: &DataArgs) -> miette::Result<Vec<Finding>> {
    let (findings, warnings) = Examined::of(model, data).pass(args.no_gate).into_diagnostic()?;
    warn(&warnings);
    Ok(findings)
}
