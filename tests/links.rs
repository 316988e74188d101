//! Parameters of the links with and without the paper's assumptions: how many there are, and how many data determine.

use crate::common;

use deltatwin::dynamics::Plant;
use deltatwin::effects::{ActiveEffect, find};
use deltatwin::identification::fit::{Fit, Options, fit_with};
use deltatwin::identification::regularisation::GroupWeight;
use deltatwin::identification::{Dataset, predict};
use deltatwin::kinematics::{BodyMotion, JointState, Motion};
use deltatwin::machine::bodies::{self, ARM};
use deltatwin::machine::{BodyParameters, Inertia, LinkParameters, Setup, six_struts};
use deltatwin::model::Model;
use deltatwin::recording::Channel;
use deltatwin::scenario::{FourierMotion, MotionLimits};
use deltatwin_io::model;
use nalgebra::DMatrix;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::StandardNormal;

const SIGMA: [f64; 4] = [0.4, 0.4, 0.4, 0.05];

/// Torques of `robot` along an excitation that is known exactly, with noise of `share` of `SIGMA`.
fn dataset(robot: &Model, share: f64, samples: usize) -> Dataset {
    let step = 10.0 / samples as f64;
    let nominal = common::model("irb360-6-1600");
    let believed = Plant::new(&nominal, &Setup::default());
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let motion = FourierMotion::random(&believed, &MotionLimits::of(&nominal, 0.6), 0.1, 10, &mut rng);
    let at = |t: f64| believed.geometry.inverse_motion(&motion.at(t)).expect("within the workspace");
    let joints = (0..samples).map(|k| at(k as f64 * step)).collect();
    let exact = Dataset::exact(robot.mechanism, Setup::default(), Channel::TORQUES.to_vec(), step, joints);
    let mut dataset = Dataset { half_width: [10; 4], ..exact };
    dataset.set_measured(predict(&Plant::new(robot, &Setup::default()), &dataset).expect("reachable"));
    for (series, sigma) in dataset.measured.iter_mut().zip(SIGMA) {
        series.iter_mut().for_each(|x| *x += share * sigma * rng.sample::<f64, _>(StandardNormal));
    }
    dataset
}

fn links(each_limb: bool, bodies: BodyParameters) -> LinkParameters {
    LinkParameters { each_limb, bodies }
}

fn fitted(links: LinkParameters, data: &Dataset, options: &Options) -> Fit {
    let model = Model { link_parameters: links, ..common::model("irb360-6-1600") };
    fit_with(&model, std::slice::from_ref(data), &[SIGMA.to_vec()], options).expect("a fit")
}

/// A model of the links alone, with or without the end effector's first moments across its axis.
fn alone(links: LinkParameters, flange: bool) -> Model {
    let mut model = Model { link_parameters: links, ..common::model("irb360-6-1600") };
    model.effects.clear();
    if flange {
        model.effects.push(ActiveEffect::absent(find("payload_com_offset").expect("registered")));
    }
    model
}

/// Rank of the torques' regressor.
fn rank_of_torques(model: &Model, data: &Dataset) -> usize {
    fit_with(model, std::slice::from_ref(data), &[SIGMA.to_vec()], &Options::default()).expect("a fit").structure.rank
}

/// Lagrangian of an inertia on a body.
fn lagrangian(inertia: &Inertia, body: &BodyMotion, gravity: f64) -> f64 {
    let moment = body.rotation * inertia.first_moment;
    let omega = body.rotation.tr_mul(&body.angular_velocity);
    let kinetic = 0.5 * inertia.mass * body.velocity.norm_squared()
        + body.velocity.dot(&body.angular_velocity.cross(&moment))
        + 0.5 * omega.dot(&(inertia.tensor * omega));
    kinetic - gravity * (inertia.mass * body.position.z + moment.z)
}

/// Turns the struts with their frames, whose y axis stays in the plane of strut and pair: ω = w × ẇ + (ẏ·z)·w.
fn turn_struts(motion: &mut Motion) {
    for strut in six_struts() {
        let v = motion.shaft[strut / 2];
        let body = &mut motion.bodies[bodies::strut(strut)];
        let [w, y, z] = [0, 1, 2].map(|k| body.rotation.column(k).into_owned());
        let w_rate = body.angular_velocity.cross(&w);
        // y = n/|n| with n = v − w(w·v), and n·z = 0.
        let n_rate = -w_rate * w.dot(&v) - w * w_rate.dot(&v);
        let across = (v - w * w.dot(&v)).norm();
        assert!(y.dot(&n_rate).is_finite() && across > 0.1);
        body.angular_velocity += w * (n_rate.dot(&z) / across);
    }
}

