//! `deltatwin diagnose`.

use std::path::{Path, PathBuf};
use std::time::Instant;

use miette::{IntoDiagnostic, miette};
use serde_json::{Map, Value, json};

use super::{budget, unexplained};
use crate::diagnosis::confidence::{Confidence, Truth};
use crate::diagnosis::{CandidateReport, Diagnosis, Named, NextExperiment, Verdict, diagnose_within};
use crate::dynamics::Plant;
use crate::excitation::scenario::write_plan;
use crate::identification::{Data, DataArgs, Trace};
use crate::model::Model;
use crate::recording::Configuration;
use crate::terminal::{
    DONE, Table, catch_interrupt, channel_names, check_output, estimates, insert_channels, interrupted, path, say,
    significant, spinner, warn, write_figure,
};

/// Find the physical effect that a model lacks.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Example: deltatwin diagnose models/irb360-6-1600.toml run.mcap --held-out other.mcap")]
pub struct Args {
    /// Model file.
    pub model: PathBuf,
    #[command(flatten)]
    data: DataArgs,
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
    /// Time after which the best answer so far is given, with what was not tried; by default 15 s for every 50 000 samples of
    /// all recordings, and not less than 30 s. Ctrl-C ends it, too.
    #[arg(long, value_name = "SECONDS", value_parser = positive)]
    pub time_limit: Option<f64>,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Default time limit: s per sample, and at least, s.
const TIME_PER_SAMPLE: f64 = 3e-4;
const LEAST_TIME: f64 = 30.0;

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x > 0.0 && x.is_finite() => Ok(x),
        _ => Err("expected a number of seconds above 0".into()),
    }
}

/// Runs the command.
pub fn run(args: &Args) -> miette::Result<u8> {
    let model = Model::read(&args.model)?;
    if let Some(output) = &args.output {
        let mut inputs = Data::inputs(&args.data);
        inputs.push(&args.model);
        check_output(output, &inputs, &["toml"])?;
    }
    if let Some(output) = &args.next {
        let mut inputs = Data::inputs(&args.data);
        inputs.push(&args.model);
        check_output(output, &inputs, &["toml"])?;
    }
    let data = Data::read(&args.data, &model)?;
    warn(&data.warnings);
    known(&args.hold, &model, &data.traces[0])?;
    let progress = spinner("diagnose");
    let samples: usize = data.traces.iter().chain(&data.held_out).map(Trace::len).sum();
    let limit = args.time_limit.unwrap_or_else(|| (TIME_PER_SAMPLE * samples as f64).max(LEAST_TIME));
    let begun = Instant::now();
    catch_interrupt()?;
    let clock = || if interrupted() { f64::INFINITY } else { begun.elapsed().as_secs_f64() / limit };
    let answer = diagnose_within(&clock, &model, &args.hold, &data.traces, &data.held_out, &mut |what| {
        progress.set_message(format!("diagnose: {what}"));
    });
    progress.finish_and_clear();
    let answer = answer.into_diagnostic()?;
    if let Some(output) = &args.output {
        crate::identification::command::write(&answer.model, output)?;
    }
    if let (Some(path), Some(u)) = (&args.figure, &answer.unexplained) {
        let figure = u.shape.figure(&format!("What acts on {}", u.location), u.unit);
        write_figure(path, &figure)?;
    }
    let scenario = match (&answer.next_experiment, &args.next) {
        (Some(next), Some(output)) => write_next(next, &model, &args.model, output)?,
        _ => None,
    };
    if args.json { say(json(&answer, args, scenario)) } else { print(&answer, args, scenario) }?;
    Ok(DONE)
}

/// Refuses names of effects that the machine of the data does not have.
fn known(held: &[String], model: &Model, trace: &Trace) -> miette::Result<()> {
    let parameters = Plant::new(model, &trace.setup).parameters();
    match held.iter().find(|name| !parameters.iter().any(|p| p.effect == *name)) {
        Some(name) => Err(miette!("--hold {name}: the model has no such effect")),
        None => Ok(()),
    }
}

/// Writes the scenario of a proposal; none if its motion is that of the data, or of the machine taken apart.
fn write_next<'a>(
    next: &NextExperiment,
    model: &Model,
    model_file: &Path,
    output: &'a Path,
) -> miette::Result<Option<&'a Path>> {
    let apart = next.experiment.trace.setup.configuration != Configuration::Assembled && model.assembled;
    if next.experiment.course.is_none() || apart {
        let what = if apart { "needs the model of the machine taken apart" } else { "repeats the motion of the data" };
        warn(&[format!("{}: not written, the experiment {what}", output.display())]);
        return Ok(None);
    }
    let comments = [format!("Proposed by `deltatwin diagnose`, {}.", next.what)];
    write_plan(&next.experiment, &comments, SEED, (model, model_file), output)?;
    Ok(Some(output))
}

