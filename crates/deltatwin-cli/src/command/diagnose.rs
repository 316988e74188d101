//! `deltatwin diagnose`.

pub mod budget;
mod details;
mod screen;
pub mod time;
mod unexplained;

use std::path::{Path, PathBuf};
use std::time::Instant;

use self::time::{Allowance, Stages};
use miette::{IntoDiagnostic, WrapErr};

use crate::command::gate::{guard, much_is_left};
use crate::command::identify::provenance;
use crate::data::{Data, DataArgs};
use crate::report::{check_report, write_report};
use crate::terminal::{BAD_ANSWER, DONE, catch_interrupt, check_output, origin, say, spinner, warn, write_figure};
use deltatwin::diagnosis::{Diagnosis, NextExperiment, Options, Progress, Verdict, diagnose_with};
use deltatwin::identification::Dataset;
use deltatwin::machine::Configuration;
use deltatwin::model::Model;
use deltatwin_analysis::page;
use deltatwin_analysis::progress::Course;
use deltatwin_io::model;
use deltatwin_io::scenario::write_experiment;
use deltatwin_report::drawing;

/// Find the physical effect that a model lacks.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Example: deltatwin diagnose models/irb360-6-1600.toml run.mcap --held-out other.mcap")]
pub struct Args {
    /// Model file.
    pub model: PathBuf,
    #[command(flatten)]
    pub(super) data: DataArgs,
    /// Model file to write: refitted, with the effects that were found.
    #[arg(short, long, value_name = "MODEL2")]
    pub output: Option<PathBuf>,
    /// Effect whose parameters are known and stay as they are (`rigid_bodies` for the links); may be given several times.
    #[arg(long, value_name = "EFFECT")]
    pub hold: Vec<String>,
    /// Scenario file to write: the experiment that is proposed next, if there is one and it has a motion of its own.
    #[arg(long, value_name = "SCENARIO")]
    pub next: Option<PathBuf>,
    /// Figure to write: what acts where no known effect explains it.
    #[arg(long, value_name = "SVG")]
    pub figure: Option<PathBuf>,
    /// Page to write, with the candidates, the errors before and after, and what is left.
    #[arg(long, value_name = "FILE.html")]
    pub report: Option<PathBuf>,
    /// Show all candidates with their p-values, the error budget and the parameters that moved.
    #[arg(short, long)]
    pub verbose: bool,
    /// Time after which the best answer so far is given, with what was not tried; by default 500 s of computing time for every
    /// 100 000 samples of all recordings, and not less than 500 s. The work is bounded as well. Ctrl-C ends it, too. Exit
    /// status 1 if the question was not answered until then.
    #[arg(long, value_name = "SECONDS", value_parser = positive)]
    pub time_limit: Option<f64>,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x > 0.0 && x.is_finite() => Ok(x),
        _ => Err("expected a number of seconds above 0".into()),
    }
}

/// Runs the command; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    let begun = Instant::now();
    let model = model::read(&args.model)?;
    if let Some(output) = &args.output {
        let given = args.data.inputs();
        let mut inputs = given.files();
        inputs.push(&args.model);
        check_output(output, &inputs, &["toml"])?;
    }
    if let Some(output) = &args.next {
        let given = args.data.inputs();
        let mut inputs = given.files();
        inputs.push(&args.model);
        check_output(output, &inputs, &["toml"])?;
    }
    check_report(args.report.as_deref(), &args.model, &args.data)?;
    let data = Data::read(&args.data.inputs(), &model)?;
    warn(&data.warnings);
    data.check_held(&args.hold, &model)?;
    guard(&model, &data, &args.data)?;
    let progress = spinner("diagnose");
    let samples: usize = data.datasets.iter().chain(&data.held_out).map(Dataset::len).sum();
    let allowance = Allowance::new(begun, args.time_limit, samples);
    catch_interrupt()?;
    // Ctrl-C ends the search as the time limit does: with an answer, if that comes soon.
    let clock = || allowance.passed().min(f64::MAX);
    let options = Options { fixed: &args.hold, clock: &clock, ..Options::default() };
    let mut stages = Stages::new("noise");
    let mut course = Course::default();
    let answer = diagnose_with(&model, &data.datasets, &data.held_out, &options, &mut |report| {
        course.follow(&report);
        progress.set_message(format!("{:>3.0} % diagnose: {}", 100.0 * course.span().0, course.text()));
        if let Progress::Step(what) = report {
            stages.next(what);
        }
    });
    let stages = stages.end();
    progress.finish_and_clear();
    let names: Vec<&str> = data.datasets.iter().map(|t| t.name.as_str()).collect();
    let answer = answer.into_diagnostic().wrap_err_with(|| format!("recording {}", names.join(", ")))?;
    warn(&much_is_left(&answer.channels, &answer.rms_after, &answer.noise_floor));
    let scenario = answer.next_experiment.as_ref().zip(args.next.as_deref()).filter(|(next, _)| writable(next, &model));
    let file = scenario.map(|(_, file)| file);
    if args.json {
        say(data.with_zeros(deltatwin_analysis::diagnose::json(&answer, args.output.as_deref(), file)))?;
    } else {
        screen::print(&answer, args)?;
        if args.verbose {
            details::print(&answer, &stages)?;
        }
        say("")?;
    }
    write(&answer, args, &model, scenario)?;
    write_report(args.report.as_deref(), args.json, || {
        let origin = origin("diagnose", Some(&args.model), &args.data.inputs(), &data.warnings)?;
        page::of_diagnosis(&answer, &model, &data, &origin).into_diagnostic()
    })?;
    Ok(status(&answer))
}

/// Exit status of an answer: negative if the time was up before there was one.
pub fn status(answer: &Diagnosis) -> u8 {
    if answer.verdict == Verdict::Undecided { BAD_ANSWER } else { DONE }
}

/// Writes the requested files after the answer; a failure to write one does not affect the others.
fn write(
    answer: &Diagnosis,
    args: &Args,
    model: &Model,
    scenario: Option<(&NextExperiment, &Path)>,
) -> miette::Result<()> {
    let figure = args.figure.as_deref().zip(answer.unexplained.as_ref()).map(|(path, u)| {
        write_figure(path, &drawing::shape::shape(&u.shape, &format!("What acts on {}", u.location), u.unit))
    });
    let next = scenario.map(|(next, output)| {
        let comments = [format!("Proposed by `deltatwin diagnose`: {}.", next.what)];
        write_experiment(&next.experiment, &comments, SEED, (model, &args.model), output)?;
        if args.json { Ok(()) } else { say(format!("  Wrote {}", output.display())) }
    });
    let model = args.output.as_deref().map(|output| {
        let provenance = provenance("diagnose", &args.data, &answer.parameters[1]);
        crate::command::identify::write(&answer.model, output, &provenance, args.json)
    });
    [figure, next, model].into_iter().flatten().collect()
}

/// Whether a proposal can be written as a scenario: not if its motion is that of the data, or of the disassembled
/// machine.
fn writable(next: &NextExperiment, model: &Model) -> bool {
    let apart = next.experiment.dataset.setup.configuration != Configuration::Assembled && model.assembled;
    if apart {
        warn(&["no scenario written: the next experiment needs the model of the machine taken apart".into()]);
    } else if next.experiment.course.is_none() {
        warn(&["no scenario written: the next experiment repeats the motion of the data".into()]);
    }
    !apart && next.experiment.course.is_some()
}

/// Seed of the sensor noise in the scenario of a proposal.
const SEED: u64 = 1;
