//! Physical effects on the machine: one file per effect, and their list, [`REGISTRY`].
//!
//! An effect writes *terms per unit of parameter* for a given instant. The twin sums them, identification uses them as
//! regressor columns, the energy balance as powers, and the diagnosis evaluates those of absent effects. With zero
//! linear parameters an effect has no influence. Effects do not depend on their users.
//!
//! To add an effect, write `src/effects/<name>.rs` and add its `mod` and its registry line below. Sources are cited by
//! the keys of `docs/bibliography.md`.

use std::any::Any;
use std::sync::{Arc, LazyLock};

use nalgebra::Vector3;

use self::rigid_bodies::RigidBodies;
use crate::machine::{Geometry, Inertia, Mechanism, Payload};
pub use crate::machine::{Part, Unit};
use crate::numerics::tanh;

mod air_drag;
mod axis4_friction;
mod axis_gravity;
mod backlash_hysteresis;
mod ball_socket_clearance;
mod ball_socket_coulomb;
mod ball_socket_load_dependent;
mod ball_socket_viscous;
mod base_tilt;
mod clamp_springs;
pub mod cogging;
mod drive_coulomb_asymmetry;
mod drive_elasticity;
mod drive_friction;
mod drive_stribeck;
mod drive_viscous_asymmetry;
pub mod formula;
mod frame_compliance;
mod gear_efficiency;
mod gear_load_friction;
mod hooke_friction;
mod hose_spring;
mod interface;
mod joint_zero_offset;
mod limb_asymmetry;
pub mod payload;
mod payload_com_offset;
mod payload_compliance;
mod payload_drag;
mod payload_mass_error;
pub mod rigid_bodies;
mod rotor_inertia;
mod signal_delay;
mod strut_elasticity;
mod strut_length_error;
mod strut_pair_error;
mod telescope_end_stop;
mod telescope_friction;
mod telescope_retract_friction;
#[cfg(test)]
pub(crate) mod testing;
mod thermal_friction_drift;
mod torque_bias;
mod torque_filter;
mod torque_gain_error;
mod torque_ripple;
mod torque_saturation;
mod transmission_error;
mod viscous_curve;

pub use drive_elasticity::GearSpring;
pub use interface::{
    About, ActiveEffect, Compliance, Count, Effects, Entry, Host, Instant, InternalStates, Kind, Layout, MachineView,
    Oscillator, Param, Parameter, Reads, Role, Search, Sensor, Spec, Start, Sway, Values, Wrenches, hunt_crossley,
    presliding,
};
pub use strut_elasticity::StrutSpring;
pub use torque_filter::LowPassStep;

/// All effects of deltatwin. The name of an effect is its table in the model file.
pub static REGISTRY: LazyLock<Vec<Arc<dyn Effect>>> = LazyLock::new(|| {
    vec![
        RigidBodies::of(Mechanism::default(), true),
        Arc::new(drive_friction::DriveFriction),
        Arc::new(axis4_friction::Axis4Friction),
        Arc::new(telescope_friction::TelescopeFriction),
        Arc::new(ball_socket_viscous::BallSocketViscous),
        Arc::new(ball_socket_coulomb::BallSocketCoulomb),
        Arc::new(drive_stribeck::DriveStribeck),
        Arc::new(drive_coulomb_asymmetry::DriveCoulombAsymmetry),
        Arc::new(drive_viscous_asymmetry::DriveViscousAsymmetry),
        Arc::new(viscous_curve::ViscousCurve),
        Arc::new(gear_load_friction::GearLoadFriction),
        Arc::new(gear_efficiency::GearEfficiency),
        Arc::new(backlash_hysteresis::BacklashHysteresis),
        Arc::new(drive_elasticity::DriveElasticity),
        Arc::new(thermal_friction_drift::ThermalFrictionDrift),
        Arc::new(torque_ripple::TorqueRipple),
        Arc::new(cogging::Cogging),
        Arc::new(rotor_inertia::RotorInertia),
        Arc::new(ball_socket_load_dependent::BallSocketLoadDependent),
        Arc::new(telescope_retract_friction::TelescopeRetractFriction),
        Arc::new(telescope_end_stop::TelescopeEndStop),
        Arc::new(hooke_friction::HookeFriction),
        Arc::new(payload_mass_error::PayloadMassError),
        Arc::new(payload_com_offset::PayloadComOffset),
        Arc::new(payload_compliance::PayloadCompliance),
        Arc::new(limb_asymmetry::LimbAsymmetry),
        Arc::new(strut_elasticity::StrutElasticity),
        Arc::new(ball_socket_clearance::BallSocketClearance),
        Arc::new(clamp_springs::ClampSprings),
        Arc::new(strut_length_error::StrutLengthError),
        Arc::new(strut_pair_error::StrutPairError),
        Arc::new(base_tilt::BaseTilt),
        Arc::new(frame_compliance::FrameCompliance),
        Arc::new(axis_gravity::AxisGravity),
        Arc::new(hose_spring::HoseSpring),
        Arc::new(air_drag::AirDrag),
        Arc::new(payload_drag::PayloadDrag),
        Arc::new(joint_zero_offset::JointZeroOffset),
        Arc::new(transmission_error::TransmissionError),
        Arc::new(torque_gain_error::TorqueGainError),
        Arc::new(torque_saturation::TorqueSaturation),
        Arc::new(torque_bias::TorqueBias),
        Arc::new(signal_delay::SignalDelay),
        Arc::new(torque_filter::TorqueFilter),
        Arc::new(formula::Formula::default()),
    ]
});

