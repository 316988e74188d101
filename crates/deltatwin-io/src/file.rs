//! Replacing a file as a whole.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use miette::Diagnostic;
use thiserror::Error;

/// Why a file was not written.
#[derive(Debug, Error, Diagnostic)]
pub enum WriteError {
    /// The file cannot be created, written or renamed.
    #[error("{}: cannot be written: {reason}", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// What the system said.
        reason: io::Error,
    },
    /// The content or the name does not allow it.
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

/// Replaces the file at `path` by what `write` writes, or leaves it as it was: the content goes to a temporary file in the
/// same folder, which is then renamed. A symbolic link stays, its target is replaced; permissions stay.
///
/// # Errors
/// What the system or `write` says; the file is then unchanged.
pub fn replace<E: Into<io::Error>>(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&File>) -> Result<(), E>,
) -> Result<(), WriteError> {
    atomically(path, |out| write(out).map_err(Into::into))
        .map_err(|reason| WriteError::Io { file: path.into(), reason })
}

/// Replaces the file at `path` by `text`, see [`replace`]; the error does not name the file.
///
/// # Errors
/// What the system says; the file is then unchanged.
pub fn replace_text(path: &Path, text: &str) -> io::Result<()> {
    atomically(path, |out| out.write_all(text.as_bytes()))
}

fn atomically(path: &Path, write: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>) -> io::Result<()> {
    let path = path.canonicalize().unwrap_or_else(|_| path.to_path_buf());
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut builder = tempfile::Builder::new();
    builder.prefix(".writing-");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666)); // less the umask, as for any new file
    }
    let temporary = builder.tempfile_in(folder)?;
    let mut out = BufWriter::new(temporary.as_file());
    write(&mut out)?;
    out.flush()?;
    drop(out);
    temporary.as_file().sync_all()?;
    if let Ok(metadata) = std::fs::metadata(&path) {
        temporary.as_file().set_permissions(metadata.permissions())?;
    }
    temporary.persist(&path)?;
    Ok(())
}
