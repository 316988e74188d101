//! What can be wrong with a recording or its setup.

use std::path::{Path, PathBuf};

use miette::Diagnostic;
use thiserror::Error;

use crate::source::Problem;

/// Why a recording or setup was refused.
#[derive(Debug, Error, Diagnostic)]
pub enum ReadError {
    /// The file cannot be opened or read.
    #[error("{}: cannot be read: {reason}", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// What the system said.
        reason: std::io::Error,
    },
    /// The file as a whole is not what it should be.
    #[error("{}: {problem}; expected {expected}", file.display())]
    Content {
        /// The file.
        file: PathBuf,
        /// What is wrong.
        problem: String,
        /// What should be there.
        expected: String,
    },
    /// One value is not what it should be.
    #[error("{}: {row}, column `{column}`: {problem}; expected {expected}", file.display())]
    Value {
        /// The file.
        file: PathBuf,
        /// Where, e.g. `line 17`.
        row: String,
        /// Name of the channel.
        column: String,
        /// What is wrong, with the value.
        problem: String,
        /// What should be there.
        expected: String,
    },
    /// A setup file with a mistake.
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
