//! `deltatwin identify`.

use std::path::{Path, PathBuf};

use miette::{IntoDiagnostic, WrapErr, miette};
use serde_json::{Map, Value, json};

use super::consistency::min_eigenvalue;
use super::estimator::PRIOR_INFORMATION;
use super::fit::{Consistency, Correction, Options, Weighing, channel_rms, residuals};
use super::{BaseParameter, Data, DataArgs, Fit, fit_with, identify_payload};
use crate::dynamics::{Channel, Plant};
use crate::identification::trace::noise_floor as floor;
use crate::model::Model;
use crate::model::bodies::{Inertia, body_name};
use crate::recording::Setup;
use crate::terminal::{
    DONE, Table, channel_names, check_output, estimates, insert_channels, path, say, significant, spinner, warn,
};

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

/// How to fit.
#[derive(clap::Args, Clone, Debug)]
pub struct How {
    /// What the rows of the regression are weighed with.
    #[arg(long, value_enum, default_value_t = Weighing::Noise)]
    weighing: Weighing,
    /// Let outliers count less (Huber's loss).
    #[arg(long)]
    robust: bool,
    /// Way to physically consistent parameters; both lead to the same ones, and each checks the other.
    #[arg(long, value_enum, default_value_t = Consistency::LogCholesky)]
    method: Consistency,
    /// Model whose parameters are the regularisation values, instead of MODEL itself.
    #[arg(long, value_name = "MODEL")]
    prior: Option<PathBuf>,
    /// Weight of the regularisation: information per parameter, in units of its own size; 1 trusts the prior as much as a
    /// measurement of the parameter with 100 % error.
    #[arg(long, value_name = "GAMMA", default_value_t = PRIOR_INFORMATION, value_parser = positive)]
    regularisation: f64,
    /// Effect whose parameters stay as they are (`rigid_bodies` for the links); may be given several times.
    #[arg(long, value_name = "EFFECT")]
    hold: Vec<String>,
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x > 0.0 && x.is_finite() => Ok(x),
        _ => Err("expected a number above 0".into()),
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
    let data = Data::read(&args.data, &model)?;
    warn(&data.warnings);
    let noise_floor = floor(&model, &data.traces);
    let prior = args.how.prior.as_deref().map(Model::read).transpose()?;
    for name in &args.how.hold {
        if !Plant::new(&model, &data.traces[0].setup).parameters().iter().any(|p| p.effect == name) {
            return Err(miette!("--hold {name}: the model has no such effect"));
        }
    }
    let options = Options {
        weighing: args.how.weighing,
        robust: args.how.robust,
        consistency: args.how.method,
        prior: prior.as_ref(),
        prior_information: Some(args.how.regularisation),
        held: &args.how.hold,
        stop: None,
    };
    if args.payload {
        return payload(args, &model, &data, &noise_floor, &options);
    }
    let progress = spinner("fit");
    let fitted = fit_with(&model, &data.traces, &vec![noise_floor.clone(); data.traces.len()], &options);
    progress.finish_and_clear();
    let fitted = fitted.into_diagnostic()?;
    let held_out_rms = match data.held_out[..] {
        [] => None,
        _ => Some(channel_rms(&residuals(&fitted.model, &data.held_out).into_diagnostic()?)),
    };
    if let Some(output) = &args.output {
        write(&fitted.model, output)?;
    }
    let answer = Answer { fitted, channels: data.channels(), noise_floor, held_out_rms };
    if args.json { say(answer.json(args)) } else { answer.print(args) }?;
    Ok(DONE)
}

/// Writes a fitted model.
pub(crate) fn write(model: &Model, output: &Path) -> miette::Result<()> {
    model
        .write(output)
        .wrap_err_with(|| format!("{}: the data lead to a model that no machine can have", output.display()))
}

