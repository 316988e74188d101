//! Relatives of the robot: carriages in place of arms.

use crate::common::{model, planned};
use deltatwin::dynamics::{Plant, inverse_dynamics};
use deltatwin::effects::{ActiveEffect, find};
use deltatwin::identification::consistency::min_eigenvalue;
use deltatwin::identification::fit::Options;
use deltatwin::identification::{Dataset, NoiseLevel, fit, limb_test, predict};
use deltatwin::kinematics::{JointState, PlatformState};
use deltatwin::machine::bodies::{END_EFFECTOR, arm};
use deltatwin::machine::{Actuator, Mechanism, Setup};
use deltatwin::model::Model;
use deltatwin::recording::Channel;
use deltatwin::scenario::{Course, DesiredMotion, Formulation};
use nalgebra::Vector3;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, Normal};

/// The shipped linear delta on guides of another inclination; its carriages move about 0.1 m around where they were.
fn inclined(inclination: f64) -> Model {
    let mut model = model("linear-delta");
    model.geometry.limbs.iter_mut().for_each(|limb| limb.actuator = Actuator::Prismatic { inclination });
    model
}

/// Guides that stand, fall steeply outwards, lie flat and rise outwards.
const INCLINATIONS: [f64; 5] = [std::f64::consts::FRAC_PI_2, 1.2, 0.0, -0.3, -0.6];

fn pose(model: &Model, rng: &mut ChaCha8Rng) -> Vector3<f64> {
    let home = model.geometry.forward(&[0.03; 3]).unwrap();
    home + Vector3::from_fn(|_, _| rng.random_range(-0.015..0.015))
}

#[test]
fn carriages_are_where_the_struts_reach() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for inclination in INCLINATIONS {
        let model = inclined(inclination);
        let g = &model.geometry;
        for _ in 0..20 {
            let position = pose(&model, &mut rng);
            let q = g.inverse(&position, 0.0).unwrap();
            for (limb, q) in g.limbs.iter().zip(q) {
                // By hand: distance of the carriage's ball line from the platform's.
                let (u, along) = (limb.radial(), inclination.sin_cos());
                let ball = u * (limb.base_radius + q * along.1) - Vector3::z() * (q * along.0);
                approx::assert_relative_eq!((position + limb.point - ball).norm(), limb.strut_length, epsilon = 1e-13);
            }
            approx::assert_relative_eq!(g.forward(&q).unwrap(), position, epsilon = 1e-12);
        }
    }
}

#[test]
fn rates_and_accelerations_are_derivatives_of_the_positions() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let h = 1e-4;
    for inclination in INCLINATIONS {
        let model = inclined(inclination);
        let g = &model.geometry;
        let q = g.inverse(&pose(&model, &mut rng), 0.0).unwrap();
        let qd: [f64; 3] = std::array::from_fn(|_| rng.random_range(-0.3..0.3));
        let qdd: [f64; 3] = std::array::from_fn(|_| rng.random_range(-3.0..3.0));
        let four = |x: [f64; 3]| [x[0], x[1], x[2], 0.0];
        let joints = JointState { q, qd: four(qd), qdd: four(qdd) };
        let motion = g.forward_motion(&joints).unwrap();
        let at = |t: f64| {
            let moved: [f64; 3] = std::array::from_fn(|i| q[i] + qd[i] * t + 0.5 * qdd[i] * t * t);
            g.forward(&moved).unwrap()
        };
        approx::assert_relative_eq!((at(h) - at(-h)) / (2.0 * h), motion.velocity, epsilon = 1e-6);
        approx::assert_relative_eq!((at(h) - 2.0 * at(0.0) + at(-h)) / (h * h), motion.acceleration, epsilon = 1e-4);
        let back = g.inverse_motion(&motion).unwrap();
        for i in 0..3 {
            approx::assert_relative_eq!(back.qd[i], qd[i], epsilon = 1e-12);
            approx::assert_relative_eq!(back.qdd[i], qdd[i], epsilon = 1e-10);
        }
        let jacobian = g.jacobian(&q, &motion.position).unwrap();
        approx::assert_relative_eq!(jacobian * Vector3::from(qd), motion.velocity, epsilon = 1e-12);
    }
}

