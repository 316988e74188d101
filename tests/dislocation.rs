//! Ball sockets that leave their balls: exact falls, the instant, the history before it, the cascade and the end.

use crate::common;

use common::{model, nominal_plant, reversing, with_effect};
use deltatwin::dynamics::{Plant, inverse_dynamics};
use deltatwin::kinematics::{JointState, Motion, PlatformState};
use deltatwin::machine::bodies::{self, END_EFFECTOR, PLATFORM, SLOTS, TELESCOPE_LOWER};
use deltatwin::machine::{Payload, PerSocket, Setup, Stops, each};
use deltatwin::model::Model;
use deltatwin::monitoring::{Sample, Sliding};
use deltatwin::numerics::{bisect, halvings};
use deltatwin::recording::{Channel, Recording};
use deltatwin::scenario::{FourierMotion, Scenario};
use deltatwin::twin::{
    Checkpoint, Clamps, Event, EventKind, Load, NewContacts, Options, Report, Torque, Twin, simulate,
};
use deltatwin_io::{model, scenario};
use nalgebra::Vector3;

// Falls with exact solutions.

const G: f64 = 9.81;

/// Platform in the middle, 0.95 m below the shafts, with 2 kg on the axis; all its sockets open.
fn dropped(plant: &Plant) -> (Twin, f64) {
    let mut plant = plant.clone();
    let payload = Payload::new(2.0, [0.0, 0.0, -0.08], 0.01);
    plant.bodies[END_EFFECTOR] += payload.inertia();
    let q = plant.geometry.inverse(&Vector3::new(0.0, 0.0, -0.95), 0.0).unwrap();
    let joints = JointState { q: [q[0], q[1], q[2], 0.3], ..JointState::default() };
    let mut twin = Twin::new(plant.clone(), &plant.motion(&joints).unwrap()).unwrap();
    (6..12).for_each(|s| twin.open(s).unwrap());
    (twin, plant.bodies[PLATFORM].mass + plant.bodies[END_EFFECTOR].mass + plant.bodies[TELESCOPE_LOWER].mass)
}

#[test]
fn a_platform_without_struts_falls_freely() {
    let (mut twin, _) = dropped(&nominal_plant());
    let start = twin.motion().bodies[PLATFORM].position;
    let mut worst = 0f64;
    for k in 1..=200 {
        twin.step(1e-3, &Torque::default()).unwrap();
        let t = 1e-3 * f64::from(k);
        for body in [PLATFORM, END_EFFECTOR, TELESCOPE_LOWER] {
            let m = twin.motion().bodies[body];
            worst = worst.max((m.velocity + Vector3::z() * G * t).norm()).max(m.angular_velocity.norm());
        }
        let position = twin.motion().bodies[PLATFORM].position;
        worst = worst.max((position - start + Vector3::z() * (0.5 * G * t * t)).norm());
    }
    println!("free fall over {:.3} m: {worst:.1e}", 0.5 * G * 0.04);
    assert!(worst < 1e-9, "{worst:e}");
}

#[test]
fn the_telescope_brakes_the_fall() {
    // m·v̇ = −m·g − c·v: z = −v∞·(t − T·(1 − e^(−t/T))) with T = m/c and v∞ = g·T.
    let c = 40.0;
    let (mut twin, mass) = dropped(&with_effect(nominal_plant(), "telescope_friction", &[&[0.0], &[c], &[100.0]]));
    assert!((mass - (1.2 + 2.0 + 0.557)).abs() < 1e-12);
    let start = twin.motion().bodies[PLATFORM].position;
    let (time, mut worst) = (mass / c, 0f64);
    for k in 1..=2000 {
        twin.step(1e-4, &Torque::default()).unwrap();
        let t = 1e-4 * f64::from(k);
        let z = -G * time * (t - time * (1.0 - (-t / time).exp()));
        worst = worst.max((twin.motion().bodies[PLATFORM].position - start - Vector3::z() * z).norm());
    }
    println!("braked fall: {worst:.1e} m");
    assert!(worst < 1e-9, "{worst:e}");
}

