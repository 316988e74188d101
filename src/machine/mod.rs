//! Data of a machine: geometry, inertia, drives, sockets, stops, sensor noise and payload.
//!
//! Sources, here and in the other modules, are cited by the keys of `docs/bibliography.md`.

pub mod bodies;
pub mod check;
mod geometry;
pub mod layout;
mod load;
mod mechanism;
mod payload;
pub mod plate;
mod setup;
#[cfg(test)]
pub(crate) mod testing;
pub mod unit;

pub use bodies::{Bodies, Inertia};
pub use geometry::{Actuator, Delta, Geometry, Limb, Limbs};
pub use layout::{
    PerAxis, PerLimb, PerSocket, PerStrut, SixStruts, StrutList, StrutMatrix, StrutVector, TELESCOPE_AXIS, ThreeArms,
    axes_from, each, every_axis, every_limb, every_strut, limbs_from, lower_socket, may_have_telescope, rate_place,
    six_struts, sockets_from, struts_from, three_arms,
};
pub use load::{FREE_FALL, Load};
pub use mechanism::{Axis, Effort, Joint, Mechanism, Members, Part};
pub use payload::Payload;
pub use plate::{Pivot, Plate};
pub use setup::{Configuration, Setup};
pub use unit::Unit;

/// Symmetry assumptions about the links of an assembled robot.
///
/// The default are those of [Gnad 2024], section 2.3: equal limbs, no deviation moments, struts and telescope parts
/// symmetric about their axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkParameters {
    /// Whether every limb has its own arm and strut parameters.
    pub each_limb: bool,
    /// Which of the ten inertial parameters of a body are free.
    pub bodies: BodyParameters,
}

/// Which of the ten inertial parameters of a link are free.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BodyParameters {
    /// The reduced set of [Gnad 2024]: symmetric bodies, no deviation moments, no parameter that the dynamics do not
    /// depend on.
    #[default]
    Symmetric,
    /// Mass, first moments and moments of inertia: the axes of the joint frame are principal axes.
    Aligned,
    /// All ten.
    Complete,
}

/// One drive, all quantities at the gear output.
#[derive(Clone, Copy, Debug)]
pub struct Drive {
    /// Motor revolutions per output revolution.
    pub gear_ratio: f64,
    /// Resolution of the motor encoder in bit: 2^`encoder_bits` increments per motor revolution.
    pub encoder_bits: u32,
    /// Torque limit, N·m.
    pub max_torque: f64,
    /// Speed limit, rad/s.
    pub max_speed: f64,
    /// Acceleration limit, rad/s².
    pub max_acceleration: f64,
    /// Jerk limit, rad/s³.
    pub max_jerk: f64,
}

impl Drive {
    /// Angle of one encoder increment at the gear output, rad.
    pub fn encoder_step(&self) -> f64 {
        std::f64::consts::TAU / f64::powi(2.0, self.encoder_bits as i32) / self.gear_ratio
    }
}

/// Ball sockets of the struts.
#[derive(Clone, Copy, Debug)]
pub struct Sockets {
    /// Radius of the ball, m.
    pub ball_radius: f64,
    /// Preload of the clamp spring that presses the cup on the ball, N.
    pub preload: f64,
    /// Lateral force on the cup at which an undamaged socket dislocates under zero load along its opening, N.
    pub dislocation_force: f64,
    /// Share of the clamp springs' own force across the cup that counts against `dislocation_force`, 0 to 1.
    ///
    /// In a sheared pair the springs pull along the pair, not along the cup, so that P·(u·v) of the preload P acts
    /// along the strut. With 0 the dislocation force is net, and only the load's reaction counts; with 1 the springs'
    /// part counts in full.
    pub clamp_share: f64,
    /// Damping of the strut's spin about its own axis relative to the inertial frame, N·m·s/rad.
    ///
    /// It represents the clamp springs, which prevent the strut from spinning.
    pub spin_damping: f64,
}

/// Hard stops at the ends of the joint ranges. Those of the telescope are at its limits in [`Geometry`].
///
/// Zero stiffness means no stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stops {
    /// Arm angles of first contact with the stops, rad.
    pub arm: [f64; 2],
    /// Stiffness of the arm stops, N·m/rad.
    pub arm_stiffness: f64,
    /// Damping χ of the arm stops ([Hunt 1975]), s/rad.
    pub arm_damping: f64,
    /// Angle between the axes of a Hooke joint's parts at which its stop is reached, rad.
    pub hooke: f64,
    /// Stiffness of the Hooke stops, N·m/rad.
    pub hooke_stiffness: f64,
    /// Damping χ of the Hooke stops, s/rad.
    pub hooke_damping: f64,
    /// Stiffness of the stops at both ends of the telescope, N/m.
    pub telescope_stiffness: f64,
    /// Damping χ of the telescope stops, s/m.
    pub telescope_damping: f64,
}

impl Stops {
    /// A machine without stops.
    pub const NONE: Self = Self {
        arm: [0.0; 2],
        arm_stiffness: 0.0,
        arm_damping: 0.0,
        hooke: 0.0,
        hooke_stiffness: 0.0,
        hooke_damping: 0.0,
        telescope_stiffness: 0.0,
        telescope_damping: 0.0,
    };
}

/// Standard deviations of the sensor noise.
#[derive(Clone, Copy, Debug)]
pub struct Noise {
    /// Noise of the torque at the gear output, N·m per axis.
    pub torque: PerAxis<f64>,
    /// Noise of the axial strut force, N.
    pub strut_force: f64,
}
