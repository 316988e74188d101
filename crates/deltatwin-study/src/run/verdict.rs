//! [`Verdict`]: what limits a run, what happened when it failed, and who would have noticed.

/// Kinds of causes that limit a motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum CauseKind {
    /// A ball socket leaves its ball.
    Socket,
    /// A drive needs more torque than it has.
    Torque,
    /// A drive turns faster than it may.
    Speed,
    /// The telescope reaches an end.
    Telescope,
    /// An arm leaves its range, or a strut does not reach the platform.
    Workspace,
    /// The robot or its payload touches something.
    Contact,
    /// The feedback torque exceeds the supervision's limit.
    Trip,
    /// The difference between desired and measured position exceeds the supervision's limit.
    Following,
}

impl CauseKind {
    /// All kinds.
    pub const ALL: [Self; 8] = [
        Self::Socket,
        Self::Torque,
        Self::Speed,
        Self::Telescope,
        Self::Workspace,
        Self::Contact,
        Self::Trip,
        Self::Following,
    ];

    /// Name in tables and figures.
    pub fn name(self) -> &'static str {
        match self {
            Self::Socket => "socket",
            Self::Torque => "drive torque",
            Self::Speed => "speed",
            Self::Telescope => "telescope",
            Self::Workspace => "workspace",
            Self::Contact => "contact",
            Self::Trip => "trip",
            Self::Following => "following error",
        }
    }
}

/// What failed, or came closest to failing.
#[derive(Clone, Debug, PartialEq)]
pub struct Cause {
    /// Kind.
    pub kind: CauseKind,
    /// The part, such as `strut 3 lower` or `axis 2`.
    pub part: String,
    /// Time of the failure, or of the least margin, s.
    pub time: f64,
}

/// Least margin against one kind of cause.
#[derive(Clone, Debug, PartialEq)]
pub struct Margin {
    /// Kind of cause, and the part and time (s) at which the margin is least.
    pub cause: Cause,
    /// 1: unloaded, 0: at the limit, negative beyond it.
    ///
    /// It is the margin of a machine that neither breaks nor trips, whose drives give any torque and that meets nothing, and
    /// therefore falls monotonically with the load also beyond the limit. Where the real machine meets an object or
    /// saturates a drive and keeps its sockets, those against sockets, trip and following error are the real one's.
    pub value: f64,
}

/// One step of what happens from the failure on.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// Time, s.
    pub time: f64,
    /// What happens.
    pub what: String,
}

/// First contact of a falling part with its surroundings.
#[derive(Clone, Debug, PartialEq)]
pub struct Touchdown {
    /// Time, s.
    pub time: f64,
    /// Origin of the body's frame, m.
    pub position: [f64; 3],
    /// Speed, m/s.
    pub speed: f64,
    /// Kinetic energy, J.
    pub energy: f64,
    /// What it hits.
    pub on: String,
}

/// A supervision that may notice a failure.
#[derive(Clone, Debug, PartialEq)]
pub struct Notice {
    /// What is watched, with its threshold.
    pub what: String,
    /// Whether the scenario states the threshold; otherwise it is the customary one of this crate.
    pub stated: bool,
    /// Time of the first sample beyond the threshold, s; `None` if it was never exceeded.
    pub time: Option<f64>,
    /// Time from there to the failure, s; `None` if it is noticed afterwards only, or never.
    pub lead: Option<f64>,
}

/// The customary estimate by hand: tilting torque of the payload over the distance of a pair of struts.
#[derive(Clone, Debug, PartialEq)]
pub struct Hand {
    /// Largest tilting torque of the payload about the centre of the platform's ball plane, N·m.
    pub torque: f64,
    /// Time of the largest tilting torque, s.
    pub time: f64,
    /// That torque over the distance of the balls of a pair, N.
    pub force: f64,
    /// Margin that follows from it, normalised as [`Margin::value`].
    pub margin: f64,
    /// Largest axial strut force of the twin, N.
    pub twin_force: f64,
    /// Excess of the twin over the estimate, relative to the estimate; `None` without a tilting torque.
    pub excess: Option<f64>,
    /// Where and why the twin differs by more than 10 %; empty otherwise.
    pub why: String,
}

/// A row of a failure mode and effects analysis.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Fmea {
    /// Cause.
    pub cause: String,
    /// Effect at the part itself.
    pub local: String,
    /// Effect on robot and payload.
    pub end: String,
    /// Supervision that notices it first.
    pub detection: String,
    /// Time from there to the failure, s; `None` if it is noticed afterwards only, or never.
    pub lead: Option<f64>,
}

/// Answer about one run.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// Whether nothing failed.
    pub survived: bool,
    /// What failed first; of a run that survived, what came closest.
    pub cause: Cause,
    /// First limit that was reached, which need not be the cause: a drive that saturates breaks nothing by itself.
    pub limit: Option<Cause>,
    /// Time of the failure, s.
    pub time: Option<f64>,
    /// Margin against the cause, see [`Margin::value`]: negative if and only if the run failed. Zero if it survived with a
    /// drive at its limit.
    pub margin: f64,
    /// Least margin of every kind that applies to the run, least first.
    pub margins: Vec<Margin>,
    /// Least margin of each ball socket, relative to its hold; empty if the motion was not run.
    pub sockets: Vec<f64>,
    /// What happens from the failure on, in order of time.
    pub sequence: Vec<Step>,
    /// Ball sockets that left their balls, in order.
    pub opened: Vec<(f64, usize)>,
    /// Kinetic energy of robot and objects at the failure, J; `None` if no socket left.
    pub energy: Option<f64>,
    /// Where the platform lands.
    pub platform: Option<Touchdown>,
    /// Where the payload or the held object lands.
    pub payload: Option<Touchdown>,
    /// What would have noticed the failure, earliest first.
    pub supervision: Vec<Notice>,
    /// The estimate by hand; `None` without payload or struts.
    pub hand: Option<Hand>,
    /// Row of a failure mode and effects analysis.
    pub fmea: Fmea,
    /// Largest axial strut force, N.
    pub strut_force: f64,
    /// Time of a cycle there and back, s; `None` for a motion without an end.
    pub cycle: Option<f64>,
}

/// Time after the first dislocation within which others count as its immediate consequence, s.
pub const FOLLOWS: f64 = 1e-3;

impl Verdict {
    /// Least margin against one kind of cause; `None` if it does not apply.
    pub fn margin_of(&self, kind: CauseKind) -> Option<f64> {
        self.margins.iter().find(|m| m.cause.kind == kind).map(|m| m.value)
    }

    /// Cycles per minute; `None` for a motion without an end.
    pub fn picks_per_minute(&self) -> Option<f64> {
        self.cycle.map(|time| 60.0 / time)
    }

    /// Number of sockets that leave within [`FOLLOWS`] of the first one, itself included.
    pub fn opened_at_once(&self) -> usize {
        let first = self.opened.first().map_or(f64::INFINITY, |(t, _)| *t);
        self.opened.iter().filter(|(t, _)| *t <= first + FOLLOWS).count().min(self.sockets.len())
    }
}
