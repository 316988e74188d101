//! The machine in absolute coordinates: fourteen bodies, 84 velocities, 74 constraint rows.

mod equations;
mod integrator;
mod state;

pub use equations::SingularPose;
pub use state::{BodyState, State};
