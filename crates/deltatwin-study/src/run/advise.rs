//! Remedies for a motion that a payload makes fail: what each costs, and the margin that it gives on the twin.
//!
//! Each remedy is tried at its mildest setting that reaches the wanted margin. Where none of its settings suffices, the
//! best one is combined with a lower speed; the cost counts both.

use deltatwin::dynamics::Plant;
use deltatwin::planner::trajectory::trajectory;
use deltatwin::planner::{Machine, PlanError, Shape, Task, plan};
use deltatwin::scenario::Course;
use deltatwin::scenario::motion::table::Table;
use deltatwin::text::significant;
use thiserror::Error;

use super::verdict::Verdict;
use super::{Case, Keep, RunError, margins_of, run};

/// Kinds of remedies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RemedyKind {
    /// The whole motion slower.
    Slower,
    /// The payload turned about the vertical by axis 4 throughout.
    Turned,
    /// The payload gripped nearer to its centre of mass.
    OtherGrip,
    /// A higher arc with rounder corners.
    HigherArc,
    /// The motion planned anew within limits on the strut forces.
    StrutLimits,
}

impl RemedyKind {
    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Slower => "slower",
            Self::Turned => "turned by axis 4",
            Self::OtherGrip => "other grip point",
            Self::HigherArc => "higher arc",
            Self::StrutLimits => "planned within strut limits",
        }
    }
}

/// A remedy that was tried on the twin.
#[derive(Clone)]
pub struct Remedy {
    /// Kind.
    pub kind: RemedyKind,
    /// What is changed, with its numbers.
    pub what: String,
    /// Speed relative to the motion as given, at most 1.
    pub speed: f64,
    /// Cycles per minute lost, relative to the motion as given; `None` for a motion without an end.
    pub cost: Option<f64>,
    /// Verdict of the twin on the changed case.
    pub verdict: Verdict,
    /// The changed case.
    pub case: Case,
}

/// Remedies for a case.
#[derive(Clone)]
pub struct Advice {
    /// Verdict on the case as given.
    pub before: Verdict,
    /// Wanted margin against every cause.
    pub wanted: f64,
    /// The cheapest remedies that reach the wanted margin, at most three, cheapest first.
    pub remedies: Vec<Remedy>,
    /// Remedies that do not apply or do not reach it, each with the reason.
    pub refused: Vec<String>,
    /// Where no remedy reaches it, the largest margin that one does reach.
    pub best: Option<Reached>,
}

/// Margin that a change reaches.
#[derive(Clone, Debug, PartialEq)]
pub struct Reached {
    /// What is changed, with its numbers.
    pub what: String,
    /// Least margin over all causes.
    pub margin: f64,
    /// The cause and part with that margin.
    pub cause: String,
}

