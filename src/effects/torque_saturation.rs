//! Torque constant of the motors that falls with the current.

use super::{About, Count, Effect, Kind, Parameter, Part, Role, Sensor, Spec, Unit, Values};
use crate::recording::Signals;

/// Reported torque τ·(1 + κ·τ²): the nominal torque constant times a current that grows faster than the torque.
///
/// τ in N·m at the gear output, κ in 1/(N·m)², never negative. The leading term of a saturating iron path, odd in the
/// current: with the reported torque τ_r, τ = τ_r·(1 − κ·τ_r²) up to κ²·τ_r⁵.
pub struct TorqueSaturation;

const PARAMETERS: &[Parameter] =
    &[Parameter::new("saturation", Unit::PerNM2, Role::Linear, 1e-5, (0.0, 1e-3)).counted(Count::PerArm)];

static SPEC: Spec = Spec::new(
    "torque_saturation",
    Part::Drives,
    About {
        summary: "the torque constant of the arm motors falls with the current",
        law: "τ_reported,i = τ_i·(1 + κ_i·τ_i²)",
        shows: "residual of an arm in proportion to the cube of its torque, at the peaks alone",
        source: "saturation of permanent-magnet motors; 10–20 % at peak torque (estimate)",
    },
    PARAMETERS,
)
.kind(Kind::Sensor);

impl Effect for TorqueSaturation {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn sensor(&self) -> Option<&dyn Sensor> {
        Some(self)
    }
}

impl Sensor for TorqueSaturation {
    fn is_affine(&self) -> bool {
        false
    }

    fn observe(&self, values: &Values, signals: &mut Signals) {
        for (tau, saturation) in signals.torques_mut().zip(values.block(0)) {
            tau.iter_mut().for_each(|x| *x *= 1.0 + saturation * *x * *x);
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
    fn ten_percent_at_a_hundred_newton_metres() {
        // κ = 1e-5: 1 + 1e-5·100² = 1.1, 1 + 1e-5·20² = 1.004.
        let active = ActiveEffect::new(Arc::new(TorqueSaturation), &[&[1e-5, 1e-5, 0.0]]);
        let mut s = Signals::new(Mechanism::default(), vec![0.0]);
        s.set_rows(Channel::Torque, &[[100.0, -20.0, 100.0, 5.0]]);
        TorqueSaturation.observe(&active.values(), &mut s);
        approx::assert_relative_eq!(s.tau().at(0).as_slice(), [110.0, -20.08, 100.0, 5.0].as_slice(), epsilon = 1e-12);
    }
}
