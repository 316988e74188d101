use std::f64::consts::FRAC_PI_2;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use super::testing::*;
use super::*;
use crate::dynamics::inertial_wrench;
use crate::kinematics::{JointState, Motion};
use crate::machine::bodies::{self, ARM, BODIES, END_EFFECTOR, PLATFORM, ROTOR, STRUT, TELESCOPE_LOWER};
use crate::machine::{every_strut, six_struts, three_arms};
use crate::scenario::Formulation;
use crate::twin::constraints::{self, ROWS, rows};
use crate::twin::{Torque, Twin, energy};

#[test]
fn jacobian_and_velocity_products_are_derivatives_of_the_rows() {
    let (plant, mut rng) = (plant(), ChaCha8Rng::seed_from_u64(1));
    let (mut of_rate, mut of_value, mut of_product) = (0f64, 0f64, 0f64);
    for _ in 0..20 {
        let motion = disturbed(&plant, &mut rng, 0.2);
        let analytic = rows_at(&plant, &motion, SocketSet::ALL);
        let a: [Pair; SLOTS] = std::array::from_fn(|_| (vector(&mut rng, 50.0), vector(&mut rng, 50.0)));
        let h = 1e-5;
        let [before, now, after] = [-h, 0.0, h].map(|h| rows(&plant.geometry, &moved(&motion, &a, h)));
        let (gv, ga) = (times(&analytic, &velocities(&motion)), times(&analytic, &a));
        for k in 0..ROWS {
            assert!((analytic.1.values[k] - now[k].0).abs() < 1e-15);
            of_rate = of_rate.max((gv[k] - now[k].1).abs());
            of_value = of_value.max((gv[k] - (after[k].0 - before[k].0) / (2.0 * h)).abs());
            of_product = of_product.max((ga[k] - analytic.1.gamma[k] - (after[k].1 - before[k].1) / (2.0 * h)).abs());
        }
    }
    println!("G·v: {of_rate:.1e}, numeric {of_value:.1e}; G·a − γ: {of_product:.1e}");
    assert!(of_rate < 1e-13 && of_value < 1e-7 && of_product < 1e-5, "{of_rate:e} {of_value:e} {of_product:e}");
}

#[test]
fn agrees_with_the_closed_form_elimination() {
    let (mut maximal, mut rng) = (MaximalCoordinates::new(&plant()), ChaCha8Rng::seed_from_u64(2));
    for (n, plant) in plants().into_iter().enumerate() {
        let (mut worst, mut worst_force) = (0f64, 0f64);
        for _ in 0..100 {
            let mut motion = plant.motion(&joints(&plant, &mut rng)).unwrap();
            let tau = std::array::from_fn(|i| rng.random_range(-1.0..1.0) * if i < 3 { 80.0 } else { 5.0 });
            let mut wrenches = torques(&tau);
            for s in six_struts() {
                // 1 mrad/s: the restraint of the spins is stiff.
                let spin = motion.strut_axis[s] * rng.random_range(-1e-3..1e-3);
                motion.bodies[bodies::strut(s)].angular_velocity += spin;
                wrenches[bodies::strut(s)].1 -= spin * plant.spin_damping;
            }
            let mut twin = Twin::new(plant.clone(), &motion).unwrap();
            let fast = twin.evaluate(&Torque::constant(tau)).unwrap();
            let (fast, forces) = (fast.motion, fast.reactions);
            let solution = maximal.solve(&plant, &fast.bodies, SocketSet::ALL, &wrenches, None).unwrap().clone();
            let mut size = [1f64; 2];
            for b in &fast.bodies {
                size = [size[0].max(b.acceleration.norm()), size[1].max(b.angular_acceleration.norm())];
            }
            for (a, b) in solution.bodies.iter().zip(&fast.bodies) {
                worst = worst.max((a.0 - b.acceleration).norm() / size[0]);
                worst = worst.max((a.1 - b.angular_acceleration).norm() / size[1]);
            }
            let axial = maximal.axial_forces(&fast.bodies);
            let largest = forces.upper.iter().fold(1f64, |x, f| x.max(f.abs()));
            for s in six_struts() {
                worst_force = worst_force.max((axial.upper[s] - forces.upper[s]).abs() / largest);
                worst_force = worst_force.max((axial.lower[s] - forces.lower[s]).abs() / largest);
            }
        }
        println!("plant {n}: accelerations to {worst:.1e}, strut forces to {worst_force:.1e}");
        assert!(worst < 1e-9 && worst_force < 1e-9, "plant {n}: {worst:e} {worst_force:e}");
    }
}

