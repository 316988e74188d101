//! Delay of the reported torque relative to the position.

use super::{About, Effect, Kind, Parameter, Part, Role, Sensor, Spec, Start, Unit, Values};
use crate::recording::Signals;

/// Reported torque τ(t − d) with the same delay d (s) for all drives. It is negative where a command is reported that
/// acts later: a controller that holds its torque over a sampling period acts half a period after the command.
pub struct SignalDelay;

const PARAMETERS: &[Parameter] = &[Parameter::new("delay", Unit::S, Role::Linear, 0.001, (-0.05, 0.05))];

static SPEC: Spec = Spec::new(
    "signal_delay",
    Part::Drives,
    About {
        summary: "torque is reported late against position, or early if negative",
        law: "τ_reported(t) = τ(t − d)",
        shows: "residual in proportion to the torque's rate of change, on all axes",
        source: "communication and filter delays, a fraction of a millisecond to some milliseconds; commands are early",
    },
    PARAMETERS,
)
.kind(Kind::Sensor)
.starts({
    const fn late(delay: &'static [f64]) -> Start {
        Start([Some((0, delay)), None, None])
    }
    const STARTS: [Start; 5] = [late(&[0.0003]), late(&[0.001]), late(&[0.002]), late(&[0.004]), late(&[0.008])];
    &STARTS
});

impl Effect for SignalDelay {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn sensor(&self) -> Option<&dyn Sensor> {
        Some(self)
    }
}

impl Sensor for SignalDelay {
    fn observe(&self, values: &Values, signals: &mut Signals) {
        let step = signals.sample_time();
        if step <= 0.0 || values.one(0) == 0.0 {
            return;
        }
        let shift = values.one(0) / step;
        for tau in signals.torques_mut() {
            let source = std::mem::take(tau);
            tau.extend((0..source.len()).map(|k| interpolate(&source, k as f64 - shift)));
        }
    }

    fn reach(&self, values: &Values) -> [f64; 2] {
        [values.one(0).max(0.0), (-values.one(0)).max(0.0)]
    }
}

/// Four-point Lagrange interpolation at sample position `x`, constant beyond the ends.
fn interpolate(samples: &[f64], x: f64) -> f64 {
    let last = samples.len() - 1;
    let x = x.clamp(0.0, last as f64);
    if last < 3 {
        return samples[x.round() as usize];
    }
    let first = (x.floor() as usize).saturating_sub(1).min(last - 3);
    let s = x - first as f64;
    let weights: [f64; 4] =
        std::array::from_fn(|i| (0..4).filter(|&j| j != i).map(|j| (s - j as f64) / (i as f64 - j as f64)).product());
    (0..4).map(|i| weights[i] * samples[first + i]).sum()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::ActiveEffect;
    use crate::machine::Mechanism;
    use crate::recording::Channel;

    #[test]
    fn cubic_signals_are_shifted_exactly() {
        let cubic = |t: f64| 2.0 * t.powi(3) - t + 1.0;
        let t: Vec<f64> = (0..20).map(|k| k as f64 * 0.01).collect();
        let tau = t.iter().map(|&t| cubic(t)).collect();
        let mut s = Signals::new(Mechanism::default(), t);
        s.set(Channel::Torque(2), tau);
        let active = ActiveEffect::new(Arc::new(SignalDelay), &[&[0.0137]]);
        SignalDelay.observe(&active.values(), &mut s);
        approx::assert_relative_eq!(s[Channel::Torque(2)][10], cubic(0.1 - 0.0137), epsilon = 1e-12);
    }
}
