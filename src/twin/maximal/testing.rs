//! States, plants and reference computations for the tests of the solver.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Quaternion, Rotation3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::factor::dot;
use super::rows::Rows;
use super::structure::Structure;
use super::*;
use crate::dynamics::inertial_wrench;
use crate::kinematics::{JointState, Motion};
use crate::machine::bodies::{self, BODIES, END_EFFECTOR, PLATFORM, ROTOR, STRUT, TELESCOPE_LOWER, TELESCOPE_UPPER};
use crate::machine::{
    Geometry, Joint, Limb, Mechanism, Members, PerSocket, PerStrut, Plate, Setup, ThreeArms, each, six_struts,
    three_arms,
};
use crate::model::testing::irb360;
use crate::twin::absolute;

/// First rows of joints of the chain of axis 4.
const ROTOR_BEARING: usize = 15;
const PIVOT: usize = 56;
const UPPER_HOOKE: usize = 61;
const SLIDE: usize = 65;
const LOWER_HOOKE: usize = 70;

/// Poses and twists of all bodies.
#[derive(Clone)]
pub(super) struct State {
    pub(super) bodies: [BodyState; SLOTS],
}

impl State {
    pub(super) fn new(motion: &Motion) -> Self {
        let state = |b: &BodyMotion| BodyState {
            position: b.position,
            orientation: *UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(b.rotation)),
            velocity: b.velocity,
            angular_velocity: b.rotation.tr_mul(&b.angular_velocity),
        };
        Self { bodies: std::array::from_fn(|b| state(&motion.bodies[b])) }
    }

    pub(super) fn motion(&self, plant: &Plant) -> Motion {
        let mut motion = Motion::disassembled(&plant.geometry, &JointState::default());
        for (b, body) in self.bodies.iter().enumerate() {
            let turned = rotation(&body.orientation);
            motion.bodies[b] = BodyMotion {
                rotation: turned,
                position: body.position,
                velocity: body.velocity,
                angular_velocity: turned * body.angular_velocity,
                ..BodyMotion::REST
            };
        }
        let joints = absolute::Joints::new(plant);
        let mut y = vec![0.0; joints.length()];
        joints.store(&mut y, plant, &motion);
        y[joints.length() - 2 * six_struts().len()..].fill(0.0);
        joints.motion(plant, &y)
    }
}

/// Forces of all joints on one of their two bodies, N and N·m, inertial axes, moments about that body's origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct JointReactions {
    /// Bearings: on the arms.
    pub(super) arms: ThreeArms<Pair>,
    /// Bearing of motor 4: on the rotor.
    pub(super) rotor: Pair,
    /// Ball sockets (elbows, then platform): force on the strut.
    pub(super) sockets: PerSocket<Vector3<f64>>,
    /// Revolute joint on the platform: on the end effector.
    pub(super) pivot: Pair,
    /// Rotor on upper telescope part.
    pub(super) upper_hooke: Pair,
    /// Prismatic joint: on the lower telescope part.
    pub(super) slide: Pair,
    /// End effector on lower telescope part.
    pub(super) lower_hooke: Pair,
}

impl MaximalCoordinates {
    /// Forces and moments of all joints from the last solution.
    pub(super) fn reactions(&self) -> JointReactions {
        JointReactions {
            arms: std::array::from_fn(|i| self.wrench(bodies::arm(i), 5 * i)),
            rotor: self.wrench(ROTOR, ROTOR_BEARING),
            sockets: self.socket_forces(),
            pivot: self.wrench(END_EFFECTOR, PIVOT),
            upper_hooke: self.wrench(TELESCOPE_UPPER, UPPER_HOOKE),
            slide: self.wrench(TELESCOPE_LOWER, SLIDE),
            lower_hooke: self.wrench(TELESCOPE_LOWER, LOWER_HOOKE),
        }
    }
}

pub(super) const STILL: Pair = (Vector3::new(0., 0., 0.), Vector3::new(0., 0., 0.));

/// The shipped model without effects: its end effector has no inertia.
pub(super) fn plant() -> Plant {
    let mut model = irb360();
    model.effects.clear();
    Plant::new(&model, &Setup::default())
}

