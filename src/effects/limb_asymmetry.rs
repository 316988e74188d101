//! Mass differences between the struts and between the arms.

use super::{About, Count, Effect, Kind, MachineView, Parameter, Part, Role, Spec, Unit, Values};
use crate::machine::Inertia;
use crate::machine::Payload;
use crate::machine::bodies::{STRUT, arm, strut};

/// Additional mass Δm of single struts and arms: m·c_x = Δm·c·l, Θ_yy = Θ_zz = Δm·(k·l)² about the upper joint.
///
/// Δm in kg, either sign; l in m, ball to ball or shaft to elbow (0 of a carriage); c (centre of mass) and k (radius of
/// gyration) relative to l: of a strut those of the machine's struts, as of one with thicker walls or heavier ends; of an
/// arm, whose inertia contains the drive's, those of a uniform rod, 1/2 and 1/√3.
pub struct LimbAsymmetry;

const STRUT_MASS: usize = 0;
const ARM_MASS: usize = 1;
const STRUT_LENGTH: usize = 2;
const ARM_LENGTH: usize = 3;
const STRUT_CENTER: usize = 4;
const STRUT_GYRATION: usize = 5;

/// Centre of mass and radius of gyration of a uniform rod relative to its length.
const ROD: [f64; 2] = [0.5, 0.577_350_269_189_625_8];

const fn length(name: &'static str, default: f64) -> Parameter {
    Parameter::new(name, Unit::M, Role::Fixed, default, (0.0, 10.0))
}

const fn share(name: &'static str, default: f64) -> Parameter {
    Parameter::new(name, Unit::One, Role::Fixed, default, (0.0, 1.0))
}

const PARAMETERS: &[Parameter] = &[
    Parameter::new("strut", Unit::Kg, Role::Linear, 0.1, (-0.1, 10.0)).counted(Count::PerStrut),
    Parameter::new("arm", Unit::Kg, Role::Linear, 0.1, (-0.5, 10.0)).counted(Count::PerArm),
    length("strut_length", 1.106),
    length("arm_length", 0.5),
    share("strut_center", ROD[0]),
    share("strut_gyration", ROD[1]),
];

/// Inertia of 1 kg along x from the origin, `length` in m, with its centre and radius of gyration relative to that.
fn slender(length: f64, [center, gyration]: [f64; 2]) -> Inertia {
    let inertia = (gyration * length).powi(2);
    Inertia::diagonal(1.0, [center * length, 0.0, 0.0], [0.0, inertia, inertia])
}

static SPEC: Spec = Spec::new(
    "limb_asymmetry",
    Part::Linkage,
    About {
        summary: "a strut or an arm is heavier or lighter than the others",
        law: "Δm per strut, distributed as the struts' own mass, and per arm, as an even rod",
        shows: "torque of that limb's drive with acceleration and weight; of both struts of a pair alike",
        source: "the paper's measurement strut of 340 g in place of 179 g",
    },
    PARAMETERS,
)
.kind(Kind::Inertia)
.constants(constant);

fn constant(parameter: &str, model: &MachineView) -> Option<f64> {
    let length = model.geometry.limbs[0].strut_length;
    let own = &model.bodies[STRUT];
    let shares = [own.first_moment.x / (own.mass * length), (own.tensor[(1, 1)] / own.mass).sqrt() / length];
    let [center, gyration] = if shares.iter().all(|s| (0.0..=1.0).contains(s)) { shares } else { ROD };
    match parameter {
        "strut_length" => Some(length),
        "arm_length" => Some(model.geometry.limbs[0].arm_length),
        "strut_center" => Some(center),
        "strut_gyration" => Some(gyration),
        _ => None,
    }
}

impl Effect for LimbAsymmetry {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn inertia(&self, values: &Values, _payload: &Payload, out: &mut dyn FnMut(usize, usize, Inertia)) {
        let unit = slender(values.one(STRUT_LENGTH), [values.one(STRUT_CENTER), values.one(STRUT_GYRATION)]);
        for s in 0..values.block(STRUT_MASS).len() {
            out(values.index(STRUT_MASS, s), strut(s), unit);
        }
        for limb in 0..values.block(ARM_MASS).len() {
            out(values.index(ARM_MASS, limb), arm(limb), slender(values.one(ARM_LENGTH), ROD));
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
        // 0.34 − 0.179 = 0.161 kg on 1.2 m: 0.161·0.6 = 0.0966 kg·m, 0.161·0.72² = 0.0834624 kg·m².
        let mut masses = [0.0; 6];
        masses[3] = 0.161;
        let active = ActiveEffect::new(Arc::new(LimbAsymmetry), &[&masses, &[0.0; 3], &[1.2], &[0.5], &[0.5], &[0.6]]);
        let mut sum = Inertia::ZERO;
        LimbAsymmetry.inertia(&active.values(), &Payload::default(), &mut |k, body, unit| {
            if active.values[k] != 0.0 {
                assert_eq!(body, strut(3));
                sum += unit * active.values[k];
            }
        });
        approx::assert_relative_eq!(sum.mass, 0.161);
        approx::assert_relative_eq!(sum.first_moment.x, 0.0966, epsilon = 1e-15);
        approx::assert_relative_eq!(sum.tensor[(1, 1)], 0.083_462_4, epsilon = 1e-15);
        approx::assert_relative_eq!(sum.tensor[(2, 2)], 0.083_462_4, epsilon = 1e-15);
    }
}
