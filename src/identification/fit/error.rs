//! Why a fit cannot be made.

use thiserror::Error;

use crate::identification::Dataset;
use crate::kinematics::KinematicsError;

/// Why a fit cannot be made.
#[derive(Debug, Error)]
pub enum FitError {
    /// A measured pose is impossible for the model's geometry.
    #[error("recording {recording}: {source}; is it this robot, in radians, with axes in order?")]
    Kinematics {
        /// Name of the recording.
        recording: String,
        /// What is wrong.
        source: KinematicsError,
    },
    /// The robot was taken apart between recordings: no set of parameters fits both.
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
    /// Too few samples.
    #[error("recording {recording}: {samples} samples are left after differentiation, at least {needed} are needed")]
    TooShort {
        /// Name of the recording.
        recording: String,
        /// Samples left.
        samples: usize,
        /// Samples needed.
        needed: usize,
    },
    /// Every parameter is fixed.
    #[error("every parameter of the model is held; expected at least one to estimate")]
    NothingToEstimate,
    /// There is nothing a payload could hang at.
    #[error(
        "recording {recording} is of a machine without a flange (a lone axis, or a robot that is taken apart), which carries no \
         payload; expected an assembled delta robot"
    )]
    NoFlange {
        /// Name of the recording.
        recording: String,
    },
    /// A weight γ of something that is not there.
    #[error(
        "no parameter to estimate belongs to {group:?}; expected torque, bodies, friction, a kind of body or an effect: {known}"
    )]
    NoSuchGroup {
        /// What was asked for.
        group: String,
        /// What there is.
        known: String,
    },
    /// The numbers ran away.
    #[error("the least-squares problem has no finite solution")]
    NotFinite,
}

/// Attaches the recording's name to a kinematic error.
pub fn kinematics(dataset: &Dataset) -> impl Fn(KinematicsError) -> FitError + '_ {
    |source| FitError::Kinematics { recording: dataset.name.clone(), source }
}
