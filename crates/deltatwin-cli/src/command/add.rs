//! `deltatwin add`.

use std::path::PathBuf;
use std::sync::Arc;

use miette::{IntoDiagnostic, WrapErr, miette};

use super::diagnose::budget;
use crate::command::gate::{guard, much_is_left};
use crate::command::identify::provenance;
use crate::data::{Data, DataArgs};
use crate::report::{check_report, write_report};
use crate::terminal::{DONE, Table, check_output, error_bars, origin, say, spinner, warn};
use deltatwin::diagnosis::{Addition, Options, add_with, parameters_of};
use deltatwin::effects::Effect;
use deltatwin::effects::formula::NAME;
use deltatwin::identification::Estimate;
use deltatwin::model::Model;
use deltatwin::text::significant;
use deltatwin_analysis::law::TermError;
use deltatwin_analysis::{law, page};
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
    /// Term of the effect `formula`, as PLACE: LAW, such as "drive1: -tanh(50*qd1)"; may be given several times.
    #[arg(long, value_name = "TERM")]
    pub law: Vec<String>,
    #[command(flatten)]
    data: DataArgs,
    /// Model file to write.
    #[arg(short, long, value_name = "MODEL2")]
    pub output: PathBuf,
    /// Page to write, with the error before and after, the parameters, and what is left.
    #[arg(long, value_name = "FILE.html")]
    pub report: Option<PathBuf>,
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
    let candidates = typed(args, &model)?;
    let given = args.data.inputs();
    let mut inputs = given.files();
    inputs.push(&args.model);
    check_output(&args.output, &inputs, &["toml"])?;
    check_report(args.report.as_deref(), &args.model, &args.data)?;
    let data = Data::read(&args.data.inputs(), &model)?;
    warn(&data.warnings);
    guard(&model, &data, &args.data)?;
    let progress = spinner(&format!("add {}", args.effect));
    let candidates = candidates.as_slice();
    let options = Options { candidates, ..Options::default() };
    let addition = add_with(&model, &args.effect, &data.datasets, &data.held_out, &options);
    progress.finish_and_clear();
    let names: Vec<&str> = data.datasets.iter().map(|t| t.name.as_str()).collect();
    let addition = addition.map_err(|error| match TermError::of(&error, &args.law) {
        Some(fault) => miette::Report::new(fault).wrap_err("--law"),
        None => miette::Report::from_err(error).wrap_err(format!("recording {}", names.join(", "))),
    })?;
    warn(&much_is_left(data.channels(), addition.budget.rms_after(), &addition.budget.noise_floor));
    let parameters = parameters_of(&addition.fit, &addition.effect);
    if args.json {
        say(data.with_zeros(deltatwin_analysis::add::json(&addition, Some(&args.output))))?;
    } else {
        print(&addition, &parameters, &data, args.verbose)?;
    }
    let provenance = provenance("add", &args.data, &addition.fit.parameters);
    crate::command::identify::write_fit(&addition.fit, &args.output, &provenance, args.json)?;
    write_report(args.report.as_deref(), args.json, || {
        let origin = origin("add", Some(&args.model), &args.data.inputs(), &data.warnings)?;
        page::of_addition(&addition, &model, &data, &origin).into_diagnostic()
    })?;
    Ok(DONE)
}

/// The formula of the typed terms, if there are any.
fn typed(args: &Args, model: &Model) -> miette::Result<Vec<Arc<dyn Effect>>> {
    if args.law.is_empty() {
        return Ok(Vec::new());
    }
    if args.effect != NAME {
        return Err(miette!("--law is of the effect `{NAME}`, not of `{}`", args.effect));
    }
    let formula = law::formula(model.mechanism, &args.law).into_diagnostic().wrap_err("--law")?;
    Ok(vec![formula])
}

fn print(a: &Addition, parameters: &[Estimate], data: &Data, verbose: bool) -> miette::Result<()> {
    let mut table = Table::new(&[&a.effect, "value", "std", "unit"], &[3]);
    for p in parameters {
        table.row([p.name.clone(), significant(p.value, 4), significant(p.std, 2), p.unit.to_string()]);
    }
    say(table)?;
    let b = &a.budget;
    say(format!(
        "\n{}",
        error_bars(data.mechanism(), data.channels(), b.held_out, &b.rms_before, b.rms_after(), &b.noise_floor)
    ))?;
    if verbose {
        budget::print(&a.budget, &a.changes, &a.fit.model.history)?;
    }
    say("")
}
