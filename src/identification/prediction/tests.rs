use super::states::exponential_heun;
use super::*;
use crate::dynamics::inverse_dynamics;
use crate::effects::Role;
use crate::effects::find;
use crate::identification::dataset::Between;
use crate::machine::{Configuration, Setup};
use crate::model::testing::irb360;
use crate::recording::Channel;

const DT: f64 = 4e-4;

fn dataset(joints: Vec<JointState>, setup: Setup) -> Dataset {
    Dataset::exact(Default::default(), setup, Channel::TORQUES.to_vec(), DT, joints)
}

/// Arms and rotor of the shipped robot, disassembled and without friction.
fn arms(name: &str, blocks: &[&[f64]]) -> (Plant, Setup) {
    let mut model = irb360();
    model.effects = vec![ActiveEffect::new(find(name).unwrap(), blocks)].into();
    let setup = Setup { configuration: Configuration::Disassembled, ..Setup::default() };
    (Plant::new(&model, &setup), setup)
}

fn rms(x: impl Iterator<Item = f64>) -> f64 {
    let squares: Vec<f64> = x.map(|x| x * x).collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

#[test]
fn steep_hysteresis_follows_the_closed_form_at_every_angle() {
    // q = ½(1 − cos 20t): 10 rad/s, so λ·h reaches −10·4e-4/4.4e-4 = −9, where Heun's method diverges.
    // A reversal between two samples is known to q̈·h²/4 = 8e-6 rad only, which causes an error of z of at most
    // 8e-6/δ.
    for angle in [4.4e-5, 4.4e-4, 0.02] {
        let at = |t: f64| JointState {
            q: [0.5 * (1.0 - (20.0 * t).cos()); 4],
            qd: [10.0 * (20.0 * t).sin(); 4],
            qdd: [200.0 * (20.0 * t).cos(); 4],
        };
        let (plant, setup) = arms("backlash_hysteresis", &[&[1.0; 3], &[angle]]);
        let dataset = dataset((0..2500).map(|k| at(f64::from(k) * DT)).collect(), setup);
        let joints = joints(&plant, &dataset).unwrap();
        let states = InternalStates::along(&plant, &[&plant.effects[0]], &dataset, &joints).unwrap();
        // z = s − (s − z_r)·exp(−|q − q_r|/δ) since the last reversal r.
        let half_period = std::f64::consts::PI / 20.0;
        let mut worst = 0f64;
        let (mut reversed, mut leg) = (0.0, 0);
        for k in 0..dataset.len() {
            let own = states.of(k, 0);
            let now = (dataset.t[k] / half_period) as usize;
            while leg < now {
                let sign = if leg % 2 == 0 { 1.0 } else { -1.0 };
                reversed = sign - (sign - reversed) * (-1.0 / angle).exp();
                leg += 1;
            }
            let sign = if leg % 2 == 0 { 1.0 } else { -1.0 };
            let travelled = (dataset.joints[k].q[0] - (leg % 2) as f64).abs();
            let exact = sign - (sign - reversed) * (-travelled / angle).exp();
            worst = worst.max((own[0] - exact).abs());
            assert!(own[0].abs() < 1.0 + 1e-3);
        }
        println!("δ = {angle} rad: {worst:.1e}");
        assert!(worst < 8.1e-6 / angle, "δ = {angle}: {worst:e}");
    }
}

#[test]
fn steps_are_exact_for_linear_laws_and_of_second_order_else() {
    // ẋ = −500·(x − 2): one step of 0.1 s from 0 gives 2·(1 − e⁻⁵⁰).
    let x = exponential_heun(&[0.0], 0.1, |_, x| (vec![-500.0 * (x[0] - 2.0)], vec![-500.0]));
    approx::assert_relative_eq!(x[0], 2.0, epsilon = 1e-14);
    // ẋ = −x², x(0) = 1: x(1) = ½. Halving the step quarters the error, even with half the true slope.
    let error = |steps: u32, share: f64| {
        let h = 1.0 / f64::from(steps);
        let law = |_: bool, x: &[f64]| (vec![-x[0] * x[0]], vec![-2.0 * share * x[0]]);
        let mut x = vec![1.0];
        for _ in 0..steps {
            x = exponential_heun(&x, h, law);
        }
        (x[0] - 0.5).abs()
    };
    for share in [0.0, 0.5, 1.0] {
        let ratio = error(100, share) / error(200, share);
        assert!((3.8..4.2).contains(&ratio), "{ratio} at {share}");
    }
}

#[test]
fn encoder_offset_is_taken_off_the_recorded_angles() {
    let (shifted, setup) = arms("joint_zero_offset", &[&[0.01, -0.02, 0.0, 0.0]]);
    let (plain, _) = arms("joint_zero_offset", &[&[0.0; 4]]);
    let at = |q: [f64; 4]| JointState { q, qd: [1.0; 4], qdd: [2.0; 4] };
    let read = predict(&shifted, &dataset(vec![at([0.51, 0.38, 0.3, 0.0]); 10], setup)).unwrap();
    let truth = predict(&plain, &dataset(vec![at([0.5, 0.4, 0.3, 0.0]); 10], setup)).unwrap();
    for (a, b) in read.iter().flatten().zip(truth.iter().flatten()) {
        approx::assert_relative_eq!(a, b, epsilon = 1e-12);
    }
}

/// Arms on waves up to 4 Hz, `n` samples.
fn waves(n: usize) -> Vec<JointState> {
    let at = |t: f64| JointState {
        q: [0.4 * (9.0 * t).sin(), 0.3 * (17.0 * t).sin(), 0.2 * (25.0 * t).sin(), 0.0],
        qd: [3.6 * (9.0 * t).cos(), 5.1 * (17.0 * t).cos(), 5.0 * (25.0 * t).cos(), 0.0],
        qdd: [-32.4 * (9.0 * t).sin(), -86.7 * (17.0 * t).sin(), -125.0 * (25.0 * t).sin(), 0.0],
    };
    (0..n).map(|k| at(k as f64 * DT)).collect()
}

/// q̈ = 2·(1 + e′) + e″·1² with e = 1 mrad·sin 33θ at 33θ = 90°: 2 − 1.089; the angle is 1 mrad ahead.
#[test]
fn an_uneven_gear_moves_the_joint_by_its_curvature() {
    let zero = [0.0; 3];
    let (uneven, setup) = arms("transmission_error", &[&[1e-3; 3], &zero, &zero, &zero, &[33.0]]);
    let quarter = std::f64::consts::FRAC_PI_2 / 33.0;
    let at = |q: f64, qdd: f64| JointState { q: [q; 4], qd: [1.0; 4], qdd: [qdd; 4] };
    let read = predict(&uneven, &dataset(vec![at(quarter, 2.0); 10], setup)).unwrap();
    let (plain, _) = arms("joint_zero_offset", &[&[0.0; 4]]);
    let truth = predict(&plain, &dataset(vec![at(quarter + 1e-3, 2.0 - 1.089); 10], setup)).unwrap();
    for (a, b) in read[..3].iter().flatten().zip(truth[..3].iter().flatten()) {
        approx::assert_relative_eq!(a, b, epsilon = 1e-12);
    }
}

/// Predictions in pieces reach back as far as the filter remembers: 5 ms in samples of 0.4 ms.
#[test]
fn a_filter_is_the_same_in_pieces() {
    for time_constant in [0.005, 0.05] {
        let (filtered, setup) = arms("torque_filter", &[&[time_constant]]);
        let whole = dataset(waves(3 * chunk(&filtered)), setup);
        let pieces = predict(&filtered, &whole).unwrap();
        let at_once = predict_along(&filtered, &whole, &joints(&filtered, &whole).unwrap()).unwrap();
        for (a, b) in pieces.iter().flatten().zip(at_once.iter().flatten()) {
            approx::assert_relative_eq!(a, b, epsilon = 1e-11);
        }
    }
}

/// Columns of the links seen through a sensor are differences of the prediction, also where it is no straight line.
#[test]
fn columns_pass_through_the_sensors() {
    for (name, blocks) in [("torque_saturation", &[&[1e-4; 3][..]][..]), ("torque_filter", &[&[0.004]])] {
        let (plant, setup) = arms(name, blocks);
        let dataset = dataset(waves(500), setup);
        let columns = columns(&plant, &dataset, None).unwrap();
        let step = 1e-4;
        let moved = |way: f64| {
            let mut moved = plant.clone();
            for arm in 0..3 {
                moved.links[arm].tensor[(1, 1)] += way * step;
            }
            moved.sum_inertia();
            predict(&moved, &dataset).unwrap()
        };
        let (more, less) = (moved(1.0), moved(-1.0));
        let inertia: Vec<usize> = (0..columns.len())
            .filter(|&i| plant.parameters().get(i).is_some_and(|p| p.name.contains("arm_inertia_yy")))
            .collect();
        assert!(!inertia.is_empty(), "{name}");
        for c in 0..3 {
            for k in 0..dataset.len() {
                let wanted = (more[c][k] - less[c][k]) / (2.0 * step);
                let found: f64 = inertia.iter().map(|&i| columns[i][c][k]).sum();
                assert!((found - wanted).abs() < 1e-3 * (1.0 + wanted.abs()), "{name} {c} {k}: {found} {wanted}");
            }
        }
    }
}

/// Encoder angle and torque of one arm behind an elastic gear, driven by a controller on the motor side.
///
/// `friction` acts on the rotor.
fn elastic_arm(
    plant: &Plant,
    compliance: f64,
    damping: f64,
    rotor: f64,
    friction: fn(f64) -> f64,
) -> (Vec<JointState>, Vec<f64>) {
    let rigid = |q: f64, qdd: f64| {
        let joints = JointState { q: [q, 0.0, 0.0, 0.0], qd: [0.0; 4], qdd: [qdd, 0.0, 0.0, 0.0] };
        let motion = plant.motion(&joints).unwrap();
        inverse_dynamics(plant, 0.0, &motion, &[&[]], false).unwrap().tau[0]
    };
    let inertia = rigid(0.0, 1.0) - rigid(0.0, 0.0) - rotor;
    let wanted = |t: f64| {
        let waves = [(0.20, 9.0), (0.05, 21.0), (0.02, 33.0)];
        // The motion is faded in over half a second to avoid ringing.
        let fade = 1.0 - (-(t / 0.25).powi(4)).exp();
        0.5 + fade * waves.iter().map(|(a, w)| a * (w * t).sin()).sum::<f64>()
    };
    let torque = |t: f64, x: &[f64; 4]| {
        let h = 1e-5;
        let rate = (wanted(t + h) - wanted(t - h)) / (2.0 * h);
        let acceleration = (wanted(t + h) - 2.0 * wanted(t) + wanted(t - h)) / (h * h);
        let feed = rigid(wanted(t), acceleration);
        feed + 60.0 * (wanted(t) - x[0] - x[2]) + 8.0 * (rate - x[1] - x[3])
    };
    // x = (q, q̇, δ, δ̇)
    let law = |t: f64, x: &[f64; 4]| {
        let transmitted = x[2] / compliance + damping * x[3];
        let arm = (transmitted - rigid(x[0], 0.0)) / inertia;
        [x[1], arm, x[3], (torque(t, x) + friction(x[1] + x[3]) - transmitted) / rotor - arm]
    };
    let moved = |x: &[f64; 4], d: &[f64; 4], h: f64| std::array::from_fn(|i| x[i] + h * d[i]);
    let start = compliance * rigid(0.5, 0.0);
    let mut x = [0.5 - start, 0.0, start, 0.0];
    let (mut joints, mut torques) = (Vec::new(), Vec::new());
    for k in 0..7500 {
        let t = f64::from(k) * DT;
        let d = law(t, &x);
        joints.push(JointState {
            q: [x[0] + x[2], 0.0, 0.0, 0.0],
            qd: [x[1] + x[3], 0.0, 0.0, 0.0],
            qdd: [d[1] + d[3], 0.0, 0.0, 0.0],
        });
        torques.push(torque(t, &x));
        for s in 0..4 {
            let (h, t) = (DT / 4.0, t + f64::from(s) * DT / 4.0);
            let a = law(t, &x);
            let b = law(t + 0.5 * h, &moved(&x, &a, 0.5 * h));
            let c = law(t + 0.5 * h, &moved(&x, &b, 0.5 * h));
            let d = law(t + h, &moved(&x, &c, h));
            x = std::array::from_fn(|i| x[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]));
        }
    }
    (joints, torques)
}

