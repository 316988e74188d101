//! The cause of a change, searched in parallel with the watch.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use serde_json::{Value, json};

use deltatwin::diagnosis::change::{Cause, Changed, changed};
use deltatwin::diagnosis::{Options, Verdict, diagnose_with};
use deltatwin::identification::Dataset;
use deltatwin::machine::Setup;
use deltatwin::model::Model;
use deltatwin::monitoring::{Alarm, Sample, recording_of};

/// Time since the onset after which the cause is looked for first, s.
const FIRST: f64 = 20.0;
/// Time over which the torques are averaged, s: an answer in a fifth of the time, with all that a machine's motion excites.
const STEP: f64 = 2e-3;
/// Share of the samples that is held out: the later part.
const HELD_OUT: f64 = 1.0 / 3.0;
/// Pause between two looks for an answer.
const PAUSE: Duration = Duration::from_millis(20);
/// Share of the error above the noise that the changes must explain.
const ENOUGH: f64 = 0.5;

/// A question for the cause: what has changed from the healthy samples to the later ones.
pub struct Investigation {
    pub model: Model,
    pub setup: Setup,
    pub healthy: Vec<Sample>,
    pub later: Vec<Sample>,
}

/// The answer.
pub struct Finding {
    /// Start and end of the later samples, s.
    pub data: [f64; 2],
    /// Changes, or why there is no answer.
    pub changed: Result<Changed, String>,
    /// Names of the effects that an ordinary diagnosis of the later samples finds missing, where changes of known effects
    /// explain too little.
    pub missing: Option<(Verdict, Vec<String>)>,
}

impl Investigation {
    /// Start and end of the later samples, s.
    pub fn data(&self) -> [f64; 2] {
        [self.later.first(), self.later.last()].map(|sample| sample.map_or(0.0, |sample| sample.t))
    }

    /// The changes since the healthy samples, validated on the last third of the later ones. If these explain less than
    /// half of the error, an ordinary diagnosis of the later samples follows. It is cut short once it `is_superseded`.
    fn answer(&self, is_superseded: &AtomicBool) -> Finding {
        let clock = || if is_superseded.load(Ordering::Relaxed) { f64::INFINITY } else { 0.0 };
        let options = Options { clock: &clock, ..Options::default() };
        // A stated noise is that of single samples.
        let setup = Setup { torque_noise: None, ..self.setup };
        let data = self.data();
        let end = self.later.len() - (HELD_OUT * self.later.len() as f64) as usize;
        let dataset = |samples: &[Sample]| {
            let dataset = Dataset::new(&recording_of(samples, self.model.mechanism, &setup));
            let mut means = dataset.averaged(dataset.stride(STEP));
            means.name = "stream".into();
            means
        };
        let [healthy, fitted, held_out] = [&self.healthy, &self.later[..end], &self.later[end..]].map(dataset);
        if [&healthy, &fitted, &held_out].iter().any(|d| d.is_empty()) {
            let short = format!("{:.1} s since the onset are too few; expected {FIRST} s", data[1] - data[0]);
            return Finding { data, changed: Err(short), missing: None };
        }
        let (fitted, held_out) = ([fitted], [held_out]);
        let changed = changed(&self.model, &[healthy], &fitted, &held_out, &options).map_err(|e| e.to_string());
        let is_enough = changed.as_ref().is_ok_and(|c| !c.causes.is_empty() && c.explained() >= ENOUGH);
        let missing = if is_enough {
            None
        } else {
            let answer = diagnose_with(&self.model, &fitted, &held_out, &options, &mut |_| {});
            answer.ok().map(|a| (a.verdict, a.effects.into_iter().map(|e| e.name).collect()))
        };
        Finding { data, changed, missing }
    }
}

/// Investigations one after the other, in a thread of their own.
#[derive(Default)]
pub struct Investigations {
    running: Option<JoinHandle<Finding>>,
    /// Whether the running one is superseded.
    superseded: Arc<AtomicBool>,
    /// Time since the onset at which the next one is due, s.
    due: Option<f64>,
}

