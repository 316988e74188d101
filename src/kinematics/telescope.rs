//! Telescope and its two Hooke joints, which transmit the rotation of the rotor to the end effector.

use nalgebra::{Matrix3, Vector3};

use super::{BodyMotion, Motion};
use crate::machine::bodies::{END_EFFECTOR, ROTOR, TELESCOPE_UPPER};

/// The telescope between its two Hooke joints.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Telescope {
    /// Unit vector along the bar, from the lower to the upper Hooke joint.
    pub axis: Vector3<f64>,
    /// Distance between the Hooke joints, m.
    pub length: f64,
    /// Rate of `length`, m/s; positive while the telescope extends.
    pub rate: f64,
}

impl Telescope {
    /// Telescope between its lower Hooke joint, which moves with `velocity`, m/s, and its upper one, which is at rest;
    /// inertial axes.
    pub fn between(lower: &Vector3<f64>, velocity: &Vector3<f64>, upper: &Vector3<f64>) -> Self {
        let bar = upper - lower;
        let length = bar.norm();
        let axis = bar / length;
        Self { axis, length, rate: -axis.dot(velocity) }
    }

    /// Angular velocity normal to the axis, rad/s, while the lower Hooke joint moves with `velocity`, m/s.
    pub fn swing(&self, velocity: &Vector3<f64>) -> Vector3<f64> {
        -self.axis.cross(velocity) / self.length
    }

    /// Rotation matrix of the telescope's frame: z along `axis`, y along the cross axis on the telescope, which is
    /// normal to `axis` and to the rotor's cross axis `yoke`.
    pub fn rotation(&self, yoke: &Vector3<f64>) -> Matrix3<f64> {
        let y = self.axis.cross(yoke).normalize();
        Matrix3::from_columns(&[y.cross(&self.axis), y, self.axis])
    }
}

/// Hooke joint of the telescope. It transmits rotation about the normal n of its cross: (ω_T − ω)·n = 0, with ω of the
/// rotor or the end effector.
#[derive(Clone, Copy, Debug)]
pub struct HookeJoint {
    /// Cross axis on the rotor or the end effector.
    pub yoke: Vector3<f64>,
    /// Cross axis on the telescope.
    pub bar: Vector3<f64>,
    /// Normal of the cross, n = yoke × bar.
    pub normal: Vector3<f64>,
}

impl HookeJoint {
    /// Joint with the given cross axes.
    pub fn new(yoke: Vector3<f64>, bar: Vector3<f64>) -> Self {
        Self { yoke, bar, normal: yoke.cross(&bar) }
    }

    /// Rate of n, 1/s, for the angular velocities `outer` of the rotor or end effector and `inner` of the telescope,
    /// rad/s.
    pub fn normal_rate(&self, outer: &Vector3<f64>, inner: &Vector3<f64>) -> Vector3<f64> {
        outer.cross(&self.yoke).cross(&self.bar) + self.yoke.cross(&inner.cross(&self.bar))
    }

    /// Rate s of a rotation about `axis`, rad/s, with the same component along n as the angular velocity `missing`:
    /// (s·axis − missing)·n = 0.
    pub fn spin(&self, missing: &Vector3<f64>, axis: &Vector3<f64>) -> f64 {
        missing.dot(&self.normal) / axis.dot(&self.normal)
    }

    /// Moment along n, N·m, with the same power as `moment` in any rotation about `axis`.
    pub fn passed(&self, moment: &Vector3<f64>, axis: &Vector3<f64>) -> Vector3<f64> {
        self.normal * (moment.dot(axis) / axis.dot(&self.normal))
    }
}

impl Motion {
    /// Upper and lower Hooke joint.
    pub fn hooke_joints(&self) -> [HookeJoint; 2] {
        let bar = self.bodies[TELESCOPE_UPPER].rotation.column(1).into_owned();
        [ROTOR, END_EFFECTOR].map(|b| HookeJoint::new(self.bodies[b].rotation.column(0).into_owned(), bar))
    }

    /// Relative rates of the Hooke joints (upper, lower), rad/s: about the cross axis on the side of the rotor or the
    /// end effector, then about the cross axis on the telescope.
    pub fn hooke_rates(&self) -> [[f64; 2]; 2] {
        let [upper, lower] = self.hooke_joints();
        [(ROTOR, upper), (END_EFFECTOR, lower)].map(|(b, joint)| {
            let relative = self.bodies[TELESCOPE_UPPER].angular_velocity - self.bodies[b].angular_velocity;
            [relative.dot(&joint.yoke), relative.dot(&joint.bar)]
        })
    }
}

/// Motion of the upper and the lower telescope part, and the telescope; the lower Hooke joint moves with `velocity` and
/// `acceleration`.
pub(super) fn telescope_motion(
    upper_hooke: Vector3<f64>,
    lower_hooke: Vector3<f64>,
    rotor: &BodyMotion,
    velocity: Vector3<f64>,
    acceleration: Vector3<f64>,
) -> (BodyMotion, BodyMotion, Telescope) {
    let telescope = Telescope::between(&lower_hooke, &velocity, &upper_hooke);
    let Telescope { axis, length, rate } = telescope;
    let axis_rate = (-velocity - axis * rate) / length;
    // Swing ω = w × ẇ plus spin s·w.
    let yoke = rotor.rotation.column(0).into_owned();
    let rotation = telescope.rotation(&yoke);
    let joint = HookeJoint::new(yoke, rotation.column(1).into_owned());
    let swing = axis.cross(&axis_rate);
    let spin = joint.spin(&(rotor.angular_velocity - swing), &axis);
    let angular_velocity = swing + axis * spin;
    let n_rate = joint.normal_rate(&rotor.angular_velocity, &angular_velocity);
    let swing_acceleration = telescope.swing(&(acceleration + axis_rate * (2.0 * rate)));
    let spin_acceleration = ((rotor.angular_acceleration - swing_acceleration - axis_rate * spin).dot(&joint.normal)
        + (rotor.angular_velocity - angular_velocity).dot(&n_rate))
        / axis.dot(&joint.normal);
    let upper = BodyMotion {
        rotation,
        position: upper_hooke,
        angular_velocity,
        angular_acceleration: swing_acceleration + axis * spin_acceleration + axis_rate * spin,
        ..BodyMotion::REST
    };
    let lower = BodyMotion { position: lower_hooke, velocity, acceleration, ..upper };
    (upper, lower, telescope)
}