fn json(d: &Diagnosis, args: &Args, scenario: Option<&Path>) -> Value {
    let mut object = Map::new();
    object.insert("verdict".into(), json!(d.verdict.to_string()));
    object.insert("channels".into(), channel_names(&d.channels));
    insert_channels(&mut object, "noise_floor", &d.channels, &d.noise_floor);
    insert_channels(&mut object, "rms_before", &d.channels, &d.rms_before);
    insert_channels(&mut object, "rms_after", &d.channels, &d.rms_after);
    let effect = |e: &Named| {
        json!({
            "name": e.name,
            "probability": e.confidence.probability(),
            "confusion": confusion(&e.confidence),
            "explained": e.explained,
            "parameters": estimates(&e.parameters),
        })
    };
    object.insert("effects".into(), d.effects.iter().map(effect).collect());
    let candidate = |c: &CandidateReport| {
        json!({
            "name": c.name,
            "probability": c.probability,
            "explained": c.explained,
            "p_adjusted": c.p_adjusted,
            "visible": c.visible,
            "absorbed_by": c.absorbed_by,
        })
    };
    object.insert("candidates".into(), d.candidates.iter().map(candidate).collect());
    object.insert("indistinguishable".into(), json!(d.indistinguishable));
    object.insert("unseen".into(), json!(d.unseen));
    object.insert("not_tried".into(), json!(d.not_tried));
    object.insert("sampling_lag".into(), json!(d.sampling_lag));
    object.insert("next_experiment".into(), d.next_experiment.as_ref().map_or(Value::Null, |e| next(e, scenario)));
    object.insert("budget".into(), budget::json(&d.budget));
    object.insert("parameters_before".into(), estimates(&d.parameters[0]));
    object.insert("parameters_after".into(), estimates(&d.parameters[1]));
    object.insert(
        "unexplained".into(),
        d.unexplained.as_ref().map_or(Value::Null, |u| unexplained::json(u, d.explained())),
    );
    object.insert("model".into(), args.output.as_deref().map_or(Value::Null, path));
    Value::Object(object)
}

/// A proposed experiment for JSON.
fn next(e: &NextExperiment, scenario: Option<&Path>) -> Value {
    let other = |(kind, chance, seconds): &(&str, f64, Option<f64>)| json!({"kind": kind, "chance": chance, "seconds": seconds});
    json!({
        "what": e.what,
        "kind": e.kind,
        "pair": e.pair,
        "noncentrality": e.noncentrality,
        "chance": e.chance,
        "duration": e.duration,
        "seconds": e.seconds,
        "scenario": scenario.map(path),
        "others": e.others.iter().map(other).collect::<Vec<_>>(),
    })
}

fn confusion(c: &Confidence) -> Value {
    let truth = |t: &Truth| json!({ "truth": t.name, "said": t.said, "probability": t.probability });
    json!({ "draws": c.draws, "truths": c.truths.iter().map(truth).collect::<Vec<_>>() })
}

fn print(d: &Diagnosis, args: &Args, scenario: Option<&Path>) -> miette::Result<()> {
    say(match d.verdict {
        Verdict::None => "Nothing is missing that these data show.",
        Verdict::Effect => "One effect is missing.",
        Verdict::Several => "Several effects are missing.",
        Verdict::Ambiguous => "Something is missing, and these data do not tell which of several effects.",
        Verdict::Unknown => "Something is missing that no known effect explains.",
    })?;
    for e in &d.effects {
        say(format!(
            "\n  {}: probability {:.2}, explains {:.1} % of the explainable error",
            e.name,
            e.confidence.probability(),
            100.0 * e.explained
        ))?;
        let mut table = Table::new(&["  parameter", "value", "std", "unit"], &[3]);
        for p in &e.parameters {
            table.row([format!("  {}", p.name), significant(p.value, 4), significant(p.std, 2), p.unit.into()]);
        }
        say(table)?;
    }
    if let Some(u) = &d.unexplained {
        unexplained::print(u, d.explained())?;
    }
    let series = [
        ("before", Some(&d.rms_before[..])),
        ("after", Some(&d.rms_after[..])),
        ("noise floor", Some(&d.noise_floor[..])),
    ];
    say(format!("\n{}", Table::of_channels(&d.channels, &series)))?;
    budget::print(&d.budget, &d.changes, &d.model.history)?;
    let mut table = Table::new(&["Candidate", "probability", "explains", "p", "imitated by"], &[4]);
    for c in d.candidates.iter().filter(|c| c.visible).take(SHOWN) {
        table.row([
            c.name.clone(),
            format!("{:.2}", c.probability),
            format!("{:.1} %", 100.0 * c.explained),
            significant(c.p_adjusted, 2),
            c.absorbed_by.join(", "),
        ]);
    }
    say(format!("\n{table}"))?;
    for set in &d.indistinguishable {
        say(format!("\n  These data cannot tell apart: {}", set.join(", ")))?;
    }
    if let Some(lag) = d.sampling_lag {
        let late = significant(1e3 * lag, 2);
        say(format!(
            "\n  The torques are recorded {late} ms late, less than half a sample: no effect, but in the model"
        ))?;
    }
    if !d.unseen.is_empty() {
        say(format!("\n  These data could not show: {}", d.unseen.join(", ")))?;
    }
    if !d.not_tried.is_empty() {
        let names = d.not_tried.join(", ");
        say(format!("\n  The time was up (--time-limit); not tried: {names}"))?;
    }
    if let Some(next) = &d.next_experiment {
        say(format!("\n  Next experiment, {}", next.what))?;
        if let Some(scenario) = scenario {
            say(format!("  Wrote {}", scenario.display()))?;
        }
    }
    match &args.output {
        Some(output) => say(format!("\n  Wrote {}", output.display())),
        None => Ok(()),
    }
}

/// Seed of the sensor noise when the twin runs a proposal.
const SEED: u64 = 1;
/// Candidates worth a line.
const SHOWN: usize = 8;
