//! Learning from a healthy stretch, then watching.

use super::healthy::{Healthy, Statistic};
use super::sliding::{Sample, Sliding, Window};
use crate::identification::fit::FitError;
use crate::machine::Setup;
use crate::model::Model;

/// Least number of windows to learn from.
const FEWEST: usize = 10;

/// Settings of a monitor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Duration of the healthy stretch, s.
    pub learn: f64,
    /// Largest number of false alarms per hour.
    pub false_alarms: f64,
}

impl Default for Settings {
    /// One minute of learning; one false alarm in a hundred hours.
    fn default() -> Self {
        Self { learn: 60.0, false_alarms: 0.01 }
    }
}

/// An alarm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Alarm {
    /// End of the window that raised it, s.
    pub t: f64,
    /// Estimated onset of the change, s.
    pub onset: f64,
    /// The statistic that raised it.
    pub statistic: Statistic,
}

/// Progress of learning.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Learning {
    /// Healthy time so far, s.
    pub done: f64,
    /// Healthy time needed, s.
    pub needed: f64,
}

/// One window with what it says about the machine.
#[derive(Clone, Debug)]
pub struct Observation {
    /// The window.
    pub window: Window,
    /// Progress while the healthy residual is being learned.
    pub learning: Option<Learning>,
    /// The chart with the largest level, and the level; above 1 it raises the alarm.
    pub level: Option<(Statistic, f64)>,
    /// The first alarm, from its window on.
    pub alarm: Option<Alarm>,
    /// Whether this window raised it.
    pub is_new: bool,
}

/// Watches a machine through its samples.
#[derive(Clone)]
pub struct Monitor {
    sliding: Sliding,
    settings: Settings,
    seen: Vec<Window>,
    learned: f64,
    healthy: Option<Healthy>,
    alarm: Option<Alarm>,
}

impl Monitor {
    /// A monitor of the residual of `model`.
    pub fn new(model: &Model, setup: &Setup, settings: Settings) -> Self {
        let sliding = Sliding::new(model, setup);
        Self { sliding, settings, seen: Vec::new(), learned: 0.0, healthy: None, alarm: None }
    }

    /// What the healthy residual is like, once it is learned.
    pub fn healthy(&self) -> Option<&Healthy> {
        self.healthy.as_ref()
    }

    /// The first alarm.
    pub fn alarm(&self) -> Option<Alarm> {
        self.alarm
    }

    /// Adds a sample later than all previous ones; returns the observation of the window that it completes.
    ///
    /// # Errors
    /// If the machine cannot be at a measured pose; the window is dropped.
    pub fn push(&mut self, sample: Sample) -> Result<Option<Observation>, FitError> {
        Ok(self.sliding.push(sample)?.map(|window| self.observe(window)))
    }

    /// Learns from all samples of a healthy stretch and starts to watch; what follows is another stretch. Returns the
    /// number of windows learned from.
    ///
    /// # Errors
    /// If the machine cannot be at a measured pose.
    pub fn learn(&mut self, samples: &[Sample]) -> Result<usize, FitError> {
        let mut sliding = self.sliding.clone();
        let mut windows = Vec::new();
        for &sample in samples {
            windows.extend(sliding.push(sample)?);
        }
        if windows.len() >= FEWEST {
            self.healthy = Healthy::learn(&windows, self.settings.false_alarms);
        }
        Ok(windows.len())
    }

    fn observe(&mut self, window: Window) -> Observation {
        let Some(healthy) = &mut self.healthy else { return self.study(window) };
        let state = healthy.add(&window);
        let mut is_new = false;
        if let Some((statistic, level, onset)) = state
            && level > 1.0
            && self.alarm.is_none()
        {
            is_new = true;
            self.alarm = Some(Alarm { t: window.t[1], onset: onset.unwrap_or(window.t[0]), statistic });
        }
        let level = state.map(|(statistic, level, _)| (statistic, level));
        Observation { window, learning: None, level, alarm: self.alarm, is_new }
    }

    /// Learns from a window.
    fn study(&mut self, window: Window) -> Observation {
        self.learned += window.t[1] - window.t[0];
        self.seen.push(window.clone());
        let needed = self.settings.learn;
        // Half a sample of slack: the sum of the durations is rounded.
        if self.seen.len() >= FEWEST && self.learned >= needed - 0.01 {
            self.healthy = Healthy::learn(&self.seen, self.settings.false_alarms);
            self.seen = Vec::new();
        }
        let learning = Some(Learning { done: self.learned.min(needed), needed });
        Observation { window, learning, level: None, alarm: None, is_new: false }
    }
}
