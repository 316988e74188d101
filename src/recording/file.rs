//! Files that appear complete or not at all.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use tempfile::NamedTempFile;

use super::WriteError;

/// Empty temporary file beside `path`, to be renamed to it.
pub(super) fn beside(path: &Path) -> io::Result<NamedTempFile> {
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let mut builder = tempfile::Builder::new();
    builder.prefix(".writing-");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666)); // the umask still applies
    }
    builder.tempfile_in(folder)
}

/// Lets `write` fill a temporary file, then renames it to `path`.
pub fn replace<E: Into<io::Error>>(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&File>) -> Result<(), E>,
) -> Result<(), WriteError> {
    let io_error = |source| WriteError::Io { file: path.into(), source };
    let temporary = beside(path).map_err(io_error)?;
    let mut out = BufWriter::new(temporary.as_file());
    write(&mut out).map_err(|e| io_error(e.into()))?;
    out.flush().map_err(io_error)?;
    drop(out);
    temporary.persist(path).map_err(|e| io_error(e.error))?;
    Ok(())
}
