//! Which parameters explain a recording.
//!
//! A [`Trace`] holds the smoothed joint motion of a recording; [`predict`] and [`columns`] turn a plant and a trace into
//! predicted channels and their derivatives by parameter; [`fit`] is weighted least squares on what the data can tell.

pub mod base_parameters;
pub mod command;
pub mod consistency;
pub mod data;
pub mod derivatives;
pub mod filtering;
pub mod fit;
pub mod noise;
pub mod prediction;
pub mod smoother;
pub mod trace;

pub use base_parameters::{BaseParameter, base_parameters};
pub use data::{Data, DataArgs};
pub use derivatives::Method;
pub use fit::{Estimate, Fit, FitError, fit};
pub use prediction::{columns, predict};
pub use trace::Trace;
