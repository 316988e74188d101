//! A recording as a Rerun file.

use std::path::{Path, PathBuf};

use miette::miette;
use serde_json::json;

use super::Args;
use crate::terminal::{DONE, check_output, path, say, spinner, warn};
use deltatwin_io::{model, recording};

/// Default model for the comparison.
const SHIPPED: &str = include_str!("../../../../../models/irb360-6-1600.toml");

/// Writes the file; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    let [file] = args.recordings.as_slice() else {
        return Err(miette!("{} recordings; expected one, or --mqtt to send several", args.recordings.len()));
    };
    let output = args.output.clone().unwrap_or_else(|| file.with_extension("rrd"));
    let inputs: Vec<&Path> = std::iter::once(file).chain(&args.model).map(PathBuf::as_path).collect();
    check_output(&output, &inputs, &["rrd"])?;
    // The shipped model is embedded, so it is available in any folder.
    let model = match &args.model {
        Some(file) => model::read(file)?,
        None => model::parse(SHIPPED, Path::new("irb360-6-1600.toml"))?,
    };
    let (recording, warnings) = recording::read_of(file, None, model.mechanism)?;
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
