//! The payload by itself, for its identification; not in the registry, because recordings state their payload in the setup.

use nalgebra::Vector3;

use super::{About, Count, Effect, Kind, Parameter, Part, Role, Values};
use crate::model::Inertia;
use crate::model::bodies::END_EFFECTOR;

/// Name of the effect.
pub const NAME: &str = "payload";

/// Mass m, first moment h = m·c and moment Θ_zz of the payload, all in the end-effector frame (origin at the flange centre,
/// z up, turning with ψ).
///
/// The end effector translates with the platform and turns about z, so nothing else of its inertia enters the drive torques; h_z
/// tilts the platform and shows in strut forces alone (Gnad et al. section 2.3.1).
pub struct Payload;

const fn parameter(name: &'static str, unit: &'static str, count: Count, default: f64) -> Parameter {
    Parameter { name, unit, count, role: Role::Linear, default, range: (-100.0, 100.0) }
}

impl Effect for Payload {
    fn name(&self) -> &'static str {
        NAME
    }

    fn acts_on(&self) -> Part {
        Part::Linkage
    }

    fn about(&self) -> About {
        About {
            summary: "inertia and weight of the payload",
            law: "Newton–Euler equations of the end effector, linear in m, m·c and Θ_zz",
            shows: "arm torques in phase with acceleration and weight; torque of axis 4 with lateral acceleration",
            source: "Gnad et al. section 2.3.1, End-effector",
        }
    }

    fn parameters(&self) -> &'static [Parameter] {
        const PARAMETERS: &[Parameter] = &[
            parameter("mass", "kg", Count::One, 1.0),
            parameter("first_moment", "kg·m", Count::Named(&["x", "y", "z"]), 0.05),
            parameter("inertia_zz", "kg·m²", Count::One, 0.01),
        ];
        PARAMETERS
    }

    fn inertia(&self, values: &Values, _: &crate::recording::Payload, out: &mut dyn FnMut(usize, usize, Inertia)) {
        out(values.index(0, 0), END_EFFECTOR, Inertia { mass: 1.0, ..Inertia::ZERO });
        for axis in 0..3 {
            let unit = Inertia { first_moment: Vector3::ith(axis, 1.0), ..Inertia::ZERO };
            out(values.index(1, axis), END_EFFECTOR, unit);
        }
        out(values.index(2, 0), END_EFFECTOR, Inertia::diagonal(0.0, [0.0; 3], [0.0, 0.0, 1.0]));
    }

    fn kind(&self) -> Kind {
        Kind::Inertia
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::ActiveEffect;

    #[test]
    fn a_kilogram_at_ten_centimetres() {
        // 1 kg at (0.1, 0, −0.2) m: h = (0.1, 0, −0.2) kg·m, Θ_zz = 0.1² = 0.01 kg·m².
        let active = ActiveEffect::new(&Payload, &[&[1.0], &[0.1, 0.0, -0.2], &[0.01]]);
        let mut sum = Inertia::ZERO;
        Payload.inertia(&active.values(), &Default::default(), &mut |k, _, unit| sum += unit * active.values[k]);
        let point = Inertia::point(1.0, [0.1, 0.0, -0.2].into());
        assert_eq!((sum.mass, sum.first_moment), (point.mass, point.first_moment));
        approx::assert_relative_eq!(sum.tensor[(2, 2)], point.tensor[(2, 2)], epsilon = 1e-15);
    }
}
