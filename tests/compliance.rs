//! Frames and payloads that swing: their energy, the twin against inverse dynamics, and their diagnosis.

use crate::common::{model, nominal_plant, random_joints, reversing};
use deltatwin::diagnosis::{Diagnosis, diagnose};
use deltatwin::dynamics::{Plant, inverse_dynamics};
use deltatwin::effects::{ActiveEffect, find};
use deltatwin::identification::{Dataset, predict};
use deltatwin::machine::{Payload, Setup};
use deltatwin::model::Model;
use deltatwin::scenario::motion::path::Path;
use deltatwin::scenario::{Course, Formulation};
use deltatwin::twin::{Options, Torque, Twin, simulate};
use nalgebra::Vector3;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

fn frame(inverse_mass: [f64; 2], frequency: [f64; 2], ratio: [f64; 2]) -> ActiveEffect {
    ActiveEffect::new(find("frame_compliance").unwrap(), &[&inverse_mass, &frequency, &ratio])
}

fn cup(share: f64, frequency: f64, ratio: f64) -> ActiveEffect {
    ActiveEffect::new(find("payload_compliance").unwrap(), &[&[share], &[frequency], &[ratio]])
}

fn loaded(mass: f64) -> Setup {
    Setup { payload: Payload::new(mass, [0.03, -0.02, -0.08], 0.012), ..Setup::default() }
}

/// `name` without its effects, with others.
fn machine(name: &str, setup: &Setup, effects: Vec<ActiveEffect>) -> Plant {
    let mut model = model(name);
    model.effects = effects.into();
    Plant::new(&model, setup)
}

/// Momentum of all bodies in x and y, kg·m/s.
fn momentum(plant: &Plant, twin: &Twin) -> [f64; 2] {
    let motion = twin.motion();
    let sum: Vector3<f64> = plant.bodies.0.iter().zip(&motion.bodies).fold(Vector3::zeros(), |sum, (inertia, m)| {
        sum + m.velocity * inertia.mass + m.angular_velocity.cross(&(m.rotation * inertia.first_moment))
    });
    [sum.x, sum.y]
}

/// Velocity of the payload's centre of mass in x and y, m/s.
fn of_payload(plant: &Plant, twin: &Twin) -> [f64; 2] {
    let m = twin.motion().bodies[deltatwin::machine::bodies::END_EFFECTOR];
    let v = m.velocity + m.angular_velocity.cross(&(m.rotation * plant.payload.com));
    [v.x, v.y]
}

/// Energy that swings, with mass `size` per direction, and what the damper takes, W: m·(ω²x²/2 + ẋ²/2 + ẋ·v) and
/// 2ζω·m·ẋ².
fn swinging(state: &[f64], size: [f64; 2], mode: [(f64, f64); 2], beside: [f64; 2]) -> [f64; 2] {
    let one = |i: usize| {
        let (omega, rate) = (std::f64::consts::TAU * mode[i].0, state[2 + i]);
        let energy = 0.5 * (omega * state[i]).powi(2) + 0.5 * rate * rate + rate * beside[i];
        [size[i] * energy, size[i] * 2.0 * mode[i].1 * omega * rate * rate]
    };
    let ([e0, p0], [e1, p1]) = (one(0), one(1));
    [e0 + e1, p0 + p1]
}

#[test]
fn what_swings_returns_what_it_took() {
    // Work of the effect + energy that swings + what the dampers took = 0.
    for (what, ratio) in [("frame", 0.0), ("frame", 0.2), ("payload", 0.0), ("payload", 0.2)] {
        let setup = loaded(2.5);
        let (mass, frequency) = ([4e-3, 2e-3], [9.0, 6.0]);
        let active = if what == "frame" { frame(mass, frequency, [ratio; 2]) } else { cup(0.6, frequency[1], ratio) };
        let plant = machine("irb360-6-1600", &setup, vec![active]);
        let free = machine("irb360-6-1600", &setup, vec![]);
        let mode = if what == "frame" { frequency.map(|f| (f, ratio)) } else { [(frequency[1], ratio); 2] };
        let now = |twin: &Twin| match what {
            "frame" => swinging(twin.internal_states(), mass, mode, momentum(&plant, twin)),
            _ => swinging(twin.internal_states(), [0.6 * 2.5; 2], mode, of_payload(&plant, twin)),
        };
        let torque = |t: f64| inverse_dynamics(&free, t, &free.motion(&reversing(t)).unwrap(), &[], false).unwrap().tau;
        let gaps = [2e-4_f64, 1e-4].map(|h| {
            let mut twin = Twin::new(plant.clone(), &plant.motion(&reversing(0.0)).unwrap()).unwrap();
            let ([start, mut power], mut taken, mut most) = (now(&twin), 0.0, 0f64);
            for k in 0..(0.2 / h).round() as usize {
                let t = k as f64 * h;
                twin.step(h, &Torque::ramp(t, torque(t), torque(t + h), h)).unwrap();
                let [energy, next] = now(&twin);
                taken += 0.5 * h * (power + next);
                power = next;
                most = most.max((energy - start).abs());
            }
            let work = twin.work()[8];
            let gap = work + now(&twin)[0] - start + taken;
            println!("{what} ζ = {ratio}, {h} s: work {work:+.5} J, up to {most:.5} J swing, {taken:.5} J taken, gap {gap:.1e} J");
            assert!(most > 1e-2, "{what}: {most}");
            gap.abs() / most
        });
        // The trapezoidal rule of the damper's work is of second order, all else of third.
        let order = if ratio > 0.0 { 1.7 } else { 2.5 };
        assert!(gaps[1] < 1e-6 && ((gaps[0] / gaps[1]).log2() > order || gaps[1] < 1e-10), "{gaps:?}");
    }
}

