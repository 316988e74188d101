//! One run of the twin: its verdict, the cause of a failure, and what follows.
//!
//! A [`Case`] is run twice where that is needed. The *unlimited* machine (sockets that cannot open, drives that give any
//! torque, no supervision, no contacts) gives the margins, which continue beyond the limits. Where one is negative, the
//! machine with its limits gives the sequence of what happens, and the loads on its sockets if a contact or a saturated
//! drive changes them. A run is a function of its case, bit by bit.

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

use deltatwin::dynamics::Plant;
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
use margins::{LOADS, Margins, holding};

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
    /// Time for which a broken robot is followed on once its load has landed, s; [`AFTER_LANDING`] unless stated.
    pub after_landing: f64,
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
/// Simulated time after the load has landed, s, where a study states none.
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
            options.after_landing = Some(self.after_landing);
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
/// One step per sample resolves most motions: where the scenario states no steps, its default is used only where work and
/// energy disagree.
fn simulated(
    case: &Case,
    motion: &DesiredMotion,
    machine: &Model,
    options: &Options,
) -> Result<Simulated, SimulationError> {
    if case.scenario.substeps.is_some() {
        return simulated_with(case, motion, machine, options);
    }
    let once = simulated_with(case, motion, machine, &Options { substeps: 1, ..options.clone() });
    match once {
        Ok(run) if run.report.energy_closes() => Ok(run),
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
    let (margins, trace, report) = margins_of(case, &motion)?;
    let mut options = case.options(Keep::Nothing);
    let crossed = margins.first_crossing();
    // A motion that leaves workspace or speed limits is refused by the controller.
    let refused = [CauseKind::Workspace, CauseKind::Telescope, CauseKind::Speed];
    let refused = crossed.as_ref().is_some_and(|c| refused.contains(&c.kind)) || trace.is_empty();
    options.duration = crossed.as_ref().map_or(case.scenario.duration, |c| c.time + AFTERMATH);
    if margins.crossed(CauseKind::Torque).is_some() {
        // Whether a drive that saturates finishes shows at the end.
        options.duration = options.duration.max(case.scenario.duration);
    }
    let mut limited = None;
    if !refused && margins.least() < CLOSE {
        match simulated(case, &motion, &case.model, &options) {
            Ok(Simulated { failure: Some(source), .. }) if is_fatal(&source) => return Err(case.failed(source)),
            Ok(run) => limited = Some(run),
            Err(source) => return Err(case.failed(source)),
        }
    }
    let end = options.duration;
    let verdict = judge(case, &motion, margins, Seen { trace: &trace, free: &report, limited: limited.as_ref(), end });
    if keep == Keep::Recording && !refused {
        let options = Options { duration: end.max(case.scenario.duration), ..case.options(keep) };
        if let Ok(run) = simulated_with(case, &motion, &case.model, &options) {
            return Ok(Outcome { verdict, recording: Some(run.recording), report: run.report, options });
        }
    }
    let report = limited.map_or(report, |run| run.report);
    Ok(Outcome { verdict, recording: None, report, options })
}

/// What the runs of a case show.
struct Seen<'a> {
    /// Samples of the unlimited machine.
    trace: &'a [Sample],
    /// Report of the unlimited machine.
    free: &'a Report,
    /// The machine with its limits, if it was run.
    limited: Option<&'a Simulated>,
    /// End of its run, s.
    end: f64,
}

/// Events of the machine with its limits that end its motion, in no order.
fn events(after: &Aftermath, report: &Report, struts: usize) -> Vec<Cause> {
    let mut events = Vec::new();
    if let Some(&(time, socket)) = after.opened().first() {
        events.push(Cause { kind: CauseKind::Socket, part: socket_name(socket, struts), time });
    }
    if let Some(impact) = after.collision() {
        events.push(Cause { kind: CauseKind::Contact, part: impact.names.join(" at "), time: impact.t });
    }
    if let Some((time, cause)) = report.trip.filter(|(t, _)| after.covers(*t)) {
        let of = |kind, axis: usize| Some(Cause { kind, part: format!("axis {}", axis + 1), time });
        events.extend(match cause {
            TripCause::Socket => None,
            TripCause::Torque(axis) => of(CauseKind::Trip, axis),
            TripCause::Tracking(axis) => of(CauseKind::Following, axis),
        });
    }
    events
}

/// Difference between desired and measured position at the end of a run up to which a motion with saturated drives counts
/// as finished, rad (m on a prismatic axis): the customary threshold of a following error.
const FINISHED: f64 = supervision::ERROR;

