//! Low-pass filter of the reported torque.

use super::{About, Effect, Kind, Parameter, Part, Role, Sensor, Spec, Start, Unit, Values};
use crate::recording::Signals;

/// Reported torque y with T·ẏ + y = τ, the same time constant T (s) for all drives; at the start of a recording y = τ.
///
/// Exact for torques that are linear between samples.
pub struct TorqueFilter;

const PARAMETERS: &[Parameter] = &[Parameter::new("time_constant", Unit::S, Role::Linear, 0.002, (0.0, 0.1))];

static SPEC: Spec = Spec::new(
    "torque_filter",
    Part::Drives,
    About {
        summary: "torque is reported through a low-pass filter",
        law: "T·ẏ + y = τ, y the reported torque",
        shows: "residual in proportion to the torque's rate of change on all axes, friction steps rounded off",
        source: "first-order filters of current measurements, 0.5–20 ms (estimate)",
    },
    PARAMETERS,
)
.kind(Kind::Sensor)
.starts({
    const fn slow(time_constant: &'static [f64]) -> Start {
        Start([Some((0, time_constant)), None, None])
    }
    const STARTS: [Start; 6] =
        [slow(&[0.0005]), slow(&[0.001]), slow(&[0.002]), slow(&[0.005]), slow(&[0.01]), slow(&[0.02])];
    &STARTS
});

/// Time constants after which the initial value is below rounding.
const FORGOTTEN: f64 = 37.0;

impl Effect for TorqueFilter {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn sensor(&self) -> Option<&dyn Sensor> {
        Some(self)
    }
}

impl Sensor for TorqueFilter {
    fn observe(&self, values: &Values, signals: &mut Signals) {
        let time_constant = values.one(0);
        if time_constant <= 0.0 {
            return;
        }
        let steps: Vec<_> = signals.t.windows(2).map(|t| LowPassStep::new(t[1] - t[0], time_constant)).collect();
        for tau in signals.torques_mut().filter(|tau| !tau.is_empty()) {
            let (mut input, mut output) = (tau[0], tau[0]);
            for (step, tau) in steps.iter().zip(tau.iter_mut().skip(1)) {
                output = step.output(output, [input, *tau]);
                input = std::mem::replace(tau, output);
            }
        }
    }

    fn memory(&self, values: &Values) -> f64 {
        FORGOTTEN * values.one(0)
    }
}

/// Step of a first-order low-pass T·ẏ + y = u, exact for an input that is linear in time.
#[derive(Clone, Copy, Debug)]
pub struct LowPassStep {
    /// e^(−h/T).
    decay: f64,
    /// (1 − e^(−h/T))·T/h.
    share: f64,
}

impl LowPassStep {
    /// Step of `duration` h (s, not negative) of a filter with `time_constant` T (s, positive).
    pub fn new(duration: f64, time_constant: f64) -> Self {
        let x = (duration / time_constant).max(0.0);
        Self { decay: (-x).exp(), share: if x > 0.0 { -(-x).exp_m1() / x } else { 1.0 } }
    }

    /// Output after the step from `output`, for an input from `start` to `end`.
    pub fn output(&self, output: f64, [start, end]: [f64; 2]) -> f64 {
        self.decay * output + (self.share - self.decay) * start + (1.0 - self.share) * end
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::ActiveEffect;
    use crate::machine::Mechanism;
    use crate::recording::Channel;

    fn filtered(t: Vec<f64>, tau: impl Fn(f64) -> f64, time_constant: f64) -> Signals {
        let values: Vec<_> = t.iter().map(|&t| [tau(t); 4]).collect();
        let mut s = Signals::new(Mechanism::default(), t);
        s.set_rows(Channel::Torque, &values);
        let active = ActiveEffect::new(Arc::new(TorqueFilter), &[&[time_constant]]);
        TorqueFilter.observe(&active.values(), &mut s);
        s
    }

    /// The response to a ramp u = 5 + 30·t from its steady start is u − 30·T·(1 − e^(−t/T)), whatever the steps.
    #[test]
    fn a_ramp_comes_late_by_the_time_constant() {
        let t = vec![0.0, 0.001, 0.0035, 0.004, 0.009, 0.03, 0.1];
        for time_constant in [1e-4, 0.002, 0.02] {
            let s = filtered(t.clone(), |t| 5.0 + 30.0 * t, time_constant);
            for (t, tau) in s.t.iter().zip(s.tau().iter()) {
                let late = 30.0 * time_constant * -(-t / time_constant).exp_m1();
                approx::assert_relative_eq!(tau[3], 5.0 + 30.0 * t - late, epsilon = 1e-13);
            }
        }
    }

    #[test]
    fn filters_that_are_much_faster_than_the_samples_change_little() {
        let t: Vec<f64> = (0..50).map(|k| 1e-3 * f64::from(k)).collect();
        let s = filtered(t.clone(), |t| (300.0 * t).sin(), 1e-9);
        for (t, tau) in t.iter().zip(s.tau().iter()) {
            approx::assert_relative_eq!(tau[0], (300.0 * t).sin(), epsilon = 1e-6);
        }
    }
}
