//! What the demo hides, and how wrong its model is to begin with.

use rand::RngExt;
use rand::seq::IndexedRandom;
use rand_chacha::ChaCha8Rng;

use super::DemoError;
use crate::effects::rigid_bodies::RigidBodies;
use crate::effects::{self, ActiveEffect, Role, find};
use crate::model::Model;

/// A hidden effect, or none.
#[derive(Clone)]
pub struct Hidden {
    /// The effect with its values.
    pub active: Option<ActiveEffect>,
}

/// An effect that can be hidden with the magnitudes it is drawn from: per parameter the range and whether the sign is
/// random. Chosen so that the refitted torque or strut-force residual rises visibly.
struct Drawer {
    name: &'static str,
    draw: fn(&mut ChaCha8Rng) -> Vec<Vec<f64>>,
}

fn between(rng: &mut ChaCha8Rng, low: f64, high: f64) -> f64 {
    rng.random_range(low..high)
}

fn either(rng: &mut ChaCha8Rng, low: f64, high: f64) -> f64 {
    let sign = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
    sign * rng.random_range(low..high)
}

fn three(rng: &mut ChaCha8Rng, draw: fn(&mut ChaCha8Rng, f64, f64) -> f64, low: f64, high: f64) -> Vec<f64> {
    (0..3).map(|_| draw(rng, low, high)).collect()
}

const DRAWERS: &[Drawer] = &[
    Drawer { name: "ball_socket_viscous", draw: |r| vec![vec![between(r, 0.1, 0.45)]] },
    Drawer { name: "ball_socket_coulomb", draw: |r| vec![vec![between(r, 0.12, 0.5)], vec![0.05]] },
    Drawer {
        name: "ball_socket_load_dependent",
        draw: |r| vec![vec![between(r, 0.15, 0.5)], vec![0.0095], vec![0.05]],
    },
    Drawer {
        name: "drive_stribeck",
        draw: |r| vec![three(r, between, 0.8, 2.0), vec![between(r, 0.08, 0.25)], vec![100.0]],
    },
    Drawer { name: "drive_coulomb_asymmetry", draw: |r| vec![three(r, either, 0.3, 1.0), vec![100.0]] },
    Drawer {
        name: "thermal_friction_drift",
        draw: |r| {
            vec![three(r, between, 0.5, 1.2), three(r, between, 0.3, 0.9), vec![between(r, 4.0, 12.0)], vec![100.0]]
        },
    },
    Drawer {
        name: "torque_ripple",
        draw: |r| {
            let mut blocks: Vec<Vec<f64>> = (0..4).map(|_| three(r, either, 0.15, 0.6)).collect();
            blocks.push(vec![33.0]);
            blocks
        },
    },
    Drawer { name: "payload_mass_error", draw: |r| vec![vec![either(r, 0.15, 0.4)]] },
    Drawer {
        name: "strut_length_error",
        draw: |r| {
            let limb = r.random_range(0..3);
            let error = either(r, 0.004, 0.01);
            vec![(0..3).map(|i| if i == limb { error } else { 0.0 }).collect()]
        },
    },
    Drawer { name: "base_tilt", draw: |r| vec![vec![either(r, 0.006, 0.015), either(r, 0.006, 0.015)]] },
    Drawer {
        name: "torque_gain_error",
        draw: |r| {
            let axis = r.random_range(0..3);
            let gain = either(r, 0.04, 0.1);
            vec![(0..4).map(|i| if i == axis { gain } else { 0.0 }).collect()]
        },
    },
    Drawer { name: "signal_delay", draw: |r| vec![vec![between(r, 0.001, 0.004)]] },
];

impl Hidden {
    /// Draws an effect and its magnitude; `name` fixes the effect (`none` hides nothing).
    pub fn draw(name: Option<&str>, rng: &mut ChaCha8Rng) -> Result<Self, DemoError> {
        let drawer = match name {
            Some("none") => return Ok(Self { active: None }),
            Some(name) => DRAWERS.iter().find(|d| d.name == name),
            None => DRAWERS.choose(rng),
        };
        let active = match (drawer, name) {
            (Some(drawer), _) => {
                let values = (drawer.draw)(rng);
                let blocks: Vec<&[f64]> = values.iter().map(Vec::as_slice).collect();
                ActiveEffect::new(find(drawer.name).expect("registered effects only"), &blocks)
            }
            (None, Some(name)) => usual(name, rng)?,
            (None, None) => return Ok(Self { active: None }),
        };
        Ok(Self { active: Some(active) })
    }

    /// Name of the effect, `none` without one.
    pub fn name(&self) -> &'static str {
        self.active.as_ref().map_or("none", |a| a.effect.name())
    }

    /// The effect's values in words.
    pub fn describe(&self) -> String {
        let Some(active) = &self.active else { return "nothing".into() };
        let values: Vec<String> = active
            .entries()
            .iter()
            .zip(&active.values)
            .filter(|(e, _)| e.parameter.role != Role::Fixed)
            .map(|(e, v)| format!("{} = {v:.4} {}", e.name, e.parameter.unit))
            .collect();
        format!("{}: {}", active.effect.name(), values.join(", "))
    }
}

/// An effect without a range of its own: half to twice its usual magnitude.
fn usual(name: &str, rng: &mut ChaCha8Rng) -> Result<ActiveEffect, DemoError> {
    let known = || effects::REGISTRY.iter().map(|e| e.name()).filter(|n| !CARRIED.contains(n)).collect();
    let effect = find(name).filter(|e| !CARRIED.contains(&e.name()));
    let effect = effect.ok_or_else(|| DemoError::Effect { name: name.into(), known: known() })?;
    let mut active = ActiveEffect::absent(effect);
    let entries = active.entries();
    for (value, entry) in active.values.iter_mut().zip(&entries) {
        let p = entry.parameter;
        if p.role == Role::Linear {
            let drawn = if p.range.0 < 0.0 { either(rng, 0.5, 2.0) } else { between(rng, 0.5, 2.0) };
            *value = (drawn * p.default).clamp(p.range.0, p.range.1);
        }
    }
    Ok(active)
}

/// Effects the demo's model has from the start, and the one that has no law until the user writes it.
const CARRIED: [&str; 5] = ["rigid_bodies", "drive_friction", "axis4_friction", "telescope_friction", "formula"];

/// Moves inertia by up to ±3 % and friction by up to ±5 %, as a real machine departs from its data sheet.
pub fn perturb(model: &mut Model, rng: &mut ChaCha8Rng) {
    let bodies = RigidBodies::of(model.mechanism, model.assembled);
    let mut links: Vec<f64> = bodies.values(&model.bodies);
    for x in &mut links {
        *x *= 1.0 + rng.random_range(-0.03..0.03);
    }
    bodies.set_values(&mut model.bodies, &links);
    for active in &mut model.effects {
        let entries = active.entries();
        for (x, entry) in active.values.iter_mut().zip(entries) {
            if entry.parameter.role != Role::Fixed {
                *x *= 1.0 + rng.random_range(-0.05..0.05);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::rand_core::SeedableRng;

    #[test]
    fn everything_that_can_be_hidden_can_be_drawn_and_lies_in_its_range() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        for effect in effects::REGISTRY.iter().filter(|e| !CARRIED.contains(&e.name())) {
            let hidden = Hidden::draw(Some(effect.name()), &mut rng).unwrap();
            let active = hidden.active.unwrap();
            for (entry, value) in active.entries().iter().zip(&active.values) {
                let (low, high) = entry.parameter.range;
                assert!((low..=high).contains(value), "{} {} = {value}", effect.name(), entry.name);
            }
        }
    }
}
