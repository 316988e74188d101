//! Drive torques over a control period.

use crate::machine::AXES;

/// Drive torques linear in time, N·m at the gear output.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Torque {
    /// Time of `start`, s.
    pub since: f64,
    /// Torques at `since`, N·m.
    pub start: [f64; AXES],
    /// Rates, N·m/s.
    pub rate: [f64; AXES],
}

impl Torque {
    /// Constant torques.
    pub fn constant(torque: [f64; AXES]) -> Self {
        Self { since: 0.0, start: torque, rate: [0.0; AXES] }
    }

    /// Torques that change linearly from `start` to `end` within `period` seconds.
    pub fn ramp(since: f64, start: [f64; AXES], end: [f64; AXES], period: f64) -> Self {
        Self { since, start, rate: std::array::from_fn(|i| (end[i] - start[i]) / period) }
    }

    /// Torques at time `t` (s).
    pub fn at(&self, t: f64) -> [f64; AXES] {
        std::array::from_fn(|i| self.start[i] + self.rate[i] * (t - self.since))
    }
}
