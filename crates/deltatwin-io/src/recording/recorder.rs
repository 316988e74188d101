//! A recording that is on the disk while it is made.

use std::path::{Path, PathBuf};

use deltatwin::machine::{Mechanism, Setup};
use deltatwin::recording::{Contacts, Context, Note, Poses, Signals};

use super::{bag, csv, setup};
use crate::file::{Appender, Growing, WriteError};

/// What is known before the first sample of a recording.
#[derive(Clone, Copy, Debug)]
pub struct Head<'a> {
    /// Kind of machine.
    pub mechanism: Mechanism,
    /// Instant of t = 0, ns since 1970-01-01 UTC; `None` if unknown.
    pub start: Option<i64>,
    /// Known conditions of the run.
    pub setup: &'a Setup,
    /// Provenance, attachments and description; its poses, contacts and events are not written.
    pub context: &'a Context,
}

/// A recording, `.mcap` or `.csv`, that grows sample by sample at constant memory.
///
/// Until it is finished it has the name `<stem>.partial.<extension>`, which all commands read. What was appended is
/// on the disk within half a second if [`Self::append`] or [`Self::keep`] is called as often; of the last chunk of a
/// bag, a tenth of a second at 2.5 kHz, only [`Self::keep`] makes sure.
pub struct Recorder {
    growing: Growing,
    target: PathBuf,
    format: Format,
    /// Sidecar of the file that grows, and of the complete one.
    sidecars: Option<[PathBuf; 2]>,
    is_empty: bool,
}

enum Format {
    Bag(Box<bag::Writer<Appender>>),
    Csv(csv::Writer<Appender>),
}

impl Recorder {
    /// Begins the recording `target`.
    ///
    /// # Errors
    /// [`WriteError::Invalid`] for another file extension, [`WriteError::Io`] if the file cannot be created.
    pub fn create(target: &Path, head: &Head) -> Result<Self, WriteError> {
        let failed = |reason| WriteError::Io { file: target.into(), reason };
        let extension = target.extension().unwrap_or_default().to_ascii_lowercase();
        if extension != "csv" && extension != "mcap" {
            return Err(WriteError::invalid(target, super::UNKNOWN_FORMAT));
        }
        let growing = Growing::create(target).map_err(failed)?;
        let mut sidecars = None;
        let format = if extension == "mcap" {
            Format::Bag(Box::new(bag::Writer::new(growing.appender(), head).map_err(failed)?))
        } else {
            let names = [setup::sidecar(growing.partial()), setup::sidecar(target)];
            setup::write_beside(head.setup, head.mechanism, &names[0])?;
            sidecars = Some(names);
            Format::Csv(csv::Writer::new(growing.appender(), head.start.unwrap_or(0)))
        };
        Ok(Self { growing, target: target.into(), format, sidecars, is_empty: true })
    }

    /// The name that the recording has until it is finished.
    pub fn partial(&self) -> &Path {
        self.growing.partial()
    }

    /// Appends samples, all with the same channels, and the poses, contacts and events among them, which a CSV has not.
    ///
    /// # Errors
    /// [`WriteError::Io`] for inconsistent signals, a time that ROS 2 cannot represent, or if the file cannot be
    /// written.
    pub fn append(
        &mut self,
        signals: &Signals,
        poses: &[Poses],
        contacts: &[Contacts],
        notes: &[Note],
    ) -> Result<(), WriteError> {
        self.is_empty &= signals.is_empty();
        let appended = match &mut self.format {
            Format::Bag(bag) => bag.append(signals, poses, contacts, notes),
            Format::Csv(csv) => csv.append(signals),
        };
        appended.and_then(|()| self.growing.keep()).map_err(|e| self.failed(e))
    }

    /// Hands everything appended so far to the operating system, and to the disk if that was last done half a second
    /// ago.
    ///
    /// # Errors
    /// [`WriteError::Io`] if the file cannot be written.
    pub fn keep(&mut self) -> Result<(), WriteError> {
        let ended = match &mut self.format {
            Format::Bag(bag) => bag.end_chunk(),
            Format::Csv(_) => Ok(()),
        };
        ended.and_then(|()| self.growing.keep()).map_err(|e| self.failed(e))
    }

    /// Completes the recording and gives it its name; without a single sample, nothing is left of it.
    ///
    /// # Errors
    /// [`WriteError::Io`] if the file cannot be written.
    pub fn finish(self) -> Result<(), WriteError> {
        self.end(true).map(drop)
    }

    /// Completes the recording of a run that was ended before its time. As [`Self::finish`], but a file of its name
    /// stays as it is: the part then keeps the name under which it grew. Returns its name.
    ///
    /// # Errors
    /// As for [`Self::finish`].
    pub fn finish_part(self) -> Result<PathBuf, WriteError> {
        let is_free = !self.target.exists();
        self.end(is_free)
    }

    fn end(self, named: bool) -> Result<PathBuf, WriteError> {
        let Self { growing, target, format, sidecars, is_empty } = self;
        let failed = |reason| WriteError::Io { file: target.clone(), reason };
        let finished = match format {
            _ if is_empty => {
                growing.discard();
                sidecars.iter().for_each(remove_first);
                return Ok(target);
            }
            Format::Bag(bag) => bag.finish(),
            Format::Csv(csv) => csv.finish(),
        };
        if !named {
            finished.and_then(|()| growing.end()).map_err(failed)?;
            return Ok(growing.partial().into());
        }
        finished.and_then(|()| growing.complete()).map_err(failed)?;
        if let Some([own, last]) = sidecars.filter(|[own, _]| own.is_file()) {
            std::fs::rename(&own, &last).map_err(|reason| WriteError::Io { file: last, reason })?;
        }
        Ok(target)
    }

    fn failed(&self, reason: std::io::Error) -> WriteError {
        let file = if self.is_empty { self.target.clone() } else { self.growing.partial().into() };
        WriteError::Io { file, reason }
    }
}

/// Removes what killed runs left on their way to the recording `target`, which is complete, with their sidecars.
pub fn clear_partial(target: &Path) {
    for gone in crate::file::clear_partial(target) {
        // A bag has none.
        let _ = std::fs::remove_file(setup::sidecar(&gone));
    }
}

/// Removes the sidecar of a file that did not come to be.
fn remove_first([own, _]: &[PathBuf; 2]) {
    // There may be none.
    let _ = std::fs::remove_file(own);
}
