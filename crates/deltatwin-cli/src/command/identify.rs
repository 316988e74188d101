//! `deltatwin identify`.

mod how;
mod payload;

use std::path::{Path, PathBuf};

use miette::{IntoDiagnostic, WrapErr, miette};

use self::how::How;
use crate::command::compare::other_noise;
use crate::command::gate::{guard, much_is_left};
use crate::data::{Data, DataArgs};
use crate::report::{check_report, write_report};
use crate::terminal::{DONE, Table, check_output, origin, say, spinner, today, warn};
use deltatwin::comparison::compare;
use deltatwin::identification::consistency::min_eigenvalue;
use deltatwin::identification::fit::FitError;
use deltatwin::identification::uncertainty::Uncertainty;
use deltatwin::identification::{BaseParameter, Estimate, Fit, HeldOut, LimbTest, NoiseLevel, fit_with, limb_test};
use deltatwin::model::{Model, Provenance};
use deltatwin::text::significant;
use deltatwin_analysis::identify::Identification;
use deltatwin_analysis::page;
use deltatwin_io::file::WriteError;
use deltatwin_io::model::{self, uncertainty};

/// Estimate the parameters of a model from recordings.
#[derive(clap::Args, Clone, Debug)]
#[command(
    after_help = "Example: deltatwin identify models/irb360-6-1600.toml run.mcap --held-out other.mcap -o fitted.toml"
)]
pub struct Args {
    /// Model file to start from.
    pub model: PathBuf,
    #[command(flatten)]
    data: DataArgs,
    /// Model file to write.
    #[arg(short, long, value_name = "MODEL2")]
    pub output: Option<PathBuf>,
    /// Identify the payload instead, with everything else as the model has it; `-o` then writes a setup file.
    #[arg(long)]
    pub payload: bool,
    /// Page to write, with the errors before and after, the parameters, and what is left.
    #[arg(long, value_name = "FILE.html", conflicts_with = "payload")]
    pub report: Option<PathBuf>,
    #[command(flatten)]
    how: How,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    let mut model = model::read(&args.model)?;
    if let Some(output) = &args.output {
        let given = args.data.inputs();
        let mut inputs = given.files();
        inputs.push(&args.model);
        check_output(output, &inputs, &["toml"])?;
    }
    check_report(args.report.as_deref(), &args.model, &args.data)?;
    model.link_parameters = args.how.links(&model);
    let data = Data::read_with(&args.data.inputs(), &model, args.how.method())?;
    warn(&data.warnings);
    data.check_held(args.how.fixed(), &model)?;
    guard(&model, &data, &args.data)?;
    let noise = NoiseLevel::measured(&model, &data.datasets).map_err(refusal)?;
    let prior = args.how.prior(&model)?;
    let options = args.how.options(prior.as_ref());
    if args.payload {
        return payload::run(args, &model, &data, noise, &options);
    }
    let progress = spinner("fit");
    let fitted = fit_with(&model, &data.datasets, &noise.of_each, &options);
    let limbs = fitted
        .as_ref()
        .map_or(Ok(None), |fit| limb_test(fit, &model, (&data.datasets, &data.held_out), &noise, &options));
    progress.finish_and_clear();
    let (fitted, limbs) = (fitted.map_err(refusal)?, limbs.map_err(refusal)?);
    warn(&much_is_left(data.channels(), &fitted.residuals.rms, &noise.pooled));
    let held_out = HeldOut::new(&fitted.model, &data.held_out).into_diagnostic()?;
    let channels = data.channels().to_vec();
    let answer = Identification { fitted, channels, noise_floor: noise.pooled, held_out, limbs };
    if args.json { say(data.with_zeros(answer.json(args.output.as_deref()))) } else { print(&answer) }?;
    match &args.output {
        Some(output) => {
            let provenance = provenance("identify", &args.data, &answer.fitted.parameters);
            write_fit(&answer.fitted, output, &provenance, args.json)?;
        }
        None if args.json => {}
        None => say("  Nothing written; -o FILE keeps the model")?,
    }
    write_report(args.report.as_deref(), args.json, || {
        let origin = origin("identify", Some(&args.model), &args.data.inputs(), &data.warnings)?;
        let before = compare(&model, &data.datasets, &data.held_out).into_diagnostic()?;
        page::of_identification(&answer, &before, &model, &data, &origin).into_diagnostic()
    })?;
    Ok(DONE)
}

/// Error of a fit, with the option that caused it.
fn refusal(error: FitError) -> miette::Report {
    let option = match error {
        FitError::NothingToEstimate => "--hold",
        FitError::NoSuchGroup { .. } => "--gamma",
        FitError::NoFlange { .. } => "--payload",
        _ => return miette!("{error}"),
    };
    miette!("{option}: {error}")
}

/// Provenance of the numbers fitted by a command today.
pub(crate) fn provenance(command: &str, data: &DataArgs, parameters: &[Estimate]) -> Provenance {
    Provenance::new(
        command,
        today(),
        data.data.iter().map(|f| f.display().to_string()).collect(),
        parameters.iter().map(|p| (p.name.clone(), p.std)),
    )
}

