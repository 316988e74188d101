//! Kinematics of the delta robot and its relatives, and the complete [`Motion`] of their bodies.
//!
//! Nothing here depends on inertia.

mod arm;
mod closure;
pub mod delta;
mod home;
pub mod motion;
mod telescope;
mod tilt;

pub(crate) use arm::Arm;
pub use arm::Screw;
pub(crate) use closure::Closed;
pub use delta::{JointState, KinematicsError, LawFault, PlatformState, Target};
pub use home::Home;
pub use motion::{BodyMotion, Motion, Reactions, SocketSet};
pub use telescope::{HookeJoint, Telescope};
