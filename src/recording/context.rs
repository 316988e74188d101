//! What a file holds of a run beside its samples: where it comes from, and what shows it in other programs.

use std::collections::BTreeMap;

use nalgebra::Isometry3;

/// Origin and pictures of a run; empty for a measurement of which nothing else is known.
#[derive(Clone, Debug, Default)]
pub struct Context {
    /// Facts by name, such as `model`, `scenario`, `seed`, `version`, `command`.
    pub provenance: BTreeMap<String, String>,
    /// The files that the run was made from.
    pub attachments: Vec<Attachment>,
    /// URDF of the robot.
    pub description: Option<String>,
    /// Poses of the robot's links and of what stands around it, in order of time.
    pub poses: Vec<Poses>,
    /// What happened, in order of time.
    pub events: Vec<Note>,
}

/// A file as it was.
#[derive(Clone, Debug)]
pub struct Attachment {
    /// Its name, without folders.
    pub name: String,
    /// Its media type, such as `application/toml`.
    pub media_type: String,
    /// Its content.
    pub content: Vec<u8>,
}

/// Poses at one time.
#[derive(Clone, Debug)]
pub struct Poses {
    /// Time, s.
    pub t: f64,
    /// Frames by name, in the inertial frame, m.
    pub frames: Vec<(String, Isometry3<f64>)>,
}

/// Something that happened.
#[derive(Clone, Debug)]
pub struct Note {
    /// When, s.
    pub t: f64,
    /// How bad it is.
    pub level: Level,
    /// What, in words.
    pub text: String,
}

/// How bad an event is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// Nothing bad.
    Info,
    /// The run goes on in another way.
    Warning,
    /// Something broke.
    Error,
}
