//! A payload that swings in its gripper.

use nalgebra::Vector3;

use super::{
    About, Effect, Instant, InternalStates, Oscillator, Parameter, Part, Reads, Role, Spec, Start, Sway, Unit, Values,
    Wrenches,
};
use crate::machine::bodies::END_EFFECTOR;

/// A share σ of the payload's mass m swings horizontally about its place, as in a soft suction cup: with the
/// displacement u (m) in x or y, inertial axes, ü = −ω²·u − 2ζω·u̇ − a, and the force −σ·m·ü on the end effector at the
/// payload's centre of mass in addition to that of the rigid payload.
///
/// a (m/s²) is the acceleration of the stated centre of mass as part of the end effector; σ between 0 (rigid) and 1;
/// frequency ω/2π in Hz, the same in all directions. The displaced mass keeps its lever, and the vertical direction is
/// rigid. Mass and centre of mass are those stated in the setup: without payload the effect does nothing, and objects
/// that the twin grasps do not swing.
///
/// Internal states are u and u̇ in x and y; a run or a recording starts in equilibrium with its first acceleration, u =
/// −a/ω². The mass holds σ·m·(ω²·u²/2 + u̇²/2 + u̇·v) at the velocity v of its place and dissipates 2ζω·σ·m·u̇²: the
/// effect's work on the end effector is the negative of both.
///
/// In the twin ü and a depend on each other, by σ·m relative to the inertia of robot and payload at the flange.
pub struct PayloadCompliance;

const SHARE: usize = 0;
const FREQUENCY: usize = 1;
const DAMPING_RATIO: usize = 2;

const PARAMETERS: &[Parameter] = &[
    Parameter::new("share", Unit::One, Role::Linear, 0.5, (0.0, 1.0)),
    Parameter::new("frequency", Unit::Hz, Role::Shape, 8.0, (1.5, 40.0)),
    Parameter::new("damping_ratio", Unit::One, Role::Shape, 0.08, (1e-3, 0.9)),
];

/// Starting values: frequencies at a ratio of 1.3, damped so that each responds between its neighbours.
const STARTS: [Start; 8] = {
    const fn at(frequency: &'static [f64]) -> Start {
        Start([Some((FREQUENCY, frequency)), Some((DAMPING_RATIO, &[0.1])), None])
    }
    [at(&[3.1]), at(&[4.0]), at(&[5.2]), at(&[6.8]), at(&[8.8]), at(&[11.4]), at(&[14.8]), at(&[19.3])]
};

static SPEC: Spec = Spec::new(
    "payload_compliance",
    Part::Linkage,
    About {
        summary: "the payload swings horizontally in its gripper",
        law: "−σ·m·ü at the payload's centre of mass, ü = −ω²·u − 2ζω·u̇ − a in x and y",
        shows: "torque of all arms that swings on after horizontal acceleration while there is a payload; none without",
        source: "mass, spring and damper [Den Hartog 1956]; bellows suction cups of 1–10 N/mm across, 0.5–6 kg: \
                 2–20 Hz, ζ of rubber 0.05–0.15 (estimates)",
    },
    PARAMETERS,
)
.reads(Reads { accelerations: true, payload: true, ..Reads::MOTION })
// Factors for randomly drawn grippers in the validation; the diagnosis uses the starts.
.grids(&[&[0.5, 0.7, 1.0, 1.5, 2.0]])
.starts(&STARTS);

/// Centre of mass of the payload from the end effector's origin, inertial axes, m.
fn lever(at: &Instant) -> Vector3<f64> {
    at.motion.bodies[END_EFFECTOR].rotation * at.payload.com
}

/// Acceleration of the payload's centre of mass in x and y, m/s².
fn support(at: &Instant) -> [f64; 2] {
    let (motion, lever) = (&at.motion.bodies[END_EFFECTOR], lever(at));
    let omega = motion.angular_velocity;
    let sum = motion.acceleration + motion.angular_acceleration.cross(&lever) + omega.cross(&omega.cross(&lever));
    [sum.x, sum.y]
}

/// The oscillators of u.
fn modes(values: &Values) -> Sway {
    Sway([Oscillator::new(values.one(FREQUENCY), values.one(DAMPING_RATIO)); 2])
}

