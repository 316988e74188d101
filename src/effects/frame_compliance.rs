//! Compliance of the frame in which the robot hangs.

use nalgebra::Vector3;

use super::{
    About, Count, Effect, Instant, InternalStates, Oscillator, Parameter, Part, Reads, Role, Spec, Start, Sway, Unit,
    Values, Wrenches,
};

/// Two horizontal modes of the frame, each a mass M on a spring k and a damper d: with the displacement u of the base
/// in x or y, M·ü = −k·u − d·u̇ − Σ m_i·(a_i + ü), and −m_i·ü on every body at its centre of mass.
///
/// All quantities of the model are relative to the base, so a_i (m/s², of the centres of mass) does not contain ü, and
/// joint angles and platform motion are those measured. With the total mass M_t = M + Σ m_i, y = M_t·u, ω² = k/M_t and
/// 2ζω = d/M_t the equation is ÿ = −ω²·y − 2ζω·ẏ − Σ m_i·a_i, and the force −m_i·s·ÿ is proportional to s = 1/M_t
/// (1/kg); s = 0 is a rigid frame, and s < 1/Σ m_i for every frame. Frequency ω/2π (Hz) and ζ are those of the frame
/// with the resting robot and its payload: M = 1/s − Σ m_i, k = ω²/s, d = 2ζω/s.
///
/// Internal states are y (kg·m) and ẏ in x and y; a run or a recording starts in equilibrium with its first
/// acceleration, y = −Σ m_i·a_i/ω². With u = s·y the frame holds k·u²/2 + M_t·u̇²/2 + u̇·Σ m_i·v_i and dissipates d·u̇²:
/// the effect's work on the bodies is the negative of both. Forces from outside the frame (contacts) do not move it.
///
/// In the twin ÿ and the accelerations depend on each other; the force of one on the other is at most s·Σ m_i.
pub struct FrameCompliance;

const INVERSE_MASS: usize = 0;
const FREQUENCY: usize = 1;
const DAMPING_RATIO: usize = 2;

const fn horizontal(name: &'static str, unit: Unit, role: Role, default: f64, range: (f64, f64)) -> Parameter {
    Parameter::new(name, unit, role, default, range).counted(Count::Named(&["x", "y"]))
}

const PARAMETERS: &[Parameter] = &[
    horizontal("inverse_mass", Unit::PerKg, Role::Linear, 2.5e-3, (0.0, 0.02)),
    horizontal("frequency", Unit::Hz, Role::Shape, 9.0, (2.0, 40.0)),
    horizontal("damping_ratio", Unit::One, Role::Shape, 0.03, (1e-3, 0.7)),
];

/// Starting values: frequencies of both directions at a ratio of 1.3, damped so that each responds between its
/// neighbours.
const STARTS: [Start; 8] = {
    const fn at(frequency: &'static [f64]) -> Start {
        Start([Some((FREQUENCY, frequency)), Some((DAMPING_RATIO, &[0.1, 0.1])), None])
    }
    [
        at(&[4.0, 4.0]),
        at(&[5.2, 5.2]),
        at(&[6.8, 6.8]),
        at(&[8.8, 8.8]),
        at(&[11.4, 11.4]),
        at(&[14.8, 14.8]),
        at(&[19.3, 19.3]),
        at(&[25.0, 25.0]),
    ]
};

static SPEC: Spec = Spec::new(
    "frame_compliance",
    Part::Weight,
    About {
        summary: "the frame in which the robot hangs swings horizontally",
        law: "−m_i·s·ÿ on every body, ÿ = −ω²·y − 2ζω·ẏ − Σ m_i·a_i in x and y; s = 1/(frame + robot)",
        shows: "torque of all arms that swings on after horizontal acceleration, at 4–25 Hz wherever the robot is",
        source: "two masses and a spring [Den Hartog 1956]; frames of 100–1000 kg at 5–20 Hz, ζ of steel frames \
                 0.01–0.05 (estimates)",
    },
    PARAMETERS,
)
.reads(Reads { accelerations: true, ..Reads::MOTION })
// Factors for randomly drawn frames in the validation; the diagnosis uses the starts.
.grids(&[&[0.5, 0.7, 1.0, 1.5, 2.0]])
.starts(&STARTS);

/// Σ m_i·a_i of the centres of mass in x and y, N.
fn inertial_force(at: &Instant) -> [f64; 2] {
    let mut sum = Vector3::zeros();
    for (inertia, motion) in at.bodies.0.iter().zip(&at.motion.bodies) {
        let h = motion.rotation * inertia.first_moment;
        let omega = motion.angular_velocity;
        sum += motion.acceleration * inertia.mass + motion.angular_acceleration.cross(&h) + omega.cross(&omega.cross(&h));
    }
    [sum.x, sum.y]
}

/// The oscillators of y.
fn modes(values: &Values) -> Sway {
    let mode = |i: usize| Oscillator::new(values.block(FREQUENCY)[i], values.block(DAMPING_RATIO)[i]);
    Sway([mode(0), mode(1)])
}

impl Effect for FrameCompliance {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        let base = modes(values).acceleration(at.state, inertial_force(at));
        for (i, acceleration) in base.into_iter().enumerate() {
            let base = Vector3::ith(i, acceleration);
            for (body, inertia) in at.bodies.0.iter().enumerate().filter(|(_, inertia)| inertia.mass != 0.0) {
                let h = at.motion.bodies[body].rotation * inertia.first_moment;
                out.wrench(values.index(INVERSE_MASS, i), body, base * -inertia.mass, base.cross(&h));
            }
        }
    }

    fn states(&self) -> Option<&dyn InternalStates> {
        Some(self)
    }
}

impl InternalStates for FrameCompliance {
    fn initial_state(&self, _values: &Values) -> Vec<f64> {
        vec![0.0; Sway::STATES]
    }

    fn state_rate(&self, values: &Values, at: &Instant, rate: &mut [f64], _slope: &mut [f64]) {
        modes(values).state_rate(at.state, inertial_force(at), rate);
    }

    fn steady_state(&self, values: &Values, at: &Instant) -> Vec<f64> {
        modes(values).at_rest(inertial_force(at))
    }

    fn step_along(&self, values: &Values, from: &Instant, to: &Instant) -> Option<Vec<f64>> {
        Some(modes(values).after(from.state, to.t - from.t, inertial_force(from), inertial_force(to)))
    }
}