#[test]
fn a_strut_off_both_balls_flies_like_a_thrown_stick() {
    let plant = nominal_plant();
    let mut motion = plant.motion(&reversing(0.0)).unwrap();
    let axis = motion.strut_axis[2];
    motion.bodies[bodies::strut(2)].angular_velocity += axis * 7.0;
    let mut twin = Twin::new(plant.clone(), &motion).unwrap();
    twin.open(2).unwrap();
    twin.open(8).unwrap();
    let inertia = plant.bodies[bodies::strut(2)];
    // Centre of mass, its velocity, and angular momentum about it.
    let state = |m: &Motion| {
        let b = &m.bodies[bodies::strut(2)];
        let lever = b.rotation * inertia.first_moment / inertia.mass;
        let velocity = b.velocity + b.angular_velocity.cross(&lever);
        let about_origin = b.rotation * inertia.tensor * b.rotation.tr_mul(&b.angular_velocity);
        let momentum = about_origin + lever.cross(&b.velocity) * inertia.mass - lever.cross(&velocity) * inertia.mass;
        (b.position + lever, velocity, momentum)
    };
    let (start, velocity, momentum) = state(&twin.motion());
    let spin = |m: &Motion| m.bodies[bodies::strut(2)].angular_velocity.dot(&m.strut_axis[2]);
    let start_spin = spin(&twin.motion());
    // The twist is projected onto 74 rows when the sockets open: some thousand roundings.
    assert!((start_spin - 7.0).abs() < 1e-11, "{start_spin}");
    let mut worst = [0f64; 4];
    for k in 1..=2000 {
        twin.step(1e-4, &Torque::constant([-8.0, -9.0, -7.0, 0.4])).unwrap();
        let t = 1e-4 * f64::from(k);
        let motion = twin.motion();
        let (x, v, l) = state(&motion);
        let fall = Vector3::z() * G;
        worst[0] = worst[0].max((x - start - velocity * t + fall * (0.5 * t * t)).norm());
        worst[1] = worst[1].max((v - velocity + fall * t).norm());
        worst[2] = worst[2].max((l - momentum).norm() / momentum.norm());
        worst[3] = worst[3].max((spin(&motion) - 7.0).abs());
    }
    println!(
        "thrown strut: {:.1e} m, {:.1e} m/s, angular momentum {:.1e}, spin {:.1e} rad/s",
        worst[0], worst[1], worst[2], worst[3]
    );
    assert!(worst.iter().all(|w| *w < 1e-9), "{worst:?}");
    assert!(twin.energy_balance().abs() < 1e-9, "{:e}", twin.energy_balance());
}

#[test]
fn opening_changes_no_velocity_and_spends_what_springs_hold() {
    for name in ["irb360-6-1600", "irb360-6-1600-truth"] {
        let mut model = model(name);
        model.effects.push(common::defaults("strut_elasticity"));
        let plant = Plant::new(&model, &common::payload());
        let mut twin = Twin::new(plant.clone(), &plant.motion(&reversing(0.0)).unwrap()).unwrap();
        let torque = Torque::constant([-8.0, -9.0, -7.0, 0.4]);
        (0..400).for_each(|_| twin.step(1e-4, &torque).unwrap());
        let (before, balance) = (twin.motion(), twin.energy_balance());
        twin.open(7).unwrap();
        let gap = twin.energy_balance() - balance;
        let after = twin.motion();
        let moved = (after.bodies[PLATFORM].position - before.bodies[PLATFORM].position).norm();
        println!("{name}: platform moved {moved:.1e} m, energy gap {gap:.1e} J");
        assert!(moved < 1e-4 && gap.abs() < 1e-9, "{moved:e} {gap:e}");
        (0..400).for_each(|_| twin.step(1e-4, &torque).unwrap());
        let gap = twin.energy_balance() - balance;
        assert!(gap.abs() < 1e-6, "{gap:e}");
    }
}

// The instant, through closed-loop runs.

fn motion() -> FourierMotion {
    FourierMotion {
        frequency: 2.0,
        centre: [0.0, 0.0, -0.95, 0.0],
        sine: vec![[0.12, 0.05, 0.02, 0.5], [0.04, 0.06, 0.01, 0.2]],
        cosine: vec![[0.05, 0.10, 0.0, 0.3], [0.01, -0.03, 0.02, 0.1]],
    }
}

fn setup() -> Setup {
    let payload = Payload::new(2.5, [0.04, 0.0, -0.1], 0.012);
    Setup { payload, ..Setup::default() }
}

/// Clamps so strong that a pull along the opening does not matter: the margin is hold − force across the cup.
fn clamps(hold: f64, armed: bool) -> Clamps {
    Clamps { hold: each(hold), preload: each(1e12), share: 0.0, armed }
}

