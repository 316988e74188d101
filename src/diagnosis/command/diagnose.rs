//! `deltatwin diagnose`.

use std::path::PathBuf;

use miette::IntoDiagnostic;
use serde_json::{Map, Value, json};

use super::unexplained;
use crate::diagnosis::{CandidateReport, Diagnosis, Named, Verdict, diagnose};
use crate::identification::{Data, DataArgs};
use crate::model::Model;
use crate::terminal::{
    DONE, Table, channel_names, check_output, estimates, insert_channels, path, say, significant, spinner, warn,
    write_figure,
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
    /// Figure to write: what acts where no known effect explains it.
    #[arg(long, value_name = "SVG")]
    pub figure: Option<PathBuf>,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> miette::Result<u8> {
    let model = Model::read(&args.model)?;
    if let Some(output) = &args.output {
        let mut inputs = Data::inputs(&args.data);
        inputs.push(&args.model);
        check_output(output, &inputs, &["toml"])?;
    }
    let data = Data::read(&args.data, &model)?;
    warn(&data.warnings);
    let progress = spinner("diagnose");
    let answer =
        diagnose(&model, &data.traces, &data.held_out, &mut |what| progress.set_message(format!("diagnose: {what}")));
    progress.finish_and_clear();
    let answer = answer.into_diagnostic()?;
    if let Some(output) = &args.output {
        crate::identification::command::write(&answer.model, output)?;
    }
    if let (Some(path), Some(u)) = (&args.figure, &answer.unexplained) {
        let figure = u.shape.figure(&format!("What acts on {}", u.location), u.unit);
        write_figure(path, &figure)?;
    }
    if args.json { say(json(&answer, args)) } else { print(&answer, args) }?;
    Ok(DONE)
}

fn json(d: &Diagnosis, args: &Args) -> Value {
    let mut object = Map::new();
    object.insert("verdict".into(), json!(d.verdict.to_string()));
    object.insert("channels".into(), channel_names(&d.channels));
    insert_channels(&mut object, "noise_floor", &d.channels, &d.noise_floor);
    insert_channels(&mut object, "rms_before", &d.channels, &d.rms_before);
    insert_channels(&mut object, "rms_after", &d.channels, &d.rms_after);
    let effect = |e: &Named| {
        json!({
            "name": e.name,
            "probability": e.probability,
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
    object.insert("next_experiment".into(), json!(d.next_experiment));
    object.insert(
        "unexplained".into(),
        d.unexplained.as_ref().map_or(Value::Null, |u| unexplained::json(u, d.explained())),
    );
    object.insert("model".into(), args.output.as_deref().map_or(Value::Null, path));
    Value::Object(object)
}

fn print(d: &Diagnosis, args: &Args) -> miette::Result<()> {
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
            e.probability,
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
    if !d.unseen.is_empty() {
        say(format!("\n  These data could not show: {}", d.unseen.join(", ")))?;
    }
    if let Some(next) = &d.next_experiment {
        say(format!("\n  Next experiment, {next}"))?;
    }
    match &args.output {
        Some(output) => say(format!("\n  Wrote {}", output.display())),
        None => Ok(()),
    }
}

/// Candidates worth a line.
const SHOWN: usize = 8;
