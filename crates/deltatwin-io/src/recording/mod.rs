//! Recordings as CSV with a sidecar, and as ROS 2 bags.

pub(crate) mod bag;
mod check;
mod columns;
mod csv;
mod dialect;
mod epoch;
mod error;
mod memory;
mod preview;
mod recorder;
pub mod setup;

pub use bag::{JointSample, Tail, begins_mcap};
pub use columns::Mapping;
pub use error::ReadError;
pub use preview::{Preview, PreviewColumn, preview};
pub use recorder::{Head, Recorder, clear_partial};

use std::path::Path;

use deltatwin::machine::Mechanism;
use deltatwin::recording::{Channel, Contacts, Context, Recording};

use self::setup::Sidecar;
use crate::file::{self, WriteError};

/// Options for reading a file.
#[derive(Clone, Copy, Debug, Default)]
pub struct Reading<'a> {
    /// Setup file in place of the sidecar.
    pub setup: Option<&'a Path>,
    /// Machine whose axes must be present; inferred from the columns if `None`.
    pub machine: Option<Mechanism>,
    /// Assignments of columns to channels, applied in order.
    pub maps: &'a [Mapping],
    /// Joint of a bag, or number of an axis in the names of the columns, that is read as a lone axis.
    pub joint: Option<&'a str>,
    /// Samples per second of a file without a column of time.
    pub rate: Option<f64>,
    /// Gear ratio of a recording of the motor's side: motor turns per turn, or per metre times 2π, of the joint.
    pub gear_ratio: Option<f64>,
    /// Memory that reading may need, bytes; by default three quarters of what is free.
    pub max_memory: Option<u64>,
}

/// Reads a CSV file or a ROS 2 bag (`.mcap`, `.db3`, bag folder) of a machine inferred from its number of axes: one,
/// three or four.
///
/// # Errors
/// As for [`read_as`].
pub fn read(path: &Path, setup: Option<&Path>) -> Result<(Recording, Vec<String>), ReadError> {
    read_as(path, &Reading { setup, ..Reading::default() })
}

/// Reads a recording of `machine`: its axes must be present, others are omitted with a warning.
///
/// # Errors
/// As for [`read_as`].
pub fn read_of(path: &Path, setup: Option<&Path>, machine: Mechanism) -> Result<(Recording, Vec<String>), ReadError> {
    read_as(path, &Reading { setup, machine: Some(machine), ..Reading::default() })
}

/// Reads a recording, whose format is determined from its content; also returns warnings about what was repaired.
///
/// The setup is that of `how.setup`, else of the sidecar `<stem>.setup.toml` if it states any, else of the MCAP metadata,
/// else the default. The sidecar's `[columns]` and then its `maps` are applied before `how.maps`.
///
/// # Errors
/// A [`ReadError`] if a file cannot be read or a fault cannot be repaired, with file, row and column.
pub fn read_as(path: &Path, how: &Reading) -> Result<(Recording, Vec<String>), ReadError> {
    let beside = setup::sidecar(path);
    let outside = match how.setup {
        Some(file) => Some(Sidecar::read(file)?),
        None if beside.is_file() => Some(Sidecar::read(&beside)?),
        None => None,
    };
    let maps: Vec<Mapping> = outside.iter().flat_map(Sidecar::assignments).chain(how.maps).cloned().collect();
    let machine = how.machine.or(outside.as_ref().and_then(|s| s.machine));
    let outside = outside.and_then(|s| s.setup);
    let (signals, inside, mut warnings) = if bag::is_bag(path) {
        bag::read(path, &Reading { machine, maps: &maps, ..*how })?
    } else {
        let (signals, warnings) = csv::read(path, &Reading { machine, maps: &maps, ..*how })?;
        (signals, None, warnings)
    };
    if let (Some(a), Some(b)) = (outside, inside)
        && a != b
    {
        let used = how.setup.unwrap_or(&beside).display();
        warnings.push(format!("setup inside the file differs from {used}, which is used"));
    }
    let mut setup = outside.or(inside).unwrap_or_default();
    if how.joint.is_some() {
        // Noise is stated for all axes of the machine that the joint is taken from.
        setup.torque_noise = None;
    }
    if let Some(misfit) = setup.load.misfit(signals.mechanism) {
        let from = how.setup.map_or(beside, Path::to_path_buf);
        let (problem, expected) = misfit.split_once("; expected ").unwrap_or((misfit, "another load"));
        return Err(ReadError::content(&from, problem, expected));
    }
    if !setup.load.is_none() && signals.get(Channel::Load(0)).is_some() {
        warnings.push("`[load]` ignored: the load was measured (`load1`)".into());
    }
    let recording =
        Recording { name: path.file_stem().unwrap_or_default().to_string_lossy().into_owned(), signals, setup };
    let warnings = warnings.iter().map(|w| format!("{}: {w}", path.display())).collect();
    Ok((recording, warnings))
}

/// Contacts of the robot that a bag written by deltatwin holds, in order of time; none for another file.
///
/// # Errors
/// A [`ReadError`] if a file cannot be read.
pub fn contacts(path: &Path) -> Result<Vec<Contacts>, ReadError> {
    if bag::is_bag(path) { bag::contacts(path) } else { Ok(Vec::new()) }
}

/// Writes a recording as `.csv` with its sidecar or as `.mcap`; an existing file is replaced.
///
/// # Errors
/// As for [`write_with`].
pub fn write(recording: &Recording, path: &Path) -> Result<(), WriteError> {
    write_with(recording, path, &Context::default())
}

/// Writes a recording like [`write()`], with provenance and display data of the run, which MCAP stores and CSV does
/// not.
///
/// # Errors
/// [`WriteError::Invalid`] for another file extension or inconsistent signals, [`WriteError::Io`] if a file cannot be
/// written.
pub fn write_with(recording: &Recording, path: &Path, context: &Context) -> Result<(), WriteError> {
    let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
    if extension == "csv" {
        file::replace(path, |out| csv::write(out, &recording.signals))?;
        setup::write_beside(&recording.setup, recording.signals.mechanism, &setup::sidecar(path))
    } else if extension == "mcap" {
        file::replace(path, |out| bag::write(out, recording, context))
    } else {
        Err(WriteError::invalid(path, UNKNOWN_FORMAT))
    }
}

const UNKNOWN_FORMAT: &str = "unknown format; expected a name ending in .csv or .mcap";
