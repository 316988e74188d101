//! [`Plant`]: a model made concrete for one run, with payload, geometry and all inertia in place.

use nalgebra::Vector3;

use crate::effects::{self, ActiveEffect, Kind, Role};
use crate::kinematics::{JointState, KinematicsError, Motion};
use crate::model::bodies::{Bodies, END_EFFECTOR};
use crate::model::{Geometry, Model};
use crate::recording::{Payload, Setup};

/// A machine ready to compute with.
#[derive(Clone)]
pub struct Plant {
    /// Geometry after all effects on it.
    pub geometry: Geometry,
    /// Total inertia: links, payload and effects on inertia.
    pub bodies: Bodies,
    /// Inertia of the links alone, the `rigid_bodies` parameters.
    pub links: Bodies,
    /// Load at the flange.
    pub payload: Payload,
    /// Gravitational acceleration, m/s².
    pub gravity: f64,
    /// Damping of the strut spins against the frame, N·m·s/rad.
    pub spin_damping: f64,
    /// Whether struts, platform and telescope are mounted.
    pub assembled: bool,
    /// Effects beyond the rigid bodies.
    pub effects: Vec<ActiveEffect>,
}

/// A parameter of a plant.
#[derive(Clone, Debug)]
pub struct PlantParameter {
    /// Printed name, e.g. `drive_friction.coulomb_1`.
    pub name: String,
    /// Name of its effect.
    pub effect: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// Flat index within its effect.
    pub index: usize,
    /// How it enters.
    pub role: Role,
    /// Present value.
    pub value: f64,
    /// Usual magnitude.
    pub usual: f64,
    /// Allowed values.
    pub range: (f64, f64),
}

impl Plant {
    /// The machine of `model` in the state that `setup` describes.
    pub fn new(model: &Model, setup: &Setup) -> Self {
        let mut plant = Self {
            geometry: model.geometry,
            bodies: model.bodies.clone(),
            links: model.bodies.clone(),
            payload: setup.payload,
            gravity: model.gravity,
            spin_damping: model.sockets.spin_damping,
            assembled: model.assembled && setup.configuration == crate::recording::Configuration::Assembled,
            effects: model.effects.clone(),
        };
        for active in &model.effects {
            active.effect.geometry(&active.values(), &mut plant.geometry);
        }
        plant.sum_inertia();
        plant
    }

    /// Brings the bodies up to date with the effects.
    pub(crate) fn sum_inertia(&mut self) {
        self.bodies = self.links.clone();
        self.bodies[END_EFFECTOR] += self.payload.inertia();
        for active in &self.effects {
            let bodies = &mut self.bodies;
            active.effect.inertia(&active.values(), &self.payload, &mut |k, body, unit| {
                bodies[body] += unit * active.values[k];
            });
        }
    }

    /// The inertia of the links as an effect.
    pub fn rigid_bodies(&self) -> ActiveEffect {
        let mut rigid = ActiveEffect::absent(&effects::rigid_bodies::RigidBodies);
        rigid.values = effects::rigid_bodies::values(&self.links);
        rigid
    }

    /// Gravity as an acceleration vector.
    pub fn gravity_vector(&self) -> Vector3<f64> {
        Vector3::new(0.0, 0.0, -self.gravity)
    }

    /// Complete motion of the bodies for joint motion.
    pub fn motion(&self, joints: &JointState) -> Result<Motion, KinematicsError> {
        if self.assembled {
            Motion::assembled(&self.geometry, joints)
        } else {
            Ok(Motion::disassembled(&self.geometry, joints))
        }
    }

    /// All parameters: rigid bodies first, then the effects in order.
    pub fn parameters(&self) -> Vec<PlantParameter> {
        let rigid = self.rigid_bodies();
        std::iter::once(&rigid)
            .chain(&self.effects)
            .flat_map(|active| {
                active.entries().into_iter().enumerate().map(|(index, entry)| PlantParameter {
                    name: format!("{}.{}", active.effect.name(), entry.name),
                    effect: active.effect.name(),
                    unit: entry.parameter.unit,
                    index,
                    role: entry.parameter.role,
                    value: active.values[index],
                    usual: entry.parameter.default.abs(),
                    range: entry.parameter.range,
                })
            })
            .collect()
    }

    /// Whether any active effect of the plant changes reported signals.
    pub fn observes(&self) -> bool {
        self.effects.iter().any(|a| a.effect.kind() == Kind::Sensor)
    }
}

/// Writes parameter values, in the order of [`Plant::parameters`], into a model.
pub fn set_parameters(model: &mut Model, values: &[f64]) {
    let n = effects::rigid_bodies::PARAMETERS.len();
    effects::rigid_bodies::set_values(&mut model.bodies, &values[..n]);
    let mut at = n;
    for active in &mut model.effects {
        let m = active.values.len();
        active.values.copy_from_slice(&values[at..at + m]);
        at += m;
    }
}
