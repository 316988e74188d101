//! Errors of the robot's surroundings.

use thiserror::Error;

/// Fault of a cell, or of a request to it.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum CellError {
    /// Two objects with the same name.
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
        /// Name of the quantity.
        what: &'static str,
        /// Its value.
        value: f64,
        /// Kind of number that was expected.
        expected: &'static str,
    },
    /// A free mesh that is not a convex hull.
    #[error("'{0}' is free, which a mesh cannot be; expected shape = \"hull\", or a fixed mesh")]
    FreeMesh(String),
    /// There is no object of that name.
    #[error("there is no object '{0}'")]
    Unknown(String),
    /// A request to pick an object that is not free.
    #[error("'{0}' is not free and cannot be picked up")]
    NotFree(String),
    /// A request to pick while the gripper holds an object.
    #[error("cannot pick up '{wanted}': the gripper holds '{held}'")]
    Occupied {
        /// Object to be picked.
        wanted: String,
        /// Object in the gripper.
        held: String,
    },
    /// A request to release while the gripper is empty.
    #[error("the gripper holds nothing to release")]
    Empty,
    /// Robot and object overlap at the start.
    #[error("{link} stands {:.1} mm deep in '{other}' at the start", 1e3 * .depth)]
    Overlap {
        /// Link of the robot.
        link: String,
        /// Name of the object.
        other: String,
        /// Penetration depth, m.
        depth: f64,
    },
    /// Objects in a run without a contact solver.
    #[error("there are objects around the robot, and nothing that solves contacts with them")]
    NoContacts,
}
