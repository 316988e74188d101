//! What a run of the twin showed besides its recording, or why it ended early.

use nalgebra::Isometry3;
use thiserror::Error;

use super::contacts::ContactWork;
use crate::cell::CellError;
use crate::kinematics::motion::SOCKETS;
use crate::kinematics::{KinematicsError, Reactions, SocketSet};
use crate::machine::bodies::BODIES;
use crate::machine::{AXES, STRUTS};

/// Where everything was at one time.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Time, s.
    pub t: f64,
    /// Joint positions, rad.
    pub q: [f64; AXES],
    /// Torques at the gear outputs, N·m.
    pub tau: [f64; AXES],
    /// Poses of the bodies' frames, world.
    pub bodies: [Isometry3<f64>; BODIES],
    /// Poses of the objects, in the order of [`super::Options::objects`].
    pub objects: Vec<Isometry3<f64>>,
    /// Sockets that held.
    pub closed: SocketSet,
    /// Axial force at the elbow end and at the platform end of each strut, tension positive, N.
    pub strut_force: [[f64; STRUTS]; 2],
    /// What each socket could still take, N; zero once open.
    pub socket_margin: [f64; SOCKETS],
}

/// Something that happened.
#[derive(Clone, Debug, PartialEq)]
pub struct Event {
    /// When, s.
    pub t: f64,
    /// What kind.
    pub kind: EventKind,
    /// What, in words.
    pub what: String,
}

/// Kinds of events.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EventKind {
    /// A ball socket left its ball.
    Dislocation,
    /// The drives tripped.
    Trip,
    /// The robot touched something.
    Contact,
    /// A joint ran into its hard stop.
    Stop,
    /// An object was picked up.
    Pick,
    /// An object was let go.
    Release,
    /// Everything has come to rest after a trip.
    Rest,
    /// The mechanism reached a pose from which the equations go no further.
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

/// What a run showed besides its recording.
#[derive(Clone, Debug)]
pub struct Report {
    /// Simulated time, s.
    pub simulated: f64,
    /// Integration steps.
    pub steps: usize,
    /// Solutions of the equations of motion: one per stage of a step and per evaluation between steps, more where laws read
    /// what is solved for.
    pub solutions: usize,
    /// Newton corrections that put states back on the constraints.
    pub corrections: usize,
    /// Work of what solves the contacts.
    pub contacts: ContactWork,
    /// Largest violation of a position row of the joints that hold, m (or 1).
    pub max_loop_gap: f64,
    /// Largest violation of a velocity row, m/s (or 1/s).
    pub max_loop_rate: f64,
    /// Largest |energy − initial energy − work| relative to the work turned over.
    pub energy_error: f64,
    /// Largest axial strut force at any sample or dislocation, N.
    pub peak_strut_force: f64,
    /// Smallest margin of every socket while it held, N.
    pub min_margin: [f64; SOCKETS],
    /// Largest distance between desired and actual joint angle until the drives trip, rad.
    pub tracking_error: [f64; AXES],
    /// What happened, in order.
    pub events: Vec<Event>,
    /// Poses, as far as [`super::Options::frames`] asks for them.
    pub frames: Vec<Frame>,
    /// Sockets that hold at the end.
    pub closed: SocketSet,
    /// Kinetic energy of robot and objects at the end, J.
    pub kinetic_energy: f64,
    /// Largest change in the last iteration over load-dependent friction that did not converge, N.
    pub unconverged: f64,
}

impl Report {
    /// Raises the peak to the strut forces of one more instant: a sample, or a dislocation between two.
    pub(super) fn see_strut_forces(&mut self, reactions: &Reactions) {
        let forces = reactions.upper.iter().chain(&reactions.lower);
        self.peak_strut_force = forces.fold(self.peak_strut_force, |peak, f| peak.max(f.abs()));
    }

    /// Whether the energy balance closes, as that of a run whose numbers mean anything does: all but
    /// [`LARGEST_ENERGY_ERROR`] of the work turned over is accounted for.
    pub fn energy_closes(&self) -> bool {
        self.energy_error <= LARGEST_ENERGY_ERROR
    }
}

/// Share of the work turned over that may be unaccounted for. Shipped runs have at most 3e-6; a thousandth and more means that the
/// step is too long for the motion, or that a law acts without being asked for its work.
pub const LARGEST_ENERGY_ERROR: f64 = 1e-3;

/// Where a machine is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Joint angles, rad (m on a slide); of axes that are not there zero.
    pub q: [f64; AXES],
    /// Centre of the platform's ball plane, m, if there is a platform.
    pub platform: Option<[f64; 3]>,
}

impl std::fmt::Display for Pose {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let listed = |values: &[f64]| values.iter().map(|x| format!("{x:.4}")).collect::<Vec<_>>().join(", ");
        write!(f, "q = ({})", listed(&self.q))?;
        self.platform.map_or(Ok(()), |p| write!(f, ", platform at ({}) m", listed(&p)))
    }
}

/// Why the equations of motion go no further.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// The mechanism has lost rank.
    Rank,
    /// The numbers do not follow the equations any more.
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
    /// The desired motion cannot be taken.
    #[error("desired motion at t = {t:.4} s: {reason}")]
    Trajectory {
        /// Time, s.
        t: f64,
        /// What is wrong with the pose.
        reason: KinematicsError,
    },
    /// The mechanism ran into a singular pose or beyond any number.
    #[error("at t = {t:.4} s {cause}; last pose: {pose}")]
    Singular {
        /// Time, s.
        t: f64,
        /// Where it was last.
        pose: Pose,
        /// Why it went no further.
        cause: Cause,
    },
    /// A force law gave no number.
    #[error(transparent)]
    Law {
        /// Which law, when and where.
        source: KinematicsError,
    },
    /// Payload and effects make a body that cannot be.
    #[error("{body}: payload and effects leave it with an inertia that no body has")]
    Body {
        /// Its name.
        body: String,
    },
    /// The run needs what the machine does not have.
    #[error("{what} need struts and platform, which this machine does not have")]
    Missing {
        /// What needs them.
        what: &'static str,
    },
    /// The objects around the robot are impossible, or the gripper cannot do what it is told.
    #[error("t = {t:.4} s: {reason}")]
    Cell {
        /// Time, s.
        t: f64,
        /// What is wrong.
        reason: CellError,
    },
}
