//! Cogging and torque ripple of the arm motors at any number of orders.

use std::sync::Arc;

use super::{
    About, ActiveEffect, Count, Effect, Host, Instant, MachineView, Parameter, Part, Role, Spec, Unit, Values, Wrenches,
};

/// Name of the effect.
pub const NAME: &str = "cogging";

/// Torque τ_i = Σ_k a_ik·sin(n_k·N·q_i) + b_ik·cos(n_k·N·q_i) (N·m at the gear output) of arm drive i.
///
/// n_k are orders, in periods per motor turn: multiples of the number of poles and of slots and their least common
/// multiple [Hanselman 2006]; an order of the joint is n_k·N. N is the gear ratio, q_i the joint angle in rad. On a
/// slide, N is in rad/m and the force in N.
pub struct Cogging;

const ORDERS: usize = 0;
const SINE: usize = 1;
const COSINE: usize = 2;
const GEAR_RATIO: usize = 3;

const fn amplitude(name: &'static str) -> Parameter {
    Parameter::new(name, Unit::NM, Role::Linear, 0.35, (-20.0, 20.0)).counted(Count::PerArmOf(ORDERS))
}

const PARAMETERS: &[Parameter] = &[
    Parameter::new("orders", Unit::One, Role::Fixed, 6.0, (1e-3, 1e4)).counted(Count::List),
    amplitude("sine"),
    amplitude("cosine"),
    Parameter::new("gear_ratio", Unit::GearRatio, Role::Fixed, 33.0, (1e-3, 1e5)),
];

static SPEC: Spec = Spec::new(
    NAME,
    Part::Drives,
    About {
        summary: "cogging of the arm motors at orders of the motor turn",
        law: "τ_i = Σ_k a_ik·sin(n_k·N·q_i) + b_ik·cos(n_k·N·q_i), n_k the orders, N the gear ratio",
        shows: "lines of the residual's spectrum over the joint angle, equal at all speeds",
        source: "Hanselman, Brushless Permanent Magnet Motor Design, ch. 10; 0.2–1 N·m at the gear output (estimate)",
    },
    PARAMETERS,
)
.constants(constant);

fn constant(parameter: &str, model: &MachineView) -> Option<f64> {
    match parameter {
        "gear_ratio" => Some(model.drives[0].gear_ratio),
        _ => None,
    }
}

/// The effect at given orders of the motor turn with zero amplitudes, for drives with a gear ratio.
pub fn at_orders(orders: &[f64], gear_ratio: f64, host: Host) -> ActiveEffect {
    let zeros = vec![0.0; orders.len() * host.mechanism.arms()];
    let effect = Arc::new(Cogging);
    ActiveEffect { host, ..ActiveEffect::new(effect, &[orders, &zeros, &zeros, &[gear_ratio]]) }
}

impl Effect for Cogging {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        let orders = values.block(ORDERS);
        let arms = values.len(SINE) / orders.len();
        for (k, order) in orders.iter().enumerate() {
            for arm in 0..arms {
                let (s, c) = (order * values.one(GEAR_RATIO) * at.motion.q[arm]).sin_cos();
                out.drive_torque(values.index(SINE, k * arms + arm), arm, s);
                out.drive_torque(values.index(COSINE, k * arms + arm), arm, c);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing;
    use crate::machine::{Joint, Mechanism};

    #[test]
    fn two_orders_at_a_motor_angle_of_thirty_degrees() {
        // Orders 1 and 3 at 30°: 2·sin 30° + 4·sin 90° + 8·cos 30° = 1 + 4 + 4·√3 on arm 2; arm 1 stays at 0°: 10 + 20.
        let mut motion = testing::still();
        motion.q[1] = std::f64::consts::PI / 6.0 / 33.0;
        let sine: &[f64] = &[0.0, 2.0, 0.0, 0.0, 4.0, 0.0];
        let cosine: &[f64] = &[10.0, 8.0, 0.0, 20.0, 0.0, 0.0];
        let total = testing::totals(&Cogging, &[&[1.0, 3.0], sine, cosine, &[33.0]], &motion);
        let torque = |arm: usize| motion.drive(arm).1.effort(&total[arm]);
        approx::assert_relative_eq!(torque(0), 30.0, epsilon = 1e-12);
        approx::assert_relative_eq!(torque(1), 5.0 + 4.0 * 3f64.sqrt(), epsilon = 1e-9);
    }

    #[test]
    fn amplitudes_are_named_by_their_orders() {
        let names = |active: &ActiveEffect| active.entries().into_iter().map(|e| e.name).collect::<Vec<_>>();
        let mut axis = at_orders(&[72.0, 4.5], 1.0, Host::default());
        assert_eq!(names(&axis)[2..6], ["sine_72_1", "sine_72_2", "sine_72_3", "sine_4.5_1"]);
        axis.host.mechanism = Mechanism::Axis(Joint::Revolute.into());
        let axis = at_orders(&[72.0, 4.5], 1.0, axis.host);
        let expected = ["orders_1", "orders_2", "sine_72", "sine_4.5", "cosine_72", "cosine_4.5", "gear_ratio"];
        assert_eq!(names(&axis), expected);
    }
}