/// The registered effect called `name`.
pub fn find(name: &str) -> Option<Arc<dyn Effect>> {
    REGISTRY.iter().find(|e| e.name() == name).cloned()
}

/// A physical effect: a force law, a change of inertia or geometry, or a change of what a sensor reports.
pub trait Effect: Any + Send + Sync {
    /// Properties that do not depend on the motion.
    fn spec(&self) -> &Spec;

    /// Writes the wrenches per unit of each linear parameter.
    fn wrenches(&self, _values: &Values, _at: &Instant, _out: &mut Wrenches) {}

    /// Writes the wrenches along a given motion, for inverse dynamics. They differ from `wrenches` for effects between
    /// drive and joint: [`Instant::torque`] is not available, and the internal states of [`Kind::Encoder`] are at rest.
    fn wrenches_along(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        self.wrenches(values, at, out);
    }

    /// Passes the inertia added per unit of each linear parameter to `out(k, body, inertia)`; constant over a run.
    fn inertia(&self, _values: &Values, _payload: &Payload, _out: &mut dyn FnMut(usize, usize, Inertia)) {}

    /// Changes the geometry.
    fn geometry(&self, _values: &Values, _geometry: &mut Geometry) {}

    /// Its differential equations, if any.
    fn states(&self) -> Option<&dyn InternalStates> {
        None
    }

    /// Its elastic elements, if any.
    fn compliance(&self) -> Option<&dyn Compliance> {
        None
    }

    /// Its effect on the sensors, if any.
    fn sensor(&self) -> Option<&dyn Sensor> {
        None
    }
}

impl dyn Effect {
    /// Name in model files and reports.
    pub fn name(&self) -> &'static str {
        self.spec().name
    }

    /// Part of a machine on which it acts.
    pub fn acts_on(&self) -> Part {
        self.spec().acts_on
    }

    /// Parameters in the order of the values.
    pub fn parameters(&self) -> &[Parameter] {
        &self.spec().parameters
    }

    /// What the effect changes.
    pub fn kind(&self) -> Kind {
        self.spec().kind
    }

    /// The formula, for the effect whose terms are stored in the model file; `None` for any other effect.
    pub fn formula(&self) -> Option<&formula::Formula> {
        (self as &dyn Any).downcast_ref()
    }
}

/// Direction of an angular velocity (rad/s), regularised to tanh(|ω|/ε)·ω/|ω|, smooth at zero.
pub fn unit_direction(rate: &Vector3<f64>, epsilon: f64) -> Vector3<f64> {
    let speed = rate.norm();
    // tanh(x)/x = 1 − x²/3 + …: equal to one within rounding below 1e-8
    if speed < 1e-8 * epsilon { rate / epsilon } else { rate * (tanh(speed / epsilon) / speed) }
}

/// Steepness parameter of the laws that use [`smooth_sign`].
const STEEPNESS_PARAMETER: Parameter = Parameter::new("steepness", Unit::SPerRad, Role::Fixed, 100.0, (1.0, 1e4));

/// Constants of friction in the drives that the model lacks: it reverses over the same speed as the model's `drive_friction`.
fn as_drive_friction(parameter: &str, model: &MachineView) -> Option<f64> {
    let friction = model.effects.iter().find(|a| a.effect.name() == "drive_friction")?;
    let mut own = friction.entries().into_iter().zip(&friction.values);
    own.find(|(entry, _)| parameter == STEEPNESS_PARAMETER.name && entry.parameter.name == parameter)
        .map(|(_, value)| *value)
}

/// Smooth sign function `tanh(rate·steepness)`, the approximation of Coulomb friction in [Gnad 2024] (100 s/rad in eq.
/// 48).
pub fn smooth_sign(rate: f64, steepness: f64) -> f64 {
    tanh(rate * steepness)
}
