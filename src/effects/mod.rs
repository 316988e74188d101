//! What acts on the machine: one file per effect, and [`REGISTRY`], their list.
//!
//! An effect writes *terms per unit of parameter* for a given instant. The twin sums them, identification stacks them
//! as regressor columns, the energy audit weighs them, the diagnosis tries the absent ones. Zero linear parameters
//! mean no effect. An effect does not know who reads it.
//!
//! To add an effect: write `src/effects/<name>.rs` and add its `mod` and its registry line below.

use std::sync::Arc;

use nalgebra::Vector3;

use crate::kinematics::{Motion, Reactions, SocketSet};
pub use crate::model::Part;
use crate::model::bodies::BODIES;
use crate::model::{AXES, Bodies, Drive, Geometry, Inertia, Mechanism, Model, STRUTS};
use crate::recording::{Payload, Signals};

mod air_drag;
mod axis4_friction;
mod backlash_hysteresis;
mod ball_socket_coulomb;
mod ball_socket_load_dependent;
mod ball_socket_viscous;
mod base_tilt;
mod clamp_springs;
pub mod command;
mod drive_coulomb_asymmetry;
mod drive_elasticity;
mod drive_friction;
mod drive_stribeck;
mod drive_viscous_asymmetry;
pub mod formula;
mod gear_load_friction;
mod hooke_friction;
mod hose_spring;
mod joint_zero_offset;
mod limb_asymmetry;
pub mod payload;
mod payload_com_offset;
mod payload_mass_error;
pub mod rigid_bodies;
mod rotor_inertia;
mod signal_delay;
mod strut_elasticity;
mod strut_length_error;
mod telescope_end_stop;
mod telescope_friction;
mod telescope_retract_friction;
#[cfg(test)]
pub(crate) mod testing;
mod thermal_friction_drift;
mod torque_bias;
mod torque_gain_error;
mod torque_ripple;

/// Every effect deltatwin knows. The name of an effect is its table in the model file.
pub static REGISTRY: &[&dyn Effect] = &[
    &rigid_bodies::ASSEMBLED,
    &drive_friction::DriveFriction,
    &axis4_friction::Axis4Friction,
    &telescope_friction::TelescopeFriction,
    &ball_socket_viscous::BallSocketViscous,
    &ball_socket_coulomb::BallSocketCoulomb,
    &drive_stribeck::DriveStribeck,
    &drive_coulomb_asymmetry::DriveCoulombAsymmetry,
    &drive_viscous_asymmetry::DriveViscousAsymmetry,
    &gear_load_friction::GearLoadFriction,
    &backlash_hysteresis::BacklashHysteresis,
    &drive_elasticity::DriveElasticity,
    &thermal_friction_drift::ThermalFrictionDrift,
    &torque_ripple::TorqueRipple,
    &rotor_inertia::RotorInertia,
    &ball_socket_load_dependent::BallSocketLoadDependent,
    &telescope_retract_friction::TelescopeRetractFriction,
    &telescope_end_stop::TelescopeEndStop,
    &hooke_friction::HookeFriction,
    &payload_mass_error::PayloadMassError,
    &payload_com_offset::PayloadComOffset,
    &limb_asymmetry::LimbAsymmetry,
    &strut_elasticity::StrutElasticity,
    &clamp_springs::ClampSprings,
    &strut_length_error::StrutLengthError,
    &base_tilt::BaseTilt,
    &hose_spring::HoseSpring,
    &air_drag::AirDrag,
    &joint_zero_offset::JointZeroOffset,
    &torque_gain_error::TorqueGainError,
    &torque_bias::TorqueBias,
    &signal_delay::SignalDelay,
    &formula::NONE,
];

/// The effect called `name`.
pub fn find(name: &str) -> Option<&'static dyn Effect> {
    REGISTRY.iter().copied().find(|e| e.name() == name)
}

/// A physical effect: a force law, a change of inertia or geometry, or a change of what a sensor reports.
pub trait Effect: Sync {
    /// Name in model files and reports.
    fn name(&self) -> &'static str;

    /// What part of a machine it acts on; a machine without that part cannot have the effect.
    fn acts_on(&self) -> Part;

    /// Law, where it shows and where the numbers come from.
    fn about(&self) -> About;

    /// Parameters in the order of the values.
    fn parameters(&self) -> &[Parameter];

    /// Inertia added per unit of each linear parameter (`out(k, body, inertia)`), constant over a run.
    fn inertia(&self, _values: &Values, _payload: &Payload, _out: &mut dyn FnMut(usize, usize, Inertia)) {}

