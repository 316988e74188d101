//! Report of a run of the twin besides its recording, and errors that end a run.

use nalgebra::Isometry3;
use thiserror::Error;

use super::contacts::{ContactBody, ContactWork, Touch};
use super::trace::{Dislocation, Impact, Sample, TripCause};
use crate::cell::CellError;
use crate::kinematics::{KinematicsError, Reactions, SocketSet};
use crate::machine::bodies::{END_EFFECTOR, SLOTS};
use crate::machine::{PerAxis, PerSocket, PerStrut, each};

/// Poses and forces at one time.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Time, s.
    pub t: f64,
    /// Joint positions, rad (m on a prismatic axis).
    pub q: PerAxis<f64>,
    /// Torques at the gear outputs, N·m.
    pub tau: PerAxis<f64>,
    /// Poses of the body frames in the inertial frame.
    pub bodies: [Isometry3<f64>; SLOTS],
    /// Poses of the objects, in the order of [`super::Options::objects`].
    pub objects: Vec<Isometry3<f64>>,
    /// Closed sockets.
    pub closed: SocketSet,
    /// Axial forces at the elbow ends and at the platform ends of the struts, tension positive, N.
    pub strut_force: [PerStrut<f64>; 2],
    /// Remaining force margin of each socket, N; zero once open.
    pub socket_margin: PerSocket<f64>,
    /// Contacts of the robot since the previous frame: of every pair the strongest.
    pub contacts: Vec<Touch>,
}

/// An event.
#[derive(Clone, Debug, PartialEq)]
pub struct Event {
    /// Time, s.
    pub t: f64,
    /// Kind.
    pub kind: EventKind,
    /// Description.
    pub what: String,
}

/// Kinds of events.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EventKind {
    /// A ball socket dislocated.
    Dislocation,
    /// The drives tripped.
    Trip,
    /// The robot came into contact.
    Contact,
    /// A joint reached its hard stop.
    Stop,
    /// An object was picked up.
    Pick,
    /// An object was released.
    Release,
    /// Everything has come to rest after a trip.
    Rest,
    /// The mechanism reached a pose at which the equations cannot be continued.
    Singular,
}

impl EventKind {
    /// Name in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Dislocation => "dislocation",
            Self::Trip => "trip",
            Self::Contact => "contact",
            Self::Stop => "stop",
            Self::Pick => "pick",
            Self::Release => "release",
            Self::Rest => "rest",
            Self::Singular => "singular",
        }
    }
}

/// Report of a run besides its recording.
#[derive(Clone, Debug)]
pub struct Report {
    /// Simulated time, s.
    pub simulated: f64,
    /// Integration steps.
    pub steps: usize,
    /// Number of solutions of the equations of motion: one per stage of a step and per evaluation between steps, more if laws
    /// depend on the solution.
    pub solutions: usize,
    /// Number of Newton corrections that project states onto the constraints.
    pub corrections: usize,
    /// Work of the contact solver.
    pub contacts: ContactWork,
    /// Largest violation of a position row of the closed joints, m (or 1).
    pub max_loop_gap: f64,
    /// Largest violation of a velocity row, m/s (or 1/s).
    pub max_loop_rate: f64,
    /// Largest |energy − initial energy − work| relative to the work turned over.
    pub energy_error: f64,
    /// Largest absolute axial strut force at any sample or dislocation, N.
    pub peak_strut_force: f64,
    /// Smallest margin of every socket while closed, N; infinite where there is none.
    pub min_margin: PerSocket<f64>,
    /// Largest difference between desired and actual joint angle before the drives trip, rad.
    pub tracking_error: PerAxis<f64>,
    /// Events in order of time.
    pub events: Vec<Event>,
    /// Sockets that left their balls, in order.
    pub dislocations: Vec<Dislocation>,
    /// When and why the drives tripped.
    pub trip: Option<(f64, TripCause)>,
    /// Beginnings of contacts of the robot, in order of time.
    pub impacts: Vec<Impact>,
    /// Loads at every sample, if requested by [`super::Options::trace`].
    pub trace: Vec<Sample>,
    /// Frames, if requested by [`super::Options::frames`].
    pub frames: Vec<Frame>,
    /// Sockets closed at the end.
    pub closed: SocketSet,
    /// Kinetic energy of robot and objects at the end, J.
    pub kinetic_energy: f64,
    /// Largest change in the last iteration over laws that depend on the solution, of evaluations that did not
    /// converge, N, rad/s² or m/s².
    pub unconverged: f64,
}

impl Default for Report {
    /// Nothing simulated, all sockets closed.
    fn default() -> Self {
        Self {
            simulated: 0.0,
            steps: 0,
            solutions: 0,
            corrections: 0,
            contacts: ContactWork::default(),
            max_loop_gap: 0.0,
            max_loop_rate: 0.0,
            energy_error: 0.0,
            peak_strut_force: 0.0,
            min_margin: each(f64::INFINITY),
            tracking_error: each(0.0),
            events: Vec::new(),
            dislocations: Vec::new(),
            trip: None,
            impacts: Vec::new(),
            trace: Vec::new(),
            frames: Vec::new(),
            closed: SocketSet::ALL,
            kinetic_energy: 0.0,
            unconverged: 0.0,
        }
    }
}

