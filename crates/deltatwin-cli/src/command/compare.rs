//! `deltatwin compare`.

use std::path::PathBuf;

use miette::IntoDiagnostic;
use serde_json::{Map, Value, json};

use crate::command::gate::{guard, json as gate_json};
use crate::data::{Data, DataArgs, positive};
use crate::terminal::{BAD_ANSWER, DONE, Table, channel_names, check_output, insert_channels, say, spinner, warn};
use deltatwin::comparison::{Comparison, Finding, compare};
use deltatwin::dynamics::Channel;
use deltatwin::model::Model;
use deltatwin::text::significant;
use deltatwin_io::model;
use deltatwin_report::Report;
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
    #[arg(long, value_name = "MODEL2", requires = "report")]
    pub beside: Option<PathBuf>,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    let model = model::read(&args.model)?;
    if let Some(page) = &args.report {
        let mut inputs = Data::inputs(&args.data);
        inputs.push(&args.model);
        inputs.extend(args.beside.as_deref());
        check_output(page, &inputs, &["html"])?;
    }
    let beside = args.beside.as_deref().map(model::read).transpose()?;
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
    if let Some(page) = &args.report {
        report(&comparison, (&model, beside.as_ref()), &data, args)?.write(page).into_diagnostic()?;
        if !args.json {
            say(format!("  Wrote {}", page.display()))?;
        }
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

/// Page of a comparison: errors, where the model fails, and pictures of the last recording, a held-out one if there is
/// any.
fn report(
    c: &Comparison,
    (model, beside): (&Model, Option<&Model>),
    data: &Data,
    args: &Args,
) -> miette::Result<Report> {
    let mut page = Report::new("deltatwin compare", format!("{} and what was measured", args.model.display()));
    let number = |x: f64| significant(x, 4);
    let row = |(i, channel): (usize, &Channel)| {
        let held_out = c.held_out_rms.as_ref().map_or("–".into(), |rms| number(rms[i]));
        vec![format!("{channel} / {}", channel.unit()), number(c.rms[i]), held_out, number(c.noise_floor[i])]
    };
    let rows: Vec<Vec<String>> = c.channels.iter().enumerate().map(row).collect();
    page.table(&["RMS", "model", "held out", "noise floor"], &rows);
    page.heading("Where the model fails");
    if c.findings.is_empty() {
        page.paragraph("Nothing stands out.");
    }
    for finding in &c.findings {
        page.paragraph(&finding.sentence);
    }
    let mut stages = vec![Stage { name: "model", model }];
    let file = args.beside.as_ref().map(|path| path.display().to_string()).unwrap_or_default();
    stages.extend(beside.map(|model| Stage { name: &file, model }));
    if let Some(dataset) = data.held_out.last().or(data.datasets.last()) {
        page.heading(&format!("Pictures of {}", dataset.name));
        for (figure, caption) in residual::figures(&stages, dataset, &c.noise_floor).into_diagnostic()? {
            page.figure(&figure, &caption);
        }
    }
    Ok(page)
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