#[test]
fn drives_on_standing_guides_carry_the_weight() {
    // All carriages together move all bodies by as much: each drive carries a third of 3·0.15 + 6·0.012 + 0.25 = 0.772 kg,
    // against +q, which is downwards. Accelerated together by 2 m/s², they need 0.772·2/3 N more.
    let mut model = model("linear-delta");
    model.effects.clear();
    let plant = Plant::new(&model, &Setup::default());
    for acceleration in [0.0, 2.0] {
        let joints = JointState {
            q: [0.05, 0.05, 0.05, 0.0],
            qdd: [acceleration, acceleration, acceleration, 0.0],
            ..JointState::default()
        };
        let motion = plant.motion(&joints).unwrap();
        let out = inverse_dynamics(&plant, 0.0, &motion, &[&[]], true).unwrap();
        let force = 0.772 / 3.0 * (acceleration - 9.81);
        for tau in &out.tau[..3] {
            approx::assert_relative_eq!(*tau, force, epsilon = 1e-12);
        }
        // The platform hangs on struts at an angle with the vertical whose sine is (163.25 − 33)/269. The force on the
        // lower end of a strut, with half its weight, is along it: (V + w/2)/cos, less the weight's own share along it.
        let cosine = (1.0 - (0.130_25f64 / 0.269).powi(2)).sqrt();
        let pull = 9.81 - acceleration;
        let (platform, half) = (pull * 0.25 / 6.0, pull * 0.006);
        for strut in 0..6 {
            let lower = (platform + half) / cosine - half * cosine;
            approx::assert_relative_eq!(out.reactions.lower[strut], lower, epsilon = 1e-5);
        }
    }
}

/// The motor of a carriage resists its acceleration and does not weigh: 0.1 kg · 5 m/s² = 0.5 N on carriage 1, nothing at rest.
#[test]
fn motors_of_carriages_resist_and_do_not_weigh() {
    let mut model = model("linear-delta");
    model.effects.clear();
    let force = |model: &Model, acceleration: f64| {
        let plant = Plant::new(model, &Setup::default());
        let q = [0.05, 0.06, 0.04, 0.0];
        let joints = JointState { q, qdd: [acceleration, 0.0, 0.0, 0.0], ..JointState::default() };
        let states = vec![&[][..]; plant.effects.len()];
        inverse_dynamics(&plant, 0.0, &plant.motion(&joints).unwrap(), &states, false).unwrap().tau
    };
    let before = [0.0, 5.0].map(|a| force(&model, a));
    let absent = deltatwin::effects::find("rotor_inertia").unwrap();
    let mut motor = deltatwin::effects::ActiveEffect::absent_on(absent, model.host());
    motor.values[0] = 0.1;
    assert_eq!(motor.entries().len(), motor.values.len());
    model.effects.push(motor);
    for (acceleration, before, expected) in [(0.0, before[0], 0.0), (5.0, before[1], 0.5)] {
        let after = force(&model, acceleration);
        for (axis, expected) in [expected, 0.0, 0.0].into_iter().enumerate() {
            approx::assert_relative_eq!(after[axis] - before[axis], expected, epsilon = 1e-12);
        }
    }
}

#[test]
fn units_of_drives_are_those_of_carriages_and_units_of_links_are_not() {
    let model = model("linear-delta");
    assert_eq!(model.mechanism, Mechanism::LINEAR_DELTA);
    let entries = model.effects.iter().flat_map(|active| active.entries()).collect::<Vec<_>>();
    let unit = |name: &str| entries.iter().find(|e| e.name == name).unwrap().parameter.unit.to_string();
    assert_eq!((unit("coulomb_1"), unit("viscous_1")), ("N".into(), "N·s/m".into()));
    let mut sockets = deltatwin::effects::ActiveEffect::absent_on(
        deltatwin::effects::find("ball_socket_coulomb").unwrap().clone(),
        model.host(),
    )
    .entries();
    assert_eq!(sockets.remove(0).parameter.unit.to_string(), "N·m");
}

/// What `robot` measures on a random motion of 8 s, with the noise of its drives.
fn recorded(robot: &Model, seed: u64) -> Dataset {
    recorded_with(robot, seed, &[])
}

