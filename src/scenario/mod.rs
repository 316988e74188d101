//! What a run does: the desired motion of the end effector over time.

pub mod fourier;

pub use fourier::{FourierMotion, MotionLimits};