#[test]
fn elastic_drive_is_seen_through_the_encoder_and_its_compliance_comes_back() {
    const COMPLIANCE: f64 = 1.5e-4;
    let with = |c: f64| arms("drive_elasticity", &[&[c, 0.0, 0.0], &[20.0], &[0.18], &[0.0]]);
    let (rigid, setup) = with(0.0);
    let (joints, torque) = elastic_arm(&rigid, COMPLIANCE, 20.0, 0.18, |_| 0.0);
    let dataset = dataset(joints, setup);
    let inside = 100..torque.len() - 100;
    let residual = |plant: &Plant| -> Vec<f64> {
        let predicted = predict(plant, &dataset).unwrap();
        inside.clone().map(|k| torque[k] - predicted[0][k]).collect()
    };
    let size = |plant: &Plant| rms(residual(plant).into_iter());
    let (before, after) = (size(&rigid), size(&with(COMPLIANCE).0));
    assert!(after < 1e-3 * before, "{before} {after}");
    // One Gauss–Newton step from two thirds of it.
    let (near, _) = with(COMPLIANCE / 1.5);
    let left = residual(&near);
    let column = &columns(&near, &dataset, None).unwrap()[near.rigid_bodies().values.len()][0][inside.clone()];
    let product: f64 = column.iter().zip(&left).map(|(c, r)| c * r).sum();
    let estimate = COMPLIANCE / 1.5 + product / column.iter().map(|c| c * c).sum::<f64>();
    println!("rigid {before:.4} N·m, elastic {after:.1e} N·m, compliance {estimate:.4e}");
    assert!((estimate / COMPLIANCE - 1.0).abs() < 0.02, "{estimate:e}");
}