/// Robots with four limbs and every kind of plate: two limbs on each carrier, or two of them passive on a rigid one.
pub(super) fn relatives() -> [Plant; 4] {
    let hinges = [Vector3::new(0.06, 0.0, 0.0), Vector3::new(-0.06, 0.01, 0.0)];
    let (main, connecting) = (Vector3::new(0.09, 0.0, 0.0), Vector3::new(0.0, 0.12, 0.0));
    let plates = [
        Plate::Par4 { main, connecting },
        Plate::H4 { hinges },
        Plate::I4 { azimuth: 0.1, radius: 0.02 },
        Plate::Rigid,
    ];
    plates.map(|plate| {
        let limb = |(i, (azimuth, offset, x, y)): (usize, (f64, f64, f64, f64))| {
            let part = usize::from(i > 1 && plate.turns());
            let mut limb = Limb::at(azimuth);
            (limb.base_radius, limb.base_offset, limb.pair_distance) = (0.275, offset, 0.1);
            (limb.arm_length, limb.strut_length) = (0.375 + 0.01 * i as f64, 0.825);
            (limb.point, limb.part) = (Vector3::new(x, y, 0.01 * i as f64), part);
            (limb.driven, limb.limits) = (plate.turns() || i < 2, [-1.0, 1.7]);
            limb
        };
        // Two parallel limbs on one bar of H4, else all in different directions.
        let (half, quarter) = (std::f64::consts::PI, FRAC_PI_2);
        let at = match plate {
            Plate::H4 { .. } => [
                (0.0, 0.0, 0.03, 0.04),
                (-quarter, 0.14, 0.02, -0.05),
                (half, 0.0, -0.03, 0.04),
                (-quarter, -0.14, -0.02, -0.05),
            ],
            Plate::Rigid => {
                [(0.1, 0.0, 0.06, 0.0), (half, 0.0, -0.06, 0.0), (quarter, 0.0, 0.0, 0.05), (-quarter, 0.0, 0.0, -0.05)]
            }
            _ => {
                [(0.8, 0.0, 0.055, 0.02), (2.4, 0.0, -0.055, 0.02), (3.9, 0.0, -0.055, -0.02), (5.5, 0.0, 0.055, -0.02)]
            }
        };
        let limbs: Vec<Limb> = at.into_iter().enumerate().map(limb).collect();
        let geometry = Geometry { flange_height: -0.03, ..Geometry::new(&limbs, plate) };
        let mut model = irb360();
        model.effects.clear();
        model.mechanism = Mechanism::Delta { telescope: false, arms: Joint::Revolute, members: Members::of(&geometry) };
        model.geometry = geometry;
        model.bodies = Bodies([Inertia::ZERO; SLOTS]);
        for b in (0..SLOTS).filter(|&b| model.mechanism.has_body(b)) {
            model.bodies[b] = match body_kind(b) {
                BodyKind::Arm(i) => Inertia::diagonal(1.2 + 0.1 * i as f64, [0.16, 0.0, 0.005], [0.02, 0.115, 0.115]),
                BodyKind::Strut(_) => Inertia::diagonal(0.12, [0.047, 0.0, 0.0], [1e-5, 0.026, 0.026]),
                _ => Inertia::diagonal(0.4, [0.001, -0.002, -0.003], [0.001, 0.0012, 0.0014]),
            };
        }
        // The restraint of the spins would turn roundings of rates into accelerations.
        model.sockets.spin_damping = 0.0;
        Plant::new(&model, &Setup::default())
    })
}

/// A random motion of a relative that its drives can make, with accelerations up to `size` rad/s².
pub(super) fn drawn(plant: &Plant, rng: &mut ChaCha8Rng, size: f64) -> Motion {
    loop {
        let mut draw = |x: f64| std::array::from_fn::<f64, 4, _>(|_| x * rng.random_range(-1.0..1.0));
        let joints = JointState { q: draw(0.15).map(|q| 0.35 + q), qd: draw(3.0), qdd: draw(size) };
        let Ok(motion) = plant.motion(&joints) else { continue };
        let psi = motion.bodies[END_EFFECTOR].rotation[(1, 0)].abs();
        if psi < 0.7 {
            return motion;
        }
    }
}

