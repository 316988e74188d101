//! Errors of a diagnosis.

use thiserror::Error;

use crate::evidence;
use crate::identification::fit::FitError;

/// Reason why a diagnosis is not possible.
#[derive(Debug, Error)]
pub enum DiagnosisError {
    /// The model cannot be fitted.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// The statistics failed.
    #[error("diagnosis: {0}")]
    Evidence(#[from] evidence::Error),
    /// The recordings have too few rows to show what has changed.
    #[error("{0}; record longer, or without gaps")]
    TooFew(evidence::TooFew),
    /// The clock has stopped the diagnosis.
    #[error("the diagnosis was stopped")]
    Stopped,
    /// No recording was given.
    #[error("no recording to diagnose")]
    NoData,
    /// There is no such effect.
    #[error("unknown effect `{0}`; `deltatwin effects` lists them")]
    UnknownEffect(String),
    /// The machine of the recordings lacks what the effect acts on.
    #[error("`{effect}` acts on {part}, which the machine of these recordings does not have")]
    Missing {
        /// Name of the effect.
        effect: String,
        /// Part that it acts on.
        part: &'static str,
    },
    /// The effect exists in the twin only.
    #[error(
        "`{0}` acts in the twin only: inverse dynamics along a measured motion does not show it, so no data determine its \
         parameters; put its table into the model file by hand"
    )]
    TwinOnly(String),
    /// The recordings do not show what the effect needs: orders of cogging, or samples of its ringing.
    #[error(
        "these recordings determine no `{0}`: cogging needs lines of the residual over the joint angle, elastic gears more \
         than 250 samples per second; put its table into the model file by hand"
    )]
    NotResolved(String),
    /// A formula has no terms.
    #[error(
        "`formula` has no law until its terms stand in the model file; write [[effects.formula.terms]] there by hand"
    )]
    NoTerms,
    /// The model contains the effect already.
    #[error("the model has `{0}` already")]
    Present(String),
}