/// What `robot` measures with sensors of the upper force in some of its struts, too.
fn recorded_with(robot: &Model, seed: u64, struts: &[usize]) -> Dataset {
    const PERIOD: f64 = 2e-3;
    let setup = Setup::default();
    let course = Course::RandomFourier { seed, frequency: 0.25, harmonics: 8, share: 0.7 };
    let motion = course.on(robot, &setup).unwrap();
    let t: Vec<f64> = (0..4000).map(|k| k as f64 * PERIOD).collect();
    let joints = t.iter().map(|&t| motion.at(t).joints(&robot.geometry).unwrap()).collect();
    let mut channels = Channel::of_drives(robot.mechanism);
    channels.extend(struts.iter().map(|s| Channel::StrutUpper(*s)));
    let mut recorded = Dataset { channels, ..planned(setup, t, joints, PERIOD) };
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    recorded.set_measured(predict(&Plant::new(robot, &setup), &recorded).unwrap());
    let sigmas =
        robot.noise.torque.iter().take(robot.mechanism.axes()).chain(std::iter::repeat(&robot.noise.strut_force));
    for (series, &sigma) in recorded.measured.iter_mut().zip(sigmas) {
        let noise = Normal::new(0.0, sigma).unwrap();
        series.iter_mut().for_each(|x| *x += noise.sample(&mut rng));
    }
    recorded
}

#[test]
#[ignore = "campaign"]
fn limbs_have_their_own_parameters_where_the_data_demand_it() {
    for (name, differing) in [("linear-delta", "rigid_bodies.arm_mass"), ("irb360-6-1600", "rigid_bodies.arm_")] {
        let alike = model(name);
        let mut robot = alike.clone();
        // The second arm with its drive is a tenth heavier.
        robot.bodies[1] = robot.bodies[1] * 1.1;
        for (robot, demanded) in [(&robot, true), (&alike, false)] {
            let (fitted, held_out) = ([recorded(robot, 1)], [recorded(robot, 2)]);
            let noise = NoiseLevel::of(robot, &fitted);
            let fit = fit(&alike, &fitted, &noise.of_each).unwrap();
            for held_out in [&held_out[..], &[]] {
                let data = (&fitted[..], held_out);
                let test = limb_test(&fit, &alike, data, &noise, &Options::default()).unwrap().unwrap();
                assert_eq!((test.demanded, test.held_out), (demanded, !held_out.is_empty()), "{name} {test:?}");
                let named = test.differing.iter().find(|one| one.name.starts_with(differing));
                assert_eq!(named.is_some(), demanded, "{name} {test:?}");
                let Some(one) = named else { continue };
                approx::assert_relative_eq!(one.values[1] / one.values[0], 1.1, epsilon = 0.02);
            }
        }
    }
}

/// Models of relatives with other plates.
const RELATIVES: [&str; 4] = ["par4", "h4", "i4", "par2"];

/// The shipped motion of a relative.
fn shipped_motion(name: &str) -> (Model, deltatwin::scenario::Scenario, DesiredMotion) {
    let model = model(name);
    let scenario = deltatwin_io::scenario::read(&crate::common::shipped(format!("scenarios/{name}.toml"))).unwrap();
    let motion = scenario.motion(&model).unwrap();
    (model, scenario, motion)
}

/// Parts of plates that the data hardly determine are bodies nevertheless, the one with the tool included; and the loads of
/// the struts are those of the fit.
#[test]
#[ignore = "campaign"]
fn fits_of_relatives_are_machines() {
    for name in RELATIVES {
        let mut robot = model(name);
        robot.noise.torque = robot.noise.torque.map(|sigma| 10.0 * sigma);
        for seed in 1..4 {
            let recorded = [recorded_with(&robot, seed, &[0])];
            let noise = NoiseLevel::of(&robot, &recorded);
            let fitted = fit(&robot, &recorded, &noise.of_each).unwrap();
            let least = min_eigenvalue(&fitted.model.bodies);
            assert!(least > 0.0, "{name}, seed {seed}: {least:e}");
            for (rms, noise) in fitted.residuals.rms.iter().zip(&noise.pooled) {
                assert!(*rms < 1.05 * noise, "{name}, seed {seed}: {:?} of {:?}", fitted.residuals.rms, noise);
            }
        }
    }
}

