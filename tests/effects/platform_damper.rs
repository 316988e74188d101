//! Damping of the platform by the medium it moves in.

use nalgebra::Vector3;

use super::{About, Effect, Instant, Parameter, Part, Role, Spec, Unit, Values, Wrenches};
use crate::machine::bodies::PLATFORM;

/// F = −d·v on the platform; F in N, v in m/s, d in N·s/m. Dissipates d·|v|².
pub struct PlatformDamper;

const PARAMETERS: &[Parameter] = &[Parameter::new("damping", Unit::NSPerM, Role::Linear, 1.0, (0.0, 100.0))];

static SPEC: Spec = Spec::new(
    "platform_damper",
    Part::Linkage,
    About {
        summary: "viscous damping of the platform",
        law: "F = −d·v",
        shows: "torque of all arms in phase with the platform's velocity",
        source: "Stokes friction; the coefficient is to be measured",
    },
    PARAMETERS,
);

impl Effect for PlatformDamper {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        out.wrench(values.index(0, 0), PLATFORM, -at.motion.bodies[PLATFORM].velocity, Vector3::zeros());
    }
}