    /// Wrenches per unit of each linear parameter.
    fn forces(&self, _values: &Values, _at: &Instant, _out: &mut Wrenches) {}

    /// The same along a given motion, where the drive torques are what is asked for. Differs from `forces` for what lies
    /// between drive and joint: [`Instant::torque`] is no help there, and own states of [`Kind::Encoder`] rest.
    fn forces_along(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        self.forces(values, at, out);
    }

    /// Whether `forces` reads [`Instant::reactions`].
    fn reads_reactions(&self) -> bool {
        false
    }

    /// Whether `forces` reads accelerations of joints or platform.
    fn reads_accelerations(&self) -> bool {
        false
    }

    /// Whether `forces_along` reads [`Instant::torque`].
    fn reads_torque(&self) -> bool {
        false
    }

    /// Whether inverse dynamics along a measured motion shows the effect. If not, only the twin has it: identification
    /// leaves its parameters alone, and the diagnosis lists it as unseen.
    fn identifiable(&self) -> bool {
        true
    }

    /// Initial values of the effect's own states.
    fn initial_state(&self, _values: &Values) -> Vec<f64> {
        Vec::new()
    }

    /// Time derivative of the effect's own states, and its derivative by each state itself where it is steep
    /// (`slope`, 1/s, zero on entry): the twin treats it implicitly.
    fn state_rate(&self, _values: &Values, _at: &Instant, _rate: &mut [f64], _slope: &mut [f64]) {}

    /// What the motor-side encoders read beyond the joint angles: adds to `angles`, rad.
    fn encoder(&self, _values: &Values, _state: &[f64], _angles: &mut [f64; AXES]) {}

    /// Elastic gears between encoder and joint, whose compliances are the first parameters. The effect's own states are
    /// then the three arms' deflections and their rates, which the twin integrates; readers of a measured motion find
    /// them along it.
    fn gear_springs(&self, _values: &Values) -> Option<[GearSpring; AXES]> {
        None
    }

    /// Axial spring and damper of each strut per unit of compliance, see [`StrutSpring`].
    fn strut_spring(&self, _values: &Values) -> Option<[StrutSpring; STRUTS]> {
        None
    }

    /// Changes the geometry.
    fn geometry(&self, _values: &Values, _geometry: &mut Geometry) {}

    /// Changes what the sensors report: the ideal signals become the reported ones.
    fn observe(&self, _values: &Values, _signals: &mut Signals) {}

    /// What `model` says of a constant of the law, for an effect that is not in the model yet; its default otherwise.
    fn constant(&self, _parameter: &Parameter, _model: &Model) -> Option<f64> {
        None
    }

    /// Where a search for shape parameters starts, as factors of their usual values: one grid for each of the leading ones,
    /// searched one at a time. The others begin at their usual values.
    fn shape_grids(&self) -> &'static [&'static [f64]] {
        &[&[0.3, 0.6, 1.0, 2.0, 4.0]]
    }

    /// The terms of a formula, which stand in the model file beside its numbers.
    fn formula(&self) -> Option<&formula::Formula> {
        None
    }

    /// What the effect changes; decides how its columns are computed.
    fn kind(&self) -> Kind {
        Kind::Force
    }
}

/// An elastic strut: T = stiffness · elongation + damping · its rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrutSpring {
    /// N/m.
    pub stiffness: f64,
    /// N·s/m.
    pub damping: f64,
}

/// An elastic gear: the encoder leads the joint by compliance · transmitted torque (but for the damping).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GearSpring {
    /// rad/(N·m); zero is rigid.
    pub compliance: f64,
    /// Damping, N·m·s/rad.
    pub damping: f64,
    /// Inertia on the motor side, seen at the gear output, kg·m².
    pub rotor_inertia: f64,
    /// Whether what acts on the drive acts on the motor's side.
    pub friction_at_motor: bool,
}

impl GearSpring {
    /// Whether the twin lets the gear give way; the effect has no torque otherwise.
    pub fn is_elastic(&self) -> bool {
        self.compliance * self.rotor_inertia > drive_elasticity::RIGID
    }
}

/// What an effect changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Inertia of bodies; linear.
    Inertia,
    /// Wrenches on bodies.
    Force,
    /// Lengths; acts through the kinematics.
    Geometry,
    /// Reported signals.
    Sensor,
    /// What lies between encoder and joint; shifts the motion that a recording stands for.
    Encoder,
}

impl Kind {
    /// Whether the effect acts through everything else rather than by terms of its own, so that its columns are
    /// differences of whole predictions.
    pub fn acts_on_the_whole(self) -> bool {
        matches!(self, Self::Geometry | Self::Sensor | Self::Encoder)
    }
}

