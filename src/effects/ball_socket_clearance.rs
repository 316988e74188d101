//! Play of the balls in worn cups, felt where the load along a strut changes its sign.

use nalgebra::Vector3;

use super::{
    About, Count, Effect, Instant, InternalStates, Parameter, Part, Reads, Role, Spec, Unit, Values, Wrenches,
};
use crate::kinematics::{PlateMotions, STILL, SocketSet, Twist};
use crate::machine::bodies::{END_EFFECTOR, PLATFORM, SLOTS, TELESCOPE_LOWER, arm};
use crate::machine::{PerLimb, StrutMatrix, StrutVector, each};
use crate::numerics::tanh;

/// Play g (m) of each strut of a limb along its axis, both sockets together: its length is l₂ + ½·g·x, with x → ±1 under
/// tension and compression.
///
/// x = x₃ follows the axial force F at the lower ball (N, tension positive) by three lags of the time T (s): T·ẋ₁ =
/// tanh(F/F₀) − x₁, T·ẋ₂ = x₁ − x₂, T·ẋ₃ = x₂ − x₃, with F₀ the force by which a ball moves through its cup. A run or a
/// recording starts at rest with its first load, x = tanh(F/F₀).
///
/// All quantities of the model are those without play; relative to them, the plate moves with its parts and the passive
/// arms as locked drives permit it while the struts of each limb elongate by ½·g_i·x̄_i, x̄ their mean. On three limbs the
/// platform translates by p with u_i·p = ½·g_i·x̄_i, u the direction of the struts. The effect is what their inertia, and the
/// mass of the telescope's lower end, oppose to the accelerations of these displacements, with ẍ = (x₁ − 2·x₂ + x₃)/T². It
/// is of first order in g. The tilt by the difference of both struts, which no drive feels, is omitted, as are changed
/// lever arms (p/l₂ of the forces), terms with rates and the inertia of the struts.
///
/// Over a cycle the struts take ∮ F·de ≥ 0 with e = ½·g·x: nothing while x follows F at once, for then F·de is the
/// differential of a potential, and more than nothing by the lags.
///
/// Valid for balls that their clamps do not seat along the strut, as in worn rings or without a spring: balls in new cups,
/// pressed on across the strut, have no play.
pub struct BallSocketClearance;

const GAP: usize = 0;
const FORCE: usize = 1;
const TIME: usize = 2;
/// Lags in a row.
const LAGS: usize = 3;
/// Play (m) beyond which a ball has left its cup, far beyond any that the law admits; a fit may try it.
const LEFT_ITS_CUP: f64 = 0.01;
/// Duration in which three lags forget their start, e⁻²⁰, over T.
const FORGOTTEN: f64 = 25.0;

const PARAMETERS: &[Parameter] = &[
    Parameter::new("gap", Unit::M, Role::Linear, 5e-4, (0.0, 5e-3)).counted(Count::PerLimb),
    Parameter::new("force", Unit::N, Role::Fixed, 10.0, (0.5, 1e3)),
    Parameter::new("time", Unit::S, Role::Fixed, 4e-3, (5e-4, 0.1)),
];

static SPEC: Spec = Spec::new(
    "ball_socket_clearance",
    Part::Linkage,
    About {
        summary: "play of the balls in their cups along the struts",
        law: "length l₂ + ½·g_i·x, x → tanh(F/F₀) by three lags of T; force −m·p̈ on the platform, u_i·p = ½·g_i·x̄_i",
        shows: "short pulses of all arm torques where the load of a strut changes its sign, none elsewhere",
        source: "loop closure with elongated struts; g: rings of the sockets wear by 0.1–1 mm (ABB manual); F₀, T estimates",
    },
    PARAMETERS,
)
.reads(Reads { inertia: true, ..Reads::MOTION });

/// x₁, x₂, x₃ of a strut.
fn lags(state: &[f64], strut: usize) -> [f64; LAGS] {
    std::array::from_fn(|k| state[LAGS * strut + k])
}

/// ẍ of a strut, 1/s².
fn acceleration(state: &[f64], strut: usize, time: f64) -> f64 {
    let [first, second, third] = lags(state, strut);
    (first - 2.0 * second + third) / (time * time)
}

