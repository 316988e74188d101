//! `deltatwin simulate`.

mod receiver;
mod remedy;

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use miette::{IntoDiagnostic, WrapErr, miette};
use rayon::prelude::*;
use serde_json::{Value, json};

use self::receiver::Receiving;
use self::remedy::Remedy;
#[cfg(feature = "viewer")]
use crate::command::view::LiveView;
use crate::data::Outside;
#[cfg(feature = "viewer")]
use crate::data::positive;
use crate::terminal::{
    BAD_ANSWER, BAD_INPUT, DONE, INTERRUPTED, bar, catch_interrupt, check_output, complain, error_json, interrupted,
    path, say,
};
use deltatwin::dynamics::Plant;
use deltatwin::machine::Unit;
use deltatwin::model::Model;
use deltatwin::recording::{Context, Difference, Recording};
use deltatwin::scenario::{DesiredMotion, Formulation, Scenario};
use deltatwin::twin::origin::origin;
use deltatwin::twin::sockets::socket_name;
use deltatwin::twin::{
    Cause, LARGEST_ENERGY_ERROR, Options, Report, SimulationError, setup_of_run, simulate, simulate_into,
};
use deltatwin_io::file::WriteError;
#[cfg(feature = "viewer")]
use deltatwin_io::file::name_of_part;
#[cfg(feature = "viewer")]
use deltatwin_io::outside::Access;
use deltatwin_io::{model, recording, scenario};
#[cfg(feature = "viewer")]
use deltatwin_rerun::{scene::Assets, show::Stage};

