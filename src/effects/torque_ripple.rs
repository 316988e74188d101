//! Torque ripple of the arm motors.

use super::{About, Count, Effect, Instant, MachineView, Parameter, Part, Role, Spec, Unit, Values, Wrenches};

/// Torque τ = Σ_h a_h·sin(h·n·q) + b_h·cos(h·n·q) (N·m) with harmonics h = 1, 2 and gear ratio n.
pub struct TorqueRipple;

/// Parameter blocks of the sine and cosine amplitudes, per harmonic.
const HARMONICS: [(usize, usize); 2] = [(0, 1), (2, 3)];
const GEAR_RATIO: usize = 4;

const fn amplitude(name: &'static str) -> Parameter {
    Parameter::new(name, Unit::NM, Role::Linear, 0.35, (-20.0, 20.0)).counted(Count::PerArm)
}

const PARAMETERS: &[Parameter] = &[
    amplitude("sine_1"),
    amplitude("cosine_1"),
    amplitude("sine_2"),
    amplitude("cosine_2"),
    Parameter::new("gear_ratio", Unit::GearRatio, Role::Fixed, 33.0, (1e-3, 1e5)),
];

static SPEC: Spec = Spec::new(
    "torque_ripple",
    Part::Drives,
    About {
        summary: "torque ripple of the arm motors over the motor angle",
        law: "τ_i = Σ_{h=1,2} a_h,i·sin(h·n·q_i) + b_h,i·cos(h·n·q_i), n the gear ratio",
        shows: "residual periodic in the joint angle with 360°/n",
        source: "cogging of servo motors, 0.2–1 N·m at the gear output (estimate)",
    },
    PARAMETERS,
)
.constants(constant);

fn constant(parameter: &str, model: &MachineView) -> Option<f64> {
    match parameter {
        "gear_ratio" => Some(model.drives[0].gear_ratio),
        _ => None,
    }
}

impl Effect for TorqueRipple {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        for (h, (sine, cosine)) in HARMONICS.into_iter().enumerate() {
            for axis in 0..values.len(sine) {
                let (s, c) = ((h + 1) as f64 * values.one(GEAR_RATIO) * at.motion.q[axis]).sin_cos();
                out.drive_torque(values.index(sine, axis), axis, s);
                out.drive_torque(values.index(cosine, axis), axis, c);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing;

    #[test]
    fn a_twelfth_of_a_motor_turn() {
        // Motor at 30°: sin 30° + cos 30° + sin 60° + cos 60° = 1 + √3.
        let mut motion = testing::still();
        motion.q[0] = std::f64::consts::PI / 6.0 / 33.0;
        let rest = testing::drive_torque(&TorqueRipple, &testing::still(), 0);
        approx::assert_relative_eq!(rest, 2.0);
        approx::assert_relative_eq!(
            testing::drive_torque(&TorqueRipple, &motion, 0),
            1.0 + 3f64.sqrt(),
            epsilon = 1e-12
        );
    }
}
