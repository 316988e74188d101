//! Effects switched on for a machine.

use std::sync::Arc;

use super::{Count, Effects, Instant, InternalStates, Layout, Param, Parameter, Role, Values};
use crate::effects::{Effect, GearSpring, StrutSpring};
use crate::kinematics::JointState;
use crate::machine::{Bodies, Drive, Geometry, Joint, Mechanism, Part, PerAxis, PerStrut, Sockets};
use crate::recording::Signals;

/// Properties of a machine on which the parameters of effects depend: their number, units and typical magnitudes, the
/// latter stated for an arm drive of the IRB 360.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Host {
    /// Kind of machine.
    pub mechanism: Mechanism,
    /// Torque (or force) limit of its drives relative to the reference drive.
    torque: f64,
    /// Speed limit of its drives relative to the reference drive.
    speed: f64,
}

/// Data of a machine from which effects derive their constants.
#[derive(Clone, Copy)]
pub struct MachineView<'a> {
    /// Kind of machine.
    pub mechanism: Mechanism,
    /// Lengths and joint limits.
    pub geometry: &'a Geometry,
    /// Inertia of every body, without payload.
    pub bodies: &'a Bodies,
    /// Drives 1–3 (arms) and 4 (telescope).
    pub drives: &'a PerAxis<Drive>,
    /// Ball sockets.
    pub sockets: &'a Sockets,
    /// Active effects.
    pub effects: &'a Effects,
}

impl MachineView<'_> {
    /// Size of the mechanism relative to the reference machine, by the strut length of the first limb.
    pub fn size(&self) -> f64 {
        self.geometry.limbs[0].strut_length / STRUT
    }
}

/// Strut length of the reference machine, m.
const STRUT: f64 = 1.106;
/// Torque (N·m) and speed limit (rad/s) of the reference arm drive.
const STATED: (f64, f64) = (132.0, 18.989);
/// Friction of the telescope drive relative to an arm drive: 0.53 N·m to 4.7 N·m ([Gnad 2024], Tables 2 and 4).
const TELESCOPE_DRIVE: f64 = 0.11;

/// Factors on the lower and upper end of a range on a lone axis. Its range follows from limits of torque and speed that
/// are often estimates, so it is widened: by a factor of 100 for coefficients and of 30 for other numbers.
fn wider(role: Role) -> (f64, f64) {
    match role {
        Role::Linear => (1e-2, 1e2),
        Role::Shape | Role::Fixed => (1.0 / 30.0, 30.0),
    }
}

impl Default for Host {
    fn default() -> Self {
        Self { mechanism: Mechanism::default(), torque: 1.0, speed: 1.0 }
    }
}

impl Host {
    /// Properties of a machine with drives like `drive`; every delta robot of three limbs whose arms turn counts
    /// as the reference machine.
    pub fn new(mechanism: Mechanism, drive: &Drive) -> Self {
        let (torque, speed) = match mechanism {
            Mechanism::Delta { arms: Joint::Revolute, .. } if mechanism.is_delta() => (1.0, 1.0),
            Mechanism::Delta { .. } | Mechanism::Axis(_) => (drive.max_torque / STATED.0, drive.max_speed / STATED.1),
        };
        Self { mechanism, torque, speed }
    }

    /// `parameter` of an effect on `part` with unit, typical magnitude and range converted to this machine.
    pub fn parameter(&self, part: Part, parameter: &Parameter) -> Parameter {
        let unit = self.mechanism.unit_on(part, parameter.unit);
        let of_drives = matches!(self.mechanism, Mechanism::Axis(_)) || part == Part::Drives;
        let factor = if of_drives { unit.scale(self.torque, self.speed) } else { 1.0 };
        let (low, high) = parameter.range;
        let (narrower, wider) = match self.mechanism {
            Mechanism::Axis(_) if unit.has_dimension() => wider(parameter.role),
            delta if delta.has_carriages() && of_drives && unit.has_dimension() => wider(parameter.role),
            _ => (1.0, 1.0),
        };
        // Away from zero, and for lower limits of positive numbers towards it.
        let least = if low > 0.0 { narrower } else { wider };
        Parameter {
            unit,
            default: factor * parameter.default,
            range: (factor * low * least, factor * high * wider),
            ..parameter.clone()
        }
    }
}

