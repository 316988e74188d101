//! Linear system Gᵀλ = w at a pose: the reduced constraint Jacobian G (32) and its solution by block elimination.
//!
//! The sign convention is "end effector on platform", "platform on strut", "strut on arm", as in [`Multipliers`].
//! Velocities: V_E = (v, ω) of the flange centre in the end effector's axes, V_P = (v, ω) of the platform's ball
//! centre in inertial axes, v_S along each strut, ω_A about each motor axis.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::{Detail, MULTIPLIERS, Multipliers};
use crate::kinematics::{KinematicsError, Motion, Twist};
use crate::machine::bodies::{self, END_EFFECTOR, PLATFORM};
use crate::machine::{SixStruts, ThreeArms, six_struts, three_arms};

/// Loads w = W − M V̇ − C M V on the reduced velocities: applied minus inertial.
#[derive(Clone, Copy, Debug)]
pub struct Loads {
    /// On the end effector, about the flange centre, inertial axes; N, N·m.
    pub end_effector: Twist,
    /// On the platform, about the ball centre, inertial axes; N, N·m.
    pub platform: Twist,
    /// Along each strut, N.
    pub struts: SixStruts<f64>,
    /// About each motor axis, N·m.
    pub arms: ThreeArms<f64>,
}

/// Geometry of the reduced constraints at a pose.
#[derive(Clone, Debug)]
pub struct Statics {
    /// Detail of the loads.
    pub(super) detail: Detail,
    /// Whether loads on rotor and telescope reach the end effector.
    pub(super) turns: bool,
    /// Axes of the end effector.
    rotation: Matrix3<f64>,
    /// Flange centre relative to the ball centre, m.
    flange: Vector3<f64>,
    /// Wrench on the end effector per unit of drive 4's torque, about the flange centre.
    pub(super) drive: Twist,
    /// Unit vector along both struts of each limb, elbow to platform.
    axis: ThreeArms<Vector3<f64>>,
    /// Middle of each pair of balls relative to the ball centre, m.
    pair: ThreeArms<Vector3<f64>>,
    /// Half the vector between the balls of a pair, m.
    half: ThreeArms<Vector3<f64>>,
    /// Torque about the motor axis (m), or force along the guide (1), per unit of force along a strut at the elbow.
    lever: ThreeArms<f64>,
    /// Inverse that maps the platform's force to the sum of the forces of each pair.
    sums: Matrix3<f64>,
    /// Inverse that maps the platform's moment to the difference of the forces of each pair.
    differences: Matrix3<f64>,
}

impl Statics {
    /// System at the pose of `motion`. `drive` is the wrench on the end effector per unit torque of drive 4, about
    /// the flange centre, in inertial axes.
    ///
    /// # Errors
    /// [`KinematicsError::Singular`] if the struts do not determine the platform's pose.
    pub fn new(motion: &Motion, drive: Twist) -> Result<Self, KinematicsError> {
        let platform = &motion.bodies[PLATFORM];
        let end_effector = &motion.bodies[END_EFFECTOR];
        let ball = |s: usize| {
            motion.bodies[bodies::strut(s)].position + motion.strut_axis[s] * motion.strut_length[s] - platform.position
        };
        let axis: ThreeArms<Vector3<f64>> = std::array::from_fn(|i| motion.strut_axis[2 * i]);
        let half: ThreeArms<Vector3<f64>> = std::array::from_fn(|i| (ball(2 * i) - ball(2 * i + 1)) * 0.5);
        let singular = || KinematicsError::Singular { q: motion.q[three_arms()].into() };
        let invert =
            |columns: &ThreeArms<Vector3<f64>>| Matrix3::from_columns(columns).try_inverse().ok_or_else(singular);
        Ok(Self {
            detail: Detail::Complete,
            turns: true,
            rotation: end_effector.rotation,
            flange: end_effector.position - platform.position,
            drive,
            axis,
            pair: std::array::from_fn(|i| (ball(2 * i) + ball(2 * i + 1)) * 0.5),
            half,
            lever: std::array::from_fn(|i| {
                let lever = motion.bodies[bodies::strut(2 * i)].position - motion.bodies[bodies::arm(i)].position;
                motion.drive(i).1.effort(&(axis[i], lever.cross(&axis[i])))
            }),
            sums: invert(&axis)?,
            differences: invert(&std::array::from_fn(|i| half[i].cross(&axis[i])))?,
        })
    }

