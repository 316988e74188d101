//! The recording of a watch.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::terminal::warn;
use deltatwin::machine::{Mechanism, Setup};
use deltatwin::model::Model;
use deltatwin::monitoring::{Sample, recording_of};
use deltatwin::recording::Context;
use deltatwin::twin::origin::{Links, measured};
use deltatwin_io::recording::{Head, Recorder};
use deltatwin_watch::stamped::SECOND;

/// Time after which what was appended is handed to the disk: a killed watch loses no more.
const KEPT: Duration = Duration::from_millis(500);
/// Time from which the seconds of a recording count at the latest, ns since 1970: the seconds of ROS 2 end in 2038.
const LATEST: i64 = 2_000_000_000 * SECOND;

/// A recording being written.
pub struct Tape {
    file: PathBuf,
    recorder: Recorder,
    mechanism: Mechanism,
    setup: Setup,
    context: Context,
    links: Links,
    kept: Instant,
    is_empty: bool,
}

fn begun(
    file: &Path,
    mechanism: Mechanism,
    setup: &Setup,
    context: &Context,
    start: Option<i64>,
) -> miette::Result<Recorder> {
    Ok(Recorder::create(file, &Head { mechanism, start, setup, context })?)
}

impl Tape {
    /// Begins the recording of the machine of `model`.
    pub fn create(file: &Path, model: &Model, setup: &Setup) -> miette::Result<Self> {
        let mechanism = model.mechanism;
        // Without the address of the source, which may contain a password.
        let name = model.path.as_deref().and_then(Path::file_name).unwrap_or_default().to_string_lossy();
        let context = measured(&format!("deltatwin watch {name}"), Some(model), setup);
        let recorder = begun(file, mechanism, setup, &context, None)?;
        if recorder.partial() != file {
            warn(&[format!("until the end, the recording is {}", recorder.partial().display())]);
        }
        let (links, kept) = (Links::new(model, setup), Instant::now());
        Ok(Self { file: file.into(), recorder, mechanism, setup: *setup, context, links, kept, is_empty: true })
    }

    /// The recording of samples whose times count from `origin`, ns on the machine's clock; before the first sample.
    pub fn since(self, origin: i64) -> miette::Result<Self> {
        if !self.is_empty || !(1..LATEST).contains(&origin) {
            return Ok(self);
        }
        // Of a recording without a sample, nothing is left.
        self.recorder.finish()?;
        let recorder = begun(&self.file, self.mechanism, &self.setup, &self.context, Some(origin))?;
        Ok(Self { recorder, ..self })
    }

    /// Appends samples in order of time.
    pub fn append(&mut self, samples: &[Sample]) -> miette::Result<()> {
        if samples.is_empty() {
            return Ok(());
        }
        self.is_empty = false;
        let signals = recording_of(samples, self.mechanism, &self.setup).signals;
        let poses = self.links.poses(&signals);
        Ok(self.recorder.append(&signals, &poses, &[], &[])?)
    }

    /// Makes sure, every half second, that everything so far is on the disk.
    pub fn keep(&mut self) -> miette::Result<()> {
        if self.kept.elapsed() < KEPT {
            return Ok(());
        }
        self.kept = Instant::now();
        Ok(self.recorder.keep()?)
    }

    /// Completes the recording.
    pub fn finish(self) -> miette::Result<()> {
        Ok(self.recorder.finish()?)
    }
}
