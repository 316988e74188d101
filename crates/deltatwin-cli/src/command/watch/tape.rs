//! The recording of a watch.

use std::path::Path;
use std::time::{Duration, Instant};

use miette::IntoDiagnostic;

use crate::terminal::warn;
use deltatwin::machine::{Mechanism, Setup};
use deltatwin::model::Model;
use deltatwin::monitoring::{Sample, recording_of};
use deltatwin::twin::origin::{Links, measured};
use deltatwin_io::recording::{Head, Recorder};

/// Time after which what was appended is handed to the disk: a killed watch loses no more.
const KEPT: Duration = Duration::from_millis(500);

/// A recording being written.
pub struct Tape {
    recorder: Recorder,
    mechanism: Mechanism,
    setup: Setup,
    links: Links,
    kept: Instant,
}

impl Tape {
    /// Begins the recording of the machine of `model`.
    pub fn create(file: &Path, model: &Model, setup: &Setup) -> miette::Result<Self> {
        let mechanism = model.mechanism;
        // Without the address of the source, which may contain a password.
        let name = model.path.as_deref().and_then(Path::file_name).unwrap_or_default().to_string_lossy();
        let context = measured(&format!("deltatwin watch {name}"), Some(model), setup);
        let head = Head { mechanism, start: None, setup, context: &context };
        let recorder = Recorder::create(file, &head).into_diagnostic()?;
        if recorder.partial() != file {
            warn(&[format!("until the end, the recording is {}", recorder.partial().display())]);
        }
        Ok(Self { recorder, mechanism, setup: *setup, links: Links::new(model, setup), kept: Instant::now() })
    }

    /// Appends samples in order of time.
    pub fn append(&mut self, samples: &[Sample]) -> miette::Result<()> {
        if samples.is_empty() {
            return Ok(());
        }
        let signals = recording_of(samples, self.mechanism, &self.setup).signals;
        let poses = self.links.poses(&signals);
        self.recorder.append(&signals, &poses, &[], &[]).into_diagnostic()
    }

    /// Makes sure, every half second, that everything so far is on the disk.
    pub fn keep(&mut self) -> miette::Result<()> {
        if self.kept.elapsed() < KEPT {
            return Ok(());
        }
        self.kept = Instant::now();
        self.recorder.keep().into_diagnostic()
    }

    /// Completes the recording.
    pub fn finish(self) -> miette::Result<()> {
        self.recorder.finish().into_diagnostic()
    }
}
