//! Errors of a fit.

use thiserror::Error;

use crate::identification::Dataset;
use crate::kinematics::KinematicsError;

/// Reason why a fit is not possible.
#[derive(Debug, Error)]
pub enum FitError {
    /// A measured pose is impossible for the model's geometry.
    #[error("recording {recording}: {reason}; is it this robot, in radians, with axes in order?")]
    Kinematics {
        /// Name of the recording.
        recording: String,
        /// Cause.
        reason: KinematicsError,
    },
    /// The recordings are of an assembled and of a disassembled robot, whose parameters differ.
    #[error(
        "recordings {first} and {second} are of an assembled and of a disassembled robot, which have different parameters; \
         expected one configuration"
    )]
    Configurations {
        /// Name of a recording.
        first: String,
        /// Name of another one.
        second: String,
    },
    /// The recordings measure different channels.
    #[error("recordings {first} and {second} measure different channels: {differ}; expected the same in all")]
    Channels {
        /// Name of a recording.
        first: String,
        /// Name of another one.
        second: String,
        /// The channels that only one of them has.
        differ: String,
    },
    /// Too few samples.
    #[error("recording {recording}: {samples} samples are left after differentiation, at least {needed} are needed")]
    TooShort {
        /// Name of the recording.
        recording: String,
        /// Number of samples left.
        samples: usize,
        /// Number of samples needed.
        needed: usize,
    },
    /// Every parameter is fixed.
    #[error("every parameter of the model is held; expected at least one to estimate")]
    NothingToEstimate,
    /// The machine has no flange for a payload.
    #[error(
        "recording {recording} is of a machine without a flange (a lone axis, or a robot that is taken apart), which carries no \
         payload; expected an assembled delta robot"
    )]
    NoFlange {
        /// Name of the recording.
        recording: String,
    },
    /// A weight γ refers to a group without parameters.
    #[error(
        "no parameter to estimate belongs to {group:?}; expected torque, bodies, friction, a kind of body or an effect: {known}"
    )]
    NoSuchGroup {
        /// The requested group.
        group: String,
        /// The existing groups.
        known: String,
    },
    /// The normal equations are not finite or not positive definite.
    #[error("the least-squares problem has no finite solution")]
    NotFinite,
}

/// Conversion of a kinematic error into a [`FitError`] with the recording's name.
pub fn kinematics(dataset: &Dataset) -> impl Fn(KinematicsError) -> FitError + '_ {
    |reason| FitError::Kinematics { recording: dataset.name.clone(), reason }
}
