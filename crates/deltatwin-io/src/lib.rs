//! Reading and writing of all files of deltatwin.

mod excerpt;
pub mod exchange;
pub mod file;
pub mod kind;
mod load;
pub mod model;
pub mod outside;
pub mod plan;
pub mod recording;
pub mod scenario;
mod source;
pub mod study;

pub use source::Problem;
