//! Files of deltatwin: everything that is read from disk or written to it goes through this crate.

pub mod file;
pub mod kind;
pub mod model;
pub mod plan;
pub mod recording;
pub mod scenario;
mod source;

pub use source::Problem;
