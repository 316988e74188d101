//! Compliance of the arm gears between motor-side encoder and arm.

use nalgebra::Vector3;

use super::{
    About, Compliance, Count, Effect, Instant, InternalStates, Kind, MachineView, Parameter, Part, Role, Sensor, Spec,
    Unit, Values, Wrenches,
};
use crate::machine::Mechanism;
use crate::machine::bodies::{ARM, Inertia, arm};
use crate::machine::{Payload, PerAxis, axes_from, each, rate_place};

/// Spring and damper in the gear: the torque on the arm is δ/c + d·δ̇ instead of τ, that on the rotor τ − δ/c − d·δ̇.
///
/// All at the gear output: δ in rad, motor side minus arm, positive if the motor leads; c in rad/(N·m); d in N·m·s/rad;
/// rotor inertia J in kg·m², the part of the arm's Θ_yy that moves with the motor: J·(q̈ + δ̈) = τ − δ/c − d·δ̇. The
/// internal states are δ₁…δ₄, δ̇₁…δ̇₄, of a telescope's drive zero; a simulation starts in equilibrium, δ = c·(τ − J·q̈). After a torque step an arm
/// oscillates at √(1/(c·J) + 1/(c·Θ)), 80 Hz, with a damping ratio of 1/5, for about 50 ms. Forces on the drives,
/// mainly friction, act on the arm, or with `friction_at_motor` = 1 on the rotor; the twin implements the arm side
/// only.
///
/// On a guide δ is in m, c in m/N, d in N·s/m, and J a mass in kg, the part of what resists the carriage that moves with the
/// motor: of the model's mass, or of a motor's that is stated in addition. All weight stays on the carriage.
///
/// The twin uses `wrenches`, `state_rate` and `encoder`, with J subtracted from the arm. Along a measured motion θ the same law
/// yields the arm motion behind the gears (see `identification::prediction`); damping and J have little influence there and
/// are not estimated.
pub struct DriveElasticity;

const COMPLIANCE: usize = 0;
const DAMPING: usize = 1;
const ROTOR_INERTIA: usize = 2;
const FRICTION_AT_MOTOR: usize = 3;

/// Compliance times rotor inertia below which a gear counts as rigid, s²: 1/40 of the default, at which it would
/// oscillate above 500 Hz.
const RIGID: f64 = 1.8e-7;

/// Index and compliance of the elastic drives.
fn elastic<'a>(values: &Values<'a>) -> impl Iterator<Item = (usize, f64)> + use<'a> {
    let rotor = values.one(ROTOR_INERTIA);
    values.block(COMPLIANCE).iter().copied().enumerate().filter(move |(_, c)| c * rotor > RIGID)
}

/// Share of the inertia of a single axis or a carriage on the motor side, estimated.
const MOTOR_SHARE: f64 = 0.4;
/// Share of an arm's inertia about its shaft on the motor side, that of the reference machine.
const ARM_SHARE: f64 = 0.7;

/// An elastic gear: the encoder leads the joint by compliance times transmitted torque, apart from damping.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GearSpring {
    /// Compliance, rad/(N·m); zero means rigid.
    pub compliance: f64,
    /// Damping, N·m·s/rad.
    pub damping: f64,
    /// Inertia on the motor side, at the gear output, kg·m².
    pub rotor_inertia: f64,
    /// Whether forces on the drive act on the motor side.
    pub friction_at_motor: bool,
}

impl GearSpring {
    /// Whether the twin treats the gear as elastic; otherwise the effect contributes no torque.
    pub fn is_elastic(&self) -> bool {
        self.compliance * self.rotor_inertia > RIGID
    }
}

const PARAMETERS: &[Parameter] = &[
    Parameter::new("compliance", Unit::RadPerNM, Role::Linear, 4e-5, (0.0, 2e-4)).counted(Count::PerArm),
    Parameter::new("damping", Unit::NMSPerRad, Role::Fixed, 20.0, (0.0, 1e3)),
    Parameter::new("rotor_inertia", Unit::KgM2, Role::Fixed, 0.18, (1e-4, 10.0)),
    // 0 or 1.
    Parameter::new("friction_at_motor", Unit::One, Role::Fixed, 0.0, (0.0, 1.0)),
];

