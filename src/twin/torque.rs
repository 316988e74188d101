//! Drive torques over a control period.

use crate::machine::{PerAxis, each};

/// Drive torques linear in time, N·m at the gear output.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Torque {
    /// Time of `start`, s.
    pub since: f64,
    /// Torques at `since`, N·m.
    pub start: PerAxis<f64>,
    /// Rates, N·m/s.
    pub rate: PerAxis<f64>,
}

impl Torque {
    /// Constant torques.
    pub fn constant(torque: PerAxis<f64>) -> Self {
        Self { since: 0.0, start: torque, rate: each(0.0) }
    }

    /// Torques that change linearly from `start` to `end` within `period` seconds.
    pub fn ramp(since: f64, start: PerAxis<f64>, end: PerAxis<f64>, period: f64) -> Self {
        Self { since, start, rate: std::array::from_fn(|i| (end[i] - start[i]) / period) }
    }

    /// Torques at time `t` (s).
    pub fn at(&self, t: f64) -> PerAxis<f64> {
        std::array::from_fn(|i| self.start[i] + self.rate[i] * (t - self.since))
    }
}