/// Run the twin.
///
/// Several scenarios run at once on all cores. A recording grows on the disk as REC.partial until it is complete, at
/// constant memory. Ctrl-C ends a run at its next sample; what was simulated until then is kept. A recording of that
/// name stays as it is: the part is then REC.partial.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Example: deltatwin simulate scenarios/crash.toml -o run.mcap --step-error")]
pub struct Args {
    /// Scenario files.
    #[arg(required = true)]
    pub scenarios: Vec<PathBuf>,
    /// Recording to write, .mcap or .csv; with several scenarios a folder, which gets one .mcap each.
    #[arg(short, long, value_name = "REC")]
    pub output: Option<PathBuf>,
    /// Model file of the machine, instead of the scenario's; the controller keeps its own.
    #[arg(long, value_name = "M")]
    pub model: Option<PathBuf>,
    /// Solve the equations of motion with the rows of the joints `eliminated` in closed form, or in `absolute` coordinates,
    /// instead of as the scenario says.
    #[arg(long, value_name = "F")]
    pub formulation: Option<Formulation>,
    /// Run again at 1/16 of the step, without noise, and report how far the two are apart.
    #[arg(long)]
    pub step_error: bool,
    /// Compare with an earlier recording of the same scenario, bit by bit; reports the first sample that differs.
    #[arg(long, value_name = "REC")]
    pub verify: Option<PathBuf>,
    /// Rerun file to write: the robot, whole or in parts, the objects around it, the events and the loads.
    #[cfg(feature = "viewer")]
    #[arg(long, value_name = "FILE")]
    pub rrd: Option<PathBuf>,
    #[cfg(feature = "viewer")]
    #[command(flatten)]
    viewer: LiveView,
    /// Simulated seconds per second of --live.
    #[cfg(feature = "viewer")]
    #[arg(long, value_name = "X", default_value_t = 1.0, requires = "live", value_parser = positive)]
    speed: f64,
    #[command(flatten)]
    pub outside: Outside,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Interval between the poses of a Rerun file or a bag, s.
const FRAME: f64 = 0.01;
/// Number of steps of the reference run per step.
const REFERENCE: usize = 16;

/// A checked scenario with all its files.
struct Job {
    scenario: Scenario,
    machine: Model,
    planning: Model,
    motion: DesiredMotion,
    options: Options,
    output: Option<PathBuf>,
    origin: Context,
    /// Whether the samples are needed after the run, besides their file.
    keeps: bool,
}

/// Result of a job.
struct Outcome {
    /// Number of samples.
    samples: usize,
    /// The recording's file, if there is one.
    file: Option<PathBuf>,
    /// Whether the run was interrupted before its end.
    stopped: bool,
    /// The run as a whole, if the job keeps it.
    recording: Recording,
    /// Why the recording was not written, if it was not.
    unwritten: Option<WriteError>,
    report: Report,
    wall: f64,
    step_error: Option<Vec<Difference>>,
    /// Error that ended the run early.
    failure: Option<SimulationError>,
    /// Finer steps that were tried because the energy balance does not close.
    remedy: Option<Remedy>,
}

impl Outcome {
    /// Reason why the run as a whole is invalid, if it is.
    fn complaint(&self) -> Option<String> {
        let remedy = self.remedy.as_ref().map_or(String::new(), |remedy| format!("; {remedy}"));
        if let Some(failure) = &self.failure {
            return Some(failure.to_string() + &remedy);
        }
        (!self.report.energy_closes()).then(|| {
            format!(
                "the energy balance does not close: {:.2} % of the work turned over is unaccounted for, expected at most \
                 {} %; the step is too long for the motion (shorten `sample_time` or raise `substeps`){remedy}",
                1e2 * self.report.energy_error,
                1e2 * LARGEST_ENERGY_ERROR
            )
        })
    }
}

/// Runs the command; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    if let Some(folder) = args.output.as_ref().filter(|_| args.scenarios.len() > 1) {
        std::fs::create_dir_all(folder).into_diagnostic().wrap_err_with(|| folder.display().to_string())?;
    }
    #[cfg_attr(not(feature = "viewer"), expect(unused_mut))]
    let mut jobs = args.scenarios.iter().map(|file| job(file, args)).collect::<miette::Result<Vec<_>>>()?;
    distinct(&args.scenarios, &jobs)?;
    let alone = |option: &str, given: bool| {
        if given && jobs.len() > 1 {
            return Err(miette!("{option} is for one scenario; {} were given", jobs.len()));
        }
        Ok(())
    };
    alone("--verify", args.verify.is_some())?;
    #[cfg(feature = "viewer")]
    alone("--rrd", args.rrd.is_some())?;
    #[cfg(feature = "viewer")]
    alone("--connect, --spawn, --serve or --live", args.viewer.wanted())?;
    #[cfg(feature = "viewer")]
    if let Some(rrd) = &args.rrd {
        check_output(rrd, &[args.scenarios[0].as_path()], &["rrd"])?;
    }
    let earlier = |file: &Path| recording::read_of(file, None, jobs[0].machine.mechanism).map(|(r, _)| r);
    let verify = args.verify.as_deref().map(earlier).transpose()?;
    catch_interrupt()?;
    #[cfg(feature = "viewer")]
    let stream = match jobs.first_mut() {
        Some(Job { scenario, machine, motion, options, .. }) if args.viewer.wanted() => {
            let shown = options.clone();
            let access = args.outside.access();
            args.viewer.open(&scenario.name, || stage(machine, scenario, motion, shown, access), options)?
        }
        _ => None,
    };
    #[cfg(feature = "viewer")]
    let pace = args.viewer.is_live().then_some(args.speed);
    #[cfg(not(feature = "viewer"))]
    let pace = None;
    let outcomes = execute_all(&jobs, args.step_error, pace);
    #[cfg(feature = "viewer")]
    if let Some(problem) = stream.and_then(deltatwin_rerun::stream::Stream::finish) {
        complain(format!("warning: {problem}"));
    }
    let mut status = DONE;
    let mut runs = Vec::new();
    for (job, outcome) in jobs.iter().zip(outcomes) {
        let outcome = match outcome {
            Ok(outcome) => outcome,
            Err(error @ (SimulationError::Singular { .. } | SimulationError::Cell { .. })) => {
                complain(format!("error: {}: {error}", job.scenario.name));
                status = status.max(BAD_ANSWER);
                let error = error_json(&miette!("{error}"));
                runs.push(json!({ "scenario": job.scenario.name, "error": error }));
                continue;
            }
            Err(error) => return Err(error).into_diagnostic().wrap_err_with(|| job.scenario.name.clone()),
        };
        if let Some(complaint) = outcome.complaint() {
            complain(format!("error: {}: {complaint}", job.scenario.name));
            status = status.max(BAD_ANSWER);
        }
        // A failure to write one result does not affect the others.
        let mut outcome = outcome;
        let written = outcome.unwritten.take().map_or_else(|| show(job, &outcome, args), Err);
        if let Err(error) = &written {
            complain(format!("error: {}: {error}", job.scenario.name));
            status = status.max(BAD_INPUT);
        }
        let difference = verify.as_ref().map(|earlier| outcome.recording.first_difference(earlier));
        if matches!(difference, Some(Some(_))) {
            status = status.max(BAD_ANSWER);
        }
        if args.json {
            let mut run = json(job, &outcome, difference.as_ref(), written.is_ok());
            let complaint = written.as_ref().err().map(ToString::to_string).or(outcome.complaint());
            run["error"] = complaint.map_or(Value::Null, |complaint| error_json(&miette!("{complaint}")));
            runs.push(run);
        } else {
            print(job, &outcome, difference.as_ref(), written.as_ref().ok().map(Option::as_deref))?;
        }
    }
    if args.json {
        match runs.len() {
            1 if jobs.len() == 1 => say(runs.remove(0))?,
            _ => say(json!({ "runs": runs }))?,
        }
    }
    if interrupted() {
        return Ok(INTERRUPTED);
    }
    #[cfg(feature = "viewer")]
    args.viewer.stay();
    Ok(status)
}

