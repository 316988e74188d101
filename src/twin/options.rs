//! How a run of the twin is made.

use std::sync::Arc;

use super::{Clamps, Event, Frame, Gains, NewContacts};
use crate::cell::Object;
use crate::model::Model;
use crate::scenario::{self, Action, Formulation, HoldTorque, PayloadShape, Scenario, Supervision};

/// How a run is made.
#[derive(Clone, Debug)]
pub struct Options {
    /// Length of the run, s.
    pub duration: f64,
    /// Integration steps per sample time.
    pub substeps: usize,
    /// Sample times per control period.
    pub control_period: usize,
    /// Torque between two control instants.
    pub hold_torque: HoldTorque,
    /// How the equations of motion are solved.
    pub formulation: Formulation,
    /// Seed of the sensor noise; `None` switches noise and quantisation off.
    pub noise_seed: Option<u64>,
    /// What is recorded.
    pub sensors: scenario::Sensors,
    /// Controller gains.
    pub gains: Gains,
    /// Ball sockets; healthy and only watched without.
    pub clamps: Option<Clamps>,
    /// When the drives trip.
    pub supervision: Supervision,
    /// Things around the robot.
    pub objects: Vec<Object>,
    /// Shape of the payload.
    pub payload_shape: Option<PayloadShape>,
    /// What the gripper does, in order of time.
    pub actions: Vec<Action>,
    /// What solves contacts where there are objects or sockets may leave their balls. Without it nothing touches, and
    /// objects are refused.
    pub contacts: Option<NewContacts>,
    /// Keep the poses of all bodies and objects every so many seconds.
    pub frames: Option<f64>,
    /// Who looks on.
    pub watcher: Option<Watcher>,
}

type See = dyn Fn(Option<&Frame>, &[Event]) + Send + Sync;

/// Sees a run while it goes on.
#[derive(Clone)]
pub struct Watcher {
    /// Time between frames, s; [`Options::frames`] comes before it.
    pub spacing: f64,
    see: Arc<See>,
}

impl Watcher {
    /// Calls `see` with a frame every `spacing` s and the events since the call before; the run waits for it. The last
    /// call has no frame.
    pub fn new(spacing: f64, see: impl Fn(Option<&Frame>, &[Event]) + Send + Sync + 'static) -> Self {
        Self { spacing, see: Arc::new(see) }
    }

    /// Shows it a frame and events.
    pub fn see(&self, frame: Option<&Frame>, events: &[Event]) {
        (self.see)(frame, events);
    }
}

impl std::fmt::Debug for Watcher {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Watcher").field("spacing", &self.spacing).finish_non_exhaustive()
    }
}

impl Default for Options {
    fn default() -> Self {
        Self {
            duration: 20.0,
            substeps: 1,
            control_period: 1,
            hold_torque: HoldTorque::Ramp,
            formulation: Formulation::default(),
            noise_seed: Some(0),
            sensors: scenario::Sensors::default(),
            gains: Gains::default(),
            clamps: None,
            supervision: Supervision::default(),
            objects: Vec::new(),
            payload_shape: None,
            actions: Vec::new(),
            contacts: None,
            frames: None,
            watcher: None,
        }
    }
}

impl Options {
    /// As `scenario` says, for a machine like `model`, still without what solves contacts.
    pub fn of(scenario: &Scenario, model: &Model) -> Self {
        let gains = Gains::of(model);
        Self {
            duration: scenario.duration,
            substeps: scenario.substeps,
            control_period: scenario.control_period,
            hold_torque: scenario.hold_torque,
            formulation: scenario.formulation,
            noise_seed: scenario.noise.then_some(scenario.seed),
            sensors: scenario.sensors,
            gains: Gains {
                proportional: scenario.gains.proportional.unwrap_or(gains.proportional),
                derivative: scenario.gains.derivative.unwrap_or(gains.derivative),
                cutoff: scenario.gains.cutoff.unwrap_or(gains.cutoff),
            },
            clamps: Some(Clamps {
                hold: scenario.socket_holds(model),
                preload: scenario.socket_preloads(model),
                share: model.sockets.clamp_share,
                armed: scenario.sockets.armed,
            }),
            supervision: scenario.supervision,
            objects: scenario.objects.clone(),
            payload_shape: scenario.payload_shape.clone(),
            actions: scenario.actions.clone(),
            contacts: None,
            frames: None,
            watcher: None,
        }
    }
}
