//! Errors of recordings and setups.

use std::path::{Path, PathBuf};

use miette::Diagnostic;
use thiserror::Error;

use crate::source::Problem;

/// Why a recording or setup was rejected.
#[derive(Debug, Error, Diagnostic)]
pub enum ReadError {
    /// The file cannot be opened or read.
    #[error("{}: cannot be read: {reason}", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// Error of the operating system.
        reason: std::io::Error,
    },
    /// The file as a whole is not valid.
    #[error("{}: {problem}; expected {expected}", file.display())]
    Content {
        /// The file.
        file: PathBuf,
        /// What is wrong.
        problem: String,
        /// What was expected.
        expected: String,
    },
    /// A single value is not valid.
    #[error("{}: {row}, column `{column}`: {problem}; expected {expected}", file.display())]
    Value {
        /// The file.
        file: PathBuf,
        /// Row, e.g. `line 17`.
        row: String,
        /// Name of the channel.
        column: String,
        /// What is wrong, with the value.
        problem: String,
        /// What was expected.
        expected: String,
    },
    /// An error in a setup file.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Setup(#[from] Problem),
}

impl ReadError {
    pub(super) fn io(file: &Path, reason: std::io::Error) -> Self {
        Self::Io { file: file.into(), reason }
    }

    pub(super) fn content(file: &Path, problem: impl Into<String>, expected: impl Into<String>) -> Self {
        Self::Content { file: file.into(), problem: problem.into(), expected: expected.into() }
    }
}
