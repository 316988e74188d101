//! One run of the twin: its verdict, the cause of a failure, and what follows.
//!
//! A [`Case`] is run twice where that is needed. The *unlimited* machine (sockets that cannot open, drives that give any
//! torque, no supervision) gives the margins, which continue beyond the limits. Where one is negative, the machine with
//! its limits gives the sequence of what happens. A run is a function of its case, bit by bit.

pub mod advise;
mod aftermath;
mod clearance;
mod fmea;
mod hand;
mod margins;
mod naming;
mod supervision;
mod table;
#[cfg(test)]
mod tests;
mod verdict;

pub use clearance::CLEAR;
pub use naming::Naming;
pub use verdict::{Cause, CauseKind, FOLLOWS, Fmea, Hand, Margin, Notice, Step, Touchdown, Verdict};

use std::path::PathBuf;

use deltatwin::cell::CellError;
use deltatwin::dynamics::Plant;
use deltatwin::kinematics::motion::SOCKETS;
use deltatwin::machine::Sockets;
use deltatwin::model::Model;
use deltatwin::recording::Recording;
use deltatwin::scenario::motion::MotionError;
use deltatwin::scenario::{Course, DesiredMotion, Scenario, Supervision};
use deltatwin::twin::sockets::socket_name;
use deltatwin::twin::{
    Cause as Breakdown, Clamps, Options, Report, Sample, SimulationError, TripCause, simulate_until_failure,
};
use thiserror::Error;

use aftermath::Aftermath;
use margins::{Margins, holding};

/// A machine, its controller's model and what they do.
#[derive(Clone)]
pub struct Case {
    /// The machine.
    pub model: Model,
    /// Model of the feed-forward, which also plans the motion; `None` means the machine's own.
    pub controller_model: Option<Model>,
    /// What is done. Sockets may open whether it arms them or not.
    pub scenario: Scenario,
    /// Folder to which the file names of the scenario are relative.
    pub base: PathBuf,
    /// Ball sockets as their thresholds are set at the machine, whatever their true hold.
    pub nominal: Sockets,
}

/// What a run leaves besides its verdict.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Keep {
    /// Nothing.
    Nothing,
    /// The recording, and the poses of all bodies in [`Report::frames`].
    Recording,
}

/// Result of a run.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The answer.
    pub verdict: Verdict,
    /// Signals of the run with the limits of the machine, if kept and not refused.
    pub recording: Option<Recording>,
    /// Report of the run with the limits of the machine, if there was one, else of the unlimited one.
    pub report: Report,
    /// Options of that run, for its display.
    pub options: Options,
}

/// Why there is no verdict.
#[derive(Debug, Error)]
pub enum RunError {
    /// The desired motion is none of this machine.
    #[error("{scenario}: {source}")]
    Motion {
        /// Name of the scenario.
        scenario: String,
        /// Cause.
        source: MotionError,
    },
    /// The twin cannot be started, or its numbers are not valid.
    #[error("{scenario}: {source}")]
    Simulation {
        /// Name of the scenario.
        scenario: String,
        /// Cause.
        source: SimulationError,
    },
    /// Work and energy disagree.
    #[error(
        "{scenario}: the energy balance does not close: {:.2} % of the work turned over is unaccounted for; the step is \
         too long for the motion (shorten `sample_time` or raise `substeps`)", 1e2 * .error
    )]
    Energy {
        /// Name of the scenario.
        scenario: String,
        /// Relative error.
        error: f64,
    },
}

/// Interval between the poses that are kept, s.
const FRAME: f64 = 0.01;
/// Simulated time after a failure, s: long enough for a fall from half a metre.
pub const AFTERMATH: f64 = 0.6;
/// Simulated time after the load has landed, s.
pub const AFTER_LANDING: f64 = 0.05;
/// Simulated time after the end of a motion in which it settles, s.
const AFTER_MOTION: f64 = 0.1;
/// Factor on the steps during contacts: the oscillation of a strut's end on its contact is followed with ωh = 0.3.
const CONTACT_STEPS: f64 = 3.0;

impl Case {
    /// Model of the feed-forward.
    pub fn planning(&self) -> &Model {
        self.controller_model.as_ref().unwrap_or(&self.model)
    }

