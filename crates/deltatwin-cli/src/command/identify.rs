//! `deltatwin identify`.

mod how;
mod payload;

use std::path::{Path, PathBuf};

use miette::{IntoDiagnostic, WrapErr, miette};
use serde_json::{Map, Value, json};

use self::how::How;
use crate::command::gate::{guard, much_is_left};
use crate::data::{Data, DataArgs};
use crate::terminal::{
    DONE, Table, channel_names, check_output, estimates, insert_channels, path, say, spinner, today, warn,
};
use deltatwin::dynamics::Channel;
use deltatwin::identification::consistency::min_eigenvalue;
use deltatwin::identification::dataset::noise_floor as floor;
use deltatwin::identification::fit::{FitError, Moved, Unidentified};
use deltatwin::identification::{BaseParameter, Estimate, Fit, Residuals, fit_with};
use deltatwin::machine::bodies::{Inertia, body_name};
use deltatwin::model::{Model, Provenance};
use deltatwin::text::significant;
use deltatwin_io::model;

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
        let mut inputs = Data::inputs(&args.data);
        inputs.push(&args.model);
        check_output(output, &inputs, &["toml"])?;
    }
    model.link_parameters = args.how.links();
    let data = Data::read_with(&args.data, &model, args.how.method())?;
    warn(&data.warnings);
    data.check_held(args.how.fixed(), &model)?;
    guard(&model, &data, &args.data)?;
    let noise_floor = floor(&model, &data.datasets);
    let prior = args.how.prior(&model)?;
    let options = args.how.options(prior.as_ref());
    if args.payload {
        return payload::run(args, &model, &data, &noise_floor, &options);
    }
    let progress = spinner("fit");
    let fitted = fit_with(&model, &data.datasets, &vec![noise_floor.clone(); data.datasets.len()], &options);
    progress.finish_and_clear();
    let fitted = fitted.map_err(refusal)?;
    warn(&much_is_left(data.channels(), &fitted.residuals.rms, &noise_floor));
    let held_out_rms = match data.held_out[..] {
        [] => None,
        _ => Some(Residuals::new(&fitted.model, &data.held_out).into_diagnostic()?.rms),
    };
    let answer = Answer { fitted, channels: data.channels(), noise_floor, held_out_rms };
    if args.json { say(answer.json(args)) } else { answer.print() }?;
    match &args.output {
        Some(output) => {
            let provenance = provenance("identify", &args.data, &answer.fitted.parameters);
            write(&answer.fitted.model, output, &provenance, args.json)?;
        }
        None if args.json => {}
        None => say("  Nothing written; -o FILE keeps the model")?,
    }
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

/// Writes a fitted model after its answer was printed; reports it unless `quietly`.
pub(crate) fn write(model: &Model, output: &Path, provenance: &Provenance, quietly: bool) -> miette::Result<()> {
    deltatwin_io::model::write_fitted(model, output, provenance)
        .wrap_err_with(|| format!("{}: the fitted model was not written", output.display()))?;
    if quietly { Ok(()) } else { say(format!("  Wrote {}", output.display())) }
}

struct Answer<'a> {
    fitted: Fit,
    channels: &'a [Channel],
    noise_floor: Vec<f64>,
    held_out_rms: Option<Vec<f64>>,
}

impl Answer<'_> {
    fn json(&self, args: &Args) -> Value {
        let mut object = Map::new();
        object.insert("parameters".into(), estimates(&self.fitted.parameters));
        object.insert("base_parameters".into(), base(&self.fitted.base));
        let structure = &self.fitted.structure;
        object.insert("rank".into(), json!(structure.rank));
        object.insert("condition".into(), json!(structure.condition()));
        object.insert("singular_values".into(), json!(structure.singular_values.as_slice()));
        object.insert("unidentified".into(), unidentified(&self.fitted));
        object.insert("channels".into(), channel_names(self.channels));
        insert_channels(&mut object, "rms", self.channels, &self.fitted.residuals.rms);
        match &self.held_out_rms {
            Some(rms) => insert_channels(&mut object, "held_out_rms", self.channels, rms),
            None => drop(object.insert("held_out_rms".into(), Value::Null)),
        }
        insert_channels(&mut object, "noise_floor", self.channels, &self.noise_floor);
        object.insert("min_pseudo_inertia_eigenvalue".into(), json!(min_eigenvalue(&self.fitted.model.bodies)));
        object.insert("pseudo_inertia_eigenvalues".into(), eigenvalues(&self.fitted.model));
        object.insert("consistency".into(), correction(&self.fitted));
        object.insert("model".into(), args.output.as_deref().map_or(Value::Null, path));
        Value::Object(object)
    }

    fn print(&self) -> miette::Result<()> {
        let fitted = &self.fitted;
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
            ("held out", self.held_out_rms.as_deref()),
            ("noise floor", Some(&self.noise_floor[..])),
        ];
        say(format!("\n{}", Table::of_channels(self.channels, &series)))?;
        let structure = &fitted.structure;
        say(format!(
            "\n  {} base parameters, condition number {}",
            structure.rank,
            significant(structure.condition(), 3)
        ))?;
        say(format!("  Smallest pseudo-inertia eigenvalue {:.3e}", min_eigenvalue(&fitted.model.bodies)))?;
        print_correction(fitted)
    }
}

/// Smallest pseudo-inertia eigenvalue of every body with non-zero inertia.
fn eigenvalues(model: &Model) -> Value {
    let real = model.bodies.0.iter().enumerate().filter(|(_, b)| **b != Inertia::ZERO);
    Value::Object(real.map(|(b, inertia)| (body_name(b), json!(inertia.min_eigenvalue()))).collect())
}

/// The consistency correction and the moved parameters; null without a correction.
fn correction(fitted: &Fit) -> Value {
    let Some(c) = fitted.correction else { return Value::Null };
    let one =
        |m: &Moved| json!({"name": m.name, "free": m.free, "value": m.value, "std": m.std, "unit": m.unit.to_string()});
    let moved: Vec<Value> = fitted.moved.iter().map(one).collect();
    json!({"cost": c.cost, "duality_gap": c.gap, "moved": moved})
}

/// Parameters that the data do not determine, with the reason.
fn unidentified(fitted: &Fit) -> Value {
    let one = |u: &Unidentified| json!({"name": u.name, "reason": u.reason.to_string()});
    fitted.unidentified.iter().map(one).collect()
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

fn base(parameters: &[BaseParameter]) -> Value {
    let entry = |b: &BaseParameter| {
        let content =
            json!({"value": b.value, "std": b.std, "unit": b.unit.to_string(), "combination": b.combination()});
        (b.name.clone(), content)
    };
    Value::Object(parameters.iter().map(entry).collect())
}
