//! Inverse dynamics: drive torques and strut forces for a given motion, and the regressor.
//!
//! The regressor projects one wrench at a time onto a channel, by the virtual motion of that channel ([`ChannelMap`]).
//! The inverse dynamics reduces the sum of all wrenches to the generalised coordinates, by the transpose of the same
//! motions (`reduction`).

mod channels;
mod feedback;
mod inverse;
mod newton_euler;
mod parameters;
mod plant;
mod reduction;

pub use channels::ChannelMap;
pub(crate) use feedback::Feedback;
pub(crate) use inverse::add_regressor;
pub(crate) use inverse::{
    Borne, LoadCourse, add_effects, balance, ball_forces, borne, loaded_wrenches, reads_loads, rigid_wrenches,
};
pub use inverse::{
    Output, Sample, SocketLoads, inverse_dynamics, regressor, steady_inverse_dynamics, steady_socket_loads,
};
pub(crate) use newton_euler::accelerated_wrench;
pub use newton_euler::inertial_wrench;
pub use parameters::{ParamTable, PlantParameter};
pub use plant::{Plant, in_configuration, set_parameters};
pub(crate) use reduction::join_end_effector;
