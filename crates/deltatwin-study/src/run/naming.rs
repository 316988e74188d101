//! What the diagnosis says of the recording of a run.

use deltatwin::diagnosis::{Diagnosis, Verdict, diagnose};
use deltatwin::identification::Dataset;
use deltatwin::recording::{Channel, Recording, Signals};

use super::{Case, Outcome};
use crate::campaign::{Column, Value};

/// Columns of [`Naming::row`].
const COLUMNS: &[Column] = &[
    Column::text("diagnosis"),
    Column::text("named"),
    Column::float("named_probability", "1"),
    Column::float("left", "1"),
    Column::float("recorded", "s"),
];
/// Share of the recording that is fitted; the rest validates.
const FITTED: f64 = 0.6;
/// Shortest recording that is diagnosed, s.
const SHORTEST: f64 = 1.0;

/// Diagnosis of the recording of a run up to its failure, with the controller's model and the payload it believes in.
pub struct Naming {
    /// The answer; `None` if the run failed too early to be diagnosed.
    diagnosis: Option<Diagnosis>,
    /// Length of the diagnosed recording, s.
    recorded: f64,
}

impl Naming {
    /// Diagnosis of `outcome`, whose recording is kept.
    ///
    /// # Errors
    /// Why the recording cannot be diagnosed, as one sentence.
    pub fn of(case: &Case, outcome: &Outcome) -> Result<Self, String> {
        let Some(recording) = &outcome.recording else { return Ok(Self { diagnosis: None, recorded: 0.0 }) };
        let failure = outcome.verdict.time.unwrap_or(f64::INFINITY);
        let signals = &recording.signals;
        let end = signals.t.partition_point(|t| *t < failure);
        let recorded = end as f64 * signals.sample_time();
        if recorded < SHORTEST {
            return Ok(Self { diagnosis: None, recorded });
        }
        let part = |from: usize, to: usize| {
            let setup = case.scenario.believed_setup();
            Dataset::new(&Recording { name: recording.name.clone(), signals: measured(signals, from, to), setup })
        };
        let middle = (FITTED * end as f64) as usize;
        let diagnosis = diagnose(case.planning(), &[part(0, middle)], &[part(middle, end)], &mut |_| {});
        Ok(Self { diagnosis: Some(diagnosis.map_err(|e| format!("diagnosis: {e}"))?), recorded })
    }

    /// Columns of the table that rows of namings form.
    pub fn columns() -> &'static [Column] {
        COLUMNS
    }

    /// Row under [`Self::columns`].
    pub fn row(&self) -> Vec<Value> {
        let Some(diagnosis) = &self.diagnosis else {
            return vec![Value::Missing, Value::Missing, Value::Missing, Value::Missing, self.recorded.into()];
        };
        let mut names: Vec<&str> = diagnosis.effects.iter().map(|e| e.name.as_str()).collect();
        names.sort_unstable();
        // The leading one of several that the recording does not tell apart is one of them.
        let joint = if diagnosis.verdict == Verdict::Ambiguous { " or others" } else { "" };
        let probability = diagnosis.effects.iter().map(|e| e.confidence.probability()).reduce(f64::min);
        let ratios = diagnosis.rms_after.iter().zip(&diagnosis.noise_floor).map(|(rms, floor)| rms / floor);
        vec![
            diagnosis.verdict.to_string().as_str().into(),
            if names.is_empty() { Value::Missing } else { format!("{}{joint}", names.join(" + ")).as_str().into() },
            probability.into(),
            ratios.fold(0.0, f64::max).into(),
            self.recorded.into(),
        ]
    }
}

/// Encoders and torques of the samples `from..to`: what a machine without further sensors records.
fn measured(signals: &Signals, from: usize, to: usize) -> Signals {
    signals.part(from..to).only(|channel| matches!(channel, Channel::Angle(_) | Channel::Torque(_)))
}
