//! What is wrong with the robot's surroundings.

use thiserror::Error;

/// What is wrong with a cell, or with a request to it.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum CellError {
    /// Two objects of one name.
    #[error("two objects are named '{0}'")]
    DuplicateName(String),
    /// An object without a name.
    #[error("object {0} has no name")]
    NoName(usize),
    /// A size, mass or surface property out of range.
    #[error("'{object}': {what} is {value}, expected a {expected} number")]
    BadValue {
        /// Name of the object.
        object: String,
        /// Which quantity.
        what: &'static str,
        /// What it is.
        value: f64,
        /// What it should be.
        expected: &'static str,
    },
    /// A mesh that would have to fall.
    #[error("'{0}' is free, which a mesh cannot be; expected shape = \"hull\", or a fixed mesh")]
    FreeMesh(String),
    /// No object of that name.
    #[error("there is no object '{0}'")]
    Unknown(String),
    /// A fixed object cannot be picked.
    #[error("'{0}' is not free and cannot be picked up")]
    NotFree(String),
    /// The gripper is occupied.
    #[error("cannot pick up '{wanted}': the gripper holds '{held}'")]
    Occupied {
        /// What was to be picked.
        wanted: String,
        /// What is in the gripper.
        held: String,
    },
    /// Nothing to release.
    #[error("the gripper holds nothing to release")]
    Empty,
    /// Robot and object in one place.
    #[error("{link} stands {:.1} mm deep in '{other}' at the start", 1e3 * .depth)]
    Overlap {
        /// Link of the robot.
        link: String,
        /// The object.
        other: String,
        /// How deep, m.
        depth: f64,
    },
    /// Objects in a run without contacts.
    #[error("there are objects around the robot, and nothing that solves contacts with them")]
    NoContacts,
}
