//! What recordings say about parameters: standard errors, consistency, and what cannot be told.

use crate::common;

use deltatwin::comparison::compare;
use deltatwin::diagnosis::{add, diagnose};
use deltatwin::dynamics::{Plant, set_parameters};
use deltatwin::effects::{ActiveEffect, find};
use deltatwin::identification::consistency::min_eigenvalue;
use deltatwin::identification::fit::{Consistency, Options, Reason, Weighing, fit_with};
use deltatwin::identification::{BaseParameter, Dataset, Residuals, fit, identify_payload, predict};
use deltatwin::kinematics::JointState;
use deltatwin::machine::bodies::ROTOR;
use deltatwin::machine::{Configuration, Setup};
use deltatwin::model::Model;
use deltatwin::recording::Channel;
use deltatwin::scenario::{FourierMotion, MotionLimits};
use deltatwin_io::model;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::StandardNormal;
use rayon::prelude::*;

const SIGMA: [f64; 4] = [0.4, 0.4, 0.4, 0.05];

/// A recording of `robot` along a motion that is known exactly, without noise.
fn dataset(robot: &Model, setup: &Setup, samples: usize, dt: f64, motion: impl Fn(f64) -> JointState) -> Dataset {
    let joints = (0..samples).map(|k| motion(k as f64 * dt)).collect();
    let exact = Dataset::exact(robot.mechanism, *setup, Channel::TORQUES.to_vec(), dt, joints);
    let mut dataset = Dataset { name: "made".into(), half_width: [10; 4], ..exact };
    dataset.set_measured(predict(&Plant::new(robot, setup), &dataset).expect("reachable"));
    dataset
}

/// A random end-effector Fourier motion in joint angles.
fn excitation(seed: u64) -> impl Fn(f64) -> JointState {
    let nominal = common::model("irb360-6-1600");
    let believed = Plant::new(&nominal, &Setup::default());
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let motion = FourierMotion::random(&believed, &MotionLimits::of(&nominal, 0.45), 0.1, 10, &mut rng);
    move |t| believed.geometry.inverse_motion(&motion.at(t)).expect("within the workspace")
}

fn robot() -> Model {
    let mut robot = common::model("irb360-6-1600");
    deltatwin_validation::exam::perturb(&mut robot, &mut ChaCha8Rng::seed_from_u64(9));
    robot
}

/// Values of `model`'s parameters in the combinations `base`.
fn combined(model: &Model, base: &[BaseParameter]) -> Vec<f64> {
    let parameters = Plant::new(model, &Setup::default()).parameters();
    let value = |name: &str| parameters.iter().find(|p| p.name == name).expect("a parameter").value;
    base.iter().map(|b| value(&b.name) + b.others.iter().map(|(n, f)| f * value(n)).sum::<f64>()).collect()
}

/// Noise with memory (half a millisecond to 50 ms), correlated across axes and growing with speed, of RMS about `SIGMA`.
fn robot_like_noise(dataset: &Dataset, rng: &mut ChaCha8Rng) -> Vec<[f64; 4]> {
    let mut slow = [0.0; 4];
    let memory: f64 = (-dataset.dt / 0.05).exp();
    let mut normal = || rng.sample::<f64, _>(StandardNormal);
    let common_part = |dataset: &Dataset, k: usize, slow: &[f64; 4], common: f64, white: &[f64; 4]| {
        std::array::from_fn(|i| {
            let growth = 0.6 + 0.2 * dataset.joints[k].qd[i].abs().min(4.0);
            SIGMA[i] * growth * (0.6 * white[i] + 0.6 * slow[i] + 0.5 * common)
        })
    };
    (0..dataset.len())
        .map(|k| {
            for x in &mut slow {
                *x = memory * *x + (1.0 - memory * memory).sqrt() * normal();
            }
            let (common, white) = (normal(), [normal(), normal(), normal(), normal()]);
            common_part(dataset, k, &slow, common, &white)
        })
        .collect()
}

