//! Options of a run of the twin.

use std::sync::Arc;

use super::{Clamps, Event, Frame, Gains, NewContacts};
use crate::cell::Object;
use crate::model::Model;
use crate::scenario::{self, Action, Formulation, HoldTorque, PayloadShape, Scenario, Supervision};

/// Options of a run.
#[derive(Clone, Debug)]
pub struct Options {
    /// Duration of the run, s.
    pub duration: f64,
    /// Integration steps per sample time.
    pub substeps: usize,
    /// Sample times per control period.
    pub control_period: usize,
    /// Torque between two control instants.
    pub hold_torque: HoldTorque,
    /// Formulation of the equations of motion.
    pub formulation: Formulation,
    /// Seed of the sensor noise; `None` switches noise and quantisation off.
    pub noise_seed: Option<u64>,
    /// Recorded channels.
    pub sensors: scenario::Sensors,
    /// Controller gains; if `None`, [`Gains::of`] the simulated machine.
    pub gains: Option<Gains>,
    /// Ball sockets; `None` means healthy ones whose margins are only reported.
    pub clamps: Option<Clamps>,
    /// Conditions under which the drives trip.
    pub supervision: Supervision,
    /// Objects around the robot.
    pub objects: Vec<Object>,
    /// Shape of the payload.
    pub payload_shape: Option<PayloadShape>,
    /// Actions of the gripper, in order of time.
    pub actions: Vec<Action>,
    /// Constructor of the contact solver, used if there are objects or if sockets may dislocate. Without one there are
    /// no contacts, and objects are an error.
    pub contacts: Option<NewContacts>,
    /// Interval at which the poses of all bodies and objects are kept, s; `None` keeps none.
    pub frames: Option<f64>,
    /// Observer of the run.
    pub watcher: Option<Watcher>,
    /// Factor on the steps during contacts, 1 for full accuracy.
    pub contact_steps: f64,
    /// Time after which a broken robot is followed on once its load has landed on an object, s; `None` follows it to the
    /// end of the run.
    pub after_landing: Option<f64>,
    /// Whether [`Report::trace`](super::Report::trace) is kept.
    pub trace: bool,
}

type See = dyn Fn(Option<&Frame>, &[Event]) + Send + Sync;

/// Observer of a run in progress.
#[derive(Clone)]
pub struct Watcher {
    /// Time between frames, s; [`Options::frames`] takes precedence.
    pub spacing: f64,
    see: Arc<See>,
}

impl Watcher {
    /// Calls `see` with a frame every `spacing` s and the events since the previous call; the run is blocked meanwhile.
    /// The last call has no frame.
    pub fn new(spacing: f64, see: impl Fn(Option<&Frame>, &[Event]) + Send + Sync + 'static) -> Self {
        Self { spacing, see: Arc::new(see) }
    }

    /// Passes a frame and events on.
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
            gains: None,
            clamps: None,
            supervision: Supervision::default(),
            objects: Vec::new(),
            payload_shape: None,
            actions: Vec::new(),
            contacts: None,
            frames: None,
            watcher: None,
            contact_steps: 1.0,
            after_landing: None,
            trace: false,
        }
    }
}

impl Options {
    /// Options of `scenario` for a machine like `model`, without a contact solver.
    pub fn of(scenario: &Scenario, model: &Model) -> Self {
        let gains = Gains::of(model);
        Self {
            duration: scenario.duration,
            substeps: scenario.substeps.unwrap_or(scenario::SUBSTEPS),
            control_period: scenario.control_period,
            hold_torque: scenario.hold_torque,
            formulation: scenario.formulation,
            noise_seed: scenario.noise.then_some(scenario.seed),
            sensors: scenario.sensors,
            gains: Some(Gains {
                proportional: scenario.gains.proportional.unwrap_or(gains.proportional),
                derivative: scenario.gains.derivative.unwrap_or(gains.derivative),
                cutoff: scenario.gains.cutoff.unwrap_or(gains.cutoff),
            }),
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
            contact_steps: 1.0,
            after_landing: None,
            trace: false,
        }
    }
}
