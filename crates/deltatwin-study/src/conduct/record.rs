//! Recordings of runs that were made again.

use std::path::Path;

use deltatwin::recording::Context;
use deltatwin::twin::origin::{origin, with_run};
use deltatwin_io::file::WriteError;
use deltatwin_io::recording;

use super::{Conduct, Remade};

impl Remade {
    /// Writes the recording (MCAP or CSV) with everything that is needed to make it again.
    ///
    /// # Errors
    /// If the file cannot be written, or the motion was refused before it began.
    pub fn write_recording(&self, conduct: &Conduct, file: &Path) -> Result<(), WriteError> {
        let Some(recording) = &self.outcome.recording else {
            return Err(WriteError::invalid(
                file,
                "the motion was refused before it began, so that nothing was recorded",
            ));
        };
        recording::write_with(recording, file, &self.context(conduct))
    }

    fn context(&self, conduct: &Conduct) -> Context {
        let (case, scenario) = (&self.case, conduct.study.scenario());
        let mut context = origin(&case.scenario, (scenario, Some(&self.text)), &case.model, case.planning());
        let study = conduct.study.path.file_name().unwrap_or_default().to_string_lossy();
        let command = format!("deltatwin study {study} --run {}", self.run);
        context.provenance.insert("command".into(), command);
        context.provenance.insert("study".into(), study.into_owned());
        context.provenance.insert("study_digest".into(), conduct.campaign.digest.hex());
        context.provenance.insert("run".into(), self.run.to_string());
        with_run(context, &case.model, &self.outcome.options, &self.outcome.report)
    }
}