#[test]
#[ignore = "campaign"]
fn intervals_cover_the_truth_when_noise_has_memory() {
    const RUNS: u64 = 200;
    let robot = robot();
    let nominal = common::model("irb360-6-1600");
    let clean = dataset(&robot, &Setup::default(), 2500, 8e-3, excitation(3));
    let run = |seed: u64| {
        let mut noisy = clean.clone();
        let mut rng = ChaCha8Rng::seed_from_u64(1000 + seed);
        for (k, e) in robot_like_noise(&clean, &mut rng).iter().enumerate() {
            for i in 0..4 {
                noisy.measured[i][k] += e[i];
            }
        }
        let fitted = fit(&nominal, &[noisy], &[SIGMA.to_vec()]).expect("a fit");
        let truth = combined(&robot, &fitted.base);
        let error = |(b, t): (&BaseParameter, f64)| (b.name.clone(), (b.value - t) / b.std);
        fitted.base.iter().zip(truth).map(error).collect::<Vec<(String, f64)>>()
    };
    let errors: Vec<Vec<(String, f64)>> = (0..RUNS).into_par_iter().map(run).collect();
    let mut inside = 0;
    let mut all = 0;
    for (i, (name, _)) in errors[0].iter().enumerate() {
        let of_one: Vec<f64> = errors.iter().map(|e| e[i].1).collect();
        let covered = of_one.iter().filter(|e| e.abs() < 1.96).count();
        let spread = (of_one.iter().map(|e| e * e).sum::<f64>() / RUNS as f64).sqrt();
        println!("{name:<45} {:.1} % covered, error/std RMS {spread:.2}", 100.0 * covered as f64 / RUNS as f64);
        // 95 % of 200 is 190 ± 3: three standard deviations and a half.
        assert!((176..=199).contains(&covered), "{name}: {covered} of {RUNS}");
        inside += covered;
        all += of_one.len();
    }
    let share = inside as f64 / all as f64;
    println!("all together {:.2} %", 100.0 * share);
    assert!((0.93..0.97).contains(&share), "{share}");
}

#[test]
fn weights_of_rows_and_robust_loss_change_little_when_the_model_is_right() {
    let robot = robot();
    let nominal = common::model("irb360-6-1600");
    let mut noisy = dataset(&robot, &Setup::default(), 5000, 4e-3, excitation(3));
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for (channel, sigma) in noisy.measured.iter_mut().zip(SIGMA) {
        channel.iter_mut().for_each(|x| *x += sigma * rng.sample::<f64, _>(StandardNormal));
    }
    let plain = fit(&nominal, &[noisy.clone()], &[SIGMA.to_vec()]).unwrap();
    // Every fiftieth sample is spoilt.
    let mut spoilt = noisy.clone();
    for channel in &mut spoilt.measured {
        channel.iter_mut().step_by(50).for_each(|x| *x += 20.0);
    }
    let with = |dataset: &Dataset, options: Options| {
        fit_with(&nominal, std::slice::from_ref(dataset), &[SIGMA.to_vec()], &options).unwrap()
    };
    let maximum = with(&noisy, Options { weighing: Weighing::Maximum, ..Options::default() });
    let robust = with(&spoilt, Options { robust: true, ..Options::default() });
    let fooled = with(&spoilt, Options::default());
    let truth = combined(&robot, &plain.base);
    let worst = |other: &[BaseParameter]| {
        let error = |(i, b): (usize, &BaseParameter)| (b.value - truth[i]).abs() / plain.base[i].std;
        other.iter().enumerate().map(error).fold(0.0, f64::max)
    };
    let (a, b, c) = (worst(&maximum.base), worst(&robust.base), worst(&fooled.base));
    println!("worst error in standard errors: maximum weights {a:.1}, robust {b:.1}, plain on spoilt data {c:.1}");
    assert!(a < 5.0 && b < 6.0 && c > 3.0 * b, "{a} {b} {c}");
}

