//! The torque constant of a drive is wrong.

use super::{About, Count, Effect, Kind, Parameter, Part, Role, Unit, Values};
use crate::recording::Signals;

/// Reported torque (1 + g)·τ.
pub struct TorqueGainError;

impl Effect for TorqueGainError {
    fn name(&self) -> &'static str {
        "torque_gain_error"
    }

    fn acts_on(&self) -> Part {
        Part::Drives
    }

    fn about(&self) -> About {
        About {
            summary: "a drive reports its torque with a wrong factor",
            law: "τ_reported,i = (1 + g_i)·τ_i",
            shows: "residual of one axis in proportion to its torque",
            source: "tolerance of torque constants, a few percent (estimate)",
        }
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[Parameter {
            name: "gain",
            unit: Unit::One,
            count: Count::PerAxis,
            role: Role::Linear,
            default: 0.05,
            range: (-0.9, 9.0),
        }]
    }

    fn kind(&self) -> Kind {
        Kind::Sensor
    }

    fn observe(&self, values: &Values, signals: &mut Signals) {
        for tau in &mut signals.tau {
            for (x, gain) in tau.iter_mut().zip(values.block(0)) {
                *x *= 1.0 + gain;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::ActiveEffect;

    #[test]
    fn five_percent_of_twenty_newton_metres() {
        let active = ActiveEffect::new(&TorqueGainError, &[&[0.05, 0.0, 0.0, -0.5]]);
        let mut s = Signals { tau: vec![[20.0, 20.0, 20.0, 2.0]], ..Signals::default() };
        TorqueGainError.observe(&active.values(), &mut s);
        approx::assert_relative_eq!(s.tau[0].as_slice(), [21.0, 20.0, 20.0, 1.0].as_slice());
    }
}
