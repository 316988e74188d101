//! [`Plant`]: a model prepared for one run, with payload, geometry and total inertia.

use nalgebra::Vector3;

use std::sync::Arc;

use super::{ParamTable, inverse_dynamics};
use crate::effects::rigid_bodies::RigidBodies;
use crate::effects::{ActiveEffect, Host, Instant, Kind};
use crate::kinematics::{Closed, JointState, KinematicsError, Motion, Reactions, SocketSet, Twist};
use crate::machine::bodies::{ARM, Bodies, END_EFFECTOR, PLATFORM, ROTOR, SLOTS};
use crate::machine::{
    Configuration, Geometry, Inertia, LinkParameters, Load, Mechanism, Part, Payload, Setup, Stops, each,
};
use crate::model::Model;
use crate::recording::{Loads, Recording};

/// A machine in the configuration of one run.
#[derive(Clone)]
pub struct Plant {
    /// Kind of machine.
    pub mechanism: Mechanism,
    /// Properties of the machine on which effect parameters depend.
    pub host: Host,
    /// Geometry including the effects that change it.
    pub geometry: Geometry,
    /// Total inertia: links, payload and effects that change inertia.
    pub bodies: Bodies,
    /// Inertia of the links alone, the `rigid_bodies` parameters.
    pub links: Bodies,
    /// Which numbers of the links are parameters.
    pub link_parameters: LinkParameters,
    /// Load at the flange.
    pub payload: Payload,
    /// Known load of a single axis, where none was measured.
    pub load: Load,
    /// Loads that were measured along the motion.
    pub measured: Option<Arc<Loads>>,
    /// Gravitational acceleration, m/s².
    pub gravity: f64,
    /// Damping of the strut spins relative to the inertial frame, N·m·s/rad.
    pub spin_damping: f64,
    /// Hard stops.
    pub stops: Stops,
    /// Whether struts, platform and telescope are mounted.
    pub assembled: bool,
    /// Effects besides the rigid bodies, if the part they act on is mounted.
    pub effects: Vec<ActiveEffect>,
}

impl Plant {
    /// The machine of `model` in the configuration of `setup`.
    pub fn new(model: &Model, setup: &Setup) -> Self {
        let assembled = model.assembled && setup.configuration == Configuration::Assembled;
        let mounted = |a: &&ActiveEffect| model.mechanism.has(a.effect.acts_on(), assembled);
        let mut plant = Self {
            mechanism: model.mechanism,
            host: model.host(),
            geometry: model.geometry,
            bodies: model.bodies.clone(),
            links: model.bodies.clone(),
            link_parameters: model.link_parameters,
            payload: setup.payload,
            load: setup.load,
            measured: None,
            gravity: model.gravity,
            spin_damping: model.sockets.spin_damping,
            stops: model.stops,
            assembled,
            effects: model
                .effects
                .iter()
                .filter(mounted)
                .map(|a| ActiveEffect { host: model.host(), ..a.clone() })
                .collect(),
        };
        for active in &plant.effects {
            active.effect.geometry(&active.values(), &mut plant.geometry);
        }
        plant.sum_inertia();
        plant
    }

    /// Recomputes the total inertia from links, payload and effects.
    pub(crate) fn sum_inertia(&mut self) {
        let mut bodies = self.links.clone();
        bodies[END_EFFECTOR] += self.payload.inertia();
        if let (Mechanism::Axis(_), None) = (self.mechanism, &self.measured) {
            bodies[ARM] += Inertia::lone(self.load.inertia());
        }
        for active in &self.effects {
            active.effect.inertia(&active.values(), &self.payload, &mut |k, body, unit| {
                bodies[body] += unit * active.values[k];
            });
        }
        let (carrier, inertia) = self.carrier(END_EFFECTOR, bodies[END_EFFECTOR]);
        bodies[END_EFFECTOR] = Inertia::ZERO;
        bodies[carrier] += inertia;
        if self.mechanism.is_delta() && !self.mechanism.has_telescope() {
            // Placeholder for motor 4, which never moves here; keeps the mass matrix regular.
            bodies[ROTOR] = Inertia::diagonal(0.0, [0.0; 3], [1.0; 3]);
        }
        self.bodies = bodies;
    }

