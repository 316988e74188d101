//! Reasons why a campaign cannot go on.

use std::io;
use std::path::{Path, PathBuf};

use ::parquet::errors::ParquetError;
use miette::Diagnostic;
use thiserror::Error;

use super::chunk::Chunk;

/// Why a campaign cannot go on.
#[derive(Debug, Error, Diagnostic)]
pub enum CampaignError {
    /// The file system failed.
    #[error("{}: {reason}", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// Error of the operating system.
        reason: io::Error,
    },
    /// A file is no table, or not a whole one.
    #[error("{}: cannot be read as a table: {reason}; expected a Parquet file of a study", file.display())]
    Content {
        /// The file.
        file: PathBuf,
        /// Error of the reader.
        reason: ParquetError,
    },
    /// Rows of another campaign are in the way.
    #[error(
        "{}: belongs to another study, {found}; this one is {expected}; expected an empty folder or one of the same \
         study",
        file.display()
    )]
    Foreign {
        /// The file.
        file: PathBuf,
        /// Name and digest of what is there.
        found: String,
        /// Name and digest of the campaign.
        expected: String,
    },
    /// Rows of the same campaign by another build are in the way: their physics may differ.
    #[error(
        "{}: was made by another build of deltatwin, {}, this one is {}; expected an empty folder, or the build that \
         began",
        file.display(), short(found), short(expected)
    )]
    OtherBuild {
        /// The file.
        file: PathBuf,
        /// Build that made what is there.
        found: String,
        /// This build.
        expected: String,
    },
    /// Another process makes the same chunk.
    #[error("{}: another process is making this chunk", file.display())]
    Taken {
        /// Its journal.
        file: PathBuf,
    },
    /// Parts are missing.
    #[error("{}: {} of {of} runs are missing, the first is run {first}", folder.display(), .missing)]
    Incomplete {
        /// The folder.
        folder: PathBuf,
        /// Number of runs without a row.
        missing: u64,
        /// Number of runs.
        of: u64,
        /// First run without a row.
        first: u64,
        /// Chunks to be made, of the number of chunks of which most are there.
        chunks: Vec<Chunk>,
    },
    /// A run cannot be made at all.
    #[error("run {run}: {reason}")]
    Run {
        /// The run.
        run: u64,
        /// Why.
        reason: Box<dyn std::error::Error + Send + Sync>,
    },
    /// The watch asked to stop; what was done is kept.
    #[error("interrupted")]
    Interrupted,
}

/// The beginning of a digest, which is enough to tell two apart.
pub(super) fn short(digest: &str) -> &str {
    match digest.get(..12) {
        Some(short) => short,
        None if digest.is_empty() => "unnamed",
        None => digest,
    }
}

impl CampaignError {
    pub(super) fn io(file: &Path) -> impl FnOnce(io::Error) -> Self + '_ {
        move |reason| Self::Io { file: file.into(), reason }
    }

    pub(super) fn content(file: &Path) -> impl FnOnce(ParquetError) -> Self + '_ {
        move |reason| match reason {
            // The reader wraps errors of the operating system.
            ParquetError::External(error) => match error.downcast::<io::Error>() {
                Ok(reason) => Self::Io { file: file.into(), reason: *reason },
                Err(error) => Self::Content { file: file.into(), reason: ParquetError::External(error) },
            },
            reason => Self::Content { file: file.into(), reason },
        }
    }
}
