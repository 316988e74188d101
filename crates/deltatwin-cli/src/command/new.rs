//! `deltatwin new`: a first model from recordings alone.

use std::path::{Path, PathBuf};

use clap::Subcommand;
use deltatwin::identification::initial::{self, Initial, Number};
use deltatwin::machine::{Axis, Effort, Joint, Mechanism, Unit};
use deltatwin::model::Model;
use deltatwin::recording::Recording;
use deltatwin::text::significant;
use deltatwin_io::model::shipped::{CLAVEL_DELTA, IRB_360_6_1600};
use deltatwin_io::model::{self, Note};
use deltatwin_io::recording::{self, Mapping, Reading};
use miette::{IntoDiagnostic, miette};
use serde_json::{Value, json};

use crate::data::positive;
use crate::kind::alone;
use crate::terminal::{DONE, Table, check_output, command, path, say, spinner, today, warn, wrapped};

/// Models that a delta robot's is started from: with a telescope, and without.
const TEMPLATES: [&str; 2] = [IRB_360_6_1600, CLAVEL_DELTA];

/// Write a first model from recordings alone.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Example: deltatwin new axis run.csv -o axis.toml")]
pub struct Args {
    #[command(subcommand)]
    machine: Machine,
}

#[derive(Subcommand, Clone, Debug)]
enum Machine {
    /// A single axis, sliding or turning: sampling, encoder, travel, limits, noise, inertia, friction and gravity.
    #[command(after_help = "Example: deltatwin new axis run.csv -o axis.toml")]
    Axis(AxisArgs),
    /// A delta robot: a template, with sampling, encoder, travel, noise and friction from the recordings.
    #[command(after_help = "Example: deltatwin new delta run.csv -o delta.toml")]
    Delta(DeltaArgs),
}

/// What both kinds take.
#[derive(clap::Args, Clone, Debug)]
struct Common {
    /// Recordings: tables of numbers or ROS 2 bags.
    #[arg(required = true, value_name = "DATA")]
    data: Vec<PathBuf>,
    /// Model file to write.
    #[arg(short, long, value_name = "MODEL")]
    output: PathBuf,
    /// Replace the output if it exists.
    #[arg(long)]
    force: bool,
    /// Setup of all recordings, instead of their sidecars.
    #[arg(long, value_name = "FILE")]
    setup: Option<PathBuf>,
    /// Which column is which channel, such as "t=Time[ms], q1=ActPos[deg], tau1=Iq[A]*0.12".
    #[arg(long, value_name = "MAP")]
    map: Vec<Mapping>,
    /// Samples per second, for a file without a column of time.
    #[arg(long, value_name = "HZ", value_parser = positive)]
    rate: Option<f64>,
    /// One JSON object on stdout.
    #[arg(long)]
    json: bool,
}

#[derive(clap::Args, Clone, Debug)]
struct AxisArgs {
    #[command(flatten)]
    common: Common,
    /// `revolute` or `prismatic`, where units and names do not tell; or, of several joints, the name or number of the one
    /// to read. May be given twice.
    #[arg(long, value_name = "KIND|NAME")]
    joint: Vec<String>,
    /// Motor turns per turn of the joint, or rad of the motor per metre; the recording is that of the joint.
    #[arg(long, value_name = "N", value_parser = positive)]
    gear_ratio: Option<f64>,
    /// The recording is that of the motor: the angle is divided by --gear-ratio, the torque multiplied.
    #[arg(long, requires = "gear_ratio")]
    motor_side: bool,
}

#[derive(clap::Args, Clone, Debug)]
struct DeltaArgs {
    #[command(flatten)]
    common: Common,
    /// Model to start from: its geometry, bodies and gear ratios are kept. Without it, the shipped robot with as many
    /// axes.
    #[arg(long, value_name = "MODEL")]
    like: Option<PathBuf>,
}

/// Runs the command; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    match &args.machine {
        Machine::Axis(args) => axis(args),
        Machine::Delta(args) => delta(args),
    }
}

