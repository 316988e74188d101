//! `deltatwin diagnose` and `deltatwin add`.

pub mod add;
pub mod diagnose;
mod unexplained;