impl Report {
    /// Updates the peak with the strut forces of one more instant, a sample or a dislocation between two.
    pub(super) fn see_strut_forces(&mut self, reactions: &Reactions) {
        let forces = reactions.upper.iter().chain(&reactions.lower);
        self.peak_strut_force = forces.fold(self.peak_strut_force, |peak, f| peak.max(f.abs()));
    }

    /// First contact of the end effector, or of what it holds, with one of `objects` objects after a socket has left.
    pub fn landing(&self, objects: usize) -> Option<&Impact> {
        let broken = self.dislocations.first()?.t;
        let is_load = |body: ContactBody| matches!(body, ContactBody::Link(END_EFFECTOR) | ContactBody::Object(_));
        let is_object = |body: ContactBody| matches!(body, ContactBody::Object(object) if object < objects);
        self.impacts.iter().find(|i| i.t >= broken && is_load(i.link) && is_object(i.other))
    }

    /// Whether the energy error is at most [`LARGEST_ENERGY_ERROR`], as it must be for a valid run.
    pub fn energy_closes(&self) -> bool {
        self.energy_error <= LARGEST_ENERGY_ERROR
    }
}

/// Largest admissible energy error, relative to the work turned over. Shipped runs reach at most 5e-6; 1e-3 and more
/// means that the step is too long for the motion, or that the work of a law is not accounted for.
pub const LARGEST_ENERGY_ERROR: f64 = 1e-3;

/// Pose of a machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Joint angles, rad (m on a prismatic axis); zero for axes that do not exist.
    pub q: PerAxis<f64>,
    /// Position of the centre of the platform's ball plane, m, if there is a platform.
    pub platform: Option<[f64; 3]>,
}

impl std::fmt::Display for Pose {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let listed = |values: &[f64]| values.iter().map(|x| format!("{x:.4}")).collect::<Vec<_>>().join(", ");
        write!(f, "q = ({})", listed(&self.q))?;
        self.platform.map_or(Ok(()), |p| write!(f, ", platform at ({}) m", listed(&p)))
    }
}

/// Why the equations of motion cannot be continued.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// The mechanism has lost rank.
    Rank,
    /// The numerical solution has diverged.
    Diverged,
}

impl std::fmt::Display for Cause {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Rank => "the mechanism lost rank: its pose is singular, motion and forces are not unique",
            Self::Diverged => {
                "the integration diverged: work and energy disagree, the step is too long for the motion (shorten \
                 `sample_time` or raise `substeps`)"
            }
        })
    }
}

/// Why a run ended early.
#[derive(Debug, Error)]
pub enum SimulationError {
    /// The desired motion is not feasible.
    #[error("desired motion at t = {t:.4} s: {reason}")]
    Trajectory {
        /// Time, s.
        t: f64,
        /// Why the pose is not feasible.
        reason: KinematicsError,
    },
    /// The mechanism reached a singular pose, or the solution diverged.
    #[error("at t = {t:.4} s {cause}; last pose: {pose}")]
    Singular {
        /// Time, s.
        t: f64,
        /// Last pose.
        pose: Pose,
        /// Cause.
        cause: Cause,
    },
    /// The value of a force law is not finite.
    #[error(transparent)]
    Law {
        /// Law, time and place.
        source: KinematicsError,
    },
    /// Payload and effects result in an inertia that is not physically consistent.
    #[error("{body}: payload and effects leave it with an inertia that no body has")]
    Body {
        /// Name of the body.
        body: String,
    },
    /// The load is not one that the machine can have.
    #[error("{what}")]
    Load {
        /// Why, and what was expected.
        what: &'static str,
    },
    /// A force sensor is on a strut that the machine does not have.
    #[error("`sensors` names strut {strut}; expected one of the machine's {struts}")]
    NoStrut {
        /// The strut, from 1.
        strut: usize,
        /// Number of struts of the machine.
        struts: usize,
    },
    /// The run requires what is known of three limbs and one platform only.
    #[error("{what}: known of robots with three limbs and one platform only")]
    NotThreeLimbs {
        /// The options that require it.
        what: &'static str,
    },
    /// The run requires parts that the machine does not have.
    #[error("{what} need struts and platform, which this machine does not have")]
    Missing {
        /// The options that require them.
        what: &'static str,
    },
    /// The objects around the robot are not valid, or the gripper cannot perform an action.
    #[error("t = {t:.4} s: {reason}")]
    Cell {
        /// Time, s.
        t: f64,
        /// Cause.
        reason: CellError,
    },
}
