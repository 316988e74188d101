//! Difference of a limb's strut length from the stated one.

use super::{About, Count, Effect, Kind, Parameter, Part, Role, Spec, Unit, Values};
use crate::machine::Geometry;

/// Length l₂ = l₂,stated + Δl (m) of both struts of a limb.
pub struct StrutLengthError;

const PARAMETERS: &[Parameter] =
    &[Parameter::new("length", Unit::M, Role::Linear, 0.001, (-0.02, 0.02)).counted(Count::PerLimb)];

static SPEC: Spec = Spec::new(
    "strut_length_error",
    Part::Linkage,
    About {
        summary: "the struts of a limb differ from the stated length",
        law: "l₂,i = l₂ + Δl_i, both struts of a pair alike",
        shows: "small torque errors everywhere, platform position off by about Δl",
        source: "CAD is inconsistent by 0.28 mm; 0.1 mm typical, 0.3 mm at worst (estimate)",
    },
    PARAMETERS,
)
.kind(Kind::Geometry);

impl Effect for StrutLengthError {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn geometry(&self, values: &Values, geometry: &mut Geometry) {
        for (limb, error) in geometry.limbs.iter_mut().zip(values.block(0)) {
            limb.strut_length += error;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::ActiveEffect;

    #[test]
    fn longer_struts_lower_the_platform() {
        // At home the struts of a symmetric robot meet at depth √(l² − ρ²), ρ = R + l₁ − r = 0.652 m:
        // l 1.106 → 1.107 m lowers it from 0.893382 m to 0.894620 m.
        let mut geometry = crate::machine::testing::geometry();
        let before = geometry.forward(&[0.0; 3]).unwrap().z;
        let active = ActiveEffect::new(Arc::new(StrutLengthError), &[&[0.001; 3]]);
        StrutLengthError.geometry(&active.values(), &mut geometry);
        let after = geometry.forward(&[0.0; 3]).unwrap().z;
        approx::assert_relative_eq!(before, -(1.106f64.powi(2) - 0.652f64.powi(2)).sqrt(), epsilon = 1e-12);
        approx::assert_relative_eq!(after, -(1.107f64.powi(2) - 0.652f64.powi(2)).sqrt(), epsilon = 1e-12);
    }
}
