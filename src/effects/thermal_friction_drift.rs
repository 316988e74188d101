//! Additional friction of cold drives, which decays during warm-up.

use super::{
    About, Count, Effect, Instant, InternalStates, MachineView, Parameter, Part, Role, STEEPNESS_PARAMETER, Spec, Unit,
    Values, Wrenches, as_drive_friction, smooth_sign,
};
use crate::numerics::tanh;

/// Friction torque τ = −x·(c_C·tanh(k q̇) + c_v·w(q̇)) at every drive with internal state ẋ = −x/T, x(0) = 1.
///
/// w(q̇) = q̇ at the arms and v_s·tanh(q̇/v_s) at the telescope drive, whose viscous friction saturates ([Gnad 2024],
/// eq. 48). c_C in N·m and c_v in N·m·s/rad, never negative, are the excess of cold over warm drives, the friction in
/// the model being that of warm ones; T in s; v_s in rad/s is that of the telescope friction in the model (linear
/// without one). Dissipates x·(c_C·q̇·tanh(k·q̇) + c_v·q̇·w).
///
/// x starts at 1, cold, in every run of the twin, which integrates it with the motion (T is at least 0.5 s: not stiff),
/// and in every recording in identification, which integrates it over the recorded time, gaps included. Warm-up is
/// assumed independent of the motion. With T of a real gear, half an hour and more, friction is constant over seconds:
/// the default suits short runs.
pub struct ThermalFrictionDrift;

const COULOMB: usize = 0;
const VISCOUS: usize = 1;
const TIME: usize = 2;
const STEEPNESS: usize = 3;
const SATURATION: usize = 4;
/// Saturation speed above all drive speeds, for which viscous friction is linear, rad/s.
const NONE: f64 = 1e4;

const PARAMETERS: &[Parameter] = &[
    Parameter::new("coulomb", Unit::NM, Role::Linear, 0.4, (0.0, 50.0)).counted(Count::AllDrives),
    Parameter::new("viscous", Unit::NMSPerRad, Role::Linear, 0.4, (0.0, 50.0)).counted(Count::AllDrives),
    Parameter::new("time_constant", Unit::S, Role::Shape, 10.0, (0.5, 1e4)),
    STEEPNESS_PARAMETER,
    Parameter::new("saturation_speed", Unit::RadPerS, Role::Fixed, 8.5919, (0.5, NONE)),
];

static SPEC: Spec = Spec::new(
    "thermal_friction_drift",
    Part::Drives,
    About {
        summary: "extra friction of cold drives that decays exponentially to the warm value",
        law: "τ_i = −x·(c_C,i·tanh(k·q̇_i) + c_v,i·w(q̇_i)), dx/dt = −x/T, x(0) = 1; w = q̇, of axis 4 v_s·tanh(q̇/v_s)",
        shows: "friction residual that shrinks over the run",
        source: "Bittencourt et al., IROS 2010: viscous −30 to −70 %, Coulomb −10 %, T 30–60 min",
    },
    PARAMETERS,
)
.drive_friction()
.constants(constant);

fn constant(parameter: &str, model: &MachineView) -> Option<f64> {
    let stated = model.effects.iter().flat_map(|a| a.entries().into_iter().zip(&a.values));
    let mut stated = stated.filter(|(entry, _)| entry.parameter.name == parameter).map(|(_, value)| *value);
    match parameter {
        "saturation_speed" => Some(stated.next().unwrap_or(NONE)),
        _ => as_drive_friction(parameter, model),
    }
}

impl Effect for ThermalFrictionDrift {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        let (cold, saturation) = (at.state[0], values.one(SATURATION));
        for axis in 0..values.len(COULOMB) {
            out.drive_torque(
                values.index(COULOMB, axis),
                axis,
                -cold * smooth_sign(at.motion.qd[axis], values.one(STEEPNESS)),
            );
        }
        for axis in 0..values.len(VISCOUS) {
            let rate = at.motion.qd[axis];
            let saturating = if axis < at.motion.limbs { rate } else { saturation * tanh(rate / saturation) };
            out.drive_torque(values.index(VISCOUS, axis), axis, -cold * saturating);
        }
    }

    fn states(&self) -> Option<&dyn InternalStates> {
        Some(self)
    }
}

impl InternalStates for ThermalFrictionDrift {
    fn initial_state(&self, _values: &Values) -> Vec<f64> {
        vec![1.0]
    }

    fn state_rate(&self, values: &Values, at: &Instant, rate: &mut [f64], _slope: &mut [f64]) {
        rate[0] = -at.state[0] / values.one(TIME);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing;

    #[test]
    fn half_warm_drive_has_half_the_extra_friction() {
        let mut motion = testing::still();
        motion.qd[0] = 3.0;
        // −0.5·(tanh(300) + 3) = −2
        let torque: f64 = testing::wrenches_in_state(&ThermalFrictionDrift, &motion, &[0.5])
            .iter()
            .filter(|(_, body, ..)| *body == 0)
            .map(|(.., moment)| moment.y)
            .sum();
        approx::assert_relative_eq!(torque, -2.0, epsilon = 1e-12);
    }

    #[test]
    fn the_drive_of_axis_4_warms_up_like_its_friction() {
        let mut motion = testing::still();
        motion.qd[3] = 20.0;
        let (body, screw) = motion.drive(3);
        let torque: f64 = testing::wrenches_in_state(&ThermalFrictionDrift, &motion, &[1.0])
            .iter()
            .filter(|(_, b, ..)| *b == body)
            .map(|(.., moment)| moment.dot(&screw.angular))
            .sum();
        // −(1 + 8.5919·tanh(20/8.5919)) with tanh 2.32777 = 0.981162
        approx::assert_relative_eq!(torque, -9.43004, epsilon = 1e-5);
    }

    #[test]
    fn viscous_friction_saturates_where_that_of_the_model_does() {
        let parameter = &SPEC.parameters[SATURATION];
        let mut model = crate::model::testing::irb360();
        assert_eq!(SPEC.constant(&parameter.name, &model.view()), Some(8.5919));
        model.effects.retain(|a| a.effect.name() != "axis4_friction");
        assert_eq!(SPEC.constant(&parameter.name, &model.view()), Some(NONE));
    }
}
