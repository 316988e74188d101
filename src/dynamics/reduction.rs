//! Reduction of the wrenches on all bodies to generalised forces of the arms, the rotor of axis 4 and the platform.
//!
//! It is the transpose of the twists of [`super::channels`]: with ξ = S·(q̇_arms, q̇_rotor, v, ω) the twists of all
//! bodies, the generalised forces are Sᵀ·w. Every channel is the product of these with the twist of its own virtual
//! motion.

use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

use super::channels::{Twist, gap_inverse, platform_ball};
use crate::kinematics::{KinematicsError, Motion};
use crate::machine::bodies::{ARM, BODIES, END_EFFECTOR, PLATFORM, ROTOR, STRUT, TELESCOPE_LOWER, TELESCOPE_UPPER};
use crate::machine::{ARMS, Geometry, STRUTS};

/// Generalised forces of arms, rotor of axis 4 and platform.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Reduced {
    /// Moments about the motor axes, N·m, or forces along the guides, N.
    arms: [f64; ARMS],
    /// Moment about z, N·m.
    rotor: f64,
    /// Force on the platform, inertial axes, N.
    force: Vector3<f64>,
    /// Moment on the platform about its origin, inertial axes, N·m.
    moment: Vector3<f64>,
}

/// Equilibrium of wrenches with drive torques and strut forces at one pose.
pub(super) struct Reduction<'a> {
    motion: &'a Motion,
    assembled: bool,
    /// Platform velocity per arm rate, m/rad.
    jacobian: Matrix3<f64>,
    /// Platform twists per unit gap at each strut; `None` if strut forces are not requested.
    gaps: Option<Matrix6<f64>>,
}

impl<'a> Reduction<'a> {
    pub(super) fn new(
        geometry: &Geometry,
        motion: &'a Motion,
        assembled: bool,
        with_struts: bool,
    ) -> Result<Self, KinematicsError> {
        let jacobian =
            if assembled { geometry.jacobian(&motion.q, &motion.bodies[PLATFORM].position)? } else { Matrix3::zeros() };
        let singular = KinematicsError::Singular { q: [motion.q[0], motion.q[1], motion.q[2]] };
        let gaps = if assembled && with_struts { Some(gap_inverse(motion).ok_or(singular)?) } else { None };
        Ok(Self { motion, assembled, jacobian, gaps })
    }

    /// Drive torques (N·m) and axial strut forces (N) at elbow and platform that balance `wrenches`; forces not
    /// requested are zero.
    pub(super) fn balance(&self, wrenches: &[Twist; BODIES]) -> ([f64; ARMS + 1], [f64; STRUTS], [f64; STRUTS]) {
        let sum = self.reduce(wrenches);
        let through = self.jacobian.tr_mul(&sum.force);
        let torque =
            [-(sum.arms[0] + through[0]), -(sum.arms[1] + through[1]), -(sum.arms[2] + through[2]), -sum.rotor];
        let (mut upper, mut lower) = ([0.0; STRUTS], [0.0; STRUTS]);
        if let Some(gaps) = &self.gaps {
            let platform =
                Vector6::new(sum.force.x, sum.force.y, sum.force.z, sum.moment.x, sum.moment.y, sum.moment.z);
            let axial = gaps.tr_mul(&platform);
            for s in 0..STRUTS {
                lower[s] = axial[s];
                // A gap at the elbow moves the strut together with the platform.
                upper[s] = axial[s] + wrenches[STRUT + s].0.dot(&self.motion.strut_axis[s]);
            }
        }
        (torque, upper, lower)
    }

