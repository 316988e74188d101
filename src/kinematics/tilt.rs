//! Platform of three limbs whose pairs have struts of unequal length: it tilts.
//!
//! Closure of strut s: f = (|l|² − L²)/2 = 0 with l = p + R·b − a, b its lower ball in the platform's frame, a its upper
//! ball and L its length. With u = l/L, f changes by L·u·(δp + δθ × R·b): six equations for place and orientation.
//!
//! To first order in the difference δ of a pair, its sum is u·(Δp + θ × b) = 0 at the middle b of the pair, and its
//! difference (v × u)·θ = δ/d, with v the pair's direction and d its distance: three pairs determine the rotation θ, which
//! shifts the platform by Δp. Both change the torques in proportion to δ: by virtual work τ = −Σ (∂x/∂q)ᵀ·w, of the
//! displaced bodies as of the nominal ones.

use nalgebra::{Matrix3, Matrix6, UnitQuaternion, Vector3, Vector6};

use super::Motion;
use super::arm::Arm;
use super::delta::{JointState, KinematicsError, PlatformState};
use super::motion::{BodyMotion, StrutEnds, strut_motion};
use super::telescope::telescope_motion;
use crate::machine::bodies::{END_EFFECTOR, PLATFORM, ROTOR, TELESCOPE_LOWER, TELESCOPE_UPPER, arm, strut};
use crate::machine::{Geometry, SixStruts, six_struts, three_arms};

/// Newton steps, far beyond the few that a small tilt takes.
const MOST_STEPS: usize = 20;
/// Size of a last step, m or rad.
const CONVERGED: f64 = 1e-14;

/// Closure of the six struts at a pose, linearised.
struct Rows {
    /// Vectors from upper to lower balls, m.
    struts: SixStruts<Vector3<f64>>,
    /// Lower balls relative to the platform's origin, inertial axes, m.
    balls: SixStruts<Vector3<f64>>,
    /// Inverse of the matrix with rows (lᵀ, (R·b × l)ᵀ).
    inverse: Matrix6<f64>,
}

impl Rows {
    fn new(
        geometry: &Geometry,
        upper: &SixStruts<Vector3<f64>>,
        position: &Vector3<f64>,
        rotation: &Matrix3<f64>,
    ) -> Option<Self> {
        let balls: SixStruts<Vector3<f64>> = std::array::from_fn(|s| rotation * geometry.platform_ball(s));
        let struts = std::array::from_fn(|s| position + balls[s] - upper[s]);
        let mut rows = Matrix6::zeros();
        for (s, (l, ball)) in struts.iter().zip(&balls).enumerate() {
            rows.fixed_view_mut::<1, 3>(s, 0).copy_from(&l.transpose());
            rows.fixed_view_mut::<1, 3>(s, 3).copy_from(&ball.cross(l).transpose());
        }
        Some(Self { struts, balls, inverse: rows.try_inverse()? })
    }

    /// Velocity and angular velocity, or their derivatives, for given right-hand sides.
    fn solve(&self, right: impl Fn(usize) -> f64) -> (Vector3<f64>, Vector3<f64>) {
        let x = self.inverse * Vector6::from_fn(|s, _| right(s));
        (x.fixed_rows::<3>(0).into_owned(), x.fixed_rows::<3>(3).into_owned())
    }
}

