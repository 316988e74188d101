//! Pre-sliding hysteresis of the arm drives: lost motion at reversals.

use super::{
    About, Count, Effect, Instant, InternalStates, Parameter, Part, Role, Spec, Unit, Values, Wrenches, presliding,
};

/// τ_i = −T_i·z_i with the internal state z_i of [`presliding`] over the angle δ, z_i(0) = 0.
///
/// T in N·m, never negative; δ in rad. In sliding the law is Coulomb friction T, near a reversal a spring T/δ. A cycle of
/// amplitude A ≫ δ dissipates 4·T·(A − δ). The torque returns at most the energy T·δ·z²/2 stored in the spring.
pub struct BacklashHysteresis;

const MOMENT: usize = 0;
const ANGLE: usize = 1;

/// Default of δ, rad: 1.5 arc minutes.
const LOST_MOTION: f64 = 4.363e-4;

const PARAMETERS: &[Parameter] = &[
    Parameter::new("moment", Unit::NM, Role::Linear, 1.5, (0.0, 50.0)).counted(Count::PerArm),
    Parameter::new("angle", Unit::Rad, Role::Shape, LOST_MOTION, (1e-5, 0.05)),
];

static SPEC: Spec = Spec::new(
    "backlash_hysteresis",
    Part::Drives,
    About {
        summary: "pre-sliding hysteresis of the arm drives around reversals",
        law: "τ_i = −T_i·z_i, dz_i/dt = (q̇_i − |q̇_i|·z_i)/δ, z_i(0) = 0",
        shows: "friction that changes sign over an angle after a reversal instead of at once, alike at every speed",
        source: "Dahl, 1968; lost motion of gears 0.5–3 minutes of arc, worn 6 (data sheets ≤ 3); T an estimate",
    },
    PARAMETERS,
)
// From lost motion (arc minutes) to elastic transmissions (degrees).
.grids(&[&[0.5, 2.0, 8.0, 30.0, 100.0]]);

impl Effect for BacklashHysteresis {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        for i in 0..values.len(MOMENT) {
            out.drive_torque(values.index(MOMENT, i), i, -at.state[i]);
        }
    }

    fn states(&self) -> Option<&dyn InternalStates> {
        Some(self)
    }
}

impl InternalStates for BacklashHysteresis {
    fn initial_state(&self, values: &Values) -> Vec<f64> {
        vec![0.0; values.block(MOMENT).len()]
    }

    fn state_rate(&self, values: &Values, at: &Instant, rate: &mut [f64], slope: &mut [f64]) {
        let angle = values.one(ANGLE);
        for i in 0..rate.len() {
            (rate[i], slope[i]) = presliding(at.state[i], at.motion.qd[i], angle);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::{ActiveEffect, testing};

    /// z of arm 1 after moving through `angles` at `speed` rad/s from state `z`, and ∫z dq, by the midpoint rule.
    fn moved(mut z: f64, angles: &[f64], speed: f64) -> (f64, f64) {
        let active = ActiveEffect::new(Arc::new(BacklashHysteresis), &[&[1.0; 3], &[1e-3]]);
        let mut area = 0.0;
        for leg in angles {
            let steps = 20_000;
            let h = leg.abs() / speed / f64::from(steps);
            let mut motion = testing::still();
            motion.qd[0] = speed * leg.signum();
            let rate = |z: f64| {
                let (mut rate, mut slope) = ([0.0; 3], [0.0; 3]);
                testing::at(&motion, &[z, 0.0, 0.0], |at| {
                    BacklashHysteresis.state_rate(&active.values(), at, &mut rate, &mut slope);
                });
                // speed/δ
                approx::assert_relative_eq!(slope[0], -speed / 1e-3);
                rate[0]
            };
            for _ in 0..steps {
                let middle = z + 0.5 * h * rate(z);
                z += h * rate(middle);
                area += middle * motion.qd[0] * h;
            }
        }
        (z, area)
    }

    #[test]
    fn moment_is_against_the_bristle() {
        let motion = testing::still();
        let w = testing::wrenches_in_state(&BacklashHysteresis, &motion, &[0.25, -0.5, 0.0]);
        let torque = |arm: usize| -> f64 {
            let (body, screw) = motion.drive(arm);
            w.iter().filter(|(_, b, ..)| *b == body).map(|(.., m)| m.dot(&screw.angular)).sum()
        };
        approx::assert_relative_eq!(torque(0), -0.25);
        approx::assert_relative_eq!(torque(1), 0.5, epsilon = 1e-15);
    }

    #[test]
    fn one_direction_follows_the_exponential() {
        // From rest through δ: 1 − e⁻¹; after sliding, back through 2δ: −1 + 2·e⁻².
        approx::assert_relative_eq!(moved(0.0, &[1e-3], 2.0).0, 1.0 - (-1f64).exp(), epsilon = 1e-7);
        approx::assert_relative_eq!(moved(1.0, &[-2e-3], 2.0).0, -1.0 + 2.0 * (-2f64).exp(), epsilon = 1e-7);
    }

    #[test]
    fn hysteresis_does_not_depend_on_speed() {
        let path = [0.7e-3, -1.1e-3, 0.4e-3, -0.2e-3];
        let slow = moved(0.0, &path, 1e-3);
        let fast = moved(0.0, &path, 10.0);
        approx::assert_relative_eq!(slow.0, fast.0, epsilon = 1e-12);
        approx::assert_relative_eq!(slow.1, fast.1, epsilon = 1e-12);
    }

    #[test]
    fn loop_costs_four_moments_times_amplitude_less_angle() {
        // Amplitude 20 mrad, δ = 1 mrad, T = 1 N·m: ∮ z dq = 4·(0.020 − 0.001) = 0.076 J, up to e⁻⁴⁰.
        let (z, area) = moved(-1.0, &[0.04, -0.04], 1.0);
        approx::assert_relative_eq!(z, -1.0, epsilon = 1e-9);
        approx::assert_relative_eq!(area, 0.076, epsilon = 1e-7);
    }
}
