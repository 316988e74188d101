//! `deltatwin run`.

use std::path::{Path, PathBuf};
use std::time::Instant;

use miette::IntoDiagnostic;

use super::diagnose::status;
use super::diagnose::time::Allowance;
use crate::data::{Data, DataArgs, positive};
use crate::terminal::{catch_interrupt, command, error_bars, interrupted, origin, say, spinner, warn, wrapped};
use deltatwin::identification::Dataset;
use deltatwin::model::Model;
#[cfg(feature = "viewer")]
use deltatwin::recording::Recording;
use deltatwin_analysis::run::RunError;
use deltatwin_analysis::{Analysis, Settings, Step, folder};
use deltatwin_io::model;
#[cfg(feature = "viewer")]
use deltatwin_io::outside::Access;
#[cfg(feature = "viewer")]
use deltatwin_rerun::replay::Replay;

/// Check recordings, identify the model, see where it fails, find what is missing and add it: all stages, one folder.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Example: deltatwin run models/irb360-6-1600.toml run.csv --held-out other.csv -o results")]
pub struct Args {
    /// Model file; it stays as it is.
    pub model: PathBuf,
    #[command(flatten)]
    data: DataArgs,
    /// Folder for results: result.json, identified.toml, model.toml (with the effects added), report.html.
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Effect whose parameters are known and stay as they are (`rigid_bodies` for the links); may be given several times.
    #[arg(long, value_name = "EFFECT")]
    hold: Vec<String>,
    /// Time after which the stages give their best answers so far, and what was cut is said; as for `diagnose`. Exit status 1
    /// if it is then not clear what is missing.
    #[arg(long, value_name = "SECONDS", value_parser = positive)]
    time_limit: Option<f64>,
    /// Replace the results of an earlier run in the folder.
    #[arg(long)]
    force: bool,
    /// One JSON object on stdout, the content of result.json.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    let begun = Instant::now();
    let model = model::read(&args.model)?;
    folder::check(&args.output, args.force)?;
    let inputs = args.data.inputs();
    let data = Data::read(&inputs, &model)?;
    warn(&data.warnings);
    data.check_held(&args.hold, &model)?;
    let origin = origin("run", Some(&args.model), &inputs, &data.warnings)?;
    let samples: usize = data.datasets.iter().chain(&data.held_out).map(Dataset::len).sum();
    let allowance = Allowance::new(begun, args.time_limit, samples);
    catch_interrupt()?;
    let clock = || allowance.passed();
    let settings = Settings { hold: &args.hold, clock: &clock, no_gate: args.data.no_gate };
    let analysis = with_progress(&model, &data, &settings)?;
    warn(&analysis.warnings);
    // The answer first: a file that cannot be written does not cost it.
    if args.json { say(folder::result(&analysis, &origin)) } else { print(&analysis) }?;
    // What prevents it is said by what writes the files.
    let _ = std::fs::create_dir_all(&args.output);
    let (shown, files) = std::thread::scope(|scope| {
        let shown = scope.spawn(|| show(&args.output, &analysis, &inputs, &model, &data));
        let files = folder::write(&args.output, &analysis, &model, &data, &origin);
        (shown.join(), files)
    });
    let mut files = files?;
    files.extend(shown.unwrap_or_else(|panic| std::panic::resume_unwind(panic))?);
    if !args.json {
        print_files(&files, args)?;
    }
    Ok(status(&analysis.diagnosis))
}

/// The whole loop with a spinner that says how far it is.
fn with_progress(model: &Model, data: &Data, settings: &Settings) -> miette::Result<Analysis> {
    let progress = spinner("check");
    let analysis = deltatwin_analysis::run(model, data, settings, &mut |step| progress.set_message(message(&step)));
    progress.finish_and_clear();
    match analysis {
        Err(RunError::Stopped) if interrupted() => std::process::exit(i32::from(crate::terminal::INTERRUPTED)),
        other => other.into_diagnostic(),
    }
}

/// How far a run is, in a few words.
pub fn message(step: &Step) -> String {
    let what = if step.what.is_empty() { String::new() } else { format!(": {}", step.what) };
    format!("{:>3.0} % {}{what}", 100.0 * step.fraction, step.stage)
}

/// A recording with the identified model, and beside it the one with the effects that were found.
#[cfg(feature = "viewer")]
pub fn replay<'a>(recording: &'a Recording, dataset: Option<&'a Dataset>, analysis: &'a Analysis) -> Replay<'a> {
    let beside = (!analysis.diagnosis.effects.is_empty()).then_some(&analysis.diagnosis.model);
    Replay {
        recording,
        dataset,
        contacts: &[],
        model: &analysis.identification.fitted.model,
        beside,
        access: Access::PROJECT,
    }
}

/// Writes the Rerun file of the last recording with the identified model; none without the viewer.
#[cfg(feature = "viewer")]
fn show(
    folder: &Path,
    analysis: &Analysis,
    inputs: &crate::data::Inputs,
    model: &Model,
    data: &Data,
) -> miette::Result<Option<PathBuf>> {
    let Some(file) = inputs.held_out.last().or(inputs.data.last()) else { return Ok(None) };
    let dataset = data.held_out.last().or(data.datasets.last());
    let (recording, _) = deltatwin_io::recording::read_as(file, &inputs.reading(Some(model.mechanism)))?;
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    let path = folder.join(format!("{stem}.rrd"));
    replay(&recording, dataset, analysis).write(&path)?;
    Ok(Some(path))
}

#[cfg(not(feature = "viewer"))]
#[allow(clippy::unnecessary_wraps)]
fn show(_: &Path, _: &Analysis, _: &crate::data::Inputs, _: &Model, _: &Data) -> miette::Result<Option<PathBuf>> {
    Ok(None)
}

fn print(a: &Analysis) -> miette::Result<()> {
    let d = &a.diagnosis;
    say(wrapped(&deltatwin_analysis::sentence::verdict(d), 0))?;
    say(format!(
        "\n{}",
        error_bars(d.model.mechanism, &d.channels, d.budget.held_out, &d.rms_before, &d.rms_after, &d.noise_floor)
    ))?;
    if !a.identified.findings.is_empty() {
        say("\n  Where the identified model fails")?;
    }
    for finding in a.identified.findings.iter().take(4) {
        say(wrapped(&finding.sentence, 4))?;
    }
    if let Some(next) = &d.next_experiment {
        say(format!("\n{}", wrapped(&format!("Next experiment: {}", next.what), 2)))?;
    }
    Ok(())
}

/// Prints the files and the next commands.
fn print_files(files: &[PathBuf], args: &Args) -> miette::Result<()> {
    say("\n  Written")?;
    for file in files {
        say(format!("    {}", file.display()))?;
    }
    say("\n  Next")?;
    let text = |path: &Path| path.display().to_string();
    let better = text(&args.output.join(folder::MODEL));
    let again = |words: &[&str], rest: Vec<String>| words.iter().map(|w| w.to_string()).chain(rest).collect::<Vec<_>>();
    let details = again(&["deltatwin", "diagnose", &text(&args.model)], args.data.inputs().words());
    let compare = again(&["deltatwin", "compare", &better], args.data.inputs().words());
    say(format!("    open {} in a browser", text(&args.output.join(folder::PAGE))))?;
    say(command(&compare, 4))?;
    say(command(&[details, vec!["--verbose".into()]].concat(), 4))?;
    if let Some(how) = super::VIEWER {
        say(format!("    {how}"))?;
    }
    Ok(())
}
