//! Reading of whole files, and writing: atomic replacement, and files that grow for hours.

use std::collections::BTreeSet;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Component, Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use miette::Diagnostic;
use tempfile::NamedTempFile;
use thiserror::Error;

/// Why a file was not written.
#[derive(Debug, Error)]
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

impl Diagnostic for WriteError {
    fn help<'a>(&'a self) -> Option<Box<dyn std::fmt::Display + 'a>> {
        use io::ErrorKind::{FileTooLarge, QuotaExceeded, StorageFull};
        let Self::Io { reason, .. } = self else { return None };
        let is_full = matches!(reason.kind(), StorageFull | QuotaExceeded | FileTooLarge);
        let help = "the disk, its quota or the limit on sizes of files is used up: free space, or write elsewhere";
        is_full.then(|| Box::new(help) as Box<dyn std::fmt::Display>)
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

/// Size of the longest text that is read as a whole, bytes: descriptions are written by hand.
const LONGEST_TEXT: u64 = 16 << 20;

/// Opens a file to be read; a device, a pipe or a folder is none and might never end.
///
/// # Errors
/// The error of the operating system, or that `path` is no file.
pub fn open(path: &Path) -> io::Result<File> {
    // Asked before opening, which would wait for the other end of a pipe.
    if !std::fs::metadata(path)?.is_file() {
        return Err(io::Error::other("it is a device, a pipe or a folder; expected a file"));
    }
    File::open(path)
}

/// The content of a file of at most `most` bytes.
///
/// # Errors
/// The error of the operating system, or that the file is none or longer.
pub fn bytes(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    let mut out = Vec::new();
    // It may grow meanwhile.
    open(path)?.take(most + 1).read_to_end(&mut out)?;
    if out.len() as u64 > most {
        return Err(io::Error::other(format!("it is longer than {} MB", most >> 20)));
    }
    Ok(out)
}

/// The content of a text file.
///
/// # Errors
/// As for [`bytes`], for more than 16 MB, or that it is not text.
pub fn text(path: &Path) -> io::Result<String> {
    let not_text = |_| io::Error::new(io::ErrorKind::InvalidData, "it is not text in UTF-8");
    String::from_utf8(bytes(path, LONGEST_TEXT)?).map_err(not_text)
}

/// Longest time for which appended bytes may be lost by a power cut.
const UNSAFE_TIME: Duration = Duration::from_millis(500);

/// A file that grows under a name of its own, `<stem>.partial.<extension>` in the same folder, until it is complete.
///
/// A file of the final name is replaced when the new one is complete, and not before; what has been written survives
/// the end of the process at once and a power cut after [`Self::keep`].
#[derive(Debug)]
pub struct Growing {
    appender: Appender,
    partial: PathBuf,
    target: PathBuf,
    synced: Instant,
}

/// End of a [`Growing`] file, to which anything may be appended.
#[derive(Clone, Debug)]
pub struct Appender(Arc<Mutex<BufWriter<File>>>);

impl Appender {
    fn file(&self) -> MutexGuard<'_, BufWriter<File>> {
        // A writer that panicked has appended a part of its record, which readers skip.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Write for Appender {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file().flush()
    }
}

impl Seek for Appender {
    fn seek(&mut self, position: SeekFrom) -> io::Result<u64> {
        self.file().seek(position)
    }
}

impl Growing {
    /// Creates the file that will become `target`; files of earlier runs that did not end are left alone, see
    /// [`clear_partial`].
    ///
    /// # Errors
    /// The error of the operating system.
    pub fn create(target: &Path) -> io::Result<Self> {
        let target = place(target)?;
        for number in 1.. {
            let partial = partial_name(&target, number);
            match OpenOptions::new().write(true).create_new(true).open(&partial) {
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {}
                Err(e) => return Err(e),
                Ok(file) => {
                    // As long as it grows; where the file system has no locks, nobody clears it.
                    let _ = file.try_lock();
                    sync_folder(&partial);
                    let appender = Appender(Arc::new(Mutex::new(BufWriter::new(file))));
                    return Ok(Self { appender, partial, target, synced: Instant::now() });
                }
            }
        }
        Err(io::ErrorKind::AlreadyExists.into())
    }

    /// The end of the file.
    pub fn appender(&self) -> Appender {
        self.appender.clone()
    }

    /// The name under which the file grows.
    pub fn partial(&self) -> &Path {
        &self.partial
    }

