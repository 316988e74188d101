//! What acts on the machine: one file per effect, and [`REGISTRY`], their list.
//!
//! An effect writes *terms per unit of parameter* for a given instant. The twin sums them, identification stacks them
//! as regressor columns, the energy audit weighs them, the diagnosis tries the absent ones. Zero linear parameters
//! mean no effect. An effect does not know who reads it.
//!
//! To add an effect: write `src/effects/<name>.rs` and add its `mod` and its registry line below.

use nalgebra::Vector3;

use crate::model::{AXES, Geometry, Inertia, Model, STRUTS};
pub use crate::model::{Part, Unit};
use crate::recording::{Payload, Signals};

mod air_drag;
mod axis4_friction;
mod backlash_hysteresis;
mod ball_socket_coulomb;
mod ball_socket_load_dependent;
mod ball_socket_viscous;
mod base_tilt;
mod clamp_springs;
mod drive_coulomb_asymmetry;
mod drive_elasticity;
mod drive_friction;
mod drive_stribeck;
mod drive_viscous_asymmetry;
pub mod formula;
mod gear_load_friction;
mod hooke_friction;
mod hose_spring;
mod interface;
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

pub use interface::{
    ActiveEffect, Count, Effects, Entry, Host, Instant, Layout, Parameter, Role, Values, Wrenches, hunt_crossley,
};

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

    /// Shapes at which a search begins where no single grid finds them; [`Self::shape_grids`] is left aside then.
    fn starts(&self) -> &'static [Start] {
        &[]
    }

    /// Constants of 0 or 1 that a search tries both ways.
    fn switches(&self) -> &'static [&'static str] {
        &[]
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

/// Values at which a search begins: up to three parameter blocks, by number, with what stands in them.
pub struct Start(pub [Option<(usize, &'static [f64])>; 3]);

/// An elastic strut: T = stiffness · elongation + damping · its rate.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
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

/// Direction of a rate vector, regularised: tanh(|ω|/ε)·ω/|ω|, smooth through zero.
pub fn unit_direction(rate: &Vector3<f64>, epsilon: f64) -> Vector3<f64> {
    let speed = rate.norm();
    // tanh(x)/x = 1 − x²/3 + …: one to rounding below 1e-8
    if speed < 1e-8 * epsilon { rate / epsilon } else { rate * ((speed / epsilon).tanh() / speed) }
}

/// Constant of the laws that use [`smooth_sign`].
const STEEPNESS_PARAMETER: Parameter = Parameter {
    name: "steepness",
    unit: Unit::SPerRad,
    count: Count::One,
    role: Role::Fixed,
    default: 100.0,
    range: (1.0, 1e4),
};

/// Smooth sign: `tanh(rate·steepness)`; the paper's approximation of Coulomb friction (eq. 48 uses 100 s/rad).
pub fn smooth_sign(rate: f64, steepness: f64) -> f64 {
    (rate * steepness).tanh()
}
