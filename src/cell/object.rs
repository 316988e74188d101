//! Objects around the robot and on its flange, as a scenario describes them.

use std::sync::Arc;

use nalgebra::Vector3;

use super::CellError;
use super::mesh::Mesh;
use crate::machine::Inertia;

/// An object in the robot's cell.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// Name in events and pictures.
    pub name: String,
    /// Its shape, centred on its origin.
    pub shape: Shape,
    /// How it can move.
    pub mobility: Mobility,
    /// Position of the origin at the start, inertial frame, m.
    pub position: Vector3<f64>,
    /// Rotation about the vertical at the start, rad.
    pub yaw: f64,
    /// Contact properties.
    pub surface: Surface,
}

/// Shape of an object.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// Convex hull or mesh about its centre of volume.
    Mesh(Arc<Mesh>),
    /// Box with edges along x, y, z, m.
    Box {
        /// Lengths of the edges, m.
        size: Vector3<f64>,
    },
    /// Upright cylinder.
    Cylinder {
        /// Radius, m.
        radius: f64,
        /// Height, m.
        height: f64,
    },
    /// Ball.
    Sphere {
        /// Radius, m.
        radius: f64,
    },
}

/// How an object can move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mobility {
    /// Fixed in the inertial frame.
    Fixed,
    /// Fixed, with a moving surface.
    Conveyor {
        /// Velocity of the surface, m/s, inertial frame.
        velocity: Vector3<f64>,
    },
    /// Free rigid body.
    Free {
        /// Mass at uniform density, kg.
        mass: f64,
    },
}

/// Contact properties of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Normal stiffness of a contact point, N/m.
    pub stiffness: f64,
    /// Damping factor of the contact force ([Hunt 1975]), s/m.
    pub dissipation: f64,
    /// Coulomb friction coefficient.
    pub friction: f64,
    /// Lever arm of the rolling resistance, m.
    pub rolling: f64,
}

impl Default for Surface {
    /// Values for hard plastic on metal.
    fn default() -> Self {
        Self { stiffness: 2e5, dissipation: 1.0, friction: 0.3, rolling: 5e-4 }
    }
}

/// Checks objects, and the shape of a payload with its centre (m).
///
/// # Errors
/// The first fault: an empty or duplicate name, a length or mass that is not positive, another number out of range or
/// not finite, or a free mesh that is not a convex hull.
pub fn check(objects: &[Object], payload: Option<(&Shape, &Vector3<f64>)>) -> Result<(), CellError> {
    for (i, object) in objects.iter().enumerate() {
        object.check(i)?;
        if objects[..i].iter().any(|o| o.name == object.name) {
            return Err(CellError::DuplicateName(object.name.clone()));
        }
    }
    let Some((shape, centre)) = payload else { return Ok(()) };
    check_shape("payload", shape)?;
    check_finite("payload", "position", centre.as_slice())
}

impl Object {
    /// Checks object number `index`, from 0.
    fn check(&self, index: usize) -> Result<(), CellError> {
        if self.name.is_empty() {
            return Err(CellError::NoName(index + 1));
        }
        check_shape(&self.name, &self.shape)?;
        check_finite(&self.name, "position", self.position.as_slice())?;
        check_finite(&self.name, "yaw", &[self.yaw])?;
        match &self.mobility {
            Mobility::Fixed => {}
            Mobility::Conveyor { velocity } => check_finite(&self.name, "velocity", velocity.as_slice())?,
            Mobility::Free { mass } => {
                require(&self.name, "mass", *mass, *mass > 0.0, "positive")?;
                if matches!(&self.shape, Shape::Mesh(mesh) if !mesh.is_convex()) {
                    return Err(CellError::FreeMesh(self.name.clone()));
                }
            }
        }
        let Surface { stiffness, dissipation, friction, rolling } = self.surface;
        require(&self.name, "stiffness", stiffness, stiffness > 0.0, "positive")?;
        for (what, value) in [("dissipation", dissipation), ("friction", friction), ("rolling", rolling)] {
            require(&self.name, what, value, value >= 0.0, "non-negative")?;
        }
        Ok(())
    }
}

/// Checks that all lengths of the shape are positive.
fn check_shape(object: &str, shape: &Shape) -> Result<(), CellError> {
    let lengths: &[(&'static str, f64)] = &match *shape {
        Shape::Box { size } => [("size along x", size.x), ("size along y", size.y), ("size along z", size.z)],
        Shape::Cylinder { radius, height } => [("radius", radius), ("height", height), ("height", height)],
        Shape::Sphere { radius } => [("radius", radius); 3],
        // Checked by its constructor.
        Shape::Mesh(_) => return Ok(()),
    };
    lengths.iter().try_for_each(|&(what, length)| require(object, what, length, length > 0.0, "positive"))
}

fn check_finite(object: &str, what: &'static str, values: &[f64]) -> Result<(), CellError> {
    values.iter().try_for_each(|&value| require(object, what, value, true, "finite"))
}

fn require(object: &str, what: &'static str, value: f64, holds: bool, expected: &'static str) -> Result<(), CellError> {
    if value.is_finite() && holds {
        return Ok(());
    }
    Err(CellError::BadValue { object: object.into(), what, value, expected })
}

impl Shape {
    /// Inertia of the shape about its origin at uniform density, `mass` in kg.
    pub fn inertia(&self, mass: f64) -> Inertia {
        let moments = match *self {
            Self::Mesh(ref mesh) => {
                return Inertia { mass, first_moment: Vector3::zeros(), tensor: mesh.gyration() * mass };
            }
            Self::Box { size } => {
                let s = size.component_mul(&size);
                Vector3::new(s.y + s.z, s.x + s.z, s.x + s.y) / 12.0
            }
            Self::Cylinder { radius, height } => {
                let across = radius * radius / 4.0 + height * height / 12.0;
                Vector3::new(across, across, radius * radius / 2.0)
            }
            Self::Sphere { radius } => Vector3::repeat(0.4 * radius * radius),
        };
        Inertia::diagonal(mass, [0.0; 3], (mass * moments).into())
    }
}