    /// Hands everything appended so far to the operating system, and to the disk if that was last done half a second
    /// ago.
    ///
    /// # Errors
    /// The error of the operating system.
    pub fn keep(&mut self) -> io::Result<()> {
        let mut file = self.appender.file();
        file.flush()?;
        if self.synced.elapsed() >= UNSAFE_TIME {
            file.get_ref().sync_data()?;
            drop(file);
            self.synced = Instant::now();
        }
        Ok(())
    }

    /// Gives the complete file its final name.
    ///
    /// # Errors
    /// The error of the operating system; the file then keeps the name under which it grew.
    pub fn complete(self) -> io::Result<()> {
        if let Ok(metadata) = std::fs::metadata(&self.target) {
            self.appender.file().get_ref().set_permissions(metadata.permissions())?;
        }
        self.end()?;
        std::fs::rename(&self.partial, &self.target)?;
        sync_folder(&self.target);
        Ok(())
    }

    /// Brings the file to the disk; it keeps the name under which it grew.
    ///
    /// # Errors
    /// The error of the operating system.
    pub fn end(&self) -> io::Result<()> {
        let mut file = self.appender.file();
        file.flush()?;
        file.get_ref().sync_all()
    }

    /// Removes the file.
    pub fn discard(self) {
        // Whether it is there or not, nothing of it is wanted.
        let _ = std::fs::remove_file(&self.partial);
    }
}

/// Where the file called `path` is or will be; what a link leads to must not be a device or a pipe.
fn place(path: &Path) -> io::Result<PathBuf> {
    if std::fs::metadata(path).is_ok_and(|m| !m.is_file()) {
        return Err(io::Error::other("it exists and is no file"));
    }
    Ok(path.canonicalize().unwrap_or_else(|_| path.to_path_buf()))
}

/// Name for a part of what was to become `target`: its own, unless a file has it.
pub fn name_of_part(target: &Path) -> PathBuf {
    let partials = (1..).map(|number| partial_name(target, number));
    let mut names = std::iter::once(target.to_path_buf()).chain(partials);
    names.find(|name| !name.exists()).unwrap_or_else(|| target.to_path_buf())
}

/// Name of the `number`th file, from 1, that grows to become `target`.
fn partial_name(target: &Path, number: usize) -> PathBuf {
    let stem = target.file_stem().unwrap_or_default().to_string_lossy();
    let extension = target.extension().unwrap_or_default().to_string_lossy();
    let number = if number == 1 { String::new() } else { format!("-{number}") };
    target.with_file_name(format!("{stem}.partial{number}.{extension}"))
}

/// Brings the names of the folder that holds `path` to the disk, as far as the system can.
fn sync_folder(path: &Path) {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    // Not every file system can; the content of the file is on the disk in any case.
    let _ = File::open(folder).and_then(|folder| folder.sync_all());
}

fn atomically(path: &Path, write: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>) -> io::Result<()> {
    let path = place(path)?;
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let temporary = temporary(folder)?;
    let mut out = BufWriter::new(temporary.as_file());
    write(&mut out)?;
    out.flush()?;
    drop(out);
    temporary.as_file().sync_all()?;
    if let Ok(metadata) = std::fs::metadata(&path) {
        temporary.as_file().set_permissions(metadata.permissions())?;
    }
    temporary.persist(&path)?;
    sync_folder(&path);
    Ok(())
}

/// Beginning of the names of files that are being written, and number of random letters and digits that follow.
const TEMPORARY: (&str, usize) = (".writing-", 6);

/// A new file in `folder`, locked while it is written. The first one in a folder clears what killed writers left there.
fn temporary(folder: &Path) -> io::Result<NamedTempFile> {
    static CLEARED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    if CLEARED.lock().unwrap_or_else(PoisonError::into_inner).insert(folder.into()) {
        clear_leftovers(folder);
    }
    let mut builder = tempfile::Builder::new();
    builder.prefix(TEMPORARY.0).rand_bytes(TEMPORARY.1);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666)); // minus the umask, as for any new file
    }
    loop {
        let file = builder.tempfile_in(folder)?;
        // Until it is locked, another process may take it for a leftover. File systems without locks keep leftovers.
        match file.as_file().try_lock() {
            Err(TryLockError::WouldBlock) => {}
            _ if !file.path().exists() => {}
            _ => return Ok(file),
        }
    }
}