/// A motion without corners within the workspace of every relative, about a seventh as large on carriages.
fn smooth(plant: &Plant, t: f64) -> JointState {
    let (scale, height) = if plant.mechanism.has_carriages() { (0.15, -0.335) } else { (1.0, -0.8) };
    let wave = |amplitude: f64, rate: f64, phase: f64| {
        let (s, c) = (rate * t + phase).sin_cos();
        let amplitude = scale * amplitude;
        [amplitude * s, amplitude * rate * c, -amplitude * rate * rate * s]
    };
    let [x, y, z] = [wave(0.2, 9.0, 0.3), wave(0.12, 11.0, 1.0), wave(0.06, 12.0, 2.0)];
    let vector = |k: usize| Vector3::new(x[k], y[k], z[k]);
    let psi = if plant.mechanism.plate_turns() { wave(0.5, 10.0, 0.7) } else { [0.0; 3] };
    let position = vector(0) + Vector3::new(0.0, -0.05 * scale, height);
    let pose = PlatformState { position, velocity: vector(1), acceleration: vector(2), psi };
    plant.geometry.inverse_motion(&pose).unwrap()
}

/// Poses, twists and accelerations of every body are each other's derivatives, passive arms and parts of plates included.
#[test]
fn bodies_of_relatives_move_as_their_poses_do() {
    let h = 2e-4;
    for name in RELATIVES {
        let (model, scenario, _) = shipped_motion(name);
        let plant = Plant::new(&model, &scenario.setup);
        let at = |t: f64| plant.motion(&smooth(&plant, t)).unwrap();
        let (mut worst, mut moved) = ([0.0f64; 4], 0.0f64);
        for t in [0.11, 0.2, 0.26, 0.33] {
            let (before, now, after) = (at(t - h), at(t), at(t + h));
            for body in (0..now.bodies.len()).filter(|&b| model.mechanism.has_body(b)) {
                let [a, b, c] = [&before, &now, &after].map(|m| &m.bodies[body]);
                moved = moved.max(b.velocity.norm()).max(b.angular_velocity.norm());
                let turning = b.angular_velocity.cross_matrix() * b.rotation;
                // The roll of a strut is not defined by the joints.
                let columns = if model.mechanism.is_part_of_plate(body) { 3 } else { 1 };
                let turned = (c.rotation - a.rotation) / (2.0 * h) - turning;
                let gaps = [
                    ((c.position - a.position) / (2.0 * h) - b.velocity).norm(),
                    turned.columns(0, columns).norm(),
                    ((c.velocity - a.velocity) / (2.0 * h) - b.acceleration).norm(),
                    ((c.angular_velocity - a.angular_velocity) / (2.0 * h) - b.angular_acceleration).norm(),
                ];
                worst = std::array::from_fn(|k| worst[k].max(gaps[k]));
            }
        }
        println!("{name}: {worst:?}, {moved:.1} m/s or rad/s");
        assert!(
            moved > 2.0 && worst[..2].iter().all(|w| *w < 2e-4) && worst[2..].iter().all(|w| *w < 2e-2),
            "{worst:?}"
        );
    }
}

