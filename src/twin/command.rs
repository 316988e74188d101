//! `deltatwin simulate`.

use std::path::PathBuf;
use std::time::Instant;

use miette::{IntoDiagnostic, WrapErr, miette};
use serde_json::{Value, json};

use super::{Options, Report, SimulationError, simulate};
use crate::dynamics::Plant;
use crate::model::Model;
use crate::recording::Recording;
use crate::scenario::Scenario;
use crate::terminal::{BAD_ANSWER, DONE, INTERRUPTED, bar, catch_interrupt, check_output, interrupted, path, say};

/// Run the twin.
///
/// Ctrl-C ends the run at the next period; what was simulated until then is written.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Example: deltatwin simulate scenarios/excitation.toml -o run.mcap")]
pub struct Args {
    /// Scenario file.
    pub scenario: PathBuf,
    /// Recording to write, .mcap or .csv.
    #[arg(short, long, value_name = "REC")]
    pub output: Option<PathBuf>,
    /// Model file of the machine, instead of the scenario's; the controller keeps its own.
    #[arg(long, value_name = "M")]
    pub model: Option<PathBuf>,
    /// Rerun file to write.
    #[cfg(feature = "viewer")]
    #[arg(long, value_name = "FILE")]
    pub rrd: Option<PathBuf>,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> miette::Result<u8> {
    let scenario = Scenario::read(&args.scenario)?;
    let machine_file = args.model.as_ref().unwrap_or(&scenario.model);
    let machine = Model::read(machine_file)?;
    // Another machine does not change what the controller knows: the same motion drives both.
    let planning = match scenario.controller_model.as_ref().unwrap_or(&scenario.model) {
        same if same == machine_file => machine.clone(),
        other => Model::read(other)?,
    };
    let inputs = [args.scenario.as_path(), machine_file];
    if let Some(output) = &args.output {
        check_output(output, &inputs, &["mcap", "csv"])?;
    }
    #[cfg(feature = "viewer")]
    if let Some(rrd) = &args.rrd {
        check_output(rrd, &inputs, &["rrd"])?;
    }
    if !machine.assembled {
        return Err(miette!("{}: is disassembled; expected an assembled robot", machine_file.display()));
    }
    let motion = scenario.motion(&planning).into_diagnostic().wrap_err_with(|| args.scenario.display().to_string())?;
    let controller = Plant::new(&planning, &scenario.setup);
    let options = Options::of(&scenario, &machine);
    catch_interrupt()?;
    let progress = bar("simulate", (scenario.duration * 1e3) as u64);
    let start = Instant::now();
    let outcome = simulate(&machine, &scenario.setup, &controller, &|t| motion.at(t), &options, &mut |t| {
        progress.set_position((t * 1e3) as u64);
        !interrupted()
    });
    let wall = start.elapsed().as_secs_f64();
    progress.finish_and_clear();
    let (mut recording, report) = match outcome {
        Ok(done) => done,
        Err(error @ SimulationError::Singular { .. }) => {
            eprintln!("error: {}: {error}", args.scenario.display());
            return Ok(BAD_ANSWER);
        }
        Err(error) => return Err(error).into_diagnostic(),
    };
    recording.name.clone_from(&scenario.name);
    if let Some(output) = &args.output {
        recording.write(output).into_diagnostic()?;
    }
    #[cfg(feature = "viewer")]
    if let Some(rrd) = &args.rrd {
        crate::replay::write(rrd, &recording, &planning)?;
    }
    if args.json {
        say(json(&report, &machine, wall, args))?;
    } else {
        print(&report, &recording, wall, args)?;
    }
    Ok(if interrupted() { INTERRUPTED } else { DONE })
}

/// Force that the sockets could still take beyond the largest strut force, N.
fn socket_margin(report: &Report, machine: &Model) -> f64 {
    machine.sockets.dislocation_force - report.peak_strut_force
}

fn json(report: &Report, machine: &Model, wall: f64, args: &Args) -> Value {
    json!({
        "simulated_s": report.simulated,
        "wall_s": wall,
        "steps": report.steps,
        "max_loop_gap": report.max_loop_gap,
        "max_loop_rate": report.max_loop_rate,
        "energy_error": report.energy_error,
        "tracking_error": report.tracking_error,
        "events": [],
        "peak_strut_force": report.peak_strut_force,
        "min_socket_margin": socket_margin(report, machine),
        "interrupted": interrupted(),
        "recording": args.output.as_deref().map_or(Value::Null, path),
    })
}

fn print(report: &Report, recording: &Recording, wall: f64, args: &Args) -> miette::Result<()> {
    let ended = if interrupted() { ", interrupted" } else { "" };
    say(format!("Simulated {:.4} s in {wall:.2} s, {} steps{ended}", report.simulated, report.steps))?;
    say(format!("  loops      gap {:.1e} m, rate {:.1e} m/s at most", report.max_loop_gap, report.max_loop_rate))?;
    say(format!("  energy     {:.1e} of the work turned over is unaccounted for", report.energy_error))?;
    say(format!("  struts     {:.1} N at most", report.peak_strut_force))?;
    let e = report.tracking_error.map(|e| 1e3 * e);
    say(format!("  tracking   {:.3}, {:.3}, {:.3}, {:.3} mrad at most", e[0], e[1], e[2], e[3]))?;
    match &args.output {
        Some(output) => say(format!("  Wrote {}: {} samples", output.display(), recording.signals.len()))?,
        None => say("  Nothing written; -o FILE keeps the recording")?,
    }
    #[cfg(feature = "viewer")]
    if let Some(rrd) = &args.rrd {
        say(format!("  Wrote {}; look at it with: rerun {}", rrd.display(), rrd.display()))?;
    }
    Ok(())
}
