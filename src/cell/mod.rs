//! Data of the robot's surroundings (table, conveyor, obstacles, products) and dimensions of the robot's links.
//!
//! Nothing here moves or collides. The contact solver is outside the library; the twin calls it through its trait
//! `Contacts`.

mod error;
pub mod links;
mod mesh;
mod object;
mod urdf;

pub use error::CellError;
pub use mesh::{MOST_TRIANGLES, Mesh, MeshError, MeshReader, no_meshes};
pub use object::{Mobility, Object, Shape, Surface, check};
pub use urdf::urdf;
