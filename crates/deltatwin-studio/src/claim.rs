//! One studio at a time on a folder: a second one would overwrite what the first has put into the session.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{ErrorKind, Seek, Write};
use std::net::SocketAddr;
use std::path::Path;

use miette::{IntoDiagnostic, WrapErr, miette};

/// Name of the file that is locked. It holds the address of the studio.
const FILE: &str = ".studio.lock";

/// A folder claimed by this process. The system ends the lock with the process, however that ends.
pub(crate) struct Claim(File);

impl Claim {
    /// Claims `folder`.
    ///
    /// # Errors
    /// If another studio has it open, or the file cannot be created.
    pub fn take(folder: &Path) -> miette::Result<Self> {
        let path = folder.join(FILE);
        let file = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path);
        let file = file.into_diagnostic().wrap_err_with(|| path.display().to_string())?;
        match file.try_lock() {
            Ok(()) => file.set_len(0).into_diagnostic()?,
            Err(TryLockError::WouldBlock) => {
                // Where a locked file cannot be read, and in the moment before the address is known, there is none.
                let address = std::fs::read_to_string(&path).unwrap_or_default();
                let at = if address.is_empty() { String::new() } else { format!(" at {address}") };
                return Err(miette!(
                    "{}: already open{at}; expected another folder, or that studio ended first",
                    folder.display()
                ));
            }
            // Some file systems have no locks.
            Err(TryLockError::Error(e)) if e.kind() == ErrorKind::Unsupported => {}
            Err(TryLockError::Error(e)) => {
                return Err(e).into_diagnostic().wrap_err_with(|| path.display().to_string());
            }
        }
        Ok(Self(file))
    }

    /// Notes the address at which the studio answers, without the token.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn note(&self, address: SocketAddr) -> std::io::Result<()> {
        let mut file = &self.0;
        file.set_len(0)?;
        file.rewind()?;
        write!(file, "http://{address}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_claimed_once_at_a_time() {
        let folder = tempfile::tempdir().unwrap();
        // What a killed process has left blocks nothing.
        std::fs::write(folder.path().join(FILE), "http://127.0.0.1:9").unwrap();
        let claim = Claim::take(folder.path()).unwrap();
        claim.note(([127, 0, 0, 1], 4711).into()).unwrap();
        let refused = Claim::take(folder.path()).err().unwrap().to_string();
        assert!(refused.contains("already open at http://127.0.0.1:4711;"), "{refused}");
        drop(claim);
        assert!(Claim::take(folder.path()).is_ok());
    }
}
