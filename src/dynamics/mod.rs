//! What the drives must give, and what the struts carry, for a given motion: inverse dynamics and its regressor.
//!
//! There is one inverse dynamics. Every wrench on a body reaches a drive torque or a strut force through the same
//! [`ChannelMap`], so the regressor is the inverse dynamics of one parameter at a time.

mod channels;
mod inverse;
mod newton_euler;
mod plant;

pub(crate) use channels::STILL;
pub use channels::{Channel, ChannelMap, Twist};
pub(crate) use inverse::add_regressor;
pub(crate) use inverse::{MAX_REACTION_ITERATIONS, add_effects, reads_loads, rigid_wrenches};
pub use inverse::{Output, inverse_dynamics, regressor};
pub use newton_euler::inertial_wrench;
pub use plant::{Plant, PlantParameter, in_configuration, set_parameters};
