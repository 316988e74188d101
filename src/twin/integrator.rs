//! One step of the twin: a Rosenbrock-W method on the Lie group, followed by projection.
//!
//! ROS34PW2 [Rang & Angermann, 2005]: four stages, order 3 for any approximation A of the Jacobian (W-method), stiffly
//! accurate. A holds the damping of the drives and of the strut spins, the only stiff terms of a rigid mechanism:
//!
//! (1 − hγA)·kᵢ = F(yₙ + h Σ αᵢⱼ kⱼ) + hA Σ γᵢⱼ kⱼ,  yₙ₊₁ = yₙ + h Σ bᵢ kᵢ.
//!
//! After the step the joints hold again to rounding: arms, rotor, struts and telescope are re-assembled in closed form,
//! the struts' lengths by a mass-weighted Newton step, and the twists by a mass-weighted projection.
//!
//! J. Rang, L. Angermann: New Rosenbrock W-methods of order 3 for partial differential algebraic equations of index 1,
//! BIT 45 (2005).

use nalgebra::{Quaternion, Rotation3, SVector, UnitQuaternion, Vector3};

use super::equations::{self, Accelerations, Condensed, Damping, SingularPose};
use super::state::{State, WORK_EFFECTS, WORK_SPIN, rotation, wrapped};
use crate::dynamics::Plant;
use crate::effects::Instant;
use crate::kinematics::motion::telescope_rotation;
use crate::kinematics::{Motion, Reactions, SocketSet};
use crate::model::bodies::{ARM, BODIES, END_EFFECTOR, PLATFORM, ROTOR, STRUT, TELESCOPE_LOWER, TELESCOPE_UPPER};
use crate::model::{ARMS, Geometry, STRUTS};

const STAGES: usize = 4;
const GAMMA: f64 = 4.358_665_215_084_59e-1;
const ALPHA: [[f64; STAGES]; STAGES] = [
    [0.0, 0.0, 0.0, 0.0],
    [8.717_330_430_169_18e-1, 0.0, 0.0, 0.0],
    [8.445_706_001_536_942e-1, -1.129_906_423_648_418_5e-1, 0.0, 0.0],
    [0.0, 0.0, 1.0, 0.0],
];
const GAMMAS: [[f64; STAGES]; STAGES] = [
    [0.0, 0.0, 0.0, 0.0],
    [-8.717_330_430_169_18e-1, 0.0, 0.0, 0.0],
    [-9.033_805_701_304_408e-1, 5.418_067_238_809_532_6e-2, 0.0, 0.0],
    [2.421_238_070_609_534_6e-1, -1.223_250_583_904_514_7, 5.452_602_553_351_021e-1, 0.0],
];
const B: [f64; STAGES] =
    [2.421_238_070_609_534_6e-1, -1.223_250_583_904_514_7, 1.545_260_255_335_102, 4.358_665_215_084_59e-1];

/// Time derivative of a state.
#[derive(Clone)]
struct Derivative {
    bodies: [BodyDerivative; BODIES],
    drives: [f64; 4],
    spins: [f64; STRUTS],
    rotor_rate: f64,
    own: Vec<f64>,
    work: Vec<f64>,
}

#[derive(Clone, Copy)]
struct BodyDerivative {
    velocity: Vector3<f64>,
    orientation: Quaternion<f64>,
    acceleration: Vector3<f64>,
    angular_acceleration: Vector3<f64>,
}

/// Drive torques over a step as a function of time.
pub type Torque<'a> = &'a dyn Fn(f64) -> [f64; 4];

/// One step of length `h` from `state`; returns the strut reactions at its start.
pub fn step(
    plant: &Plant,
    state: &mut State,
    h: f64,
    torque: Torque,
    guess: &Reactions,
) -> Result<Reactions, SingularPose> {
    let spin_restraint = plant.spin_damping;
    let damping = damping(plant, spin_restraint, state, guess);
    let implicit = damping.drives.map(|d| h * GAMMA * d);
    let spin_inertia: [f64; STRUTS] =
        std::array::from_fn(|s| plant.bodies[STRUT + s].tensor[(0, 0)] + h * GAMMA * damping.spins[s]);
    let mut reactions = *guess;
    let mut at_start = *guess;
    let mut k: Vec<Derivative> = Vec::with_capacity(STAGES);
    for i in 0..STAGES {
        let stage = advanced(state, h, &k, &ALPHA[i]);
        let t = state.t + h * ALPHA[i].iter().sum::<f64>();
        let mut extra = Damping::default();
        for (j, kj) in k.iter().enumerate() {
            let w = -h * GAMMAS[i][j];
            for a in 0..4 {
                extra.drives[a] += w * damping.drives[a] * kj.drives[a];
            }
            for s in 0..STRUTS {
                extra.spins[s] += w * damping.spins[s] * kj.spins[s];
            }
        }
        let motion = stage.motion(&plant.geometry);
        let condensed = Condensed::new(plant, &motion, &implicit)?;
        let tau = torque(t);
        let (acc, powers) = solve(
            plant,
            t,
            &motion,
            &stage.own,
            &condensed,
            &tau,
            &extra,
            &spin_inertia,
            spin_restraint,
            &mut reactions,
        );
        if i == 0 {
            at_start = reactions;
        }
        k.push(derivative(plant, t, &stage, &motion, &acc, &tau, powers, spin_restraint));
    }
    *state = advanced(state, h, &k, &B);
    state.t += h;
    project(plant, state)?;
    Ok(at_start)
}

