//! Atomic replacement of files.

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
        /// Error of the operating system.
        reason: io::Error,
    },
    /// The content or the file name is not valid.
    #[error("{}: cannot be written: {problem}", file.display())]
    Invalid {
        /// The file.
        file: PathBuf,
        /// What is wrong.
        problem: String,
    },
}

impl WriteError {
    /// An error in the content for `file`.
    pub fn invalid(file: &Path, problem: impl Into<String>) -> Self {
        Self::Invalid { file: file.into(), problem: problem.into() }
    }
}

/// Replaces the file at `path` by the output of `write`; on an error the file is unchanged.
///
/// The content is written to a temporary file in the same folder, which is then renamed. Permissions are kept; of a
/// symbolic link the target is replaced.
///
/// # Errors
/// [`WriteError::Io`] with the error of the operating system or of `write`.
pub fn replace<E: Into<io::Error>>(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&File>) -> Result<(), E>,
) -> Result<(), WriteError> {
    atomically(path, |out| write(out).map_err(Into::into))
        .map_err(|reason| WriteError::Io { file: path.into(), reason })
}

/// Replaces the file at `path` by `text`, see [`replace`].
///
/// # Errors
/// The error of the operating system, without the file name; the file is then unchanged.
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
        builder.permissions(std::fs::Permissions::from_mode(0o666)); // minus the umask, as for any new file
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
