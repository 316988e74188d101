//! The twin against the inverse dynamics, its own constraint Jacobian, energy and order of convergence.

use crate::common;

use common::random_joints;
use deltatwin::dynamics::{Plant, inertial_wrench, inverse_dynamics};
use deltatwin::kinematics::{JointState, Motion};
use deltatwin::machine::bodies::{self, BODIES, END_EFFECTOR, PLATFORM, ROTOR, TELESCOPE_UPPER};
use deltatwin::twin::constraints::{ROWS, rows};
use deltatwin::twin::{Snapshot, Torque, Twin};
use nalgebra::{DMatrix, DVector, Vector3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

fn loaded_plant() -> Plant {
    let mut plant = common::nominal_plant();
    plant.payload =
        deltatwin::machine::Payload::with_tensor(2.5, [0.03, -0.02, -0.08], [0.02, 0.03, 0.025, 0.004, -0.005, 0.003]);
    plant.bodies[deltatwin::machine::bodies::END_EFFECTOR] += plant.payload.inertia();
    let plant = common::with_effect(plant, "drive_friction", &[&[4.2, 4.1, 5.8], &[0.28, 0.42, 0.45], &[100.0]]);
    common::with_effect(plant, "axis4_friction", &[&[0.5272], &[0.6672], &[8.5919]])
}

/// Accelerations and forces of the twin at a motion under drive torques.
fn at(plant: &Plant, motion: &Motion, tau: [f64; 4]) -> Snapshot {
    Twin::new(plant.clone(), motion).unwrap().evaluate(&Torque::constant(tau)).unwrap()
}

#[test]
fn forward_dynamics_inverts_inverse_dynamics() {
    let mut tilted = loaded_plant();
    tilted.geometry.limbs.iter_mut().zip([1e-3, -2e-3, 5e-4]).for_each(|(limb, d)| limb.strut_difference = d);
    [loaded_plant(), tilted].iter().for_each(inverted);
}

fn inverted(plant: &Plant) {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let (mut worst, mut worst_force) = (0f64, 0f64);
    for _ in 0..100 {
        let joints = random_joints(plant, &mut rng);
        let motion = plant.motion(&joints).unwrap();
        let out = inverse_dynamics(plant, 0.0, &motion, &[&[], &[]], true).unwrap();
        let Snapshot { motion: twin, reactions, .. } = at(plant, &motion, out.tau);
        for i in 0..4 {
            worst = worst.max((twin.qdd[i] - joints.qdd[i]).abs() / 60.0);
        }
        for s in 0..6 {
            worst_force = worst_force
                .max((reactions.lower[s] - out.reactions.lower[s]).abs())
                .max((reactions.upper[s] - out.reactions.upper[s]).abs());
        }
        for b in 0..BODIES {
            let d = twin.bodies[b].acceleration - motion.bodies[b].acceleration;
            let a = twin.bodies[b].angular_acceleration - motion.bodies[b].angular_acceleration;
            assert!(d.norm() < 1e-8 && a.norm() < 1e-6, "body {b}: {:e} {:e}", d.norm(), a.norm());
        }
    }
    println!("accelerations agree to {worst:.1e} relative, strut forces to {worst_force:.1e} N");
    assert!(worst < 1e-9 && worst_force < 1e-8, "{worst:e} {worst_force:e}");
}

/// Constraint Jacobian G, 74 × 84: rates of the rows per unit of each body's twist.
fn constraint_jacobian(plant: &Plant, motion: &Motion) -> DMatrix<f64> {
    let mut still = *motion;
    for b in &mut still.bodies {
        (b.velocity, b.angular_velocity) = (Vector3::zeros(), Vector3::zeros());
    }
    let mut g = DMatrix::zeros(ROWS, 6 * BODIES);
    for c in 0..6 * BODIES {
        let mut moved = still;
        let unit = Vector3::ith(c % 3, 1.0);
        if c % 6 < 3 {
            moved.bodies[c / 6].velocity = unit
        } else {
            moved.bodies[c / 6].angular_velocity = unit
        }
        for (r, (_, rate)) in rows(&plant.geometry, &moved).into_iter().enumerate() {
            g[(r, c)] = rate;
        }
    }
    g
}

#[test]
fn reactions_hold_every_body_and_spare_every_freedom() {
    // Seventy-four numbers: what a joint leaves free it does not load.
    let plant = loaded_plant();
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for _ in 0..20 {
        let joints = random_joints(&plant, &mut rng);
        let motion = plant.motion(&joints).unwrap();
        let snapshot = at(&plant, &motion, [20.0, -15.0, 30.0, 1.0]);
        let (motion, joints) = (snapshot.motion, snapshot.joints(&plant));
        let axis = |b: usize, i: usize| motion.bodies[b].rotation.column(i).into_owned();
        let mut free = Vec::new();
        for i in 0..3 {
            free.push(joints.arms[i].1.dot(&axis(i, 1)));
        }
        free.push(joints.rotor.1.z);
        for (hooke, yoke) in [(joints.upper_hooke, ROTOR), (joints.lower_hooke, END_EFFECTOR)] {
            free.push(hooke.1.dot(&axis(yoke, 0)));
            free.push(hooke.1.dot(&axis(TELESCOPE_UPPER, 1)));
        }
        free.push(joints.slide.0.dot(&axis(TELESCOPE_UPPER, 2)));
        free.push(joints.end_effector.1.dot(&axis(PLATFORM, 2)));
        for (k, x) in free.iter().enumerate() {
            assert!(x.abs() < 1e-9, "freedom {k}: {x:e}");
        }
        // The frame carries the whole machine: sum of bearings = demand of all bodies.
        let carried = joints.arms.iter().map(|a| a.0).sum::<Vector3<f64>>() + joints.rotor.0;
        let demand: Vector3<f64> =
            (0..BODIES).map(|b| inertial_wrench(&plant.bodies[b], &motion.bodies[b], &plant.gravity_vector()).0).sum();
        assert!((carried - demand).norm() < 1e-9 * demand.norm(), "{carried} {demand}");
    }
}

#[test]
fn what_the_joints_must_carry_is_in_the_range_of_the_constraint_jacobian() {
    // M a − f = −Gᵀλ has a solution λ exactly when a solves the 84 + 74 equations; G has full rank, so λ is unique.
    let plant = loaded_plant();
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    for _ in 0..10 {
        let joints = random_joints(&plant, &mut rng);
        let motion = plant.motion(&joints).unwrap();
        let tau = [20.0, -15.0, 30.0, 1.0];
        let twin = at(&plant, &motion, tau).motion;
        let mut demand = DVector::zeros(6 * BODIES);
        for b in 0..BODIES {
            let (force, moment) = inertial_wrench(&plant.bodies[b], &twin.bodies[b], &plant.gravity_vector());
            demand.fixed_rows_mut::<3>(6 * b).copy_from(&force);
            demand.fixed_rows_mut::<3>(6 * b + 3).copy_from(&moment);
        }
        let friction = [4.2, 4.1, 5.8]
            .iter()
            .zip([0.28, 0.42, 0.45])
            .enumerate()
            .map(|(i, (c, v))| -c * (100.0 * joints.qd[i]).tanh() - v * joints.qd[i]);
        let w = joints.qd[3];
        let axis4 = -0.5272 * (100.0 * w).tanh() - 0.6672 * (w / 8.5919).tanh();
        for (i, f) in friction.chain([axis4]).enumerate() {
            let (body, screw) = motion.drive(i);
            let mut m = demand.fixed_rows_mut::<3>(6 * body + 3);
            m -= screw.angular * (tau[i] + f);
        }
        let g = constraint_jacobian(&plant, &motion);
        let svd = g.transpose().svd(true, true);
        let ratio = svd.singular_values.min() / svd.singular_values.max();
        assert!(ratio > 1e-4, "74 independent rows: {ratio:e}");
        let lambda = svd.solve(&demand, 0.0).unwrap();
        let left = (g.transpose() * lambda - &demand).amax() / demand.amax();
        assert!(left < 1e-9, "{left:e}"); // rounding times the condition of G
    }
}

/// Swings freely from a moving start under constant torques; returns the final arm angles and the energy balance.
fn swing(plant: &Plant, h: f64, duration: f64) -> ([f64; 4], f64, f64) {
    let joints = JointState { q: [0.3, 0.2, 0.4, 0.0], qd: [2.0, -1.5, 1.0, 5.0], qdd: [0.0; 4] };
    let motion = plant.motion(&joints).unwrap();
    let mut twin = Twin::new(plant.clone(), &motion).unwrap();
    let torque = Torque::constant([-8.0, -9.0, -7.0, 0.4]);
    let mut gap = 0f64;
    for _ in 0..(duration / h).round() as usize {
        twin.step(h, &torque).unwrap();
        gap = rows(&plant.geometry, &twin.motion()).iter().fold(gap, |g, r| g.max(r.0.abs()).max(0.1 * r.1.abs()));
    }
    (twin.motion().q, twin.energy_balance(), gap)
}

/// Observed orders of convergence of position and energy over halvings of the step.
fn observed_order(plant: &Plant, coarse: f64) -> (f64, f64) {
    let exact = swing(plant, coarse / 64.0, 0.16).0;
    let error = |h: f64| {
        let (q, balance, gap) = swing(plant, h, 0.16);
        assert!(gap < 1e-10, "closure {gap:e}");
        let e = q.iter().zip(exact).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        (e, balance.abs())
    };
    let (e1, b1) = error(coarse);
    let (e2, b2) = error(coarse / 2.0);
    println!("error {e1:.2e} → {e2:.2e}, energy {b1:.2e} → {b2:.2e}");
    ((e1 / e2).log2(), (b1 / b2).log2())
}

#[test]
fn order_is_four_without_friction() {
    let (order, energy_order) = observed_order(&common::nominal_plant(), 4e-3);
    assert!((3.7..4.6).contains(&order), "{order}");
    assert!(energy_order > 3.7, "{energy_order}");
}

#[test]
fn order_is_three_with_smooth_stiff_friction() {
    // Viscous friction in every socket and drive: the strut spins decay in microseconds.
    let plant = common::nominal_plant();
    let plant = common::with_effect(plant, "drive_friction", &[&[0.0; 3], &[1.7, 2.0, 1.5], &[100.0]]);
    let plant = common::with_effect(plant, "ball_socket_viscous", &[&[0.3]]);
    let (order, _) = observed_order(&plant, 8e-4);
    assert!((2.5..3.6).contains(&order), "{order}");
}

#[test]
fn struts_do_not_spin_against_their_restraint() {
    let plant = common::with_effect(common::nominal_plant(), "ball_socket_viscous", &[&[0.3]]);
    let joints = JointState { q: [0.3, 0.2, 0.4, 0.0], qd: [2.0, -1.5, 1.0, 5.0], qdd: [0.0; 4] };
    let mut twin = Twin::new(plant.clone(), &plant.motion(&joints).unwrap()).unwrap();
    for _ in 0..100 {
        twin.step(2e-4, &Torque::default()).unwrap();
    }
    let motion = twin.motion();
    for s in 0..6 {
        // 2·0.3 N·m·s/rad at the sockets against 1000 at the restraint.
        let spin = motion.bodies[bodies::strut(s)].angular_velocity.dot(&motion.strut_axis[s]);
        assert!(spin.abs() < 1e-3 && spin != 0.0, "{spin:e}");
    }
}

#[test]
fn drives_do_not_load_the_bearings_of_a_broken_mechanism() {
    let plant = loaded_plant();
    let joints = JointState { q: [0.3, 0.2, 0.4, 0.1], qd: [2.0, -1.5, 1.0, 5.0], qdd: [0.0; 4] };
    let mut twin = Twin::new(plant.clone(), &plant.motion(&joints).unwrap()).unwrap();
    twin.open(2).unwrap();
    let snapshot = twin.evaluate(&Torque::constant([20.0, -15.0, 30.0, 1.0])).unwrap();
    let (motion, joints) = (&snapshot.motion, snapshot.joints(&plant));
    for i in 0..3 {
        let about = joints.arms[i].1.dot(&motion.bodies[i].rotation.column(1));
        assert!(about.abs() < 1e-9, "arm {i}: {about:e}");
    }
    assert!(joints.rotor.1.z.abs() < 1e-9, "{:e}", joints.rotor.1.z);
    assert_eq!(joints.sockets[2], Vector3::zeros());
}
