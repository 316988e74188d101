//! The robot's surroundings as data: table, conveyor, obstacles and products, and the sizes of the robot's own links.
//!
//! Nothing here moves or touches. What solves contacts stands outside of the library and answers the twin through its
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
