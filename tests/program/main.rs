//! Tests of the program, in one binary.

#[path = "../common/mod.rs"]
mod common;
#[path = "../common/snapshot.rs"]
mod snapshot;

mod cli;
mod combinations;
mod documents;
mod exam;
mod failures;
mod faults;
mod gate;
mod import;
mod messages;
mod reproduce;
mod run;
#[cfg(feature = "studio")]
mod studio;
mod study;
mod watch;