/// Play of the balls opposes to a motion the inertia of all that it displaces, as longer struts displace it while the drives are
/// locked: the platform or the parts of a plate, and passive arms.
#[test]
fn play_of_the_balls_displaces_the_plates_of_relatives() {
    const PLAY: f64 = 1e-3;
    for name in RELATIVES {
        let (mut robot, scenario, _) = shipped_motion(name);
        robot.effects.clear();
        let plain = Plant::new(&robot, &scenario.setup);
        let joints = smooth(&plain, 0.2);
        let motion = plain.motion(&joints).unwrap();
        let state: Vec<f64> = (0..3 * motion.struts()).map(|k| (1.7 * k as f64).sin()).collect();
        let rate = |s: usize| (state[3 * s] - 2.0 * state[3 * s + 1] + state[3 * s + 2]) / 4e-3f64.powi(2);
        let mut moved = motion;
        for limb in 0..motion.limbs {
            let elongation = 0.25 * PLAY * (rate(2 * limb) + rate(2 * limb + 1));
            let [shorter, longer] = [-1e-6, 1e-6].map(|length| {
                let mut other = robot.clone();
                other.geometry.limbs[limb].strut_length += length;
                Plant::new(&other, &scenario.setup).motion(&joints).unwrap()
            });
            let is_displaced = |b: &usize| {
                robot.mechanism.is_part_of_plate(*b)
                    || *b == END_EFFECTOR
                    || (motion.driven..motion.limbs).any(|i| *b == arm(i))
            };
            for body in (0..motion.bodies.len()).filter(is_displaced) {
                let [a, b] = [&shorter, &longer].map(|m| &m.bodies[body]);
                let turned = (b.rotation - a.rotation) * motion.bodies[body].rotation.transpose();
                let turned = Vector3::new(turned[(2, 1)], turned[(0, 2)], turned[(1, 0)]);
                moved.bodies[body].acceleration += (b.position - a.position) / 2e-6 * elongation;
                moved.bodies[body].angular_acceleration += turned / 2e-6 * elongation;
            }
        }
        let effect = find("ball_socket_clearance").unwrap();
        robot.effects.push(ActiveEffect::new(effect, &[&vec![PLAY; motion.limbs], &[10.0], &[4e-3]]));
        let with = Plant::new(&robot, &scenario.setup);
        let [still, displaced] = [motion, moved].map(|m| inverse_dynamics(&plain, 0.0, &m, &[], true).unwrap());
        let played = inverse_dynamics(&with, 0.0, &motion, &[&state], true).unwrap();
        let worst = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        let gaps = [worst(&played.tau, &displaced.tau), worst(&played.reactions.lower, &displaced.reactions.lower)];
        let size = [worst(&played.tau, &still.tau), worst(&played.reactions.lower, &still.reactions.lower)];
        println!("{name}: {gaps:?} of {size:?}");
        assert!(gaps.iter().zip(size).all(|(gap, size)| size > 1.0 && *gap < 1e-6 * size), "{name}: {gaps:?} {size:?}");
    }
}

/// The power of the drives is the rate of the bodies' energy plus the power lost in the drives' friction.
#[test]
fn drives_of_relatives_do_the_work_that_moves_them() {
    for name in RELATIVES {
        let (model, scenario, _) = shipped_motion(name);
        let mut plant = Plant::new(&model, &scenario.setup);
        plant.effects.clear();
        let at = |t: f64| plant.motion(&smooth(&plant, t)).unwrap();
        let energy = |t: f64| -> f64 {
            let motion = at(t);
            let of = |(inertia, body): (&deltatwin::machine::Inertia, &deltatwin::kinematics::BodyMotion)| {
                let h = body.rotation * inertia.first_moment;
                let omega = body.rotation.tr_mul(&body.angular_velocity);
                0.5 * inertia.mass * body.velocity.norm_squared()
                    + body.velocity.dot(&body.angular_velocity.cross(&h))
                    + 0.5 * omega.dot(&(inertia.tensor * omega))
                    + plant.gravity * (inertia.mass * body.position.z + h.z)
            };
            plant.bodies.0.iter().zip(&motion.bodies).map(of).sum()
        };
        let mut largest = 0.0f64;
        for t in [0.11, 0.2, 0.26, 0.33] {
            let motion = at(t);
            let tau = inverse_dynamics(&plant, t, &motion, &[], false).unwrap().tau;
            let power: f64 = (0..model.mechanism.axes()).map(|i| tau[i] * motion.qd[i]).sum();
            let h = 1e-4;
            let rate = (energy(t + h) - energy(t - h)) / (2.0 * h);
            largest = largest.max(power.abs());
            assert!((power - rate).abs() < 1e-3 * power.abs().max(100.0), "{name}: {power} {rate}");
        }
        assert!(largest > 20.0, "{name}: {largest} W");
    }
}