    /// Options of a run with the limits of the machine, sockets armed.
    pub fn options(&self, keep: Keep) -> Options {
        let mut options =
            Options { contacts: Some(deltatwin_cell::contacts), ..Options::of(&self.scenario, &self.model) };
        if let Some(clamps) = options.clamps.as_mut() {
            clamps.armed = self.model.assembled;
        }
        options.trace = true;
        // A recording is that of `simulate`; a verdict needs less.
        if keep == Keep::Nothing {
            options.contact_steps = CONTACT_STEPS;
            options.after_landing = Some(AFTER_LANDING);
        }
        options.frames = (keep == Keep::Recording).then_some(FRAME);
        options
    }

    /// Clamps of the run.
    fn clamps(&self) -> Clamps {
        let (scenario, model) = (&self.scenario, &self.model);
        Clamps {
            hold: scenario.socket_holds(model),
            preload: scenario.socket_preloads(model),
            ..Clamps::watched(&model.sockets)
        }
    }

    /// The machine in this run.
    fn plant(&self) -> Plant {
        Plant::new(&self.scenario.machine(&self.model), &self.scenario.setup)
    }

    /// The machine as the controller believes it to be.
    fn believed(&self) -> Plant {
        Plant::new(self.planning(), &self.scenario.believed_setup())
    }

    fn failed(&self, source: SimulationError) -> RunError {
        RunError::Simulation { scenario: self.scenario.name.clone(), source }
    }

    fn motion(&self) -> Result<DesiredMotion, RunError> {
        let scenario = &self.scenario;
        scenario
            .motion
            .unchecked(self.planning(), &scenario.believed_setup())
            .map_err(|source| RunError::Motion { scenario: scenario.name.clone(), source })
    }

    /// Time of a cycle there and back, s: of a motion that does not return, twice its length.
    fn cycle(&self) -> Option<f64> {
        match &self.scenario.motion {
            Course::RandomFourier { frequency, .. } => Some(1.0 / frequency),
            Course::Fourier(series) => Some(1.0 / series.frequency),
            Course::Path(path) => {
                let length = path.course().lap();
                let returns = path.closed || path.waypoints.first() == path.waypoints.last();
                Some(if returns { length } else { 2.0 * length })
            }
            Course::Table(table) => {
                let length = table.t.last()?;
                let returns = match (table.rows.first(), table.rows.last()) {
                    (Some(a), Some(b)) => a.iter().zip(b).all(|(a, b)| (a - b).abs() < RETURNED),
                    _ => false,
                };
                Some(if returns { *length } else { 2.0 * length })
            }
            Course::ConstantSpeed(_) | Course::StaticPoses(_) => None,
        }
    }
}

/// Distance (m, rad) from its start within which a motion counts as returned.
const RETURNED: f64 = 1e-4;

/// A simulation: recording, report and the error that ended it.
struct Simulated {
    recording: Recording,
    report: Report,
    failure: Option<SimulationError>,
}

/// Runs `machine` in place of the case's own.
///
/// One step per sample resolves most motions; the steps of the scenario are used where work and energy disagree.
fn simulated(
    case: &Case,
    motion: &DesiredMotion,
    machine: &Model,
    options: &Options,
) -> Result<Simulated, SimulationError> {
    let once = simulated_with(case, motion, machine, &Options { substeps: 1, ..options.clone() });
    match once {
        Ok(run) if run.report.energy_closes() => Ok(run),
        once if options.substeps == 1 => once,
        _ => simulated_with(case, motion, machine, options),
    }
}

/// Runs `machine` in place of the case's own with the steps of `options`.
fn simulated_with(
    case: &Case,
    motion: &DesiredMotion,
    machine: &Model,
    options: &Options,
) -> Result<Simulated, SimulationError> {
    let (setup, controller) = (&case.scenario.setup, case.believed());
    let machine = case.scenario.machine(machine);
    let run = simulate_until_failure(&machine, setup, &controller, &|t| motion.at(t), options, &mut |_| true);
    run.map(|(recording, report, failure)| Simulated { recording, report, failure })
}

