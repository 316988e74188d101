//! Shipped models and random motions of the integration tests, for all benches.

// Of tests: a missing file is a panic.
#![allow(clippy::missing_panics_doc)]

#[path = "../tests/common/mod.rs"]
pub mod common;
#[path = "../tests/common/oracle.rs"]
pub mod oracle;
