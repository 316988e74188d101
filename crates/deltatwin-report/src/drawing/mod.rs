//! Figures of results of the library.

pub mod budget;
pub mod plan;
pub mod residual;
pub mod shape;
