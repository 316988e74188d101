//! Closure of the loops of the assembled mechanism.

use nalgebra::{UnitQuaternion, Vector3};

use super::super::SingularPose;
use super::blocks::Paired;
use super::pairs::Pairs;
use super::{Mechanism, OpenVector, PLATFORM_V, Pose};
use crate::kinematics::{Arm, Motion};
use crate::machine::bodies::{self, PLATFORM};
use crate::machine::{SixStruts, ThreeArms, each, six_struts, three_arms};
use crate::numerics::sin_cos;

/// Change of strut length below which the loops count as closed, m.
const CLOSURE_TOLERANCE: f64 = 1e-14;
const MAX_CLOSURE_ITERATIONS: usize = 12;

impl Mechanism {
    /// Restores strut lengths and their rates by moving the platform; returns the number of Newton corrections. Drives and
    /// spins are unchanged.
    pub fn close(&self, pose: &mut Pose, nu: &mut OpenVector) -> Result<usize, SingularPose> {
        if self.springs.is_some() {
            pose.orientation /= pose.orientation.norm();
            return Ok(0);
        }
        let g = &self.geometry;
        let mut orientation = UnitQuaternion::new_normalize(pose.orientation);
        let mut rows: SixStruts<_> = each(Paired::ZERO);
        let mut elbows: ThreeArms<Vector3<f64>> = each(Vector3::zeros());
        let mut elbow_jacobian: ThreeArms<Vector3<f64>> = each(Vector3::zeros());
        for i in three_arms() {
            let arm = Arm::by(&g.limbs[i], pose.phi[i], sin_cos);
            (elbows[i], elbow_jacobian[i]) = (arm.elbow, arm.slope);
        }
        let (mut closed, mut corrections) = (false, 0);
        for _ in 0..MAX_CLOSURE_ITERATIONS {
            let rotation = orientation.to_rotation_matrix().into_inner();
            let mut gaps: SixStruts<_> = each(0f64);
            for s in six_struts() {
                let ball = rotation * self.balls[s];
                let span = pose.position + ball - elbows[s / 2] - g.limbs[s / 2].tangential() * g.pair_offset(s);
                let length = span.norm();
                let u = span * (1.0 / length);
                gaps[s] = length - self.rods[s].length;
                rows[s] = Paired::new(u, ball.cross(&u));
            }
            closed = gaps.iter().all(|gap| gap.abs() < CLOSURE_TOLERANCE);
            if closed {
                break;
            }
            corrections += 1;
            let Paired { v: shift, w: turn } = Pairs::new(&rows)?.solve(&gaps.map(|gap| -gap));
            pose.position += shift;
            orientation = UnitQuaternion::from_scaled_axis(turn) * orientation;
        }
        if !closed {
            return Err(SingularPose);
        }
        pose.orientation = *orientation;
        let rates = std::array::from_fn(|s| rows[s].v.dot(&elbow_jacobian[s / 2]) * nu[s / 2]);
        let twist = Pairs::new(&rows)?.solve(&rates);
        nu.fixed_rows_mut::<6>(PLATFORM_V).copy_from(&twist.to_vector());
        Ok(corrections)
    }

    /// Pose, ν and spins of a motion, whose loops must be closed to within a few millimetres.
    pub fn pose(&self, motion: &Motion) -> (Pose, OpenVector, SixStruts<f64>) {
        let platform = &motion.bodies[PLATFORM];
        let orientation =
            *UnitQuaternion::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(platform.rotation));
        let mut roll: SixStruts<f64> = each(0.0);
        let mut spin: SixStruts<f64> = each(0.0);
        for s in six_struts() {
            let (u, v) = (motion.strut_axis[s], self.geometry.limbs[s / 2].tangential());
            let y = (v - u * u.dot(&v)).normalize();
            let strut = &motion.bodies[bodies::strut(s)];
            let own = strut.rotation.column(1);
            roll[s] = own.dot(&u.cross(&y)).atan2(own.dot(&y));
            spin[s] = strut.angular_velocity.dot(&u);
        }
        let q = motion.q;
        let (v, w) = (platform.velocity, platform.angular_velocity);
        let d = motion.qd;
        (
            Pose { phi: [q[0], q[1], q[2]], psi: q[3], position: platform.position, orientation, roll },
            OpenVector::from_column_slice(&[d[0], d[1], d[2], d[3], v.x, v.y, v.z, w.x, w.y, w.z]),
            spin,
        )
    }
}
