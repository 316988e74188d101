//! `deltatwin diagnose` and `deltatwin add`.

pub mod add;
pub mod budget;
mod details;
pub mod diagnose;
mod json;
mod screen;
mod time;
mod unexplained;
