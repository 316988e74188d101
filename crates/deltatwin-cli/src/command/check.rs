//! `deltatwin check`.

use std::path::PathBuf;

use serde_json::json;

use crate::command::gate::{json as gate_json, line};
use crate::data::{ColumnArgs, Outside, mass};
use crate::kind::{Examination, Verified, check_as};
use crate::terminal::{BAD_ANSWER, BAD_INPUT, DONE, complain, error_json, path, say, warn};
use deltatwin::gate::combined;
use deltatwin_io::model;

/// Validate files: models, scenarios, setups, recordings.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Example: deltatwin check models/irb360-6-1600.toml run.csv")]
pub struct Args {
    /// Files of any kind.
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// Model that the recordings should fit: also examines sign, factor, order, zero, lag, offset and payload.
    #[arg(long, value_name = "MODEL")]
    pub model: Option<PathBuf>,
    #[command(flatten)]
    pub columns: ColumnArgs,
    /// Setup of all recordings, instead of their sidecars `<stem>.setup.toml`.
    #[arg(long, value_name = "FILE")]
    pub setup: Option<PathBuf>,
    /// Mass of the payload of all recordings in kg, instead of what the setup states.
    #[arg(long, value_name = "KG", value_parser = mass)]
    pub payload_mass: Option<f64>,
    #[command(flatten)]
    pub outside: Outside,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command: checks every file and reports each error on stderr; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    let mut good = true;
    let mut fits = true;
    let mut gate = Vec::new();
    let mut entries = Vec::new();
    let model = args.model.as_deref().map(model::read).transpose()?;
    let machine = model.as_ref().map(|m| m.mechanism);
    let how = args.columns.reading(args.setup.as_deref(), machine);
    for file in &args.files {
        match check_as(
            file,
            args.outside.access(),
            &Examination { how, model: model.as_ref(), payload_mass: args.payload_mass },
        ) {
            Ok(v) => {
                warn(&v.warnings);
                if !args.json {
                    say(format!("{}: {}: {}", file.display(), v.kind, v.summary))?;
                    print_gate(&v)?;
                }
                fits &= !v.gate.iter().flatten().any(|f| f.severe);
                entries.push(json!({
                    "file": path(file),
                    "good": true,
                    "kind": v.kind.to_string(),
                    "summary": v.summary,
                    "warnings": v.warnings,
                    "gate": v.gate.as_deref().map(gate_json),
                }));
                gate.extend(v.gate.unwrap_or_default());
            }
            Err(report) => {
                good = false;
                complain(format!("{report:?}"));
                entries.push(json!({"file": path(file), "good": false, "error": report.to_string(), "cause": error_json(&report)}));
            }
        }
    }
    if args.json {
        say(json!({"good": good, "files": entries, "gate": gate_json(&gate)}))?;
    }
    Ok(match (good, fits) {
        (false, _) => BAD_INPUT,
        (true, false) => BAD_ANSWER,
        (true, true) => DONE,
    })
}

/// Prints the findings of the gate about a recording.
fn print_gate(v: &Verified) -> miette::Result<()> {
    let Some(findings) = &v.gate else { return Ok(()) };
    if findings.is_empty() {
        return say("  It fits the model: signs, factors, order, zeros, lag, offsets and payload are in order.");
    }
    findings.iter().try_for_each(|f| say(format!("  {}", line(f))))?;
    let others = findings.iter().filter(|f| !matches!(f.remedy, deltatwin::gate::Remedy::Map(_)));
    let remedies = others.map(|f| f.remedy.to_string()).chain(combined(findings).map(|r| r.to_string()));
    let mut remedies: Vec<String> = remedies.collect();
    remedies.dedup();
    remedies.into_iter().try_for_each(|r| say(format!("  remedy: {r}")))
}