/// Accelerations, with reactions and the friction that reads them solved together.
#[allow(clippy::too_many_arguments)]
fn solve(
    plant: &Plant,
    t: f64,
    motion: &Motion,
    own: &[f64],
    condensed: &Condensed,
    tau: &[f64; 4],
    extra: &Damping,
    spin_inertia: &[f64; STRUTS],
    spin_restraint: f64,
    reactions: &mut Reactions,
) -> (Accelerations, Vec<f64>) {
    let reads = plant.effects.iter().any(|a| a.effect.reads_reactions());
    let mut iterations = 0;
    loop {
        let loads = equations::loads(plant, t, motion, own, reactions);
        let acc = equations::accelerations(plant, motion, condensed, &loads, tau, extra, spin_inertia, spin_restraint);
        let difference =
            |a: &[f64; STRUTS], b: &[f64; STRUTS]| a.iter().zip(b).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
        let change =
            difference(&acc.reactions.upper, &reactions.upper).max(difference(&acc.reactions.lower, &reactions.lower));
        *reactions = acc.reactions;
        iterations += 1;
        if !reads || change < REACTION_TOLERANCE || iterations == MAX_REACTION_ITERATIONS {
            return (acc, loads.powers);
        }
    }
}

/// Change of the strut forces at which the iteration over load-dependent friction stops, N.
const REACTION_TOLERANCE: f64 = 1e-9;
const MAX_REACTION_ITERATIONS: usize = 50;

/// Motion with accelerations, and the strut reactions, of the twin at a state.
pub fn accelerations(
    plant: &Plant,
    state: &State,
    tau: &[f64; 4],
    guess: &Reactions,
) -> Result<(Motion, Reactions), SingularPose> {
    let mut motion = state.motion(&plant.geometry);
    let condensed = Condensed::new(plant, &motion, &[0.0; 4])?;
    let spin_inertia: [f64; STRUTS] = std::array::from_fn(|s| plant.bodies[STRUT + s].tensor[(0, 0)]);
    let mut reactions = *guess;
    let (acc, _) = solve(
        plant,
        state.t,
        &motion,
        &state.own,
        &condensed,
        tau,
        &Damping::default(),
        &spin_inertia,
        plant.spin_damping,
        &mut reactions,
    );
    for b in 0..BODIES {
        (motion.bodies[b].acceleration, motion.bodies[b].angular_acceleration) = acc.bodies[b];
    }
    for i in 0..ARMS {
        motion.qdd[i] = acc.bodies[ARM + i].1.dot(&Geometry::tangential(i));
    }
    motion.qdd[3] = acc.bodies[ROTOR].1.z;
    Ok((motion, reactions))
}

/// Damping of drives and spins at a state by one-sided differences of the effects' loads; never negative.
fn damping(plant: &Plant, spin_restraint: f64, state: &State, reactions: &Reactions) -> Damping {
    const RATE: f64 = 1e-6;
    let motion = state.motion(&plant.geometry);
    let base = equations::loads(plant, state.t, &motion, &state.own, reactions);
    let mut moved = motion;
    for a in 0..4 {
        moved.qd[a] += RATE;
    }
    let driven = equations::loads(plant, state.t, &moved, &state.own, reactions);
    let mut moved = motion;
    for s in 0..STRUTS {
        moved.bodies[STRUT + s].angular_velocity += motion.strut_axis[s] * RATE;
    }
    let spun = equations::loads(plant, state.t, &moved, &state.own, reactions);
    let slope = |b: usize, axis: &Vector3<f64>, other: &equations::Loads| {
        ((base.wrenches[b].1 - other.wrenches[b].1).dot(axis) / RATE).max(0.0)
    };
    Damping {
        drives: std::array::from_fn(|a| {
            let (body, axis) = Motion::drive(a);
            slope(body, &axis, &driven)
        }),
        spins: std::array::from_fn(|s| spin_restraint + slope(STRUT + s, &motion.strut_axis[s], &spun)),
    }
}