/// What a person wants to know about an effect.
#[derive(Clone, Copy, Debug)]
pub struct About {
    /// One line: what it is.
    pub summary: &'static str,
    /// The law with its symbols.
    pub law: &'static str,
    /// Where it shows in measurements.
    pub shows: &'static str,
    /// Source of the law and its usual magnitude.
    pub source: &'static str,
}

/// How a parameter enters the law.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Proportionally; zero switches the term off.
    Linear,
    /// Nonlinearly, estimated by an outer iteration.
    Shape,
    /// A constant of the law, taken from the model file.
    Fixed,
}

/// How many values a parameter has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Count {
    /// A single number.
    One,
    /// One per arm (array of 3).
    PerArm,
    /// One per drive (array of 3 or 4; three mean the arms).
    PerDrive,
    /// One per axis, the telescope's included.
    PerAxis,
    /// A fixed number of named values (array).
    Named(&'static [&'static str]),
}

impl Count {
    /// Number of values on a machine; of one that may have more, the least.
    pub fn on(self, machine: Mechanism) -> usize {
        match self {
            Self::One => 1,
            Self::PerArm | Self::PerDrive => machine.arms(),
            Self::PerAxis => machine.axes(),
            Self::Named(names) => names.len(),
        }
    }
}

/// A parameter of an effect.
#[derive(Clone, Copy, Debug)]
pub struct Parameter {
    /// Key in the effect's table.
    pub name: &'static str,
    /// Unit, e.g. `N·m·s/rad`.
    pub unit: &'static str,
    /// How many values.
    pub count: Count,
    /// How it enters the law.
    pub role: Role,
    /// Usual magnitude; the starting value of shape parameters and the default of optional ones.
    pub default: f64,
    /// Allowed values.
    pub range: (f64, f64),
}

/// Where each parameter's values stand in the flat list.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    starts: Vec<usize>,
}

impl Layout {
    /// Layout for parameter blocks of the given lengths.
    pub fn new(lengths: impl IntoIterator<Item = usize>) -> Self {
        let mut starts = vec![0];
        for n in lengths {
            starts.push(starts[starts.len() - 1] + n);
        }
        Self { starts }
    }

    /// Total number of values.
    pub fn len(&self) -> usize {
        self.starts[self.starts.len() - 1]
    }

    /// Whether there are no values.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Values of an effect's parameters, addressed by parameter block.
#[derive(Clone, Copy)]
pub struct Values<'a> {
    values: &'a [f64],
    layout: &'a Layout,
}

impl<'a> Values<'a> {
    /// All values of parameter `block`.
    pub fn block(&self, block: usize) -> &'a [f64] {
        &self.values[self.layout.starts[block]..self.layout.starts[block + 1]]
    }

    /// The value of the scalar parameter `block`.
    pub fn one(&self, block: usize) -> f64 {
        self.values[self.layout.starts[block]]
    }

    /// Number of values of parameter `block`.
    pub fn len(&self, block: usize) -> usize {
        self.block(block).len()
    }

    /// Flat index of value `i` of parameter `block`, as `forces` and `inertia` report it.
    pub fn index(&self, block: usize, i: usize) -> usize {
        self.layout.starts[block] + i
    }
}

/// The machine that an effect is on, as far as its parameters depend on it: how many there are, their units, and their
/// usual sizes, which are stated for an arm drive of the IRB 360.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Host {
    /// Kind of machine.
    pub mechanism: Mechanism,
    /// Largest torque (or force) of its drives relative to the stated one.
    torque: f64,
    /// Largest speed, likewise.
    speed: f64,
}

/// Arm drive for which sizes are stated: N·m and rad/s.
const STATED: (f64, f64) = (132.0, 18.989);

impl Default for Host {
    fn default() -> Self {
        Self { mechanism: Mechanism::default(), torque: 1.0, speed: 1.0 }
    }
}

impl Host {
    /// Of a machine with drives like `drive`; all delta robots count as the stated one.
    pub fn new(mechanism: Mechanism, drive: &Drive) -> Self {
        let (torque, speed) = match mechanism {
            Mechanism::Delta { .. } => (1.0, 1.0),
            Mechanism::Axis(_) => (drive.max_torque / STATED.0, drive.max_speed / STATED.1),
        };
        Self { mechanism, torque, speed }
    }

