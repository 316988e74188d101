//! Geometry for unit tests.

use super::{Actuator, Delta, Geometry};

/// Geometry of the shipped IRB 360-6/1600.
pub(crate) fn geometry() -> Geometry {
    let lengths = Delta {
        actuator: Actuator::Revolute,
        base_radius: 0.2,
        arm_length: 0.5,
        strut_length: 1.106,
        platform_radius: 0.048,
        pair_distance: 0.1,
        arm_limits: [-0.703, 1.745],
    };
    Geometry {
        mounting_height: 0.275,
        upper_hooke_height: 0.075,
        lower_hooke_height: 0.038,
        flange_height: -0.0625,
        telescope_limits: [0.812, 1.372],
        ..Geometry::delta(lengths)
    }
}
