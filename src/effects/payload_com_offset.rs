//! Offset of the payload's centre of mass from the stated one.

use nalgebra::Vector3;

use super::{About, Count, Effect, Kind, Parameter, Part, Role, Spec, Unit, Values};
use crate::machine::Inertia;
use crate::machine::Payload;
use crate::machine::bodies::END_EFFECTOR;

/// First moment h = m·Δc of the end effector in addition to that of the stated payload.
///
/// h in kg·m in end-effector axes, which rotate with ψ, either sign. h_z tilts the platform and affects the strut
/// forces alone. For a payload of mass m at c, moved by Δc, the first moment grows by h and the tensor about the flange
/// by −[c]×[h]× − [h]×[c]×, exact up to m·Δc² (1 kg, 10 mm: 1e-4 kg·m²).
pub struct PayloadComOffset;

const PARAMETERS: &[Parameter] =
    &[Parameter::new("first_moment", Unit::KgM, Role::Linear, 0.02, (-1.0, 1.0))
        .counted(Count::Named(&["x", "y", "z"]))];

static SPEC: Spec = Spec::new(
    "payload_com_offset",
    Part::Linkage,
    About {
        summary: "the payload's centre of mass lies beside the stated one",
        law: "first moment h = m·Δc added in the end-effector frame, tensor to first order",
        shows: "torque of axis 4 in proportion to the platform's lateral acceleration, turning with \
                  ψ; the height in strut forces alone",
        source: "10 mm typical, 50 mm at worst (estimate)",
    },
    PARAMETERS,
)
.kind(Kind::Inertia);

impl Effect for PayloadComOffset {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn inertia(&self, values: &Values, payload: &Payload, out: &mut dyn FnMut(usize, usize, Inertia)) {
        for axis in 0..values.len(0) {
            let h = Vector3::ith(axis, 1.0);
            let (c, x) = (payload.com.cross_matrix(), h.cross_matrix());
            let unit = Inertia { mass: 0.0, first_moment: h, tensor: -(c * x + x * c) };
            out(values.index(0, axis), END_EFFECTOR, unit);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::ActiveEffect;

    #[test]
    fn two_kilograms_moved_by_a_tenth_of_a_millimetre() {
        // A point of 2 kg moved from (30, 0, −100) mm to (30.1, 0, −100) mm: h = 2e-4 kg·m; Θ_zz grows by 2·(0.0301² −
        // 0.03²) = 1.202e-5, Θ_xz by 2·0.1·1e-4 = 2e-5 kg·m².
        let payload = Payload::new(2.0, [0.03, 0.0, -0.1], 0.0);
        let active = ActiveEffect::new(Arc::new(PayloadComOffset), &[&[2e-4, 0.0, 0.0]]);
        let mut sum = Inertia::point(2.0, payload.com);
        PayloadComOffset.inertia(&active.values(), &payload, &mut |k, body, unit| {
            assert_eq!(body, END_EFFECTOR);
            sum += unit * active.values[k];
        });
        let moved = Inertia::point(2.0, [0.0301, 0.0, -0.1].into());
        approx::assert_relative_eq!(sum.first_moment, moved.first_moment, epsilon = 1e-15);
        approx::assert_relative_eq!(sum.tensor, moved.tensor, epsilon = 2.1e-8); // m·Δc² = 2e-8
        approx::assert_relative_eq!(sum.tensor[(2, 2)] - 2.0 * 0.03f64.powi(2), 1.2e-5, epsilon = 1e-15);
        approx::assert_relative_eq!(sum.tensor[(0, 2)], 2.0 * 0.1 * 0.03 + 2e-5, epsilon = 1e-15);
    }

    #[test]
    fn a_load_that_hangs_lower_than_stated() {
        // A point of 2.5 kg, stated at (40, 0, −150) mm, is at (40, 0, −250) mm: h_z = −0.25 kg·m, Θ_xz grows from
        // 0.015 by 2.5·0.04·0.1 = 0.01 to 2.5·0.04·0.25 = 0.025 kg·m².
        let payload = Payload::new(2.5, [0.04, 0.0, -0.15], 0.0);
        let active = ActiveEffect::new(Arc::new(PayloadComOffset), &[&[0.0, 0.0, -0.25]]);
        let mut sum = payload.inertia();
        PayloadComOffset.inertia(&active.values(), &payload, &mut |k, _, unit| sum += unit * active.values[k]);
        approx::assert_relative_eq!(sum.first_moment.z, -0.625, epsilon = 1e-15);
        approx::assert_relative_eq!(sum.tensor[(0, 2)], 0.025, epsilon = 1e-15);
        approx::assert_relative_eq!(sum.tensor[(2, 2)], 2.5 * 0.04 * 0.04, epsilon = 1e-15);
    }
}
