//! Shared by the integration tests.
#![allow(dead_code)]

use std::path::Path;

use deltatwin::dynamics::Plant;
use deltatwin::effects::{ActiveEffect, find};
use deltatwin::kinematics::JointState;
use deltatwin::model::Model;
use deltatwin::recording::Setup;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// The shipped model called `name`.
pub fn model(name: &str) -> Model {
    Model::read(Path::new(&format!("models/{name}.toml"))).expect("a shipped model")
}

/// Numbers of Table 3 on the geometry of the IRB 360-6/1600, no effects, no payload.
pub fn nominal_plant() -> Plant {
    let mut model = model("irb360-6-1600");
    model.effects.clear();
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
