//! `deltatwin forces`.

use std::io::Write;
use std::ops::Range;
use std::path::{Path, PathBuf};

use miette::{IntoDiagnostic, WrapErr, miette};
use rayon::prelude::*;
use serde_json::{Map, Value, json};

use crate::data::Outside;
use crate::terminal::{DONE, Table, assembled_robot, check_output, path, say, spinner, warn, wrapped, write_figure};
use deltatwin::constraint_forces::{Detail, Multipliers, constraint_forces};
use deltatwin::dynamics::{Plant, inverse_dynamics};
use deltatwin::identification::{Dataset, residuals};
use deltatwin::kinematics::JointState;
use deltatwin::machine::{PerSocket, Setup, Unit};
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
    if args.loads == Which::Reduced && !plant.is_closed_delta() {
        return Err(miette!("--loads reduced: the paper's reduced model is of three limbs and one platform"));
    }
    let rows = rows(&model);
    let progress = spinner("forces");
    let (forces, margins) = compute(args, &model, &plant, &motion)?;
    progress.finish_and_clear();
    let loads =
        Loads { rows: &rows, forces: &forces, margins: &least(&rows, &forces, &margins, model.mechanism.struts()) };
    if let Some(output) = &args.output {
        write_table(output, &loads, &motion.t)?;
    }
    if let Some(figure) = &args.figure {
        write_figure(figure, &draw(&model, &motion, &loads))?;
    }
    if args.json { say(to_json(args, &motion, &loads)) } else { print(args, &plant, &motion, &loads) }?;
    Ok(DONE)
}

/// Forces in the order of [`rows`] and margins of the sockets, at every instant; no margins on relatives of the delta robot.
fn compute(
    args: &Args,
    model: &Model,
    plant: &Plant,
    motion: &Motion,
) -> miette::Result<(Vec<Vec<f64>>, Vec<Margins>)> {
    let clamps = Clamps::watched(&model.sockets);
    let one = |(k, (t, joints)): (usize, (&f64, &JointState))| {
        let pose = plant.motion(joints)?;
        let own = plant.steady_states(*t, &pose);
        let states: Vec<&[f64]> = own.iter().map(Vec::as_slice).collect();
        if !plant.is_closed_delta() {
            let out = inverse_dynamics(plant, *t, &pose, &states, true).map_err(|e| e.at_sample(k))?;
            let struts = plant.mechanism.struts();
            let (upper, lower) = (&out.reactions.upper[..struts], &out.reactions.lower[..struts]);
            let own = [lower, upper, &out.tau[..plant.mechanism.axes()]].concat();
            return Ok((own, clamps.along(plant, *t, &pose)?.1));
        }
        let forces = constraint_forces(plant, *t, &pose, &states, args.loads.into()).map_err(|e| e.at_sample(k))?;
        let own = forces.to_array()[Multipliers::of(plant.mechanism)].to_vec();
        Ok((own, clamps.along(plant, *t, &pose)?.1))
    };
    let loads: Result<Vec<_>, deltatwin::kinematics::KinematicsError> =
        motion.t.par_iter().zip(&motion.joints).enumerate().map(one).collect();
    let loads = loads.into_diagnostic().wrap_err_with(|| args.motion.display().to_string())?;
    Ok(loads.into_iter().unzip())
}

/// Margins of all sockets at one instant, N.
type Margins = PerSocket<f64>;

/// One multiplier.
struct Row {
    name: String,
    unit: String,
    /// Limit of the machine: drive torque (N·m), or dislocation force of a socket without pull along its opening (N).
    limit: Option<f64>,
    /// Strut force as which it may be measured.
    channel: Option<Channel>,
}

/// Multipliers of an assembled machine in order: the load of the end effector, where there is a telescope, axial forces of
/// the struts at the plate and at the elbows, and torques of the drives.
fn rows(model: &Model) -> Vec<Row> {
    let (mechanism, drives) = (model.mechanism, &model.drives);
    let row = |name: String, unit: Unit, limit: f64| Row {
        name,
        unit: unit.to_string(),
        limit: Some(limit).filter(|l| *l > 0.0),
        channel: None,
    };
    let names = Multipliers::names();
    let bearing = (0..if mechanism.has_telescope() { 6 } else { 0 }).map(|k| {
        let limit = if k == 5 { drives[3].max_torque } else { 0.0 };
        row(names[k].clone(), Multipliers::unit(mechanism, k), limit)
    });
    let hold = model.sockets.dislocation_force;
    let struts = |letter: char, of: fn(usize) -> Channel| {
        (0..mechanism.struts()).map(move |s| {
            let own = row(format!("lambda_{letter}{}", s + 1), Unit::N, hold);
            Row { channel: Some(of(s)), ..own }
        })
    };
    let arms = (0..mechanism.arms())
        .map(|i| row(format!("lambda_a{}", i + 1), mechanism.unit(Unit::NM), drives[i].max_torque));
    bearing.chain(struts('p', Channel::StrutLower)).chain(struts('s', Channel::StrutUpper)).chain(arms).collect()
}

/// Multipliers over time, and the least margin of each.
struct Loads<'a> {
    rows: &'a [Row],
    forces: &'a [Vec<f64>],
    margins: &'a [Option<f64>],
}