/// Identifies the payload and writes the setup that states it.
fn payload(args: &Args, model: &Model, data: &Data, noise_floor: &[f64], options: &Options) -> miette::Result<u8> {
    let weights = vec![noise_floor.to_vec(); data.traces.len()];
    let progress = spinner("fit");
    let found = identify_payload(model, &data.traces, &weights, options);
    progress.finish_and_clear();
    let found = found.into_diagnostic()?;
    let setup = Setup { payload: found.payload, ..data.traces[0].setup };
    if let Some(output) = &args.output {
        setup.write(output).into_diagnostic()?;
    }
    let p = &found.payload;
    if args.json {
        let mut object = Map::new();
        object.insert("parameters".into(), estimates(&found.parameters));
        let payload = json!({"mass": p.mass, "com": p.com.as_slice(), "inertia_zz": p.inertia_zz});
        object.insert("payload".into(), payload);
        insert_channels(&mut object, "rms", data.channels(), &found.fit.rms);
        insert_channels(&mut object, "noise_floor", data.channels(), noise_floor);
        object.insert("setup".into(), args.output.as_deref().map_or(Value::Null, path));
        say(Value::Object(object))?;
        return Ok(DONE);
    }
    let mut table = Table::new(&["Parameter", "value", "std", "unit"], &[3]);
    for p in found.parameters.iter().filter(|p| p.identified()) {
        table.row([p.name.clone(), significant(p.value, 4), significant(p.std, 2), p.unit.into()]);
    }
    say(table)?;
    let series = [("fitted", Some(&found.fit.rms[..])), ("noise floor", Some(noise_floor))];
    say(format!("\n{}", Table::of_channels(data.channels(), &series)))?;
    say(format!("\n{}", setup.to_toml()))?;
    match &args.output {
        Some(output) => say(format!("  Wrote {}", output.display()))?,
        None => say("  Nothing written; -o FILE keeps the setup")?,
    }
    Ok(DONE)
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
        let unidentified = self.fitted.unidentified.iter();
        let unidentified: Vec<Value> =
            unidentified.map(|u| json!({"name": u.name, "reason": u.reason.to_string()})).collect();
        object.insert("unidentified".into(), json!(unidentified));
        object.insert("channels".into(), channel_names(self.channels));
        insert_channels(&mut object, "rms", self.channels, &self.fitted.rms);
        match &self.held_out_rms {
            Some(rms) => insert_channels(&mut object, "held_out_rms", self.channels, rms),
            None => drop(object.insert("held_out_rms".into(), Value::Null)),
        }
        insert_channels(&mut object, "noise_floor", self.channels, &self.noise_floor);
        object.insert("min_pseudo_inertia_eigenvalue".into(), json!(min_eigenvalue(&self.fitted.model.bodies)));
        object.insert("pseudo_inertia_eigenvalues".into(), eigenvalues(&self.fitted.model));
        object.insert("consistency".into(), self.fitted.correction.map_or(Value::Null, |c| correction(&c)));
        object.insert("model".into(), args.output.as_deref().map_or(Value::Null, path));
        Value::Object(object)
    }

    fn print(&self, args: &Args) -> miette::Result<()> {
        let fitted = &self.fitted;
        let mut table = Table::new(&["Parameter", "value", "std", "unit"], &[3]);
        for p in fitted.parameters.iter().filter(|p| p.identified()) {
            table.row([p.name.clone(), significant(p.value, 4), significant(p.std, 2), p.unit.into()]);
        }
        say(table)?;
        let together: Vec<&BaseParameter> = fitted.base.iter().filter(|b| !b.others.is_empty()).collect();
        if !together.is_empty() {
            let mut table = Table::new(&["Only together", "value", "std", "unit"], &[3]);
            for b in together {
                table.row([b.combination(), significant(b.value, 4), significant(b.std, 2), b.unit.into()]);
            }
            say(format!("\n{table}"))?;
        }
        if !fitted.unidentified.is_empty() {
            let mut table = Table::new(&["Not identified", "because"], &[1]);
            for u in &fitted.unidentified {
                table.row([u.name.clone(), u.reason.to_string()]);
            }
            say(format!("\n{table}"))?;
        }
        let series = [
            ("fitted", Some(&fitted.rms[..])),
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
        if let Some(c) = fitted.correction {
            say(format!(
                "  The free estimate was no possible machine: consistency costs {} in ½Σr²/σ²; log-Cholesky and convex \
                 programme agree to {:.1e} of that, proven to {:.1e}",
                significant(c.cost, 3),
                c.disagreement.abs(),
                c.gap
            ))?;
        }
        match &args.output {
            Some(output) => say(format!("  Wrote {}", output.display())),
            None => say("  Nothing written; -o FILE keeps the model"),
        }
    }
}

/// Smallest pseudo-inertia eigenvalue of every body that has inertia.
fn eigenvalues(model: &Model) -> Value {
    let real = model.bodies.0.iter().enumerate().filter(|(_, b)| **b != Inertia::ZERO);
    Value::Object(real.map(|(b, inertia)| (body_name(b), json!(inertia.min_eigenvalue()))).collect())
}

fn correction(c: &Correction) -> Value {
    json!({"cost": c.cost, "disagreement": c.disagreement, "duality_gap": c.gap})
}

fn base(parameters: &[BaseParameter]) -> Value {
    let entry = |b: &BaseParameter| {
        let content = json!({"value": b.value, "std": b.std, "unit": b.unit, "combination": b.combination()});
        (b.name.clone(), content)
    };
    Value::Object(parameters.iter().map(entry).collect())
}