fn options(hold: f64, armed: bool) -> Options {
    let clamps = clamps(hold, armed);
    let contacts: Option<NewContacts> = Some(deltatwin_cell::contacts);
    let mut options = Options { duration: 0.4, noise_seed: None, clamps: Some(clamps), contacts, ..Options::default() };
    (options.sensors.sockets, options.sensors.velocity, options.sensors.acceleration) = (true, true, true);
    (options.sensors.strut_upper, options.sensors.strut_lower) = (crate::common::SIX_STRUTS, crate::common::SIX_STRUTS);
    options
}

fn run(robot: &Model, options: &Options) -> (Recording, Report) {
    let motion = motion();
    let believed = Plant::new(&model("irb360-6-1600"), &setup());
    let desired = |t: f64| -> PlatformState { motion.at(t) };
    simulate(robot, &setup(), &believed, &desired, options, &mut |_| true).expect("a feasible motion")
}

/// The truth with friction that reads the reactions.
fn robot(load_dependent: bool) -> Model {
    let mut robot = model("irb360-6-1600-truth");
    if load_dependent {
        robot.effects.push(common::defaults("ball_socket_load_dependent"));
    }
    robot
}

fn of_kind(report: &Report, kind: EventKind) -> Vec<Event> {
    report.events.iter().filter(|e| e.kind == kind).cloned().collect()
}

/// Socket, force across the cup and hold in a dislocation event.
fn told(event: &Event) -> (usize, f64, f64) {
    let words: Vec<&str> = event.what.split_whitespace().collect();
    let strut: usize = words[1].parse().unwrap();
    let end = if words[2].starts_with("upper") { 0 } else { 6 };
    (end + strut - 1, words[3].parse().unwrap(), words[7].parse().unwrap())
}