/// Why there is no advice.
#[derive(Debug, Error)]
pub enum AdviceError {
    /// A case cannot be run.
    #[error(transparent)]
    Run(#[from] RunError),
    /// The path cannot be planned as given.
    #[error("{path}: {source}")]
    Plan {
        /// Name of the path.
        path: String,
        /// Cause.
        source: PlanError,
    },
}

/// Lowest speed that is tried.
const SLOWEST: f64 = 0.25;
/// Resolution of speeds, and of the share of the way to the centre of mass.
const RESOLUTION: f64 = 0.01;
/// Number of angles that are tried, over a turn.
const TURNS: usize = 24;
/// Heights (m) by which arcs are raised.
const RAISED: [f64; 4] = [0.02, 0.04, 0.08, 0.12];
/// Number of tries to meet the wanted margin by strut limits, and the factor between them.
const LIMIT_TRIES: usize = 6;
const LIMIT_STEP: f64 = 0.92;
/// Number of remedies in an [`Advice`].
const BEST: usize = 3;

/// The three cheapest remedies with which a case has at least the margin `wanted` (normalised as
/// [`Margin::value`](super::Margin::value)) against every cause; with `task`, the motion is the plan of that path.
///
/// # Errors
/// An [`AdviceError`] if the case itself cannot be run, or its path not be planned.
pub fn advise(case: &Case, task: Option<&Task>, wanted: f64) -> Result<Advice, AdviceError> {
    let given = match task {
        Some(task) => planned(case, task)?,
        None => case.clone(),
    };
    let before = run(&given, Keep::Nothing)?.verdict;
    let advisor = Advisor { given: &given, task, wanted, cycle: given.cycle() };
    let (mut refused, mut found, mut short) = (Vec::new(), Vec::new(), Vec::new());
    for kind in
        [RemedyKind::Slower, RemedyKind::Turned, RemedyKind::OtherGrip, RemedyKind::HigherArc, RemedyKind::StrutLimits]
    {
        match advisor.remedy(kind)? {
            Ok(remedy) => found.push(remedy),
            Err(Refusal::Useless(reason)) => refused.push(format!("{}: {reason}", kind.name())),
            Err(Refusal::Short(reached)) => {
                let Reached { what, margin, cause } = &reached;
                let margin = significant(*margin, 3);
                refused.push(format!("{}: {what}: the margin is {margin}, that of the {cause}", kind.name()));
                short.push(reached);
            }
        }
    }
    let best = short.into_iter().max_by(|a, b| a.margin.total_cmp(&b.margin)).filter(|_| found.is_empty());
    found.sort_by(|a, b| a.cost.unwrap_or(1.0 - a.speed).total_cmp(&b.cost.unwrap_or(1.0 - b.speed)));
    found.truncate(BEST);
    Ok(Advice { before, wanted, remedies: found, refused, best })
}

/// A case whose motion is the plan of `task`, with the believed payload of the case.
///
/// # Errors
/// [`AdviceError::Plan`] if there is no motion within the limits of the task.
pub fn planned(case: &Case, task: &Task) -> Result<Case, AdviceError> {
    let failed = |source| AdviceError::Plan { path: task.name.clone(), source };
    let setup = case.scenario.believed_setup();
    let plant = Plant::new(case.planning(), &setup);
    let machine = Machine::new(&plant, task.limits.detail);
    let options = deltatwin::planner::Options { certify: false, ..task.options };
    let found = plan(&machine, &task.shape.curve(), &task.limits, &options).map_err(failed)?;
    let recording = trajectory(&machine, &found, &setup, case.planning().sample_time, &task.name).map_err(failed)?;
    let signals = recording.signals;
    let mut out = case.clone();
    out.scenario.duration = found.time + SETTLING;
    out.scenario.motion = Course::Table(Table {
        file: Default::default(),
        joints: true,
        rows: signals.q().iter().collect(),
        t: signals.t,
        moving: false,
    });
    Ok(out)
}

/// Simulated time after the end of a planned motion, s.
const SETTLING: f64 = 0.02;

/// The case as given, and what is wanted of it.
struct Advisor<'a> {
    given: &'a Case,
    task: Option<&'a Task>,
    wanted: f64,
    cycle: Option<f64>,
}

/// Why a remedy does not help.
enum Refusal {
    /// It does not apply, or changes nothing for the better.
    Useless(String),
    /// The margin stays too small.
    Short(Reached),
}

/// A remedy, or why it does not help.
type Tried = Result<Remedy, Refusal>;

fn useless(reason: &str) -> Tried {
    Err(Refusal::Useless(reason.into()))
}

