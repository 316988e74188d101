//! What the drives must give, and what the struts carry, for a given motion: inverse dynamics and its regressor.
//!
//! The regressor takes one wrench at a time to a drive torque or a strut force, by the virtual motion of that channel
//! ([`ChannelMap`]). The inverse dynamics takes all wrenches at once to what moves the machine, the transpose of the same
//! motions (`reduction`).

mod channels;
mod inverse;
mod newton_euler;
mod parameters;
mod plant;
mod reduction;

pub(crate) use channels::STILL;
pub use channels::{Channel, ChannelMap, Twist};
pub(crate) use inverse::add_regressor;
pub(crate) use inverse::{Borne, add_effects, borne, reads_loads, rigid_wrenches};
pub use inverse::{Output, Sample, inverse_dynamics, regressor};
pub use newton_euler::inertial_wrench;
pub use parameters::{ParamTable, PlantParameter};
pub use plant::{Plant, in_configuration, set_parameters};
