//! The payload as an effect, for its identification; not in the registry, since recordings state their payload in the
//! setup.

use nalgebra::Vector3;

use super::{About, Count, Effect, Kind, Parameter, Part, Role, Spec, Unit, Values};
use crate::machine::Inertia;
use crate::machine::bodies::END_EFFECTOR;

/// Name of the effect.
pub const NAME: &str = "payload";

/// The ten inertial parameters of the payload: m, h = m·c and Θ about the flange centre, in the end-effector frame
/// (origin at the flange centre, z up, rotating with ψ); Θ_xy = −∫xy dm etc. ([Gnad 2024], eq. 4).
///
/// The end effector translates with the platform and rotates about z. For given a and ψ̇ its load on the flange is the
/// force m(a − g) + ψ̈ z×h − ψ̇² h_⊥ and the moment h×(a − g) + (Θ_xz ψ̈ − Θ_yz ψ̇², Θ_yz ψ̈ + Θ_xz ψ̇², Θ_zz ψ̈). The
/// drive torques depend on m, h_x, h_y and Θ_zz ([Gnad 2024], section 2.3.1); h_z, Θ_xz and Θ_yz tilt the platform and
/// affect the strut forces alone; Θ_xx, Θ_yy and Θ_xy are unobservable while the robot is intact.
pub struct Payload;

const fn parameter(name: &'static str, unit: Unit, count: Count, default: f64) -> Parameter {
    Parameter::new(name, unit, Role::Linear, default, (-100.0, 100.0)).counted(count)
}

const PARAMETERS: &[Parameter] = &[
    parameter("mass", Unit::Kg, Count::One, 1.0),
    parameter("first_moment", Unit::KgM, Count::Named(&["x", "y", "z"]), 0.05),
    parameter("inertia", Unit::KgM2, Count::Named(&["xx", "yy", "zz", "xy", "xz", "yz"]), 0.01),
];

static SPEC: Spec = Spec::new(NAME, Part::Linkage, About {
            summary: "inertia and weight of the payload",
            law: "Newton–Euler equations of the end effector, linear in m, m·c and Θ",
            shows: "arm torques in phase with acceleration and weight; torque of axis 4 with lateral acceleration; height and Θ_xz, Θ_yz in strut forces",
            source: "Gnad et al. section 2.3.1, End-effector",
        }, PARAMETERS)
.kind(Kind::Inertia);

impl Effect for Payload {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn inertia(&self, values: &Values, _: &crate::machine::Payload, out: &mut dyn FnMut(usize, usize, Inertia)) {
        out(values.index(0, 0), END_EFFECTOR, Inertia { mass: 1.0, ..Inertia::ZERO });
        for axis in 0..3 {
            let unit = Inertia { first_moment: Vector3::ith(axis, 1.0), ..Inertia::ZERO };
            out(values.index(1, axis), END_EFFECTOR, unit);
        }
        for entry in 0..6 {
            let mut moments = [0.0; 6];
            moments[entry] = 1.0;
            let tensor = crate::machine::Payload::with_tensor(0.0, [0.0; 3], moments).tensor;
            out(values.index(2, entry), END_EFFECTOR, Inertia { tensor, ..Inertia::ZERO });
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::ActiveEffect;

    #[test]
    fn a_kilogram_at_ten_centimetres() {
        // 1 kg at (0.1, 0, −0.2) m: h = (0.1, 0, −0.2) kg·m, Θ_xx = 0.04, Θ_yy = 0.05, Θ_zz = 0.01, Θ_xz = 0.02 kg·m².
        let active =
            ActiveEffect::new(Arc::new(Payload), &[&[1.0], &[0.1, 0.0, -0.2], &[0.04, 0.05, 0.01, 0.0, 0.02, 0.0]]);
        let mut sum = Inertia::ZERO;
        Payload.inertia(&active.values(), &Default::default(), &mut |k, _, unit| sum += unit * active.values[k]);
        let point = Inertia::point(1.0, [0.1, 0.0, -0.2].into());
        assert_eq!((sum.mass, sum.first_moment), (point.mass, point.first_moment));
        approx::assert_relative_eq!(sum.tensor, point.tensor, epsilon = 1e-15);
    }
}