/// An effect that is switched on, with its parameter values.
#[derive(Clone)]
pub struct ActiveEffect {
    /// Properties of the machine.
    pub host: Host,
    /// The law.
    pub effect: Arc<dyn Effect>,
    /// Flat parameter values, in the units of `host`.
    pub values: Vec<f64>,
    /// Position of each parameter in `values`.
    pub layout: Arc<Layout>,
}

impl ActiveEffect {
    /// `effect` on the four-axis robot with default shape parameters and zero linear parameters, hence without action.
    pub fn absent(effect: Arc<dyn Effect>) -> Self {
        Self::absent_on(effect, Host::default())
    }

    /// [`Self::absent`] on another machine.
    pub fn absent_on(effect: Arc<dyn Effect>, host: Host) -> Self {
        let (values, layout) = default_values(&*effect, host);
        Self { host, effect, values, layout: Arc::new(layout) }
    }

    /// The effect with its linear parameters set to their typical magnitudes.
    pub fn at_nominal_size(&self) -> Self {
        let mut usual = self.clone();
        for (value, entry) in usual.values.iter_mut().zip(self.entries()) {
            if entry.parameter.role == Role::Linear {
                *value = entry.parameter.default;
            }
        }
        usual
    }

    /// Whether the effect makes gears elastic, at its typical magnitude if it is absent.
    pub fn has_gears(&self) -> bool {
        self.at_nominal_size().gear_springs().is_some()
    }

    /// `effect` on the four-axis robot, with one slice of values per parameter.
    ///
    /// # Panics
    /// If the number of blocks differs from the number of parameters.
    pub fn new(effect: Arc<dyn Effect>, blocks: &[&[f64]]) -> Self {
        assert_eq!(blocks.len(), effect.parameters().len(), "{}: one block per parameter", effect.name());
        let layout = Layout::new(blocks.iter().map(|b| b.len()));
        Self { host: Host::default(), effect, values: blocks.concat(), layout: Arc::new(layout) }
    }

