//! `deltatwin replay`.

use std::path::PathBuf;

use serde_json::json;

use crate::model::Model;
use crate::recording::Recording;
use crate::terminal::{DONE, check_output, path, say, spinner, warn};

/// Look at a recording in Rerun: the moving robot, measured and predicted torques.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Example: deltatwin replay run.mcap && rerun run.rrd")]
pub struct Args {
    /// Recording.
    pub recording: PathBuf,
    /// Rerun file to write; without it, beside the recording.
    #[arg(short, long, value_name = "RRD")]
    pub output: Option<PathBuf>,
    /// Model file to compare with.
    #[arg(long, value_name = "M", default_value = "models/irb360-6-1600.toml")]
    pub model: PathBuf,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> miette::Result<u8> {
    let output = args.output.clone().unwrap_or_else(|| args.recording.with_extension("rrd"));
    check_output(&output, &[&args.recording, &args.model], &["rrd"])?;
    let model = Model::read(&args.model)?;
    let (recording, warnings) = Recording::read_of(&args.recording, None, model.mechanism)?;
    warn(&warnings);
    let progress = spinner("replay");
    let written = super::write(&output, &recording, &model);
    progress.finish_and_clear();
    written?;
    if args.json {
        say(json!({"rrd": path(&output), "samples": recording.signals.len(), "warnings": warnings}))?;
    } else {
        say(format!("Wrote {}; look at it with: rerun {}", output.display(), output.display()))?;
    }
    Ok(DONE)
}