/// Virtual motions of the plate; `None` where the struts do not hold it, or with an open socket.
fn motions(at: &Instant) -> Option<PlateMotions> {
    let all = SocketSet::of(at.motion.struts());
    PlateMotions::new(at.geometry, at.motion).ok().filter(|_| at.closed == all)
}

/// Forces and moments (per m/s² of elongation of both struts of `limb`, about the origins) that accelerate the displaced bodies.
fn resistance(at: &Instant, motions: &PlateMotions, limb: usize) -> [Twist; SLOTS] {
    let mut xi = [STILL; SLOTS];
    let mut arms: PerLimb<f64> = each(0.0);
    motions.spread(&motions.gaps_of(limb), &mut arms, &mut xi);
    if !at.geometry.plate.bodies().contains(&END_EFFECTOR) {
        let (v, omega) = xi[PLATFORM];
        xi[END_EFFECTOR] = (v + omega.cross(&lever(at, END_EFFECTOR)), omega);
    }
    for limb in at.motion.driven..at.motion.limbs {
        let screw = at.motion.arm_screw(limb);
        xi[arm(limb)] = (screw.linear * arms[limb], screw.angular * arms[limb]);
    }
    let mut out = [STILL; SLOTS];
    for (body, (linear, alpha)) in xi.iter().enumerate().filter(|(_, twist)| **twist != STILL) {
        let (inertia, rotation) = (&at.bodies[body], &at.motion.bodies[body].rotation);
        let h = rotation * inertia.first_moment;
        let turning = rotation * (inertia.tensor * rotation.tr_mul(alpha));
        out[body] = (linear * inertia.mass + alpha.cross(&h), h.cross(linear) + turning);
    }
    let hung = xi[PLATFORM].0 * at.bodies[TELESCOPE_LOWER].mass;
    out[PLATFORM].0 += hung;
    out[PLATFORM].1 += lever(at, TELESCOPE_LOWER).cross(&hung);
    out
}

/// Vector from the platform's origin to the origin of a body, m.
fn lever(at: &Instant, body: usize) -> Vector3<f64> {
    at.motion.bodies[body].position - at.motion.bodies[PLATFORM].position
}

/// Forces that the struts lose per ẍ of each strut, N·s², without those by the pull of the telescope, which takes the moment
/// about the end effector's axis.
fn relief(values: &Values, at: &Instant) -> StrutMatrix {
    let mut out = StrutMatrix::zeros();
    let Some(motions) = motions(at) else { return out };
    let parts = at.geometry.plate.bodies();
    let pivot = at.motion.bodies[PLATFORM].rotation.column(2).into_owned();
    for limb in 0..at.motion.limbs {
        let mut wrenches = resistance(at, &motions, limb);
        if !parts.contains(&END_EFFECTOR) {
            let (force, moment) = wrenches[END_EFFECTOR];
            let free = if at.geometry.has_end_effector() { pivot * pivot.dot(&moment) } else { STILL.1 };
            wrenches[PLATFORM].0 += force;
            wrenches[PLATFORM].1 += moment - free + lever(at, END_EFFECTOR).cross(&force);
        }
        let mut arms: PerLimb<f64> = each(0.0);
        for limb in at.motion.driven..at.motion.limbs {
            arms[limb] = at.motion.arm_screw(limb).effort(&wrenches[arm(limb)]);
        }
        let taken = motions.balance(&wrenches, &arms) * (0.25 * values.block(GAP)[limb]);
        out.set_column(2 * limb, &taken);
        out.set_column(2 * limb + 1, &taken);
    }
    out
}

/// ẍ of all struts, 1/s².
fn all_rates(state: &[f64], time: f64) -> StrutVector {
    let mut rates = StrutVector::zeros();
    (0..state.len() / LAGS).for_each(|s| rates[s] = acceleration(state, s, time));
    rates
}