/// The machine without limits, and the options of its run: no contacts either, unless the gripper needs them.
fn unlimited(case: &Case) -> (Model, Options) {
    let mut model = case.model.clone();
    for drive in &mut model.drives {
        drive.max_torque = f64::INFINITY;
    }
    let mut options = Options { supervision: Supervision::default(), ..case.options(Keep::Nothing) };
    if let Some(clamps) = options.clamps.as_mut() {
        clamps.armed = false;
    }
    if case.scenario.actions.is_empty() {
        options.objects.clear();
        options.contacts = None;
        // Where the motion has ended, nothing changes any more.
        let end = case.scenario.motion.length().map_or(f64::INFINITY, |length| length + AFTER_MOTION);
        options.duration = options.duration.min(end);
    }
    (model, options)
}

/// Margins of the unlimited machine, with what its run left.
fn margins_of(case: &Case, motion: &DesiredMotion) -> Result<(Margins, Vec<Sample>, Report), RunError> {
    let scenario = &case.scenario;
    let (model, options) = unlimited(case);
    let free = simulated(case, motion, &model, &options);
    let mut margins = Margins::default();
    let plant = case.plant();
    let reach = |margins: &mut Margins| {
        margins.reach(&plant.geometry, motion, scenario.duration, case.model.sample_time);
    };
    let mut free = match free {
        Ok(free) => free,
        // Out of reach from the start: only the workspace has a margin.
        Err(SimulationError::Trajectory { .. }) => {
            reach(&mut margins);
            return Ok((margins, Vec::new(), Report::default()));
        }
        Err(source) => return Err(case.failed(source)),
    };
    match free.failure {
        None if !free.report.energy_closes() => {
            let error = free.report.energy_error;
            return Err(RunError::Energy { scenario: scenario.name.clone(), error });
        }
        None => {}
        Some(SimulationError::Trajectory { .. }) => reach(&mut margins),
        Some(SimulationError::Singular { t, cause: Breakdown::Rank, .. }) => {
            margins.see(CauseKind::Workspace, t, -BARELY, || "singular pose".into());
        }
        Some(source) => return Err(case.failed(source)),
    }
    let trace = std::mem::take(&mut free.report.trace);
    margins.follow(&case.model, &case.clamps(), &scenario.supervision, &trace);
    clearance::follow(&mut margins, &plant, scenario, &trace);
    Ok((margins, trace, free.report))
}

/// Margin below which the machine with its limits is run to see whether it fails between two samples.
const CLOSE: f64 = 0.02;
/// Excess over a limit whose size is not known, normalised.
const BARELY: f64 = 1e-6;

/// Whether the error of a machine with its limits leaves no verdict; a broken one may end in a singular pose.
fn is_fatal(error: &SimulationError) -> bool {
    !matches!(error, SimulationError::Trajectory { .. } | SimulationError::Singular { cause: Breakdown::Rank, .. })
}

/// Verdict on a case, with what `keep` asks for, which does not influence it.
///
/// # Errors
/// A [`RunError`] if the case cannot be run at all. A motion beyond the workspace is an answer, not an error.
pub fn run(case: &Case, keep: Keep) -> Result<Outcome, RunError> {
    let motion = case.motion()?;
    let (mut margins, trace, report) = margins_of(case, &motion)?;
    let mut options = case.options(Keep::Nothing);
    let crossed = margins.first_crossing();
    // A motion that leaves workspace or speed limits is refused by the controller.
    let refused = [CauseKind::Workspace, CauseKind::Telescope, CauseKind::Speed];
    let refused = crossed.as_ref().is_some_and(|c| refused.contains(&c.kind)) || trace.is_empty();
    let end = crossed.as_ref().map_or(case.scenario.duration, |c| c.time + AFTERMATH);
    options.duration = end;
    let mut limited = None;
    if !refused && margins.least() < CLOSE {
        match simulated(case, &motion, &case.model, &options) {
            Ok(Simulated { failure: Some(source), .. }) if is_fatal(&source) => return Err(case.failed(source)),
            Ok(run) => limited = Some(run),
            Err(SimulationError::Cell { reason: CellError::Overlap { link, other, depth }, .. }) => {
                margins.see(CauseKind::Contact, 0.0, -depth / CLEAR, || format!("{link} at {other}"));
            }
            Err(source) => return Err(case.failed(source)),
        }
    }
    let shown = limited.as_ref().map_or(&report, |run| &run.report);
    let verdict = judge(case, &motion, margins, (&trace, shown, end, limited.is_some()));
    if keep == Keep::Recording && !refused {
        let options = Options { duration: end.max(case.scenario.duration), ..case.options(keep) };
        if let Ok(run) = simulated_with(case, &motion, &case.model, &options) {
            return Ok(Outcome { verdict, recording: Some(run.recording), report: run.report, options });
        }
    }
    let report = limited.map_or(report, |run| run.report);
    Ok(Outcome { verdict, recording: None, report, options })
}