#[test]
fn a_socket_leaves_when_the_force_reaches_its_hold_and_not_before() {
    for load_dependent in [false, true] {
        let robot = robot(load_dependent);
        let period = robot.sample_time;
        const WATCHED: f64 = 1e3;
        let (free, _) = run(&robot, &options(WATCHED, false));
        let margins = margins_of(&free.signals);
        let across: Vec<f64> =
            margins.iter().map(|m| WATCHED - m.iter().copied().fold(f64::INFINITY, f64::min)).collect();
        // A level that the force crosses upwards after a while, 2/3 of the way to its peak.
        let calm = across[..250].iter().copied().fold(0.0, f64::max);
        let peak = across.iter().copied().fold(0.0, f64::max);
        let hold = calm + 0.66 * (peak - calm);
        assert!(peak > calm + 5.0, "{calm} {peak}");
        let (watched, _) = run(&robot, &options(hold, false));
        let (armed, report) = run(&robot, &options(hold, true));
        let gone = of_kind(&report, EventKind::Dislocation);
        let event = gone.first().expect("a dislocation");
        let k = (event.t / period).floor() as usize;

        // The history until then is the same bit for bit, and the margin changes its sign in that sample.
        let head = |r: &Recording| {
            let signals = r.signals.part(0..k + 1);
            Recording { signals, ..r.clone() }
        };
        assert!(armed.signals.len() > k + 1);
        if let Some(d) = head(&armed).first_difference(&head(&watched)) {
            panic!("arming changes sample {} of {} by {:e}", d.sample, d.channel, d.size);
        }
        assert!(across[k] < hold && across[k + 1] >= hold, "{} {hold} {}", across[k], across[k + 1]);

        // The instant: the unarmed machine under the recorded torques, found on its own.
        let plant = Plant::new(&robot, &setup());
        let start = plant.geometry.inverse_motion(&motion().at(0.0)).unwrap();
        let crossing = |substeps: usize| {
            let mut twin = Twin::new(plant.clone(), &plant.motion(&start).unwrap()).unwrap();
            let clamps = clamps(hold, true);
            let tau = watched.signals.tau();
            let torque = |j: usize| Torque::ramp(j as f64 * period, tau.at(j), tau.at(j + 1), period);
            for j in 0..k {
                twin.set_time(j as f64 * period);
                (0..substeps).for_each(|_| twin.step(period / substeps as f64, &torque(j)).unwrap());
            }
            twin.set_time(k as f64 * period);
            let mut checkpoint = Checkpoint::default();
            twin.save(&mut checkpoint);
            let [_, high] = bisect([0.0, period], halvings(period, 1e-10), |step| {
                twin.restore(&checkpoint);
                (0..substeps).for_each(|_| twin.step(step / substeps as f64, &torque(k)).unwrap());
                let s = twin.evaluate(&torque(k)).unwrap();
                let margins = clamps.margins(&s.motion, &s.sockets, twin.closed());
                !margins.iter().any(|m| *m < 0.0)
            });
            twin.restore(&checkpoint);
            (0..substeps).for_each(|_| twin.step(high / substeps as f64, &torque(k)).unwrap());
            (twin.time(), twin)
        };
        let (at, mut twin) = crossing(1);
        let (finer, _) = crossing(16);
        let rate = (across[k + 1] - across[k]) / period;
        let (first, force, told_hold) = told(event);
        println!(
            "hold {hold:.3} N, {rate:.0} N/s: event at {:.7} s, crossing at {at:.7} s, at 1/16 of the step {finer:.7} s; \
             {force:.3} N",
            event.t
        );
        assert!((event.t - at).abs() < 1.1e-7 && (event.t - finer).abs() < 1e-6);
        assert!((told_hold - hold).abs() < 6e-4 && force - hold > -6e-4 && force - hold < rate * 1e-7 + 1e-3);

        // The cascade: again and again the socket that lacks most; the first loss takes the partner's hold.
        let mut clamps = clamps(hold, true);
        let at_once: Vec<usize> = gone.iter().filter(|e| e.t == event.t).map(|e| told(e).0).collect();
        assert_eq!(at_once[..2], [first, first ^ 1], "the partner follows");
        let tau = watched.signals.tau();
        let torque = Torque::ramp(k as f64 * period, tau.at(k), tau.at(k + 1), period);
        for (n, &socket) in at_once.iter().enumerate() {
            let s = twin.evaluate(&torque).unwrap();
            let margins = clamps.margins(&s.motion, &s.sockets, twin.closed());
            let worst = twin.closed().iter().min_by(|&a, &b| margins[a].total_cmp(&margins[b])).unwrap();
            assert_eq!((worst, margins[worst] < 0.0), (socket, true), "loss {n}");
            twin.open(socket).unwrap();
            for s in [socket, socket ^ 1] {
                (clamps.hold[s], clamps.preload[s]) = (0.0, 0.0);
            }
        }
        let s = twin.evaluate(&torque).unwrap();
        let margins = clamps.margins(&s.motion, &s.sockets, twin.closed());
        assert!(twin.closed().iter().all(|s| margins[s] >= 0.0), "the rest holds");

        // The drives trip at the next control instant, and not before.
        let trips = of_kind(&report, EventKind::Trip);
        assert_eq!(trips.len(), 1);
        assert!((trips[0].t - (k + 1) as f64 * period).abs() < 1e-12, "{} {}", trips[0].t, event.t);
        let tau = armed.signals.tau();
        assert!(tau.at(k + 1) != [0.0; 4] && tau.iter().skip(k + 2).all(|t| t == [0.0; 4]));
        println!("lost at once: {at_once:?}; later: {}; trip at {:.4} s", gone.len() - at_once.len(), trips[0].t);
        assert!((0..12).all(|s| report.closed.contains(s) != gone.iter().any(|e| told(e).0 == s)));
    }
}

#[test]
fn a_missing_spring_holds_nothing_from_the_start() {
    let mut options = options(500.0, true);
    options.duration = 0.02;
    let clamps = options.clamps.as_mut().unwrap();
    for s in [8, 9] {
        (clamps.hold[s], clamps.preload[s]) = (0.0, 0.0);
    }
    let (_, report) = run(&robot(false), &options);
    let gone = of_kind(&report, EventKind::Dislocation);
    let mut sockets: Vec<usize> = gone.iter().map(|e| told(e).0).collect();
    sockets.sort_unstable();
    assert_eq!(sockets, [8, 9]);
    assert!(gone.iter().all(|e| e.t < 1e-6), "{gone:?}");
}

// What the cup of a socket feels.

/// A machine at rest at a position of its platform, under the torques that keep it there.
fn resting(robot: &Model, position: Vector3<f64>) -> (Twin, Torque) {
    let plant = Plant::new(robot, &Setup::default());
    let q = plant.geometry.inverse(&position, 0.0).unwrap();
    let motion = plant.motion(&JointState { q: [q[0], q[1], q[2], 0.0], ..JointState::default() }).unwrap();
    let states = vec![&[][..]; plant.effects.len()];
    let torque = Torque::constant(inverse_dynamics(&plant, 0.0, &motion, &states, false).unwrap().tau);
    (Twin::new(plant, &motion).unwrap(), torque)
}

