//! `deltatwin compare`.

use std::path::PathBuf;

use miette::{IntoDiagnostic, WrapErr};

use crate::command::gate::guard;
use crate::data::{Data, DataArgs, positive};
use crate::report::{check_report, write_report};
use crate::terminal::{
    BAD_ANSWER, DONE, Table, check_output, input, origin, say, say_repeats, spinner, warn, wrapped, write_figure,
};
use deltatwin::comparison::{Comparison, compare};
use deltatwin::identification::HeldOut;
use deltatwin::model::Model;
use deltatwin_analysis::page;
use deltatwin_io::model;
use deltatwin_report::Role;
use deltatwin_report::drawing::residual::{self, Stage};

/// Show where a model fails to predict recordings.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Example: deltatwin compare models/irb360-6-1600.toml run.mcap")]
pub struct Args {
    /// Model file.
    pub model: PathBuf,
    #[command(flatten)]
    data: DataArgs,
    /// Exit with status 1 if the RMS of any channel, fitted or held out, is above so many times the noise floor.
    #[arg(long, value_name = "RATIO", value_parser = positive)]
    pub fail_above: Option<f64>,
    /// Page to write, with what the model leaves over time, angle, speed and frequency.
    #[arg(long, value_name = "FILE.html")]
    pub report: Option<PathBuf>,
    /// A later model of the same machine, whose residual is drawn beside.
    #[arg(long, value_name = "MODEL2")]
    pub beside: Option<PathBuf>,
    /// Folder for the same as SVG, made if need be.
    #[arg(long, value_name = "DIR")]
    pub figure: Option<PathBuf>,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    let model = model::read(&args.model)?;
    check_report(args.report.as_deref(), &args.model, &args.data)?;
    if let Some((page, other)) = args.report.as_deref().zip(args.beside.as_deref()) {
        check_output(page, &[other], &["html"])?;
    }
    let beside = args.beside.as_deref().map(model::read).transpose()?;
    let data = Data::read(&args.data.inputs(), &model)?;
    warn(&data.warnings);
    let gate = guard(&model, &data, &args.data)?;
    let progress = spinner("compare");
    let comparison = compare(&model, &data.datasets, &data.held_out);
    progress.finish_and_clear();
    let comparison = comparison.into_diagnostic()?;
    if args.json {
        say(data.with_zeros(deltatwin_analysis::compare::json(&comparison, &gate)))?;
    } else {
        print(&comparison)?;
    }
    let name = args.beside.as_ref().map(|path| path.display().to_string()).unwrap_or_default();
    let beside = beside.as_ref().map(|model| (&name[..], model));
    draw(args, &model, beside, &data, comparison.judged().1)?;
    write_report(args.report.as_deref(), args.json, || {
        let mut origin = origin("compare", Some(&args.model), &args.data.inputs(), &data.warnings)?;
        origin
            .inputs
            .extend(args.beside.iter().map(|file| input("later model", file)).collect::<miette::Result<Vec<_>>>()?);
        page::of_comparison(&comparison, &model, beside, &data, &origin).into_diagnostic()
    })?;
    let Some(most) = args.fail_above else { return Ok(DONE) };
    match comparison.worst().filter(|(_, ratio)| *ratio > most) {
        Some((channel, ratio)) => {
            warn(&[format!("{channel}: RMS {ratio:.3} times the noise floor, above {most}")]);
            Ok(BAD_ANSWER)
        }
        None => Ok(DONE),
    }
}

/// Writes the figures of the last recording, a held-out one if there is any.
fn draw(args: &Args, model: &Model, beside: Option<(&str, &Model)>, data: &Data, noise: &[f64]) -> miette::Result<()> {
    let (Some(folder), Some(dataset)) = (&args.figure, data.held_out.last().or(data.datasets.last())) else {
        return Ok(());
    };
    let stages = std::iter::once((Role::Nominal, ("model", model)))
        .chain(beside.map(|other| (Role::Added, other)))
        .map(|(role, (name, model))| Stage { role, name, model });
    std::fs::create_dir_all(folder).into_diagnostic().wrap_err_with(|| folder.display().to_string())?;
    for (name, figure) in residual::figures(&stages.collect::<Vec<_>>(), dataset, noise).into_diagnostic()? {
        write_figure(&folder.join(name.replace(' ', "-")).with_extension("svg"), &figure)?;
    }
    if args.json { Ok(()) } else { say(format!("  Wrote the figures into {}", folder.display())) }
}

fn print(c: &Comparison) -> miette::Result<()> {
    let series = [
        ("model", Some(&c.rms[..])),
        ("held out", c.held_out.as_ref().map(|h| &h.rms[..])),
        ("noise floor", Some(&c.noise_floor[..])),
        ("held-out noise", other_noise(&c.noise_floor, c.held_out.as_ref())),
    ];
    say(Table::of_channels(c.mechanism, &c.channels, &series))?;
    if let Some(repeats) = &c.repeats {
        say_repeats(repeats)?;
    }
    if c.findings.is_empty() {
        return say("\n  Nothing stands out.");
    }
    say("")?;
    c.findings.iter().try_for_each(|f| say(wrapped(&f.sentence, 2)))
}

/// Noise of the held-out data where it is not `of_fitted` data's.
pub(super) fn other_noise<'a>(of_fitted: &[f64], held_out: Option<&'a HeldOut>) -> Option<&'a [f64]> {
    /// Share by which estimates of one noise differ.
    const ALIKE: f64 = 0.05;
    let held_out = &held_out?.noise_floor;
    let differs = |(own, other): (&f64, &f64)| (other - own).abs() > ALIKE * own;
    held_out.iter().zip(of_fitted).any(differs).then_some(held_out)
}
