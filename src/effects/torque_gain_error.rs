//! Gain error of the reported drive torques, e.g. from a wrong torque constant.

use super::{About, Count, Effect, Kind, Parameter, Part, Role, Sensor, Spec, Unit, Values};
use crate::recording::Signals;

/// Reported torque (1 + g)·τ; g dimensionless.
pub struct TorqueGainError;

const PARAMETERS: &[Parameter] =
    &[Parameter::new("gain", Unit::One, Role::Linear, 0.05, (-0.9, 9.0)).counted(Count::PerAxis)];

static SPEC: Spec = Spec::new(
    "torque_gain_error",
    Part::Drives,
    About {
        summary: "a drive reports its torque with a wrong factor",
        law: "τ_reported,i = (1 + g_i)·τ_i",
        shows: "residual of one axis in proportion to its torque",
        source: "tolerance of torque constants, a few percent (estimate)",
    },
    PARAMETERS,
)
.kind(Kind::Sensor);

impl Effect for TorqueGainError {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn sensor(&self) -> Option<&dyn Sensor> {
        Some(self)
    }
}

impl Sensor for TorqueGainError {
    fn observe(&self, values: &Values, signals: &mut Signals) {
        for (tau, gain) in signals.torques_mut().zip(values.block(0)) {
            tau.iter_mut().for_each(|x| *x *= 1.0 + gain);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::ActiveEffect;
    use crate::machine::Mechanism;
    use crate::recording::Channel;

    #[test]
    fn five_percent_of_twenty_newton_metres() {
        let active = ActiveEffect::new(Arc::new(TorqueGainError), &[&[0.05, 0.0, 0.0, -0.5]]);
        let mut s = Signals::new(Mechanism::default(), vec![0.0]);
        s.set_rows(Channel::Torque, &[[20.0, 20.0, 20.0, 2.0]]);
        TorqueGainError.observe(&active.values(), &mut s);
        approx::assert_relative_eq!(s.tau().at(0).as_slice(), [21.0, 20.0, 20.0, 1.0].as_slice());
    }
}
