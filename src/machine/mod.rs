//! What the machine is made of: geometry, bodies, drives, sockets, stops, noise, and what it carries.

pub mod bodies;
pub mod check;
mod geometry;
mod mechanism;
mod payload;
mod setup;
#[cfg(test)]
pub(crate) mod testing;
pub mod unit;

pub use bodies::{Bodies, Inertia};
pub use geometry::Geometry;
pub use mechanism::{Joint, Mechanism, Part};
pub use payload::Payload;
pub use setup::{Configuration, Setup};
pub use unit::Unit;

/// Number of actuated axes: three arms and the telescope drive.
pub const AXES: usize = 4;
/// Number of arms.
pub const ARMS: usize = 3;
/// Number of struts.
pub const STRUTS: usize = 6;

/// What is taken as alike and symmetric among the links of an assembled robot. The default are the paper's assumptions
/// (section 2.3): limbs alike, no deviation moments, struts and telescope parts symmetric about their axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkParameters {
    /// Every limb has arm and struts of its own.
    pub each_limb: bool,
    /// How many of its ten inertial parameters a body has.
    pub bodies: BodyParameters,
}

/// How many of its ten inertial parameters a link has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BodyParameters {
    /// What the paper leaves of them: symmetry, no deviation moments, nothing that does not enter.
    #[default]
    Symmetric,
    /// Mass, first moments and moments of inertia: the joint frames are principal ones.
    Aligned,
    /// All ten.
    Complete,
}

/// One drive, seen at the gear output.
#[derive(Clone, Copy, Debug)]
pub struct Drive {
    /// Motor turns per output turn.
    pub gear_ratio: f64,
    /// Encoder resolution on the motor side, bit per motor turn.
    pub encoder_bits: u32,
    /// Largest torque at the gear output, N·m.
    pub max_torque: f64,
    /// Largest speed at the gear output, rad/s.
    pub max_speed: f64,
    /// Largest acceleration, rad/s².
    pub max_acceleration: f64,
    /// Largest jerk, rad/s³.
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
    /// Force of the clamp spring that presses the cup on the ball, N.
    pub preload: f64,
    /// Force across the cup at which a healthy socket leaves its ball while nothing pulls along its opening, N.
    pub dislocation_force: f64,
    /// Share of the clamp springs' own pull across the cup that counts against `dislocation_force`, 0 to 1.
    ///
    /// Where a pair is sheared, the springs pull along the pair and not along the cup: P·(u·v) of it acts along the strut.
    /// With 0 the dislocation force is net, the load's reaction alone counts; with 1 the springs' part counts in full.
    pub clamp_share: f64,
    /// Damping of the strut's spin about its own axis against the frame, N·m·s/rad.
    ///
    /// Stands for the clamp springs, which keep the strut from spinning.
    pub spin_damping: f64,
}

/// Hard stops: buffers at the ends of what the joints can do. Those of the telescope stand at its limits in [`Geometry`].
///
/// A stiffness of zero is no stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stops {
    /// Arm angles at which the stops are first touched, rad.
    pub arm: [f64; 2],
    /// N·m/rad.
    pub arm_stiffness: f64,
    /// Hunt and Crossley's damping χ, s/rad.
    pub arm_damping: f64,
    /// Angle between the axes of a Hooke joint's parts at which it is stopped, rad.
    pub hooke: f64,
    /// N·m/rad.
    pub hooke_stiffness: f64,
    /// s/rad.
    pub hooke_damping: f64,
    /// Of both ends of the telescope, N/m.
    pub telescope_stiffness: f64,
    /// s/m.
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

/// Standard deviations of the sensors.
#[derive(Clone, Copy, Debug)]
pub struct Noise {
    /// Torque at the gear output, N·m per axis.
    pub torque: [f64; AXES],
    /// Axial strut force, N.
    pub strut_force: f64,
}