/// Forces of the balls accelerate every strut and the plate as a whole, and the twin records the margins that follow from them.
#[test]
fn balls_of_relatives_carry_their_struts_and_the_plate() {
    for name in RELATIVES {
        let (model, scenario, desired) = shipped_motion(name);
        let mut plant = Plant::new(&model, &scenario.setup);
        plant.effects.clear();
        let motion = plant.motion(&smooth(&plant, 0.26)).unwrap();
        let struts = model.mechanism.struts();
        let demand = |body: usize| {
            let (inertia, b) = (&plant.bodies[body], &motion.bodies[body]);
            let centre = b.rotation * inertia.first_moment;
            let turning = b.angular_velocity.cross(&b.angular_velocity.cross(&centre));
            let gravity = Vector3::z() * plant.gravity;
            (b.acceleration + gravity) * inertia.mass + b.angular_acceleration.cross(&centre) + turning
        };
        let forces = deltatwin::dynamics::steady_socket_loads(&plant, 0.0, &motion).unwrap().sockets;
        for s in 0..struts {
            let own = demand(deltatwin::machine::bodies::strut(s));
            approx::assert_abs_diff_eq!(forces[s] + forces[struts + s], own, epsilon = 1e-9);
        }
        let parts = (0..plant.bodies.0.len()).filter(|&b| model.mechanism.is_part_of_plate(b));
        let tool = deltatwin::machine::bodies::END_EFFECTOR;
        let held = if model.mechanism.is_part_of_plate(tool) { Vector3::zeros() } else { demand(tool) };
        let carried = parts.map(demand).sum::<Vector3<f64>>() + held;
        let given: Vector3<f64> = forces[struts..2 * struts].iter().sum();
        approx::assert_abs_diff_eq!(-given, carried, epsilon = 1e-8);
        // The twin with the same criterion.
        let plant = Plant::new(&model, &scenario.setup);
        let mut options = deltatwin::twin::Options { duration: 0.3, ..Default::default() };
        (options.sensors.sockets, options.sensors.velocity, options.sensors.acceleration) = (true, true, true);
        let run =
            deltatwin::twin::simulate(&model, &scenario.setup, &plant, &|t| desired.at(t), &options, &mut |_| true);
        let signals = run.unwrap().0.signals;
        let clamps = deltatwin::twin::Clamps::watched(&model.sockets);
        let (qd, qdd) = (signals.rows(Channel::Rate), signals.rows(Channel::Acceleration));
        let sockets = Channel::of_sockets(model.mechanism);
        assert_eq!(sockets.len(), 2 * struts);
        let mut worst = 0.0f64;
        for k in (0..signals.len()).step_by(50) {
            let joints = JointState { q: signals.q().at(k), qd: qd.at(k), qdd: qdd.at(k) };
            let margins = clamps.along(&plant, signals.t[k], &plant.motion(&joints).unwrap()).unwrap().1;
            for (channel, margin) in sockets.iter().zip(margins) {
                worst = worst.max((signals[*channel][k] - margin).abs());
            }
        }
        assert!(worst < 0.1, "{name}: {worst} N");
    }
}

/// A designed motion of a robot with passive arms stays within every limit and shows more than random ones.
#[test]
fn motions_are_designed_for_relatives() {
    use deltatwin::excitation::{Options, design};
    let model = model("par2");
    let options = Options { harmonics: 3, randoms: 3, starts: 1, iterations: 8, ..Options::default() };
    let found = design(&model, &options, &|| true).unwrap();
    let value = |merit: &deltatwin::excitation::Merit| merit.log_det;
    assert!(found.worst.iter().all(|(_, use_)| *use_ <= 1.0), "{:?}", found.worst);
    assert!(found.random.iter().all(|random| value(random) < value(&found.merit)), "{:?}", found.merit);
    assert!(found.parameters.iter().any(|p| p.name.contains("passive_arm")));
}

/// A run of the twin follows its motion, keeps its energy, and its strut forces are those of the inverse dynamics.
#[test]
fn twins_of_relatives_follow_their_motion() {
    for name in RELATIVES {
        let (model, scenario, desired) = shipped_motion(name);
        let plant = Plant::new(&model, &scenario.setup);
        let options = deltatwin::twin::Options { duration: scenario.duration, ..Default::default() };
        let (recording, report) =
            deltatwin::twin::simulate(&model, &scenario.setup, &plant, &|t| desired.at(t), &options, &mut |_| true)
                .unwrap();
        let error = report.tracking_error.iter().fold(0.0f64, |a, b| a.max(b.abs()));
        println!("{name}: {error:.1e} rad, energy {:.1e}, {:.0} N", report.energy_error, report.peak_strut_force);
        assert!(error < 1e-3 && report.energy_closes(), "{name}: {error} {}", report.energy_error);
        assert!(report.peak_strut_force > 20.0 && recording.signals.len() > 500);
    }
}

