//! Display of robot, surroundings and signals in Rerun: as a file, or live in a viewer during a run.

pub mod ghost;
pub mod replay;
pub mod scene;
pub mod show;
mod sigma;
pub mod stream;
pub mod watch;
pub mod web;
