//! The robot, its surroundings and its signals in Rerun: as a file, or live in a viewer while the twin runs.

pub mod replay;
pub mod scene;
pub mod show;
pub mod stream;