    /// The machine of `model` along a recording: in its setup, under the loads that were measured.
    pub fn along(model: &Model, recording: &Recording) -> Self {
        Self::new(model, &recording.setup).under(Loads::of(&recording.signals, &recording.signals.t).map(Arc::new))
    }

    /// The machine along a recording in which these loads were measured: they replace the load of the setup.
    pub fn under(mut self, measured: Option<Arc<Loads>>) -> Self {
        if measured.is_some() {
            self.measured = measured;
            self.sum_inertia();
        }
        self
    }

    /// Load L of a single axis at time `t` that is known, against positive motion, N·m or N; `None` if none is.
    pub fn known_load(&self, t: f64) -> Option<f64> {
        match (&self.measured, self.mechanism) {
            (Some(measured), Mechanism::Axis(_)) => measured.of_axis(t),
            (None, Mechanism::Axis(_)) => (!self.load.is_none()).then(|| self.load.at_rest()),
            (_, Mechanism::Delta { .. }) => None,
        }
    }

    /// Adds the wrench of the known loads at time `t`, −L on a single axis, a measured force on a robot's flange; returns
    /// its power, W.
    pub(crate) fn add_loads(&self, t: f64, motion: &Motion, wrenches: &mut [Twist; SLOTS]) -> f64 {
        if let Some(load) = self.known_load(t) {
            let (body, screw) = motion.drive(0);
            screw.push(&mut wrenches[body], -load);
            return -load * motion.qd[0];
        }
        match &self.measured {
            Some(measured) if self.assembled => {
                let force = measured.on_flange(t);
                wrenches[END_EFFECTOR].0 += force;
                force.dot(&motion.bodies[END_EFFECTOR].velocity)
            }
            _ => 0.0,
        }
    }

    /// The body that carries an inertia: without a telescope, and where the plate does not turn it, the end effector is part of
    /// the platform.
    pub(crate) fn carrier(&self, body: usize, inertia: Inertia) -> (usize, Inertia) {
        if body == END_EFFECTOR && !self.mechanism.has_end_effector() {
            (PLATFORM, inertia.seen_from(&Vector3::new(0.0, 0.0, self.geometry.flange_height)))
        } else {
            (body, inertia)
        }
    }

    /// All ball sockets.
    pub fn sockets(&self) -> SocketSet {
        SocketSet::of(self.mechanism.struts())
    }

    /// Whether it is an assembled robot with three limbs and one platform.
    pub fn is_closed_delta(&self) -> bool {
        self.assembled && self.mechanism.is_delta()
    }

    /// Whether the machine has `part`, mounted.
    pub fn has(&self, part: Part) -> bool {
        self.mechanism.has(part, self.assembled)
    }

    /// The inertia of the links as an effect.
    pub fn rigid_bodies(&self) -> ActiveEffect {
        let links = RigidBodies::with(self.mechanism, self.assembled, self.link_parameters);
        let mut rigid = ActiveEffect::absent_on(links.clone(), self.host);
        rigid.values = links.values(&self.links);
        rigid
    }

    /// Gravitational acceleration as a vector in the inertial frame, m/s².
    pub fn gravity_vector(&self) -> Vector3<f64> {
        Vector3::new(0.0, 0.0, -self.gravity)
    }

    /// Motion of all bodies for a joint motion.
    ///
    /// # Errors
    /// Those of [`Motion::assembled`]; none for a disassembled machine.
    pub fn motion(&self, joints: &JointState) -> Result<Motion, KinematicsError> {
        let mut motion = Motion::REST;
        self.set_motion(joints, &mut motion)?;
        Ok(motion)
    }

    /// Sets `motion` to the one that [`Self::motion`] returns; before, it was [`Motion::REST`] or one of this machine.
    ///
    /// # Errors
    /// As [`Self::motion`].
    #[inline]
    pub(crate) fn set_motion(&self, joints: &JointState, motion: &mut Motion) -> Result<(), KinematicsError> {
        self.set_motion_near(joints, None, motion).map(|_| ())
    }