/// Largest difference of the torques that give the twin's accelerations from those it was given, relative to 100 N·m,
/// while frame and payload swing, and number of solutions per evaluation.
fn apart(plant: &Plant, formulation: Formulation, rng: &mut ChaCha8Rng) -> (f64, f64) {
    let (mut worst, mut solutions, mut count) = (0f64, 0, 0);
    for _ in 0..10 {
        let joints = random_joints(plant, rng);
        let motion = plant.motion(&joints).unwrap();
        let own = plant.steady_states(0.0, &motion);
        let states: Vec<&[f64]> = own.iter().map(Vec::as_slice).collect();
        let start = inverse_dynamics(plant, 0.0, &motion, &states, false).unwrap().tau;
        let mut twin = Twin::formulated(plant.clone(), &motion, formulation).unwrap();
        let axes = plant.mechanism.axes();
        let torque = Torque::constant(std::array::from_fn(|i| if i < axes { 0.5 * start[i] } else { 0.0 }));
        for _ in 0..25 {
            twin.step(4e-4, &torque).unwrap();
        }
        let before = twin.solutions();
        let seen = twin.evaluate(&torque).unwrap();
        (solutions, count) = (solutions + twin.solutions() - before, count + 1);
        assert_eq!(twin.unconverged(), 0.0);
        let own = twin.internal_states();
        let mut at = 0;
        let states: Vec<&[f64]> = plant
            .effects
            .iter()
            .map(|a| {
                at += a.states();
                &own[at - a.states()..at]
            })
            .collect();
        assert!(own.iter().any(|x| x.abs() > 1e-6));
        let tau = inverse_dynamics(plant, twin.time(), &seen.motion, &states, false).unwrap().tau;
        for i in 0..axes {
            worst = worst.max((tau[i] - torque.start[i]).abs() / 100.0);
        }
    }
    (worst, solutions as f64 / f64::from(count))
}

#[test]
fn forward_dynamics_inverts_inverse_dynamics_while_frame_and_payload_swing() {
    // With all of 6 kg swinging, a plain iteration over the accelerations would multiply its error by 0.7 per solution
    // and more; a frame of 60 kg by 0.2.
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    for (name, setup, effects) in [
        ("irb360-6-1600", loaded(2.5), vec![frame([2.5e-3, 4e-3], [9.0, 6.0], [0.03, 0.1])]),
        ("irb360-6-1600", loaded(6.0), vec![cup(1.0, 5.0, 0.08)]),
        ("irb360-6-1600", loaded(6.0), vec![cup(1.0, 5.0, 0.08), frame([1.6e-2; 2], [12.0, 8.0], [0.05; 2])]),
        ("clavel-delta", loaded(1.0), vec![cup(1.0, 5.0, 0.08), frame([4e-3; 2], [12.0, 8.0], [0.05; 2])]),
    ] {
        let plant = machine(name, &setup, effects);
        for formulation in [Formulation::Eliminated, Formulation::Absolute] {
            let (worst, solutions) = apart(&plant, formulation, &mut rng);
            println!("{name}, {} effects, {formulation:?}: {worst:.1e}, {solutions} solutions", plant.effects.len());
            assert!(worst < 1e-9 && solutions < 10.0, "{name} {formulation:?}: {worst:e}, {solutions}");
        }
    }
}

/// A cycle of a working robot within 0.6 m: straight lines with stops at both ends.
fn picking(acceleration: f64, laps: usize) -> Course {
    let waypoints = vec![
        [-0.25, -0.1, -1.05, 0.0],
        [-0.25, -0.1, -0.97, 0.0],
        [0.25, 0.12, -0.97, 1.0],
        [0.25, 0.12, -1.05, 1.0],
        [0.05, -0.25, -0.97, -0.5],
    ];
    Course::Path(Path {
        waypoints,
        blend: 0.05,
        speed: 3.0,
        acceleration,
        jerk: 50.0 * acceleration,
        turn_radius: 0.15,
        stops: vec![3],
        dwell: 0.1,
        closed: true,
        laps,
    })
}