/// The identified machine without laws of friction, which have nothing to do at rest.
fn bare() -> Model {
    let mut robot = model("irb360-6-1600");
    robot.effects.clear();
    robot
}

#[test]
fn struts_pulled_apart_leave_their_balls_above_the_preload() {
    let robot = bare();
    let clamps = Clamps::watched(&robot.sockets);
    let (mut twin, torque) = resting(&robot, Vector3::new(0.0, 0.0, -0.95));
    let rest = twin.evaluate(&torque).unwrap();
    let before = clamps.margins(&rest.motion, &rest.sockets, twin.closed());
    // Struts 1 and 2, upright on v in the middle of the workspace, are pulled apart by f in the middle of their lengths:
    // in balance, so nothing moves, and each of the four balls takes f/2 along the opening of its cup. Of 200 N of clamp
    // 200 − f/2 are left, at tan α = 200/200.
    let mut pulled_apart = |f: f64| {
        let mut load = [(Vector3::zeros(), Vector3::zeros()); SLOTS];
        for (strut, side) in [(0, f), (1, -f)] {
            let force = Vector3::y() * side;
            load[bodies::strut(strut)] = (force, (rest.motion.strut_axis[strut] * (0.5 * 1.106)).cross(&force));
        }
        twin.set_external(Load::constant(load));
        let now = twin.evaluate(&torque).unwrap();
        clamps.margins(&now.motion, &now.sockets, twin.closed())
    };
    for f in [100.0, 300.0, 420.0] {
        let after = pulled_apart(f);
        for s in 0..12 {
            let lost = if s % 6 < 2 { 0.5 * f } else { 0.0 };
            approx::assert_relative_eq!(after[s], before[s] - lost, epsilon = 1e-6);
        }
        assert_eq!(after.iter().filter(|m| **m < 0.0).count(), if f > 400.0 { 4 } else { 0 }, "{f} N");
    }
    // Pushed together they sit the firmer.
    assert!(pulled_apart(-100.0)[0] > before[0] + 49.9);
}

#[test]
fn margins_are_net_of_the_clamp_springs() {
    // Far out the pairs are sheared by 43°, and the springs of a unit of 200 N pull 136 N along the struts.
    let far = Vector3::new(0.0, 0.75, -0.9);
    let mut robot = bare();
    let read = |robot: &Model| {
        let (mut twin, torque) = resting(robot, far);
        let now = twin.evaluate(&torque).unwrap();
        let margins = Clamps::watched(&robot.sockets).margins(&now.motion, &now.sockets, twin.closed());
        (margins, now.reactions)
    };
    let (without, forces) = read(&robot);
    robot.effects.push(common::defaults("clamp_springs"));
    let (with, forces_with) = read(&robot);
    for s in 0..12 {
        assert!((with[s] - without[s]).abs() < 1e-6, "socket {s}: {} and {}", with[s], without[s]);
    }
    for (a, b) in forces.upper.iter().chain(&forces.lower).zip(forces_with.upper.iter().chain(&forces_with.lower)) {
        assert!((a - b).abs() < 1e-6, "{a} {b}");
    }
    // Counted in full they would leave nothing of the hold where the real machine works: cos 43° of the preload seats
    // the cup, sin 43° pushes it off.
    robot.sockets.clamp_share = 1.0;
    let (gross, _) = read(&robot);
    assert!(gross.iter().any(|m| *m < 0.0) && without.iter().all(|m| *m > 150.0), "{gross:?} {without:?}");
}

/// A run of a machine that is its own controller's model, without noise: margins of the twin, and those of the model along
/// the executed motion.
fn followed(mut scenario: Scenario, duration: f64) -> (Model, Setup, Recording, Vec<PerSocket<f64>>) {
    let machine = deltatwin_io::model::read(&scenario.model).unwrap();
    scenario.duration = duration;
    scenario.noise = false;
    let sensors = &mut scenario.sensors;
    (sensors.sockets, sensors.velocity, sensors.acceleration) = (true, true, true);
    (sensors.strut_upper, sensors.strut_lower) = (crate::common::SIX_STRUTS, crate::common::SIX_STRUTS);
    let setup = scenario.setup;
    let motion = scenario.motion(&machine).unwrap();
    let (plant, options) = (Plant::new(&machine, &setup), Options::of(&scenario, &machine));
    let (recording, _) = simulate(&machine, &setup, &plant, &|t| motion.at(t), &options, &mut |_| true).unwrap();
    let clamps = Clamps::watched(&machine.sockets);
    let signals = &recording.signals;
    let (qd, qdd) = (signals.rows(Channel::Rate), signals.rows(Channel::Acceleration));
    let margins = (0..signals.len()).map(|k| {
        let pose = plant.motion(&JointState { q: signals.q().at(k), qd: qd.at(k), qdd: qdd.at(k) }).unwrap();
        clamps.along(&plant, signals.t[k], &pose).unwrap().1
    });
    let margins = margins.collect();
    (machine, setup, recording, margins)
}