fn advanced(state: &State, h: f64, k: &[Derivative], weights: &[f64; STAGES]) -> State {
    let mut next = state.clone();
    for (kj, w) in k.iter().zip(weights) {
        let w = h * w;
        if w == 0.0 {
            continue;
        }
        for (body, d) in next.bodies.iter_mut().zip(&kj.bodies) {
            body.position += d.velocity * w;
            body.orientation += d.orientation * w;
            body.velocity += d.acceleration * w;
            body.angular_velocity += d.angular_acceleration * w;
        }
        for (x, d) in next.own.iter_mut().zip(&kj.own) {
            *x += d * w;
        }
        for (x, d) in next.work.iter_mut().zip(&kj.work) {
            *x += d * w;
        }
        next.psi += w * kj.rotor_rate;
    }
    next
}

fn derivative(
    plant: &Plant,
    t: f64,
    stage: &State,
    motion: &Motion,
    acc: &Accelerations,
    tau: &[f64; 4],
    powers: Vec<f64>,
    spin_restraint: f64,
) -> Derivative {
    let bodies = std::array::from_fn(|b| {
        let s = &stage.bodies[b];
        BodyDerivative {
            velocity: s.velocity,
            orientation: s.orientation * Quaternion::from_imag(s.angular_velocity) * 0.5,
            acceleration: acc.bodies[b].0,
            angular_acceleration: motion.bodies[b].rotation.tr_mul(&acc.bodies[b].1),
        }
    });
    let mut work = vec![0.0; WORK_EFFECTS];
    for a in 0..4 {
        work[a] = tau[a] * motion.qd[a];
    }
    for s in 0..STRUTS {
        work[WORK_SPIN] -= spin_restraint * stage.bodies[STRUT + s].angular_velocity.x.powi(2);
    }
    work.extend(powers);
    let mut own = vec![0.0; stage.own.len()];
    let mut at = 0;
    for active in &plant.effects {
        let n = active.states();
        if n > 0 {
            let instant = Instant {
                t,
                motion,
                bodies: &plant.bodies,
                gravity: plant.gravity,
                reactions: &acc.reactions,
                state: &stage.own[at..at + n],
                torque: *tau,
                closed: SocketSet::ALL,
            };
            active.effect.state_rate(&active.values(), &instant, &mut own[at..at + n], &mut vec![0.0; n]);
            at += n;
        }
    }
    Derivative {
        drives: std::array::from_fn(|a| {
            let (body, axis) = Motion::drive(a);
            acc.bodies[body].1.dot(&axis)
        }),
        spins: acc.spins,
        rotor_rate: stage.bodies[ROTOR].angular_velocity.z,
        bodies,
        own,
        work,
    }
}

/// Makes all joints hold again: 74 rows in position and velocity.
pub(super) fn project(plant: &Plant, state: &mut State) -> Result<(), SingularPose> {
    let geometry = &plant.geometry;
    let raw = state.motion(geometry);
    let mut q = raw.q;
    let mut nu = equations::open_velocities(&raw);
    let mut platform = (raw.bodies[PLATFORM].position, unit(&state.bodies[PLATFORM].orientation));
    let spins: [f64; STRUTS] = std::array::from_fn(|s| state.bodies[STRUT + s].angular_velocity.x);
    let condensed = Condensed::new(plant, &raw, &[0.0; 4])?;
    for _ in 0..MAX_CLOSURE_ITERATIONS {
        let gaps = strut_gaps(geometry, &q, &platform);
        if gaps.amax() < CLOSURE_TOLERANCE {
            break;
        }
        let (correction, _) = condensed.solve(&SVector::zeros(), &-gaps);
        for (angle, d) in q.iter_mut().zip(correction.iter()) {
            *angle += d;
        }
        platform.0 += correction.fixed_rows::<3>(4);
        platform.1 = UnitQuaternion::from_scaled_axis(correction.fixed_rows::<3>(7).into_owned()) * platform.1;
    }
    assemble(geometry, state, &q, &platform);
    let motion = state.motion(geometry);
    let closed = Condensed::new(plant, &motion, &[0.0; 4])?;
    for _ in 0..2 {
        let (correction, _) = closed.solve(&SVector::zeros(), &-closed.rates(&nu));
        nu += correction;
    }
    for (body, twist) in state.bodies.iter_mut().zip(equations::twists(&motion, &nu, &spins)) {
        body.velocity = twist.0;
        body.angular_velocity = rotation(&body.orientation).tr_mul(&twist.1);
    }
    Ok(())
}

/// Ball distance minus strut length at which the loops count as closed, m.
const CLOSURE_TOLERANCE: f64 = 1e-14;
const MAX_CLOSURE_ITERATIONS: usize = 5;

fn unit(q: &Quaternion<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::new_normalize(*q)
}

type PlatformPose = (Vector3<f64>, UnitQuaternion<f64>);