/// Rates of the states under the forces F of the struts, N.
fn rates(values: &Values, state: &[f64], force: impl Fn(usize) -> f64, rate: &mut [f64]) {
    for strut in 0..state.len() / LAGS {
        let mut input = tanh(force(strut) / values.one(FORCE));
        for (k, x) in lags(state, strut).into_iter().enumerate() {
            rate[LAGS * strut + k] = (input - x) / values.one(TIME);
            input = x;
        }
    }
}

impl Effect for BallSocketClearance {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        let Some(motions) = motions(at) else { return };
        let rate = |strut: usize| acceleration(at.state, strut, values.one(TIME));
        for limb in 0..at.motion.limbs {
            let share = -0.25 * (rate(2 * limb) + rate(2 * limb + 1));
            for (body, (force, moment)) in resistance(at, &motions, limb).into_iter().enumerate() {
                if force != STILL.0 || moment != STILL.1 {
                    out.wrench(values.index(GAP, limb), body, force * share, moment * share);
                }
            }
        }
    }

    fn states(&self) -> Option<&dyn InternalStates> {
        Some(self)
    }
}

impl InternalStates for BallSocketClearance {
    fn initial_state(&self, values: &Values) -> Vec<f64> {
        vec![0.0; LAGS * 2 * values.block(GAP).len()]
    }

    fn reads_reactions(&self) -> bool {
        true
    }

    fn state_rate(&self, values: &Values, at: &Instant, rate: &mut [f64], slope: &mut [f64]) {
        rates(values, at.state, |strut| at.reactions.lower[strut], rate);
        slope.fill(-1.0 / values.one(TIME));
    }

    fn steady_state(&self, values: &Values, at: &Instant) -> Vec<f64> {
        let side = |strut: usize| [tanh(at.reactions.lower[strut] / values.one(FORCE)); LAGS];
        (0..2 * values.block(GAP).len()).flat_map(side).collect()
    }