/// Plants with an end effector without inertia, with a payload, with a full tensor, and with unequal links.
pub(super) fn plants() -> [Plant; 4] {
    let mut all = std::array::from_fn(|_| plant());
    let payload =
        crate::machine::Payload::with_tensor(2.5, [0.03, -0.02, -0.08], [0.02, 0.03, 0.025, 0.004, -0.005, 0.003]);
    all[1].bodies[END_EFFECTOR] += payload.inertia();
    all[2].bodies[END_EFFECTOR] += Inertia::point(1.5, Vector3::new(0.1, -0.05, -0.1));
    all[3].bodies[END_EFFECTOR] += Inertia::diagonal(0.8, [0.0; 3], [0.01, 0.02, 0.025]);
    for b in 0..BODIES {
        if b != END_EFFECTOR && !(STRUT..PLATFORM).contains(&b) {
            all[3].bodies[b] += Inertia::point(0.3, Vector3::new(0.02, 0.05, -0.04));
        }
    }
    all[3].bodies[bodies::strut(1)] += Inertia::point(0.34, Vector3::new(0.5, 0.0, 0.0));
    all
}

pub(super) fn joints(plant: &Plant, rng: &mut ChaCha8Rng) -> JointState {
    loop {
        let mut draw = |x: f64| rng.random_range(-x..x);
        let q = [0.35 + draw(0.85), 0.35 + draw(0.85), 0.35 + draw(0.85), draw(3.0)];
        let qd = [draw(4.0), draw(4.0), draw(4.0), draw(12.0)];
        let Ok(p) = plant.geometry.forward(&q) else { continue };
        if plant.geometry.check_limits(&q, &p).is_ok() {
            return JointState { q, qd, qdd: [0.0; 4] };
        }
    }
}

/// All rows at a motion with rigid struts.
pub(super) fn rows_at(plant: &Plant, motion: &Motion, closed: SocketSet) -> (Structure, Rows) {
    let structure = Structure::new(plant);
    let mut rows = Rows::new(&structure);
    let mut lengths: PerStrut<f64> = each(0.0);
    (0..structure.struts).for_each(|s| lengths[s] = plant.geometry.strut_length(s));
    rows.fill(&structure, &plant.geometry, &lengths, &motion.bodies, closed);
    (structure, rows)
}

pub(super) fn vector(rng: &mut ChaCha8Rng, size: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| rng.random_range(-size..size))
}

/// An assembled pose with random disturbances of every body, which violate the rows.
pub(super) fn disturbed(plant: &Plant, rng: &mut ChaCha8Rng, size: f64) -> Motion {
    let mut motion = plant.motion(&joints(plant, rng)).unwrap();
    for b in &mut motion.bodies {
        b.position += vector(rng, size);
        b.rotation = Rotation3::from_scaled_axis(vector(rng, size)).into_inner() * b.rotation;
        b.velocity += vector(rng, 3.0);
        b.angular_velocity += vector(rng, 5.0);
    }
    motion
}

/// Pose and velocities after `h` s at given accelerations, to second order.
pub(super) fn moved(motion: &Motion, a: &[Pair; SLOTS], h: f64) -> Motion {
    let mut out = *motion;
    for (b, (linear, angular)) in out.bodies.iter_mut().zip(a) {
        b.position += b.velocity * h + linear * (0.5 * h * h);
        let turn = b.angular_velocity * h + angular * (0.5 * h * h);
        b.rotation = Rotation3::from_scaled_axis(turn).into_inner() * b.rotation;
        b.velocity += linear * h;
        b.angular_velocity += angular * h;
    }
    out
}

pub(super) fn times((structure, rows): &(Structure, Rows), x: &[Pair; SLOTS]) -> [f64; MAX_ROWS] {
    let mut out = [0.0; MAX_ROWS];
    for &b in &structure.bodies {
        for k in structure.blocks[b].clone() {
            out[structure.row[k]] += dot(&rows.blocks[k], &six(&x[b]));
        }
    }
    out
}

pub(super) fn velocities(motion: &Motion) -> [Pair; SLOTS] {
    motion.bodies.map(|b| (b.velocity, b.angular_velocity))
}