impl Investigations {
    /// Whether to look for the cause at time `now`, s: 20 s after the onset, then each time that this time has doubled.
    pub fn is_due(&mut self, alarm: Alarm, now: f64) -> bool {
        let due = *self.due.get_or_insert(FIRST);
        if self.running.is_some() || now - alarm.onset < due {
            return false;
        }
        self.due = Some(2.0 * (now - alarm.onset));
        true
    }

    /// Starts an investigation, in the place of one that still runs.
    pub fn start(&mut self, question: Investigation) {
        self.superseded.store(true, Ordering::Relaxed);
        let superseded = Arc::<AtomicBool>::default();
        self.superseded = superseded.clone();
        let work = move || question.answer(&superseded);
        self.running = std::thread::Builder::new().name("cause".into()).spawn(work).ok();
    }

    /// The answer, if there is one now.
    pub fn finished(&mut self) -> Option<Finding> {
        let done = self.running.take_if(|running| running.is_finished())?;
        done.join().ok()
    }

    /// The answer to come, unless it is `cancelled` before.
    pub fn wait(&mut self, cancelled: impl Fn() -> bool) -> Option<Finding> {
        while self.running.as_ref().is_some_and(|running| !running.is_finished()) && !cancelled() {
            std::thread::sleep(PAUSE);
        }
        self.finished()
    }
}

impl Finding {
    /// The answer as JSON.
    pub fn to_json(&self) -> Value {
        let mut out = json!({ "data": self.data });
        match &self.changed {
            Err(problem) => out["problem"] = json!(problem),
            Ok(changed) => {
                out["effects"] = changed.causes.iter().map(effect).collect();
                out["explained"] = json!(changed.explained());
                out["channels"] = changed.channels.iter().map(ToString::to_string).collect();
                out["rms_before"] = json!(changed.rms_before);
                out["rms_after"] = json!(changed.rms_after);
                out["noise_floor"] = json!(changed.noise_floor);
            }
        }
        if let Some((verdict, effects)) = &self.missing {
            out["diagnosis"] = json!({ "verdict": verdict.to_string(), "effects": effects });
        }
        out
    }

    /// One line per change.
    pub fn lines(&self) -> Vec<String> {
        let mut lines = match &self.changed {
            Err(problem) => vec![format!("no cause yet: {problem}")],
            Ok(changed) if changed.causes.is_empty() => vec!["no effect of the library has changed".into()],
            Ok(changed) => {
                let share = 100.0 * changed.explained();
                let causes = changed.causes.iter().map(line);
                causes
                    .chain([format!("together {share:.0} % of the error above the noise, on held-out data")])
                    .collect()
            }
        };
        if let Some((verdict, effects)) = &self.missing {
            let names = if effects.is_empty() { "no name".into() } else { effects.join(", ") };
            lines.push(format!("ordinary diagnosis of the same time: {verdict}, {names}"));
        }
        lines
    }
}

fn effect(cause: &Cause) -> Value {
    let parameters: serde_json::Map<String, Value> = cause
        .parameters
        .iter()
        .map(|p| {
            let std = p.std.is_finite().then_some(p.std);
            (p.name.clone(), json!({ "before": p.before, "after": p.after, "std": std, "unit": p.unit.to_string() }))
        })
        .collect();
    json!({
        "name": cause.name,
        "kind": if cause.was_present { "changed" } else { "new" },
        "p_value": cause.p_value,
        "indistinguishable": cause.rivals,
        "parameters": parameters,
    })
}

fn line(cause: &Cause) -> String {
    let what = if cause.was_present { "has changed" } else { "is new" };
    let parameters: Vec<String> = cause
        .parameters
        .iter()
        .map(|p| {
            let (before, after) = (deltatwin::text::significant(p.before, 4), deltatwin::text::significant(p.after, 4));
            let unit = p.unit;
            match p.before {
                0.0 => format!("{} {after} {unit}", p.name),
                _ => format!("{} {before} → {after} {unit} (× {:.2})", p.name, p.after / p.before),
            }
        })
        .collect();
    let rivals = if cause.rivals.is_empty() {
        String::new()
    } else {
        format!("; or {}, which these data do not tell apart", cause.rivals.join(", "))
    };
    format!("{} {what}: {}{rivals}", cause.name, parameters.join(", "))
}
