//! `deltatwin forces`.

use std::io::Write;
use std::ops::Range;
use std::path::{Path, PathBuf};

use miette::{IntoDiagnostic, WrapErr, miette};
use rayon::prelude::*;
use serde_json::{Map, Value, json};

use crate::data::Outside;
use crate::terminal::{DONE, Table, assembled_robot, check_output, path, say, spinner, warn, wrapped, write_figure};
use deltatwin::constraint_forces::{Detail, MULTIPLIERS, Multipliers, constraint_forces};
use deltatwin::dynamics::Plant;
use deltatwin::identification::{Dataset, residuals};
use deltatwin::kinematics::JointState;
use deltatwin::kinematics::motion::SOCKETS;
use deltatwin::machine::{STRUTS, Setup};
use deltatwin::model::Model;
use deltatwin::recording::{Channel, Series};
use deltatwin::text::significant;
use deltatwin::twin::Clamps;
use deltatwin_io::kind::{Kind, kind};
use deltatwin_io::{file, recording, scenario};
use deltatwin_report::{Color, Curve, Panel, Style, panels};

/// Compute the constraint forces of a motion.
///
/// The motion is that of a recording (its joint angles, differentiated) or the desired one of a scenario.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Example: deltatwin forces models/irb360-6-1600.toml run.csv --figure forces.svg")]
pub struct Args {
    /// Model file.
    pub model: PathBuf,
    /// Recording (.csv, .mcap) or scenario (.toml).
    #[arg(value_name = "DATA|SCENARIO")]
    pub motion: PathBuf,
    /// Table of all multipliers over time, .csv.
    #[arg(short, long, value_name = "CSV")]
    pub output: Option<PathBuf>,
    /// Figure of the strut forces and the bearing's loads over time, .svg.
    #[arg(long, value_name = "SVG")]
    pub figure: Option<PathBuf>,
    /// Setup of the recording, instead of its sidecar `<stem>.setup.toml`.
    #[arg(long, value_name = "FILE")]
    pub setup: Option<PathBuf>,
    /// Which loads enter: all, or those of the paper's reduced model.
    #[arg(long, value_enum, default_value_t)]
    pub loads: Which,
    #[command(flatten)]
    pub outside: Outside,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Which loads enter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Which {
    /// The paper's reduced model: struts only along their axes, no telescope but the mass of its lower part on the platform.
    Reduced,
    /// All of them.
    #[default]
    Complete,
}

impl From<Which> for Detail {
    fn from(chosen: Which) -> Self {
        match chosen {
            Which::Reduced => Self::Reduced,
            Which::Complete => Self::Complete,
        }
    }
}

/// A motion with the measured strut forces.
struct Motion {
    setup: Setup,
    t: Vec<f64>,
    joints: Vec<JointState>,
    /// Measured strut forces, N.
    measured: Vec<(Channel, Series)>,
}

/// Runs the command; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    let model = assembled_robot(&args.model)?;
    for (output, extension) in [(&args.output, "csv"), (&args.figure, "svg")] {
        if let Some(output) = output {
            check_output(output, &[&args.model, &args.motion], &[extension])?;
        }
    }
    let motion = read(args, &model)?;
    let plant = Plant::new(&model, &motion.setup);
    if !plant.assembled {
        return Err(miette!("{}: is of a disassembled robot; expected an assembled one", args.motion.display()));
    }
    let clamps = Clamps::watched(&model.sockets);
    let progress = spinner("forces");
    let one = |(k, (t, joints)): (usize, (&f64, &JointState))| {
        let pose = plant.motion(joints)?;
        let own = plant.steady_states(*t, &pose);
        let states: Vec<&[f64]> = own.iter().map(Vec::as_slice).collect();
        let forces = constraint_forces(&plant, *t, &pose, &states, args.loads.into()).map_err(|e| e.at_sample(k))?;
        Ok((forces.to_array(), clamps.along(&plant, *t, &pose)?.1))
    };
    let loads: Result<Vec<_>, deltatwin::kinematics::KinematicsError> =
        motion.t.par_iter().zip(&motion.joints).enumerate().map(one).collect();
    progress.finish_and_clear();
    let loads = loads.into_diagnostic().wrap_err_with(|| args.motion.display().to_string())?;
    let (forces, margins): (Vec<_>, Vec<_>) = loads.into_iter().unzip();
    let margins = least(&model, &forces, &margins);
    if let Some(output) = &args.output {
        write_table(output, Multipliers::of(model.mechanism), &motion.t, &forces)?;
    }
    if let Some(figure) = &args.figure {
        write_figure(figure, &draw(&model, &motion, &forces))?;
    }
    if args.json {
        say(to_json(args, &model, &motion, (&forces, &margins)))
    } else {
        print(args, &model, &motion, (&forces, &margins))
    }?;
    Ok(DONE)
}

