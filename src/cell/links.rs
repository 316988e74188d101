//! Dimensions of the link shapes, for collision and display, and the cylinders that show the links elsewhere.

use crate::machine::bodies::{BodyKind, body_kind};
use crate::machine::{Actuator, Geometry};

/// Radius of an arm's tube, m; estimated from pictures.
pub const ARM_RADIUS: f64 = 0.03;
/// Length of a carriage along its guide, m; estimated.
pub const CARRIAGE_LENGTH: f64 = 0.04;
/// Radius of a carriage, m; estimated.
pub const CARRIAGE_RADIUS: f64 = 0.01;
/// Distance between the end of the arm's tube and the ball line, where the struts are, m; estimated.
pub const ARM_TRIM: f64 = 0.06;
/// Radius of the balls, m; CAD.
pub const BALL_RADIUS: f64 = 0.0095;
/// Radius of a strut's tube, m; CAD, outside diameter 16 mm.
pub const STRUT_RADIUS: f64 = 0.008;
/// Half the thickness of the platform, m; estimated.
pub const PLATFORM_THICKNESS: f64 = 0.012;
/// Distance of the plate's middle line from the ball pairs, inward, m; estimated.
pub const PLATFORM_INSET: f64 = 0.015;
/// Radius of the flange face, m; estimated.
pub const FLANGE_RADIUS: f64 = 0.025;
/// Radius of the telescope's upper rod, m; CAD, diameter 14.5 mm.
pub const ROD_RADIUS: f64 = 0.00725;
/// Distance between the end of the rod and the lower Hooke joint at the shortest telescope, m; CAD, 812 − 760 mm.
pub const ROD_CLEARANCE: f64 = 0.052;
/// Radius of the telescope's lower tube, m; CAD, outside diameter 27.5 mm.
pub const TUBE_RADIUS: f64 = 0.01375;
/// Distance between the end of the tube and the upper Hooke joint at the shortest telescope, m; CAD, 812 − 776.5 mm.
pub const TUBE_CLEARANCE: f64 = 0.0355;

/// A cylinder along the x or the z axis of a link, which shows the link in other programs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cylinder {
    /// Radius, m.
    pub radius: f64,
    /// Centres of its two faces in the link's frame, m.
    pub ends: [[f64; 3]; 2],
}

impl Cylinder {
    fn along_x(length: f64, radius: f64) -> Self {
        Self { radius, ends: [[0.0; 3], [length, 0.0, 0.0]] }
    }

    fn along_z([from, to]: [f64; 2], radius: f64) -> Self {
        Self { radius, ends: [[0.0, 0.0, from], [0.0, 0.0, to]] }
    }

    /// Whether it is along x; otherwise it is along z.
    pub fn is_along_x(&self) -> bool {
        self.ends[0][0] != self.ends[1][0]
    }

    /// Centre in the link's frame, m.
    pub fn centre(&self) -> [f64; 3] {
        std::array::from_fn(|k| 0.5 * (self.ends[0][k] + self.ends[1][k]))
    }

    /// Distance of the faces, m.
    pub fn length(&self) -> f64 {
        (0..3).map(|k| (self.ends[1][k] - self.ends[0][k]).abs()).sum()
    }
}

/// The cylinder that shows body `body` of a robot; none for the rotor, which is inside the base.
///
/// # Panics
/// If `body` is not the index of a body.
pub fn cylinder(geometry: &Geometry, body: usize) -> Option<Cylinder> {
    let shortest = geometry.telescope_limits[0];
    Some(match body_kind(body) {
        BodyKind::Arm(limb) => match geometry.limbs[limb].actuator {
            Actuator::Revolute => Cylinder::along_x(geometry.limbs[limb].arm_length, ARM_RADIUS),
            Actuator::Prismatic { .. } => Cylinder {
                radius: CARRIAGE_RADIUS,
                ends: [[-CARRIAGE_LENGTH / 2.0, 0.0, 0.0], [CARRIAGE_LENGTH / 2.0, 0.0, 0.0]],
            },
        },
        BodyKind::Strut(s) => Cylinder::along_x(geometry.limbs[s / 2].strut_length, STRUT_RADIUS),
        BodyKind::Platform(_) => {
            let radius = (geometry.platform_radius() - PLATFORM_INSET).max(0.5 * geometry.platform_radius());
            Cylinder::along_z([-PLATFORM_THICKNESS, PLATFORM_THICKNESS], radius)
        }
        BodyKind::EndEffector => Cylinder::along_z([0.0, (-geometry.flange_height).max(0.01)], FLANGE_RADIUS),
        BodyKind::Rotor => return None,
        BodyKind::Link => Cylinder::along_z([-PLATFORM_THICKNESS, PLATFORM_THICKNESS], FLANGE_RADIUS),
        BodyKind::TelescopeUpper => Cylinder::along_z([(ROD_CLEARANCE - shortest).min(0.0), 0.0], ROD_RADIUS),
        BodyKind::TelescopeLower => Cylinder::along_z([0.0, (shortest - TUBE_CLEARANCE).max(0.0)], TUBE_RADIUS),
    })
}
