//! Offset of the reported drive torques.

use super::{About, Count, Effect, Kind, Parameter, Part, Role, Sensor, Spec, Unit, Values};
use crate::recording::Signals;

/// Reported torque τ + b; b in N·m at the gear output, either sign.
pub struct TorqueBias;

const PARAMETERS: &[Parameter] =
    &[Parameter::new("bias", Unit::NM, Role::Linear, 0.5, (-50.0, 50.0)).counted(Count::PerAxis)];

static SPEC: Spec = Spec::new(
    "torque_bias",
    Part::Drives,
    About {
        summary: "a drive reports its torque with a constant offset",
        law: "τ_reported,i = τ_i + b_i",
        shows: "constant residual of one axis, at rest as in motion; close to a base tilt",
        source: "offset of the current measurement, about 0.5 % of 132 N·m (estimate)",
    },
    PARAMETERS,
)
.kind(Kind::Sensor);

impl Effect for TorqueBias {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn sensor(&self) -> Option<&dyn Sensor> {
        Some(self)
    }
}

impl Sensor for TorqueBias {
    fn observe(&self, values: &Values, signals: &mut Signals) {
        for (tau, bias) in signals.torques_mut().zip(values.block(0)) {
            tau.iter_mut().for_each(|x| *x += bias);
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
    fn half_a_newton_metre_too_much() {
        let active = ActiveEffect::new(Arc::new(TorqueBias), &[&[0.5, 0.0, 0.0, -0.1]]);
        let mut s = Signals::new(Mechanism::default(), vec![0.0]);
        s.set_rows(Channel::Torque, &[[20.0, -20.0, 20.0, 2.0]]);
        TorqueBias.observe(&active.values(), &mut s);
        approx::assert_relative_eq!(s.tau().at(0).as_slice(), [20.5, -20.0, 20.0, 1.9].as_slice());
    }
}
