//! Machines for unit tests, with the numbers of the shipped model files.

use super::{Meshes, Model};
use crate::effects::{ActiveEffect, Effects, find};
use crate::machine::bodies::{ARM, PLATFORM, ROTOR, SLOTS, STRUT, TELESCOPE_LOWER, TELESCOPE_UPPER};
use crate::machine::{Bodies, Drive, Inertia, Joint, LinkParameters, Mechanism, Noise, Sockets, Stops};

/// `models/irb360-6-1600.toml`: paper's identified model.
pub(crate) fn irb360() -> Model {
    robot(&[
        ("drive_friction", &[&[4.667, 4.376, 6.466], &[1.727, 2.064, 1.557], &[100.0]]),
        ("axis4_friction", &[&[0.5272], &[0.6672], &[8.5919]]),
        ("telescope_friction", &[&[1.641], &[1.247], &[100.0]]),
    ])
}

/// `models/irb360-6-1600-truth.toml`: friction of the disassembled drives and of the ball sockets.
pub(crate) fn irb360_truth() -> Model {
    robot(&[
        ("drive_friction", &[&[4.2, 4.1, 5.8], &[0.28, 0.42, 0.45], &[100.0]]),
        ("axis4_friction", &[&[0.5272], &[0.6672], &[8.5919]]),
        ("telescope_friction", &[&[1.641], &[1.247], &[100.0]]),
        ("ball_socket_viscous", &[&[0.3]]),
        ("ball_socket_coulomb", &[&[0.285], &[0.05]]),
    ])
}

/// The drive of `models/servo-axis.toml` on a slide without friction.
pub(crate) fn slide() -> Model {
    let mut model = robot(&[]);
    (model.name, model.mechanism, model.assembled) = ("slide".into(), Mechanism::axis(Joint::Prismatic), false);
    model.drives[0] = Drive {
        gear_ratio: 314.159265,
        encoder_bits: 17,
        max_torque: 600.0,
        max_speed: 1.0,
        max_acceleration: 20.0,
        max_jerk: 1000.0,
    };
    model
}

/// The robot of [Gnad 2024] with the given effects and their blocks of values.
fn robot(effects: &[(&str, &[&[f64]])]) -> Model {
    let arm = Drive {
        gear_ratio: 33.0,
        encoder_bits: 15,
        max_torque: 132.0,
        max_speed: 18.989,
        max_acceleration: 87.266,
        max_jerk: 1745.33,
    };
    let telescope = Drive { max_torque: 45.0, max_speed: 55.851, max_acceleration: 349.07, max_jerk: 6981.3, ..arm };
    let mut bodies = [Inertia::ZERO; SLOTS];
    bodies[ARM..STRUT].fill(Inertia::diagonal(1.6, [0.176, 0.0, 0.006], [0.1, 0.258, 0.258]));
    bodies[STRUT..PLATFORM].fill(Inertia::diagonal(0.179, [0.076, 0.0, 0.0], [1.5e-5, 0.075, 0.075]));
    bodies[PLATFORM] = Inertia::diagonal(1.2, [0.0, 0.0, -0.024], [0.005, 0.005, 0.006]);
    bodies[ROTOR] = Inertia::diagonal(1.0, [0.0; 3], [0.003; 3]);
    bodies[TELESCOPE_UPPER] = Inertia::diagonal(0.922, [0.0, 0.0, -0.219], [0.084, 0.084, 1.9e-5]);
    bodies[TELESCOPE_LOWER] = Inertia::diagonal(0.557, [0.0, 0.0, 0.146], [0.077, 0.077, 3e-5]);
    let active =
        |(name, blocks): &(&str, &[&[f64]])| ActiveEffect::new(find(name).expect("an effect of the registry"), blocks);
    let mut model = Model {
        name: "irb360-6-1600".into(),
        path: None,
        source: None,
        mechanism: Mechanism::default(),
        assembled: true,
        geometry: crate::machine::testing::geometry(),
        bodies: Bodies(bodies),
        link_parameters: LinkParameters::default(),
        drives: [arm, arm, arm, telescope],
        sockets: Sockets {
            ball_radius: 0.0095,
            preload: 200.0,
            dislocation_force: 200.0,
            clamp_share: 0.0,
            spin_damping: 1000.0,
        },
        stops: Stops {
            arm: [-0.805, 1.847],
            arm_stiffness: 2e4,
            arm_damping: 0.05,
            hooke: 1.05,
            hooke_stiffness: 2e3,
            hooke_damping: 0.05,
            telescope_stiffness: 1e5,
            telescope_damping: 0.3,
        },
        noise: Noise { torque: [0.5, 0.5, 0.5, 0.05], strut_force: 0.5 },
        gravity: 9.81,
        sample_time: 400e-6,
        effects: Effects::default(),
        history: Vec::new(),
        meshes: Meshes::default(),
    };
    let host = model.host();
    model.effects = effects.iter().map(|effect| ActiveEffect { host, ..active(effect) }).collect();
    model
}