/// Takes the loads of the machine with its limits where contacts or saturated drives change them, and returns the samples
/// until its first dislocation; `None` where it is the unlimited one up to there.
fn changed<'a>(margins: &mut Margins, case: &Case, (after, trace): (&Aftermath, &'a [Sample])) -> Option<&'a [Sample]> {
    let broken = after.broken();
    let collision = after.collision().map_or(f64::INFINITY, |impact| impact.t);
    let saturated = margins.crossed(CauseKind::Torque).map_or(f64::INFINITY, |(time, _)| time);
    if collision.min(saturated) >= broken.min(f64::MAX) {
        return None;
    }
    let until = &trace[..trace.partition_point(|sample| sample.t < broken)];
    if broken.is_finite() {
        // Beyond the limit the unlimited machine shows how far.
        margins.loads(&case.model, &case.clamps(), &case.scenario.supervision, until);
        return Some(until);
    }
    margins.forget(LOADS);
    margins.loads(&case.model, &case.clamps(), &case.scenario.supervision, until);
    if collision.is_infinite() && margins.crossed(CauseKind::Contact).is_some() {
        margins.forget(&[CauseKind::Contact]);
        clearance::follow(margins, &case.plant(), &case.scenario, until);
    }
    Some(until)
}

/// The failures of a run in order of time, and the first limit it reached; completes `margins` by the events of the machine
/// with its limits.
fn failures(margins: &mut Margins, mut failures: Vec<Cause>, finished: bool) -> (Vec<Cause>, Option<Cause>) {
    // What the machine with its limits shows is at least barely beyond a limit.
    for cause in &failures {
        if margins.crossed(cause.kind).is_none() {
            margins.see(cause.kind, cause.time, -BARELY, || cause.part.clone());
        }
    }
    let mut limits = failures.clone();
    for kind in CauseKind::ALL {
        if failures.iter().all(|f| f.kind != kind)
            && let Some((time, part)) = margins.crossed(kind)
        {
            let cause = Cause { kind, part: part.into(), time };
            limits.push(cause.clone());
            // A drive at its limit breaks nothing by itself.
            if kind != CauseKind::Torque || !finished {
                failures.push(cause);
            }
        }
    }
    let order = |a: &Cause, b: &Cause| a.time.total_cmp(&b.time).then(a.kind.cmp(&b.kind));
    failures.sort_by(order);
    (failures, limits.into_iter().min_by(order))
}

/// The verdict from the margins of the unlimited machine and what the runs show.
fn judge(case: &Case, motion: &DesiredMotion, mut margins: Margins, seen: Seen) -> Verdict {
    let scenario = &case.scenario;
    let clamps = case.clamps();
    let report = seen.limited.map_or(seen.free, |run| &run.report);
    let after = Aftermath::new(report, scenario, (seen.end, case.after_landing));
    let was_run = seen.limited.is_some();
    let (mut found, mut finished, mut real) = (Vec::new(), true, None);
    if was_run {
        found = events(&after, report, case.model.mechanism.struts());
        let error =
            |x: &Sample| x.error[..case.model.mechanism.axes()].iter().fold(0.0, |most: f64, e| most.max(e.abs()));
        // A machine that tripped or broke has failed of that, not of a drive at its limit.
        finished = !found.is_empty() || report.trace.last().is_some_and(|last| error(last) <= FINISHED);
        real = changed(&mut margins, case, (&after, &report.trace));
    }
    let opened = if was_run { after.opened() } else { Vec::new() };
    let (failures, limit) = failures(&mut margins, found, finished);
    let first = failures.into_iter().next();
    let sorted = margins.sorted();
    let nothing = || Cause { kind: CauseKind::Workspace, part: "motion".into(), time: 0.0 };
    let cause = first.clone().or_else(|| sorted.first().map(|m| m.cause.clone())).unwrap_or_else(nothing);
    let time = first.map(|cause| cause.time);
    let margin = sorted.iter().find(|m| m.cause.kind == cause.kind).map_or(1.0, |m| m.value);
    let trace = real.unwrap_or(seen.trace);
    let weakest = |s: usize| {
        let left =
            if opened.iter().any(|(_, socket)| *socket == s) && real.is_some() { -BARELY } else { f64::INFINITY };
        let least = trace.iter().map(|x| x.margin[s]).fold(f64::INFINITY, f64::min);
        (least / holding(&case.model, &clamps, s)).min(left)
    };
    let assembled = case.model.assembled && !seen.trace.is_empty();
    let force = |x: &Sample| x.strut_force.iter().flatten().fold(0.0, |most: f64, f| most.max(f.abs()));
    let hold = case.model.sockets.dislocation_force;
    let mut verdict = Verdict {
        survived: time.is_none(),
        margin: if time.is_none() { margin.max(0.0) } else { margin },
        margins: sorted,
        sockets: if assembled { (0..2 * case.model.mechanism.struts()).map(weakest).collect() } else { Vec::new() },
        sequence: if time.is_some() { after.sequence(&cause) } else { Vec::new() },
        energy: report.dislocations.first().filter(|_| was_run && !opened.is_empty()).map(|d| d.kinetic_energy),
        platform: after.platform().filter(|_| was_run),
        payload: after.payload().filter(|_| was_run),
        opened,
        supervision: Vec::new(),
        hand: hand::estimate(&case.plant(), motion, scenario.duration, seen.trace, hold),
        fmea: Fmea::default(),
        strut_force: trace.iter().map(force).fold(0.0, f64::max),
        cycle: case.cycle(),
        time,
        limit,
        cause,
    };
    if let Some(failed) = time {
        verdict.supervision = supervision::notices(case, motion, report, failed);
    }
    verdict.fmea = fmea::row(case, &verdict);
    verdict
}