fn read(args: &Args, model: &Model) -> miette::Result<Motion> {
    let name = || args.motion.display().to_string();
    if kind(&args.motion)? == Kind::Scenario {
        let scenario = scenario::read_with(&args.motion, args.outside.access())?;
        let desired = scenario.motion(model).into_diagnostic().wrap_err_with(name)?;
        let geometry = Plant::new(model, &scenario.setup).geometry;
        let samples = (scenario.duration / model.sample_time).floor() as usize;
        let t: Vec<f64> = (0..=samples).map(|k| k as f64 * model.sample_time).collect();
        let joints: Result<Vec<_>, _> = t.iter().map(|t| desired.at(*t).joints(&geometry)).collect();
        let joints = joints.into_diagnostic().wrap_err_with(name)?;
        return Ok(Motion { setup: scenario.setup, t, joints, measured: vec![] });
    }
    let (recording, warnings) = recording::read_of(&args.motion, args.setup.as_deref(), model.mechanism)?;
    warn(&warnings);
    let dataset = Dataset::new(&recording);
    if dataset.is_empty() {
        return Err(miette!("{}: has too few samples to differentiate", name()));
    }
    let measured =
        dataset.channels.iter().copied().zip(dataset.measured).filter(|(channel, _)| channel.drive().is_none());
    Ok(Motion { setup: dataset.setup, t: dataset.t, joints: dataset.joints, measured: measured.collect() })
}

/// Index of a measured strut force among the multipliers.
fn place(channel: Channel) -> usize {
    let upper = matches!(channel, Channel::StrutUpper(_));
    if upper { 12 + channel.index() } else { 6 + channel.index() }
}

/// Limit of the machine on multiplier `k`: drive torque (N·m), or dislocation force of a socket without pull along its
/// opening (N); `None` without a limit.
fn limit(model: &Model, k: usize) -> Option<f64> {
    match k {
        0..5 => None,
        5 => Some(model.drives[3].max_torque),
        6..18 => Some(model.sockets.dislocation_force),
        _ => Some(model.drives[k - 18].max_torque),
    }
    .filter(|l| *l > 0.0)
}

/// Least margin of every multiplier with a limit, in its unit: of a strut's force the least one of the ball socket at that
/// end, from all loads ([`Clamps::margins`]), else the limit less the largest magnitude.
fn least(model: &Model, forces: &[[f64; MULTIPLIERS]], margins: &[[f64; SOCKETS]]) -> [Option<f64>; MULTIPLIERS] {
    std::array::from_fn(|k| match k {
        6..18 => {
            let socket = if k < 12 { STRUTS + k - 6 } else { k - 12 };
            Some(margins.iter().map(|m| m[socket]).fold(f64::INFINITY, f64::min))
        }
        _ => limit(model, k).map(|l| l - forces.iter().map(|f| f[k].abs()).fold(0.0, f64::max)),
    })
}

/// Smallest, largest and RMS value of multiplier `k`.
fn statistics(forces: &[[f64; MULTIPLIERS]], k: usize) -> [f64; 3] {
    let of = || forces.iter().map(|f| f[k]);
    let rms = (of().map(|f| f * f).sum::<f64>() / forces.len() as f64).sqrt();
    [of().fold(f64::INFINITY, f64::min), of().fold(f64::NEG_INFINITY, f64::max), rms]
}

/// RMS of the difference between measured and computed values, and RMS of the measured ones.
fn difference(measured: &[f64], forces: &[[f64; MULTIPLIERS]], k: usize) -> [f64; 2] {
    let computed: Vec<f64> = forces.iter().map(|f| f[k]).collect();
    [residuals::rms(&residuals::difference(measured, &computed)), residuals::rms(measured)]
}

fn write_table(target: &Path, own: Range<usize>, t: &[f64], forces: &[[f64; MULTIPLIERS]]) -> miette::Result<()> {
    file::replace(target, |out| -> std::io::Result<()> {
        writeln!(out, "t,{}", Multipliers::names()[own.clone()].join(","))?;
        for (t, row) in t.iter().zip(forces) {
            let cells: Vec<String> = row[own.clone()].iter().map(f64::to_string).collect();
            writeln!(out, "{t},{}", cells.join(","))?;
        }
        Ok(())
    })
    .into_diagnostic()
}

