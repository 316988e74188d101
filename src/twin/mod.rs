//! Simulation of the machine: fourteen bodies, 84 velocities, 74 constraint rows.
//!
//! There are two formulations of the same equations. `absolute` integrates all bodies with all rows, which `maximal`
//! solves for any set of closed joints. `assembled` integrates the coordinates that remain after the elimination of the
//! rows, in closed form by `closed`, while all sockets are closed; `axes` is its counterpart for a disassembled robot
//! or a single axis. `integrator` advances each of them. The eliminated form is the default because it is faster; from
//! the first dislocation on every run is in absolute coordinates.

mod absolute;
mod assembled;
mod axes;
mod closed;
pub mod constraints;
mod contacts;
mod context;
pub mod controller;
pub mod energy;
mod forces;
mod integrator;
mod layout;
mod machine;
pub mod maximal;

mod options;
pub mod origin;
mod reactions;
mod report;
mod rod;
mod sensors;
mod simulate;
pub mod sockets;
mod state;
pub mod stops;
mod torque;
mod trace;
mod wrench;

pub use contacts::{Block, ContactBody, ContactWork, Contacts, Held, NewContacts, Resistance, Surroundings, Touch};
pub use controller::Gains;
pub use machine::{Checkpoint, Snapshot, Twin};
pub use options::{Options, Watcher};
pub use reactions::JointReactions;
pub use report::{Cause, Event, EventKind, Frame, LARGEST_ENERGY_ERROR, Pose, Report, SimulationError};
pub use simulate::{Piece, Receiver, setup_of_run, simulate, simulate_into, simulate_until_failure};
pub use sockets::Clamps;
pub use state::BodyState;
pub use torque::Torque;
pub use trace::{Dislocation, Impact, Sample, TripCause};
pub use wrench::{Load, Twist};

/// The equations cannot be solved: the mechanism has lost rank (a singular pose), or an inertia is not consistent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SingularPose;
