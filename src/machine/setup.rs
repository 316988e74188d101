//! State of the machine during a run.

use super::{AXES, Payload};

/// What is known about a run beside its signals.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Setup {
    /// Assembled robot or arms and rotor alone.
    pub configuration: Configuration,
    /// Payload at the flange.
    pub payload: Payload,
    /// Standard deviation of the torque sensors, N·m; zero where it is not known, as of axes that are not there.
    pub torque_noise: Option<[f64; AXES]>,
}

/// State of the machine during a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Configuration {
    /// Complete robot.
    #[default]
    Assembled,
    /// Arms and motor 4 only, struts, platform and telescope dismounted.
    Disassembled,
}
