//! Friction of cold drives that decays while they warm up.

use super::{About, Count, Effect, Instant, Parameter, Part, Role, STEEPNESS_PARAMETER, Values, Wrenches, smooth_sign};

/// τ = −x·(c_C·tanh(k q̇) + c_v·q̇) with the effect's own state ẋ = −x/T, x(0) = 1.
///
/// The parameters are the surplus of the cold drives over `drive_friction`, which describes the warm ones; c_C in N·m, c_v
/// in N·m·s/rad, T in s. Dissipates x·(c_C·q̇·tanh(k·q̇) + c_v·q̇²).
///
/// x starts from 1, cold, with every run of the twin, which integrates it beside its motion like any other state (T is
/// half a second at least: nothing steep), and with every recording in identification, which integrates it along the
/// recorded time, gaps included. Warming does not depend on how much the drives move. With the T of a real gear, half an
/// hour and more, a run of seconds sees constant friction: the default fits short runs.
pub struct ThermalFrictionDrift;

const COULOMB: usize = 0;
const VISCOUS: usize = 1;
const TIME: usize = 2;
const STEEPNESS: usize = 3;

impl Effect for ThermalFrictionDrift {
    fn name(&self) -> &'static str {
        "thermal_friction_drift"
    }

    fn acts_on(&self) -> Part {
        Part::Drives
    }

    fn about(&self) -> About {
        About {
            summary: "extra friction of cold arm drives that decays exponentially to the warm value",
            law: "τ_i = −x·(c_C,i·tanh(k·q̇_i) + c_v,i·q̇_i), dx/dt = −x/T, x(0) = 1",
            shows: "friction residual that shrinks over the run",
            source: "Bittencourt et al., IROS 2010: viscous −30 to −70 %, Coulomb −10 %, T 30–60 min",
        }
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[
            Parameter {
                name: "coulomb",
                unit: "N·m",
                count: Count::PerArm,
                role: Role::Linear,
                default: 0.4,
                range: (-50.0, 50.0),
            },
            Parameter {
                name: "viscous",
                unit: "N·m·s/rad",
                count: Count::PerArm,
                role: Role::Linear,
                default: 0.4,
                range: (-50.0, 50.0),
            },
            Parameter {
                name: "time_constant",
                unit: "s",
                count: Count::One,
                role: Role::Shape,
                default: 10.0,
                range: (0.5, 1e4),
            },
            STEEPNESS_PARAMETER,
        ]
    }

    fn initial_state(&self, _values: &Values) -> Vec<f64> {
        vec![1.0]
    }

    fn state_rate(&self, values: &Values, at: &Instant, rate: &mut [f64], _slope: &mut [f64]) {
        rate[0] = -at.state[0] / values.one(TIME);
    }

    fn forces(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        let cold = at.state[0];
        for axis in 0..values.len(COULOMB) {
            let rate = at.motion.qd[axis];
            let coulomb = -cold * smooth_sign(rate, values.one(STEEPNESS));
            out.drive_torque(values.index(COULOMB, axis), axis, coulomb);
            out.drive_torque(values.index(VISCOUS, axis), axis, -cold * rate);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing;

    #[test]
    fn half_warm_drive_has_half_the_extra_friction() {
        let mut motion = testing::still();
        motion.qd[0] = 3.0;
        // −0.5·(tanh(300) + 3) = −2
        let torque: f64 = testing::wrenches_in_state(&ThermalFrictionDrift, &motion, &[0.5])
            .iter()
            .filter(|(_, body, ..)| *body == 0)
            .map(|(.., moment)| moment.y)
            .sum();
        approx::assert_relative_eq!(torque, -2.0, epsilon = 1e-12);
    }
}
