//! Where the samples of a run go: into its file while it lasts, and into memory if they are needed as a whole.

use std::path::PathBuf;

use deltatwin::machine::Setup;
use deltatwin::recording::{Contacts, Note, Poses, Signals};
use deltatwin::twin::origin::{contacts, note, poses};
use deltatwin::twin::{Frame, Piece, Receiver};
use deltatwin_io::file::WriteError;
use deltatwin_io::recording::{Head, Recorder, clear_partial};

use super::Job;

/// A run being received.
pub struct Receiving<'a> {
    job: &'a Job,
    /// The setup that the recording states.
    setup: &'a Setup,
    progress: &'a mut dyn FnMut(f64) -> bool,
    recorder: Option<Recorder>,
    received: Received,
}

/// What is left of a run after its end, besides its file.
#[derive(Default)]
pub struct Received {
    /// Number of samples.
    pub samples: usize,
    /// All samples and frames, if the job keeps them.
    pub signals: Signals,
    pub frames: Vec<Frame>,
    /// The file; the part of an interrupted run has another name if a file of the job's name exists.
    pub file: Option<PathBuf>,
    /// Whether the run was stopped before its end.
    pub stopped: bool,
    /// Why the file was not written, if it was not.
    pub problem: Option<WriteError>,
}

impl<'a> Receiving<'a> {
    /// Nothing received yet of a run of `job` whose recording states `setup`; its file is created with the first samples.
    pub fn new(job: &'a Job, setup: &'a Setup, progress: &'a mut dyn FnMut(f64) -> bool) -> Self {
        Self { job, setup, progress, recorder: None, received: Received::default() }
    }

    /// Completes the recording.
    pub fn finish(self) -> Received {
        let Self { job, recorder, mut received, .. } = self;
        // After an error, the file is left as it is: it may be all there is.
        if let Some(recorder) = recorder.filter(|_| received.problem.is_none()) {
            let finished = match received.stopped {
                true => recorder.finish_part().map(Some),
                false => recorder.finish().map(|()| job.output.clone()),
            };
            // The same run, killed earlier, is now complete.
            if finished.is_ok() && !received.stopped {
                job.output.iter().for_each(|output| clear_partial(output));
            }
            match finished {
                Ok(file) => received.file = file,
                Err(problem) => received.problem = Some(problem),
            }
        }
        received
    }

    fn record(&mut self, piece: &Piece) -> Result<(), WriteError> {
        let Job { machine, options, origin, output: Some(output), .. } = self.job else { return Ok(()) };
        let recorder = match &mut self.recorder {
            Some(recorder) => recorder,
            none => {
                let head = Head { mechanism: machine.mechanism, start: None, setup: self.setup, context: origin };
                none.insert(Recorder::create(output, &head)?)
            }
        };
        let poses: Vec<Poses> = piece.frames.iter().filter_map(|frame| poses(machine, options, frame)).collect();
        let contacts: Vec<Contacts> = piece.frames.iter().map(|frame| contacts(options, frame)).collect();
        let notes: Vec<Note> = piece.events.iter().map(note).collect();
        recorder.append(&piece.signals, &poses, &contacts, &notes)
    }
}

impl Receiver for Receiving<'_> {
    fn progress(&mut self, t: f64) -> bool {
        self.received.stopped |= !(self.progress)(t);
        self.received.problem.is_none() && !self.received.stopped
    }

    fn piece(&mut self, piece: Piece) -> bool {
        self.received.samples += piece.signals.len();
        if self.received.problem.is_none() && !piece.signals.is_empty() {
            self.received.problem = self.record(&piece).err();
        }
        if self.job.keeps {
            self.received.frames.extend(piece.frames);
            self.received.signals.extend(piece.signals);
        }
        self.received.problem.is_none()
    }
}