/// Margins of all sockets at every sample, N.
fn margins_of(signals: &deltatwin::recording::Signals) -> Vec<Vec<f64>> {
    let sockets = Channel::of_sockets(signals.mechanism);
    (0..signals.len()).map(|k| sockets.iter().map(|socket| signals[*socket][k]).collect()).collect()
}

/// One criterion: the margins that the model gives along a motion are those of the twin, and not hold − |axial force|.
#[test]
fn margins_along_a_known_motion_are_those_of_the_twin() {
    let (machine, setup, recording, margins) = followed(scenario("payload"), 1.4);
    let signals = &recording.signals;
    let twin = margins_of(signals);
    let (mut worst, mut axial_only) = (0.0f64, 0.0f64);
    for (k, (twin, margins)) in twin.iter().zip(&margins).enumerate() {
        let ends = (0..6).map(Channel::StrutUpper).chain((0..6).map(Channel::StrutLower));
        for ((twin, margin), end) in twin.iter().zip(margins).zip(ends) {
            worst = worst.max((twin - margin).abs());
            let axial = machine.sockets.dislocation_force - signals[end][k].abs();
            axial_only = axial_only.max((twin - axial).abs());
        }
    }
    println!("{worst:.1e} N apart; the axial force alone would be {axial_only:.1} N wrong");
    assert!(worst < 0.5 && axial_only > 1.5, "{worst} {axial_only}");
    // A watch sees sockets from angles alone.
    let mut stream = Sliding::new(&machine, &setup);
    let sample = |k: usize| Sample { t: signals.t[k], q: signals.q().at(k), tau: signals.tau().at(k) };
    let window = (0..signals.len()).find_map(|k| stream.push(sample(k)).unwrap()).expect("a window");
    assert!(window.loads.is_some_and(|loads| loads.margin.iter().all(|m| m.is_finite())));
}

/// A scenario's options, with contacts.
fn touching(scenario: &Scenario, machine: &Model) -> Options {
    Options { contacts: Some(deltatwin_cell::contacts), ..Options::of(scenario, machine) }
}

/// A heavy tilted load breaks the robot, and its drives coast.
const COAST: &str = r#"
model = "../models/irb360-6-1600-truth.toml"
controller_model = "../models/irb360-6-1600.toml"
duration = 0.7
seed = 1
noise = false
substeps = 2
[motion]
kind = "path"
waypoints = [[-0.3, 0.1, -0.95, 0.0], [0.3, 0.1, -0.95, 1.5]]
speed = 4.0
acceleration = 45.0
jerk = 3000.0
[payload]
mass = 4.0
com = [0.08, 0.0, -0.22]
inertia_zz = 0.03
[sockets]
armed = true
[supervision]
trip = "coast"
[sensors]
record = ["ee", "sockets"]
"#;

#[test]
fn a_broken_robot_stays_within_its_hard_stops() {
    let scenario = scenario::parse(COAST, &crate::common::shipped("scenarios/coast.toml")).unwrap();
    let machine = model::read(&scenario.model).unwrap();
    let options = Options { frames: Some(0.002), ..touching(&scenario, &machine) };
    let worst = |machine: &Model| {
        let report = play_on(machine, &scenario, &options);
        let (mut arm, mut length) = ([0f64; 2], 0f64);
        for frame in &report.frames {
            for i in 0..3 {
                let x = frame.bodies[i].rotation * Vector3::x();
                let q = (-x.z).atan2(x.dot(&machine.geometry.limbs[i].radial()));
                arm = [arm[0].min(q), arm[1].max(q)];
            }
            let lower = frame.bodies[TELESCOPE_LOWER].translation.vector;
            length = length.max((machine.geometry.upper_hooke() - lower).norm());
        }
        (report, arm, length)
    };
    let (report, arm, length) = worst(&machine);
    tell("coast", &report);
    println!("arms {arm:.3?} rad, telescope {length:.4} m");
    assert!(arm[0] > -0.805 - 0.06 && arm[1] < 1.847 + 0.06, "{arm:?}");
    // 7 kg at 2 m/s, ½·m·v² = ½·k·x²: 17 mm; an arm of 0.26 kg·m² at 15 rad/s: 0.054 rad.
    assert!(length < 1.372 + 0.017, "{length}");
    assert!(!of_kind(&report, EventKind::Stop).is_empty());
    assert!(report.energy_error < 1e-5, "{:e}", report.energy_error);
    let forces: Vec<f64> = of_kind(&report, EventKind::Dislocation).iter().map(|e| told(e).1).collect();
    assert!(report.peak_strut_force > 0.9 * forces[0], "{} N, {forces:?}", report.peak_strut_force);
    // Without stops they go beyond.
    let (report, arm, length) = worst(&Model { stops: Stops::NONE, ..machine });
    assert!(of_kind(&report, EventKind::Stop).is_empty());
    assert!(arm[1] > 1.9 || length > 1.4, "{arm:?} {length}");
}