/// Friction on the rotor, whose sign changes excite ringing of gear and arm, in the torque of the drive.
#[test]
fn friction_on_the_motors_side_is_seen_through_the_gear() {
    const COMPLIANCE: f64 = 4e-5;
    let (bare, setup) = arms("drive_elasticity", &[&[0.0; 3], &[20.0], &[0.18], &[1.0]]);
    let (joints, torque) = elastic_arm(&bare, COMPLIANCE, 20.0, 0.18, |rate| -5.0 * (100.0 * rate).tanh() - 2.0 * rate);
    let dataset = dataset(joints, setup);
    let left = |compliance: f64, at_motor: f64| {
        let mut model = irb360();
        let elastic: [&[f64]; 4] = [&[compliance, 0.0, 0.0], &[20.0], &[0.18], &[at_motor]];
        let friction: [&[f64]; 3] = [&[5.0, 0.0, 0.0], &[2.0, 0.0, 0.0], &[100.0]];
        model.effects = vec![
            ActiveEffect::new(find("drive_friction").unwrap(), &friction),
            ActiveEffect::new(find("drive_elasticity").unwrap(), &elastic),
        ]
        .into();
        let predicted = predict(&Plant::new(&model, &setup), &dataset).unwrap();
        rms((100..torque.len() - 100).map(|k| torque[k] - predicted[0][k]))
    };
    let (right, wrong, rigid) = (left(COMPLIANCE, 1.0), left(COMPLIANCE, 0.0), left(0.0, 0.0));
    println!("motor's side {right:.1e} N·m, arm's side {wrong:.1e}, rigid {rigid:.1e}");
    assert!(right < 0.05 && right < 0.05 * wrong && right < 0.05 * rigid, "{right} {wrong} {rigid}");
}

