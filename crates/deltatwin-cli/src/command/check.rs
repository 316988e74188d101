//! `deltatwin check`.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use miette::miette;
use serde_json::{Value, json};

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
        let examination = Examination { how, model: model.as_ref(), payload_mass: args.payload_mass };
        match guarded(file, || check_as(file, args.outside.access(), &examination)) {
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
            Err(refused) => {
                good = false;
                complain(refused.printed);
                entries.push(refused.entry);
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

/// Why a file was refused: as text and as JSON.
struct Refused {
    printed: String,
    entry: Value,
}

impl Refused {
    fn new(file: &Path, report: &miette::Report) -> Self {
        let entry =
            json!({"file": path(file), "good": false, "error": report.to_string(), "cause": error_json(report)});
        Self { printed: format!("{report:?}"), entry }
    }
}

/// The answer of `check` about `file`; a fault of the program itself is an answer too, and the other files get theirs.
fn guarded(file: &Path, check: impl FnOnce() -> miette::Result<Verified>) -> Result<Verified, Refused> {
    let answer = || check().map_err(|report| Refused::new(file, &report));
    catch_unwind(AssertUnwindSafe(answer)).unwrap_or_else(|_| {
        Err(Refused::new(file, &miette!("{}: the check failed unexpectedly; please report this file", file.display())))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_about_one_file_is_its_answer() {
        let refused = guarded(Path::new("a.toml"), || panic!("on purpose")).unwrap_err();
        assert!(refused.printed.contains("a.toml: the check failed unexpectedly"), "{}", refused.printed);
        assert_eq!((&refused.entry["file"], &refused.entry["good"]), (&json!("a.toml"), &json!(false)));
    }
}