    fn reduce(&self, wrenches: &[Twist; BODIES]) -> Reduced {
        let motion = self.motion;
        let mut sum = Reduced { rotor: wrenches[ROTOR].1.z, ..Reduced::default() };
        for (i, arm) in sum.arms.iter_mut().enumerate() {
            let (body, screw) = motion.drive(i);
            *arm = screw.effort(&wrenches[body]);
        }
        if !self.assembled {
            return sum;
        }
        (sum.force, sum.moment) = wrenches[PLATFORM];
        for s in 0..STRUTS {
            let (force, moment) = &wrenches[STRUT + s];
            let (strut, arm) = (&motion.bodies[STRUT + s], s / 2);
            // ω = u × (v_lower − v_upper)/ℓ: a moment is equivalent to a pair of forces at the ends.
            let pair = moment.cross(&motion.strut_axis[s]) / motion.strut_length[s];
            let lever = strut.position - motion.bodies[ARM + arm].position;
            let upper = force - pair;
            sum.arms[arm] += motion.drive(arm).1.effort(&(upper, lever.cross(&upper)));
            sum.force += pair;
            sum.moment += platform_ball(motion, s).cross(&pair);
        }
        self.reduce_chain(wrenches, &mut sum);
        sum
    }

    /// Adds the wrenches of end effector, rotor and both telescope parts.
    fn reduce_chain(&self, wrenches: &[Twist; BODIES], sum: &mut Reduced) {
        let motion = self.motion;
        let telescope = &motion.telescope;
        let [upper, lower] = motion.hooke_joints();
        let pivot = motion.bodies[PLATFORM].rotation.column(2).into_owned();
        let lever = |b: usize| motion.bodies[b].position - motion.bodies[PLATFORM].position;
        let (force, moment) = &wrenches[END_EFFECTOR];
        // The end effector turns with the platform and, about the pivot, with the telescope.
        let turning = lower.passed(moment, &pivot);
        sum.force += force;
        sum.moment += lever(END_EFFECTOR).cross(force) + moment - turning;
        // The telescope spins with the rotor and swings with its lower end.
        let on_telescope = wrenches[TELESCOPE_UPPER].1 + wrenches[TELESCOPE_LOWER].1 + turning;
        let spinning = upper.passed(&on_telescope, &telescope.axis);
        sum.rotor += spinning.z;
        let swinging = on_telescope - spinning;
        let end = wrenches[TELESCOPE_LOWER].0 + telescope.axis.cross(&swinging) / telescope.length;
        sum.force += end;
        sum.moment += lever(TELESCOPE_LOWER).cross(&end);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::channels::ChannelMap;
    use crate::dynamics::{Plant, STILL};
    use crate::kinematics::JointState;
    use crate::model::testing::irb360;
    use crate::recording::Channel;

    /// Virtual work of random wrenches in the virtual motions of the channels.
    #[test]
    fn is_the_transpose_of_the_channels_twists() {
        let model = irb360();
        let plant = Plant::new(&model, &Default::default());
        let joints = JointState { q: [0.3, 0.5, 0.1, 0.7], qd: [1.0, -2.0, 0.5, 3.0], qdd: [5.0, 3.0, -4.0, 9.0] };
        let motion = plant.motion(&joints).unwrap();
        let mut wrenches = [STILL; BODIES];
        for (b, (f, m)) in wrenches.iter_mut().enumerate() {
            let wave = |k: usize| (1.7 * (6 * b + k) as f64 + 0.3).sin();
            (*f, *m) = (Vector3::new(wave(0), wave(1), wave(2)), Vector3::new(wave(3), wave(4), wave(5)));
        }
        let channels: Vec<Channel> = Channel::TORQUES
            .into_iter()
            .chain((0..STRUTS).map(Channel::StrutUpper))
            .chain((0..STRUTS).map(Channel::StrutLower))
            .collect();
        for assembled in [true, false] {
            let count = if assembled { channels.len() } else { 4 };
            let map = ChannelMap::new(&plant.geometry, &motion, assembled, &channels[..count]).unwrap();
            let (torque, upper, lower) =
                Reduction::new(&plant.geometry, &motion, assembled, true).unwrap().balance(&wrenches);
            let values: Vec<f64> = torque.into_iter().chain(upper).chain(lower).collect();
            for (c, value) in values.iter().enumerate().take(count) {
                let work: f64 = wrenches.iter().enumerate().map(|(b, (f, m))| map.project(c, b, f, m)).sum();
                approx::assert_relative_eq!(*value, work, epsilon = 1e-12);
            }
        }
    }
}