    /// `parameter` with unit, usual size and range on this machine.
    pub fn parameter(&self, parameter: &Parameter) -> Parameter {
        let (t, v) = (self.torque, self.speed);
        let factor = match parameter.unit {
            "N·m" => t,
            "rad" | "rad/s" => v,
            "s/rad" => 1.0 / v,
            "N·m·s/rad" | "kg·m²" => t / v,
            "rad/(N·m)" => v / t,
            _ => 1.0,
        };
        let (low, high) = parameter.range;
        Parameter {
            unit: self.mechanism.unit(parameter.unit),
            default: factor * parameter.default,
            range: (factor * low, factor * high),
            ..*parameter
        }
    }
}

/// An effect that is switched on, with its parameter values.
#[derive(Clone)]
pub struct ActiveEffect {
    /// The machine it is on.
    pub host: Host,
    /// The law.
    pub effect: &'static dyn Effect,
    /// Flat parameter values.
    pub values: Vec<f64>,
    /// Where each parameter stands in `values`.
    pub layout: Arc<Layout>,
}

impl ActiveEffect {
    /// `effect` on the four-axis robot with its default shape and zero linear parameters: present, but without action.
    pub fn absent(effect: &'static dyn Effect) -> Self {
        Self::absent_on(effect, Host::default())
    }

    /// The same on another machine.
    pub fn absent_on(effect: &'static dyn Effect, host: Host) -> Self {
        let layout = Layout::new(effect.parameters().iter().map(|p| p.count.on(host.mechanism)));
        let mut values = vec![0.0; layout.len()];
        for (b, p) in effect.parameters().iter().enumerate() {
            if p.role != Role::Linear {
                values[layout.starts[b]..layout.starts[b + 1]].fill(host.parameter(p).default);
            }
        }
        Self { host, effect, values, layout: Arc::new(layout) }
    }

    /// The same shape with the linear parameters at their usual values.
    pub fn at_usual_size(&self) -> Self {
        let mut usual = self.clone();
        for (value, entry) in usual.values.iter_mut().zip(self.entries()) {
            if entry.parameter.role == Role::Linear {
                *value = entry.parameter.default;
            }
        }
        usual
    }

    /// Whether the effect puts springs into gears, at its usual size if it is absent.
    pub fn has_gears(&self) -> bool {
        self.effect.gear_springs(&self.at_usual_size().values()).is_some()
    }

    /// `effect` with one slice of values per parameter.
    ///
    /// # Panics
    /// If the number of blocks differs from the number of parameters.
    pub fn new(effect: &'static dyn Effect, blocks: &[&[f64]]) -> Self {
        assert_eq!(blocks.len(), effect.parameters().len(), "{}: one block per parameter", effect.name());
        let layout = Layout::new(blocks.iter().map(|b| b.len()));
        Self { host: Host::default(), effect, values: blocks.concat(), layout: Arc::new(layout) }
    }

    /// The values, by parameter.
    pub fn values(&self) -> Values<'_> {
        Values { values: &self.values, layout: &self.layout }
    }

    /// Number of the effect's own states.
    pub fn states(&self) -> usize {
        self.effect.initial_state(&self.values()).len()
    }

    /// Parameter, its number within the parameter and its printed name for each flat value.
    pub fn entries(&self) -> Vec<Entry> {
        let mut out = Vec::with_capacity(self.values.len());
        for (b, p) in self.effect.parameters().iter().enumerate() {
            let n = self.values().len(b);
            for i in 0..n {
                let name = match p.count {
                    Count::One => p.name.to_string(),
                    Count::PerArm | Count::PerDrive | Count::PerAxis => format!("{}_{}", p.name, i + 1),
                    Count::Named(names) => format!("{}_{}", p.name, names[i]),
                };
                out.push(Entry { parameter: self.host.parameter(p), name });
            }
        }
        out
    }
}

/// One flat value of an effect.
#[derive(Clone, Debug)]
pub struct Entry {
    /// Its parameter, as it is on the machine.
    pub parameter: Parameter,
    /// Printed name, e.g. `coulomb_2`.
    pub name: String,
}

/// Everything a force law may read.
#[derive(Clone, Copy)]
pub struct Instant<'a> {
    /// Time since the start of the run, s.
    pub t: f64,
    /// Motion of all bodies and joints; in the twin without accelerations, but for laws that say they read them.
    pub motion: &'a Motion,
    /// Total inertia of the bodies, with payload.
    pub bodies: &'a Bodies,
    /// Gravitational acceleration, m/s².
    pub gravity: f64,
    /// Reactions in the struts.
    pub reactions: &'a Reactions,
    /// The effect's own states.
    pub state: &'a [f64],
    /// Torques of the drives at the gear output, N·m. Where they are what is asked for, zero, unless the effect says that
    /// it reads them.
    pub torque: [f64; AXES],
    /// Ball sockets that still hold.
    pub closed: SocketSet,
}