// Shipped scenarios.

fn scenario(name: &str) -> Scenario {
    scenario::read(&crate::common::shipped(format!("scenarios/{name}.toml"))).unwrap()
}

fn play(scenario: &Scenario, options: &Options) -> Report {
    play_on(&model::read(&scenario.model).unwrap(), scenario, options)
}

fn play_on(machine: &Model, scenario: &Scenario, options: &Options) -> Report {
    let planning = model::read(scenario.controller_model.as_ref().unwrap()).unwrap();
    let motion = scenario.motion(&planning).unwrap();
    let believed = Plant::new(&planning, &scenario.setup);
    simulate(machine, &scenario.setup, &believed, &|t| motion.at(t), options, &mut |_| true).unwrap().1
}

fn tell(name: &str, report: &Report) {
    println!(
        "{name}: {:.3} s, kinetic energy {:.2e} J, energy {:.1e}",
        report.simulated, report.kinetic_energy, report.energy_error
    );
    for e in &report.events {
        println!("  {:9.6} {}: {}", e.t, e.kind.name(), e.what);
    }
}

#[test]
fn drawn_and_worn_holds_decide_which_socket_goes_first() {
    let worn = scenario("worn-sockets");
    let machine = model::read(&worn.model).unwrap();
    let holds = worn.socket_holds(&machine);
    assert_ne!(holds[6], holds[7], "drawn one by one");
    let report = play(&worn, &Options { duration: 0.3, ..touching(&worn, &machine) });
    let gone = of_kind(&report, EventKind::Dislocation);
    let (socket, force, hold) = told(&gone[0]);
    // A pull along the opening of a few newtons takes its part of the hold.
    let words: Vec<&str> = gone[0].what.split_whitespace().collect();
    let [drawn, pull] = [words[9], words[12]].map(|word| word.parse::<f64>().unwrap());
    assert!([6, 7].contains(&socket) && (drawn - holds[socket]).abs() < 0.051, "{:?}", gone[0]);
    // Pull and drawn hold are printed to a tenth of a newton.
    assert!((hold - drawn * (1.0 - pull / machine.sockets.preload)).abs() < 0.11, "{:?}", gone[0]);
    assert!(force >= hold - 2e-3 && force < hold + 0.05 && pull.abs() < 0.2 * hold, "{:?}", gone[0]);
    assert!(report.peak_strut_force >= 0.95 * force, "{} at the event, {force}", report.peak_strut_force);
    let mut healthy = worn.clone();
    healthy.sockets.wear = each(0.0);
    let report = play(&healthy, &Options { duration: 0.3, ..touching(&healthy, &machine) });
    assert!(of_kind(&report, EventKind::Dislocation).is_empty());
}

#[test]
fn two_metres_per_second_dislocate_and_five_centimetres_do_not() {
    let crash = scenario("crash");
    let machine = model::read(&crash.model).unwrap();
    let report = play(&crash, &Options { duration: 0.3, ..touching(&crash, &machine) });
    tell("crash", &report);
    let contact = &of_kind(&report, EventKind::Contact)[0];
    let gone = &of_kind(&report, EventKind::Dislocation)[0];
    assert!(contact.t < gone.t && gone.t < contact.t + 0.05, "{contact:?} {gone:?}");
    let touch = scenario("touch");
    let report = play(&touch, &touching(&touch, &machine));
    tell("touch", &report);
    assert!(!of_kind(&report, EventKind::Contact).is_empty());
    assert!(of_kind(&report, EventKind::Dislocation).is_empty());
    assert_eq!(of_kind(&report, EventKind::Trip).len(), 1);
}

