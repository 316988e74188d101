//! Delay of the reported torque relative to the position.

use super::{About, Effect, Kind, Parameter, Part, Role, Sensor, Spec, Start, Unit, Values};
use crate::recording::{Signals, is_even};

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
        if is_even(&signals.t, step) {
            return signals.torques_mut().for_each(|tau| *tau = delayed(tau, values.one(0) / step).into());
        }
        let mut next = 0;
        let late = |t: &f64| place(&signals.t, t - values.one(0), &mut next);
        let places: Vec<f64> = signals.t.iter().map(late).collect();
        for tau in signals.torques_mut() {
            let source = std::mem::take(tau);
            tau.extend(places.iter().map(|x| between(&source, *x)));
        }
    }

    fn reach(&self, values: &Values) -> [f64; 2] {
        [values.one(0).max(0.0), (-values.one(0)).max(0.0)]
    }
}

/// Position of the time `t` among increasing times, as sample and share of the step after it; `next` is the last one's, and
/// the times asked for increase.
fn place(times: &[f64], t: f64, next: &mut usize) -> f64 {
    while *next + 2 < times.len() && times[*next + 1] <= t {
        *next += 1;
    }
    *next as f64 + (t - times[*next]) / (times[*next + 1] - times[*next])
}

/// Linear interpolation at sample position `x`, constant beyond the ends.
fn between(samples: &[f64], x: f64) -> f64 {
    let x = x.clamp(0.0, (samples.len() - 1) as f64);
    let k = (x as usize).min(samples.len() - 2);
    samples[k] + (x - k as f64) * (samples[k + 1] - samples[k])
}

/// A series `shift` samples later, by four-point Lagrange interpolation; constant beyond the ends.
fn delayed(samples: &[f64], shift: f64) -> Vec<f64> {
    let ends = |k: usize| interpolate(samples, k as f64 - shift);
    // All inner samples have the same weights, of the sample at `shift` rounded up and its neighbours.
    let back = shift.ceil();
    let weights = lagrange(1.0 + back - shift);
    let first = |k: usize| (k as f64 - back) as isize - 1;
    let is_inner = |k: usize| first(k) >= 0 && first(k) + 4 <= samples.len() as isize;
    let Some(begin) = (0..samples.len()).find(|&k| is_inner(k)) else { return (0..samples.len()).map(ends).collect() };
    let nodes = samples[first(begin) as usize..].windows(4).take(samples.len() - begin);
    let mut out: Vec<f64> = (0..begin).map(ends).collect();
    out.extend(nodes.map(|x| weights[0] * x[0] + weights[1] * x[1] + weights[2] * x[2] + weights[3] * x[3]));
    out.extend((out.len()..samples.len()).map(ends));
    out
}

/// Four-point Lagrange interpolation at sample position `x`, constant beyond the ends.
fn interpolate(samples: &[f64], x: f64) -> f64 {
    let last = samples.len() - 1;
    let x = x.clamp(0.0, last as f64);
    if last < 3 {
        return samples[x.round() as usize];
    }
    let first = (x.floor() as usize).saturating_sub(1).min(last - 3);
    lagrange(x - first as f64).iter().zip(&samples[first..first + 4]).map(|(w, x)| w * x).sum()
}

/// Weights Π_{j≠i} (s − j)/(i − j) of the nodes 0 to 3 at `s`.
fn lagrange(s: f64) -> [f64; 4] {
    let (lower, upper) = (s * (s - 1.0), (s - 2.0) * (s - 3.0));
    let (near, far) = (0.5 * upper, lower / 6.0);
    [near * (s - 1.0) / -3.0, near * s, 3.0 * far * (3.0 - s), far * (s - 2.0)]
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::ActiveEffect;
    use crate::machine::Mechanism;
    use crate::recording::Channel;

    #[test]
    fn times_that_are_not_even_count() {
        let t: Vec<f64> = (0..20).map(|k| 0.01 * (f64::from(k) + 0.3 * f64::from(k).sin())).collect();
        let tau = t.iter().map(|&t| 3.0 * t + 1.0).collect();
        let mut s = Signals::new(Mechanism::default(), t);
        s.set(Channel::Torque(2), tau);
        let active = ActiveEffect::new(Arc::new(SignalDelay), &[&[0.0137]]);
        SignalDelay.observe(&active.values(), &mut s);
        approx::assert_relative_eq!(s[Channel::Torque(2)][10], 3.0 * (s.t[10] - 0.0137) + 1.0, epsilon = 1e-12);
    }

    /// Inner samples share their weights; each is interpolated at its own place.
    #[test]
    fn samples_are_interpolated_at_their_places() {
        let samples: Vec<f64> = (0..9).map(|k| (0.7 * f64::from(k)).sin()).collect();
        for shift in [-12.5, -2.25, -1.0, 0.0, 0.4, 1.0, 3.75, 20.0] {
            let each: Vec<f64> = (0..9).map(|k| interpolate(&samples, f64::from(k) - shift)).collect();
            approx::assert_relative_eq!(delayed(&samples, shift)[..], each[..], epsilon = 1e-14);
            assert_eq!(delayed(&samples[..2], shift).len(), 2);
        }
    }

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
