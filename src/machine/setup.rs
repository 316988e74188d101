//! Configuration and payload of the machine during a run.

use super::{Load, Payload, PerAxis};

/// Known conditions of a run besides its signals.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Setup {
    /// Assembled robot, or arms and rotor alone.
    pub configuration: Configuration,
    /// Payload at the flange.
    pub payload: Payload,
    /// Known load of a single axis, where none was measured.
    pub load: Load,
    /// Standard deviation of the torque noise per axis, N·m; zero for an axis without a known value.
    pub torque_noise: Option<PerAxis<f64>>,
}

/// Configuration of the machine during a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Configuration {
    /// Complete robot.
    #[default]
    Assembled,
    /// Arms and motor 4 only; struts, platform and telescope dismounted.
    Disassembled,
}
