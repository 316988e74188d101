//! The machine in absolute coordinates: fourteen bodies, 84 velocities, 74 constraint rows.

pub mod command;
pub mod constraints;
pub mod controller;
pub mod energy;
mod equations;
mod integrator;
pub mod loose;
mod simulate;
mod state;

pub use controller::Gains;
pub use equations::SingularPose;
pub use integrator::{accelerations, step};
pub use simulate::{Options, Report, SimulationError, simulate};
pub use state::{BodyState, State};