impl Advisor<'_> {
    fn remedy(&self, kind: RemedyKind) -> Result<Tried, AdviceError> {
        match kind {
            RemedyKind::Slower => self.with_speed(kind, "the whole motion slower".into(), self.given),
            RemedyKind::Turned => self.turned(),
            RemedyKind::OtherGrip => self.gripped(),
            RemedyKind::HigherArc => self.raised(),
            RemedyKind::StrutLimits => self.limited(),
        }
    }

    /// Least margin of a case over all causes, with the change that makes the case.
    fn least(&self, what: &str, case: &Case) -> Result<Reached, AdviceError> {
        let margins = margins_of(case, &case.motion()?)?.0.sorted();
        let (margin, cause) = margins.first().map_or((1.0, "motion".into()), |m| {
            let cause = &m.cause;
            (m.value, format!("{} ({})", cause.kind.name(), cause.part))
        });
        Ok(Reached { what: what.into(), margin, cause })
    }

    /// Least margin of a case over all causes.
    fn margin(&self, case: &Case) -> Result<f64, AdviceError> {
        Ok(self.least("", case)?.margin)
    }

    /// The remedy of a changed case at the highest speed that reaches the wanted margin.
    fn with_speed(&self, kind: RemedyKind, what: String, case: &Case) -> Result<Tried, AdviceError> {
        let reaches = |speed: f64| Ok::<bool, AdviceError>(self.margin(&slower(case, speed))? >= self.wanted);
        let at =
            |speed: f64| if speed < 1.0 { format!("{what}, {:.0} % of the speed", 1e2 * speed) } else { what.clone() };
        let mut speed = 1.0;
        if !reaches(1.0)? {
            if !reaches(SLOWEST)? {
                return Ok(Err(Refusal::Short(self.least(&at(SLOWEST), &slower(case, SLOWEST))?)));
            }
            let mut fast = 1.0;
            speed = SLOWEST;
            while fast - speed > RESOLUTION {
                let middle = 0.5 * (fast + speed);
                *if reaches(middle)? { &mut speed } else { &mut fast } = middle;
            }
        }
        let (what, case) = (at(speed), slower(case, speed));
        let verdict = run(&case, Keep::Nothing)?.verdict;
        // The machine with its limits may show what the margins do not.
        if !verdict.survived || verdict.margin < self.wanted {
            let cause = format!("{} ({})", verdict.cause.kind.name(), verdict.cause.part);
            return Ok(Err(Refusal::Short(Reached { what, margin: verdict.margin, cause })));
        }
        let cost = self.cycle.zip(verdict.cycle).map(|(before, after)| 1.0 - before / after);
        Ok(Ok(Remedy { kind, what, speed, cost, verdict, case }))
    }

    /// The first of several changed cases that reaches the wanted margin, else the one with the largest margin, slower.
    fn mildest(&self, kind: RemedyKind, cases: impl IntoIterator<Item = (String, Case)>) -> Result<Tried, AdviceError> {
        let mut best: Option<(f64, String, Case)> = None;
        for (what, case) in cases {
            let margin = self.margin(&case)?;
            if best.as_ref().is_none_or(|(most, ..)| margin > *most) {
                best = Some((margin, what, case));
            }
            if margin >= self.wanted {
                break;
            }
        }
        let Some((margin, what, case)) = best else { return Ok(useless("it does not apply to this motion")) };
        if margin <= self.margin(self.given)? {
            return Ok(useless("it gives no margin"));
        }
        self.with_speed(kind, what, &case)
    }

    /// The payload turned by the smallest angle that suffices.
    fn turned(&self) -> Result<Tried, AdviceError> {
        let payload = &self.given.scenario.setup.payload;
        if payload.mass <= 0.0 || payload.com.xy().norm() <= 0.0 {
            return Ok(useless("the payload hangs centred: turning it changes nothing"));
        }
        let angles = (1..TURNS).map(|k| {
            // By growing magnitude, to both sides: +15°, −15°, +30°, …
            let steps = k.div_ceil(2) as f64;
            steps * std::f64::consts::TAU / TURNS as f64 * if k % 2 == 1 { 1.0 } else { -1.0 }
        });
        let cases = angles.filter_map(|angle| {
            let mut case = self.given.clone();
            turn(&mut case.scenario.motion, angle).then(|| {
                (
                    format!("the payload turned by {:+.0}° throughout, so that it arrives turned", angle.to_degrees()),
                    case,
                )
            })
        });
        self.mildest(RemedyKind::Turned, cases)
    }

    /// The payload gripped as little nearer to its centre of mass as suffices.
    fn gripped(&self) -> Result<Tried, AdviceError> {
        let payload = &self.given.scenario.setup.payload;
        let offset = payload.com.xy();
        if payload.mass <= 0.0 || offset.norm() <= 0.0 {
            return Ok(useless("the payload hangs centred"));
        }
        let at = |share: f64| {
            let mut case = self.given.clone();
            let scenario = &mut case.scenario;
            let shift = offset * share;
            let believed = scenario.believed_payload.as_mut().map(|p| &mut p.com);
            for com in std::iter::once(&mut scenario.setup.payload.com).chain(believed) {
                com.x -= shift.x;
                com.y -= shift.y;
            }
            if let Some(shape) = &mut scenario.payload_shape {
                shape.centre.x -= shift.x;
                shape.centre.y -= shift.y;
            }
            case
        };
        let mut share = 1.0;
        if self.margin(&at(1.0))? >= self.wanted {
            let mut none = 0.0;
            while share - none > RESOLUTION {
                let middle = 0.5 * (share + none);
                *if self.margin(&at(middle))? >= self.wanted { &mut share } else { &mut none } = middle;
            }
        }
        // Adding zero removes the sign of a zero.
        let [x, y] = [offset.x * share, offset.y * share].map(|x| (1e3 * x).round() + 0.0);
        let what = format!("gripped {:.0} mm nearer to its centre, by ({x:+.0}, {y:+.0}) mm", x.hypot(y));
        self.mildest(RemedyKind::OtherGrip, [(what, at(share))])
    }

    /// The lowest arc that suffices.
    fn raised(&self) -> Result<Tried, AdviceError> {
        let mut cases = Vec::new();
        for height in RAISED {
            let what = format!("the arc {:.0} mm higher and rounder", 1e3 * height);
            match self.task {
                Some(task) => {
                    let mut task = task.clone();
                    if let Shape::Lines { points, blend, .. } = &mut task.shape
                        && raise(points, &[], height)
                    {
                        *blend += height;
                        // A higher arc may leave the workspace: it is then no remedy.
                        if let Ok(case) = planned(self.given, &task) {
                            cases.push((what, case));
                        }
                    }
                }
                None => {
                    let mut case = self.given.clone();
                    if let Course::Path(path) = &mut case.scenario.motion
                        && raise(&mut path.waypoints, &path.stops, height)
                    {
                        path.blend += height;
                        case.scenario.duration = path.course().length().max(case.scenario.duration);
                        cases.push((what, case));
                    }
                }
            }
        }
        self.mildest(RemedyKind::HigherArc, cases)
    }

    /// The motion planned within the loosest strut limits that suffice.
    fn limited(&self) -> Result<Tried, AdviceError> {
        let Some(task) = self.task else {
            return Ok(useless("the motion is not planned; `plan` needs a path file"));
        };
        let mut limit = (1.0 - self.wanted) * self.given.model.sockets.dislocation_force;
        let mut best: Option<Reached> = None;
        for _ in 0..LIMIT_TRIES {
            let mut task = task.clone();
            (task.limits.strut_upper, task.limits.strut_lower) = (limit, limit);
            let Ok(case) = planned(self.given, &task) else { break };
            let what = format!("planned with strut forces up to {limit:.0} N, less its margin");
            let reached = self.least(&what, &case)?;
            if reached.margin >= self.wanted {
                return self.with_speed(RemedyKind::StrutLimits, what, &case);
            }
            if best.as_ref().is_none_or(|b| reached.margin > b.margin) {
                best = Some(reached);
            }
            limit *= LIMIT_STEP;
        }
        Ok(best.map_or_else(|| useless("no motion within such limits"), |best| Err(Refusal::Short(best))))
    }
}