fn axis(args: &AxisArgs) -> miette::Result<u8> {
    let common = &args.common;
    common.check(&[])?;
    let kind = |text: &String| match text.as_str() {
        "revolute" => Some(Joint::Revolute),
        "prismatic" => Some(Joint::Prismatic),
        _ => None,
    };
    let (kinds, names): (Vec<&String>, Vec<&String>) = args.joint.iter().partition(|j| kind(j).is_some());
    if kinds.len() > 1 || names.len() > 1 {
        return Err(miette!("--joint {}: expected at most one kind and one name", args.joint.join(" --joint ")));
    }
    let joint = kinds.first().and_then(|k| kind(k));
    let mut how = common.reading(None);
    how.joint = names.first().map(|n| n.as_str());
    how.gear_ratio = args.gear_ratio.filter(|_| args.motor_side);
    let (recordings, warnings) = common.read(&how, joint)?;
    let mechanism = recordings[0].signals.mechanism;
    if !matches!(mechanism, Mechanism::Axis(_)) {
        let (file, axes) = (common.data[0].display(), mechanism.axes());
        return Err(miette!(
            "{file}: has {axes} axes; expected one: --joint 2 reads axis 2 alone, `deltatwin new delta` all of them"
        ));
    }
    let progress = spinner("estimate");
    let found = initial::axis(&common.name(), &recordings, args.gear_ratio);
    progress.finish_and_clear();
    let mut found = found.into_diagnostic()?;
    found.remarks.insert(0, kind_of(mechanism, joint.is_some()));
    let mut columns: Vec<String> = names.iter().flat_map(|n| ["--joint".to_string(), n.to_string()]).collect();
    columns.extend(how.gear_ratio.iter().flat_map(|n| ["--gear-ratio".to_string(), n.to_string()]));
    common.finish(&found, &warnings, "", columns)
}

/// The kind of axis in a sentence.
fn kind_of(mechanism: Mechanism, stated: bool) -> String {
    let (name, other) = match mechanism.joint() {
        Joint::Revolute => ("revolute", "prismatic"),
        Joint::Prismatic => ("prismatic", "revolute"),
    };
    let why = if stated {
        "as --joint says".into()
    } else {
        format!("by its units and names; --joint {other} says otherwise")
    };
    let (q, tau) = (mechanism.unit(Unit::Rad), mechanism.unit(Unit::NM));
    let constant = match mechanism.effort() {
        Effort::Current => "; the current stands for the torque: everything is per torque constant",
        Effort::Force => "",
    };
    format!("A {name} axis in {q} and {tau}, {why}{constant}.")
}

fn delta(args: &DeltaArgs) -> miette::Result<u8> {
    let common = &args.common;
    let like: Vec<&Path> = args.like.iter().map(PathBuf::as_path).collect();
    common.check(&like)?;
    let chosen = args.like.as_deref().map(model::read).transpose()?;
    let how = common.reading(chosen.as_ref().map(|m| m.mechanism));
    let (recordings, warnings) = common.read(&how, None)?;
    let mechanism = recordings[0].signals.mechanism;
    let template = match (chosen, mechanism) {
        (Some(model), _) => model,
        (None, Mechanism::Delta { telescope, .. }) => shipped(telescope)?,
        (None, Mechanism::Axis(_)) => {
            return Err(miette!("{}: has one axis; `deltatwin new axis` makes its model", common.data[0].display()));
        }
    };
    let progress = spinner("estimate");
    let found = initial::delta(&template, &recordings);
    progress.finish_and_clear();
    let mut found = found.into_diagnostic()?;
    let from = template.name.clone();
    found.model.name = common.name();
    found.remarks.insert(
        0,
        format!(
            "From the template {from}: geometry, masses, gear ratios, sockets, limits of acceleration and jerk. Torques do \
             not tell the geometry: put your machine's into [geometry], then `identify` fits the masses."
        ),
    );
    let original = template.source.as_deref().unwrap_or("").to_string();
    common.finish(&found, &warnings, &original, Vec::new())
}

fn shipped(telescope: bool) -> miette::Result<Model> {
    let (text, name) =
        if telescope { (TEMPLATES[0], "irb360-6-1600.toml") } else { (TEMPLATES[1], "clavel-delta.toml") };
    model::parse(text, Path::new(name))
}

impl Common {
    /// Checks the output before anything is read.
    fn check(&self, others: &[&Path]) -> miette::Result<()> {
        let inputs: Vec<&Path> =
            self.data.iter().chain(&self.setup).map(PathBuf::as_path).chain(others.iter().copied()).collect();
        check_output(&self.output, &inputs, &["toml"])?;
        if self.output.exists() && !self.force {
            return Err(miette!("{} exists; expected another name, or --force to replace it", self.output.display()));
        }
        Ok(())
    }

