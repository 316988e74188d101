//! A recording as a Rerun file.

use std::path::{Path, PathBuf};

use miette::miette;
use serde_json::json;

use super::Args;
use crate::terminal::{DONE, INTERRUPTED, catch_interrupt, check_output, interrupted, path, say, spinner, warn};
use deltatwin::model::Model;
use deltatwin_io::model::shipped::IRB_360_6_1600;
use deltatwin_io::{model, recording};
use deltatwin_rerun::replay::Replay;

/// Writes the file; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    let [file] = args.recordings.as_slice() else {
        return Err(miette!("{} recordings; expected one, or --mqtt to send several", args.recordings.len()));
    };
    if args.viewer.wanted() {
        return stream(args, file);
    }
    let output = args.output.clone().unwrap_or_else(|| file.with_extension("rrd"));
    let inputs: Vec<&Path> = std::iter::once(file).chain(&args.model).map(PathBuf::as_path).collect();
    check_output(&output, &inputs, &["rrd"])?;
    let (model, beside) = models(args)?;
    let (recording, warnings) = recording::read_of(file, None, model.mechanism)?;
    warn(&warnings);
    let progress = spinner("replay");
    let (contacts, access) = (recording::contacts(file)?, args.outside.access());
    let replay = Replay {
        recording: &recording,
        dataset: None,
        contacts: &contacts,
        model: &model,
        beside: beside.as_ref(),
        access,
    };
    let written = replay.write(&output);
    progress.finish_and_clear();
    written?;
    if args.json {
        say(json!({"rrd": path(&output), "samples": recording.signals.len(), "warnings": warnings}))?;
    } else {
        say(format!("Wrote {}; look at it with: rerun {}", output.display(), output.display()))?;
    }
    Ok(DONE)
}

/// The models that the recording is compared with.
fn models(args: &Args) -> miette::Result<(Model, Option<Model>)> {
    // The shipped model is embedded, so it is available in any folder.
    let model = match &args.model {
        Some(file) => model::read(file)?,
        None => model::parse(IRB_360_6_1600, Path::new("irb360-6-1600"))?,
    };
    Ok((model, args.beside.as_deref().map(model::read).transpose()?))
}

/// Streams the recording to a viewer; returns the exit status.
fn stream(args: &Args, file: &Path) -> miette::Result<u8> {
    let (model, beside) = models(args)?;
    let (recording, warnings) = recording::read_of(file, None, model.mechanism)?;
    warn(&warnings);
    catch_interrupt()?;
    let (contacts, access) = (recording::contacts(file)?, args.outside.access());
    let replay = Replay {
        recording: &recording,
        dataset: None,
        contacts: &contacts,
        model: &model,
        beside: beside.as_ref(),
        access,
    };
    let Some(viewer) = args.viewer.viewer() else { return Ok(DONE) };
    let pace = args.viewer.is_live().then_some(args.speed);
    replay.stream(&viewer, pace, &|| !interrupted())?;
    if args.json {
        say(json!({"samples": recording.signals.len(), "warnings": warnings}))?;
    } else {
        say(format!("Streamed {} samples", recording.signals.len()))?;
    }
    if !interrupted() {
        args.viewer.stay();
        return Ok(DONE);
    }
    Ok(INTERRUPTED)
}
