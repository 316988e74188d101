//! The robot's surroundings: table, conveyor, obstacles and products.

pub mod object;

pub use object::{Mobility, Object, Shape, Surface};
