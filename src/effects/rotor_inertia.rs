//! Difference of the rotor inertia of the arm drives from the stated one.

use nalgebra::Vector3;

use super::{About, Count, Effect, Instant, Kind, Parameter, Part, Role, Spec, Unit, Values, Wrenches};
use crate::machine::bodies::arm;
use crate::machine::{Inertia, Payload};

/// Additional inertia ΔJ of each arm drive at its gear output: τ_i grows by ΔJ_i·q̈_i.
///
/// ΔJ in kg·m², the motor's inertia times the gear ratio squared, either sign. The part common to all arms is equivalent to
/// the arms' own Θ_yy.
///
/// On a guide ΔJ is a mass in kg: the motor's inertia times the square of its turns in rad per metre. It resists the carriage
/// and does not weigh: the law adds the mass ΔJ and carries its weight.
pub struct RotorInertia;

const PARAMETERS: &[Parameter] =
    &[Parameter::new("inertia", Unit::KgM2, Role::Linear, 0.02, (-0.2, 1.0)).counted(Count::PerArm)];

static SPEC: Spec = Spec::new(
    "rotor_inertia",
    Part::ArmDrives,
    About {
        summary: "the reflected rotor inertia of an arm drive differs from the stated one",
        law: "τ_i grows by ΔJ_i·d²q_i/dt², ΔJ at the gear output",
        shows: "torque of one arm in phase with its own acceleration, none at rest; alike on all \
                  arms it is the arms' inertia",
        source: "motors of one series differ by some 10 % of about 0.18 kg·m² (estimate)",
    },
    PARAMETERS,
)
.kind(Kind::Inertia);

impl Effect for RotorInertia {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn inertia(&self, values: &Values, _payload: &Payload, out: &mut dyn FnMut(usize, usize, Inertia)) {
        for limb in 0..values.len(0) {
            out(values.index(0, limb), arm(limb), values.of_motor());
        }
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        let carried = Vector3::z() * (at.gravity * values.of_motor().mass);
        for limb in 0..values.len(0) {
            out.wrench(values.index(0, limb), arm(limb), carried, Vector3::zeros());
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::dynamics::{Plant, inverse_dynamics};
    use crate::effects::ActiveEffect;
    use crate::kinematics::JointState;

    #[test]
    fn torque_grows_by_inertia_times_acceleration() {
        // 0.02 kg·m² · 50 rad/s² = 1 N·m on arm 2, nothing on the others.
        let mut model = crate::model::testing::irb360();
        model.effects.clear();
        let joints = JointState { q: [0.3; 4], qd: [1.0; 4], qdd: [50.0; 4] };
        let torque = |model: &crate::model::Model| {
            let plant = Plant::new(model, &Default::default());
            inverse_dynamics(&plant, 0.0, &plant.motion(&joints).unwrap(), &[&[]], false).unwrap().tau
        };
        let before = torque(&model);
        model.effects.push(ActiveEffect::new(Arc::new(RotorInertia), &[&[0.0, 0.02, 0.0]]));
        let change: Vec<f64> = torque(&model).iter().zip(before).map(|(a, b)| a - b).collect();
        approx::assert_relative_eq!(change.as_slice(), [0.0, 1.0, 0.0, 0.0].as_slice(), epsilon = 1e-12);
    }
}
