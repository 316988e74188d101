//! The machine in absolute coordinates: fourteen bodies, 84 velocities, 74 constraint rows.
//!
//! While all sockets hold, `mechanism` solves the equations in closed form; from the first dislocation on `loose`
//! solves them for whatever joints are left; `axes` those of a robot taken apart or a lone axis. `integrator` steps each.

mod absolute;
mod assembled;
mod axes;
pub mod command;
pub mod constraints;
mod context;
pub mod controller;
pub mod energy;
mod forces;
mod integrator;
mod layout;
pub mod loose;
mod machine;
mod mechanism;
mod options;
mod reactions;
mod report;
mod sensors;
#[cfg(feature = "viewer")]
mod show;
mod simulate;
pub mod sockets;
mod state;
pub mod stops;
mod torque;
mod wrench;

pub use controller::Gains;
pub use machine::{Mark, Snapshot, Twin};
pub use options::Options;
pub use reactions::JointReactions;
pub use report::{Event, EventKind, Frame, Report, SimulationError};
pub use simulate::simulate;
pub use sockets::Clamps;
pub use state::BodyState;
pub use torque::Torque;
pub use wrench::{Load, Twist};

/// The mechanism has lost rank: a singular pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SingularPose;
