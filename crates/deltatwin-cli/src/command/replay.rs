//! `deltatwin replay`.

use std::path::{Path, PathBuf};

use serde_json::json;

use crate::terminal::{DONE, check_output, path, say, spinner, warn};
use deltatwin_io::{model, recording};

/// Look at a recording in Rerun: the moving robot, measured and predicted torques.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Example: deltatwin replay run.mcap && rerun run.rrd")]
pub struct Args {
    /// Recording.
    pub recording: PathBuf,
    /// Rerun file to write; without it, beside the recording.
    #[arg(short, long, value_name = "RRD")]
    pub output: Option<PathBuf>,
    /// Model file to compare with; the shipped `irb360-6-1600.toml` without it.
    #[arg(long, value_name = "M")]
    pub model: Option<PathBuf>,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Default model for the comparison.
const SHIPPED: &str = include_str!("../../../../models/irb360-6-1600.toml");

/// Runs the command; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    let output = args.output.clone().unwrap_or_else(|| args.recording.with_extension("rrd"));
    let inputs: Vec<&Path> = std::iter::once(&args.recording).chain(&args.model).map(PathBuf::as_path).collect();
    check_output(&output, &inputs, &["rrd"])?;
    // The shipped model is embedded, so it is available in any folder.
    let model = match &args.model {
        Some(file) => model::read(file)?,
        None => model::parse(SHIPPED, Path::new("irb360-6-1600.toml"))?,
    };
    let (recording, warnings) = recording::read_of(&args.recording, None, model.mechanism)?;
    warn(&warnings);
    let progress = spinner("replay");
    let written = deltatwin_rerun::replay::write(&output, &recording, &model);
    progress.finish_and_clear();
    written?;
    if args.json {
        say(json!({"rrd": path(&output), "samples": recording.signals.len(), "warnings": warnings}))?;
    } else {
        say(format!("Wrote {}; look at it with: rerun {}", output.display(), output.display()))?;
    }
    Ok(DONE)
}
