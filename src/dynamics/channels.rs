//! Projection of wrenches on bodies onto drive torques and strut forces, by the principle of virtual work.
//!
//! A drive torque does work on its joint angle, an axial strut force on a virtual gap at its socket while the drives
//! are locked. With ξ_c the twists of all bodies per unit of such a virtual motion and w the applied minus the inertial
//! wrenches, τ_c = −Σ ξ_c·w and T_c = +Σ ξ_c·w (tension positive).

use nalgebra::{Matrix6, Vector3, Vector6};

use crate::kinematics::{KinematicsError, Motion};
use crate::machine::bodies::{ARM, BODIES, END_EFFECTOR, PLATFORM, ROTOR, STRUT, TELESCOPE_LOWER, TELESCOPE_UPPER};
use crate::machine::{ARMS, Geometry, STRUTS};
use crate::recording::Channel;

/// Twist (velocity of the frame origin, angular velocity) or wrench (force, moment about the origin) of a body,
/// inertial axes.
pub type Twist = (Vector3<f64>, Vector3<f64>);

/// Zero twist or wrench.
pub(crate) const STILL: Twist = (Vector3::new(0., 0., 0.), Vector3::new(0., 0., 0.));

/// Twists of all bodies per unit of each channel's virtual motion.
pub struct ChannelMap {
    /// Channels in order.
    pub channels: Vec<Channel>,
    twists: Vec<[Twist; BODIES]>,
}

impl ChannelMap {
    /// Projection onto `channels`, drive torques and strut forces, at a pose. A disassembled robot (`assembled` false)
    /// has drive torques only.
    ///
    /// # Errors
    /// [`KinematicsError::Singular`] if the Jacobian or, with strut forces among the channels, the matrix of the strut
    /// lines is singular.
    pub fn new(
        geometry: &Geometry,
        motion: &Motion,
        assembled: bool,
        channels: &[Channel],
    ) -> Result<Self, KinematicsError> {
        let mut twists = Vec::with_capacity(channels.len());
        let jacobian = if assembled {
            geometry.jacobian(&motion.q, &motion.bodies[PLATFORM].position)?
        } else {
            nalgebra::Matrix3::zeros()
        };
        let gaps = if channels.iter().all(|c| c.drive().is_some()) {
            None
        } else {
            Some(gap_inverse(motion).ok_or(KinematicsError::Singular { q: [motion.q[0], motion.q[1], motion.q[2]] })?)
        };
        for &channel in channels {
            let mut arms = [0.0; ARMS];
            let mut rotor = 0.0;
            let mut platform = STILL;
            match channel {
                Channel::Torque(axis) if axis < ARMS => {
                    arms[axis] = 1.0;
                    platform.0 = jacobian.column(axis).into_owned();
                }
                Channel::Torque(_) => rotor = 1.0,
                Channel::StrutUpper(s) | Channel::StrutLower(s) => {
                    let column = gaps.as_ref().map_or(Vector6::zeros(), |g| g.column(s).into_owned());
                    platform = (column.fixed_rows::<3>(0).into_owned(), column.fixed_rows::<3>(3).into_owned());
                }
                _ => {}
            }
            let mut xi = if assembled {
                spread(motion, &arms, rotor, &platform)
            } else {
                let mut xi = [STILL; BODIES];
                set_drives(&mut xi, motion, &arms, rotor);
                xi
            };
            if let Channel::StrutUpper(s) = channel {
                xi[STRUT + s].0 += motion.strut_axis[s];
            }
            twists.push(xi);
        }
        Ok(Self { channels: channels.to_vec(), twists })
    }

    /// Contribution of a wrench on `body` (inertial axes, about its origin) to channel number `c` of the map, N·m or N.
    ///
    /// # Panics
    /// If there is no channel `c` or no `body`.
    pub fn project(&self, c: usize, body: usize, force: &Vector3<f64>, moment: &Vector3<f64>) -> f64 {
        let (v, omega) = &self.twists[c][body];
        let sign = if self.channels[c].drive().is_some() { -1.0 } else { 1.0 };
        sign * (force.dot(v) + moment.dot(omega))
    }
}