/// Gears of other numbers of arms give way: both formulations agree, every encoder leads its arm, the run keeps account of its
/// energy, and the torques follow from what the encoders read.
#[test]
#[ignore = "campaign"]
fn gears_of_relatives_give_way() {
    for (name, rotor) in [("par4", 0.07), ("par2", 0.07), ("linear-delta", 0.06)] {
        let rigid = model(name);
        let arms = rigid.mechanism.arms();
        let mut elastic = rigid.clone();
        let gears = [vec![8e-5; arms], vec![20.0], vec![rotor], vec![0.0]];
        let gears: Vec<&[f64]> = gears.iter().map(Vec::as_slice).collect();
        elastic.effects.push(ActiveEffect::new(find("drive_elasticity").unwrap(), &gears));
        let setup = Setup::default();
        let believed = Plant::new(&rigid, &setup);
        let desired = |t: f64| smooth(&believed, t);
        let run = |robot: &Model, formulation: Formulation, duration: f64, substeps: usize| {
            let mut options = deltatwin::twin::Options { duration, formulation, substeps, ..Default::default() };
            options.sensors.links = true;
            deltatwin::twin::simulate(robot, &setup, &believed, &desired, &options, &mut |_| true).unwrap()
        };
        let [closed, free] =
            [Formulation::Eliminated, Formulation::Absolute].map(|f| run(&elastic, f, 0.02, 32).0.signals);
        for (channel, values) in closed.series() {
            let apart = values.iter().zip(&free[channel]).map(|(a, b)| (a - b).abs() / (1.0 + a.abs()));
            let worst = apart.fold(0.0, f64::max);
            assert!(worst < 1e-7, "{name}: {worst:e} in {channel}");
        }
        let (recording, report) = run(&elastic, Formulation::Eliminated, 2.0, 2);
        assert!(report.energy_closes(), "{name}: {}", report.energy_error);
        for axis in 0..arms {
            let [motor, link] = [Channel::Angle(axis), Channel::LinkAngle(axis)].map(|c| &recording.signals[c]);
            let lead = motor.iter().zip(link).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(lead > 1e-4 && lead < 1e-2, "{name}, axis {}: {lead:e} rad", axis + 1);
        }
        let rms = |robot: &Model, dataset: &Dataset| {
            let seen = predict(&Plant::new(robot, &setup), dataset).unwrap();
            let squares =
                (0..arms).flat_map(|c| seen[c].iter().zip(&dataset.measured[c]).map(|(a, b)| (a - b).powi(2)));
            (squares.sum::<f64>() / (arms * dataset.len()) as f64).sqrt()
        };
        let plain = Dataset::new(&run(&rigid, Formulation::Eliminated, 2.0, 2).0);
        let dataset = Dataset::new(&recording);
        let (least, left, without) = (rms(&rigid, &plain), rms(&elastic, &dataset), rms(&rigid, &dataset));
        println!("{name}: {least:.4} N·m on a rigid robot, {left:.4} on this one, {without:.4} if it were rigid");
        // What is left on both is the error of the differentiated angles.
        let beyond = |rms: f64| (rms * rms - least * least).max(0.0).sqrt();
        assert!(beyond(left) < 0.1 * beyond(without), "{name}: {least} {left} {without}");
    }
}

/// Three limbs of different lengths at odd azimuths, one shaft off the radial line and one above the others.
fn uneven() -> Model {
    let mut model = model("clavel-delta");
    let changes = [(0.1, 0.97, 0.0, 0.0), (2.0, 1.04, 0.015, 0.0), (4.4, 1.0, 0.0, 0.02)];
    for (limb, (azimuth, factor, offset, height)) in model.geometry.limbs.iter_mut().zip(changes) {
        let radius = limb.point.norm() * factor;
        limb.turn_to(azimuth);
        limb.point = limb.radial() * radius + limb.tangential() * offset;
        (limb.base_offset, limb.base_height) = (offset, height);
        limb.strut_length *= factor;
        limb.arm_length *= 2.0 - factor;
        limb.pair_distance *= factor;
    }
    model
}