/// Runs all jobs on all cores, with a progress bar over their simulated time; with a `pace`, no faster than so many
/// simulated seconds per second.
fn execute_all(jobs: &[Job], step_error: bool, pace: Option<f64>) -> Vec<Result<Outcome, SimulationError>> {
    let total: f64 = jobs.iter().map(|j| j.scenario.duration).sum();
    let progress = bar("simulate", (total * 1e3) as u64);
    let (done, start) = (AtomicU64::new(0), Instant::now());
    let one = |job: &Job| {
        let mut last = 0;
        execute(job, step_error, &mut |t| {
            let now = (t * 1e3) as u64;
            progress.set_position(done.fetch_add(now - last, Ordering::Relaxed) + now - last);
            last = now;
            if let Some(pace) = pace {
                std::thread::sleep(Duration::from_secs_f64(t / pace).saturating_sub(start.elapsed()));
            }
            !interrupted()
        })
    };
    let outcomes = jobs.par_iter().map(one).collect();
    progress.finish_and_clear();
    outcomes
}

/// Checks that the recordings of the scenarios have different names.
fn distinct(files: &[PathBuf], jobs: &[Job]) -> miette::Result<()> {
    for (i, job) in jobs.iter().enumerate() {
        let Some(output) = &job.output else { continue };
        // Some file systems do not distinguish upper and lower case.
        let lower = |path: &Path| path.to_string_lossy().to_lowercase();
        let same = |other: &Job| other.output.as_deref().is_some_and(|o| lower(o) == lower(output));
        if let Some(earlier) = jobs[..i].iter().position(same) {
            return Err(miette!(
                "{} and {} would both be written to {}; expected scenarios with different names, or one run each",
                files[earlier].display(),
                files[i].display(),
                output.display()
            ));
        }
    }
    Ok(())
}

/// Writes the Rerun file of a run, if one is wanted, and returns its name; the name of a part if the run was interrupted and
/// there is a file already.
fn show(job: &Job, outcome: &Outcome, args: &Args) -> Result<Option<PathBuf>, WriteError> {
    #[cfg(feature = "viewer")]
    if let Some(rrd) = &args.rrd {
        let Job { machine, scenario, motion, options, .. } = job;
        let stage = stage(machine, scenario, motion, options.clone(), args.outside.access());
        let stage = stage.map_err(|e| WriteError::invalid(rrd, format!("{e:#}")))?;
        let file = if outcome.stopped { name_of_part(rrd) } else { rrd.clone() };
        stage.write(&file, &outcome.recording, &outcome.report)?;
        return Ok(Some(file));
    }
    #[cfg(not(feature = "viewer"))]
    let _ = (job, outcome.stopped, args);
    Ok(None)
}

/// What a viewer shows of a run besides its frames.
#[cfg(feature = "viewer")]
fn stage(
    machine: &Model,
    scenario: &Scenario,
    motion: &DesiredMotion,
    options: Options,
    access: Access,
) -> miette::Result<Stage> {
    let plant = Plant::new(machine, &scenario.setup);
    Ok(Stage { plant, options, desired: Some(motion.clone()), assets: Assets::of(machine, access)? })
}