#[test]
fn what_has_fallen_comes_to_rest() {
    // Regularised friction creeps: six struts of 0.075 kg·m² in their sockets at up to 0.05 rad/s.
    const CREEP: f64 = 6.0 * 0.5 * 0.075 * 0.05 * 0.05;
    for name in ["worn-sockets", "crash"] {
        let scenario = scenario(name);
        let machine = model::read(&scenario.model).unwrap();
        let start = std::time::Instant::now();
        let report = play(&scenario, &Options { duration: 2.5, ..touching(&scenario, &machine) });
        tell(name, &report);
        println!("  {:.1} s of wall clock", start.elapsed().as_secs_f64());
        assert!(report.kinetic_energy < CREEP, "{name}: {:e} J", report.kinetic_energy);
    }
}

/// Parts on a block are followed with one step per sample, impacts with steps that resolve them: the energy closes.
#[test]
fn steps_in_contact_follow_the_error_and_not_the_stiffness() {
    let crash = scenario("crash");
    let machine = model::read(&crash.model).unwrap();
    let report = play(&crash, &touching(&crash, &machine));
    tell("crash", &report);
    let impacts = of_kind(&report, EventKind::Contact).len();
    // Steps of ωh = 0.1 would be 10 700 after the breakage, with six times the error of the energy.
    println!("{} steps, {impacts} impacts", report.steps);
    assert!(impacts >= 4 && report.steps < 6000, "{} steps, {impacts} impacts", report.steps);
    assert!(report.energy_error < 1e-6, "{:e}", report.energy_error);
}

/// Without what solves contacts a run is complete as long as there is nothing to touch; a broken robot's links pass through
/// each other.
#[test]
fn a_run_without_contacts_has_none_and_takes_no_objects() {
    let crash = scenario("crash");
    let machine = model::read(&crash.model).unwrap();
    let options = Options { duration: 0.3, ..Options::of(&crash, &machine) };
    let planning = model::read(crash.controller_model.as_ref().unwrap()).unwrap();
    let motion = crash.motion(&planning).unwrap();
    let believed = Plant::new(&planning, &crash.setup);
    let run =
        |options: &Options| simulate(&machine, &crash.setup, &believed, &|t| motion.at(t), options, &mut |_| true);
    let refused = run(&options).unwrap_err().to_string();
    assert!(refused.contains("nothing that solves contacts"), "{refused}");
    let mut clamps = options.clamps.unwrap();
    clamps.hold[0] = 0.0;
    let alone = Options { objects: Vec::new(), actions: Vec::new(), clamps: Some(clamps), ..options };
    let report = run(&alone).unwrap().1;
    assert!(!of_kind(&report, EventKind::Dislocation).is_empty() && of_kind(&report, EventKind::Contact).is_empty());
}

/// Struts of 12 g whose cups lie on their balls when a socket opens: the overlap is no spring that was stretched. Of the work
/// turned over, a fifth was unaccounted for where it was one.
#[test]
fn light_struts_that_come_loose_keep_their_energy() {
    const BREAK: &str = r#"
model = "linear-delta.toml"
duration = 0.4
seed = 1
noise = false
substeps = 2
[motion]
kind = "random_fourier"
seed = 1
frequency = 0.22
harmonics = 8
share = 0.8
[payload]
mass = 1.1
com = [0.068, 0.0, 0.0]
inertia_zz = 0.001
[sockets]
armed = true
"#;
    let file = crate::common::shipped("models/break.toml");
    let machine = crate::common::model("linear-delta");
    for substeps in [2, 8] {
        let text = BREAK.replace("substeps = 2", &format!("substeps = {substeps}"));
        let scenario = deltatwin_io::scenario::parse(&text, &file).unwrap();
        let (motion, plant) = (scenario.motion(&machine).unwrap(), Plant::new(&machine, &scenario.setup));
        let options = Options { contacts: Some(deltatwin_cell::contacts), ..Options::of(&scenario, &machine) };
        let desired = |t: f64| motion.at(t);
        let (_, report) = simulate(&machine, &scenario.setup, &plant, &desired, &options, &mut |_| true).unwrap();
        let lost = of_kind(&report, EventKind::Dislocation).len();
        println!("{substeps} substeps: {lost} sockets, {:.2e} of the work", report.energy_error);
        assert!(lost >= 6 && report.energy_error < 0.01, "{substeps}: {lost} {:e}", report.energy_error);
    }
}