static SPEC: Spec = Spec::new(
    "drive_elasticity",
    Part::Drives,
    About {
        summary: "compliance of the arm gears between motor-side encoder and arm",
        law: "τ_arm,i = δ_i/c_i + d·dδ_i/dt, J·(d²q_i/dt² + d²δ_i/dt²) = τ_i − τ_arm,i, encoder reads q_i + δ_i",
        shows: "torque in phase with the jerk's rate: at fast reversals of the acceleration and of friction",
        source: "gear 2.5e4 N·m/rad (0.8e4–5e4), 20 N·m·s/rad, estimates, ≤ 10 minutes of arc at rated torque in data \
                     sheets; J: Θ_yy 0.258 less at most 0.176 kg·m · 0.5 m of the arm itself",
    },
    PARAMETERS,
)
.kind(Kind::Encoder)
// Factors of the compliance: every gear in the range is within √2 of one of them.
.grids(&[&[0.25, 0.5, 1.0, 2.0]])
// In an elastic drive, friction can act on either side.
.switches(&["friction_at_motor"])
.constants(constant);

fn constant(parameter: &str, model: &MachineView) -> Option<f64> {
    match model.mechanism {
        _ if parameter != "rotor_inertia" => None,
        Mechanism::Axis(_) => Some(MOTOR_SHARE * model.bodies[ARM].tensor[(1, 1)]),
        delta if delta.has_carriages() => Some(MOTOR_SHARE * model.bodies[ARM].mass),
        delta if delta.is_delta() => None,
        Mechanism::Delta { .. } => Some(ARM_SHARE * model.bodies[ARM].tensor[(1, 1)]),
    }
}

/// Adds the weight of what `inertia` removes from arm `i`.
fn add_weight(values: &Values, i: usize, at: &Instant, out: &mut Wrenches) {
    let weight = values.one(ROTOR_INERTIA) * values.of_motor().mass * at.gravity / values.block(COMPLIANCE)[i];
    out.wrench(values.index(COMPLIANCE, i), arm(i), Vector3::z() * -weight, Vector3::zeros());
}

impl Effect for DriveElasticity {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn inertia(&self, values: &Values, _payload: &Payload, out: &mut dyn FnMut(usize, usize, Inertia)) {
        let rotor = values.one(ROTOR_INERTIA);
        for (i, c) in elastic(values) {
            out(values.index(COMPLIANCE, i), arm(i), values.of_motor() * (-rotor / c));
        }
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        for (i, c) in elastic(values) {
            let transmitted = at.state[i] / c + values.one(DAMPING) * at.state[rate_place(i)];
            out.drive_torque(values.index(COMPLIANCE, i), i, (transmitted - at.torque[i]) / c);
            add_weight(values, i, at, out);
        }
    }

    /// The rotor moves with the arm: adds the inertia that `inertia` removes.
    fn wrenches_along(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        for (i, c) in elastic(values) {
            out.drive_torque(values.index(COMPLIANCE, i), i, -values.one(ROTOR_INERTIA) * at.motion.qdd[i] / c);
            add_weight(values, i, at, out);
        }
    }

    fn states(&self) -> Option<&dyn InternalStates> {
        Some(self)
    }

    fn sensor(&self) -> Option<&dyn Sensor> {
        Some(self)
    }

    fn compliance(&self) -> Option<&dyn Compliance> {
        Some(self)
    }
}

impl InternalStates for DriveElasticity {
    fn initial_state(&self, _values: &Values) -> Vec<f64> {
        vec![0.0; axes_from(rate_place(0)).end]
    }

    fn state_rate(&self, values: &Values, at: &Instant, rate: &mut [f64], _slope: &mut [f64]) {
        let (damping, rotor) = (values.one(DAMPING), values.one(ROTOR_INERTIA));
        for (i, c) in elastic(values) {
            let transmitted = at.state[i] / c + damping * at.state[rate_place(i)];
            rate[i] = at.state[rate_place(i)];
            rate[rate_place(i)] = (at.torque[i] - transmitted) / rotor - at.motion.qdd[i];
        }
    }
}

impl Sensor for DriveElasticity {
    fn encoder(&self, values: &Values, state: &[f64], angles: &mut PerAxis<f64>) {
        for (i, _) in elastic(values) {
            angles[i] += state[i];
        }
    }
}