#[test]
fn joints_of_plates_hold_along_motions_of_the_loop_closure() {
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    for plant in relatives() {
        let (mut worst, mut largest) = ([0f64; 3], [1f64; 2]);
        for _ in 0..20 {
            let motion = drawn(&plant, &mut rng, 50.0);
            let all = rows_at(&plant, &motion, plant.sockets());
            let v = velocities(&motion);
            let a = motion.bodies.map(|b| (b.acceleration, b.angular_acceleration));
            let (gv, ga) = (times(&all, &v), times(&all, &a));
            for k in 0..MAX_ROWS {
                worst[0] = worst[0].max(all.1.values[k].abs());
                worst[1] = worst[1].max(gv[k].abs());
                worst[2] = worst[2].max((ga[k] - all.1.gamma[k]).abs());
            }
            largest[0] = v.iter().fold(largest[0], |x, v| x.max(v.0.norm()));
            largest[1] = a.iter().fold(largest[1], |x, a| x.max(a.0.norm()));
        }
        println!("{:?}: {worst:?} at {largest:.1?}", plant.geometry.plate);
        assert!(worst[0] < 1e-14 && worst[1] < 1e-13 * largest[0] && worst[2] < 1e-13 * largest[1], "{worst:?}");
    }
}

#[test]
fn relatives_move_as_in_the_coordinates_of_their_drives() {
    let mut rng = ChaCha8Rng::seed_from_u64(10);
    for plant in relatives() {
        let mut maximal = MaximalCoordinates::new(&plant);
        let (mut worst, mut worst_force, mut worst_socket) = (0f64, 0f64, 0f64);
        for _ in 0..20 {
            let motion = drawn(&plant, &mut rng, 0.0);
            let mut tau = [0.0; 4];
            tau[..plant.mechanism.axes()].iter_mut().for_each(|tau| *tau = rng.random_range(-30.0..30.0));
            let torque = Torque::constant(tau);
            let mut twin = Twin::new(plant.clone(), &motion).unwrap();
            let mut whole = Twin::formulated(plant.clone(), &motion, Formulation::Absolute).unwrap();
            let (reduced, absolute) = (twin.evaluate(&torque).unwrap(), whole.evaluate(&torque).unwrap());
            let size = reduced.motion.bodies.iter().fold(1f64, |x, b| x.max(b.acceleration.norm()));
            for &b in maximal.bodies() {
                let [a, b] = [&absolute.motion.bodies[b], &reduced.motion.bodies[b]];
                worst = worst.max((a.acceleration - b.acceleration).norm() / size);
                worst = worst.max((a.angular_acceleration - b.angular_acceleration).norm() / size);
            }
            let largest = reduced.reactions.upper.iter().fold(1f64, |x, f| x.max(f.abs()));
            for s in every_strut() {
                worst_force =
                    worst_force.max((absolute.reactions.upper[s] - reduced.reactions.upper[s]).abs() / largest);
                worst_force =
                    worst_force.max((absolute.reactions.lower[s] - reduced.reactions.lower[s]).abs() / largest);
            }
            for (a, b) in absolute.sockets.iter().zip(&reduced.sockets) {
                worst_socket = worst_socket.max((a - b).norm() / largest);
            }
            assert!(maximal.project(&plant, &mut State::new(&motion).bodies, plant.sockets()).is_ok());
        }
        println!(
            "{:?}: accelerations to {worst:.1e}, forces to {worst_force:.1e}, {worst_socket:.1e}",
            plant.geometry.plate
        );
        assert!(
            worst < 1e-9 && worst_force < 1e-9 && worst_socket < 1e-9,
            "{worst:e} {worst_force:e} {worst_socket:e}"
        );
    }
}

