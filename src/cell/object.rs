//! Objects around the robot, as a scenario describes them.

use nalgebra::Vector3;

/// A thing in the robot's cell.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// Name in events and pictures.
    pub name: String,
    /// Its shape, centred on its origin.
    pub shape: Shape,
    /// How it moves.
    pub mobility: Mobility,
    /// Origin at the start, m, inertial frame.
    pub position: Vector3<f64>,
    /// Turn about the vertical at the start, rad.
    pub yaw: f64,
    /// Contact properties.
    pub surface: Surface,
}

/// Shape of an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
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

/// How an object moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mobility {
    /// Stands still whatever happens.
    Fixed,
    /// Stands still while its surface moves.
    Conveyor {
        /// Velocity of the surface, m/s.
        velocity: Vector3<f64>,
    },
    /// Falls, slides and tumbles.
    Free {
        /// Mass, kg, spread evenly over the shape.
        mass: f64,
    },
}

/// Contact properties of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Normal stiffness of a contact point, N/m.
    pub stiffness: f64,
    /// Hunt–Crossley dissipation, s/m.
    pub dissipation: f64,
    /// Coefficient of friction.
    pub friction: f64,
    /// Arm of the rolling resistance, m.
    pub rolling: f64,
}

impl Default for Surface {
    /// Hard plastic on metal.
    fn default() -> Self {
        Self { stiffness: 2e5, dissipation: 1.0, friction: 0.3, rolling: 5e-4 }
    }
}
