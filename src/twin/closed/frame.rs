//! Motion of all bodies of the assembled mechanism, with the Jacobians and velocity products of its joints.

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use super::super::wrench::STILL;
use super::chain::{Chain, ChainBias};
use super::{Mechanism, OpenVector, Pose, platform_twist};
use crate::kinematics::{Arm, BodyMotion, JointState, Motion};
use crate::machine::bodies::{self, PLATFORM, ROTOR};
use crate::machine::{Geometry, SixStruts, ThreeArms, each, six_struts, three_arms};
use crate::numerics::sin_cos;

/// Linear maps and bias accelerations of one configuration, used by mass matrix and forces.
pub(super) struct Jacobians {
    /// Velocity of the elbow per unit of arm rate, m.
    pub elbow: ThreeArms<Vector3<f64>>,
    /// Acceleration of the elbow at φ̈ = 0, m/s².
    pub elbow_bias: ThreeArms<Vector3<f64>>,
    /// Lower ball relative to the platform's origin, m.
    pub ball: SixStruts<Vector3<f64>>,
    /// Acceleration of the lower ball at v̇ = 0 and ω̇ = 0, m/s².
    pub ball_bias: SixStruts<Vector3<f64>>,
    /// Velocity of the lower relative to the upper ball, m/s.
    pub stretch: SixStruts<Vector3<f64>>,
    pub chain: Chain,
    pub bias: ChainBias,
}

/// Kinematic quantities of the equations at one configuration and velocity.
pub(in crate::twin) struct Frame {
    /// Motion of all bodies, without accelerations.
    pub motion: Motion,
    /// Rate of the roll angles, rad/s.
    pub roll_rate: SixStruts<f64>,
    /// Rates of the strut lengths, m/s.
    pub length_rate: SixStruts<f64>,
    /// Reciprocals of the strut lengths, 1/m.
    pub(super) inverse_length: SixStruts<f64>,
    pub(super) jacobians: Jacobians,
}

impl Frame {
    /// A frame at rest, to be filled.
    pub fn empty(geometry: &Geometry) -> Self {
        let none = Vector3::zeros();
        Self {
            motion: Motion::disassembled(geometry, &JointState::default()),
            roll_rate: each(0.0),
            length_rate: each(0.0),
            inverse_length: each(0.0),
            jacobians: Jacobians {
                elbow: each(none),
                elbow_bias: each(none),
                ball: each(none),
                ball_bias: each(none),
                stretch: each(none),
                chain: Chain::zero(),
                bias: ChainBias { hooke: none, telescope: none, end_effector: STILL },
            },
        }
    }

    /// Rate of the length of strut `s` for open velocities `x`, m/s.
    pub fn along(&self, s: usize, x: &OpenVector) -> f64 {
        let u = self.motion.strut_axis[s];
        let (v, omega) = platform_twist(x);
        u.dot(&(v + omega.cross(&self.jacobians.ball[s]) - self.jacobians.elbow[s / 2] * x[s / 2]))
    }
}

impl Mechanism {
    /// Writes the frame at a pose with velocities ν and spins.
    pub fn frame(&self, pose: &Pose, nu: &OpenVector, spin: &SixStruts<f64>, out: &mut Frame) {
        let g = &self.geometry;
        let Frame { motion, roll_rate, length_rate, inverse_length, jacobians } = out;
        let Motion { q, qd, bodies, strut_axis, strut_length, telescope, .. } = motion;
        *q = [pose.phi[0], pose.phi[1], pose.phi[2], pose.psi];
        *qd = [nu[0], nu[1], nu[2], nu[3]];
        let mut elbows: ThreeArms<Vector3<f64>> = each(Vector3::zeros());
        for i in three_arms() {
            let arm = Arm::by(&g.limbs[i], pose.phi[i], sin_cos);
            let screw = arm.screw(&g.limbs[i]);
            bodies[bodies::arm(i)].place(
                arm.rotation(&g.limbs[i]),
                arm.origin,
                screw.linear * nu[i],
                screw.angular * nu[i],
            );
            elbows[i] = arm.elbow;
            jacobians.elbow[i] = arm.slope;
            jacobians.elbow_bias[i] = arm.curvature * (nu[i] * nu[i]);
        }
        let velocity = Vector3::new(nu[4], nu[5], nu[6]);
        let omega = Vector3::new(nu[7], nu[8], nu[9]);
        let rotation = UnitQuaternion::new_unchecked(pose.orientation).to_rotation_matrix().into_inner();
        bodies[PLATFORM] =
            BodyMotion { rotation, position: pose.position, velocity, angular_velocity: omega, ..BodyMotion::REST };
        for s in six_struts() {
            let i = s / 2;
            let v = g.limbs[i].tangential();
            let upper = elbows[i] + v * g.pair_offset(s);
            let ball = rotation * self.balls[s];
            let turning = omega.cross(&ball);
            let span = pose.position + ball - upper;
            let length = span.norm();
            let inverse = 1.0 / length;
            let axis = span * inverse;
            let upper_velocity = jacobians.elbow[i] * nu[i];
            let stretch = velocity + turning - upper_velocity;
            let along = axis.dot(&stretch);
            let swing = axis.cross(&stretch) * inverse;
            // Facing frame: y is the projection of the pair direction v normal to the axis.
            let share = axis.dot(&v);
            let lateral = 1.0 / (1.0 - share * share).sqrt();
            let y = (v - axis * share) * lateral;
            let z = axis.cross(&y);
            let facing_rate = -share * lateral * inverse * stretch.dot(&z);
            let (sin, cos) = sin_cos(pose.roll[s]);
            let roll = Matrix3::from_columns(&[axis, y * cos + z * sin, z * cos - y * sin]);
            bodies[bodies::strut(s)].place(roll, upper, upper_velocity, swing + axis * spin[s]);
            (strut_axis[s], strut_length[s]) = (axis, length);
            (jacobians.ball[s], jacobians.stretch[s]) = (ball, stretch);
            jacobians.ball_bias[s] = omega.cross(&turning);
            (roll_rate[s], length_rate[s], inverse_length[s]) = (spin[s] - facing_rate, along, inverse);
        }
        let (sin, cos) = sin_cos(pose.psi);
        let turned = Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0);
        bodies[ROTOR].place(turned, g.upper_hooke(), Vector3::zeros(), Vector3::new(0.0, 0.0, nu[3]));
        *telescope = self.place_chain(bodies, &mut jacobians.chain, nu[3]);
        jacobians.bias = jacobians.chain.bias(motion, g);
    }
}