#[test]
fn a_strut_without_sockets_flies_freely() {
    let (plant, mut rng, mut maximal) = (plant(), ChaCha8Rng::seed_from_u64(3), MaximalCoordinates::new(&plant()));
    let closed = without(&[2, 8]);
    for _ in 0..20 {
        let mut motion = plant.motion(&joints(&plant, &mut rng)).unwrap();
        motion.bodies[bodies::strut(2)].angular_velocity = vector(&mut rng, 20.0);
        motion.bodies[bodies::strut(2)].velocity = vector(&mut rng, 5.0);
        let solution = maximal.solve(&plant, &motion.bodies, closed, &[STILL; SLOTS], None).unwrap().clone();
        let strut = with_accelerations(&motion, &solution)[bodies::strut(2)];
        let centre = strut.rotation * plant.bodies[bodies::strut(2)].first_moment / plant.bodies[bodies::strut(2)].mass;
        let (omega, alpha) = (strut.angular_velocity, strut.angular_acceleration);
        let falls = strut.acceleration + alpha.cross(&centre) + omega.cross(&omega.cross(&centre));
        assert!((falls - plant.gravity_vector()).norm() < 1e-11, "{falls}");
        // The only external load is weight, so that the inertial wrench with weight is zero.
        let (force, moment) = inertial_wrench(&plant.bodies[bodies::strut(2)], &strut, &plant.gravity_vector());
        assert!(force.norm() < 1e-12 && moment.norm() < 1e-12, "{force} {moment}");
        assert_eq!((maximal.socket_forces()[2], maximal.socket_forces()[8]), (Vector3::zeros(), Vector3::zeros()));
    }
}

#[test]
fn the_platform_falls_on_the_telescope_when_all_sockets_are_open() {
    let (mut rng, mut maximal) = (ChaCha8Rng::seed_from_u64(4), MaximalCoordinates::new(&plant()));
    let closed = without(&[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]);
    let mut worst = 0f64;
    for plant in plants() {
        for _ in 0..20 {
            let mut state = State::new(&disturbed(&plant, &mut rng, 0.1));
            maximal.project(&plant, &mut state.bodies, closed).unwrap();
            let motion = state.motion(&plant);
            let tau = [3.0, -2.0, 1.0, 0.5];
            let solution = maximal.solve(&plant, &motion.bodies, closed, &torques(&tau), None).unwrap().clone();
            let bodies = with_accelerations(&motion, &solution);
            let joints = maximal.reactions();
            // Only the bearing of motor 4 and its drive act from outside.
            let (force, moment) = demand(&plant, &bodies, PLATFORM..BODIES);
            let at = bodies[ROTOR].position;
            worst = worst.max((force - joints.rotor.0).norm());
            let drive = Vector3::z() * tau[3];
            worst = worst.max((moment - joints.rotor.1 - at.cross(&joints.rotor.0) - drive).norm());
            // The part below the telescope's slide.
            let (force, moment) = demand(&plant, &bodies, [PLATFORM, END_EFFECTOR, TELESCOPE_LOWER].into_iter());
            let at = bodies[TELESCOPE_LOWER].position;
            worst = worst.max((force - joints.slide.0).norm());
            worst = worst.max((moment - joints.slide.1 - at.cross(&joints.slide.0)).norm());
            let (force, moment) = demand(&plant, &bodies, std::iter::once(TELESCOPE_LOWER));
            let (slide, hooke) = (joints.slide, joints.lower_hooke);
            worst = worst.max((force - slide.0 - hooke.0).norm());
            worst = worst.max((moment - slide.1 - hooke.1 - at.cross(&(slide.0 + hooke.0))).norm());
            let (force, moment) = demand(&plant, &bodies, std::iter::once(PLATFORM));
            let at = bodies[END_EFFECTOR].position;
            worst = worst.max((force + joints.pivot.0).norm());
            worst = worst.max((moment + joints.pivot.1 + at.cross(&joints.pivot.0)).norm());
            let (force, moment) = demand(&plant, &bodies, [ROTOR].into_iter());
            let (bearing, hooke) = (joints.rotor, joints.upper_hooke);
            let at = bodies[ROTOR].position;
            worst = worst.max((force - bearing.0 + hooke.0).norm());
            worst = worst.max((moment - bearing.1 - drive + hooke.1 - at.cross(&(bearing.0 - hooke.0))).norm());
            // The arms are decoupled.
            for i in three_arms() {
                let (force, moment) =
                    inertial_wrench(&plant.bodies[bodies::arm(i)], &bodies[bodies::arm(i)], &plant.gravity_vector());
                worst = worst.max((force - joints.arms[i].0).norm());
                worst = worst.max((moment - joints.arms[i].1 - plant.geometry.limbs[i].tangential() * tau[i]).norm());
            }
        }
    }
    println!("balances to {worst:.1e} N, N·m");
    assert!(worst < 1e-9, "{worst:e}");
}

