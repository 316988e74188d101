//! Friction of the telescope drive with saturating viscous part ([Gnad 2024], eq. 48).

use super::{About, Effect, Instant, Parameter, Part, Role, Spec, Unit, Values, Wrenches, smooth_sign};
use crate::numerics::tanh;

/// Friction torque τ₄ = −A_C·tanh(100 q̇₄) − A_v·tanh(q̇₄/ε_v); τ₄, A_C and A_v in N·m, q̇₄ and ε_v in rad/s.
pub struct Axis4Friction;

const COULOMB: usize = 0;
const VISCOUS: usize = 1;
const SATURATION: usize = 2;
/// Steepness of the Coulomb term, s/rad ([Gnad 2024], eq. 48).
const STEEPNESS: f64 = 100.0;

const PARAMETERS: &[Parameter] = &[
    Parameter::new("coulomb", Unit::NM, Role::Linear, 0.5272, (0.0, 20.0)),
    Parameter::new("saturating", Unit::NM, Role::Linear, 0.6672, (0.0, 20.0)),
    Parameter::new("saturation_speed", Unit::RadPerS, Role::Shape, 8.5919, (0.5, 60.0)),
];

static SPEC: Spec = Spec::new(
    "axis4_friction",
    Part::Axis4,
    About {
        summary: "friction of the telescope drive, saturating with speed",
        law: "τ_4 = −A_C·tanh(100·q̇_4) − A_v·tanh(q̇_4/ε_v)",
        shows: "torque of axis 4: jump at reversals, flat above about 20 rad/s",
        source: "Gnad et al. eq. 48, Table 2, Fig. 9",
    },
    PARAMETERS,
)
.drive_friction();

impl Effect for Axis4Friction {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        let rate = at.motion.qd[3];
        out.drive_torque(values.index(COULOMB, 0), 3, -smooth_sign(rate, STEEPNESS));
        out.drive_torque(values.index(VISCOUS, 0), 3, -tanh(rate / values.one(SATURATION)));
    }
}