/// The verdict from the margins, the `trace` of the unlimited machine, and the report of the machine with its limits
/// until `end` (s), if it was run.
fn judge(
    case: &Case,
    motion: &DesiredMotion,
    mut margins: Margins,
    (trace, report, end, was_run): (&[Sample], &Report, f64, bool),
) -> Verdict {
    let scenario = &case.scenario;
    let clamps = case.clamps();
    let after = Aftermath::new(report, scenario, end);
    let opened = if was_run { after.opened() } else { Vec::new() };
    let mut failures: Vec<Cause> = Vec::new();
    if was_run {
        if let Some(&(time, socket)) = opened.first() {
            failures.push(Cause { kind: CauseKind::Socket, part: socket_name(socket), time });
        }
        if let Some(impact) = after.collision() {
            let part = impact.names.join(" at ");
            failures.push(Cause { kind: CauseKind::Contact, part, time: impact.t });
        }
        if let Some((time, cause)) = report.trip.filter(|(t, _)| *t <= end) {
            let of = |kind, axis: usize| Some(Cause { kind, part: format!("axis {}", axis + 1), time });
            failures.extend(match cause {
                TripCause::Socket => None,
                TripCause::Torque(axis) => of(CauseKind::Trip, axis),
                TripCause::Tracking(axis) => of(CauseKind::Following, axis),
            });
        }
    }
    // What the machine with its limits shows is at least barely beyond a limit.
    let intact = margins.first_crossing().is_none();
    for cause in &failures {
        if intact || margins.crossed(cause.kind).is_none() && cause.kind == CauseKind::Contact {
            margins.see(cause.kind, cause.time, -BARELY, || cause.part.clone());
        }
    }
    for kind in CauseKind::ALL {
        if failures.iter().all(|f| f.kind != kind)
            && let Some((time, part)) = margins.crossed(kind)
        {
            failures.push(Cause { kind, part: part.into(), time });
        }
    }
    failures.sort_by(|a, b| a.time.total_cmp(&b.time).then(a.kind.cmp(&b.kind)));
    let first = failures.into_iter().next();
    let sorted = margins.sorted();
    let nothing = || Cause { kind: CauseKind::Workspace, part: "motion".into(), time: 0.0 };
    let cause = first.clone().or_else(|| sorted.first().map(|m| m.cause.clone())).unwrap_or_else(nothing);
    let time = first.map(|cause| cause.time);
    let weakest = |s: usize| trace.iter().map(|x| x.margin[s]).fold(f64::INFINITY, f64::min);
    let assembled = case.model.assembled && !trace.is_empty();
    let force = |x: &Sample| x.strut_force.iter().flatten().fold(0.0, |most: f64, f| most.max(f.abs()));
    let hold = case.model.sockets.dislocation_force;
    let mut verdict = Verdict {
        survived: time.is_none(),
        margin: sorted.first().map_or(1.0, |m| m.value),
        margins: sorted,
        sockets: if assembled {
            (0..SOCKETS).map(|s| weakest(s) / holding(&case.model, &clamps, s)).collect()
        } else {
            Vec::new()
        },
        sequence: if time.is_some() { after.sequence(&cause) } else { Vec::new() },
        energy: report.dislocations.first().filter(|_| was_run && !opened.is_empty()).map(|d| d.kinetic_energy),
        platform: after.platform().filter(|_| was_run),
        payload: after.payload().filter(|_| was_run),
        opened,
        supervision: Vec::new(),
        hand: hand::estimate(&case.plant(), motion, scenario.duration, trace, hold),
        fmea: Fmea::default(),
        strut_force: trace.iter().map(force).fold(0.0, f64::max),
        cycle: case.cycle(),
        time,
        cause,
    };
    if let Some(failed) = time {
        verdict.supervision = supervision::notices(case, motion, report, failed);
    }
    verdict.fmea = fmea::row(case, &verdict);
    verdict
}
