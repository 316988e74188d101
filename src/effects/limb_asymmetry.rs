//! Mass differences between the struts and between the arms.

use super::{About, Count, Effect, Kind, MachineView, Parameter, Part, Role, Spec, Unit, Values};
use crate::machine::Inertia;
use crate::machine::Payload;
use crate::machine::bodies::{arm, strut};

/// Additional mass Δm of single struts and arms, uniform along them: m·c_x = Δm·l/2, Θ_yy = Θ_zz = Δm·l²/3.
///
/// Δm in kg, either sign; l in m, ball to ball or shaft to elbow. Of a carriage, l = 0.
pub struct LimbAsymmetry;

const STRUT_MASS: usize = 0;
const ARM_MASS: usize = 1;
const STRUT_LENGTH: usize = 2;
const ARM_LENGTH: usize = 3;

const fn length(name: &'static str, default: f64) -> Parameter {
    Parameter::new(name, Unit::M, Role::Fixed, default, (0.0, 10.0))
}

const PARAMETERS: &[Parameter] = &[
    Parameter::new("strut", Unit::Kg, Role::Linear, 0.1, (-0.1, 10.0)).counted(Count::PerStrut),
    Parameter::new("arm", Unit::Kg, Role::Linear, 0.1, (-0.5, 10.0)).counted(Count::PerArm),
    length("strut_length", 1.106),
    length("arm_length", 0.5),
];

/// Inertia of a uniform rod of 1 kg along x from the origin, `length` in m.
fn rod(length: f64) -> Inertia {
    let inertia = length * length / 3.0;
    Inertia::diagonal(1.0, [0.5 * length, 0.0, 0.0], [0.0, inertia, inertia])
}

static SPEC: Spec = Spec::new(
    "limb_asymmetry",
    Part::Linkage,
    About {
        summary: "a strut or an arm is heavier or lighter than the others",
        law: "Δm per strut and arm as an even rod: first moment Δm·l/2, inertia Δm·l²/3 about its upper joint",
        shows: "torque of that limb's drive with acceleration and weight; of both struts of a pair alike",
        source: "the paper's measurement strut of 340 g in place of 179 g",
    },
    PARAMETERS,
)
.kind(Kind::Inertia)
.constants(constant);

fn constant(parameter: &str, model: &MachineView) -> Option<f64> {
    match parameter {
        "strut_length" => Some(model.geometry.limbs[0].strut_length),
        "arm_length" => Some(model.geometry.limbs[0].arm_length),
        _ => None,
    }
}

impl Effect for LimbAsymmetry {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn inertia(&self, values: &Values, _payload: &Payload, out: &mut dyn FnMut(usize, usize, Inertia)) {
        for s in 0..values.block(STRUT_MASS).len() {
            out(values.index(STRUT_MASS, s), strut(s), rod(values.one(STRUT_LENGTH)));
        }
        for limb in 0..values.block(ARM_MASS).len() {
            out(values.index(ARM_MASS, limb), arm(limb), rod(values.one(ARM_LENGTH)));
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::ActiveEffect;

    #[test]
    fn the_measurement_strut() {
        // 0.34 − 0.179 = 0.161 kg on 1.2 m: 0.0966 kg·m, 0.161·1.44/3 = 0.07728 kg·m².
        let mut masses = [0.0; 6];
        masses[3] = 0.161;
        let active = ActiveEffect::new(Arc::new(LimbAsymmetry), &[&masses, &[0.0; 3], &[1.2], &[0.5]]);
        let mut sum = Inertia::ZERO;
        LimbAsymmetry.inertia(&active.values(), &Payload::default(), &mut |k, body, unit| {
            if active.values[k] != 0.0 {
                assert_eq!(body, strut(3));
                sum += unit * active.values[k];
            }
        });
        approx::assert_relative_eq!(sum.mass, 0.161);
        approx::assert_relative_eq!(sum.first_moment.x, 0.0966, epsilon = 1e-15);
        approx::assert_relative_eq!(sum.tensor[(1, 1)], 0.07728, epsilon = 1e-15);
        approx::assert_relative_eq!(sum.tensor[(2, 2)], 0.07728, epsilon = 1e-15);
    }
}
