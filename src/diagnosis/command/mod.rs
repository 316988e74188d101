//! `deltatwin diagnose` and `deltatwin add`.

pub mod add;
pub mod budget;
pub mod diagnose;
mod unexplained;