/// Writes the model of a fit, and its covariance beside it; reports them unless `quietly`.
pub(crate) fn write_fit(fit: &Fit, output: &Path, provenance: &Provenance, quietly: bool) -> miette::Result<()> {
    write(&fit.model, output, provenance, quietly)?;
    let covariance = uncertainty::beside(output);
    uncertainty::write(&Uncertainty::of(fit), output)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot write {}", covariance.display()))?;
    if quietly {
        Ok(())
    } else {
        say(format!("  Wrote {}, for studies over what the fit leaves open", covariance.display()))
    }
}

/// Writes a fitted model after its answer was printed; reports it unless `quietly`.
pub(crate) fn write(model: &Model, output: &Path, provenance: &Provenance, quietly: bool) -> miette::Result<()> {
    if let Err(refused) = deltatwin_io::model::write_fitted(model, output, provenance) {
        // Of the file, not of the fit.
        if refused.is::<WriteError>() {
            return Err(refused);
        }
        let causes: Vec<String> = refused.chain().map(ToString::to_string).collect();
        return Err(miette!(
            help = "A fit that leaves what a model file admits belongs to recordings that do not determine it: `deltatwin \
                    check DATA --model MODEL` tells what is wrong with them, `deltatwin compare` what the model leaves \
                    before a fit; a faster motion determines masses, `--hold rigid_bodies` of `identify` keeps them",
            "{}: the fitted model was not written: {}",
            output.display(),
            causes.join(": ")
        ));
    }
    if quietly { Ok(()) } else { say(format!("  Wrote {}", output.display())) }
}

fn print(answer: &Identification) -> miette::Result<()> {
    let fitted = &answer.fitted;
    let mut table = Table::new(&["Parameter", "value", "std", "unit"], &[3]);
    for p in fitted.parameters.iter().filter(|p| p.identified()) {
        table.row([p.name.clone(), significant(p.value, 4), significant(p.std, 2), p.unit.to_string()]);
    }
    say(table)?;
    let together: Vec<&BaseParameter> = fitted.base.iter().filter(|b| !b.others.is_empty()).collect();
    if !together.is_empty() {
        let mut table = Table::new(&["Value", "std", "unit", "only together"], &[2, 3]);
        for b in together {
            table.row([significant(b.value, 4), significant(b.std, 2), b.unit.to_string(), b.combination()]);
        }
        say(format!("\n{table}"))?;
    }
    print_unidentified(fitted)?;
    let series = [
        ("fitted", Some(&fitted.residuals.rms[..])),
        ("held out", answer.held_out.as_ref().map(|h| &h.rms[..])),
        ("noise floor", Some(&answer.noise_floor[..])),
        ("held-out noise", other_noise(&answer.noise_floor, answer.held_out.as_ref())),
    ];
    say(format!("\n{}", Table::of_channels(answer.fitted.model.mechanism, &answer.channels, &series)))?;
    let structure = &fitted.structure;
    say(format!("\n  {} base parameters, condition number {}", structure.rank, significant(structure.condition(), 3)))?;
    say(format!("  Smallest pseudo-inertia eigenvalue {:.3e}", min_eigenvalue(&fitted.model.bodies)))?;
    print_correction(fitted)?;
    answer.limbs.as_ref().map_or(Ok(()), |test| print_limbs(test, fitted.model.link_parameters.each_limb))
}

/// What the data say about limbs with the same or with their own parameters, if the model has it otherwise or they differ.
fn print_limbs(test: &LimbTest, is_own: bool) -> miette::Result<()> {
    let judged = if test.held_out { "held-out" } else { "fitted" };
    let change = significant(100.0 * (1.0 - test.error), 2);
    let gain = format!("{change} % of the squared error on {judged} data (t = {:.1})", test.t);
    match (test.demanded, is_own) {
        (true, false) => say(format!("  The limbs differ: `--limbs own` takes away {gain}"))?,
        (true, true) => say(format!("  The limbs differ: their own parameters take away {gain}"))?,
        (false, true) => say(format!("  Limbs alike would do: their own parameters take away {gain}"))?,
        (false, false) => return say("  Limbs alike: parameters of their own are not demanded by the data"),
    }
    for one in &test.differing {
        let values: Vec<String> = one.values.iter().map(|v| significant(*v, 4)).collect();
        say(format!("    {}: {} {}", one.name, values.join(", "), one.unit))?;
    }
    Ok(())
}

fn print_unidentified(fitted: &Fit) -> miette::Result<()> {
    if fitted.unidentified.is_empty() {
        return Ok(());
    }
    let mut table = Table::new(&["Not identified", "because"], &[1]);
    for u in &fitted.unidentified {
        table.row([u.name.clone(), u.reason.to_string()]);
    }
    say(format!("\n{table}"))
}

fn print_correction(fitted: &Fit) -> miette::Result<()> {
    let Some(c) = fitted.correction else { return Ok(()) };
    let proof = c.gap.map_or_else(String::new, |gap| format!(",\n  proven to be least to {gap:.1e} of that"));
    let cost = significant(c.cost, 3);
    say(format!("  The free estimate was no possible machine: consistency costs {cost} in ½Σr²/σ²{proof}"))?;
    if fitted.moved.is_empty() {
        return say("  It moved no identified parameter by more than its standard error");
    }
    let mut table = Table::new(&["Moved to be possible", "from", "to", "standard errors", "unit"], &[4]);
    for m in &fitted.moved {
        let by = significant((m.value - m.free).abs() / m.std, 3);
        table.row([m.name.clone(), significant(m.free, 4), significant(m.value, 4), by, m.unit.to_string()]);
    }
    say(format!("\n{table}"))
}