#[test]
#[ignore = "campaign"]
fn garbage_gives_possible_bodies_and_both_ways_agree() {
    let nominal = common::model("irb360-6-1600");
    let clean = dataset(&nominal, &Setup::default(), 1500, 4e-3, excitation(3));
    let (mut corrected, mut written) = (0, 0);
    for seed in 0..12u64 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut garbage = clean.clone();
        let size = 10f64.powf(rng.random_range(-2.0..4.0));
        for channel in &mut garbage.measured {
            let (sign, slope) = (rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0));
            for (k, x) in channel.iter_mut().enumerate() {
                *x = sign * *x + size * (rng.sample::<f64, _>(StandardNormal) + slope * (k as f64 * 0.01).sin());
            }
        }
        let of = |consistency| {
            let options = Options { consistency, ..Options::default() };
            fit_with(&nominal, &[garbage.clone()], &[SIGMA.to_vec()], &options).expect("a fit")
        };
        let (smooth, convex) = (of(Consistency::LogCholesky), of(Consistency::Cones));
        for fitted in [&smooth, &convex] {
            let smallest = min_eigenvalue(&fitted.model.bodies);
            assert!(smallest > 0.0, "seed {seed}: {smallest:e}");
            assert!(fitted.residuals.rms.iter().all(|r| r.is_finite()));
            let file = std::env::temp_dir().join(format!("deltatwin-garbage-{}-{seed}.toml", std::process::id()));
            // Bodies of tonnes are refused by name; what is written loads again, with its bodies and ranges checked.
            match deltatwin_io::model::write(&fitted.model, &file) {
                Ok(()) => {
                    model::read(&file).expect("a model that can be read");
                    std::fs::remove_file(file).ok();
                    written += 1;
                }
                Err(e) => assert!(format!("{e:?}").contains("expected a number"), "{e:?}"),
            }
        }
        if let Some((smooth, convex)) = smooth.correction.zip(convex.correction) {
            let apart = (smooth.cost - convex.cost) / convex.cost;
            println!("seed {seed}: cost {:.3e}, log-Cholesky {apart:.1e} above", convex.cost);
            assert!(
                apart.abs() < 1e-6 && convex.gap.is_some_and(|gap| gap < 1e-6),
                "seed {seed}: {apart:e} {convex:?}"
            );
            corrected += 1;
        }
    }
    println!("{corrected} of 12 corrected, {written} of 24 written");
    assert!(corrected >= 6 && written >= 12, "{corrected} {written}");
}

/// The factors of all torque sensors and all inertias are free together: short, noisy recordings determine them so badly that
/// the free estimate is no machine at all, and its correction must not cost more than the machine the fit began with.
#[test]
fn a_fit_leaves_no_more_than_the_possible_machine_it_begins_with() {
    let mut assumed = common::model("irb360-6-1600");
    assumed.effects.push(common::defaults("torque_gain_error"));
    let mut corrected = 0;
    for seed in 0..6u64 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut noisy = dataset(&assumed, &Setup::default(), 150, 1e-2, excitation(seed));
        for (channel, sigma) in noisy.measured.iter_mut().zip(SIGMA) {
            let mut slow = 0.0;
            for x in channel.iter_mut() {
                slow = 0.9 * slow + rng.sample::<f64, _>(StandardNormal);
                *x += 2.0 * sigma * slow;
            }
        }
        let begun = Residuals::new(&assumed, std::slice::from_ref(&noisy)).expect("reachable");
        let fitted = fit(&assumed, &[noisy], &[SIGMA.to_vec()]).expect("a fit");
        let cost = |rms: &[f64]| rms.iter().zip(SIGMA).map(|(r, s)| (r / s).powi(2)).sum::<f64>();
        let (before, after) = (cost(&begun.rms), cost(&fitted.residuals.rms));
        println!("seed {seed}: {before:.2}, fitted {after:.2}, {:?}", fitted.correction);
        assert!(after < before, "seed {seed}: {before} {after}");
        corrected += usize::from(fitted.correction.is_some());
    }
    assert!(corrected > 2, "{corrected}");
}

#[test]
fn a_useless_motion_is_answered_by_names() {
    let nominal = common::model("irb360-6-1600");
    let pose = |_: f64| JointState { q: [0.3, 0.4, 0.2, 0.5], ..JointState::default() };
    let still = dataset(&robot(), &Setup::default(), 1000, 4e-3, pose);
    let fitted = fit(&nominal, &[still], &[SIGMA.to_vec()]).unwrap();
    for p in &fitted.parameters {
        let named = fitted.unidentified.iter().any(|u| u.name == p.name);
        assert!(named && !p.identified(), "{} = {} ± {}", p.name, p.value, p.std);
    }
    // Friction and moments of inertia need motion.
    let reason = |name: &str| &fitted.unidentified.iter().find(|u| u.name == name).expect("named").reason;
    assert_eq!(*reason("drive_friction.viscous_1"), Reason::NotExcited);
    assert_eq!(*reason("rigid_bodies.arm_inertia_yy"), Reason::NotExcited);
    assert!(matches!(reason("rigid_bodies.platform_mass"), Reason::OnlyTogether(_)));

    // One axis alone turns.
    let turning = |t: f64| {
        let (s, c) = (9.0 * t).sin_cos();
        JointState { q: [0.3, 0.4, 0.2, 0.5 * s], qd: [0.0, 0.0, 0.0, 4.5 * c], qdd: [0.0, 0.0, 0.0, -40.5 * s] }
    };
    let one = dataset(&robot(), &Setup::default(), 1000, 4e-3, turning);
    let fitted = fit(&nominal, &[one], &[SIGMA.to_vec()]).unwrap();
    let identified: Vec<&str> = fitted.parameters.iter().filter(|p| p.identified()).map(|p| p.name.as_str()).collect();
    assert!(identified.iter().all(|n| n.contains("axis4") || n.contains("rotor")), "{identified:?}");
    assert!(identified.contains(&"axis4_friction.coulomb"), "{identified:?}");
}

