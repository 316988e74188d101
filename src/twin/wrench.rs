//! External wrenches.

use crate::kinematics::Motion;
pub(super) use crate::kinematics::STILL;
pub use crate::kinematics::Twist;
use crate::machine::bodies::SLOTS;

/// External wrenches on all bodies, linear in time.
#[derive(Clone, Debug, PartialEq)]
pub struct Load {
    /// Time of `start`, s.
    pub since: f64,
    /// Wrenches at `since`, N and N·m.
    pub start: [Twist; SLOTS],
    /// Rates, N/s and N·m/s.
    pub rate: [Twist; SLOTS],
    nothing: bool,
}

impl Load {
    /// No wrenches.
    pub const NONE: Self = Self { since: 0.0, start: [STILL; SLOTS], rate: [STILL; SLOTS], nothing: true };

    /// Constant wrenches.
    pub fn constant(wrenches: [Twist; SLOTS]) -> Self {
        Self { start: wrenches, nothing: false, ..Self::NONE }
    }

    /// Wrenches that change linearly from `start` to `end` within `h` seconds.
    pub fn ramp(since: f64, start: &[Twist; SLOTS], end: &[Twist; SLOTS], h: f64) -> Self {
        let rate = std::array::from_fn(|b| ((end[b].0 - start[b].0) / h, (end[b].1 - start[b].1) / h));
        Self { since, start: *start, rate, nothing: false }
    }

    /// Whether there are no wrenches.
    pub fn is_none(&self) -> bool {
        self.nothing
    }

    /// Wrenches at time `t` (s).
    pub fn at(&self, t: f64) -> [Twist; SLOTS] {
        let s = t - self.since;
        std::array::from_fn(|b| (self.start[b].0 + self.rate[b].0 * s, self.start[b].1 + self.rate[b].1 * s))
    }

    /// Power on the bodies at time `t` (s), W.
    pub fn power(&self, t: f64, motion: &Motion) -> f64 {
        self.at(t).iter().zip(&motion.bodies).map(|(w, m)| w.0.dot(&m.velocity) + w.1.dot(&m.angular_velocity)).sum()
    }
}
