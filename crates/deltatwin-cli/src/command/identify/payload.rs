//! `deltatwin identify --payload`.

use miette::{IntoDiagnostic, miette};
use serde_json::{Map, Value, json};

use super::{Args, print_correction, print_unidentified, refusal};
use crate::data::Data;
use crate::terminal::{DONE, Table, estimates, insert_channels, path, say, spinner};
use deltatwin::identification::fit::Options;
use deltatwin::identification::{NoiseLevel, PayloadFit, identify_payload};
use deltatwin::machine::Setup;
use deltatwin::model::Model;
use deltatwin::text::significant;
use deltatwin_analysis::identify::{correction, unidentified};
use deltatwin_io::recording::setup;

/// Identifies the payload and writes a setup with it; returns the exit status.
pub fn run(args: &Args, model: &Model, data: &Data, noise: NoiseLevel, options: &Options) -> miette::Result<u8> {
    let progress = spinner("fit");
    let found = identify_payload(model, &data.datasets, &noise.of_each, options);
    progress.finish_and_clear();
    let found = found.map_err(refusal)?;
    let setup = Setup { payload: found.payload, ..data.datasets[0].setup };
    // A setup must not state an impossible payload: the recording was of an empty flange, or of another robot.
    let readable = setup::from_toml(&setup::to_toml(&setup), "the payload found");
    if args.json {
        say(json(args, data, &noise.pooled, &found))?;
    } else {
        print(data, &noise.pooled, &found)?;
        say(format!("\n{}", setup::to_toml(&setup)))?;
    }
    readable.map_err(|e| {
        let what = format!("{} as a setup states it: {e}", data.datasets[0].name);
        miette!("{what}; is something at the flange, and is the empty robot identified?")
    })?;
    match &args.output {
        Some(output) => {
            setup::write(&setup, output).into_diagnostic()?;
            if !args.json {
                say(format!("  Wrote {}", output.display()))?;
            }
        }
        None if args.json => {}
        None => say("  Nothing written; -o FILE keeps the setup")?,
    }
    Ok(DONE)
}

fn json(args: &Args, data: &Data, noise_floor: &[f64], found: &PayloadFit) -> Value {
    let p = &found.payload;
    let mut object = Map::new();
    object.insert("parameters".into(), estimates(&found.parameters));
    let payload =
        json!({"mass": p.mass, "com": p.com.as_slice(), "inertia_zz": p.inertia_zz(), "inertia": p.moments()});
    object.insert("payload".into(), payload);
    object.insert("unidentified".into(), unidentified(&found.fit));
    object.insert("consistency".into(), correction(&found.fit));
    insert_channels(&mut object, "rms", data.channels(), &found.fit.residuals.rms);
    insert_channels(&mut object, "noise_floor", data.channels(), noise_floor);
    object.insert("setup".into(), args.output.as_deref().map_or(Value::Null, path));
    Value::Object(object)
}

fn print(data: &Data, noise_floor: &[f64], found: &PayloadFit) -> miette::Result<()> {
    let mut table = Table::new(&["Parameter", "value", "std", "unit"], &[3]);
    for p in found.parameters.iter().filter(|p| p.identified()) {
        table.row([p.name.clone(), significant(p.value, 4), significant(p.std, 2), p.unit.to_string()]);
    }
    say(table)?;
    print_unidentified(&found.fit)?;
    let series = [("fitted", Some(&found.fit.residuals.rms[..])), ("noise floor", Some(noise_floor))];
    say(format!("\n{}", Table::of_channels(data.mechanism(), data.channels(), &series)))?;
    print_correction(&found.fit)
}