/// Platform twists per unit gap at each strut with locked drives: inverse of the matrix with rows (uᵀ, (r × u)ᵀ).
pub(super) fn gap_inverse(motion: &Motion) -> Option<Matrix6<f64>> {
    let mut rows = Matrix6::zeros();
    for s in 0..STRUTS {
        let u = motion.strut_axis[s];
        let r = platform_ball(motion, s);
        rows.fixed_view_mut::<1, 3>(s, 0).copy_from(&u.transpose());
        rows.fixed_view_mut::<1, 3>(s, 3).copy_from(&r.cross(&u).transpose());
    }
    rows.try_inverse()
}

/// Lower ball of strut `s` relative to the platform origin, inertial axes, m.
pub(super) fn platform_ball(motion: &Motion, s: usize) -> Vector3<f64> {
    let strut = &motion.bodies[STRUT + s];
    strut.position + strut_vector(motion, s) - motion.bodies[PLATFORM].position
}

fn strut_vector(motion: &Motion, s: usize) -> Vector3<f64> {
    motion.strut_axis[s] * motion.strut_length[s]
}

fn set_drives(xi: &mut [Twist; BODIES], motion: &Motion, arms: &[f64; ARMS], rotor: f64) {
    for (i, rate) in arms.iter().enumerate() {
        let (body, screw) = motion.drive(i);
        xi[body] = (screw.linear * *rate, screw.angular * *rate);
    }
    xi[ROTOR].1 = Vector3::z() * rotor;
}

/// Twists of all bodies for given arm rates, rotor rate and platform twist; struts do not spin.
pub(crate) fn spread(motion: &Motion, arms: &[f64; ARMS], rotor: f64, platform: &Twist) -> [Twist; BODIES] {
    let mut xi = [STILL; BODIES];
    set_drives(&mut xi, motion, arms, rotor);
    let (v, omega) = *platform;
    for s in 0..STRUTS {
        let body = &motion.bodies[STRUT + s];
        let arm = ARM + s / 2;
        let upper = xi[arm].0 + xi[arm].1.cross(&(body.position - motion.bodies[arm].position));
        let lower = v + omega.cross(&platform_ball(motion, s));
        let axis = &motion.strut_axis[s];
        xi[STRUT + s] = (upper, axis.cross(&(lower - upper)) / motion.strut_length[s]);
    }
    xi[PLATFORM] = *platform;
    xi[END_EFFECTOR..].copy_from_slice(&spread_chain(motion, rotor, platform));
    xi
}

/// Twists of end effector, rotor, upper and lower telescope part for a rotor rate and a platform twist.
pub(crate) fn spread_chain(motion: &Motion, rotor: f64, platform: &Twist) -> [Twist; BODIES - END_EFFECTOR] {
    let (v, omega) = *platform;
    let at_platform = |b: usize| v + omega.cross(&(motion.bodies[b].position - motion.bodies[PLATFORM].position));
    let lower_hooke = at_platform(TELESCOPE_LOWER);
    let rotor_omega = Vector3::z() * rotor;
    let telescope = &motion.telescope;
    let [upper, lower] = motion.hooke_joints();
    let swing = telescope.swing(&lower_hooke);
    let telescope_omega = swing + telescope.axis * upper.spin(&(rotor_omega - swing), &telescope.axis);
    let pivot = motion.bodies[PLATFORM].rotation.column(2).into_owned();
    let relative = lower.spin(&(telescope_omega - omega), &pivot);
    let mut xi = [STILL; BODIES - END_EFFECTOR];
    xi[0] = (at_platform(END_EFFECTOR), omega + pivot * relative);
    xi[ROTOR - END_EFFECTOR] = (Vector3::zeros(), rotor_omega);
    xi[TELESCOPE_UPPER - END_EFFECTOR] = (Vector3::zeros(), telescope_omega);
    xi[TELESCOPE_LOWER - END_EFFECTOR] = (lower_hooke, telescope_omega);
    xi
}