    /// Along a motion the forces without the relief by ẍ are known; it may be so strong that x follows within microseconds.
    /// Classical Runge–Kutta with forces linear in between and the relief at the end; after a gap of [`FORGOTTEN`] times T in
    /// equilibrium. Not a number for a play with which a ball has left its cup.
    fn step_along(&self, values: &Values, from: &Instant, to: &Instant) -> Option<Vec<f64>> {
        let (h, time) = (to.t - from.t, values.one(TIME));
        if values.block(GAP).iter().any(|gap| gap.abs() > LEFT_ITS_CUP) {
            return Some(vec![f64::NAN; from.state.len()]);
        }
        if h > FORGOTTEN * time {
            return Some(self.steady_state(values, to));
        }
        let relief = relief(values, to);
        let own = |at: &Instant| StrutVector::from(at.reactions.lower) + relief * all_rates(at.state, time);
        let (before, after) = (own(from), own(to));
        // Rate of the fastest mode: (3 + κ)/T with κ = |relief|/(T²·F₀).
        let fastest = (3.0 + relief.norm() / (time * time * values.one(FORCE))) / time;
        let steps = (fastest * h).ceil().max(1.0) as usize;
        let step = h / steps as f64;
        let slope = |share: f64, state: &[f64]| {
            let force = before + (after - before) * share - relief * all_rates(state, time);
            let mut rate = vec![0.0; state.len()];
            rates(values, state, |s| force[s], &mut rate);
            rate
        };
        let ahead = |state: &[f64], rate: &[f64], h: f64| -> Vec<f64> {
            state.iter().zip(rate).map(|(x, rate)| x + h * rate).collect()
        };
        let mut state = from.state.to_vec();
        for k in 0..steps {
            let share = |part: f64| (k as f64 + part) / steps as f64;
            let first = slope(share(0.0), &state);
            let second = slope(share(0.5), &ahead(&state, &first, 0.5 * step));
            let third = slope(share(0.5), &ahead(&state, &second, 0.5 * step));
            let fourth = slope(share(1.0), &ahead(&state, &third, step));
            for (i, x) in state.iter_mut().enumerate() {
                *x += step / 6.0 * (first[i] + 2.0 * (second[i] + third[i]) + fourth[i]);
            }
        }
        Some(state)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use nalgebra::Matrix3;

    use super::*;
    use crate::dynamics::{Plant, inverse_dynamics};
    use crate::effects::{ActiveEffect, testing};
    use crate::kinematics::{JointState, Motion, Reactions};
    use crate::machine::{Bodies, Inertia, Payload, Setup, ThreeArms, six_struts};

    const PLAY: [&[f64]; 3] = [&[2e-4; 3], &[10.0], &[4e-3]];

    #[test]
    fn the_platform_drops_where_all_struts_lengthen() {
        // x₁ = 1 in all struts: ë = ½·0.2 mm/(4 ms)² = 6.25 m/s² of each. At home u_z = −0.893382/1.106, so that the platform
        // falls by 1.237992 of it; 2 kg resist upwards by 15.4749 N.
        let geometry = crate::machine::testing::geometry();
        let motion = Motion::assembled(&geometry, &JointState::default()).unwrap();
        let mut bodies = Bodies([Inertia::ZERO; SLOTS]);
        bodies[PLATFORM] = Inertia::diagonal(2.0, [0.0; 3], [0.01; 3]);
        let state = [1.0, 0.0, 0.0].repeat(six_struts().len());
        let (mut force, mut moment) = (Vector3::zeros(), Vector3::zeros());
        testing::at(&motion, &state, |at| {
            let at = &Instant { bodies: &bodies, ..*at };
            let active = ActiveEffect::new(Arc::new(BallSocketClearance), &PLAY);
            let mut add = |k: usize, _: usize, f: Vector3<f64>, m: Vector3<f64>| {
                force += f * active.values[k];
                moment += m * active.values[k];
            };
            BallSocketClearance.wrenches(&active.values(), at, &mut Wrenches::new(&motion, &mut add));
        });
        approx::assert_relative_eq!(force, Vector3::z() * 15.4749, epsilon = 1e-3);
        approx::assert_relative_eq!(moment, Vector3::zeros(), epsilon = 1e-10);
    }

    /// The forces of drives and struts are those of a platform that really has the acceleration p̈.
    #[test]
    fn forces_are_those_of_the_moving_platform() {
        let mut model = crate::model::testing::irb360();
        model.effects.clear();
        let setup = Setup { payload: Payload::new(2.0, [0.03, -0.02, -0.1], 0.01), ..Setup::default() };
        // Only the mass of the telescope's lower part is displaced.
        model.bodies[TELESCOPE_LOWER].first_moment = Vector3::zeros();
        let plain = Plant::new(&model, &setup);
        model.effects.push(ActiveEffect::new(Arc::new(BallSocketClearance), &PLAY));
        let with = Plant::new(&model, &setup);
        let motion = plain.motion(&JointState { q: [0.3, -0.2, 0.6, 0.4], ..JointState::default() }).unwrap();
        let state: Vec<f64> = (0..LAGS * six_struts().len()).map(|k| (1.7 * k as f64).sin()).collect();
        let rates = all_rates(&state, 4e-3);
        // u·p̈ = ½·0.2 mm·mean of ẍ.
        let axes: ThreeArms<_> = std::array::from_fn(|i| motion.strut_axis[2 * i].transpose());
        let along = Vector3::from_fn(|i, _| 1e-4 * 0.5 * (rates[2 * i] + rates[2 * i + 1]));
        let linear = Matrix3::from_rows(&axes).try_inverse().unwrap() * along;
        let mut moved = motion;
        for body in [PLATFORM, END_EFFECTOR, TELESCOPE_LOWER] {
            moved.bodies[body].acceleration += linear;
        }
        let still = inverse_dynamics(&plain, 0.0, &motion, &[], true).unwrap();
        let expected = inverse_dynamics(&plain, 0.0, &moved, &[], true).unwrap();
        let played = inverse_dynamics(&with, 0.0, &motion, &[&state], true).unwrap();
        assert!(played.change(&still) > 1.0);
        assert!(played.tau.iter().zip(expected.tau).all(|(a, b)| (a - b).abs() < 1e-9));
        let mut relieved = StrutVector::zeros();
        for s in six_struts() {
            approx::assert_relative_eq!(played.reactions.lower[s], expected.reactions.lower[s], epsilon = 1e-9);
            relieved[s] = still.reactions.lower[s] - played.reactions.lower[s];
        }
        testing::at(&motion, &state, |at| {
            let at = Instant { bodies: &with.bodies, ..*at };
            let found = relief(&with.effects[0].values(), &at) * rates;
            assert!((found - relieved).norm() < 0.05 * relieved.norm(), "{found} {relieved}");
        });
        // A pair that gives way is relieved.
        assert!(relieved.dot(&rates) > 1.0);
    }

    #[test]
    fn a_step_of_any_length_is_that_of_many_short_ones() {
        let mut model = crate::model::testing::irb360();
        model.effects = vec![ActiveEffect::new(Arc::new(BallSocketClearance), &[&[1e-3; 3], &[10.0], &[4e-3]])].into();
        let plant = Plant::new(&model, &Setup::default());
        let motion = plant.motion(&JointState { q: [0.3, -0.2, 0.6, 0.4], ..JointState::default() }).unwrap();
        let active = &plant.effects[0];
        let zero = active.initial_state();
        // The motion's own forces change from −30 N to 30 N within 4 ms; those felt are less the relief.
        let at = |t: f64, state: &[f64], read: &mut dyn FnMut(&Instant)| {
            let base = Instant { bodies: &plant.bodies, state, ..plant.instant(t, &motion, state) };
            let own = relief(&active.values(), &base) * all_rates(state, 4e-3);
            let force = |s: usize| 30.0 * (t / 2e-3 - 1.0) * if s == 3 { -1.0 } else { 1.0 } - own[s];
            let reactions = Reactions::of(&[], &six_struts().map(force).collect::<Vec<_>>());
            read(&Instant { reactions: &reactions, ..base });
        };
        let advanced = |count: u32| {
            let (mut state, h) = (zero.clone(), 4e-3 / f64::from(count));
            for k in 0..count {
                let (mut next, now) = (Vec::new(), state.clone());
                at(f64::from(k) * h, &now, &mut |from| {
                    at(f64::from(k + 1) * h, &now, &mut |to| next = active.step_along(from, to).unwrap());
                });
                state = next;
            }
            state
        };
        let (one, many) = (advanced(1), advanced(400));
        assert!(many.iter().any(|x| x.abs() > 0.1), "{many:?}");
        for (a, b) in one.iter().zip(&many) {
            assert!((a - b).abs() < 1e-2, "{a} {b}");
        }
        for (a, b) in advanced(10).iter().zip(&many) {
            assert!((a - b).abs() < 1e-4, "{a} {b}");
        }
    }

    #[test]
    fn a_cycle_of_the_load_takes_energy_and_a_slow_one_none() {
        let active = ActiveEffect::new(Arc::new(BallSocketClearance), &PLAY);
        let motion = testing::still();
        // ∮ F·de of strut 1 over the second period of F = 8 + 40·sin, J.
        let lost = |period: f64| {
            let (steps, mut state, mut work) = (20_000, vec![0.0; LAGS * six_struts().len()], 0.0);
            let h = period / f64::from(steps);
            for k in 0..2 * steps {
                let mut reactions = Reactions::default();
                let force = 8.0 + 40.0 * (f64::from(k) / f64::from(steps) * std::f64::consts::TAU).sin();
                reactions.lower[0] = force;
                let (mut rate, mut slope) = (vec![0.0; state.len()], vec![0.0; state.len()]);
                testing::at(&motion, &state, |at| {
                    active.state_rate(&Instant { reactions: &reactions, ..*at }, &mut rate, &mut slope);
                });
                state.iter_mut().zip(&rate).for_each(|(x, rate)| *x += h * rate);
                work += if k >= steps { force * 1e-4 * rate[2] * h } else { 0.0 };
            }
            work
        };
        let losses = [40.0, 1.0, 0.2, 0.08].map(lost);
        assert!(losses.windows(2).all(|w| w[0] > 0.0 && w[1] > 1.5 * w[0]), "{losses:?}");
        // Of a potential: what a lag of 12 ms leaves of it at 40 s.
        assert!(losses[0] < 0.01 * losses[3], "{losses:?}");
    }
}
