//! Readers, command lines and mutations for fuzzing deltatwin.

#![allow(missing_docs)]

pub mod command;
pub mod guided;
pub mod mutation;
pub mod target;