impl Compliance for DriveElasticity {
    fn gear_springs(&self, values: &Values) -> Option<PerAxis<GearSpring>> {
        let mut gears: PerAxis<_> = each(GearSpring::default());
        for (gear, &compliance) in gears.iter_mut().zip(values.block(COMPLIANCE)) {
            *gear = GearSpring {
                compliance,
                damping: values.one(DAMPING),
                rotor_inertia: values.one(ROTOR_INERTIA),
                friction_at_motor: values.one(FRICTION_AT_MOTOR) > 0.5,
            };
        }
        gears.iter().any(|g| g.compliance != 0.0).then_some(gears)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::{ActiveEffect, testing};

    fn active() -> ActiveEffect {
        ActiveEffect::new(Arc::new(DriveElasticity), &[&[4e-5, 0.0, 0.0], &[20.0], &[0.2], &[0.0]])
    }

    #[test]
    fn spring_and_damper_replace_the_drive_torque() {
        // δ = 1 mrad at 2.5e4 N·m/rad: 25 N·m; δ̇ = 0.1 rad/s: 2 N·m; the drive's 10 N·m goes to the rotor.
        let active = active();
        let state = [1e-3, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0];
        let mut motion = testing::still();
        motion.qdd = [30.0; 4];
        let mut rate = [0.0; 8];
        let mut torque = 0.0;
        testing::at(&motion, &state, |at| {
            let at = &Instant { torque: [10.0; 4], ..*at };
            DriveElasticity.wrenches(
                &active.values(),
                at,
                &mut Wrenches::new(at.motion, &mut |k, body, _, m| {
                    assert_eq!((k, body), (0, ARM), "rigid drives get nothing");
                    torque += active.values[k] * m.y;
                }),
            );
            DriveElasticity.state_rate(&active.values(), at, &mut rate, &mut [0.0; 8]);
        });
        approx::assert_relative_eq!(torque, 27.0 - 10.0, epsilon = 1e-12);
        // (10 − 27)/0.2 − 30 = −115 rad/s²
        approx::assert_relative_eq!(
            rate.as_slice(),
            [0.1, 0.0, 0.0, 0.0, -115.0, 0.0, 0.0, 0.0].as_slice(),
            epsilon = 1e-11
        );
        let mut angles: PerAxis<f64> = each(0.5);
        DriveElasticity.encoder(&active.values(), &state, &mut angles);
        approx::assert_relative_eq!(angles.as_slice(), [0.501, 0.5, 0.5, 0.5].as_slice());
    }

    #[test]
    fn rotor_leaves_the_arm_and_a_possible_arm_remains() {
        let mut arm = Inertia::diagonal(1.6, [0.176, 0.0, 0.006], [0.1, 0.258, 0.258]);
        let active = ActiveEffect::new(Arc::new(DriveElasticity), &[&[4e-5; 3], &[20.0], &[0.18], &[0.0]]);
        DriveElasticity.inertia(&active.values(), &Payload::default(), &mut |k, body, unit| {
            if body == ARM {
                arm += unit * active.values[k];
            }
        });
        approx::assert_relative_eq!(arm.tensor[(1, 1)], 0.078, epsilon = 1e-12);
        assert!(arm.min_eigenvalue() > 0.0, "{}", arm.min_eigenvalue());
    }

    #[test]
    fn too_stiff_to_ring_is_rigid() {
        let active =
            ActiveEffect::new(Arc::new(DriveElasticity), &[&[0.99 * RIGID / 0.18, 0.0, 0.0], &[20.0], &[0.18], &[0.0]]);
        DriveElasticity.inertia(&active.values(), &Payload::default(), &mut |_, _, _| panic!("no inertia"));
        let mut rate = [0.0; 8];
        testing::at(&testing::still(), &[1.0; 8], |at| {
            DriveElasticity.wrenches(
                &active.values(),
                at,
                &mut Wrenches::new(at.motion, &mut |_, _, _, _| panic!("no force")),
            );
            DriveElasticity.state_rate(&active.values(), at, &mut rate, &mut [0.0; 8]);
        });
        assert_eq!(rate, [0.0; 8]);
    }
}
