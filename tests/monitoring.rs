//! A machine whose wear grows: the monitor raises an alarm, and the change is named.

use deltatwin::diagnosis::change::{Changed, changed};
use deltatwin::dynamics::Plant;
use deltatwin::identification::NoiseLevel;
use deltatwin::identification::{Dataset, fit};
use deltatwin::machine::{Mechanism, Setup};
use deltatwin::model::Model;
use deltatwin::monitoring::{Alarm, Monitor, Sample, Settings, recording_of};
use deltatwin::twin::{Options, simulate};
use deltatwin_io::scenario;

use crate::common::{model, root};

const MACHINE: Mechanism = Mechanism::delta(true);
/// Duration of a run, s: two periods of its motion.
const RUN: f64 = 20.0;

/// Samples of a run of `machine`, from `start` on.
fn run(machine: &Model, seed: u64, start: f64) -> Vec<Sample> {
    let scenario = scenario::read(&root().join("scenarios/excitation.toml")).unwrap();
    let planning = model("irb360-6-1600");
    let motion = scenario.motion(&planning).unwrap();
    let controller = Plant::new(&planning, &scenario.setup);
    let options = Options { noise_seed: Some(seed), ..Options::of(&scenario, machine) };
    let run = simulate(machine, &scenario.setup, &controller, &|t| motion.at(t), &options, &mut |_| true);
    let signals = run.unwrap().0.signals;
    (0..signals.len())
        .map(|k| Sample { t: start + signals.t[k], q: signals.q().at(k), tau: signals.tau().at(k) })
        .collect()
}

/// The true robot with the friction of its ball sockets times `wear`.
fn worn(wear: f64) -> Model {
    let mut machine = model("irb360-6-1600-truth");
    let sockets = machine.effects.iter_mut().find(|a| a.effect.name() == "ball_socket_coulomb").unwrap();
    sockets.values[0] *= wear;
    machine
}

fn dataset(samples: &[Sample]) -> Dataset {
    Dataset::new(&recording_of(samples, MACHINE, &Setup::default()))
}

/// The robot's model with socket friction, as identified from a healthy run.
fn identified(healthy: &[Sample]) -> Model {
    let mut start = model("irb360-6-1600");
    let truth = worn(1.0).effects;
    start.effects.extend(truth.into_iter().filter(|a| a.effect.name().starts_with("ball_socket")));
    let datasets = [dataset(healthy)];
    let noise = [NoiseLevel::of(&start, &datasets).pooled];
    fit(&start, &datasets, &noise).unwrap().model
}

/// The alarm while `stages` of wear follow a healthy minute, and the samples from its onset on.
fn watch(model: &Model, stages: &[f64]) -> (Option<Alarm>, Vec<Sample>, Vec<f64>) {
    let mut monitor = Monitor::new(model, &Setup::default(), Settings::default());
    let (mut all, mut levels) = (Vec::new(), Vec::new());
    let wear = [1.0; 3].iter().chain(stages);
    for (k, wear) in wear.enumerate() {
        for sample in run(&worn(*wear), 100 + k as u64, 25.0 * k as f64) {
            all.push(sample);
            if let Some(observation) = monitor.push(sample).unwrap() {
                levels.extend(observation.level.map(|(_, level)| level));
            }
        }
    }
    let alarm = monitor.alarm();
    let onset = alarm.map_or(f64::INFINITY, |a| a.onset);
    (alarm, all.into_iter().filter(|s| s.t >= onset).collect(), levels)
}

#[test]
#[ignore = "campaign"]
fn wear_that_grows_is_alarmed_and_named() {
    let healthy = run(&worn(1.0), 1, 0.0);
    let model = identified(&healthy);
    let (alarm, later, levels) = watch(&model, &[1.0, 1.2, 2.0]);
    let alarm = alarm.expect("an alarm");
    println!("alarm at {:.1} s, onset {:.1} s, {}; levels {levels:.2?}", alarm.t, alarm.onset, alarm.statistic);
    assert!(alarm.onset > 95.0 && alarm.t < 120.0, "{alarm:?}");
    // The last run, in which the friction is twice the healthy one; its second half is held out.
    let last = later[later.len() - 1].t;
    let [fitted, held_out] = [[last - RUN, last - 0.5 * RUN], [last - 0.5 * RUN, last]]
        .map(|[from, to]| dataset(&later.iter().copied().filter(|s| s.t > from && s.t <= to).collect::<Vec<_>>()));
    let found = changed(&model, &[dataset(&healthy)], &[fitted], &[held_out], &Default::default()).unwrap();
    let Changed { causes, rms_before, rms_after, noise_floor, .. } = &found;
    println!("{causes:?}\n{rms_before:.4?} {rms_after:.4?} {noise_floor:.4?} {:.3}", found.explained());
    let named: Vec<&str> = causes.iter().map(|c| c.name.as_str()).collect();
    assert_eq!(named, ["ball_socket_coulomb"]);
    let moment = &causes[0].parameters[0];
    assert!(causes[0].was_present && (moment.after / moment.before - 2.0).abs() < 0.3, "{moment:?}");
    assert!(found.explained() > 0.8, "{}", found.explained());
}
