//! `deltatwin compare`.

use std::path::PathBuf;

use miette::IntoDiagnostic;
use serde_json::{Map, Value, json};

use crate::command::gate::{guard, json as gate_json};
use crate::data::{Data, DataArgs, positive};
use crate::terminal::{BAD_ANSWER, DONE, Table, channel_names, insert_channels, say, spinner, warn};
use deltatwin::comparison::{Comparison, Finding, compare};
use deltatwin_io::model;

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
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    let model = model::read(&args.model)?;
    let data = Data::read(&args.data, &model)?;
    warn(&data.warnings);
    let gate = guard(&model, &data, &args.data)?;
    let progress = spinner("compare");
    let comparison = compare(&model, &data.datasets, &data.held_out);
    progress.finish_and_clear();
    let comparison = comparison.into_diagnostic()?;
    if args.json {
        let mut object = json(&comparison);
        object.insert("gate".into(), gate_json(&gate));
        say(Value::Object(object))?;
    } else {
        print(&comparison)?;
    }
    let Some(most) = args.fail_above else { return Ok(DONE) };
    match comparison.worst().filter(|(_, ratio)| *ratio > most) {
        Some((channel, ratio)) => {
            warn(&[format!("{channel}: RMS {ratio:.3} times the noise floor, above {most}")]);
            Ok(BAD_ANSWER)
        }
        None => Ok(DONE),
    }
}

fn json(c: &Comparison) -> Map<String, Value> {
    let mut object = Map::new();
    object.insert("channels".into(), channel_names(&c.channels));
    insert_channels(&mut object, "rms", &c.channels, &c.rms);
    insert_channels(&mut object, "noise_floor", &c.channels, &c.noise_floor);
    match &c.held_out_rms {
        Some(rms) => insert_channels(&mut object, "held_out_rms", &c.channels, rms),
        None => drop(object.insert("held_out_rms".into(), Value::Null)),
    }
    let finding = |f: &Finding| {
        json!({
            "axis": f.channel.drive().map(|i| i + 1),
            "channel": f.channel.to_string(),
            "where": f.place,
            "share": f.share,
            "sentence": f.sentence,
        })
    };
    object.insert("findings".into(), c.findings.iter().map(finding).collect());
    object
}

fn print(c: &Comparison) -> miette::Result<()> {
    let series = [
        ("model", Some(&c.rms[..])),
        ("held out", c.held_out_rms.as_deref()),
        ("noise floor", Some(&c.noise_floor[..])),
    ];
    say(Table::of_channels(&c.channels, &series))?;
    if c.findings.is_empty() {
        return say("\n  Nothing stands out.");
    }
    say("")?;
    c.findings.iter().try_for_each(|f| say(format!("  {}", wrapped(&f.sentence))))
}

/// A sentence wrapped to the width of the screen, with further lines indented.
fn wrapped(sentence: &str) -> String {
    const WIDTH: usize = 94;
    let mut text = String::new();
    let mut width = 0;
    for word in sentence.split(' ') {
        let length = word.chars().count();
        if width > 0 && width + 1 + length > WIDTH {
            text.push_str("\n    ");
            width = 2;
        } else if width > 0 {
            text.push(' ');
            width += 1;
        }
        text.push_str(word);
        width += length;
    }
    text
}