/// Number of parameters' combinations that equations of motion hold: Lagrange's equations of L = Σ p_j·L_j vanish for a
/// constant L alone, since every L_j is quadratic in the rates.
fn rank_of_lagrangians(model: &Model, data: &Dataset, turning: bool) -> usize {
    let plant = Plant::new(model, &Setup::default());
    let effects: Vec<ActiveEffect> = std::iter::once(plant.rigid_bodies()).chain(plant.effects.clone()).collect();
    let columns: usize = effects.iter().map(|a| a.values.len()).sum();
    let states: Vec<&JointState> = data.joints.iter().step_by(5).collect();
    let mut of = DMatrix::zeros(states.len(), columns + 1);
    for (row, joints) in states.into_iter().enumerate() {
        let mut motion = plant.motion(joints).expect("reachable");
        if turning {
            turn_struts(&mut motion);
        }
        let mut first = 0;
        for active in &effects {
            let values = active.values();
            active.effect.inertia(&values, &plant.payload, &mut |k, body, unit| {
                of[(row, first + k)] += lagrangian(&unit, &motion.bodies[body], plant.gravity);
            });
            first += active.values.len();
        }
        of[(row, columns)] = 1.0;
    }
    for mut column in of.column_iter_mut() {
        // Of what does not move there is rounding.
        let norm = column.norm();
        column *= if norm > 1e-12 { 1.0 / norm } else { 0.0 };
    }
    // From 7e-3 to 4e-16 of the largest there is none.
    let singular = of.singular_values();
    singular.iter().filter(|s| **s > 1e-9 * singular.amax()).count() - 1
}

/// Numbers of parameters and of their combinations: 51 and 37 in the paper (section 6.3.3).
#[test]
fn the_papers_counts() {
    use BodyParameters::{Aligned, Complete, Symmetric};
    // The 18 without the masses that do not enter, with the height of the platform's centre of mass, which strut forces show.
    // Then combinations: with struts that turn with their frames, as the paper's, and with those that do not, as here.
    let cases = [
        (links(false, Symmetric), 17, 11, 10),
        (links(true, Symmetric), 31, 21, 18),
        (links(false, Aligned), 2 * 7 + 3 * 7 + 1, 19, 18),
        (links(true, Aligned), 3 * 14 + 3 * 7 + 1, 35, 32),
        (links(false, Complete), 51, 25, 22),
        (links(true, Complete), 3 * 20 + 3 * 10 + 1, 47, 38),
    ];
    let data = dataset(&alone(links(false, Symmetric), false), 0.0, 500);
    for (links, numbers, turning, still) in cases {
        let [bare, with] = [false, true].map(|flange| alone(links, flange));
        assert_eq!(Plant::new(&bare, &Setup::default()).parameters().len(), numbers, "{links:?}");
        // The end effector adds its two first moments across its axis.
        for (model, more) in [(&bare, 0), (&with, 2)] {
            assert_eq!(rank_of_lagrangians(model, &data, true), turning + more, "{links:?}");
            assert_eq!(rank_of_lagrangians(model, &data, false), still + more, "{links:?}");
        }
        // Frames of struts turn about them without an angular velocity: struts without symmetry are not quite rigid.
        if links.bodies != Complete {
            assert_eq!(rank_of_torques(&bare, &data), still, "{links:?}");
            assert_eq!(rank_of_torques(&with, &data), still + 2, "{links:?}");
        }
    }
}

#[test]
fn limbs_that_differ_are_found() {
    let mut robot = common::model("irb360-6-1600");
    robot.bodies[bodies::arm(1)] += Inertia::diagonal(0.0, [0.02, 0.0, 0.0], [0.0, 0.02, 0.02]);
    for strut in [bodies::strut(4), bodies::strut(5)] {
        robot.bodies[strut] += Inertia::diagonal(0.161, [0.089, 0.0, 0.0], [0.0, 0.066, 0.066]);
    }
    let data = dataset(&robot, 1.0, 2000);
    let alike = fitted(links(false, BodyParameters::Symmetric), &data, &Options::default());
    let each = fitted(links(true, BodyParameters::Symmetric), &data, &Options::default());
    println!("RMS alike {:?}, each limb {:?}", alike.residuals.rms, each.residuals.rms);
    assert!(alike.residuals.rms[..3].iter().any(|r| *r > 1.2 * SIGMA[0]), "{:?}", alike.residuals.rms);
    // Four standard errors of the RMS of 2000 samples.
    for (rms, sigma) in each.residuals.rms.iter().zip(SIGMA) {
        assert!(*rms < 1.065 * sigma, "{rms} {sigma}");
    }
    let truth = Model { link_parameters: links(true, BodyParameters::Symmetric), ..robot };
    let parameters = Plant::new(&truth, &Setup::default()).parameters();
    let value = |name: &str| parameters.iter().find(|p| p.name == name).expect("a parameter").value;
    for b in &each.base {
        let truth = value(&b.name) + b.others.iter().map(|(n, f)| f * value(n)).sum::<f64>();
        assert!((b.value - truth).abs() < 4.5 * b.std, "{}: {} ± {}, truth {truth}", b.name, b.value, b.std);
    }
    // What is written is read again, each limb with its own bodies.
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("each.toml");
    deltatwin_io::model::write(&each.model, &file).unwrap();
    let read = model::read(&file).unwrap();
    for strut in six_struts() {
        let (a, b) = (read.bodies[bodies::strut(strut)], each.model.bodies[bodies::strut(strut)]);
        assert!((a.pseudo_inertia() - b.pseudo_inertia()).norm() < 1e-9, "strut {}", strut + 1);
    }
    assert!((read.bodies[ARM].first_moment - read.bodies[bodies::arm(1)].first_moment).norm() > 1e-3);
}