/// Three limbs need not be alike: closed form and free bodies with all joints as constraint rows agree.
#[test]
fn uneven_limbs_run_both_ways() {
    let model = uneven();
    let text = deltatwin_io::model::full_text(&model).unwrap();
    let again = deltatwin_io::model::parse(&text, std::path::Path::new("uneven.toml")).unwrap();
    assert!(again.geometry == model.geometry && again.mechanism.is_delta(), "{text}");
    let plant = Plant::new(&model, &Setup::default());
    let start = model.geometry.home().unwrap().platform;
    let desired = |t: f64| {
        let (s, c) = (25.0 * t).sin_cos();
        let way = Vector3::new(0.05, -0.03, -0.04);
        PlatformState {
            position: start - Vector3::z() * 0.1 + way * s,
            velocity: way * (25.0 * c),
            acceleration: way * (-625.0 * s),
            psi: [0.0; 3],
        }
    };
    let run = |formulation: Formulation| {
        let mut options = deltatwin::twin::Options { duration: 0.02, formulation, substeps: 32, ..Default::default() };
        (options.sensors.strut_upper, options.sensors.strut_lower) =
            (crate::common::SIX_STRUTS, crate::common::SIX_STRUTS);
        deltatwin::twin::simulate(&model, &Setup::default(), &plant, &desired, &options, &mut |_| true).unwrap().0
    };
    let (closed, free) = (run(Formulation::Eliminated), run(Formulation::Absolute));
    let (mut worst, mut largest) = (0.0f64, 0.0f64);
    for (channel, values) in closed.signals.series() {
        for (a, b) in values.iter().zip(&free.signals[channel]) {
            worst = worst.max((a - b).abs() / (1.0 + a.abs()));
            largest = largest.max(a.abs());
        }
    }
    println!("{worst:.1e} of {largest:.1}");
    assert!(worst < 1e-7 && largest > 20.0, "{worst:e} of {largest}");
}

/// Where the end effector is part of the platform, a force off its centre turns the platform: forces of the balls, weight,
/// inertia and drag are in equilibrium, and the column of the drag is the change of the loads.
#[test]
fn loads_off_the_centre_turn_the_platform() {
    use deltatwin::dynamics::{Sample, inertial_wrench, regressor, steady_inverse_dynamics, steady_socket_loads};
    use deltatwin::machine::Payload;
    use deltatwin::machine::bodies::{END_EFFECTOR, PLATFORM};
    const COEFFICIENT: f64 = 3.0;
    let payload = Payload { mass: 0.5, com: Vector3::new(0.06, -0.04, -0.03), ..Payload::default() };
    for name in ["linear-delta", "clavel-delta", "par2"] {
        let setup = Setup { payload, ..Setup::default() };
        let mut robot = model(name);
        robot.effects.clear();
        robot.effects.push(ActiveEffect::new(find("payload_drag").unwrap(), &[&[COEFFICIENT]]));
        let mut plant = Plant::new(&robot, &setup);
        let motion = plant.motion(&smooth(&plant, 0.26)).unwrap();
        let struts = plant.mechanism.struts();
        let [platform, tool] = [PLATFORM, END_EFFECTOR].map(|b| &motion.bodies[b]);
        let lever = tool.position + payload.com - platform.position;
        let drag = -platform.velocity * (COEFFICIENT * platform.velocity.norm());
        let (force, moment) = inertial_wrench(&plant.bodies[PLATFORM], platform, &plant.gravity_vector());
        let (mut force, mut moment) = (drag - force, lever.cross(&drag) - moment);
        let forces = steady_socket_loads(&plant, 0.0, &motion).unwrap().sockets;
        for s in 0..struts {
            force -= forces[struts + s];
            moment -= (motion.lower_ball(s) - platform.position).cross(&forces[struts + s]);
        }
        println!("{name}: drag {:.2} N, left {:.1e} N, {:.1e} N·m", drag.norm(), force.norm(), moment.norm());
        assert!(drag.norm() > 0.1 && force.norm() < 1e-9 && moment.norm() < 1e-9, "{name}: {force} {moment}");
        let mut channels = Channel::of_drives(plant.mechanism);
        channels.extend((0..struts).flat_map(|s| [Channel::StrutUpper(s), Channel::StrutLower(s)]));
        let with = steady_inverse_dynamics(&plant, 0.0, &motion, true).unwrap();
        let at = Sample { t: 0.0, motion: &motion, loads: &with };
        let column = regressor(&plant, &[&plant.effects[0]], &at, &[&[]], &channels).unwrap().column(0) * COEFFICIENT;
        plant.effects.clear();
        let without = steady_inverse_dynamics(&plant, 0.0, &motion, true).unwrap();
        for (channel, own) in channels.iter().zip(&column) {
            approx::assert_relative_eq!(with.of(*channel) - without.of(*channel), *own, epsilon = 1e-9);
        }
    }
}
