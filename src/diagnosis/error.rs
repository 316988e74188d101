//! Why a diagnosis cannot be made.

use thiserror::Error;

use crate::evidence;
use crate::identification::fit::FitError;

/// Why a diagnosis cannot be made.
#[derive(Debug, Error)]
pub enum DiagnosisError {
    /// The model cannot be fitted.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// The statistics failed.
    #[error("diagnosis: {0}")]
    Evidence(#[from] evidence::Error),
    /// No recording was given.
    #[error("no recording to diagnose")]
    NoData,
    /// The recordings measure different channels.
    #[error("recordings {first} and {second} measure different channels")]
    Channels {
        /// Name of a recording.
        first: String,
        /// Name of another one.
        second: String,
    },
    /// There is no such effect.
    #[error("unknown effect `{0}`; `deltatwin effects` lists them")]
    UnknownEffect(String),
    /// The machine of the recordings lacks what the effect acts on.
    #[error("`{effect}` acts on {part}, which the machine of these recordings does not have")]
    Missing {
        /// Name of the effect.
        effect: String,
        /// What it acts on.
        part: &'static str,
    },
    /// The effect is in the twin only.
    #[error(
        "`{0}` acts in the twin only: inverse dynamics along a measured motion does not show it, so no data determine its \
         parameters; put its table into the model file by hand"
    )]
    TwinOnly(String),
    /// A formula has no law of its own.
    #[error(
        "`formula` has no law until its terms stand in the model file; write [[effects.formula.terms]] there by hand"
    )]
    NoTerms,
    /// The effect is in the model already.
    #[error("the model has `{0}` already")]
    Present(String),
}