#[test]
#[ignore = "campaign"]
fn bodies_with_more_parameters_stay_possible() {
    let data = dataset(&common::model("irb360-6-1600"), 1.0, 2000);
    for bodies in [BodyParameters::Aligned, BodyParameters::Complete] {
        let fit = fitted(links(false, bodies), &data, &Options::default());
        for (b, body) in fit.model.bodies.0.iter().enumerate().filter(|(_, b)| **b != Inertia::ZERO) {
            assert!(body.min_eigenvalue() > 0.0, "{bodies:?}, body {b}: {:e}", body.min_eigenvalue());
        }
        for (rms, sigma) in fit.residuals.rms.iter().zip(SIGMA) {
            assert!(*rms < 1.065 * sigma, "{bodies:?}: {rms} {sigma}");
        }
        println!("{bodies:?}: {:?}", fit.correction);
        if let Some(c) = fit.correction {
            assert!(c.gap.is_none_or(|gap| gap < 1e-3), "{bodies:?}: {c:?}");
        }
    }
}

#[test]
fn a_group_has_its_own_weight() {
    let data = dataset(&common::model("irb360-6-1600"), 1.0, 2000);
    let mut believed = common::model("irb360-6-1600");
    for active in &mut believed.effects {
        active.values.iter_mut().for_each(|v| *v *= 1.1);
    }
    let drive = |weights: &[GroupWeight]| {
        let options = Options { prior: Some(&believed), weights, ..Options::default() };
        let fit = fitted(links(false, BodyParameters::Symmetric), &data, &options);
        let of = |name: &str| fit.parameters.iter().find(|p| p.name == name).expect("a parameter").value;
        (of("drive_friction.viscous_1"), of("rigid_bodies.arm_inertia_yy"))
    };
    let weight = |group: &str, weight: f64| GroupWeight { group: group.into(), weight };
    let prior = 1.1 * drive(&[weight("bodies", 1e-2)]).0;
    let (plain, inertia) = drive(&[]);
    // A weight beyond all data holds friction at its regularisation value and leaves the links.
    let (fixed, still) = drive(&[weight("friction", 1e9)]);
    let named = |name: &str| {
        let parameters = Plant::new(&believed, &Setup::default()).parameters();
        parameters.iter().find(|p| p.name == name).expect("a parameter").value
    };
    assert!((fixed - named("drive_friction.viscous_1")).abs() < 1e-4, "{fixed} {prior}");
    assert!(
        (plain - fixed).abs() > 0.05 * fixed && (inertia - still).abs() < 0.05 * inertia,
        "{plain} {inertia} {still}"
    );
    // Only ratios count: γ_τ = n_s is the plain sum, and a thousandth of it makes every prior a thousand times stronger.
    let samples = data.len() as f64;
    assert!((drive(&[weight("torque", samples)]).0 - plain).abs() < 1e-12);
    let (ratio, other) =
        (drive(&[weight("torque", 1e-3 * samples)]).0, drive(&[weight("bodies", 10.0), weight("friction", 10.0)]).0);
    assert!((ratio - other).abs() < 1e-9 && (ratio - plain).abs() > 1e-9, "{ratio} {other} {plain}");
    let model = common::model("irb360-6-1600");
    let options = Options { weights: &[weight("gripper", 1.0)], ..Options::default() };
    let error = fit_with(&model, &[data], &[SIGMA.to_vec()], &options).map(drop).unwrap_err().to_string();
    assert!(error.contains("\"gripper\"") && error.contains("telescope_friction"), "{error}");
}
