//! Coulomb and viscous friction of the drives ([Gnad 2024], eq. 5–7).

use super::{
    About, Count, Effect, Instant, Parameter, Part, Role, STEEPNESS_PARAMETER, Spec, Unit, Values, Wrenches,
    smooth_sign,
};

/// Friction torque τ = −p_C·tanh(k q̇) − p_v·q̇ at each drive; p_C in N·m, p_v in N·m·s/rad, k in s/rad.
pub struct DriveFriction;

const COULOMB: usize = 0;
const VISCOUS: usize = 1;
const STEEPNESS: usize = 2;

const PARAMETERS: &[Parameter] = &[
    Parameter::new("coulomb", Unit::NM, Role::Linear, 4.5, (0.0, 50.0)).counted(Count::PerDrive),
    Parameter::new("viscous", Unit::NMSPerRad, Role::Linear, 1.0, (0.0, 50.0)).counted(Count::PerDrive),
    STEEPNESS_PARAMETER,
];

static SPEC: Spec = Spec::new(
    "drive_friction",
    Part::Drives,
    About {
        summary: "Coulomb and viscous friction of the drives",
        law: "τ_i = −p_C,i·tanh(k·q̇_i) − p_v,i·q̇_i",
        shows: "torque jump at every reversal of an arm, torque in phase with its speed",
        source: "Gnad et al. eq. 5–7; Tables 1 and 4",
    },
    PARAMETERS,
)
.drive_friction();

impl Effect for DriveFriction {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        let k = values.one(STEEPNESS);
        for axis in 0..values.len(COULOMB) {
            out.drive_torque(values.index(COULOMB, axis), axis, -smooth_sign(at.motion.qd[axis], k));
        }
        for axis in 0..values.len(VISCOUS) {
            out.drive_torque(values.index(VISCOUS, axis), axis, -at.motion.qd[axis]);
        }
    }
}
