//! Pairs of vectors per body: twists and wrenches.

use nalgebra::Vector3;

/// Twist (velocity of the origin, angular velocity) or wrench (force, moment about the origin) of a body, world axes.
pub type Twist = (Vector3<f64>, Vector3<f64>);

/// No motion, no load.
pub(super) const STILL: Twist = (Vector3::new(0., 0., 0.), Vector3::new(0., 0., 0.));