#[test]
fn socket_forces_balance_each_strut_whatever_is_open() {
    let (plant, mut rng, mut maximal) =
        (plants()[3].clone(), ChaCha8Rng::seed_from_u64(5), MaximalCoordinates::new(&plant()));
    let mut worst = 0f64;
    for open in [&[][..], &[7], &[0, 6], &[0, 1, 8, 9], &[6, 7, 8, 9, 10], &[6, 7, 8, 9, 10, 11]] {
        let closed = without(open);
        for _ in 0..10 {
            let mut state = State::new(&disturbed(&plant, &mut rng, 0.01));
            maximal.project(&plant, &mut state.bodies, closed).unwrap();
            let motion = state.motion(&plant);
            let mut wrenches = [STILL; SLOTS];
            for w in &mut wrenches {
                *w = (vector(&mut rng, 5.0), vector(&mut rng, 0.02));
            }
            let solution = maximal.solve(&plant, &motion.bodies, closed, &wrenches, None).unwrap().clone();
            let bodies = with_accelerations(&motion, &solution);
            let forces = maximal.socket_forces();
            for s in six_struts() {
                let b = bodies::strut(s);
                let (force, moment) = inertial_wrench(&plant.bodies[b], &bodies[b], &plant.gravity_vector());
                let lever = motion.strut_axis[s] * motion.strut_length[s];
                worst = worst.max((force - wrenches[b].0 - forces[s] - forces[6 + s]).norm());
                worst = worst.max((moment - wrenches[b].1 - lever.cross(&forces[6 + s])).norm());
            }
        }
    }
    println!("struts balance to {worst:.1e} N, N·m");
    assert!(worst < 1e-9, "{worst:e}");
}

#[test]
fn a_strut_that_left_its_platform_ball_is_a_pendulum() {
    let (mut plant, mut maximal) = (plant(), MaximalCoordinates::new(&plant()));
    for i in three_arms() {
        plant.bodies[bodies::arm(i)].tensor *= 1e12; // held
    }
    let closed = without(&[6]);
    let joints = JointState { q: [0.4; 4], qd: [0.0; 4], qdd: [0.0; 4] };
    let mut state = State::new(&plant.motion(&joints).unwrap());
    let angle = 2e-3;
    // Strut frame: x down, with a small component along the inertial x axis.
    let hanging = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), FRAC_PI_2 - angle);
    state.bodies[STRUT].orientation = *hanging;
    maximal.project(&plant, &mut state.bodies, closed).unwrap();
    let inertia = plant.bodies[STRUT];
    let frequency = (inertia.first_moment.x * plant.gravity / inertia.tensor[(1, 1)]).sqrt();
    let start = energy::total(&plant, &state.motion(&plant));
    let (mut worst, mut drift, mut gap, h) = (0f64, 0f64, 0f64, 1e-4);
    for k in 1..=5_000 {
        step(&plant, &mut maximal, &mut state, closed, h);
        let motion = state.motion(&plant);
        let swing = motion.strut_axis[0].x / angle;
        worst = worst.max((swing - (frequency * k as f64 * h).cos()).abs());
        drift = drift.max((energy::total(&plant, &motion) - start).abs());
        for (k, (value, rate)) in rows(&plant.geometry, &motion).into_iter().enumerate() {
            if constraints::socket(k) != Some(6) {
                gap = gap.max(value.abs()).max(rate.abs());
            }
        }
    }
    let kinetic = energy::total(&Plant { gravity: 0.0, ..plant.clone() }, &state.motion(&plant));
    println!("frequency {frequency:.4} rad/s, swing off by {worst:.1e}, energy drift {drift:.1e} J of {kinetic:.2} J");
    println!("rows {gap:.1e}");
    assert!(worst < 1e-5 && drift < 1e-6 && gap < 1e-11, "{worst:e} {drift:e} {gap:e}");
}

