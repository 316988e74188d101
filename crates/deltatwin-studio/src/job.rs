//! Work in the background: one at a time, with stage, share done and time left, and it can be cancelled.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use deltatwin::diagnosis::progress::Promise;
use serde_json::{Value, json};

/// Work that goes on.
pub struct Job {
    /// Stage of the loop, such as `fit`.
    pub stage: &'static str,
    begun: Instant,
    cancelled: AtomicBool,
    step: Mutex<Step>,
    /// What is known of the candidates before the work is done, most likely first.
    first: Mutex<Vec<Value>>,
}

/// A step of the work, from the share of the work before it to the share after it.
struct Step {
    what: String,
    span: (f64, f64),
    begun: Instant,
    /// Beginning of the first step, which reading the data precedes.
    first: Instant,
    /// Expected time of the whole work, s; none is expected before the data are known.
    whole: Option<f64>,
}

/// Number of ranked candidates that are shown before the work is done.
const FIRST: usize = 5;

/// Share of the work from which the time passed determines the expected time.
const EARLY: f64 = 0.08;

impl Job {
    /// Work on `stage` that begins now.
    pub fn new(stage: &'static str) -> Self {
        let begun = Instant::now();
        let step = Step { what: String::new(), span: (0.0, 0.0), begun, first: begun, whole: None };
        Self { stage, begun, cancelled: AtomicBool::new(false), step: Mutex::new(step), first: Mutex::default() }
    }

    /// Asks the work to end without a result.
    pub fn cancel(&self) {
        self.cancelled.store(true, Ordering::Relaxed);
    }

    /// Whether it was asked to end.
    pub fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }

    fn step(&self) -> MutexGuard<'_, Step> {
        self.step.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The data are read; the work begins, and is expected to take so many seconds.
    pub fn expect(&self, seconds: f64) {
        let mut step = self.step();
        step.first = Instant::now();
        step.whole = Some(seconds);
    }

    /// Begins the step `what`, which is done between two shares of the work; the share done never falls.
    pub fn at(&self, (from, to): (f64, f64), what: &str) {
        let mut step = self.step();
        let now = from.max(step.fraction());
        let whole = if now > EARLY { Some(step.first.elapsed().as_secs_f64() / now) } else { step.whole };
        *step = Step { what: what.into(), span: (now, to.max(now)), begun: Instant::now(), whole, first: step.first };
    }

    /// Keeps the first of the ranked candidates to be shown.
    pub fn rank(&self, promises: &[Promise]) {
        let one = |p: &Promise| json!({"name": p.name, "explained": p.explained, "p_adjusted": p.p_adjusted});
        let first = promises.iter().take(FIRST).map(one).collect();
        *self.first.lock().unwrap_or_else(PoisonError::into_inner) = first;
    }

    /// Time since its beginning, s.
    pub fn seconds(&self) -> f64 {
        self.begun.elapsed().as_secs_f64()
    }

    /// Stage, share, step, time passed and left (s), and the first of the ranked candidates.
    pub fn json(&self) -> Value {
        let step = self.step();
        let fraction = step.fraction();
        let left = step.whole.map(|whole| whole * (1.0 - fraction));
        let first = self.first.lock().unwrap_or_else(PoisonError::into_inner).clone();
        json!({"stage": self.stage, "fraction": fraction, "what": step.what, "passed": self.seconds(), "left": left, "cancelled": self.is_cancelled(), "first": first})
    }
}

impl Step {
    /// Share of the work done, by the time expected for this step; it approaches the end of a step that takes longer.
    fn fraction(&self) -> f64 {
        let (from, to) = self.span;
        let expected = self.whole.unwrap_or(0.0) * (to - from);
        let passed = if expected > 0.0 { self.begun.elapsed().as_secs_f64() / expected } else { 0.0 };
        from + (to - from) * passed / 1.0f64.hypot(passed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_moves_within_a_step_and_never_falls() {
        let job = Job::new("fit");
        assert!(job.json()["left"].is_null());
        let fraction = || job.json()["fraction"].as_f64().unwrap();
        job.expect(0.2);
        job.at((0.0, 0.5), "a");
        let pause = || std::thread::sleep(std::time::Duration::from_millis(30));
        let mut last = 0.0;
        for _ in 0..8 {
            pause();
            let now = fraction();
            assert!(now > last && now <= 0.5, "{now} after {last}");
            last = now;
        }
        let left = job.json()["left"].as_f64().unwrap();
        assert!(left < 0.12, "{left}");
        job.at((0.2, 0.3), "b");
        let state = job.json();
        assert!(state["fraction"].as_f64().unwrap() >= last && state["what"] == "b", "{state}");
        job.at((0.9, 1.0), "c");
        assert!(fraction() >= 0.9 && fraction() < 1.0);
        job.cancel();
        assert!(job.is_cancelled());
    }

    #[test]
    fn the_first_of_the_ranked_candidates_are_shown() {
        let job = Job::new("why");
        assert_eq!(job.json()["first"], json!([]));
        let promise = |k: usize| Promise { name: format!("effect {k}"), explained: 1.0 / k as f64, p_adjusted: 0.01 };
        job.rank(&(1..=40).map(promise).collect::<Vec<_>>());
        let state = job.json();
        assert_eq!(state["first"].as_array().map(Vec::len), Some(FIRST));
        assert_eq!(state["first"][1], json!({"name": "effect 2", "explained": 0.5, "p_adjusted": 0.01}));
    }
}