/// Upper and lower ball of strut `s`.
fn balls(geometry: &Geometry, s: usize, angle: f64, platform: &PlatformPose) -> (Vector3<f64>, Vector3<f64>) {
    let pair = Geometry::tangential(s / 2) * geometry.pair_offset(s);
    let upper = geometry.elbow(s / 2, angle) + pair;
    (upper, platform.0 + platform.1 * (Geometry::radial(s / 2) * geometry.platform_radius + pair))
}

fn strut_gaps(geometry: &Geometry, q: &[f64; 4], platform: &PlatformPose) -> SVector<f64, STRUTS> {
    SVector::from_fn(|s, _| {
        let (upper, lower) = balls(geometry, s, q[s / 2], platform);
        (lower - upper).norm() - geometry.strut_length[s / 2]
    })
}

/// Places all bodies for joint angles and a platform pose; struts keep their roll.
fn assemble(geometry: &Geometry, state: &mut State, q: &[f64; 4], platform: &PlatformPose) {
    for i in 0..ARMS {
        let azimuth = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), Geometry::azimuth(i));
        let arm = &mut state.bodies[ARM + i];
        arm.position = Geometry::radial(i) * geometry.base_radius;
        arm.orientation = *(azimuth * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), q[i]));
    }
    for s in 0..STRUTS {
        let (upper, lower) = balls(geometry, s, q[s / 2], platform);
        let strut = &mut state.bodies[STRUT + s];
        strut.position = upper;
        let old = unit(&strut.orientation);
        let axis = (lower - upper).normalize();
        // Smallest rotation from the old axis to the new one; exact for small angles too.
        let from = old * Vector3::x();
        let swing = UnitQuaternion::new_normalize(Quaternion::from_parts(1.0 + from.dot(&axis), from.cross(&axis)));
        strut.orientation = *(swing * old);
    }
    state.psi += wrapped(q[3] - state.psi);
    let rotor = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), state.psi);
    state.bodies[ROTOR].position = geometry.upper_hooke();
    state.bodies[ROTOR].orientation = *rotor;
    state.bodies[PLATFORM].position = platform.0;
    state.bodies[PLATFORM].orientation = *platform.1;
    let lower_hooke = platform.0 + platform.1 * (Vector3::z() * geometry.lower_hooke_height);
    let axis = (geometry.upper_hooke() - lower_hooke).normalize();
    let telescope = telescope_rotation(&axis, &(rotor * Vector3::x()));
    for (b, position) in [(TELESCOPE_UPPER, geometry.upper_hooke()), (TELESCOPE_LOWER, lower_hooke)] {
        state.bodies[b].position = position;
        state.bodies[b].orientation = *from_matrix(&telescope);
    }
    // The end effector turns about the platform's z; its cross axis x is normal to the telescope's cross axis.
    let pivot = platform.1 * Vector3::z();
    let x = telescope.column(1).cross(&pivot).normalize();
    let old = unit(&state.bodies[END_EFFECTOR].orientation) * Vector3::x();
    let x = if x.dot(&old) < 0.0 { -x } else { x };
    let matrix = nalgebra::Matrix3::from_columns(&[x, pivot.cross(&x), pivot]);
    state.bodies[END_EFFECTOR].position = platform.0 + platform.1 * (Vector3::z() * geometry.flange_height);
    state.bodies[END_EFFECTOR].orientation = *from_matrix(&matrix);
}

fn from_matrix(m: &nalgebra::Matrix3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*m))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tableau_fulfils_the_order_conditions_of_a_w_method() {
        let beta = |m: &[[f64; STAGES]; STAGES], diagonal: f64, x: &[f64; STAGES]| -> [f64; STAGES] {
            std::array::from_fn(|i| (0..STAGES).map(|j| m[i][j] * x[j]).sum::<f64>() + diagonal * x[i])
        };
        let weigh = |x: &[f64; STAGES]| (0..STAGES).map(|i| B[i] * x[i]).sum::<f64>();
        let one = [1.0; STAGES];
        let a = beta(&ALPHA, 0.0, &one);
        let g = beta(&GAMMAS, GAMMA, &one);
        let square = std::array::from_fn(|i| a[i] * a[i]);
        // Order 1, 2, 3 for exact and for arbitrary Jacobians.
        for (got, want) in [
            (weigh(&one), 1.0),
            (weigh(&a), 0.5),
            (weigh(&g), 0.0),
            (weigh(&square), 1.0 / 3.0),
            (weigh(&beta(&ALPHA, 0.0, &a)), 1.0 / 6.0),
            (weigh(&beta(&ALPHA, 0.0, &g)), 0.0),
            (weigh(&beta(&GAMMAS, GAMMA, &a)), 0.0),
            (weigh(&beta(&GAMMAS, GAMMA, &g)), 0.0),
        ] {
            approx::assert_abs_diff_eq!(got, want, epsilon = 1e-13);
        }
    }
}
