//! A point of a path in joint space: q, q′, q″, q‴.

use nalgebra::{Matrix3, Vector3, Vector4};
use thiserror::Error;

use super::Curve;
use crate::kinematics::{JointState, KinematicsError, Motion, PlatformState};
use crate::machine::{Geometry, PerAxis, each};

/// Joint positions along a path and their derivatives with respect to s.
#[derive(Clone, Copy, Debug)]
pub struct PathPoint {
    /// Path parameter.
    pub s: f64,
    /// q, q′, q″, q‴; rad.
    pub q: [PerAxis<f64>; 4],
    /// r and its derivatives with respect to s (x, y, z, ψ); m, rad.
    pub r: [Vector4<f64>; 4],
}

/// Least sine of the angle between strut and arm, seen along the motor axis.
const MIN_ARM_SINE: f64 = 0.1;
/// Least volume spanned by the unit vectors along the three struts.
const MIN_STRUT_VOLUME: f64 = 0.05;
/// Least determinant of the closure over the one with all arms at zero, for other plates and numbers of limbs.
const MIN_CLOSURE: f64 = 0.1;
/// Share of the path over which third derivatives of a settled plate are taken.
const JERK_STEP: f64 = 1e-5;

/// Reason why the robot cannot take a place on the path.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum PlaceError {
    /// The pose is impossible or outside the limits of joints and telescope.
    #[error("{0}")]
    Pose(KinematicsError),
    /// The path turns the end effector of a robot that cannot.
    #[error("ψ is {psi:.3} rad, but the robot has no axis that turns the end effector: expected ψ = 0")]
    Turned {
        /// ψ, rad.
        psi: f64,
    },
    /// An arm and its struts are almost collinear.
    #[error("arm {} and its struts are almost in line: sine of their angle {sine:.3}, at least {least}", .arm + 1)]
    Stretched {
        /// Arm, from 0.
        arm: usize,
        /// Sine of the angle.
        sine: f64,
        /// Least permitted sine.
        least: f64,
    },
    /// The drives almost lose the plate.
    #[error(
        "the drives almost lose the plate: its closure is {share:.3} of that with all arms at zero, at least {least}"
    )]
    Lost {
        /// Determinant of the closure over the one with all arms at zero.
        share: f64,
        /// Least permitted share.
        least: f64,
    },
    /// The struts are almost coplanar.
    #[error("the struts lie almost in a plane: their unit vectors span {volume:.3}, at least {least}")]
    Flat {
        /// Spanned volume.
        volume: f64,
        /// Least permitted volume.
        least: f64,
    },
}

impl PathPoint {
    /// The point of `curve` at `s` in joint space.
    ///
    /// # Errors
    ///
    /// The error of the inverse kinematics where the pose is impossible.
    pub fn new(geometry: &Geometry, curve: &Curve, s: f64) -> Result<Self, KinematicsError> {
        let r = settled(geometry, curve, s)?;
        let platform = platform(&r[0], &r[1], &r[2]);
        let joints = geometry.inverse_motion(&platform)?;
        let third = geometry.inverse_jerk(&platform, &joints, &r[3].xyz(), r[3][3]);
        Ok(Self { s, q: [joints.q, joints.qd, joints.qdd, third], r })
    }

    /// Checks that the robot can take this point.
    ///
    /// # Errors
    ///
    /// [`PlaceError`] with the exceeded limit of joints or telescope, or the singularity that is too close.
    pub fn check(&self, geometry: &Geometry) -> Result<(), PlaceError> {
        let position = self.r[0].xyz();
        if !geometry.has_telescope() && !geometry.plate.turns() && self.r[0][3] != 0.0 {
            return Err(PlaceError::Turned { psi: self.r[0][3] });
        }
        geometry.check_limits(&self.q[0], &position).map_err(PlaceError::Pose)?;
        let mut axes = Matrix3::zeros();
        let platform = self.platform(0.0, 0.0);
        for (arm, limb) in geometry.limbs.iter().enumerate() {
            let (strut, sine) = geometry.transmission(arm, self.q[0][arm], &platform);
            if limb.driven && sine < MIN_ARM_SINE {
                return Err(PlaceError::Stretched { arm, sine, least: MIN_ARM_SINE });
            }
            if arm < axes.ncols() {
                axes.set_column(arm, &strut);
            }
        }
        if !geometry.has_platform_of_three() {
            let share = geometry.closure_share(&self.q[0], &platform);
            return if share < MIN_CLOSURE { Err(PlaceError::Lost { share, least: MIN_CLOSURE }) } else { Ok(()) };
        }
        let volume = axes.determinant().abs();
        if volume < MIN_STRUT_VOLUME {
            return Err(PlaceError::Flat { volume, least: MIN_STRUT_VOLUME });
        }
        Ok(())
    }

    /// Joint motion at path speed ṡ (1/s) and path acceleration s̈ (1/s²), (38) and (39).
    pub fn joints(&self, speed: f64, acceleration: f64) -> JointState {
        let [q, q1, q2, _] = &self.q;
        JointState {
            q: *q,
            qd: std::array::from_fn(|i| q1[i] * speed),
            qdd: std::array::from_fn(|i| q2[i] * speed * speed + q1[i] * acceleration),
        }
    }

    /// Platform motion at path speed ṡ (1/s) and path acceleration s̈ (1/s²).
    pub fn platform(&self, speed: f64, acceleration: f64) -> PlatformState {
        let [r, r1, r2, _] = &self.r;
        platform(r, &(r1 * speed), &(r2 * (speed * speed) + r1 * acceleration))
    }

    /// Motion of all bodies at path speed ṡ (1/s) and path acceleration s̈ (1/s²).
    pub fn motion(&self, geometry: &Geometry, speed: f64, acceleration: f64) -> Motion {
        Motion::with_platform(geometry, &self.joints(speed, acceleration), &self.platform(speed, acceleration))
    }

    /// Motion per unit s̈ at rest.
    pub(super) fn unit_acceleration(&self, geometry: &Geometry) -> Motion {
        let none = Vector4::zeros();
        let joints = JointState { q: self.q[0], qd: each(0.0), qdd: self.q[1] };
        Motion::with_platform(geometry, &joints, &platform(&self.r[0], &none, &self.r[1]))
    }
}

/// The path at `s` and its derivatives, with the plate where coupled passive arms hold it.
fn settled(geometry: &Geometry, curve: &Curve, s: f64) -> Result<[Vector4<f64>; 4], KinematicsError> {
    let mut r = curve.at(s);
    if geometry.driven() == geometry.limbs.len() {
        return Ok(r);
    }
    let at = |r: &[Vector4<f64>; 4]| geometry.settled(&platform(&r[0], &r[1], &r[2]));
    let step = JERK_STEP * curve.end();
    let [before, own, after] = [at(&curve.at(s - step))?, at(&r)?, at(&curve.at(s + step))?];
    let jerk = (after.acceleration - before.acceleration) / (2.0 * step);
    let mut set = |k: usize, x: Vector3<f64>| r[k].fixed_rows_mut::<3>(0).copy_from(&x);
    set(0, own.position);
    set(1, own.velocity);
    set(2, own.acceleration);
    set(3, jerk);
    Ok(r)
}

fn platform(r: &Vector4<f64>, v: &Vector4<f64>, a: &Vector4<f64>) -> PlatformState {
    PlatformState { position: r.xyz(), velocity: v.xyz(), acceleration: a.xyz(), psi: [r[3], v[3], a[3]] }
}