/// Derivatives through elastic gears against finite differences of predictions.
#[test]
fn columns_pass_through_the_gears() {
    for at_motor in [0.0, 1.0] {
        columns_pass_through_gears_with_friction(at_motor);
    }
}

fn columns_pass_through_gears_with_friction(at_motor: f64) {
    let mut elastic = irb360();
    elastic.effects.push(ActiveEffect::new(
        find("drive_elasticity").unwrap(),
        &[&[3e-5, 4e-5, 6e-5], &[20.0], &[0.18], &[at_motor]],
    ));
    let at = |k: usize| {
        let t = k as f64 * DT;
        let wave = |i: usize| (0.2 + 0.05 * i as f64, 11.0 + 3.0 * i as f64);
        JointState {
            q: std::array::from_fn(|i| 0.2 + wave(i).0 * (wave(i).1 * t).sin()),
            qd: std::array::from_fn(|i| wave(i).0 * wave(i).1 * (wave(i).1 * t).cos()),
            qdd: std::array::from_fn(|i| -wave(i).0 * wave(i).1.powi(2) * (wave(i).1 * t).sin()),
        }
    };
    let mut dataset = dataset((0..1500).map(at).collect(), Setup::default());
    dataset.channels.push(Channel::StrutUpper(2));
    dataset.measured.push(vec![0.0; 1500].into());
    let plant = Plant::new(&elastic, &dataset.setup);
    let analytic = columns(&plant, &dataset, None).unwrap();
    let values: Vec<f64> = plant.parameters().iter().map(|p| p.value).collect();
    let moved = |k: usize, step: f64| {
        let mut there = values.clone();
        there[k] += step;
        let mut model = elastic.clone();
        crate::dynamics::set_parameters(&mut model, &there);
        predict(&Plant::new(&model, &dataset.setup), &dataset).unwrap()
    };
    let mut wrong = Vec::new();
    for (k, p) in plant.parameters().iter().enumerate().filter(|(_, p)| p.role == Role::Linear) {
        let step = 1e-4 * p.usual.abs().max(1e-3 * p.value.abs()).max(1e-9);
        let (ahead, behind) = (moved(k, step), moved(k, -step));
        let slope = |(a, b): (&f64, &f64)| (a - b) / (2.0 * step);
        let differences: Vec<Vec<f64>> =
            ahead.iter().zip(&behind).map(|(a, b)| a.iter().zip(b).map(slope).collect()).collect();
        let size = differences.iter().map(|d| rms(d.iter().copied())).fold(0.0, f64::max);
        for (c, (column, difference)) in analytic[k].iter().zip(&differences).enumerate() {
            let error = rms(column.iter().zip(difference).map(|(x, y)| x - y));
            if error > 2e-2 * size + 1e-12 {
                wrong.push(format!("{} on {c}: {error:e} of {size:e}", p.name));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn a_frame_of_25_hz_is_followed_at_any_sampling_rate() {
    // Waves up to 6.4 Hz, in full swing from the start. Straight lines between the samples of the inertial force leave
    // (Ω·h)²/12 of its waves: at 4 ms 2.1e-3 of the fastest, at 400 µs a hundredth of that. A general method of second
    // order would miss the mode itself, with ω·h = 0.63.
    let mut model = irb360();
    let blocks: [&[f64]; 3] = [&[2.5e-3; 2], &[25.0, 21.0], &[0.02, 0.05]];
    model.effects = vec![ActiveEffect::new(find("frame_compliance").unwrap(), &blocks)].into();
    let setup = Setup::default();
    let plant = Plant::new(&model, &setup);
    let at = |t: f64| {
        let wave = |i: usize, w: f64| (0.01 + 0.004 * i as f64, w * (1.0 - 0.15 * i as f64));
        let both = |i: usize| [wave(i, 40.0), wave(2 - i.min(2), 13.0)];
        JointState {
            q: std::array::from_fn(|i| 0.3 + both(i).iter().map(|(a, w)| a * (w * t).sin()).sum::<f64>()),
            qd: std::array::from_fn(|i| both(i).iter().map(|(a, w)| a * w * (w * t).cos()).sum::<f64>()),
            qdd: std::array::from_fn(|i| both(i).iter().map(|(a, w)| -a * w * w * (w * t).sin()).sum::<f64>()),
        }
    };
    let states = |h: f64| {
        let n = (2.0 / h).round() as usize + 1;
        let mut dataset = dataset((0..n).map(|k| at(k as f64 * h)).collect(), setup);
        dataset.t = (0..n).map(|k| k as f64 * h).collect();
        dataset.dt = h;
        let joints = joints(&plant, &dataset).unwrap();
        let own = InternalStates::along(&plant, &[&plant.effects[0]], &dataset, &joints).unwrap();
        let every = (4e-3 / h).round() as usize;
        (0..n).step_by(every).map(|k| own.of(k, 0).to_vec()).collect::<Vec<_>>()
    };
    let exact = states(4e-5);
    for (h, allowed) in [(4e-4, 3e-5), (4e-3, 3e-3)] {
        let seen = states(h);
        for i in 0..4 {
            let size = rms(exact.iter().map(|x| x[i]));
            let error = rms(seen.iter().zip(&exact).map(|(x, e)| x[i] - e[i])) / size;
            println!("{h} s, state {i}: {error:.1e}");
            assert!(size > 0.0 && error < allowed, "{h} s, state {i}: {error:e}");
        }
    }
}

/// Kept columns give the same predictions and columns, for the model that they were computed with, for others with the same laws,
/// and for effects that change the motion, for which they do not hold.
#[test]
fn kept_columns_change_nothing() {
    let at = |k: usize| {
        let wave = |i: usize, n: i32| (9.0 + 2.0 * i as f64).powi(n) * 0.3;
        let phase = |i: usize| (9.0 + 2.0 * i as f64) * k as f64 * DT;
        JointState {
            q: std::array::from_fn(|i| wave(i, 0) * phase(i).sin()),
            qd: std::array::from_fn(|i| wave(i, 1) * phase(i).cos()),
            qdd: std::array::from_fn(|i| -wave(i, 2) * phase(i).sin()),
        }
    };
    let setup = Setup { payload: crate::machine::Payload::new(1.5, [0.01, 0.0, -0.05], 0.01), ..Setup::default() };
    let dataset = dataset((0..1500).map(at).collect(), setup);
    let kept = KeptColumns::new(&dataset);
    let effects: [&[&str]; 5] = [
        &[],
        &["drive_stribeck"],
        &["base_tilt", "signal_delay"],
        &["joint_zero_offset"],
        &["ball_socket_load_dependent", "torque_gain_error"],
    ];
    for (k, added) in effects.iter().enumerate() {
        let mut model = irb360();
        model.bodies[0].tensor[(1, 1)] *= 1.0 + 0.1 * k as f64;
        for name in *added {
            model.effects.push(ActiveEffect::absent(find(name).unwrap()).at_nominal_size());
        }
        let plant = dataset.plant(&model);
        let laws = kept.laws(&plant).unwrap();
        let (with, columns) = prediction_and_columns(&plant, &dataset, laws.clone()).unwrap();
        let (without, expected) = prediction_and_columns(&plant, &dataset, Laws::default()).unwrap();
        let close = |a: &[Vec<f64>], b: &[Vec<f64>]| {
            let size = rms(b.iter().flatten().copied()).max(1e-9);
            let error = rms(a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| a - b));
            assert!(a.len() == b.len() && error < 1e-9 * size, "{added:?}: {error:e} of {size:e}");
        };
        close(&with, &without);
        close(&predict_knowing(&plant, &dataset, &laws).unwrap(), &without);
        assert_eq!(columns.len(), expected.len());
        columns.iter().zip(&expected).for_each(|(a, b)| close(a, b));
    }
}

/// `whole`, a single segment, without the samples of `range`, whose motion it keeps.
fn cut(whole: &Dataset, range: std::ops::Range<usize>) -> Dataset {
    let without = |k: &usize| !range.contains(k);
    let kept: Vec<usize> = (0..whole.len()).filter(without).collect();
    let motion = range.clone().map(|k| (whole.t[k], whole.joints[k])).collect();
    Dataset {
        t: kept.iter().map(|k| whole.t[*k]).collect(),
        joints: kept.iter().map(|k| whole.joints[*k]).collect(),
        measured: whole.measured.iter().map(|m| m.pieces(&[0..range.start, range.end..whole.len()])).collect(),
        segments: vec![0..range.start, range.start..kept.len()],
        between: vec![Between { before: range.start, motion }],
        ..whole.clone()
    }
}

/// RMS difference of the predicted torques of arm 1 to those of the whole motion after the cut, and RMS of what the effect adds
/// there.
fn error_after_a_cut(name: &str, blocks: &[&[f64]], none: &[&[f64]], setup: Setup) -> (f64, f64) {
    let range = 900..1100;
    let with = |blocks: &[&[f64]]| {
        let mut model = irb360();
        model.effects = vec![ActiveEffect::new(find(name).unwrap(), blocks)].into();
        Plant::new(&model, &setup)
    };
    let plant = with(blocks);
    let whole = dataset(waves(2000), setup);
    let pieces = cut(&whole, range.clone());
    let of = |plant: &Plant, dataset: &Dataset, from: usize| predict(plant, dataset).unwrap()[0][from..].to_vec();
    let (there, here) = (of(&plant, &whole, range.end), of(&plant, &pieces, range.start));
    let without = of(&with(none), &whole, range.end);
    let difference = |a: &[f64], b: &[f64]| rms(a.iter().zip(b).map(|(a, b)| a - b));
    (difference(&there, &here), difference(&there, &without))
}

/// In the 80 ms that are left out every axis reverses at most once; δ = 20 mrad.
#[test]
fn hysteresis_goes_on_where_samples_were_left_out() {
    let (error, size) =
        error_after_a_cut("backlash_hysteresis", &[&[2.0; 3], &[0.02]], &[&[0.0; 3], &[0.02]], Setup::default());
    println!("{error:.1e} N·m of {size:.2} N·m");
    assert!(error < 1e-12 && size > 0.5, "{error} {size}");
}

/// A filter of 10 ms, which begins a recording at rest, has been running where samples were left out. Up to 25 rad/s a torque
/// is linear over 2 ms to within (25·2e-3)²/8 = 3e-4 of it.
#[test]
fn a_filter_is_running_after_samples_that_were_left_out() {
    let (error, size) = error_after_a_cut("torque_filter", &[&[0.01]], &[&[0.0]], Setup::default());
    println!("{error:.1e} N·m of {size:.2} N·m");
    assert!(error < 1e-4 * size, "{error} {size}");
}

/// Pieces of 256 samples begin with a filter of 10 ms in the state of the run-up, which forgets its own start by e⁻¹⁰.
#[test]
fn a_filter_is_running_at_the_start_of_pieces() {
    let mut model = irb360();
    model.effects = vec![ActiveEffect::new(find("torque_filter").unwrap(), &[&[0.01]])].into();
    let plant = Plant::new(&model, &Setup::default());
    let whole = dataset(waves(4000), Setup::default());
    let pieces = whole.sparse(256, 3);
    let (there, here) = (predict(&plant, &whole).unwrap(), predict(&plant, &pieces).unwrap());
    let place = |k: usize| (pieces.t[k] / DT).round() as usize;
    let error = rms((0..pieces.len()).map(|k| here[0][k] - there[0][place(k)]));
    let size = rms(there[0].iter().copied());
    println!("{error:.1e} N·m of {size:.2} N·m");
    assert!(pieces.len() > 1200 && error < 1e-4 * size, "{error} {size}");
}

/// The first step after samples that were left out is one sampling period.
#[test]
fn an_elastic_gear_does_not_swing_after_samples_that_were_left_out() {
    let elastic: [&[f64]; 4] = [&[1e-4; 3], &[20.0], &[0.18], &[0.0]];
    let rigid: [&[f64]; 4] = [&[0.0; 3], &[20.0], &[0.18], &[0.0]];
    let (error, size) = error_after_a_cut("drive_elasticity", &elastic, &rigid, Setup::default());
    println!("{error:.1e} N·m of {size:.2} N·m");
    assert!(error < 0.25 * size, "{error} {size}");
}
