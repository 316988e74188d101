//! What was measured or simulated: joint angles, drive torques and optional channels over time.
//!
//! Only `csv.rs`, `bag/` and `rerun/` know file formats.

pub mod bag;
mod channels;
mod check;
pub mod columns;
pub mod csv;
mod difference;
mod epoch;
mod error;
pub mod file;
pub mod setup;

pub use bag::Context;
pub use channels::{ROWS, multiplier_names};
pub use columns::Mapping;
pub use difference::Difference;
pub use error::{ReadError, WriteError};

use std::ops::Range;
use std::path::Path;

use self::setup::Sidecar;
use crate::machine::{AXES, Mechanism, STRUTS, Setup};

/// One run of the machine, sampled at increasing times.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// Name for reports, usually the file's stem.
    pub name: String,
    /// Signals of every sample.
    pub signals: Signals,
    /// What is known about the run.
    pub setup: Setup,
}

/// How a file is read.
#[derive(Clone, Copy, Debug, Default)]
pub struct Reading<'a> {
    /// Setup instead of the sidecar.
    pub setup: Option<&'a Path>,
    /// Machine whose axes must be there; by the columns if none is given.
    pub machine: Option<Mechanism>,
    /// Which column is which channel, one after the other.
    pub maps: &'a [Mapping],
}

impl Recording {
    /// Reads a CSV file or a ROS 2 bag (`.mcap`, `.db3`, a bag's folder) of whatever machine it is by its axes: one, three or four.
    pub fn read(path: &Path, setup: Option<&Path>) -> Result<(Self, Vec<String>), ReadError> {
        Self::read_as(path, &Reading { setup, ..Reading::default() })
    }

    /// Reads a recording of a `machine`: its axes must be there, others are left out with a warning.
    ///
    /// See [`Recording::read_as`] for the rest.
    pub fn read_of(path: &Path, setup: Option<&Path>, machine: Mechanism) -> Result<(Self, Vec<String>), ReadError> {
        Self::read_as(path, &Reading { setup, machine: Some(machine), ..Reading::default() })
    }

    /// Reads a recording, its format known by its content. Also returns what was noticed and repaired.
    ///
    /// The setup is that of `how.setup`, else of the sidecar `<stem>.setup.toml`, else of the MCAP file's metadata, else
    /// the default. The sidecar's `[columns]` come before `how.maps`.
    ///
    /// # Errors
    /// What cannot be read or repaired, with file, row and column.
    pub fn read_as(path: &Path, how: &Reading) -> Result<(Self, Vec<String>), ReadError> {
        let beside = setup::sidecar(path);
        let outside = match how.setup {
            Some(file) => Some(Sidecar::read(file)?),
            None if beside.is_file() => Some(Sidecar::read(&beside)?),
            None => None,
        };
        let columns = outside.iter().map(|s| &s.columns).filter(|c| !c.is_empty());
        let maps: Vec<Mapping> = columns.chain(how.maps).cloned().collect();
        let outside = outside.map(|s| s.setup);
        let (signals, inside, mut warnings) = if bag::is_bag(path) {
            bag::read(path, how.machine, &maps)?
        } else {
            let (signals, warnings) = csv::read(path, how.machine, &maps)?;
            (signals, None, warnings)
        };
        if let (Some(a), Some(b)) = (outside, inside)
            && a != b
        {
            let used = how.setup.unwrap_or(&beside).display();
            warnings.push(format!("setup inside the file differs from {used}, which is used"));
        }
        let recording = Self {
            name: path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
            signals,
            setup: outside.or(inside).unwrap_or_default(),
        };
        let warnings = warnings.iter().map(|w| format!("{}: {w}", path.display())).collect();
        Ok((recording, warnings))
    }

    /// Writes `.csv` with its sidecar, or `.mcap`. A file that is there is replaced as a whole.
    ///
    /// # Errors
    /// Names with another ending, signals that no machine has, and whatever the system says.
    pub fn write(&self, path: &Path) -> Result<(), WriteError> {
        self.write_with(path, &Context::default())
    }

    /// The same with origin and pictures of the run, as far as the format keeps them: MCAP does, CSV does not.
    ///
    /// # Errors
    /// See [`Recording::write`].
    pub fn write_with(&self, path: &Path, context: &Context) -> Result<(), WriteError> {
        let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
        if extension == "csv" {
            csv::write(path, &self.signals)?;
            self.setup.write(&setup::sidecar(path))
        } else if extension == "mcap" {
            bag::write(path, self, context)
        } else {
            Err(WriteError::invalid(path, "unknown format; expected a name ending in .csv or .mcap"))
        }
    }
}

/// Sampled signals; all channels have the length of `t`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Signals {
    /// Kind of machine: only its axes are measured, the others are zero.
    pub mechanism: Mechanism,
    /// When t = 0 was, ns since 1970-01-01 UTC; `None` where it is not known, as of simulated runs.
    pub start: Option<i64>,
    /// Time, s.
    pub t: Vec<f64>,
    /// Joint angles q = (φ1, φ2, φ3, ψ) as the encoders see them, rad: of elastic gears on the motors' side.
    pub q: Vec<[f64; AXES]>,
    /// Drive torques at the gear output, N·m.
    pub tau: Vec<[f64; AXES]>,
    /// Axial force at the elbow end of each strut, tension positive, N.
    pub strut_upper: [Option<Vec<f64>>; STRUTS],
    /// Axial force at the platform end of each strut, tension positive, N.
    pub strut_lower: [Option<Vec<f64>>; STRUTS],
    /// Platform ball plane's centre, m.
    pub ee: Option<Vec<[f64; 3]>>,
    /// Rates of the same angles, rad/s.
    pub qd: Option<Vec<[f64; AXES]>>,
    /// Accelerations of the same angles, rad/s².
    pub qdd: Option<Vec<[f64; AXES]>>,
    /// What each ball socket could still take (six at the elbows, six at the platform), zero once open, N.
    pub socket_margin: Option<Vec<[f64; 2 * STRUTS]>>,
    /// Multipliers of all constraint rows, see [`multiplier_names`]; zero of joints that do not hold.
    pub multipliers: Option<Vec<[f64; ROWS]>>,
    /// Angles of the links, behind elastic gears, rad.
    pub link_q: Option<Vec<[f64; AXES]>>,
    /// Rates of the links, rad/s.
    pub link_qd: Option<Vec<[f64; AXES]>>,
    /// Stretches of samples without a gap in time between them; filters work on one at a time.
    ///
    /// Empty means a single stretch; read [`Signals::stretches`].
    pub segments: Vec<Range<usize>>,
}

impl Signals {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.t.len()
    }

    /// Whether there are no samples.
    pub fn is_empty(&self) -> bool {
        self.t.is_empty()
    }

    /// Index ranges of the uniformly sampled stretches, at least one unless there are no samples.
    pub fn stretches(&self) -> Vec<Range<usize>> {
        if self.segments.is_empty() && !self.is_empty() {
            std::iter::once(0..self.len()).collect()
        } else {
            self.segments.clone()
        }
    }

    /// Median sampling period, s; zero with fewer than two samples.
    pub fn sample_time(&self) -> f64 {
        let mut d: Vec<f64> = self.t.windows(2).map(|w| w[1] - w[0]).collect();
        if d.is_empty() {
            return 0.0;
        }
        let m = d.len() / 2;
        *d.select_nth_unstable_by(m, f64::total_cmp).1
    }
}