#[test]
fn a_whole_fall_keeps_its_energy() {
    // The sockets of limb 1 are open and the drives have tripped.
    let (plant, mut maximal) = (plant(), MaximalCoordinates::new(&plant()));
    let closed = without(&[6, 7]);
    let joints = JointState { q: [0.2, 0.3, 0.1, 0.5], qd: [3.0, -2.0, 1.0, 5.0], qdd: [0.0; 4] };
    let mut state = State::new(&plant.motion(&joints).unwrap());
    let start = energy::total(&plant, &state.motion(&plant));
    let mut drift = 0f64;
    for _ in 0..2000 {
        step(&plant, &mut maximal, &mut state, closed, 1e-4);
        drift = drift.max((energy::total(&plant, &state.motion(&plant)) - start).abs());
    }
    let tilt = state.motion(&plant).bodies[PLATFORM].rotation[(2, 2)].acos();
    println!("energy drift {drift:.1e} J, platform tilted by {tilt:.2} rad");
    assert!(drift < 1e-6 && tilt > 0.03, "{drift:e} {tilt}");
}

#[test]
fn projection_restores_poses_and_velocities() {
    let (mut rng, mut maximal) = (ChaCha8Rng::seed_from_u64(6), MaximalCoordinates::new(&plant()));
    let mut worst = (0f64, 0f64);
    for plant in plants() {
        for open in [&[][..], &[3], &[0, 6, 9]] {
            let closed = without(open);
            for _ in 0..10 {
                let mut state = State::new(&disturbed(&plant, &mut rng, 0.02));
                maximal.project(&plant, &mut state.bodies, closed).unwrap();
                let motion = state.motion(&plant);
                let all = rows_at(&plant, &motion, closed);
                worst.0 = all.1.values.iter().fold(worst.0, |w, c| w.max(c.abs()));
                worst.1 = times(&all, &velocities(&motion)).iter().fold(worst.1, |w, c| w.max(c.abs()));
                let before = state.clone();
                maximal.project(&plant, &mut state.bodies, closed).unwrap();
                for (a, b) in state.bodies.iter().zip(&before.bodies) {
                    assert!((a.position - b.position).norm() < 1e-12 && (a.velocity - b.velocity).norm() < 1e-10);
                }
            }
        }
    }
    println!("violation {:.1e}, rate {:.1e}", worst.0, worst.1);
    assert!(worst.0 < 1e-12 && worst.1 < 1e-11, "{worst:?}");
    // Struts too short to close the loops.
    let mut short = plant();
    let mut state = State::new(&short.motion(&joints(&short, &mut rng)).unwrap());
    short.geometry.limbs.iter_mut().zip([0.05, 1.9, 1.9]).for_each(|(limb, length)| limb.strut_length = length);
    assert_eq!(maximal.project(&short, &mut state.bodies, SocketSet::ALL), Err(SingularPose));
}

