//! One run of the twin: its verdict, the cause of a failure, and what follows.
//!
//! A [`Case`] is run twice where that is needed. The *unlimited* machine (sockets that cannot open, drives that give any
//! torque, no supervision) gives the margins, which continue beyond the limits. Where one is negative, the machine with
//! its limits gives the sequence of what happens. A run is a function of its case, bit by bit.

mod margins;
mod table;
mod verdict;

pub use verdict::{Cause, CauseKind, FOLLOWS, Fmea, Hand, Margin, Notice, Step, Touchdown, Verdict};

use std::path::PathBuf;

use deltatwin::dynamics::Plant;
use deltatwin::model::Model;
use deltatwin::recording::Recording;
use deltatwin::scenario::motion::MotionError;
use deltatwin::scenario::{Course, DesiredMotion, Scenario, Supervision};
use deltatwin::twin::{Clamps, Options, Report, SimulationError, simulate_until_failure};
use thiserror::Error;

use margins::Margins;

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
    /// Signals of the run with the limits of the machine, if kept.
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
        options.frames = (keep == Keep::Recording).then_some(FRAME);
        options
    }

    /// Clamps of the run.
    fn clamps(&self) -> Clamps {
        self.options(Keep::Nothing).clamps.unwrap_or_else(|| Clamps::watched(&self.model.sockets))
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

/// Result of a simulation: recording, report and the error that ended it.
type Simulated = (Recording, Report, Option<SimulationError>);

fn simulate_case(case: &Case, motion: &DesiredMotion, model: &Model, options: &Options) -> Result<Simulated, RunError> {
    let scenario = &case.scenario;
    let controller = Plant::new(case.planning(), &scenario.believed_setup());
    let run = simulate_until_failure(model, &scenario.setup, &controller, &|t| motion.at(t), options, &mut |_| true);
    run.map_err(|source| RunError::Simulation { scenario: scenario.name.clone(), source })
}

/// The machine without limits, and its options.
fn unlimited(case: &Case) -> (Model, Options) {
    let mut model = case.model.clone();
    for drive in &mut model.drives {
        drive.max_torque = f64::INFINITY;
    }
    let mut options = Options { supervision: Supervision::default(), ..case.options(Keep::Nothing) };
    if let Some(clamps) = options.clamps.as_mut() {
        clamps.armed = false;
    }
    (model, options)
}

/// Verdict on a case, with what `keep` asks for.
///
/// # Errors
/// A [`RunError`] if the case cannot be run at all. A motion beyond the workspace is an answer, not an error.
pub fn run(case: &Case, keep: Keep) -> Result<Outcome, RunError> {
    let motion = case.motion()?;
    let (free, options) = unlimited(case);
    let (_, report, failure) = simulate_case(case, &motion, &free, &options)?;
    let mut margins = Margins::default();
    margins.follow(&case.model, &case.clamps(), &case.scenario.supervision, &report.trace);
    if let Some(SimulationError::Trajectory { .. }) = &failure {
        let spacing = case.planning().sample_time;
        margins.reach(&case.model.geometry, &motion, case.scenario.duration, spacing);
    } else if let Some(source) = failure {
        return Err(RunError::Simulation { scenario: case.scenario.name.clone(), source });
    }
    let limits = case.options(keep);
    let (recording, report, _) = simulate_case(case, &motion, &case.model, &limits)?;
    let sorted = margins.sorted();
    let first = CauseKind::ALL
        .iter()
        .filter_map(|&kind| margins.crossed(kind).map(|(time, part)| Cause { kind, part: part.into(), time }))
        .min_by(|a, b| a.time.total_cmp(&b.time));
    let least = sorted.first().map(|m| m.cause.clone());
    let nothing = || Cause { kind: CauseKind::Workspace, part: "motion".into(), time: 0.0 };
    let verdict = Verdict {
        survived: first.is_none(),
        time: first.as_ref().map(|cause| cause.time),
        cause: first.or(least).unwrap_or_else(nothing),
        margin: sorted.first().map_or(f64::NEG_INFINITY, |m| m.value),
        margins: sorted,
        sockets: Vec::new(),
        sequence: report.events.iter().map(|e| Step { time: e.t, what: e.what.clone() }).collect(),
        opened: report.dislocations.iter().map(|d| (d.t, d.socket)).collect(),
        energy: report.dislocations.first().map(|d| d.kinetic_energy),
        platform: None,
        payload: None,
        supervision: Vec::new(),
        hand: None,
        fmea: Fmea::default(),
        strut_force: report.peak_strut_force,
        cycle: case.cycle(),
    };
    let recording = (keep == Keep::Recording).then_some(recording);
    Ok(Outcome { verdict, recording, report, options: limits })
}
