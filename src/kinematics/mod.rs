//! Closed-form kinematics of the delta robot, and the complete [`Motion`] of its bodies.
//!
//! Nothing here depends on inertia.

mod arm;
pub mod delta;
pub mod motion;
mod telescope;

pub(crate) use arm::Arm;
pub use arm::Screw;
pub use delta::{JointState, KinematicsError, LawFault, PlatformState, Target};
pub use motion::{BodyMotion, Motion, Reactions, SocketSet};
pub use telescope::{HookeJoint, Telescope};
