//! Every run in absolute coordinates beside the same run with its rows eliminated in closed form.
//!
//! Both integrate the same equations with the same method over different coordinates. They agree where the step resolves
//! the motion: each scenario runs for a short time at a step at which the method's own error is below what is asked for.

use crate::common;

use std::path::Path;

use common::{defaults, runs};
use deltatwin::dynamics::Plant;
use deltatwin::effects::{ActiveEffect, REGISTRY, find};
use deltatwin::kinematics::JointState;
use deltatwin::machine::Setup;
use deltatwin::model::Model;
use deltatwin::recording::{Channel, Recording, Signals};
use deltatwin::scenario::Formulation;
use deltatwin::twin::{Options, Report, Torque, Twin, simulate};
use deltatwin_io::{model, recording, scenario};
use rayon::prelude::*;

/// Largest difference of a channel, relative to the largest magnitude of its kind.
const AGREEMENT: f64 = 1e-9;

fn name(file: &Path) -> &str {
    file.file_stem().unwrap().to_str().unwrap()
}

/// What a test changes in a run.
type Change<'a> = dyn Fn(&mut Model, &mut Options, &mut Setup) + Sync + 'a;

fn play(file: &Path, formulation: Formulation, change: &Change<'_>) -> (Recording, Report) {
    let mut scenario = scenario::read(file).unwrap();
    let mut machine = model::read(&scenario.model).unwrap();
    let planning = model::read(scenario.controller_model.as_ref().unwrap_or(&scenario.model)).unwrap();
    let motion = scenario.motion(&planning).unwrap();
    let mut options = Options::of(&scenario, &machine);
    options.formulation = formulation;
    options.contacts = Some(deltatwin_cell::contacts);
    options.sensors.velocity = true;
    options.sensors.acceleration = true;
    options.sensors.multipliers = machine.mechanism.is_delta() || !machine.assembled;
    if machine.assembled && machine.mechanism.arms() == 3 {
        options.sensors.strut_upper = crate::common::SIX_STRUTS;
        options.sensors.strut_lower = crate::common::SIX_STRUTS;
        options.sensors.sockets = true;
    }
    change(&mut machine, &mut options, &mut scenario.setup);
    let believed = Plant::new(&planning, &scenario.setup);
    simulate(&machine, &scenario.setup, &believed, &|t| motion.at(t), &options, &mut |_| true)
        .unwrap_or_else(|e| panic!("{}: {e}", scenario.name))
}

/// Families of channels that both have: name, largest difference, and largest magnitude.
fn differences(a: &Recording, b: &Recording) -> Vec<(String, f64, f64)> {
    let mut still = b.clone();
    still.signals = zero(&b.signals);
    let sizes = b.differences(&still);
    let size = |channel: &str| sizes.iter().find(|d| d.channel == channel).map_or(0.0, |d| d.size);
    a.differences(b)
        .into_iter()
        .filter(|d| d.channel != "t")
        .map(|d| (d.channel.clone(), d.size, size(&d.channel)))
        .collect()
}

/// The same channels, all zero.
fn zero(s: &Signals) -> Signals {
    let mut zero = s.clone();
    zero.series_mut().for_each(|(_, values)| values.fill(0.0));
    zero
}

/// Runs both ways with `change`, prints the worst channel and returns every family's name and relative difference.
fn apart(label: &str, file: &Path, change: &Change<'_>) -> Vec<(String, f64)> {
    let (a, eliminated) = play(file, Formulation::Eliminated, change);
    let (b, absolute) = play(file, Formulation::Absolute, change);
    assert_eq!(eliminated.events, absolute.events, "{label}");
    let (gap, energy) = (absolute.max_loop_gap, absolute.energy_error);
    assert!(gap < 1e-12 && energy < 1e-4, "{label}: {gap:e} {energy:e}");
    let all: Vec<(String, f64)> =
        differences(&a, &b).into_iter().map(|(channel, size, of)| (channel, size / of.max(1e-3))).collect();
    let worst = all.iter().max_by(|x, y| x.1.total_cmp(&y.1)).unwrap();
    println!("{label:<34} {:.1e} in {}, gap {gap:.0e}", worst.1, worst.0);
    all
}

fn agree(label: &str, file: &Path, change: &Change<'_>) {
    let all = apart(label, file, change);
    assert!(all.iter().all(|(_, d)| *d < AGREEMENT), "{label}: {all:?}");
}

