//! Validation of deltatwin: exams of the diagnosis on hidden effects, the demo, and the reproduction of the paper.

pub mod demo;
pub mod exam;
#[cfg(feature = "reproduce")]
pub mod reproduce;
