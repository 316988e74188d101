//! Why a diagnosis cannot be made.

use thiserror::Error;

use super::problem;
use crate::evidence;
use crate::identification::Dataset;
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
    /// Too little is left of the recordings for statistics.
    #[error(
        "diagnosis: {used:.3} s of {recorded:.3} s are usable ({rows} means of {block} samples; the noise model needs the first \
         {skip} of each of {stretches} stretches), expected at least {needed:.3} s ({means} means); record longer, or without gaps",
        block = problem::BLOCK
    )]
    TooShort {
        /// Length of all stretches, s.
        recorded: f64,
        /// Stretches of evenly spaced samples.
        stretches: usize,
        /// Part of it that statistics can use, s.
        used: f64,
        /// The same in means.
        rows: usize,
        /// Means that the noise model needs of each stretch.
        skip: usize,
        /// Least length, s.
        needed: f64,
        /// The same in means.
        means: usize,
    },
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

impl DiagnosisError {
    /// An error of the statistics on means of samples, in the seconds of the recordings.
    pub(super) fn of_statistics(error: evidence::Error, datasets: &[Dataset]) -> Self {
        let evidence::Error::TooShort { rows, skip, needed: means } = error else { return error.into() };
        let mean = problem::BLOCK as f64 * datasets.iter().map(|t| t.dt).fold(0.0, f64::max);
        let (stretches, all) = problem::segments(datasets);
        Self::TooShort {
            recorded: all as f64 * mean,
            stretches: stretches.len(),
            used: rows as f64 * mean,
            rows,
            skip,
            needed: means as f64 * mean,
            means,
        }
    }
}