fn draw(model: &Model, motion: &Motion, forces: &[[f64; MULTIPLIERS]]) -> deltatwin_report::Figure {
    let series = |k: usize| -> Vec<f64> { forces.iter().map(|f| f[k]).collect() };
    let names = Multipliers::names();
    let line = |k: usize, label: &str| Curve::new(label, motion.t.clone(), series(k));
    let pairs = |first: usize, label: &str| -> Vec<Panel> {
        (0..STRUTS / 2)
            .map(|limb| {
                let curves = [2 * limb, 2 * limb + 1].map(|s| {
                    let which =
                        if s.is_multiple_of(2) { "first strut of the pair" } else { "second strut of the pair" };
                    line(first + s, which)
                });
                let title = format!("{label}, struts {} and {}", 2 * limb + 1, 2 * limb + 2);
                Panel { title, y_label: "N".into(), curves: curves.into() }
            })
            .collect()
    };
    let mut all = pairs(12, "λ_S");
    for (channel, values) in &motion.measured {
        let k = place(*channel);
        let measured = Curve::new("measured", motion.t.clone(), values.to_vec()).color(Color::MEASURED);
        let computed = line(k, "computed").color(Color::MODEL).style(Style::Dashed);
        all.push(Panel {
            title: format!("{channel}, measured and computed"),
            y_label: "N".into(),
            curves: vec![measured, computed],
        });
    }
    let bearing = |range: Range<usize>| range.map(|k| line(k, &names[k])).collect();
    if model.mechanism.has_telescope() {
        all.push(Panel { title: "λ_E, moments".into(), y_label: "N·m".into(), curves: bearing(0..2) });
        all.push(Panel { title: "λ_E, forces".into(), y_label: "N".into(), curves: bearing(2..5) });
    }
    panels("Constraint forces", "t / s", &all)
}

/// Multipliers over time, and the least margin of each.
type Loads<'a> = (&'a [[f64; MULTIPLIERS]], &'a [Option<f64>; MULTIPLIERS]);

fn to_json(args: &Args, model: &Model, motion: &Motion, (forces, margins): Loads) -> Value {
    let names = Multipliers::names();
    let multipliers: Map<String, Value> = Multipliers::of(model.mechanism)
        .map(|k| {
            let [min, max, rms] = statistics(forces, k);
            let (unit, limit) = (Multipliers::unit(model.mechanism, k).to_string(), limit(model, k));
            let entry = json!({
                "min": min, "max": max, "rms": rms, "unit": unit, "limit": limit, "margin": margins[k],
            });
            (names[k].clone(), entry)
        })
        .collect();
    let measured: Map<String, Value> = motion
        .measured
        .iter()
        .map(|(channel, values)| {
            let [rms, size] = difference(values, forces, place(*channel));
            (channel.to_string(), json!({ "rms_difference": rms, "rms_measured": size, "unit": "N" }))
        })
        .collect();
    json!({
        "motion": path(&args.motion),
        "samples": motion.t.len(),
        "multipliers": multipliers,
        "measured": measured,
        "table": args.output.as_deref().map_or(Value::Null, path),
        "figure": args.figure.as_deref().map_or(Value::Null, path),
    })
}

fn print(args: &Args, model: &Model, motion: &Motion, (forces, margins): Loads) -> miette::Result<()> {
    let mut table = Table::new(&["Multiplier", "min", "max", "rms", "limit", "margin", ""], &[6]);
    let names = Multipliers::names();
    for k in Multipliers::of(model.mechanism) {
        let [min, max, rms] = statistics(forces, k);
        let cells = [Some(min), Some(max), Some(rms), limit(model, k), margins[k]];
        let cells = cells.map(|v| v.map_or(String::new(), |v| significant(v, 4)));
        let unit = Multipliers::unit(model.mechanism, k).to_string();
        table.row(std::iter::once(names[k].clone()).chain(cells).chain([unit]));
    }
    say(table)?;
    let law = "The margin of a strut's force is the least one of the ball socket there, whose hold falls with the pull along \
               its opening; all loads count.";
    say(wrapped(law, 2))?;
    say(format!("\n  {} samples over {:.4} s", motion.t.len(), motion.t[motion.t.len() - 1] - motion.t[0]))?;
    for (channel, values) in &motion.measured {
        let [rms, size] = difference(values, forces, place(*channel));
        say(format!(
            "  {channel}: measured {} N RMS, computed differs by {} N RMS",
            significant(size, 4),
            significant(rms, 3)
        ))?;
    }
    for file in args.output.iter().chain(&args.figure) {
        say(format!("  Wrote {}", file.display()))?;
    }
    Ok(())
}