/// Receives wrenches per unit of each parameter: force and moment about the body's origin, world axes.
pub struct Wrenches<'a> {
    sink: Sink<'a>,
}

enum Sink<'a> {
    /// `(parameter, body, force, moment)` one by one.
    Each(&'a mut dyn FnMut(usize, usize, Vector3<f64>, Vector3<f64>)),
    /// Times the parameters' values, summed over all laws, with their power.
    Sum { values: &'a [f64], motion: &'a Motion, total: &'a mut [(Vector3<f64>, Vector3<f64>); BODIES], power: f64 },
}

impl<'a> Wrenches<'a> {
    /// Hands every wrench to a reader as `(parameter, body, force, moment)`.
    pub fn new(sink: &'a mut dyn FnMut(usize, usize, Vector3<f64>, Vector3<f64>)) -> Self {
        Self { sink: Sink::Each(sink) }
    }

    /// Adds every wrench times its parameter's value to `total`.
    pub fn sum(values: &'a [f64], motion: &'a Motion, total: &'a mut [(Vector3<f64>, Vector3<f64>); BODIES]) -> Self {
        Self { sink: Sink::Sum { values, motion, total, power: 0.0 } }
    }

    /// Power of the summed wrenches on the bodies, W.
    pub fn power(&self) -> f64 {
        if let Sink::Sum { power, .. } = &self.sink { *power } else { 0.0 }
    }

    /// Force and moment on `body` about its origin.
    #[inline]
    pub fn wrench(&mut self, k: usize, body: usize, force: Vector3<f64>, moment: Vector3<f64>) {
        match &mut self.sink {
            Sink::Each(read) => read(k, body, force, moment),
            Sink::Sum { values, motion, total, power } => {
                let force = force * values[k];
                total[body].0 += force;
                *power += force.dot(&motion.bodies[body].velocity);
                self.moment(k, body, moment);
            }
        }
    }

    /// Moment on `body`.
    #[inline]
    pub fn moment(&mut self, k: usize, body: usize, moment: Vector3<f64>) {
        match &mut self.sink {
            Sink::Each(read) => read(k, body, Vector3::zeros(), moment),
            Sink::Sum { values, motion, total, power } => {
                let moment = moment * values[k];
                total[body].1 += moment;
                *power += moment.dot(&motion.bodies[body].angular_velocity);
            }
        }
    }

    /// Torque on drive `axis`, positive along its joint angle; the reaction goes to the base.
    #[inline]
    pub fn drive_torque(&mut self, k: usize, axis: usize, torque: f64) {
        let (body, direction) = Motion::drive(axis);
        self.moment(k, body, direction * torque);
    }

    /// Force along the telescope, positive when it pushes the two parts apart.
    pub fn telescope_force(&mut self, k: usize, motion: &Motion, force: f64) {
        use crate::model::bodies::{TELESCOPE_LOWER, TELESCOPE_UPPER};
        self.wrench(k, TELESCOPE_UPPER, motion.telescope.axis * force, Vector3::zeros());
        self.wrench(k, TELESCOPE_LOWER, -motion.telescope.axis * force, Vector3::zeros());
    }

    /// Moment on the strut at `socket` with its reaction on the arm or the platform.
    #[inline]
    pub fn socket_moment(&mut self, k: usize, socket: usize, moment: Vector3<f64>) {
        let (strut, partner) = Motion::socket_bodies(socket);
        self.moment(k, strut, moment);
        self.moment(k, partner, -moment);
    }
}

/// Direction of a rate vector, regularised: tanh(|ω|/ε)·ω/|ω|, smooth through zero.
pub fn unit_direction(rate: &Vector3<f64>, epsilon: f64) -> Vector3<f64> {
    let speed = rate.norm();
    // tanh(x)/x = 1 − x²/3 + …: one to rounding below 1e-8
    if speed < 1e-8 * epsilon { rate / epsilon } else { rate * ((speed / epsilon).tanh() / speed) }
}

/// Constant of the laws that use [`smooth_sign`].
const STEEPNESS_PARAMETER: Parameter = Parameter {
    name: "steepness",
    unit: "s/rad",
    count: Count::One,
    role: Role::Fixed,
    default: 100.0,
    range: (1.0, 1e4),
};

/// Smooth sign: `tanh(rate·steepness)`; the paper's approximation of Coulomb friction (eq. 48 uses 100 s/rad).
pub fn smooth_sign(rate: f64, steepness: f64) -> f64 {
    (rate * steepness).tanh()
}