/// Removes the files in `folder` of writers that no longer live; what cannot be removed stays.
fn clear_leftovers(folder: &Path) {
    let is_ours = |path: &PathBuf| {
        let name = path.file_name().and_then(|n| n.to_str()).and_then(|n| n.strip_prefix(TEMPORARY.0));
        name.is_some_and(|n| n.len() == TEMPORARY.1 && n.bytes().all(|b| b.is_ascii_alphanumeric()))
    };
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    for path in entries.filter(is_ours) {
        remove_unused(&path);
    }
}

/// Removes a file unless a living process has locked it; returns whether it is gone.
fn remove_unused(path: &Path) -> bool {
    let is_file = std::fs::symlink_metadata(path).is_ok_and(|m| m.is_file());
    let Some(file) = is_file.then(|| File::open(path).ok()).flatten() else { return false };
    file.try_lock().is_ok() && std::fs::remove_file(path).is_ok()
}

/// Largest number of a file of a killed run that is cleared.
const MOST_PARTIAL: usize = 100;

/// Removes the files that killed runs left on their way to `target`, and returns their names; files of living runs stay.
/// They may be all there is of a recording until `target` is complete.
pub fn clear_partial(target: &Path) -> Vec<PathBuf> {
    let Ok(target) = place(target) else { return Vec::new() };
    let mut all: Vec<PathBuf> = (1..=MOST_PARTIAL).map(|number| partial_name(&target, number)).collect();
    all.retain(|partial| remove_unused(partial));
    all
}

/// Checks that files can be written into `folder`, which may have to be created, and clears what killed writers left
/// there; a folder that does not exist is not left behind.
///
/// # Errors
/// The error of the operating system.
pub fn check_folder(folder: &Path) -> io::Result<()> {
    let is_missing = |f: &&Path| !f.as_os_str().is_empty() && !f.exists();
    let missing: Vec<&Path> = folder.ancestors().take_while(is_missing).collect();
    let written = std::fs::create_dir_all(folder).and_then(|()| temporary(folder)).map(drop);
    // Another process may already use them.
    missing.into_iter().for_each(|f| drop(std::fs::remove_dir(f)));
    written
}

/// The way from the folder `folder` to `file`, both absolute; `file` itself on another drive.
pub(crate) fn way(file: &Path, folder: &Path) -> PathBuf {
    let mut plain: Vec<Component> = Vec::new();
    for part in file.components() {
        match part {
            Component::ParentDir => drop(plain.pop()),
            Component::CurDir => {}
            other => plain.push(other),
        }
    }
    let common = plain.iter().zip(folder.components()).take_while(|(a, b)| **a == *b).count();
    if common == 0 {
        return file.to_path_buf();
    }
    let up = folder.components().skip(common).map(|_| Component::ParentDir);
    up.chain(plain.iter().copied().skip(common)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn leftovers_of_dead_writers_alone_are_cleared() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let others = [".writing-notes.txt", ".writing-abc", "writing-abcdef"].map(at);
        let left = at(".writing-aB3xyZ");
        others.iter().chain([&left]).for_each(|file| std::fs::write(file, "half").unwrap());
        let living = temporary(folder.path()).unwrap();
        clear_leftovers(folder.path());
        assert!(!left.exists() && living.path().exists() && others.iter().all(|file| file.exists()));
        std::fs::write(&left, "half").unwrap();
        clear_leftovers(folder.path());
        assert!(!left.exists() && living.path().exists());

        let target = at("run.mcap");
        std::fs::write(at("run.partial.mcap"), "half").unwrap();
        let growing = Growing::create(&target).unwrap();
        assert_eq!(growing.partial(), at("run.partial-2.mcap"));
        assert_eq!(clear_partial(&target), [at("run.partial.mcap")]);
        assert!(!at("run.partial.mcap").exists() && growing.partial().exists());
    }

    #[test]
    fn folders_are_checked_without_a_trace() {
        let folder = tempfile::tempdir().unwrap();
        let new = folder.path().join("a/b");
        check_folder(&new).unwrap();
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        std::fs::write(folder.path().join("a"), "a file").unwrap();
        assert!(check_folder(&new).is_err() && folder.path().join("a").is_file());
    }

    #[test]
    fn a_file_is_found_from_another_folder() {
        let from = |file: &str, folder: &str| way(Path::new(file), Path::new(folder)).display().to_string();
        assert_eq!(from("/a/models/cad/arm.stl", "/a/models"), "cad/arm.stl");
        assert_eq!(from("/a/models/cad/arm.stl", "/a/out/run1"), "../../models/cad/arm.stl");
        assert_eq!(from("/a/models/../cad/arm.stl", "/a/out"), "../cad/arm.stl");
    }
}
