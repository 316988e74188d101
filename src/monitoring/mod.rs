//! Residual of a running machine, and charts that tell when it is no longer that of the healthy one.
//!
//! Samples enter one by one ([`Monitor::push`]). Every second gives a [`Window`]: the residual of the model, computed
//! as in [`crate::comparison`], and its means over blocks of 20 ms. A first healthy stretch teaches what is usual
//! ([`Healthy`]): real residuals are coloured and differ from zero, so the means are whitened by an autoregression
//! and every statistic is relative to its own healthy values. From then on, cumulative sums ([`chart`]) of the energy
//! and of the mean of every channel raise an alarm, with a given number of false alarms per hour over all charts.
//!
//! Boundaries of windows depend on the times of the samples alone, so the result is the same for samples that arrive
//! one by one, in batches, or from a file.

pub mod chart;
mod healthy;
mod monitor;
mod sliding;

pub use healthy::{Healthy, Statistic};
pub use monitor::{Alarm, Learning, Monitor, Observation, Settings};
pub use sliding::{Loads, Sample, Sliding, Window, recording_of};
