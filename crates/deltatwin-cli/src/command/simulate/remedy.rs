//! The step at which the energy balance of a run would close.

use std::time::Instant;

use deltatwin::dynamics::Plant;
use deltatwin::twin::{Options, Piece, Receiver, simulate_into};

use super::Job;
use crate::terminal::interrupted;

/// Largest factor on the number of steps that is tried.
const FINEST: usize = 64;
/// Time for trying, relative to that of the run, and the least of it, s.
const PATIENCE: f64 = 10.0;
const LEAST_PATIENCE: f64 = 10.0;

/// What runs at finer steps have shown.
#[derive(Clone, Copy, Debug)]
pub struct Remedy {
    /// Longest step at which the balance closes, s; none if no run has closed it.
    pub step: Option<f64>,
    /// Steps per sample time of the last run, and whether it came to its end.
    substeps: usize,
    ended: bool,
}

impl Remedy {
    /// Repeats the run of `job`, which took `wall` s, with twice as many steps again and again.
    pub fn of(job: &Job, wall: f64) -> Self {
        let Job { scenario, machine, planning, motion, options, .. } = job;
        let controller = Plant::new(planning, &scenario.believed_setup());
        let desired = |t: f64| motion.at(t);
        let mut waiting =
            Waiting { start: Instant::now(), longest: (PATIENCE * wall).max(LEAST_PATIENCE), given_up: false };
        let mut out = Self { step: None, substeps: options.substeps, ended: true };
        while out.step.is_none() && out.ended && out.substeps < FINEST * options.substeps {
            out.substeps *= 2;
            let options = Options { substeps: out.substeps, frames: None, watcher: None, ..options.clone() };
            let run = simulate_into(machine, &scenario.setup, &controller, &desired, &options, &mut waiting);
            out.ended = !waiting.given_up;
            let closes = matches!(&run, Ok((report, None)) if report.energy_closes());
            out.step = (closes && out.ended).then_some(machine.sample_time / out.substeps as f64);
        }
        out
    }
}

impl std::fmt::Display for Remedy {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.step {
            Some(step) => write!(f, "at a step of {:.3} µs, `substeps = {}`, it closes", 1e6 * step, self.substeps),
            None if self.ended => write!(f, "it does not at `substeps = {}` either", self.substeps),
            None => write!(f, "up to `substeps = {}` it does not, finer steps were not tried", self.substeps / 2),
        }
    }
}

/// Receiver of a run of which only the end matters.
struct Waiting {
    start: Instant,
    /// s
    longest: f64,
    given_up: bool,
}

impl Receiver for Waiting {
    fn progress(&mut self, _: f64) -> bool {
        self.given_up |= interrupted() || self.start.elapsed().as_secs_f64() > self.longest;
        !self.given_up
    }

    fn piece(&mut self, _: Piece) -> bool {
        true
    }
}