#[test]
fn impulses_conserve_momentum() {
    let (plant, mut rng, mut maximal) = (plant(), ChaCha8Rng::seed_from_u64(7), MaximalCoordinates::new(&plant()));
    let closed = without(&[2, 8]);
    for _ in 0..10 {
        let motion = plant.motion(&joints(&plant, &mut rng)).unwrap();
        let impulses: [Pair; SLOTS] = std::array::from_fn(|_| (vector(&mut rng, 2.0), vector(&mut rng, 0.01)));
        let after = maximal.impulse(&plant, &plant.bodies, &motion.bodies, closed, &impulses).unwrap().clone();
        let mut then = motion;
        for (b, x) in then.bodies.iter_mut().zip(&after.bodies) {
            (b.velocity, b.angular_velocity) = *x;
        }
        let joints = maximal.reactions();
        let change = |b: usize| {
            let (was, is) =
                (momentum(&plant.bodies[b], &motion.bodies[b]), momentum(&plant.bodies[b], &then.bodies[b]));
            (is.0 - was.0, is.1 - was.1)
        };
        // All of the impulse on a free strut changes its own momentum.
        let (p, l) = change(bodies::strut(2));
        assert!((p - impulses[bodies::strut(2)].0).norm() < 1e-12 && (l - impulses[bodies::strut(2)].1).norm() < 1e-12);
        // All others: impulses and bearing reactions only.
        let mut sum = joints.rotor.0 + joints.arms.iter().map(|a| a.0).sum::<Vector3<f64>>();
        for b in 0..BODIES {
            sum += impulses[b].0 - change(b).0;
        }
        assert!(sum.norm() < 1e-11, "{sum}");
        let all = rows_at(&plant, &motion, closed);
        let rate = times(&all, &velocities(&then)).iter().fold(0f64, |w, c| w.max(c.abs()));
        assert!(rate < 1e-11, "{rate:e}");
    }
}

#[test]
fn picking_up_a_product_at_rest_loses_energy_as_a_plastic_shock() {
    let (plant, mut maximal) = (plant(), MaximalCoordinates::new(&plant()));
    let joints = JointState { q: [0.3; 4], qd: [1.0, 1.0, 1.0, 0.0], qdd: [0.0; 4] };
    let motion = plant.motion(&joints).unwrap();
    let mut loaded = plant.clone();
    loaded.bodies[END_EFFECTOR] += Inertia::point(2.0, Vector3::new(0.0, 0.0, -0.05));
    let after = maximal.impulse(&loaded, &plant.bodies, &motion.bodies, SocketSet::ALL, &[STILL; SLOTS]).unwrap();
    let mut then = motion;
    for (b, x) in then.bodies.iter_mut().zip(&after.bodies) {
        (b.velocity, b.angular_velocity) = *x;
    }
    // One degree of freedom (all arms alike): p = M·q̇ is conserved, so that E₊/E₋ = M₋/M₊ = q̇₊/q̇₋.
    let kinetic = |plant: &Plant, motion: &Motion| energy::total(&Plant { gravity: 0.0, ..plant.clone() }, motion);
    let (before, with_product) = (kinetic(&plant, &motion), kinetic(&loaded, &motion));
    let slowed = then.bodies[PLATFORM].velocity.z / motion.bodies[PLATFORM].velocity.z;
    assert!((slowed - before / with_product).abs() < 1e-12, "{slowed}");
    assert!((kinetic(&loaded, &then) / before - slowed).abs() < 1e-12);
}

#[test]
fn damping_adds_to_the_inertia() {
    let (plant, mut maximal) = (plant(), MaximalCoordinates::new(&plant()));
    let joints = JointState { q: [0.3, 0.2, 0.4, 0.1], qd: [2.0, -1.0, 1.0, 4.0], qdd: [0.0; 4] };
    let motion = plant.motion(&joints).unwrap();
    let mut damping = [Added::NONE; SLOTS];
    let mut heavier = plant.clone();
    for b in (ARM..STRUT).chain([ROTOR]) {
        let (_, screw) = motion.drive(if b == ROTOR { 3 } else { b });
        damping[b].along(&screw, 0.4);
        let own = motion.bodies[b].rotation.tr_mul(&screw.angular);
        heavier.bodies[b].tensor += own * own.transpose() * 0.4;
    }
    let a = maximal.solve(&plant, &motion.bodies, SocketSet::ALL, &[STILL; SLOTS], Some(&damping)).unwrap().clone();
    let b = maximal.solve(&heavier, &motion.bodies, SocketSet::ALL, &[STILL; SLOTS], None).unwrap();
    for (a, b) in a.bodies.iter().zip(&b.bodies) {
        assert!((a.0 - b.0).norm() < 1e-10 && (a.1 - b.1).norm() < 1e-9);
    }
}

