//! Data of a run besides its samples: provenance, and what other programs need for display.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Vector3};

/// Provenance and display data of a run; empty for a measurement about which nothing else is known.
#[derive(Clone, Debug, Default)]
pub struct Context {
    /// Facts by name, such as `model`, `scenario`, `seed`, `version`, `command`.
    pub provenance: BTreeMap<String, String>,
    /// Input files of the run.
    pub attachments: Vec<Attachment>,
    /// URDF of the robot.
    pub description: Option<String>,
    /// Poses of the robot's links and of the objects around it, in order of time.
    pub poses: Vec<Poses>,
    /// Contacts of the robot, in order of time.
    pub contacts: Vec<Contacts>,
    /// Events in order of time.
    pub events: Vec<Note>,
}

/// A file, stored unchanged.
#[derive(Clone, Debug)]
pub struct Attachment {
    /// File name without folders.
    pub name: String,
    /// Media type, such as `application/toml`.
    pub media_type: String,
    /// Content.
    pub content: Vec<u8>,
}

/// Poses of named frames at one time.
#[derive(Clone, Debug)]
pub struct Poses {
    /// Time, s.
    pub t: f64,
    /// Frame names with their poses in the inertial frame, translation in m.
    pub frames: Vec<(String, Isometry3<f64>)>,
}

/// Contacts of the robot at one time; none is a statement, too.
#[derive(Clone, Debug, PartialEq)]
pub struct Contacts {
    /// Time, s.
    pub t: f64,
    /// The pairs of bodies that touch.
    pub pairs: Vec<Contact>,
}

/// Two bodies in contact.
#[derive(Clone, Debug, PartialEq)]
pub struct Contact {
    /// Frame names of the robot's body and of what it touches, as in [`Poses`].
    pub bodies: [String; 2],
    /// Place in the inertial frame, m.
    pub at: Vector3<f64>,
    /// Unit normal from the surface touched to the robot's body, in the inertial frame.
    pub normal: Vector3<f64>,
    /// Force on the robot's body, with friction, in the inertial frame, N.
    pub force: Vector3<f64>,
}

/// An event.
#[derive(Clone, Debug)]
pub struct Note {
    /// Time, s.
    pub t: f64,
    /// Severity.
    pub level: Level,
    /// Description.
    pub text: String,
}

/// Severity of an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// Normal course of the run.
    Info,
    /// The run continues in another way.
    Warning,
    /// A failure, such as a broken part.
    Error,
}
