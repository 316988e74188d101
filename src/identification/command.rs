//! `deltatwin identify`.

use std::path::{Path, PathBuf};

use miette::{IntoDiagnostic, WrapErr};
use serde_json::{Map, Value, json};

use super::consistency::min_eigenvalue;
use super::fit::{channel_rms, residuals};
use super::{BaseParameter, Data, DataArgs, Fit, fit};
use crate::dynamics::Channel;
use crate::identification::trace::noise_floor as floor;
use crate::model::Model;
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
    let noise_floor = floor(&model, &data.traces);
    let progress = spinner("fit");
    let fitted = fit(&model, &data.traces, &vec![noise_floor.clone(); data.traces.len()]);
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
        object.insert("channels".into(), channel_names(self.channels));
        insert_channels(&mut object, "rms", self.channels, &self.fitted.rms);
        match &self.held_out_rms {
            Some(rms) => insert_channels(&mut object, "held_out_rms", self.channels, rms),
            None => drop(object.insert("held_out_rms".into(), Value::Null)),
        }
        insert_channels(&mut object, "noise_floor", self.channels, &self.noise_floor);
        object.insert("min_pseudo_inertia_eigenvalue".into(), json!(min_eigenvalue(&self.fitted.model.bodies)));
        object.insert("model".into(), args.output.as_deref().map_or(Value::Null, path));
        Value::Object(object)
    }

    fn print(&self, args: &Args) -> miette::Result<()> {
        let mut table = Table::new(&["Parameter", "value", "std", "unit"], &[3]);
        for p in self.fitted.parameters.iter().filter(|p| p.std.is_finite()) {
            table.row([p.name.clone(), significant(p.value, 4), significant(p.std, 2), p.unit.into()]);
        }
        say(table)?;
        let together: Vec<&BaseParameter> = self.fitted.base.iter().filter(|b| !b.others.is_empty()).collect();
        if !together.is_empty() {
            let mut table = Table::new(&["Only together", "value", "std", "unit"], &[3]);
            for b in together {
                table.row([b.combination(), significant(b.value, 4), significant(b.std, 2), b.unit.into()]);
            }
            say(format!("\n{table}"))?;
        }
        let series = [
            ("fitted", Some(&self.fitted.rms[..])),
            ("held out", self.held_out_rms.as_deref()),
            ("noise floor", Some(&self.noise_floor[..])),
        ];
        say(format!("\n{}", Table::of_channels(self.channels, &series)))?;
        say(format!("\n  Smallest pseudo-inertia eigenvalue {:.3e}", min_eigenvalue(&self.fitted.model.bodies)))?;
        match &args.output {
            Some(output) => say(format!("  Wrote {}", output.display())),
            None => say("  Nothing written; -o FILE keeps the model"),
        }
    }
}

fn base(parameters: &[BaseParameter]) -> Value {
    let entry = |b: &BaseParameter| {
        let content = json!({"value": b.value, "std": b.std, "unit": b.unit, "combination": b.combination()});
        (b.name.clone(), content)
    };
    Value::Object(parameters.iter().map(entry).collect())
}