/// With the shipped noise and quantisation: both draw the same.
#[test]
fn every_shipped_scenario_runs_both_ways() {
    runs().par_iter().for_each(|file| {
        agree(name(file), file, &|_, options, _| {
            options.duration = 0.004;
            options.substeps *= 32;
        });
    });
}

#[test]
fn every_effect_runs_both_ways() {
    let effects: Vec<&str> =
        REGISTRY.iter().map(|e| e.name()).filter(|n| !["rigid_bodies", "formula"].contains(n)).collect();
    effects.par_iter().for_each(|effect| {
        // Struts begin without elongation and ring at 450 Hz and more, which takes finer steps. Angles and torques agree
        // as all others do; of accelerations and forces the ringing itself remains, smaller with the cube of the step.
        let active = defaults(effect);
        let rings = active.strut_spring().is_some();
        let all = apart(effect, &crate::common::shipped("scenarios/smoke.toml"), &|model, options, setup| {
            *model = common::model("irb360-6-1600");
            *setup = common::payload();
            model.effects.retain(|a| a.effect.name() != *effect);
            model.effects.push(defaults(effect));
            (options.duration, options.noise_seed) = (0.0024, None);
            options.substeps *= if rings { 64 } else { 16 };
        });
        for (channel, d) in all {
            let smooth = ["q", "qd", "tau", "ee"].contains(&channel.as_str());
            let allowed = if rings && !smooth { 1e-7 } else { AGREEMENT };
            assert!(d < allowed, "{effect}: {d:e} in {channel}");
        }
    });
}

/// Gears of 2.5e4 N·m/rad with a damping of 20 N·m·s/rad, rotors of that inertia, kg·m², and friction on the motors' side.
fn gears(rotor: f64) -> ActiveEffect {
    gears_of(3, rotor)
}

/// [`gears`] of a robot with so many arms.
fn gears_of(arms: usize, rotor: f64) -> ActiveEffect {
    ActiveEffect::new(find("drive_elasticity").unwrap(), &[&vec![4e-5; arms], &[20.0], &[rotor], &[1.0]])
}

#[test]
fn friction_at_the_motors_of_elastic_gears_runs_both_ways() {
    // The arms alone leave no body without more of it than a rotor of 0.1 kg·m².
    for (file, rotor) in [("smoke", 0.18), ("disassembled", 0.1)] {
        let path = format!("scenarios/{file}.toml");
        agree(&format!("{file}, friction at the motors"), &crate::common::shipped(path), &|model, options, _| {
            model.effects.push(gears(rotor));
            options.duration = 0.004;
            options.substeps *= 32;
        });
    }
}

#[test]
fn the_smaller_irb360_runs_both_ways() {
    let scenario = tempfile::tempdir().unwrap();
    let file = scenario.path().join("small.toml");
    let model = crate::common::shipped("models/irb360-1-1130.toml");
    let text = format!(
        "model = {:?}\nduration = 0.5\n[motion]\nkind = \"fourier\"\nfrequency = 1.0\ncentre = [0.0, 0.0, -0.8, 0.0]\n\
         sine = [[0.1, 0.05, 0.03, 1.0]]\n",
        model.display().to_string()
    );
    std::fs::write(&file, text).unwrap();
    agree("irb360-1-1130", &file, &|_, options, _| {
        options.duration = 0.008;
        options.substeps *= 16;
    });
}

#[test]
fn multipliers_and_links_are_read_back_from_both_formats() {
    let (run, _) =
        play(&crate::common::shipped("scenarios/smoke.toml"), Formulation::Absolute, &|model, options, _| {
            model.effects.push(gears(0.18));
            options.sensors.links = true;
            options.duration = 0.1;
        });
    let folder = tempfile::tempdir().unwrap();
    for file in ["run.csv", "run.mcap"].map(|name| folder.path().join(name)) {
        recording::write(&run, &file).unwrap();
        let read = recording::read(&file, None).unwrap().0.signals;
        assert!(read.series().eq(run.signals.series()), "{}", file.display());
    }
    // The encoders lead the links by the gears' deflection, and so do their rates.
    let (s, last) = (&run.signals, run.signals.len() - 1);
    let lead = |motor: Channel, link: Channel| (s[motor][last] - s[link][last]).abs();
    let q = lead(Channel::Angle(0), Channel::LinkAngle(0));
    let qd = lead(Channel::Rate(0), Channel::LinkRate(0));
    assert!(q > 1e-5 && q < 1e-2 && qd > 1e-6, "{q:e} {qd:e}");
}

