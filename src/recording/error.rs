//! What can be wrong with a recording or its setup.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use miette::{Diagnostic, NamedSource, SourceSpan};
use thiserror::Error;

/// Why a recording or setup was refused.
#[derive(Debug, Error, Diagnostic)]
pub enum ReadError {
    /// The file cannot be opened or read.
    #[error("{}: cannot be read: {source}", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// What the system said.
        source: std::io::Error,
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
    #[error("{place}: {message}")]
    Setup {
        /// `file:line:column`.
        place: String,
        /// What is wrong and what was expected.
        message: String,
        /// The setup's text.
        #[source_code]
        text: Arc<NamedSource<String>>,
        /// Where the mistake is.
        #[label("here")]
        span: SourceSpan,
    },
}

impl ReadError {
    pub(super) fn io(file: &Path, source: std::io::Error) -> Self {
        Self::Io { file: file.into(), source }
    }

    pub(super) fn content(file: &Path, problem: impl Into<String>, expected: impl Into<String>) -> Self {
        Self::Content { file: file.into(), problem: problem.into(), expected: expected.into() }
    }
}

/// Why a recording was not written.
#[derive(Debug, Error, Diagnostic)]
pub enum WriteError {
    /// The file cannot be created, written or renamed.
    #[error("{}: cannot be written: {source}", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The recording or the name does not allow it.
    #[error("{}: cannot be written: {problem}", file.display())]
    Invalid {
        /// The file.
        file: PathBuf,
        /// What is wrong.
        problem: String,
    },
}

impl WriteError {
    /// An error of what was to be written to `file`.
    pub fn invalid(file: &Path, problem: impl Into<String>) -> Self {
        Self::Invalid { file: file.into(), problem: problem.into() }
    }
}