impl Effect for PayloadCompliance {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        if at.payload.mass != 0.0 {
            let [x, y] = modes(values).acceleration(at.state, support(at));
            let force = Vector3::new(x, y, 0.0) * -at.payload.mass;
            out.wrench(values.index(SHARE, 0), END_EFFECTOR, force, lever(at).cross(&force));
        }
    }

    fn states(&self) -> Option<&dyn InternalStates> {
        Some(self)
    }
}

impl InternalStates for PayloadCompliance {
    fn initial_state(&self, _values: &Values) -> Vec<f64> {
        vec![0.0; Sway::STATES]
    }

    fn state_rate(&self, values: &Values, at: &Instant, rate: &mut [f64], _slope: &mut [f64]) {
        modes(values).state_rate(at.state, support(at), rate);
    }

    fn steady_state(&self, values: &Values, at: &Instant) -> Vec<f64> {
        modes(values).at_rest(support(at))
    }

    fn step_along(&self, values: &Values, from: &Instant, to: &Instant) -> Option<Vec<f64>> {
        Some(modes(values).after(from.state, to.t - from.t, support(from), support(to)))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::{ActiveEffect, testing};
    use crate::kinematics::{Motion, Reactions, SocketSet};
    use crate::machine::Payload;

    /// Wrench on the end effector for a share of 1 in `state`.
    fn pull(payload: &Payload, motion: &Motion, state: &[f64]) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let active = ActiveEffect::new(Arc::new(PayloadCompliance), &[&[1.0], &[8.0], &[0.1]]);
        let mut written = None;
        let at = Instant {
            t: 0.0,
            motion,
            geometry: &crate::machine::testing::geometry(),
            bodies: &testing::no_bodies(),
            payload,
            gravity: 9.81,
            reactions: &Reactions::default(),
            state,
            torque: [0.0; 4],
            load: None,
            closed: SocketSet::ALL,
        };
        let mut read = |_, body, force, moment| {
            assert_eq!(body, END_EFFECTOR);
            written = Some((force, moment));
        };
        PayloadCompliance.wrenches(&active.values(), &at, &mut Wrenches::new(at.motion, &mut read));
        written
    }

    #[test]
    fn a_swinging_mass_pulls_by_its_spring_alone() {
        // The rigid payload gives −m·a; with u = 1 mm and u̇ = −20 mm/s at 8 Hz and ζ = 0.1 the sum of both must be the
        // force of spring and damper, m·(ω²·u + 2ζω·u̇) = 2·(2.526619 − 0.201062) N, whatever a is.
        let payload = Payload::new(2.0, [0.0, 0.0, -0.1], 0.0);
        let mut motion = testing::still();
        motion.bodies[END_EFFECTOR].acceleration = Vector3::new(15.0, -6.0, 4.0);
        let (force, moment) = pull(&payload, &motion, &[1e-3, 0.0, -0.02, 0.0]).unwrap();
        approx::assert_relative_eq!(force.x - 2.0 * 15.0, 4.651_114, epsilon = 1e-5);
        approx::assert_relative_eq!(force.y + 2.0 * 6.0, 0.0, epsilon = 1e-12);
        assert_eq!(force.z, 0.0);
        // 0.1 m below the flange: M = (0, 0, −0.1) × F.
        approx::assert_relative_eq!(moment, Vector3::new(0.1 * force.y, -0.1 * force.x, 0.0), epsilon = 1e-12);
    }

    #[test]
    fn its_place_turns_with_the_end_effector() {
        // 0.2 m beside the axis, turning with 5 rad/s and 30 rad/s²: a = (−0.2·25, 0.2·30) m/s² = (−5, 6) without
        // spring force.
        let payload = Payload::new(1.5, [0.2, 0.0, 0.0], 0.0);
        let mut motion = testing::still();
        motion.bodies[END_EFFECTOR].angular_velocity.z = 5.0;
        motion.bodies[END_EFFECTOR].angular_acceleration.z = 30.0;
        let (force, moment) = pull(&payload, &motion, &[0.0; 4]).unwrap();
        approx::assert_relative_eq!(force, Vector3::new(-7.5, 9.0, 0.0), epsilon = 1e-12);
        approx::assert_relative_eq!(moment.z, 1.8, epsilon = 1e-12);
    }

    #[test]
    fn without_payload_nothing_swings() {
        let mut motion = testing::still();
        motion.bodies[END_EFFECTOR].acceleration.x = 15.0;
        assert_eq!(pull(&Payload::default(), &motion, &[1.0; 4]), None);
    }
}