    /// [`Self::set_motion`] in the assembly of the pose `near`, see [`Motion::assemble`]; returns the rates of plate and
    /// passive arms.
    ///
    /// # Errors
    /// As [`Self::motion`].
    #[inline]
    pub(crate) fn set_motion_near(
        &self,
        joints: &JointState,
        near: Option<&Closed>,
        motion: &mut Motion,
    ) -> Result<Closed, KinematicsError> {
        if self.assembled {
            return motion.assemble(&self.geometry, joints, near);
        }
        motion.place_arms(&self.geometry, joints);
        Ok(Closed::default())
    }

    /// The quantities that laws may depend on, without reactions and torques.
    pub(crate) fn instant<'a>(&'a self, t: f64, motion: &'a Motion, state: &'a [f64]) -> Instant<'a> {
        static NONE: Reactions = Reactions::ZERO;
        Instant {
            t,
            motion,
            geometry: &self.geometry,
            bodies: &self.bodies,
            payload: &self.payload,
            gravity: self.gravity,
            reactions: &NONE,
            state,
            torque: each(0.0),
            load: self.known_load(t),
            closed: self.sockets(),
        }
    }

    /// Internal states of every effect in equilibrium with a motion, for an instant without a past.
    pub fn steady_states(&self, t: f64, motion: &Motion) -> Vec<Vec<f64>> {
        let loaded = self.effects.iter().any(ActiveEffect::states_read_reactions);
        let reactions = if loaded { self.resting_reactions(t, motion) } else { Reactions::ZERO };
        let at = Instant { reactions: &reactions, ..self.instant(t, motion, &[]) };
        self.effects.iter().map(|active| active.steady_state(&at)).collect()
    }

    /// Strut forces of a motion with the initial states of all effects, N; zero where the pose is singular.
    pub(crate) fn resting_reactions(&self, t: f64, motion: &Motion) -> Reactions {
        let own: Vec<Vec<f64>> = self.effects.iter().map(ActiveEffect::initial_state).collect();
        self.reactions(t, motion, &own.iter().map(Vec::as_slice).collect::<Vec<_>>())
    }

    /// Strut forces of a motion with given states of all effects, N; zero where the pose is singular or a law fails, which
    /// the prediction there reports.
    pub(crate) fn reactions(&self, t: f64, motion: &Motion, states: &[&[f64]]) -> Reactions {
        inverse_dynamics(self, t, motion, states, true).map_or(Reactions::ZERO, |out| out.reactions)
    }

    /// Motion of the joints behind the encoders' motion, with the internal states of gears at rest.
    pub fn behind_encoders(&self, encoders: &JointState) -> JointState {
        let mut joints = *encoders;
        self.effects.iter().rev().for_each(|active| active.joint(&mut joints));
        joints
    }

    /// All parameters: rigid bodies first, then the effects in order.
    pub fn parameters(&self) -> ParamTable {
        ParamTable::new(std::iter::once(&self.rigid_bodies()).chain(&self.effects))
    }

    /// Whether an active effect changes the reported signals.
    pub fn observes(&self) -> bool {
        self.effects.iter().any(|a| a.effect.kind() == Kind::Sensor)
    }
}

/// Writes parameter values, in the order of [`Plant::parameters`] of the model's own configuration, into `model`.
///
/// For recordings of the disassembled robot, `model` must first be converted by [`in_configuration`].
///
/// # Panics
/// If the number of values differs from that of the parameters.
pub fn set_parameters(model: &mut Model, values: &[f64]) {
    let (mechanism, assembled) = (model.mechanism, model.assembled);
    let links = RigidBodies::with(mechanism, assembled, model.link_parameters);
    let (own, mut rest) = values.split_at(links.values(&model.bodies).len());
    links.set_values(&mut model.bodies, own);
    for active in model.effects.iter_mut().filter(|a| mechanism.has(a.effect.acts_on(), assembled)) {
        let (own, others) = rest.split_at(active.values.len());
        active.values.copy_from_slice(own);
        rest = others;
    }
    assert!(rest.is_empty(), "{} values too many", rest.len());
}

/// The model in the configuration of a run; effects on dismounted parts are kept, without action.
pub fn in_configuration(model: &Model, setup: &Setup) -> Model {
    Model { assembled: model.assembled && setup.configuration == Configuration::Assembled, ..model.clone() }
}
