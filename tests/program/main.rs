//! Tests of the program, in one binary.

#[path = "../common/mod.rs"]
mod common;
#[path = "../common/snapshot.rs"]
mod snapshot;

mod cli;
mod combinations;
#[cfg(feature = "full")]
mod documents;
#[cfg(feature = "studies")]
mod exam;
mod failures;
mod faults;
mod gate;
mod import;
mod messages;
#[cfg(feature = "reproduce")]
mod reproduce;
mod run;
#[cfg(feature = "studio")]
mod studio;
#[cfg(feature = "studies")]
mod study;
#[cfg(feature = "watch")]
mod watch;
