//! A recording as a Rerun file, or streamed to a viewer.

use std::path::{Path, PathBuf};

use miette::miette;
use serde_json::json;

use super::Args;
use crate::terminal::{DONE, INTERRUPTED, catch_interrupt, check_output, interrupted, path, say, spinner, warn};
use deltatwin_io::model::shipped::IRB_360_6_1600;
use deltatwin_io::{model, recording};
use deltatwin_rerun::replay::Replay;

/// Writes the file or streams the recording; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    let [file] = args.recordings.as_slice() else {
        return Err(miette!("{} recordings; expected one, or --mqtt to send several", args.recordings.len()));
    };
    let output = args.output.clone().unwrap_or_else(|| file.with_extension("rrd"));
    if !args.viewer.wanted() {
        let inputs: Vec<&Path> = std::iter::once(file).chain(&args.model).map(PathBuf::as_path).collect();
        check_output(&output, &inputs, &["rrd"])?;
    }
    // The shipped model is embedded, so it is available in any folder.
    let model = match &args.model {
        Some(file) => model::read(file)?,
        None => model::parse(IRB_360_6_1600, Path::new("irb360-6-1600"))?,
    };
    let beside = args.beside.as_deref().map(model::read).transpose()?;
    let (recording, warnings) = recording::read_as(file, &args.columns.reading(None, Some(model.mechanism)))?;
    warn(&warnings);
    let (contacts, access) = (recording::contacts(file)?, args.outside.access());
    let replay = Replay {
        recording: &recording,
        dataset: None,
        contacts: &contacts,
        model: &model,
        beside: beside.as_ref(),
        access,
    };
    let samples = recording.signals.len();
    if args.viewer.wanted() {
        catch_interrupt()?;
        let Some(viewer) = args.viewer.viewer() else { return Ok(DONE) };
        replay.stream(&viewer, args.viewer.is_live().then_some(args.speed), &|| !interrupted())?;
        match args.json {
            true => say(json!({"samples": samples, "warnings": warnings}))?,
            false => say(format!("Streamed {samples} samples"))?,
        }
        if interrupted() {
            return Ok(INTERRUPTED);
        }
        args.viewer.stay();
        return Ok(DONE);
    }
    let progress = spinner("replay");
    let written = replay.write(&output);
    progress.finish_and_clear();
    written?;
    match args.json {
        true => say(json!({"rrd": path(&output), "samples": samples, "warnings": warnings}))?,
        false => say(format!("Wrote {}; look at it with: rerun {}", output.display(), output.display()))?,
    }
    Ok(DONE)
}
