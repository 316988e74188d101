//! The 74 constraint rows at position and velocity level.
//!
//! Four revolute joints to the base (5 rows each; those of carriages are prismatic), twelve spherical joints (3), the revolute joint of the end effector
//! (5), two Hooke joints (4) and the prismatic joint of the telescope (5). Without a telescope the rows of its chain are zero.

use nalgebra::Vector3;

use crate::kinematics::{Arm, BodyMotion, Motion};
use crate::machine::bodies::{self, END_EFFECTOR, PLATFORM, ROTOR, SLOTS, TELESCOPE_LOWER, TELESCOPE_UPPER};
use crate::machine::{Actuator, Geometry, Limb, lower_socket, six_struts, three_arms};

/// Number of constraint rows.
pub const ROWS: usize = crate::recording::ROWS;

/// The ball socket to which a row belongs (0..6 at the elbows, 6..12 at the platform); `None` for another joint.
pub fn socket(row: usize) -> Option<usize> {
    // After the bearings of three arms and the rotor, upper and lower socket of each strut with three rows each.
    let k = row.checked_sub(20).filter(|k| *k < 6 * six_struts().len())?;
    Some(k / 6 + if k % 6 < 3 { 0 } else { lower_socket(0) })
}

/// Violation (m or 1) and violation rate (m/s or 1/s) of every row.
///
/// # Panics
/// For no input: only an internal assertion on the number of rows can fail.
pub fn rows(geometry: &Geometry, motion: &Motion) -> [(f64, f64); ROWS] {
    let mut out = Rows { values: [(0.0, 0.0); ROWS], n: 0 };
    let b = &motion.bodies;
    for i in three_arms() {
        out.bearing(&geometry.limbs[i], &b[bodies::arm(i)]);
    }
    let telescope = geometry.has_telescope();
    if telescope {
        let hooke = Moving::fixed(geometry.upper_hooke());
        out.same_point(Moving::point(&b[ROTOR], Vector3::zeros()), hooke);
        out.normal(Moving::axis(&b[ROTOR], 2), Moving::fixed(Vector3::x()));
        out.normal(Moving::axis(&b[ROTOR], 2), Moving::fixed(Vector3::y()));
    } else {
        out.n += 5;
    }
    for s in six_struts() {
        let strut = &b[bodies::strut(s)];
        let (on_arm, on_platform) = (geometry.elbow_ball(s), geometry.platform_ball(s));
        let along = Vector3::new(geometry.strut_length(s), 0.0, 0.0);
        out.same_point(Moving::point(strut, Vector3::zeros()), Moving::point(&b[bodies::arm(s / 2)], on_arm));
        out.same_point(Moving::point(strut, along), Moving::point(&b[PLATFORM], on_platform));
    }
    match telescope {
        true => out.telescope(geometry, b),
        false => out.n += 18,
    }
    assert_eq!(out.n, ROWS, "rows of the mechanism");
    out.values
}

/// A vector and its time derivative.
#[derive(Clone, Copy)]
struct Moving {
    x: Vector3<f64>,
    rate: Vector3<f64>,
}

impl Moving {
    fn fixed(x: Vector3<f64>) -> Self {
        Self { x, rate: Vector3::zeros() }
    }

    fn point(b: &BodyMotion, in_body: Vector3<f64>) -> Self {
        let r = b.rotation * in_body;
        Self { x: b.position + r, rate: b.velocity + b.angular_velocity.cross(&r) }
    }

    fn axis(b: &BodyMotion, i: usize) -> Self {
        let x = b.rotation.column(i).into_owned();
        Self { x, rate: b.angular_velocity.cross(&x) }
    }

    fn minus(&self, other: &Self) -> Self {
        Self { x: self.x - other.x, rate: self.rate - other.rate }
    }
}

struct Rows {
    values: [(f64, f64); ROWS],
    n: usize,
}

impl Rows {
    fn push(&mut self, value: f64, rate: f64) {
        self.values[self.n] = (value, rate);
        self.n += 1;
    }

    fn same_point(&mut self, a: Moving, b: Moving) {
        let d = a.minus(&b);
        for i in 0..3 {
            self.push(d.x[i], d.rate[i]);
        }
    }

    /// Pivot of the end effector, Hooke joints and slide.
    fn telescope(&mut self, geometry: &Geometry, b: &[BodyMotion; SLOTS]) {
        let (ee, upper, lower) = (&b[END_EFFECTOR], &b[TELESCOPE_UPPER], &b[TELESCOPE_LOWER]);
        let flange = Vector3::new(0.0, 0.0, geometry.flange_height);
        self.same_point(Moving::point(ee, Vector3::zeros()), Moving::point(&b[PLATFORM], flange));
        self.normal(Moving::axis(ee, 2), Moving::axis(&b[PLATFORM], 0));
        self.normal(Moving::axis(ee, 2), Moving::axis(&b[PLATFORM], 1));
        self.same_point(Moving::point(upper, Vector3::zeros()), Moving::point(&b[ROTOR], Vector3::zeros()));
        self.normal(Moving::axis(&b[ROTOR], 0), Moving::axis(upper, 1));
        for i in 0..3 {
            self.normal(Moving::axis(upper, i), Moving::axis(lower, (i + 1) % 3));
        }
        let offset = Moving::point(lower, Vector3::zeros()).minus(&Moving::point(upper, Vector3::zeros()));
        self.normal(offset, Moving::axis(upper, 0));
        self.normal(offset, Moving::axis(upper, 1));
        let cross = Vector3::new(0.0, 0.0, geometry.lower_hooke_height - geometry.flange_height);
        self.same_point(Moving::point(lower, Vector3::zeros()), Moving::point(ee, cross));
        self.normal(Moving::axis(ee, 0), Moving::axis(lower, 1));
    }

    /// The bearing of an arm: its shaft, or its guide.
    fn bearing(&mut self, limb: &Limb, arm: &BodyMotion) {
        let guide = Arm::new(limb, 0.0);
        let origin = Moving::point(arm, Vector3::zeros());
        match limb.actuator {
            Actuator::Revolute => {
                self.same_point(origin, Moving::fixed(guide.origin));
                self.normal(Moving::axis(arm, 1), Moving::fixed(limb.radial()));
                self.normal(Moving::axis(arm, 1), Moving::fixed(Vector3::z()));
            }
            Actuator::Prismatic { .. } => {
                let offset = origin.minus(&Moving::fixed(guide.origin));
                self.normal(offset, Moving::fixed(limb.tangential()));
                self.normal(offset, Moving::fixed(guide.z));
                for (own, fixed) in [(1, guide.x), (1, guide.z), (0, guide.z)] {
                    self.normal(Moving::axis(arm, own), Moving::fixed(fixed));
                }
            }
        }
    }

    fn normal(&mut self, a: Moving, b: Moving) {
        self.push(a.x.dot(&b.x), a.rate.dot(&b.x) + a.x.dot(&b.rate));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kinematics::JointState;

    #[test]
    fn closed_form_motion_fulfils_all_rows() {
        let geometry = crate::machine::testing::geometry();
        let joints = JointState { q: [0.3, -0.2, 0.6, 2.0], qd: [1.0, -2.0, 3.0, 10.0], qdd: [0.0; 4] };
        let motion = Motion::assembled(&geometry, &joints).unwrap();
        for (i, (value, rate)) in rows(&geometry, &motion).into_iter().enumerate() {
            assert!(value.abs() < 1e-14 && rate.abs() < 1e-13, "row {i}: {value:e} {rate:e}");
        }
    }
}