/// What the nominal robot, a few percent off, measures in the twin with another effect, and the true machine.
fn measured(active: ActiveEffect, setup: Setup, duration: f64, noisy: bool) -> (Dataset, Model) {
    let mut robot = model("irb360-6-1600");
    deltatwin_validation::exam::perturb(&mut robot, &mut ChaCha8Rng::seed_from_u64(9));
    robot.effects.push(active);
    let nominal = model("irb360-6-1600");
    let motion = picking(40.0, 100).on(&nominal, &setup).unwrap();
    let believed = Plant::new(&nominal, &setup);
    let options = Options { duration, noise_seed: noisy.then_some(5), ..Options::default() };
    let (recording, report) = simulate(&robot, &setup, &believed, &|t| motion.at(t), &options, &mut |_| true).unwrap();
    println!("tracking {:?}, unconverged {}", report.tracking_error, report.unconverged);
    assert!(report.energy_closes() && report.unconverged == 0.0);
    (Dataset::new(&recording), robot)
}

fn diagnosed(dataset: Dataset) -> Diagnosis {
    let begun = std::time::Instant::now();
    let d = diagnose(&model("irb360-6-1600"), &[dataset], &[], &mut |_| {}).unwrap();
    println!("{:?} {:?} sets {:?} in {:?}", d.verdict, names(&d), d.indistinguishable, begun.elapsed());
    for e in &d.effects {
        println!(
            "{:?}",
            e.parameters.iter().map(|p| format!("{} {:.4} ± {:.4}", p.name, p.value, p.std)).collect::<Vec<_>>()
        );
    }
    d
}

fn names(d: &Diagnosis) -> Vec<&str> {
    d.effects.iter().map(|e| e.name.as_str()).collect()
}

#[test]
fn inverse_dynamics_along_a_recording_of_the_twin_gives_its_torques() {
    // What is left is the error of the differentiated angles, as without the effect; without the effect in the model it
    // is many times that.
    for (active, setup) in
        [(frame([4e-3, 2.5e-3], [9.0, 12.0], [0.03, 0.05]), Setup::default()), (cup(0.8, 7.0, 0.08), loaded(2.5))]
    {
        let rigid = ActiveEffect::absent(active.effect.clone());
        let [(plain, still), (dataset, robot)] = [rigid, active].map(|a| measured(a, setup, 1.0, false));
        let rms = |robot: &Model, dataset: &Dataset| -> f64 {
            let seen = predict(&Plant::new(robot, &setup), dataset).unwrap();
            let square = |c: usize| seen[c].iter().zip(&dataset.measured[c]).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
            ((0..3).map(square).sum::<f64>() / (3 * dataset.len()) as f64).sqrt()
        };
        let (least, left, without) = (rms(&still, &plain), rms(&robot, &dataset), rms(&still, &dataset));
        println!("{least:.4} N·m on a rigid robot, {left:.4} on this one, {without:.4} if it were rigid");
        assert!(left < 1.5 * least + 2e-3 * without && without > 10.0 * left, "{least} {left} {without}");
    }
}

#[test]
#[ignore = "campaign"]
fn a_swinging_frame_is_named() {
    // Two modes far apart, none at a frequency from which the search starts.
    let frequency = [6.0, 13.0];
    let (dataset, _) = measured(frame([4e-3, 4e-3], frequency, [0.03, 0.03]), Setup::default(), 6.0, true);
    let d = diagnosed(dataset);
    assert_eq!(names(&d), ["frame_compliance"]);
    for (name, frequency) in ["frequency_x", "frequency_y"].iter().zip(frequency) {
        let found = d.effects[0].parameters.iter().find(|p| p.name == *name).unwrap();
        assert!((found.value - frequency).abs() < 4.0 * found.std + 5e-3 * frequency, "{found:?}");
    }
}

#[test]
#[ignore = "campaign"]
fn a_swinging_payload_is_named() {
    let (dataset, _) = measured(cup(0.8, 7.0, 0.08), loaded(2.5), 6.0, true);
    let d = diagnosed(dataset);
    assert_eq!(names(&d), ["payload_compliance"]);
}

#[test]
fn rigid_frames_stay_rigid() {
    // The same equations with s = 0.
    let rigid = nominal_plant();
    let mut still = rigid.clone();
    still.effects.push(frame([0.0; 2], [9.0; 2], [0.03; 2]));
    let joints = reversing(0.1);
    let motion = rigid.motion(&joints).unwrap();
    let own = still.steady_states(0.0, &motion);
    let with = inverse_dynamics(&still, 0.0, &motion, &[&own[0]], true).unwrap();
    assert_eq!(with, inverse_dynamics(&rigid, 0.0, &motion, &[], true).unwrap());
}
