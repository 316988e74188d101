//! Errors of the evidence procedure.

/// Reason why a problem cannot be evaluated.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// A series differs in length from the stacked system.
    #[error("column {name:?} has {found} values, expected {expected}")]
    Length {
        /// Column or series.
        name: String,
        /// Its length.
        found: usize,
        /// Length of the stacked system.
        expected: usize,
    },
    /// A segment is outside the samples, empty, or overlaps its predecessor.
    #[error("segment {0} is empty, out of order or outside the samples")]
    Segment(usize),
    /// A value is NaN or infinite.
    #[error("column {0:?} holds a value that is not finite")]
    NotFinite(String),
    /// There are no channels or no samples.
    #[error("there is nothing to diagnose: no channels or no samples")]
    Empty,
    /// No more values than parameters.
    #[error("{values} values of channels that are not exactly explained are too few for {parameters} parameters")]
    Undetermined {
        /// Values of all channels with a residual.
        values: usize,
        /// Parameters.
        parameters: usize,
    },
    /// A chosen effect does not exist in the problem.
    #[error("chosen effect {0} or its variant is not in the problem")]
    Chosen(usize),
    /// The relinearised problem lists other candidates.
    #[error("the refitted problem lists other candidates than the first")]
    Candidates,
    /// The caller's refit failed.
    #[error("refit failed: {0}")]
    Refit(String),
}
