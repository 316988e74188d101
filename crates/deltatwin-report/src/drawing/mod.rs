//! Figures of what the library finds.

pub mod budget;
pub mod plan;
pub mod shape;
