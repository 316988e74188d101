//! Kinematics of the delta robot and its relatives, and the complete [`Motion`] of their bodies.
//!
//! Nothing here depends on inertia.

mod arm;
mod closure;
pub mod delta;
mod home;
pub mod motion;
mod plate;
mod telescope;
mod tilt;

pub(crate) use arm::Arm;
pub use arm::Screw;
pub(crate) use closure::Closed;
pub use delta::{JointState, KinematicsError, LawFault, PlatformState, Target};
pub use home::Home;
pub(crate) use motion::STILL;
pub use motion::{BodyMotion, Motion, Reactions, SocketSet, Twist};
pub(crate) use plate::{PlateMotions, without_prestress};
pub use telescope::{HookeJoint, Telescope};