    fn reading(&self, machine: Option<Mechanism>) -> Reading<'_> {
        Reading { setup: self.setup.as_deref(), machine, maps: &self.map, rate: self.rate, ..Reading::default() }
    }

    /// Name of the model.
    fn name(&self) -> String {
        self.output.file_stem().unwrap_or_default().to_string_lossy().into_owned()
    }

    /// All recordings, of one machine; its `joint` overrides what units and names tell.
    fn read(&self, how: &Reading, joint: Option<Joint>) -> miette::Result<(Vec<Recording>, Vec<String>)> {
        let mut how = *how;
        let (mut first, mut warnings) = recording::read_as(&self.data[0], &how)?;
        if let (Some(joint), Mechanism::Axis(axis)) = (joint, first.signals.mechanism)
            && axis.joint != joint
        {
            how.machine = Some(Mechanism::Axis(Axis { joint, ..axis }));
            (first, warnings) = recording::read_as(&self.data[0], &how)?;
        }
        how.machine = Some(first.signals.mechanism);
        warnings.extend(alone(&self.data[0], &first));
        let mut all = vec![first];
        for file in &self.data[1..] {
            let (recording, more) = recording::read_as(file, &how)?;
            warnings.extend(more);
            warnings.extend(alone(file, &recording));
            all.push(recording);
        }
        Ok((all, warnings))
    }

    /// Writes the model and prints how its numbers were found.
    ///
    /// `original` is the text of the template, `columns` the options with which the data were read besides the common
    /// ones.
    fn finish(
        &self,
        found: &Initial,
        warnings: &[String],
        original: &str,
        mut columns: Vec<String>,
    ) -> miette::Result<u8> {
        warn(warnings);
        let what = if matches!(found.model.mechanism, Mechanism::Axis(_)) { "new axis" } else { "new delta" };
        columns.extend(self.columns());
        let files: Vec<String> = self.data.iter().map(|f| file_name(f)).collect();
        let files = files.join(", ");
        let notes: Vec<Note> = found.numbers.iter().map(|n| note(n, &files)).collect();
        let mut heading = vec![
            format!("{}: a first model from {files}, made by `deltatwin {what}` on {}.", found.model.name, today()),
            "Numbers with \"from\" are those of the recordings, ± is one standard error; limits of drives are no ratings.".into(),
        ];
        if found.model.mechanism.effort() == Effort::Current {
            heading.push("In ampere: torque, friction and inertia are divided by the unknown torque constant.".into());
        }
        if !original.is_empty() {
            heading.push("All other numbers are those of the template, whose comments follow.".into());
        }
        model::write_noted(&found.model, &self.output, original, &notes, &heading)?;
        if self.json {
            say(json!({
                "model": path(&self.output),
                "numbers": found.numbers.iter().map(entry).collect::<Vec<Value>>(),
                "remarks": found.remarks,
                "warnings": warnings,
            }))?;
            return Ok(DONE);
        }
        let mut table = Table::new(&["Number", "value", "±", "unit", "found"], &[3, 4]);
        for n in &found.numbers {
            let texts = |values: &[f64], digits| values.iter().map(|v| significant(*v, digits)).collect::<Vec<_>>();
            let values = if n.unit == Unit::Bit { texts(&n.values, 2) } else { texts(&n.values, 4) };
            table.row([
                n.key.to_string(),
                values.join(" "),
                texts(&n.std, 2).join(" "),
                n.unit.to_string(),
                n.how.clone(),
            ]);
        }
        say(table)?;
        say("")?;
        found.remarks.iter().try_for_each(|r| say(wrapped(r, 2)))?;
        say(format!("\n  Wrote {}\n  next:", self.output.display()))?;
        let data: Vec<String> = self.data.iter().map(|f| f.display().to_string()).collect();
        for words in self.next(&data, &columns) {
            say(command(&words, 4))?;
        }
        Ok(DONE)
    }

    /// Commands that make use of the model.
    fn next(&self, data: &[String], columns: &[String]) -> Vec<Vec<String>> {
        let model = self.output.display().to_string();
        let better = self.output.with_extension("identified.toml").display().to_string();
        let words = |parts: &[&str]| parts.iter().map(|p| p.to_string()).collect::<Vec<_>>();
        let with_data = |before: &[&str], after: &[&str]| {
            let mut all = words(before);
            all.extend(data.iter().cloned());
            all.extend(words(after));
            all.extend(columns.iter().cloned());
            all
        };
        vec![
            with_data(&["deltatwin", "check"], &["--model", &model]),
            with_data(&["deltatwin", "identify", &model], &["-o", &better]),
            with_data(&["deltatwin", "diagnose", &better], &[]),
        ]
    }

    /// Options with which the data were read.
    fn columns(&self) -> Vec<String> {
        let maps = self.map.iter().flat_map(|m| ["--map".to_string(), m.to_string()]);
        maps.chain(self.rate.iter().flat_map(|r| ["--rate".to_string(), r.to_string()])).collect()
    }
}

fn file_name(file: &Path) -> String {
    file.file_name().map_or_else(|| file.display().to_string(), |n| n.to_string_lossy().into_owned())
}

/// Comment on a number in the model file.
fn note(n: &Number, files: &str) -> Note {
    let std: Vec<String> = n.std.iter().map(|s| format!("±{}", significant(*s, 2))).collect();
    let origin = if n.key == "gear_ratio" { n.how.clone() } else { format!("from {files}: {}", n.how) };
    let error = if std.is_empty() { String::new() } else { format!(", {}", std.join(" ")) };
    Note { table: n.table.into(), key: n.key.into(), text: origin + &error }
}

fn entry(n: &Number) -> Value {
    json!({"table": n.table, "key": n.key, "values": n.values, "std": n.std, "unit": n.unit.to_string(), "how": n.how})
}