impl Motion {
    /// Motion of the assembled robot with its platform tilted by the lengths of the struts; `level` is the motion of the
    /// platform with both struts of every pair at their mean length.
    ///
    /// # Errors
    /// [`KinematicsError::Singular`] where the struts do not determine the platform's pose,
    /// [`KinematicsError::NoClosure`] where they do not reach it.
    pub(super) fn tilted(
        geometry: &Geometry,
        joints: &JointState,
        level: &PlatformState,
    ) -> Result<Self, KinematicsError> {
        let mut motion = Self::with_platform(geometry, joints, level);
        let q = || joints.q[three_arms()].to_vec();
        let arms = Arm::three(geometry, &joints.q);
        let upper =
            std::array::from_fn(|s| arms[s / 2].elbow + geometry.limbs[s / 2].tangential() * geometry.pair_offset(s));
        let (mut position, mut turned) = (level.position, UnitQuaternion::identity());
        let singular = || KinematicsError::Singular { q: q() };
        let rows = |position: &Vector3<f64>, turned: &UnitQuaternion<f64>| {
            Rows::new(geometry, &upper, position, turned.to_rotation_matrix().matrix()).ok_or_else(singular)
        };
        let mut converged = false;
        for _ in 0..MOST_STEPS {
            let here = rows(&position, &turned)?;
            let gap = |s: usize| 0.5 * (geometry.strut_length(s).powi(2) - here.struts[s].norm_squared());
            let (shift, turn) = here.solve(gap);
            position += shift;
            turned = UnitQuaternion::from_scaled_axis(turn) * turned;
            converged = shift.amax().max(turn.amax()) < CONVERGED;
            if converged {
                break;
            }
        }
        if !converged {
            return Err(KinematicsError::NoClosure { q: q() });
        }
        let here = rows(&position, &turned)?;
        let (qd, qdd) = (&joints.qd, &joints.qdd);
        let upper_velocity = |s: usize| arms[s / 2].slope * qd[s / 2];
        let (velocity, omega) = here.solve(|s| here.struts[s].dot(&upper_velocity(s)));
        // l·l̈ = −|l̇|² with l̈ = p̈ + α × r + ω × (ω × r) − ä.
        let (acceleration, alpha) = here.solve(|s| {
            let (l, r, arm) = (&here.struts[s], &here.balls[s], &arms[s / 2]);
            let ld = velocity + omega.cross(r) - upper_velocity(s);
            let upper = arm.slope * qdd[s / 2] + arm.curvature * (qd[s / 2] * qd[s / 2]);
            l.dot(&(upper - omega.cross(&omega.cross(r)))) - ld.norm_squared()
        });
        motion.bodies[PLATFORM] = BodyMotion {
            rotation: turned.to_rotation_matrix().into_inner(),
            position,
            velocity,
            angular_velocity: omega,
            acceleration,
            angular_acceleration: alpha,
        };
        for s in six_struts() {
            let ends = StrutEnds {
                offset: geometry.limbs[s / 2].tangential() * geometry.pair_offset(s),
                point: geometry.platform_ball(s),
                length: geometry.strut_length(s),
            };
            let (body, axis) =
                strut_motion(&geometry.limbs[s / 2], &motion.bodies[arm(s / 2)], &motion.bodies[PLATFORM], &ends);
            motion.bodies[strut(s)] = body;
            (motion.strut_axis[s], motion.strut_length[s]) = (axis, ends.length);
        }
        motion.place_chain(geometry);
        Ok(motion)
    }

    /// Sets telescope and end effector between the rotor and a platform that turns: the end effector turns with the
    /// platform and, by κ̇ about its normal, with the telescope if there is one.
    fn place_chain(&mut self, geometry: &Geometry) {
        let platform = self.bodies[PLATFORM];
        let (omega, alpha) = (platform.angular_velocity, platform.angular_acceleration);
        let pivot = platform.rotation.column(2).into_owned();
        let on_pivot = |height: f64| {
            let r = pivot * height;
            BodyMotion {
                position: platform.position + r,
                velocity: platform.velocity + omega.cross(&r),
                acceleration: platform.acceleration + alpha.cross(&r) + omega.cross(&omega.cross(&r)),
                ..platform
            }
        };
        if !geometry.has_end_effector() {
            self.bodies[END_EFFECTOR] = on_pivot(geometry.flange_height);
            return;
        }
        let hooke = on_pivot(geometry.lower_hooke_height);
        let (upper, lower, telescope) = telescope_motion(
            geometry.upper_hooke(),
            hooke.position,
            &self.bodies[ROTOR],
            hooke.velocity,
            hooke.acceleration,
        );
        (self.bodies[TELESCOPE_UPPER], self.bodies[TELESCOPE_LOWER], self.telescope) = (upper, lower, telescope);
        let x = upper.rotation.column(1).cross(&pivot).normalize();
        self.bodies[END_EFFECTOR] = BodyMotion {
            rotation: Matrix3::from_columns(&[x, pivot.cross(&x), pivot]),
            ..on_pivot(geometry.flange_height)
        };
        let [_, joint] = self.hooke_joints();
        let rate = joint.spin(&(upper.angular_velocity - omega), &pivot);
        let own = omega + pivot * rate;
        // (α_E − α_T)·n + (ω_E − ω_T)·ṅ = 0 with α_E = α + κ̈·z + κ̇·ω × z.
        let precession = omega.cross(&pivot) * rate;
        let turning = (own - upper.angular_velocity).dot(&joint.normal_rate(&own, &upper.angular_velocity));
        let missing = upper.angular_acceleration - alpha - precession;
        let rate_rate = joint.spin(&missing, &pivot) - turning / pivot.dot(&joint.normal);
        let end_effector = &mut self.bodies[END_EFFECTOR];
        end_effector.angular_velocity = own;
        end_effector.angular_acceleration = alpha + precession + pivot * rate_rate;
    }
}