#[test]
fn regularisation_pulls_where_the_data_are_silent_and_nowhere_else() {
    let robot = robot();
    let nominal = common::model("irb360-6-1600");
    let mut weighed = nominal.clone();
    let mut values: Vec<f64> = Plant::new(&weighed, &Setup::default()).parameters().iter().map(|p| p.value).collect();
    values.iter_mut().take(17).for_each(|v| *v *= 1.2);
    set_parameters(&mut weighed, &values);
    let data = dataset(&robot, &Setup::default(), 4000, 4e-3, excitation(3));
    let options = |prior| Options { prior, ..Options::default() };
    let own = fit_with(&nominal, std::slice::from_ref(&data), &[SIGMA.to_vec()], &options(None)).unwrap();
    let other = fit_with(&nominal, &[data], &[SIGMA.to_vec()], &options(Some(&weighed))).unwrap();
    for (a, b) in own.parameters.iter().zip(&other.parameters) {
        let moved = (a.value - b.value).abs();
        if a.identified() {
            assert!(moved < 0.1 * a.std, "{}: {moved:e} ± {:e}", a.name, a.std);
        } else if a.name.ends_with("strut_inertia_xx") {
            assert!((b.value / a.value - 1.2).abs() < 1e-3, "{}: {} {}", a.name, a.value, b.value);
        }
    }
    assert!(min_eigenvalue(&other.model.bodies) > 0.0);
}

#[test]
fn arms_alone_are_identified_without_struts() {
    let nominal = common::model("irb360-6-1600-disassembled");
    let setup = Setup { configuration: Configuration::Disassembled, ..Setup::default() };
    let wave = |t: f64| {
        let mut joints = JointState::default();
        for i in 0..4 {
            for k in 1..=5 {
                let (w, a, p) = (2.2 * k as f64, 0.25 / k as f64, (i * 7 + k * k) as f64);
                let (s, c) = (w * t + p).sin_cos();
                joints.q[i] += a * s;
                joints.qd[i] += a * w * c;
                joints.qdd[i] -= a * w * w * s;
            }
        }
        joints
    };
    let data = dataset(&nominal, &setup, 2000, 4e-3, wave);
    let fitted = fit(&nominal, &[data], &[SIGMA.to_vec()]).unwrap();
    let friction: Vec<_> = fitted.parameters.iter().filter(|p| p.name.starts_with("drive_friction")).collect();
    assert!(friction.len() == 8 && friction.iter().all(|p| p.identified()), "{friction:?}");
    assert!(fitted.parameters.iter().all(|p| !p.name.contains("strut") || !p.identified()));
}

#[test]
fn a_payload_is_found_with_a_known_robot() {
    let robot = robot();
    let truth = common::payload();
    let mut data = dataset(&robot, &truth, 5000, 4e-3, excitation(3));
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    for (channel, sigma) in data.measured.iter_mut().zip(SIGMA) {
        channel.iter_mut().for_each(|x| *x += sigma * rng.sample::<f64, _>(StandardNormal));
    }
    let inertia = truth.payload.inertia();
    let expected = [inertia.mass, inertia.first_moment.x, inertia.first_moment.y, inertia.tensor[(2, 2)]];
    // Whatever the setup says about the payload.
    for stated in [Setup::default(), truth] {
        data.setup = stated;
        let found = identify_payload(&robot, &[data.clone()], &[SIGMA.to_vec()], &Options::default()).unwrap();
        let shown: Vec<_> = found.parameters.iter().filter(|p| p.identified()).collect();
        assert_eq!(shown.len(), 4, "{shown:?}");
        for (p, truth) in shown.iter().zip(expected) {
            println!("{:<25} {:.5} ± {:.5}, truth {truth:.5}", p.name, p.value, p.std);
            assert!((p.value - truth).abs() < 3.5 * p.std, "{} {} ± {} {truth}", p.name, p.value, p.std);
        }
        let payload = found.payload;
        assert!(
            (payload.mass - truth.payload.mass).abs() < 0.02 && (payload.com - truth.payload.com).xy().norm() < 2e-3
        );
        assert!((payload.inertia_zz() - truth.payload.inertia_zz()).abs() < 2e-3, "{}", payload.inertia_zz());
    }
}

