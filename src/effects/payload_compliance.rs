//! A payload that swings in its gripper.

use nalgebra::Vector3;

use super::{
    About, Effect, Instant, InternalStates, Oscillator, Parameter, Part, Reads, Role, Spec, Start, Sway, Unit,
    Values, Wrenches,
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
.reads(Reads { accelerations: true, ..Reads::MOTION })
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