impl Loads<'_> {
    /// Index of the row of a measured strut force.
    fn place(&self, channel: Channel) -> Option<usize> {
        self.rows.iter().position(|row| row.channel == Some(channel))
    }

    /// Row `k` over time.
    fn series(&self, k: usize) -> Vec<f64> {
        self.forces.iter().map(|f| f[k]).collect()
    }

    /// Smallest, largest and RMS value of row `k`.
    fn statistics(&self, k: usize) -> [f64; 3] {
        let of = || self.forces.iter().map(|f| f[k]);
        let rms = (of().map(|f| f * f).sum::<f64>() / self.forces.len() as f64).sqrt();
        [of().fold(f64::INFINITY, f64::min), of().fold(f64::NEG_INFINITY, f64::max), rms]
    }

    /// RMS of the difference between measured and computed values, and RMS of the measured ones.
    fn difference(&self, measured: &[f64], k: usize) -> [f64; 2] {
        [residuals::rms(&residuals::difference(measured, &self.series(k))), residuals::rms(measured)]
    }
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

/// Least margin of every multiplier with a limit, in its unit: of a strut's force the least one of the ball socket at that
/// end, from all loads ([`Clamps::margins`]), else the limit less the largest magnitude.
fn least(rows: &[Row], forces: &[Vec<f64>], margins: &[Margins], struts: usize) -> Vec<Option<f64>> {
    let least = |k: usize, row: &Row| match row.channel {
        Some(channel) => {
            let socket = channel.index() + if matches!(channel, Channel::StrutLower(_)) { struts } else { 0 };
            Some(margins.iter().map(|margins| margins[socket]).fold(f64::INFINITY, f64::min))
        }
        None => row.limit.map(|l| l - forces.iter().map(|f| f[k].abs()).fold(0.0, f64::max)),
    };
    rows.iter().enumerate().map(|(k, row)| least(k, row)).collect()
}

fn write_table(target: &Path, loads: &Loads, t: &[f64]) -> miette::Result<()> {
    let names: Vec<&str> = loads.rows.iter().map(|row| row.name.as_str()).collect();
    file::replace(target, |out| -> std::io::Result<()> {
        writeln!(out, "t,{}", names.join(","))?;
        for (t, row) in t.iter().zip(loads.forces) {
            let cells: Vec<String> = row.iter().map(f64::to_string).collect();
            writeln!(out, "{t},{}", cells.join(","))?;
        }
        Ok(())
    })
    .into_diagnostic()
}

fn draw(model: &Model, motion: &Motion, loads: &Loads) -> deltatwin_report::Figure {
    let line = |k: usize, label: &str| Curve::new(label, motion.t.clone(), loads.series(k));
    let first = loads.place(Channel::StrutUpper(0)).unwrap_or(0);
    let pairs = |label: &str| -> Vec<Panel> {
        (0..model.mechanism.limbs())
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
    let mut all = pairs("λ_S");
    for (channel, values) in &motion.measured {
        let Some(k) = loads.place(*channel) else { continue };
        let measured = Curve::new("measured", motion.t.clone(), values.to_vec()).color(Color::MEASURED);
        let computed = line(k, "computed").color(Color::BLUE).style(Style::Dashed);
        all.push(Panel {
            title: format!("{channel}, measured and computed"),
            y_label: "N".into(),
            curves: vec![measured, computed],
        });
    }
    let bearing = |range: Range<usize>| range.map(|k| line(k, &loads.rows[k].name)).collect();
    if model.mechanism.has_telescope() {
        all.push(Panel { title: "λ_E, moments".into(), y_label: "N·m".into(), curves: bearing(0..2) });
        all.push(Panel { title: "λ_E, forces".into(), y_label: "N".into(), curves: bearing(2..5) });
    }
    panels("Constraint forces", "t / s", &all)
}

fn to_json(args: &Args, motion: &Motion, loads: &Loads) -> Value {
    let entry = |(k, row): (usize, &Row)| {
        let [min, max, rms] = loads.statistics(k);
        let entry = json!({
            "min": min, "max": max, "rms": rms, "unit": row.unit, "limit": row.limit, "margin": loads.margins[k],
        });
        (row.name.clone(), entry)
    };
    let multipliers: Map<String, Value> = loads.rows.iter().enumerate().map(entry).collect();
    let measured: Map<String, Value> = motion
        .measured
        .iter()
        .filter_map(|(channel, values)| {
            let [rms, size] = loads.difference(values, loads.place(*channel)?);
            Some((channel.to_string(), json!({ "rms_difference": rms, "rms_measured": size, "unit": "N" })))
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

fn print(args: &Args, plant: &Plant, motion: &Motion, loads: &Loads) -> miette::Result<()> {
    let mut table = Table::new(&["Multiplier", "min", "max", "rms", "limit", "margin", ""], &[6]);
    for (k, row) in loads.rows.iter().enumerate() {
        let [min, max, rms] = loads.statistics(k);
        let cells = [Some(min), Some(max), Some(rms), row.limit, loads.margins[k]];
        let cells = cells.map(|v| v.map_or(String::new(), |v| significant(v, 4)));
        table.row(std::iter::once(row.name.clone()).chain(cells).chain([row.unit.clone()]));
    }
    say(table)?;
    let law = "The margin of a strut's force is the least one of the ball socket there, whose hold falls with the pull along \
               its opening; all loads count.";
    say(wrapped(law, 2))?;
    let redundant = plant.geometry.redundant_struts();
    if redundant > 0 {
        let open = format!(
            "Struts beyond those that hold the plate: {redundant}. Forces are those of equally stiff struts without prestress; \
             torques and sums of a pair do not depend on that."
        );
        say(wrapped(&open, 2))?;
    }
    say(format!("\n  {} samples over {:.4} s", motion.t.len(), motion.t[motion.t.len() - 1] - motion.t[0]))?;
    for (channel, values) in &motion.measured {
        let Some(k) = loads.place(*channel) else { continue };
        let [rms, size] = loads.difference(values, k);
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