#[test]
fn recordings_with_different_payloads_are_used_together() {
    let robot = robot();
    let nominal = common::model("irb360-6-1600");
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let data: Vec<Dataset> = [(Setup::default(), 3), (common::payload(), 4)]
        .into_iter()
        .map(|(setup, seed)| {
            let mut data = dataset(&robot, &setup, 2500, 4e-3, excitation(seed));
            for (channel, sigma) in data.measured.iter_mut().zip(SIGMA) {
                channel.iter_mut().for_each(|x| *x += sigma * rng.sample::<f64, _>(StandardNormal));
            }
            data
        })
        .collect();
    let noise = [SIGMA.to_vec(), SIGMA.to_vec()];
    let (one, both) = (fit(&nominal, &data[..1], &noise[..1]).unwrap(), fit(&nominal, &data, &noise).unwrap());
    let truth = combined(&robot, &both.base);
    for (b, truth) in both.base.iter().zip(&truth) {
        assert!((b.value - truth).abs() < 4.0 * b.std, "{} {} ± {} {truth}", b.name, b.value, b.std);
    }
    let smaller = both.base.iter().filter(|b| one.base.iter().any(|o| o.name == b.name && b.std < o.std)).count();
    assert!(smaller > both.base.len() / 2, "{smaller} of {}", both.base.len());
}

#[test]
fn what_effects_and_payload_add_stays_out_of_the_links() {
    let mut robot = common::model("irb360-6-1600");
    robot.effects.push(ActiveEffect::new(find("rotor_inertia").unwrap(), &[&[0.05; 3]]));
    let data = dataset(&robot, &common::payload(), 1500, 4e-3, excitation(3));
    let fitted = fit(&robot, &[data], &[SIGMA.to_vec()]).unwrap();
    // The data are the model's own: its links come back as they were, also in what no torque shows.
    for (b, (found, before)) in
        fitted.model.bodies.0.iter().zip(&robot.bodies.0).enumerate().filter(|(b, _)| *b != ROTOR)
    {
        let apart = (found.pseudo_inertia() - before.pseudo_inertia()).norm();
        assert!(apart < 1e-6, "body {b}: {apart:e}");
    }
}

#[test]
fn recordings_of_unlike_configurations_or_channels_are_not_used_together() {
    let nominal = common::model("irb360-6-1600");
    let whole = dataset(&nominal, &Setup::default(), 300, 4e-3, excitation(3));
    let apart = Setup { configuration: Configuration::Disassembled, ..Setup::default() };
    let apart = Dataset { name: "apart".into(), ..dataset(&nominal, &apart, 300, 4e-3, excitation(3)) };
    let mut fewer = Dataset { name: "fewer".into(), ..whole.clone() };
    fewer.restrict(&Channel::TORQUES[..3]);
    for (other, difference) in [(apart, "expected one configuration"), (fewer, "tau4 only in made")] {
        let (fitted, held_out) = (std::slice::from_ref(&whole), std::slice::from_ref(&other));
        let refusals = [
            diagnose(&nominal, fitted, held_out, &mut |_| {}).err().map(|e| e.to_string()),
            add(&nominal, "air_drag", fitted, held_out).err().map(|e| e.to_string()),
            compare(&nominal, fitted, held_out).err().map(|e| e.to_string()),
            fit(&nominal, &[whole.clone(), other.clone()], &vec![SIGMA.to_vec(); 2]).err().map(|e| e.to_string()),
        ];
        for refusal in refusals {
            let refusal = refusal.unwrap();
            assert!(refusal.contains(difference) && refusal.contains(&other.name), "{refusal}");
        }
    }
}
