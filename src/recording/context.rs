//! Data of a run besides its samples: provenance, and what other programs need for display.

use std::collections::BTreeMap;

use nalgebra::Isometry3;

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
