//! Errors of a diagnosis.

use thiserror::Error;

use super::problem;
use crate::evidence;
use crate::identification::Dataset;
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
    /// The recordings are too short for the statistics.
    #[error(
        "diagnosis: {used:.3} s of {recorded:.3} s are usable ({rows} means of {block} samples; the noise model needs the first \
         {skip} of each of {stretches} stretches), expected at least {needed:.3} s ({means} means); record longer, or without gaps"
    )]
    TooShort {
        /// Duration of all segments, s.
        recorded: f64,
        /// Number of segments.
        stretches: usize,
        /// Duration that the statistics can use, s.
        used: f64,
        /// Number of samples in a mean.
        block: usize,
        /// Number of means in that duration.
        rows: usize,
        /// Number of means that the noise model needs of each segment.
        skip: usize,
        /// Least duration, s.
        needed: f64,
        /// Number of means in the least duration.
        means: usize,
    },
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

impl DiagnosisError {
    /// Error of the statistics on means of samples, expressed in seconds of the recordings.
    pub(super) fn of_statistics(error: evidence::Error, datasets: &[Dataset]) -> Self {
        let evidence::Error::TooShort { rows, skip, needed: means } = error else { return error.into() };
        let block = problem::block(datasets);
        let mean = block as f64 * datasets.iter().map(|t| t.dt).fold(0.0, f64::max);
        let (stretches, all) = problem::segments(datasets);
        Self::TooShort {
            recorded: all as f64 * mean,
            stretches: stretches.len(),
            used: rows as f64 * mean,
            block,
            rows,
            skip,
            needed: means as f64 * mean,
            means,
        }
    }
}
