//! Time limit of a diagnosis.

use std::time::Instant;

use crate::terminal::interrupted;

/// Default computing time in s per sample of all recordings, and its lower bound in s. On two idle cores this takes about
/// 30 s for 100 000 samples; the elapsed time on a busy machine is longer.
const PER_SAMPLE: f64 = 4.8e-4;
const MIN_SECONDS: f64 = 48.0;

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