    /// Values by parameter.
    pub fn values(&self) -> Values<'_> {
        Values::new(&self.values, &self.layout).on(self.host.mechanism)
    }

    /// Number of internal states.
    pub fn states(&self) -> usize {
        self.initial_state().len()
    }

    /// Initial internal states; empty without any.
    pub fn initial_state(&self) -> Vec<f64> {
        self.effect.states().map_or_else(Vec::new, |own| own.initial_state(&self.values()))
    }

    /// Whether the internal states depend on strut forces, see [`InternalStates::reads_reactions`].
    pub fn states_read_reactions(&self) -> bool {
        self.effect.states().is_some_and(InternalStates::reads_reactions) && self.states() > 0
    }

    /// Internal states in equilibrium with the motion at an instant, see [`InternalStates::steady_state`].
    pub fn steady_state(&self, at: &Instant) -> Vec<f64> {
        self.effect.states().map_or_else(Vec::new, |own| own.steady_state(&self.values(), at))
    }

    /// Internal states after a step along a measured motion, see [`InternalStates::step_along`].
    pub fn step_along(&self, from: &Instant, to: &Instant) -> Option<Vec<f64>> {
        self.effect.states()?.step_along(&self.values(), from, to)
    }

    /// Writes the time derivative of the internal states, see [`InternalStates::state_rate`].
    pub fn state_rate(&self, at: &Instant, rate: &mut [f64], slope: &mut [f64]) {
        if let Some(own) = self.effect.states() {
            own.state_rate(&self.values(), at, rate, slope);
        }
    }

    /// Turns joint angles into encoder readings, rad.
    pub fn encoder(&self, state: &[f64], angles: &mut PerAxis<f64>) {
        if let Some(sensor) = self.effect.sensor() {
            sensor.encoder(&self.values(), state, angles);
        }
    }

    /// Turns the motion of the encoders into that of the joints, with the internal states at rest.
    pub fn joint(&self, motion: &mut JointState) {
        if let Some(sensor) = self.effect.sensor() {
            sensor.joint(&self.values(), motion);
        }
    }

    /// Applies the sensor errors to the reported signals.
    pub fn observe(&self, signals: &mut Signals) {
        if let Some(sensor) = self.effect.sensor() {
            sensor.observe(&self.values(), signals);
        }
    }

    /// Time (s) over which earlier signals enter a reported one, beyond a few samples.
    pub fn sensor_memory(&self) -> f64 {
        self.effect.sensor().map_or(0.0, |sensor| sensor.memory(&self.values()))
    }

    /// Time (s) before and after an instant whose ideal signals enter the reported ones of that instant.
    pub fn sensor_reach(&self) -> [f64; 2] {
        self.effect.sensor().map_or([0.0; 2], |sensor| sensor.reach(&self.values()))
    }

    /// Whether earlier or later signals enter the reported ones.
    pub fn shifts_time(&self) -> bool {
        self.sensor_memory() > 0.0 || self.sensor_reach() != [0.0; 2]
    }

    /// Elastic gears between encoder and joint; `None` if there are none.
    pub fn gear_springs(&self) -> Option<PerAxis<GearSpring>> {
        self.effect.compliance()?.gear_springs(&self.values())
    }

    /// Axial spring and damper of each strut; `None` if the struts are rigid.
    pub fn strut_spring(&self) -> Option<PerStrut<StrutSpring>> {
        self.effect.compliance()?.strut_spring(&self.values())
    }

    /// One entry per flat value: identity, parameter and printed name.
    pub fn entries(&self) -> Vec<Entry> {
        let mut out = Vec::with_capacity(self.values.len());
        for (b, p) in self.effect.parameters().iter().enumerate() {
            let n = self.values().len(b);
            for i in 0..n {
                let mut parameter = self.host.parameter(self.effect.acts_on(), p);
                if p.count == Count::AllDrives && i >= self.host.mechanism.arms() {
                    parameter.default *= TELESCOPE_DRIVE;
                }
                if p.or_zero && self.values().block(b)[i] == 0.0 {
                    parameter.role = Role::Fixed;
                }
                let name = match p.count {
                    Count::One => p.name.to_string(),
                    Count::Named(names) => format!("{}_{}", p.name, names[i]),
                    Count::PerArmOf(list) => {
                        let arms = self.host.mechanism.arms();
                        let name = format!("{}_{}", p.name, self.values().block(list)[i / arms]);
                        if arms == 1 { name } else { format!("{name}_{}", i % arms + 1) }
                    }
                    _ => format!("{}_{}", p.name, i + 1),
                };
                out.push(Entry { param: Param { effect: self.effect.name(), block: b, item: i }, parameter, name });
            }
        }
        out
    }
}

/// Flat values of `effect` with default shape parameters and zero linear parameters, and their layout.
pub(crate) fn default_values(effect: &dyn Effect, host: Host) -> (Vec<f64>, Layout) {
    let parameters = effect.parameters();
    let layout = Layout::new(parameters.iter().map(|p| p.count.on(host.mechanism)));
    let mut values = vec![0.0; layout.len()];
    for (b, p) in parameters.iter().enumerate().filter(|(_, p)| p.role != Role::Linear) {
        values[layout.starts[b]..layout.starts[b + 1]].fill(host.parameter(effect.acts_on(), p).default);
    }
    (values, layout)
}

/// One flat value of an effect.
#[derive(Clone, Debug)]
pub struct Entry {
    /// Identity.
    pub param: Param,
    /// Its parameter, converted to the machine.
    pub parameter: Parameter,
    /// Printed name, e.g. `coulomb_2`.
    pub name: String,
}

impl Entry {
    /// Printed name preceded by that of the effect, e.g. `drive_friction.coulomb_2`.
    pub fn full_name(&self) -> String {
        format!("{}.{}", self.param.effect, self.name)
    }
}