/// The case with its motion at `speed` times its speed: the same path, all times longer.
pub fn slower(case: &Case, speed: f64) -> Case {
    let mut out = case.clone();
    if speed == 1.0 {
        return out;
    }
    match &mut out.scenario.motion {
        Course::RandomFourier { frequency, .. } => *frequency *= speed,
        Course::Fourier(series) => series.frequency *= speed,
        Course::Path(path) => {
            path.speed *= speed;
            path.acceleration *= speed.powi(2);
            path.jerk *= speed.powi(3);
            path.dwell /= speed;
        }
        Course::Table(table) => table.t.iter_mut().for_each(|t| *t /= speed),
        Course::ConstantSpeed(runs) => {
            runs.speeds.iter_mut().for_each(|v| *v *= speed);
            runs.acceleration *= speed.powi(2);
        }
        Course::StaticPoses(poses) => {
            poses.hold /= speed;
            poses.travel /= speed;
        }
    }
    out.scenario.duration /= speed;
    for action in &mut out.scenario.actions {
        action.t /= speed;
    }
    out
}

/// Adds `angle` (rad) to ψ along a motion; false if it does not state ψ.
fn turn(motion: &mut Course, angle: f64) -> bool {
    match motion {
        Course::Path(path) => path.waypoints.iter_mut().for_each(|w| w[3] += angle),
        Course::Table(table) => table.rows.iter_mut().for_each(|row| row[3] += angle),
        Course::StaticPoses(poses) => poses.poses.iter_mut().for_each(|pose| pose[3] += angle),
        Course::Fourier(series) => series.centre[3] += angle,
        Course::RandomFourier { .. } | Course::ConstantSpeed(_) => return false,
    }
    true
}

/// Raises the inner waypoints at which the motion does not stop; false if there is none.
fn raise(points: &mut [[f64; 4]], stops: &[usize], height: f64) -> bool {
    let last = points.len().saturating_sub(1);
    let mut any = false;
    for (i, point) in points.iter_mut().enumerate().take(last).skip(1) {
        if !stops.contains(&i) {
            point[2] += height;
            any = true;
        }
    }
    any
}
