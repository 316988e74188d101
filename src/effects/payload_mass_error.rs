//! Difference of the payload's mass from the stated one.

use super::{About, Effect, Kind, Parameter, Part, Role, Spec, Unit, Values};
use crate::machine::Inertia;
use crate::machine::Payload;
use crate::machine::bodies::END_EFFECTOR;

/// Additional mass Δm (kg) at the stated centre of mass of the payload (at the flange centre without payload).
pub struct PayloadMassError;

const PARAMETERS: &[Parameter] = &[Parameter::new("mass", Unit::Kg, Role::Linear, 0.1, (-10.0, 10.0))];

static SPEC: Spec = Spec::new(
    "payload_mass_error",
    Part::Linkage,
    About {
        summary: "the payload's mass differs from the stated one",
        law: "m = m_stated + Δm at the stated centre of mass; its inertia grows in proportion",
        shows: "torque in phase with the platform's acceleration; hides in the platform's mass \
                  unless the centre of mass is off the axis",
        source: "3 % typical, 10 % at worst (estimate)",
    },
    PARAMETERS,
)
.kind(Kind::Inertia);

impl Effect for PayloadMassError {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn inertia(&self, values: &Values, payload: &Payload, out: &mut dyn FnMut(usize, usize, Inertia)) {
        let mut unit = Inertia::point(1.0, payload.com);
        if payload.mass > 0.0 {
            unit.tensor += payload.tensor / payload.mass;
        }
        out(values.index(0, 0), END_EFFECTOR, unit);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::ActiveEffect;

    #[test]
    fn unit_mass_sits_at_the_centre_of_mass() {
        let payload = Payload::new(2.0, [0.03, 0.0, -0.1], 0.01);
        let active = ActiveEffect::absent(Arc::new(PayloadMassError));
        let mut seen = Vec::new();
        PayloadMassError.inertia(&active.values(), &payload, &mut |_, body, unit| seen.push((body, unit)));
        let (body, unit) = seen[0];
        assert_eq!((seen.len(), body, unit.mass), (1, END_EFFECTOR, 1.0));
        approx::assert_relative_eq!(unit.first_moment.z, -0.1);
        // 0.01/2 + 0.03² = 0.0059 kg·m² about the vertical axis of the flange
        approx::assert_relative_eq!(unit.tensor[(2, 2)], 0.0059, epsilon = 1e-15);
    }
}