fn job(file: &Path, args: &Args) -> miette::Result<Job> {
    let scenario = scenario::read_with(file, args.outside.access())?;
    let machine_file = args.model.as_ref().unwrap_or(&scenario.model);
    let machine = scenario.machine(&model::read(machine_file)?);
    // The controller's model is independent of the machine: the same motion drives both.
    let planning = match scenario.controller_model.as_ref().unwrap_or(&scenario.model) {
        same if same == machine_file => machine.clone(),
        other => model::read(other)?,
    };
    let output = args.output.as_ref().map(|output| {
        if args.scenarios.len() > 1 { output.join(format!("{}.mcap", scenario.name)) } else { output.clone() }
    });
    if let Some(output) = &output {
        check_output(output, &[file, machine_file], &["mcap", "csv"])?;
    }
    if planning.mechanism != machine.mechanism {
        return Err(miette!(
            "{}: is another kind of machine than {}; expected a controller model of the same kind",
            planning.name,
            machine.name
        ));
    }
    if let Some(problem) = scenario.sockets.misfit(machine.mechanism) {
        return Err(miette!("{}: {problem}", file.display()));
    }
    let motion = scenario.motion(&planning).into_diagnostic().wrap_err_with(|| file.display().to_string())?;
    let mut options = Options { contacts: Some(deltatwin_cell::contacts), ..Options::of(&scenario, &machine) };
    if let Some(formulation) = args.formulation {
        options.formulation = formulation;
    }
    let in_bag = output.as_ref().is_some_and(|o| o.extension().is_some_and(|e| e.eq_ignore_ascii_case("mcap")));
    #[cfg(feature = "viewer")]
    let in_bag = in_bag || args.rrd.is_some();
    if in_bag {
        options.frames = Some(FRAME);
    }
    let text = std::fs::read_to_string(file).ok();
    let origin = origin(&scenario, (file, text.as_deref()), &machine, &planning);
    let keeps = args.verify.is_some();
    #[cfg(feature = "viewer")]
    let keeps = keeps || args.rrd.is_some();
    Ok(Job { scenario, machine, planning, motion, options, output, origin, keeps })
}

fn execute(job: &Job, step_error: bool, progress: &mut dyn FnMut(f64) -> bool) -> Result<Outcome, SimulationError> {
    let Job { scenario, machine, planning, motion, options, .. } = job;
    let controller = Plant::new(planning, &scenario.believed_setup());
    let desired = |t: f64| motion.at(t);
    let start = Instant::now();
    let setup = setup_of_run(machine, &scenario.setup);
    let mut receiving = Receiving::new(job, &setup, progress);
    let (mut report, failure) =
        simulate_into(machine, &scenario.setup, &controller, &desired, options, &mut receiving)?;
    let received = receiving.finish();
    report.frames = received.frames;
    let wall = start.elapsed().as_secs_f64();
    let recording = Recording { name: scenario.name.clone(), signals: received.signals, setup };
    let step_error = if step_error && failure.is_none() {
        let again = |substeps: usize| {
            let options = Options { noise_seed: None, substeps, frames: None, watcher: None, ..options.clone() };
            simulate(machine, &scenario.setup, &controller, &desired, &options, &mut |_| !interrupted())
        };
        let coarse = again(options.substeps)?.0;
        let fine = again(REFERENCE * options.substeps)?.0;
        Some(coarse.differences(&fine))
    } else {
        None
    };
    let (samples, file, stopped, unwritten) = (received.samples, received.file, received.stopped, received.problem);
    let diverged = matches!(failure, Some(SimulationError::Singular { cause: Cause::Diverged, .. }));
    let remedy = (diverged || failure.is_none() && !report.energy_closes()).then(|| Remedy::of(job, wall));
    Ok(Outcome { samples, file, stopped, recording, unwritten, report, wall, step_error, failure, remedy })
}

/// The socket with the least margin, and its margin, N.
fn weakest(report: &Report) -> (usize, f64) {
    report.min_margin.iter().copied().enumerate().min_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, f64::INFINITY))
}