pub(super) fn torques(tau: &[f64; 4]) -> [Pair; SLOTS] {
    let mut out = [STILL; SLOTS];
    for (a, tau) in tau.iter().enumerate() {
        let (body, axis) = match three_arms().contains(&a) {
            true => (bodies::arm(a), plant().geometry.limbs[a].tangential()),
            false => (ROTOR, Vector3::z()),
        };
        out[body].1 += axis * *tau;
    }
    out
}

pub(super) fn without(open: &[usize]) -> SocketSet {
    open.iter().fold(SocketSet::ALL, |set, &k| set.without(k))
}

pub(super) fn with_accelerations(motion: &Motion, solution: &Solution) -> [BodyMotion; SLOTS] {
    let mut bodies = motion.bodies;
    for (b, a) in bodies.iter_mut().zip(&solution.bodies) {
        (b.acceleration, b.angular_acceleration) = *a;
    }
    bodies
}

/// Force and moment about the inertial origin required by inertia and weight of `set`.
pub(super) fn demand(plant: &Plant, bodies: &[BodyMotion; SLOTS], set: impl Iterator<Item = usize>) -> Pair {
    set.fold(STILL, |sum, b| {
        let (force, moment) = inertial_wrench(&plant.bodies[b], &bodies[b], &plant.gravity_vector());
        (sum.0 + force, sum.1 + moment + bodies[b].position.cross(&force))
    })
}

/// Four-stage Runge–Kutta step without loads; the rows are restored afterwards.
pub(super) fn step(plant: &Plant, maximal: &mut MaximalCoordinates, state: &mut State, closed: SocketSet, h: f64) {
    let mut stages = [(0.5, 1.0), (0.5, 2.0), (1.0, 2.0), (0.0, 1.0)].into_iter();
    let start = state.bodies;
    let mut sum = start;
    let mut stage = state.clone();
    for (ahead, weight) in &mut stages {
        let motion = stage.motion(plant);
        let a = maximal.solve(plant, &motion.bodies, closed, &[STILL; SLOTS], None).unwrap();
        for b in 0..BODIES {
            let s = stage.bodies[b];
            let turn = s.orientation * Quaternion::from_imag(s.angular_velocity) * 0.5;
            let angular = motion.bodies[b].rotation.tr_mul(&a.bodies[b].1);
            let add = |to: &mut BodyState, from: &BodyState, h: f64| {
                to.position = from.position + s.velocity * h;
                to.orientation = from.orientation + turn * h;
                to.velocity = from.velocity + a.bodies[b].0 * h;
                to.angular_velocity = from.angular_velocity + angular * h;
            };
            let so_far = sum[b];
            add(&mut sum[b], &so_far, h * weight / 6.0);
            add(&mut stage.bodies[b], &start[b], h * ahead);
        }
    }
    state.bodies = sum;
    maximal.project(plant, &mut state.bodies, closed).unwrap();
}

/// All struts and arms hang straight down: three of the six strut rows are redundant.
pub(super) fn hanging() -> (Plant, [BodyMotion; SLOTS]) {
    let mut plant = plant();
    let g = &mut plant.geometry;
    let radius = g.platform_radius();
    g.limbs.iter_mut().for_each(|limb| limb.base_radius = radius);
    g.upper_hooke_height = 0.3;
    let g = plant.geometry;
    let joints = JointState { q: [FRAC_PI_2; 4], qd: [0.0; 4], qdd: [0.0; 4] };
    let mut bodies = Motion::disassembled(&g, &joints).bodies;
    let height = -g.limbs[0].arm_length - g.limbs[0].strut_length;
    for s in six_struts() {
        bodies[bodies::strut(s)].position = g.platform_ball(s) - Vector3::z() * g.limbs[0].arm_length;
        bodies[bodies::strut(s)].rotation = Rotation3::from_axis_angle(&Vector3::y_axis(), FRAC_PI_2).into_inner();
    }
    // Rotor and cross axes are rotated equally by q4.
    for (b, z) in [
        (END_EFFECTOR, height + g.flange_height),
        (TELESCOPE_UPPER, g.upper_hooke_height),
        (TELESCOPE_LOWER, height + g.lower_hooke_height),
    ] {
        bodies[b] = BodyMotion { position: Vector3::new(0.0, 0.0, z), ..bodies[ROTOR] };
    }
    bodies[PLATFORM].position.z = height;
    (plant, bodies)
}
