//! What a run leaves for a verdict on it: loads at every sample, and the instants at which something gave way.

use nalgebra::Vector3;

use super::contacts::ContactBody;
use crate::machine::{PerAxis, PerSocket, PerStrut};

/// Loads and errors at one sample, kept by [`super::Options::trace`] until the drives trip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Time, s.
    pub t: f64,
    /// Joint positions, rad (m on a prismatic axis).
    pub q: PerAxis<f64>,
    /// Joint rates, rad/s.
    pub rate: PerAxis<f64>,
    /// Torques at the gear outputs, N·m.
    pub torque: PerAxis<f64>,
    /// Feedback part of the torque that is commanded now, N·m.
    pub feedback: PerAxis<f64>,
    /// Desired minus measured joint position, as the controller sees it, rad.
    pub error: PerAxis<f64>,
    /// Length of the telescope, m.
    pub telescope: f64,
    /// Centre of the platform's ball plane, m.
    pub platform: [f64; 3],
    /// Axial forces at the elbow and platform ends of the struts, tension positive, N.
    pub strut_force: [PerStrut<f64>; 2],
    /// Force margin of every ball socket, N.
    pub margin: PerSocket<f64>,
}

/// A ball socket that left its ball.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dislocation {
    /// Time, s.
    pub t: f64,
    /// Socket, 0..6 at the elbows, 6..12 at the platform.
    pub socket: usize,
    /// Force across the cup, N.
    pub across: f64,
    /// Hold that was left, N.
    pub hold: f64,
    /// Pull along the opening, N.
    pub pull: f64,
    /// Kinetic energy of robot and objects, J.
    pub kinetic_energy: f64,
}

/// Why the drives tripped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TripCause {
    /// A socket has left its ball.
    Socket,
    /// Feedback torque of an axis, from 0.
    Torque(usize),
    /// Difference between desired and measured position of an axis, from 0.
    Tracking(usize),
}

/// Beginning of a contact of a link of the robot.
#[derive(Clone, Debug, PartialEq)]
pub struct Impact {
    /// Time, s.
    pub t: f64,
    /// Link or held object.
    pub link: ContactBody,
    /// Object or other link.
    pub other: ContactBody,
    /// Their names.
    pub names: [String; 2],
    /// Origin of the link's frame, m.
    pub position: Vector3<f64>,
    /// Velocity of that origin, m/s.
    pub velocity: Vector3<f64>,
    /// Kinetic energy of the link, J.
    pub kinetic_energy: f64,
}
