//! Shared by the integration tests.
#![allow(dead_code)]

use deltatwin::dynamics::Plant;
use deltatwin::effects::{ActiveEffect, find};
use deltatwin::model::bodies::*;
use deltatwin::model::{Bodies, Geometry, Inertia};
use deltatwin::recording::Payload;

/// Numbers of Table 3 on the geometry of the IRB 360-6/1600, no effects, no payload.
pub fn nominal_plant() -> Plant {
    let mut bodies = Bodies([Inertia::ZERO; BODIES]);
    for i in ARM..STRUT {
        bodies[i] = Inertia::diagonal(1.6, [0.176, 0.0, 0.006], [0.01, 0.258, 0.258]);
    }
    for i in STRUT..PLATFORM {
        bodies[i] = Inertia::diagonal(0.179, [0.076, 0.0, 0.0], [1.5e-5, 0.075, 0.075]);
    }
    bodies[PLATFORM] = Inertia::diagonal(1.2, [0.0, 0.0, -0.024], [0.002, 0.002, 0.003]);
    bodies[ROTOR] = Inertia::diagonal(0.5, [0.0; 3], [0.003, 0.003, 0.003]);
    bodies[TELESCOPE_UPPER] = Inertia::diagonal(0.922, [0.0, 0.0, -0.219], [0.084, 0.084, 1.9e-5]);
    bodies[TELESCOPE_LOWER] = Inertia::diagonal(0.557, [0.0, 0.0, 0.146], [0.077, 0.077, 3.0e-5]);
    Plant {
        geometry: Geometry {
            base_radius: 0.2,
            arm_length: 0.5,
            strut_length: [1.106; 3],
            platform_radius: 0.048,
            pair_distance: 0.1,
            mounting_height: 0.275,
            upper_hooke_height: 0.075,
            lower_hooke_height: 0.038,
            flange_height: -0.0625,
            arm_limits: [-0.703, 1.745],
            telescope_limits: [0.812, 1.372],
        },
        bodies: bodies.clone(),
        links: bodies,
        payload: Payload::default(),
        gravity: 9.81,
        spin_damping: 1000.0,
        assembled: true,
        effects: Vec::new(),
    }
}

/// Adds an effect by name.
pub fn with_effect(mut plant: Plant, name: &str, blocks: &[&[f64]]) -> Plant {
    plant.effects.push(ActiveEffect::new(find(name).expect("registered"), blocks));
    plant
}
