//! Compliance of the frame in which the robot hangs.

use nalgebra::Vector3;

use super::{
    About, Count, Effect, Instant, InternalStates, Oscillator, Parameter, Part, Reads, Role, Spec, Start, Sway, Unit,
    Values, Wrenches,
};
use crate::machine::bodies::Inertia;

/// Two horizontal modes of the frame, each a mass M on a spring k and a damper d: with the displacement u of the base
/// in x or y, M·ü = −k·u − d·u̇ − Σ m_i·(a_i + ü), and −m_i·ü on every body at its centre of mass.
///
/// All quantities of the model are relative to the base, so a_i (m/s², of the centres of mass) does not contain ü, and
/// joint angles and platform motion are those measured. With the total mass M_t = M + Σ m_i, y = M_t·u, ω² = k/M_t and
/// 2ζω = d/M_t the equation is ÿ = −ω²·y − 2ζω·ẏ − Σ m_i·a_i, and the force −m_i·s·ÿ is proportional to s = 1/M_t
/// (1/kg); s = 0 is a rigid frame, and s < 1/Σ m_i for every frame. Frequency ω/2π (Hz) and ζ are those of the frame
/// with the robot's joints held and its payload: M = 1/s − Σ m_i, k = ω²/s, d = 2ζω/s.
///
/// Internal states are y (kg·m) and ẏ in x and y; a run or a recording starts in equilibrium with its first
/// acceleration, y = −Σ m_i·a_i/ω². With u = s·y the frame holds k·u²/2 + M_t·u̇²/2 + u̇·Σ m_i·v_i and dissipates d·u̇²:
/// the effect's work on the bodies is the negative of both. Forces from outside the frame (contacts) do not move it.
///
/// In the twin ÿ and the accelerations of the bodies depend on each other, by at most s·Σ m_i.
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

/// Frequencies from which the search starts in each direction, Hz: every frame between 4 and 25 Hz is within a factor of
/// 1.26 of one of them, and an iteration from there finds it.
const GRID: [f64; 4] = [5.0, 7.9, 12.6, 20.0];

/// All pairs of frequencies, Hz. Equal ones come first: their columns are those of all other pairs.
static PAIRS: [[f64; 2]; GRID.len() * GRID.len()] = {
    let mut pairs = [[0.0; 2]; GRID.len() * GRID.len()];
    let mut i = 0;
    while i < pairs.len() {
        pairs[i] = [GRID[i % GRID.len()], GRID[(i % GRID.len() + i / GRID.len()) % GRID.len()]];
        i += 1;
    }
    pairs
};

/// Starting values: all pairs of frequencies, damped so that each responds between its neighbours.
static STARTS: [Start; GRID.len() * GRID.len()] = {
    const NONE: Start = Start([None; 3]);
    let mut starts = [NONE; GRID.len() * GRID.len()];
    let mut i = 0;
    while i < starts.len() {
        starts[i] = Start([Some((FREQUENCY, &PAIRS[i])), Some((DAMPING_RATIO, &[0.1, 0.1])), None]);
        i += 1;
    }
    starts
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
.reads(Reads { accelerations: true, inertia: true, ..Reads::MOTION })
// Factors for randomly drawn frames in the validation; the diagnosis uses the starts.
.grids(&[&[0.5, 0.7, 1.0, 1.5, 2.0]])
.starts(&STARTS)
.by_item();

/// Bodies that the frame carries. One without mass of its own may have the first moment that a fit gave it.
fn carried<'a>(at: &Instant<'a>) -> impl Iterator<Item = (usize, &'a Inertia)> {
    at.bodies.0.iter().enumerate().filter(|(_, inertia)| **inertia != Inertia::ZERO)
}

