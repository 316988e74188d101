//! Closed-form inverse and forward kinematics.
/// placeholder
pub struct JointState;
/// placeholder
pub struct PlatformState;
/// placeholder
pub struct KinematicsError;
