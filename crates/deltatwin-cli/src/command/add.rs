//! `deltatwin add`.

use std::path::PathBuf;

use miette::{IntoDiagnostic, WrapErr};
use serde_json::{Map, Value};

use super::diagnose::budget;
use crate::command::gate::{guard, much_is_left};
use crate::command::identify::provenance;
use crate::data::{Data, DataArgs};
use crate::terminal::{
    DONE, Table, channel_names, check_output, error_bars, estimates, insert_channels, path, say, spinner, warn,
};
use deltatwin::diagnosis::{Addition, add, parameters_of};
use deltatwin::identification::Estimate;
use deltatwin::text::significant;
use deltatwin_io::model;

/// Add an effect to a model, refit, and see the error fall.
#[derive(clap::Args, Clone, Debug)]
#[command(
    after_help = "Example: deltatwin add models/irb360-6-1600.toml ball_socket_coulomb run.mcap -o with-sockets.toml"
)]
pub struct Args {
    /// Model file; it stays as it is.
    pub model: PathBuf,
    /// Name of the effect, see `deltatwin effects`.
    pub effect: String,
    #[command(flatten)]
    data: DataArgs,
    /// Model file to write.
    #[arg(short, long, value_name = "MODEL2")]
    pub output: PathBuf,
    /// Show the error budget and the parameters that moved, too.
    #[arg(short, long)]
    pub verbose: bool,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    let model = model::read(&args.model)?;
    crate::command::effects::known(&args.effect)?;
    let mut inputs = Data::inputs(&args.data);
    inputs.push(&args.model);
    check_output(&args.output, &inputs, &["toml"])?;
    let data = Data::read(&args.data, &model)?;
    warn(&data.warnings);
    guard(&model, &data, &args.data)?;
    let progress = spinner(&format!("add {}", args.effect));
    let addition = add(&model, &args.effect, &data.datasets, &data.held_out);
    progress.finish_and_clear();
    let names: Vec<&str> = data.datasets.iter().map(|t| t.name.as_str()).collect();
    let addition = addition.into_diagnostic().wrap_err_with(|| format!("recording {}", names.join(", ")))?;
    warn(&much_is_left(data.channels(), addition.budget.rms_after(), &addition.budget.noise_floor));
    let parameters = parameters_of(&addition.fit, &addition.effect);
    if args.json {
        say(json(&addition, &parameters, &data, args))?;
    } else {
        print(&addition, &parameters, &data, args.verbose)?;
    }
    let provenance = provenance("add", &args.data, &addition.fit.parameters);
    crate::command::identify::write(&addition.fit.model, &args.output, &provenance, args.json)?;
    Ok(DONE)
}

fn json(a: &Addition, parameters: &[Estimate], data: &Data, args: &Args) -> Value {
    let mut object = Map::new();
    object.insert("effect".into(), a.effect.clone().into());
    object.insert("channels".into(), channel_names(data.channels()));
    insert_channels(&mut object, "rms_before", data.channels(), &a.budget.rms_before);
    insert_channels(&mut object, "rms_after", data.channels(), a.budget.rms_after());
    insert_channels(&mut object, "noise_floor", data.channels(), &a.budget.noise_floor);
    object.insert("parameters".into(), estimates(parameters));
    object.insert("budget".into(), budget::json(&a.budget));
    object.insert("parameters_before".into(), estimates(&a.parameters_before));
    object.insert("parameters_after".into(), estimates(&a.fit.parameters));
    object.insert("model".into(), path(&args.output));
    Value::Object(object)
}

fn print(a: &Addition, parameters: &[Estimate], data: &Data, verbose: bool) -> miette::Result<()> {
    let mut table = Table::new(&[&a.effect, "value", "std", "unit"], &[3]);
    for p in parameters {
        table.row([p.name.clone(), significant(p.value, 4), significant(p.std, 2), p.unit.to_string()]);
    }
    say(table)?;
    let b = &a.budget;
    say(format!("\n{}", error_bars(data.channels(), b.held_out, &b.rms_before, b.rms_after(), &b.noise_floor)))?;
    if verbose {
        budget::print(&a.budget, &a.changes, &a.fit.model.history)?;
    }
    say("")
}