    /// Solution of Gᵀλ = w by block elimination from the end effector to the arms.
    pub fn solve(&self, loads: &Loads) -> Multipliers {
        let mut out = Multipliers::default();
        // The bearing transmits no moment about the end effector's axis except that of drive 4.
        let (force, moment) = loads.end_effector;
        let pivot = self.rotation.column(2);
        out.lambda_tb = -moment.dot(&pivot) / self.drive.1.dot(&pivot);
        let force = force + self.drive.0 * out.lambda_tb;
        let moment = moment + self.drive.1 * out.lambda_tb;
        let (f, m) = (self.rotation.tr_mul(&force), self.rotation.tr_mul(&moment));
        out.lambda_e = [m.x, m.y, f.x, f.y, f.z];
        // Platform: the sums of the pairs balance the force, the differences the remaining moment.
        let moment = loads.platform.1 + moment + self.flange.cross(&force);
        let sums = self.sums * (loads.platform.0 + force);
        let carried: Vector3<f64> = three_arms().map(|i| self.pair[i].cross(&self.axis[i]) * sums[i]).sum();
        let differences = self.differences * (moment - carried);
        for i in three_arms() {
            let (a, b) = (2 * i, 2 * i + 1);
            out.lambda_p[a] = 0.5 * (sums[i] + differences[i]);
            out.lambda_p[b] = 0.5 * (sums[i] - differences[i]);
            for s in [a, b] {
                out.lambda_s[s] = out.lambda_p[s] + loads.struts[s];
            }
            out.lambda_a[i] = -loads.arms[i] - self.lever[i] * (out.lambda_s[a] + out.lambda_s[b]);
        }
        out
    }

    /// The Jacobian G; rows in the order of the multipliers, columns in the order of V.
    pub fn jacobian(&self) -> SMatrix<f64, MULTIPLIERS, MULTIPLIERS> {
        let mut g = SMatrix::<f64, MULTIPLIERS, MULTIPLIERS>::zeros();
        let ee = self.rotation;
        let mut row = |k: usize, e: Twist, p: Twist| {
            g.fixed_view_mut::<1, 3>(k, 0).copy_from(&ee.tr_mul(&e.0).transpose());
            g.fixed_view_mut::<1, 3>(k, 3).copy_from(&ee.tr_mul(&e.1).transpose());
            g.fixed_view_mut::<1, 3>(k, 6).copy_from(&p.0.transpose());
            g.fixed_view_mut::<1, 3>(k, 9).copy_from(&p.1.transpose());
        };
        let none = Vector3::zeros();
        for k in 0..2 {
            let x = ee.column(k).into_owned();
            row(k, (none, x), (none, -x));
        }
        for k in 0..3 {
            let x = ee.column(k).into_owned();
            row(2 + k, (x, none), (-x, -self.flange.cross(&x)));
        }
        row(5, (-self.drive.0, -self.drive.1), (none, none));
        for s in six_struts() {
            let i = s / 2;
            let ball = if s.is_multiple_of(2) { self.pair[i] + self.half[i] } else { self.pair[i] - self.half[i] };
            row(6 + s, (none, none), (self.axis[i], ball.cross(&self.axis[i])));
        }
        for s in six_struts() {
            g[(6 + s, 12 + s)] = -1.0;
            g[(12 + s, 12 + s)] = 1.0;
            g[(12 + s, 18 + s / 2)] = -self.lever[s / 2];
        }
        for i in three_arms() {
            g[(18 + i, 18 + i)] = -1.0;
        }
        g
    }
}

impl Loads {
    /// Loads in the order of V, those of the end effector in its axes at the pose of `statics`.
    pub fn to_vector(&self, statics: &Statics) -> SVector<f64, MULTIPLIERS> {
        let ee = statics.rotation;
        let mut w = SVector::<f64, MULTIPLIERS>::zeros();
        w.fixed_rows_mut::<3>(0).copy_from(&ee.tr_mul(&self.end_effector.0));
        w.fixed_rows_mut::<3>(3).copy_from(&ee.tr_mul(&self.end_effector.1));
        w.fixed_rows_mut::<3>(6).copy_from(&self.platform.0);
        w.fixed_rows_mut::<3>(9).copy_from(&self.platform.1);
        w.fixed_rows_mut::<6>(12).copy_from_slice(&self.struts);
        w.fixed_rows_mut::<3>(18).copy_from_slice(&self.arms);
        w
    }
}
