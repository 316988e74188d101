//! `deltatwin check`.

use std::path::PathBuf;

use serde_json::json;

use super::check;
use crate::terminal::{BAD_INPUT, DONE, path, say, warn};

/// Validate files: models, scenarios, setups, recordings.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Example: deltatwin check models/irb360-6-1600.toml run.csv")]
pub struct Args {
    /// Files of any kind.
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command; every file is checked, each mistake told on stderr.
pub fn run(args: &Args) -> miette::Result<u8> {
    let mut good = true;
    let mut entries = Vec::new();
    for file in &args.files {
        match check(file) {
            Ok(v) => {
                warn(&v.warnings);
                if !args.json {
                    say(format!("{}: {}: {}", file.display(), v.kind, v.summary))?;
                }
                entries.push(json!({
                    "file": path(file),
                    "good": true,
                    "kind": v.kind.to_string(),
                    "summary": v.summary,
                    "warnings": v.warnings,
                }));
            }
            Err(report) => {
                good = false;
                eprintln!("{report:?}");
                entries.push(json!({"file": path(file), "good": false, "error": report.to_string()}));
            }
        }
    }
    if args.json {
        say(json!({"good": good, "files": entries}))?;
    }
    Ok(if good { DONE } else { BAD_INPUT })
}
