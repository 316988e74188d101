//! Time limit of a diagnosis, and the time of its stages.

use std::time::Instant;

use crate::terminal::interrupted;

/// Default computing time in s per sample of all recordings, and its lower bound in s. The library bounds the work of a
/// diagnosis; the most that was seen of it took 96 s for 100 000 samples, so a computer five times slower answers the same.
const PER_SAMPLE: f64 = 5e-3;
const MIN_SECONDS: f64 = 500.0;

/// Time limit of a diagnosis.
pub enum Allowance {
    /// Elapsed time.
    Passing {
        /// Start.
        begun: Instant,
        /// Limit, s.
        seconds: f64,
    },
    /// Computing time over all cores.
    Computing {
        /// Computing time of the process at the start, s.
        before: f64,
        /// Limit, s.
        seconds: f64,
    },
}

impl Allowance {
    /// Limit as given by the user, from `begun` on, or by the number of samples.
    pub fn new(begun: Instant, limit: Option<f64>, samples: usize) -> Self {
        match limit {
            Some(seconds) => Self::Passing { begun, seconds },
            None => Self::Computing { before: computed(), seconds: (PER_SAMPLE * samples as f64).max(MIN_SECONDS) },
        }
    }

    /// Share of the limit that has passed; infinite after Ctrl-C.
    pub fn passed(&self) -> f64 {
        match self {
            _ if interrupted() => f64::INFINITY,
            Self::Passing { begun, seconds } => begun.elapsed().as_secs_f64() / seconds,
            Self::Computing { before, seconds } => (computed() - before) / seconds,
        }
    }
}

/// Times of the stages of a diagnosis.
pub struct Stages {
    done: Vec<Stage>,
    begun: (Instant, f64),
    name: String,
}

/// A stage with the time it took.
pub struct Stage {
    /// What was done.
    pub name: String,
    /// Elapsed time, s.
    pub elapsed: f64,
    /// Computing time over all cores, s.
    pub computed: f64,
}

impl Stages {
    /// Begins with the first stage.
    pub fn new(first: &str) -> Self {
        Self { done: Vec::new(), begun: (Instant::now(), computed()), name: first.into() }
    }

    /// Ends the stage and begins the next one.
    pub fn next(&mut self, name: &str) {
        let (elapsed, computing) = (self.begun.0.elapsed().as_secs_f64(), computed() - self.begun.1);
        let ended = std::mem::replace(&mut self.name, name.into());
        self.done.push(Stage { name: ended, elapsed, computed: computing });
        self.begun = (Instant::now(), computed());
    }

    /// Ends the last stage; returns all.
    pub fn end(mut self) -> Vec<Stage> {
        self.next("");
        self.done
    }
}

/// Computing time of the process, s.
#[cfg(unix)]
fn computed() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

/// Computing time of the process, s; where the system does not report it, that of one permanently busy core.
#[cfg(not(unix))]
fn computed() -> f64 {
    static BEGUN: std::sync::OnceLock<Instant> = std::sync::OnceLock::new();
    BEGUN.get_or_init(Instant::now).elapsed().as_secs_f64()
}