/// Angle, deflection of the gear and their rates of an arm between a motor with friction and gravity: J·(q̈ + δ̈) =
/// τ − c·tanh(100·ω) − d·ω − T with ω = q̇ + δ̇, Θ·q̈ = T + W + g·(h_x·cos q + h_z·sin q), T = δ/C + D·δ̇.
struct TwoMasses {
    rotor: f64,
    theta: f64,
    h: [f64; 2],
    /// Weight W along a vertical guide.
    weight: f64,
    friction: [f64; 2],
}

impl TwoMasses {
    fn rates(&self, [q, delta, qd, deltad]: [f64; 4], torque: f64) -> [f64; 4] {
        let (rate, transmitted) = (qd + deltad, delta / 4e-5 + 20.0 * deltad);
        let friction = self.friction[0] * (100.0 * rate).tanh() + self.friction[1] * rate;
        let pull = self.weight + 9.81 * (self.h[0] * q.cos() + self.h[1] * q.sin());
        let arm = (transmitted + pull) / self.theta;
        [qd, deltad, arm, (torque - friction - transmitted) / self.rotor - arm]
    }

    /// Classical Runge–Kutta at 2 µs to `t`.
    fn run(&self, mut y: [f64; 4], torque: f64, t: f64) -> [f64; 4] {
        let h = 2e-6;
        let ahead = |y: &[f64; 4], k: &[f64; 4], h: f64| std::array::from_fn(|i| y[i] + h * k[i]);
        for _ in 0..(t / h).round() as usize {
            let a = self.rates(y, torque);
            let b = self.rates(ahead(&y, &a, 0.5 * h), torque);
            let c = self.rates(ahead(&y, &b, 0.5 * h), torque);
            let d = self.rates(ahead(&y, &c, h), torque);
            y = std::array::from_fn(|i| y[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]));
        }
        y
    }
}

#[test]
#[ignore = "campaign"]
fn friction_at_the_motor_is_that_of_two_masses_with_a_spring() {
    let [mut four, mut guides] = ["par4", "linear-delta"].map(common::model);
    (four.assembled, guides.assembled) = (false, false);
    let machines =
        [(common::model("irb360-6-1600-disassembled"), 0.18, 12.0, 0), (four, 0.07, 12.0, 3), (guides, 0.05, 0.5, 1)];
    for (mut model, rotor, torque, arm) in machines {
        let arms = model.mechanism.arms();
        model.effects.push(gears_of(arms, rotor));
        let plant = Plant::new(&model, &Setup::default());
        let body = &plant.bodies[deltatwin::machine::bodies::arm(arm)];
        let friction = model.effects.iter().find(|a| a.effect.name() == "drive_friction").unwrap();
        let friction = [friction.values[arm], friction.values[friction.layout.len() / 2 + arm]];
        let masses = match model.mechanism.has_carriages() {
            // 0.15 kg weigh, of which 0.1 kg are behind the spring.
            true => TwoMasses { rotor, theta: 0.1, h: [0.0; 2], weight: 0.15 * 9.81, friction },
            false => TwoMasses {
                rotor,
                theta: body.tensor[(1, 1)],
                h: [body.first_moment.x, body.first_moment.z],
                weight: 0.0,
                friction,
            },
        };
        let joints = JointState { q: [0.2; 4], qd: [-0.5; 4], ..JointState::default() };
        let drive = Torque::constant(std::array::from_fn(|i| if i == arm { torque } else { 0.0 }));
        for formulation in [Formulation::Eliminated, Formulation::Absolute] {
            for (step, allowed) in [(2e-4, 2e-5), (2.5e-5, 5e-7)] {
                let mut twin = Twin::formulated(plant.clone(), &plant.motion(&joints).unwrap(), formulation).unwrap();
                let mut worst = 0f64;
                for k in 1..=50 {
                    for _ in 0..(2e-3_f64 / step).round() as usize {
                        twin.step(step, &drive).unwrap();
                    }
                    let expected = masses.run([0.2, 0.0, -0.5, 0.0], torque, 2e-3 * f64::from(k));
                    let seen = twin.evaluate(&drive).unwrap();
                    worst = worst.max((twin.encoders()[arm] - expected[0] - expected[1]).abs());
                    worst = worst.max((seen.motion.q[arm] - expected[0]).abs());
                    worst = worst.max((seen.encoder_rate[arm] - expected[2] - expected[3]).abs() / 100.0);
                }
                println!("{}, {formulation:?}, {:.0} µs: {worst:.1e} rad", model.name, 1e6 * step);
                assert!(worst < allowed, "{} {formulation:?} {step}: {worst:e}", model.name);
            }
        }
    }
}
