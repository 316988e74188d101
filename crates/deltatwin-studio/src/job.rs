//! Work in the background: one at a time, with stage, share done and time left, and it can be cancelled.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use serde_json::{Value, json};

/// Work that goes on.
pub struct Job {
    /// Stage of the loop, such as `fit`.
    pub stage: &'static str,
    begun: Instant,
    cancelled: AtomicBool,
    progress: Mutex<(f64, String)>,
}

/// Share of the work below which its time left is not estimated.
const EARLY: f64 = 0.08;

impl Job {
    /// Work on `stage` that begins now.
    pub fn new(stage: &'static str) -> Self {
        Self { stage, begun: Instant::now(), cancelled: AtomicBool::new(false), progress: Mutex::default() }
    }

    /// Asks the work to end without a result.
    pub fn cancel(&self) {
        self.cancelled.store(true, Ordering::Relaxed);
    }

    /// Whether it was asked to end.
    pub fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }

    /// Reports that the share `fraction` is done and what is done now; the fraction never falls.
    pub fn at(&self, fraction: f64, what: &str) {
        if let Ok(mut progress) = self.progress.lock() {
            *progress = (progress.0.max(fraction), what.to_string());
        }
    }

    /// Time since its beginning, s.
    pub fn seconds(&self) -> f64 {
        self.begun.elapsed().as_secs_f64()
    }

    /// Stage, share, what is done, time passed and left (s).
    pub fn json(&self) -> Value {
        let (fraction, what) = self.progress.lock().map(|p| p.clone()).unwrap_or_default();
        let passed = self.seconds();
        let left = (fraction > EARLY).then(|| passed * (1.0 - fraction) / fraction);
        json!({"stage": self.stage, "fraction": fraction, "what": what, "passed": passed, "left": left, "cancelled": self.is_cancelled()})
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_never_falls() {
        let job = Job::new("fit");
        assert!(job.json()["left"].is_null());
        job.at(0.5, "a");
        job.at(0.2, "b");
        let state = job.json();
        assert_eq!((state["fraction"].as_f64(), state["what"].as_str()), (Some(0.5), Some("b")));
        assert!(state["left"].as_f64().is_some());
        job.cancel();
        assert!(job.is_cancelled());
    }
}