fn json(job: &Job, outcome: &Outcome, difference: Option<&Option<Difference>>, written: bool) -> Value {
    let Outcome { report, wall, step_error, failure, .. } = outcome;
    let differences = |all: &[Difference]| {
        all.iter().map(|d| (d.channel.clone(), json!(d.size))).collect::<serde_json::Map<String, Value>>()
    };
    let events: Vec<Value> =
        report.events.iter().map(|e| json!({ "t": e.t, "kind": e.kind.name(), "what": e.what })).collect();
    let mut out = json!({
        "scenario": job.scenario.name,
        "simulated_s": report.simulated,
        "wall_s": wall,
        "steps": report.steps,
        "max_loop_gap": report.max_loop_gap,
        "max_loop_rate": report.max_loop_rate,
        "energy_error": report.energy_error,
        "energy_closes": report.energy_closes(),
        "failure": failure.as_ref().map(ToString::to_string),
        "step_that_closes": outcome.remedy.as_ref().and_then(|remedy| remedy.step),
        "formulation": job.options.formulation.name(),
        "tracking_error": report.tracking_error[..job.machine.mechanism.axes()],
        "events": events,
        "peak_strut_force": report.peak_strut_force,
        "min_socket_margin": weakest(report).1,
        "socket_margins": report.min_margin[..2 * job.machine.mechanism.struts()],
        "kinetic_energy": report.kinetic_energy,
        "interrupted": interrupted(),
        "recording": outcome.file.as_deref().filter(|_| written).map_or(Value::Null, path),
    });
    if let Some(step_error) = step_error {
        out["step_error"] = Value::Object(differences(step_error));
    }
    if let Some(difference) = difference {
        out["first_difference"] = difference
            .as_ref()
            .map_or(Value::Null, |d| json!({ "sample": d.sample, "channel": d.channel, "size": d.size }));
    }
    out
}

/// Prints what a run has given; `written` is the Rerun file, and none at all if writing failed.
fn print(
    job: &Job,
    outcome: &Outcome,
    difference: Option<&Option<Difference>>,
    written: Option<Option<&Path>>,
) -> miette::Result<()> {
    let Outcome { samples, file, report, wall, step_error, failure, .. } = outcome;
    let ended = match failure {
        _ if interrupted() => ", interrupted",
        Some(_) => ", failed there",
        None => "",
    };
    let name = &job.scenario.name;
    say(format!("{name}: simulated {:.4} s in {wall:.2} s, {} steps{ended}", report.simulated, report.steps))?;
    let plant = Plant::new(&job.machine, &job.scenario.setup);
    if plant.is_closed_delta() {
        say(format!("  loops      gap {:.1e} m, rate {:.1e} m/s at most", report.max_loop_gap, report.max_loop_rate))?;
    }
    say(format!("  energy     {:.1e} of the work turned over is unaccounted for", report.energy_error))?;
    let machine = job.machine.mechanism;
    if plant.assembled {
        let (socket, margin) = weakest(report);
        let weakest = match margin.is_finite() {
            true => {
                format!("; weakest socket {} with a margin of {margin:.1} N", socket_name(socket, machine.struts()))
            }
            false => String::new(),
        };
        say(format!("  struts     {:.1} N at most{weakest}", report.peak_strut_force))?;
    }
    let errors: Vec<String> =
        report.tracking_error[..machine.axes()].iter().map(|e| format!("{:.3}", 1e3 * e)).collect();
    say(format!("  tracking   {} m{} at most", errors.join(", "), machine.unit(Unit::Rad)))?;
    if report.unconverged > 0.0 {
        say(format!(
            "  effects    laws that read forces or accelerations did not converge, off by up to {:.1e}",
            report.unconverged
        ))?;
    }
    for event in &report.events {
        say(format!("  {:9.6} s  {}: {}", event.t, event.kind.name(), event.what))?;
    }
    if let Some(step_error) = step_error {
        say(format!("  against {REFERENCE} times smaller steps, without noise:"))?;
        for d in step_error {
            say(format!("    {:<14} {:.1e} {} at most, at sample {}", d.channel, d.size, d.unit, d.sample))?;
        }
    }
    match difference {
        None => {}
        Some(None) => say("  verified   every sample is the same, bit for bit")?,
        Some(Some(d)) if d.size.is_infinite() => {
            say(format!("  differs    {} from sample {} on is only in one of the two", d.channel, d.sample))?;
        }
        Some(Some(d)) => {
            say(format!("  differs    first at sample {} in {}, by {:e} {}", d.sample, d.channel, d.size, d.unit))?;
        }
    }
    let Some(rrd) = written else { return say("  Nothing written: see the error above") };
    match (&job.output, file) {
        (Some(_), None) => say("  Nothing written: the run failed at its first sample")?,
        (Some(output), Some(file)) => {
            let stays = if file == output { String::new() } else { format!("; {} stays as it was", output.display()) };
            say(format!("  Wrote {}: {samples} samples{stays}", file.display()))?;
        }
        (None, _) if rrd.is_none() => say("  Nothing written; -o FILE keeps the recording")?,
        (None, _) => {}
    }
    if let Some(rrd) = rrd {
        say(format!("  Wrote {}; look at it with: rerun {}", rrd.display(), rrd.display()))?;
    }
    Ok(())
}
