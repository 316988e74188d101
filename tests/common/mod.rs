//! Shared by the integration tests.
#![allow(dead_code)]

use std::path::{Path, PathBuf};

use deltatwin::dynamics::Plant;
use deltatwin::effects::{ActiveEffect, find};
use deltatwin::identification::Dataset;
use deltatwin::kinematics::JointState;
use deltatwin::machine::{Payload, Setup, Stops};
use deltatwin::model::Model;
use deltatwin::recording::Channel;
use deltatwin_io::kind::{Kind, kind};
use deltatwin_io::model;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Sensors in all struts of three limbs.
#[allow(dead_code)] // some binaries record none
pub const SIX_STRUTS: [bool; 8] = [true, true, true, true, true, true, false, false];

/// Folder of the shipped models and scenarios.
pub fn root() -> PathBuf {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    package.ancestors().find(|p| p.join("scenarios").is_dir()).expect("the root of the workspace").into()
}

/// A file of the repository by its name there.
pub fn shipped(file: impl AsRef<Path>) -> PathBuf {
    root().join(file)
}

/// Shipped files are named from the root from now on, as in a shell that stands there.
pub fn at_root() {
    std::env::set_current_dir(root()).expect("a folder");
}

/// Whether a file describes a run of the twin.
pub fn is_scenario(path: &Path) -> bool {
    kind(path).expect("a file of a known kind") == Kind::Scenario
}

/// Files of the shipped runs, by name.
pub fn runs() -> Vec<PathBuf> {
    let files = std::fs::read_dir(shipped("scenarios")).expect("a folder").map(|e| e.expect("an entry").path());
    let mut runs: Vec<_> = files.filter(|p| p.extension().is_some_and(|e| e == "toml") && is_scenario(p)).collect();
    runs.sort();
    assert!(runs.len() >= 12, "{runs:?}");
    runs
}

/// The shipped model called `name`.
pub fn model(name: &str) -> Model {
    model::read(&root().join(format!("models/{name}.toml"))).expect("a shipped model")
}

/// Numbers of Table 3 on the geometry of the IRB 360-6/1600, no effects, no payload, and no hard stops: smooth motion
/// wherever the torques of a test take it.
pub fn nominal_plant() -> Plant {
    let mut model = model("irb360-6-1600");
    model.effects.clear();
    model.stops = Stops::NONE;
    Plant::new(&model, &Setup::default())
}

/// Adds an effect by name.
pub fn with_effect(mut plant: Plant, name: &str, blocks: &[&[f64]]) -> Plant {
    plant.effects.push(ActiveEffect::new(find(name).expect("registered"), blocks));
    plant
}

/// Random joint motion within the joint and telescope limits, up to 4 rad/s (axis 4: 12 rad/s) and 60 rad/s².
pub fn random_joints(plant: &Plant, rng: &mut ChaCha8Rng) -> JointState {
    loop {
        let mut draw = |low: f64, high: f64| rng.random_range(low..high);
        let q = [draw(-0.5, 1.2), draw(-0.5, 1.2), draw(-0.5, 1.2), draw(-3.0, 3.0)];
        let qd = std::array::from_fn(|i| draw(-4.0, 4.0) * if i == 3 { 3.0 } else { 1.0 });
        let qdd = std::array::from_fn(|_| draw(-60.0, 60.0));
        let Ok(p) = plant.geometry.forward(&q) else { continue };
        if plant.geometry.check_limits(&q, &p).is_ok() {
            return JointState { q, qd, qdd };
        }
    }
}

/// Drive torques along `joints` every `dt`, none measured yet.
pub fn planned(setup: Setup, t: Vec<f64>, joints: Vec<JointState>, dt: f64) -> Dataset {
    let exact = Dataset::exact(Default::default(), setup, Channel::TORQUES.to_vec(), dt, joints);
    Dataset { name: "measured".into(), t, ..exact }
}

/// What the encoders of `robot` read at `joints`: whole steps, rad.
pub fn encoded(robot: &Model, joints: &[JointState]) -> Vec<[f64; 4]> {
    let step = robot.drives.map(|d| d.encoder_step());
    joints.iter().map(|j| std::array::from_fn(|i| (j.q[i] / step[i]).round() * step[i])).collect()
}

/// An effect with every parameter at its default, linear ones too.
pub fn defaults(name: &str) -> ActiveEffect {
    let mut active = ActiveEffect::absent(find(name).expect("registered"));
    let values = active.entries().iter().map(|e| e.parameter.default).collect();
    active.values = values;
    active
}

/// Joint motion whose arms and rotor reverse every 0.13 s and more, with exact derivatives.
pub fn reversing(t: f64) -> JointState {
    // amplitude, angular frequency, phase
    const WAVES: [[f64; 3]; 4] = [[0.12, 23.0, 0.3], [0.14, 19.0, 1.7], [0.11, 24.0, 4.1], [0.8, 15.0, 2.2]];
    waves(&WAVES, [0.0; 4], t)
}

/// Joint motion in one direction on all axes, with exact derivatives; until 0.2 s.
pub fn one_way(t: f64) -> JointState {
    const WAVES: [[f64; 3]; 4] = [[0.03, 23.0, 0.3], [0.04, 19.0, 1.7], [0.03, 24.0, 4.1], [0.1, 15.0, 2.2]];
    waves(&WAVES, [2.0, 1.6, -2.2, 6.0], t)
}

fn waves(waves: &[[f64; 3]; 4], rate: [f64; 4], t: f64) -> JointState {
    const CENTRE: [f64; 4] = [0.25, 0.30, 0.60, 0.5];
    let mut joints = JointState::default();
    for (i, [a, w, p]) in waves.iter().enumerate() {
        let (s, c) = (w * t + p).sin_cos();
        joints.q[i] = CENTRE[i] + rate[i] * t + a * s;
        joints.qd[i] = rate[i] + a * w * c;
        joints.qdd[i] = -a * w * w * s;
    }
    joints
}

/// A payload off the axis.
pub fn payload() -> Setup {
    Setup { payload: Payload::new(2.5, [0.03, -0.02, -0.08], 0.012), ..Setup::default() }
}

/// Waypoints (x, y, z in m, ψ in rad) of the planner's test paths.
pub const WAYPOINTS: [[f64; 4]; 7] = [
    [0.1, -0.3, -1.0, 0.0],
    [0.0, -0.1, -0.9, 0.4],
    [-0.1, 0.0, -0.95, 1.0],
    [0.0, 0.2, -1.0, 0.5],
    [0.2, 0.2, -1.05, 0.0],
    [0.25, 0.0, -1.0, -0.5],
    [0.1, -0.1, -0.95, 0.0],
];
