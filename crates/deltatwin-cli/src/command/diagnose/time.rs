//! The time that a diagnosis may take.

use std::time::Instant;

use crate::terminal::interrupted;

/// Default: computing time per sample of all recordings, and at least, s. On two idle cores that is 30 s for twice 50 000 samples,
/// however long a busy machine takes for it.
const PER_SAMPLE: f64 = 4.8e-4;
const LEAST: f64 = 48.0;

/// What a diagnosis may take.
pub enum Allowance {
    /// Seconds that pass.
    Passing {
        /// When it began.
        begun: Instant,
        /// How many.
        seconds: f64,
    },
    /// Seconds of computing, over all cores.
    Computing {
        /// What the process had used before.
        before: f64,
        /// How many.
        seconds: f64,
    },
}

impl Allowance {
    /// As the user says, or by the number of samples.
    pub fn new(limit: Option<f64>, samples: usize) -> Self {
        match limit {
            Some(seconds) => Self::Passing { begun: Instant::now(), seconds },
            None => Self::Computing { before: computed(), seconds: (PER_SAMPLE * samples as f64).max(LEAST) },
        }
    }

    /// Share of it that has passed; without end after Ctrl-C.
    pub fn passed(&self) -> f64 {
        match self {
            _ if interrupted() => f64::INFINITY,
            Self::Passing { begun, seconds } => begun.elapsed().as_secs_f64() / seconds,
            Self::Computing { before, seconds } => (computed() - before) / seconds,
        }
    }
}

/// Computing time of the process, s.
#[cfg(unix)]
fn computed() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

/// Computing time of the process, s; where the system's is not known, as if one core worked all the time.
#[cfg(not(unix))]
fn computed() -> f64 {
    static BEGUN: std::sync::OnceLock<Instant> = std::sync::OnceLock::new();
    BEGUN.get_or_init(Instant::now).elapsed().as_secs_f64()
}