#[test]
fn bodies_without_inertia_are_solved_exactly() {
    // A platform without a tensor and arms of two points each, compared with inertia that does not influence the
    // motion.
    let (mut full, mut rng, mut maximal) = (plant(), ChaCha8Rng::seed_from_u64(8), MaximalCoordinates::new(&plant()));
    full.bodies[PLATFORM] = Inertia::point(1.2, Vector3::zeros());
    for i in three_arms() {
        full.bodies[bodies::arm(i)] = Inertia::point(1.0, Vector3::new(0.1, 0.0, 0.02));
        full.bodies[bodies::arm(i)] += Inertia::point(0.4, Vector3::new(0.3, 0.0, -0.03));
    }
    let bare = full.clone();
    full.bodies[PLATFORM] += Inertia::diagonal(0.0, [0.0; 3], [0.005, 0.005, 0.006]);
    for i in three_arms() {
        full.bodies[bodies::arm(i)] += Inertia::diagonal(0.0, [0.0; 3], [0.1, 0.0, 0.1]);
    }
    let (mut worst, mut size) = (0f64, 1f64);
    for _ in 0..50 {
        let motion = full.motion(&joints(&full, &mut rng)).unwrap();
        let wrenches = torques(&[50.0, -20.0, 30.0, 1.0]);
        let a = maximal.solve(&full, &motion.bodies, SocketSet::ALL, &wrenches, None).unwrap().clone();
        let b = maximal.solve(&bare, &motion.bodies, SocketSet::ALL, &wrenches, None).unwrap();
        for (a, b) in a.bodies.iter().zip(&b.bodies) {
            size = size.max(a.0.norm()).max(a.1.norm());
            worst = worst.max((a.0 - b.0).norm()).max((a.1 - b.1).norm());
        }
    }
    println!("off by {worst:.1e} of {size:.1e}");
    assert!(worst < 1e-9 * size, "{worst:e}");
}

#[test]
fn redundant_rows_do_not_stop_a_run() {
    let (plant, mut bodies) = hanging();
    let mut maximal = MaximalCoordinates::new(&plant);
    let solution = maximal.solve(&plant, &bodies, SocketSet::ALL, &[STILL; SLOTS], None).unwrap().clone();
    assert!(maximal.violation() < 1e-15 && maximal.0.regularised);
    for (b, a) in solution.bodies.iter().enumerate().skip(PLATFORM) {
        assert!(a.0.norm() < 1e-9 && a.1.norm() < 1e-9, "body {b}: {a:?}");
    }
    let weight: f64 = [PLATFORM, TELESCOPE_LOWER].iter().map(|&b| plant.bodies[b].mass * plant.gravity).sum();
    let carried: f64 = maximal.socket_forces()[6..].iter().map(|f| -f.z).sum();
    assert!((carried - weight).abs() < 1e-9, "{carried} of {weight}");
    // A platform without a valid orientation.
    bodies[PLATFORM].rotation[(0, 1)] = f64::NAN;
    assert_eq!(maximal.solve(&plant, &bodies, SocketSet::ALL, &[STILL; SLOTS], None).unwrap_err(), SingularPose);
}

#[test]
fn arms_in_their_bearings_turn_alone() {
    let mut plant = plant();
    plant.assembled = false;
    let joints = JointState { q: [0.1, 0.2, 0.3, 0.4], qd: [1.0, 2.0, 3.0, 4.0], qdd: [0.0; 4] };
    let (mut maximal, motion) = (MaximalCoordinates::new(&plant), plant.motion(&joints).unwrap());
    let mut twin = Twin::new(plant.clone(), &motion).unwrap();
    let torque = [5.0, -3.0, 2.0, 0.1];
    let expected = twin.evaluate(&Torque::constant(torque)).unwrap().motion.qdd;
    let found = maximal.solve(&plant, &motion.bodies, plant.sockets(), &torques(&torque), None).unwrap();
    for (axis, qdd) in expected.into_iter().enumerate() {
        let (body, screw) = motion.drive(axis);
        let (linear, angular) = found.bodies[body];
        approx::assert_relative_eq!(screw.rate(&linear, &angular), qdd, max_relative = 1e-12);
        assert!(linear.norm() < 1e-12);
    }
    assert_eq!(maximal.project(&plant, &mut State::new(&motion).bodies, plant.sockets()), Ok(0));
}
