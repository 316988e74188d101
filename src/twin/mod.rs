//! The machine in motion: fourteen bodies, 84 velocities, 74 constraint rows.
//!
//! Two formulations of the same equations. `absolute` integrates all bodies with all rows, which `maximal` solves for whatever
//! joints hold. `assembled` integrates what is left when the rows are eliminated, which `mechanism` does in closed form while
//! all sockets hold; `axes` is that for a robot taken apart or a lone axis. `integrator` steps each. The eliminated form is the
//! default, being the faster one; from the first dislocation on every run is in absolute coordinates.

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
mod wrench;

pub use contacts::{ContactBody, ContactWork, Contacts, Held, NewContacts, Surroundings, Touch};
pub use controller::Gains;
pub use machine::{Checkpoint, Snapshot, Twin};
pub use options::{Options, Watcher};
pub use reactions::JointReactions;
pub use report::{Cause, Event, EventKind, Frame, LARGEST_ENERGY_ERROR, Pose, Report, SimulationError};
pub use simulate::{simulate, simulate_until_failure};
pub use sockets::Clamps;
pub use state::BodyState;
pub use torque::Torque;
pub use wrench::{Load, Twist};

/// The mechanism has lost rank: a singular pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SingularPose;