/// Σ m_i·a_i of the centres of mass in x and y, N.
fn inertial_force(at: &Instant) -> [f64; 2] {
    let mut sum = Vector3::zeros();
    for (body, inertia) in carried(at) {
        let motion = &at.motion.bodies[body];
        let h = motion.rotation * inertia.first_moment;
        let omega = motion.angular_velocity;
        sum +=
            motion.acceleration * inertia.mass + motion.angular_acceleration.cross(&h) + omega.cross(&omega.cross(&h));
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
            for (body, inertia) in carried(at) {
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

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;
    use std::sync::Arc;

    use super::*;
    use crate::effects::{ActiveEffect, testing};
    use crate::kinematics::{Motion, Reactions, SocketSet};
    use crate::machine::bodies::{ARM, PLATFORM};
    use crate::machine::{Bodies, Payload};

    /// Calls `read` with an instant of a robot with these bodies.
    fn at<T>(t: f64, motion: &Motion, bodies: &Bodies, state: &[f64], read: impl FnOnce(&Instant) -> T) -> T {
        read(&Instant {
            t,
            motion,
            geometry: &crate::machine::testing::geometry(),
            bodies,
            payload: &Payload::default(),
            gravity: 9.81,
            reactions: &Reactions::default(),
            state,
            torque: [0.0; 4],
            load: None,
            closed: SocketSet::ALL,
        })
    }

    #[test]
    fn a_shaken_mass_moves_the_frame_as_the_two_masses_do() {
        // Frame M = 245 kg on k and d, 8 Hz and ζ = 0.04 with the mass m = 5 kg that moves by 0.1 m·sin(2π·5 Hz·t)
        // relative to it. M·ü = −k·u − d·u̇ − m·(ẍ + ü) is (M + m)·ü + d·u̇ + k·u = m·Ω²·X·sin Ωt.
        let (frame, mass, size, shake) = (245.0, 5.0, 0.1, TAU * 5.0);
        let omega = TAU * 8.0;
        let (k, d) = (250.0 * omega * omega, 250.0 * 2.0 * 0.04 * omega);
        let force = mass * shake * shake * size;
        let (inertial, damping) = (k - (frame + mass) * shake * shake, d * shake);
        let (amplitude, lag) = (force / inertial.hypot(damping), damping.atan2(inertial));

        let total: f64 = k / (omega * omega);
        let active = ActiveEffect::new(
            Arc::new(FrameCompliance),
            &[&[1.0 / total, 0.0], &[8.0, 9.0], &[d / (2.0 * omega * total), 0.1]],
        );
        let mut bodies = testing::no_bodies();
        bodies[PLATFORM].mass = mass;
        let moving = |t: f64| {
            let mut motion = testing::still();
            motion.bodies[PLATFORM].acceleration.x = -size * shake * shake * (shake * t).sin();
            motion
        };
        // 10 s: the beginning has decayed by e^−20.
        let h = 4e-4;
        let mut state = vec![0.0; Sway::STATES];
        let mut worst = 0f64;
        for step in 0..25_000 {
            let t = f64::from(step) * h;
            let (now, next) = (moving(t), moving(t + h));
            state = at(t, &now, &bodies, &state, |from| {
                at(t + h, &next, &bodies, &[], |to| active.step_along(from, to).unwrap())
            });
            if step > 24_000 {
                let mut pulled = 0.0;
                at(t + h, &next, &bodies, &state, |at| {
                    let mut read = |k: usize, body: usize, force: Vector3<f64>, _: Vector3<f64>| {
                        if body == PLATFORM {
                            pulled += active.values[k] * force.x;
                        }
                    };
                    FrameCompliance.wrenches(&active.values(), at, &mut Wrenches::new(at.motion, &mut read));
                });
                let exact = mass * amplitude * shake * shake * (shake * (t + h) - lag).sin();
                worst = worst.max((pulled - exact).abs() / (mass * amplitude * shake * shake));
            }
        }
        // Linear interpolation of the inertial force leaves (Ω·h)²/12 of y, (ω·h)²/12 = 3.37e-5 of ÿ.
        assert!(worst < 3.5e-5, "{worst:e}");
    }

    #[test]
    fn the_force_acts_at_the_centre_of_mass() {
        // A mass of 2 kg, 0.3 m along x from its body's origin, turning about y with 50 rad/s² and 10 rad/s: its centre
        // has the acceleration (−0.3·10², 0, −0.3·50) m/s² = (−30, 0, −15). On a free frame of 1/s = 100 kg: ÿ = 60 N,
        // and per unit of s −2·60 N along x; about y z·F_x − x·F_z with the centre at z = 0 none, about z none.
        let mut bodies = testing::no_bodies();
        (bodies[ARM].mass, bodies[ARM].first_moment.x) = (2.0, 0.6);
        let mut motion = testing::still();
        motion.bodies[ARM].angular_velocity.y = 10.0;
        motion.bodies[ARM].angular_acceleration.y = 50.0;
        let active = ActiveEffect::absent(Arc::new(FrameCompliance));
        let written = |motion: &Motion| {
            let mut all = Vec::new();
            at(0.0, motion, &bodies, &[0.0; 4], |at| {
                let mut read = |k, body, force, moment| all.push((k, body, force, moment));
                FrameCompliance.wrenches(&active.values(), at, &mut Wrenches::new(at.motion, &mut read));
            });
            all
        };
        let flat = written(&motion);
        assert_eq!(flat.len(), 2);
        assert_eq!(flat[0], (0, ARM, Vector3::new(-120.0, 0.0, 0.0), Vector3::zeros()));
        assert_eq!(flat[1].2, Vector3::zeros());
        // Turned by 90° about z the centre lies on y: the same turning gives no horizontal acceleration.
        motion.bodies[ARM].rotation = nalgebra::Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
        assert!(written(&motion)[0].2.norm() < 1e-12);
        // The lever (0, 0.3, 0) m turns a force along x about −z: 4 m/s² of the origin, 8 N, −16 N, 4.8 N·m.
        motion.bodies[ARM].angular_velocity.y = 0.0;
        motion.bodies[ARM].angular_acceleration.y = 0.0;
        motion.bodies[ARM].acceleration.x = 4.0;
        let turned = written(&motion)[0];
        assert_eq!(turned.2, Vector3::new(16.0, 0.0, 0.0));
        approx::assert_relative_eq!(turned.3, Vector3::new(0.0, 0.0, -4.8), epsilon = 1e-12);
    }

    #[test]
    fn a_first_moment_without_mass_counts() {
        // h = (0.6, 0, 0.2) kg·m turns about z with 10 rad/s: Σ m·a = (−0.6·10², 0) N, ÿ = 60 N. Without mass no force, and
        // ÿ × h = (60, 0, 0) × (0.6, 0, 0.2) = (0, −12, 0) per unit of s.
        let mut bodies = testing::no_bodies();
        bodies[ARM].first_moment = Vector3::new(0.6, 0.0, 0.2);
        let mut motion = testing::still();
        motion.bodies[ARM].angular_velocity.z = 10.0;
        let active = ActiveEffect::absent(Arc::new(FrameCompliance));
        let mut all = Vec::new();
        at(0.0, &motion, &bodies, &[0.0; 4], |at| {
            let mut read = |k, body, force: Vector3<f64>, moment| all.push((k, body, force.norm(), moment));
            FrameCompliance.wrenches(&active.values(), at, &mut Wrenches::new(at.motion, &mut read));
        });
        assert_eq!(all[0], (0, ARM, 0.0, Vector3::new(0.0, -12.0, 0.0)));
    }

    #[test]
    fn in_equilibrium_there_is_no_force() {
        let mut bodies = testing::no_bodies();
        bodies[PLATFORM].mass = 5.0;
        let mut motion = testing::still();
        motion.bodies[PLATFORM].acceleration = Vector3::new(20.0, -7.0, 3.0);
        let active = ActiveEffect::absent(Arc::new(FrameCompliance));
        let state = at(0.0, &motion, &bodies, &[], |at| active.steady_state(at));
        // 100 N at 9 Hz: −100/(2π·9)² = −0.031272 kg·m, 78 µm of a frame of 400 kg.
        approx::assert_relative_eq!(state[0], -0.031_272, epsilon = 1e-6);
        at(0.0, &motion, &bodies, &state, |at| {
            let mut read = |_, _, force: Vector3<f64>, _| assert!(force.norm() < 1e-12, "{force}");
            FrameCompliance.wrenches(&active.values(), at, &mut Wrenches::new(at.motion, &mut read));
        });
    }
}
