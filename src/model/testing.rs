//! Shipped models for unit tests.

use std::path::Path;

use super::{Added, Meshes, Model};
use crate::effects::{ActiveEffect, Effects, find};
use crate::machine::{
    Actuator, Bodies, Drive, Geometry, Inertia, Joint, LinkParameters, Mechanism, Noise, Sockets, Stops,
};

/// A struct of this crate built from one with the same fields.
macro_rules! copy {
    ($name:ident { $($field:ident),* $(,)? } of $from:expr) => {
        $name { $($field: $from.$field),* }
    };
}

/// The geometry as read, whose type is another one.
macro_rules! geometry {
    ($from:expr) => {{
        let text = format!("{:?}", $from.arms);
        let inclination = text.split([':', '}']).nth(1).and_then(|number| number.trim().parse().ok());
        Geometry {
            arms: inclination.map_or(Actuator::Revolute, |inclination| Actuator::Prismatic { inclination }),
            base_radius: $from.base_radius,
            arm_length: $from.arm_length,
            strut_length: $from.strut_length,
            platform_radius: $from.platform_radius,
            pair_distance: $from.pair_distance,
            mounting_height: $from.mounting_height,
            upper_hooke_height: $from.upper_hooke_height,
            lower_hooke_height: $from.lower_hooke_height,
            flange_height: $from.flange_height,
            arm_limits: $from.arm_limits,
            telescope_limits: $from.telescope_limits,
        }
    }};
}

/// The model in `models/<name>.toml`.
///
/// The reader links the library as other crates do, not as built for unit tests: its types are distinct types of the
/// same names, from which every field is copied.
pub(crate) fn shipped(name: &str) -> Model {
    let read = deltatwin_io::model::read(Path::new(&format!("models/{name}.toml"))).expect("a shipped model");
    let mechanism = match (read.mechanism.arms(), format!("{:?}", read.mechanism).as_str()) {
        (1, text) if text.contains("Revolute") => Mechanism::axis(Joint::Revolute),
        (1, _) => Mechanism::axis(Joint::Prismatic),
        (_, text) if text.contains("Prismatic") => Mechanism::LINEAR_DELTA,
        _ => Mechanism::delta(read.mechanism.has_telescope()),
    };
    let mut model = Model {
        name: read.name.clone(),
        path: read.path.clone(),
        source: read.source.clone(),
        mechanism,
        assembled: read.assembled,
        geometry: geometry!(read.geometry),
        bodies: Bodies(read.bodies.0.map(|b| copy!(Inertia { mass, first_moment, tensor } of b))),
        link_parameters: LinkParameters::default(),
        drives: read
            .drives
            .map(|d| copy!(Drive { gear_ratio, encoder_bits, max_torque, max_speed, max_acceleration, max_jerk } of d)),
        sockets: copy!(Sockets { ball_radius, preload, dislocation_force, clamp_share, spin_damping } of read.sockets),
        stops: copy!(Stops {
            arm,
            arm_stiffness,
            arm_damping,
            hooke,
            hooke_stiffness,
            hooke_damping,
            telescope_stiffness,
            telescope_damping,
        } of read.stops),
        noise: copy!(Noise { torque, strut_force } of read.noise),
        gravity: read.gravity,
        sample_time: read.sample_time,
        effects: Effects::default(),
        history: read
            .history
            .iter()
            .map(|a| copy!(Added { effect, channels, rms_before, rms_after, noise_floor, held_out } of a.clone()))
            .collect(),
        meshes: Meshes::default(),
    };
    let host = model.host();
    model.effects = read
        .effects
        .iter()
        .map(|a| {
            let blocks: Vec<&[f64]> = (0..a.effect.parameters().len()).map(|b| a.values().block(b)).collect();
            let effect = find(a.effect.name()).expect("an effect of the registry");
            ActiveEffect { host, ..ActiveEffect::new(effect, &blocks) }
        })
        .collect();
    model
}
