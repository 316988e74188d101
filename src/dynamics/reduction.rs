//! Reduction of the wrenches on all bodies to generalised forces of the arms, the rotor of axis 4 and the platform.
//!
//! It is the transpose of the twists of [`super::channels`]: with ξ = S·(q̇_arms, q̇_rotor, v, ω) the twists of all
//! bodies, the generalised forces are Sᵀ·w. Every channel is the product of these with the twist of its own virtual
//! motion.

use nalgebra::{Vector3, Vector6};

use super::Output;
use super::channels::Three;
use crate::kinematics::{KinematicsError, Motion, PlateMotions, Reactions, STILL, Twist};
use crate::machine::bodies::{END_EFFECTOR, PLATFORM, ROTOR, SLOTS, TELESCOPE_LOWER, TELESCOPE_UPPER, arm, strut};
use crate::machine::{Geometry, PerAxis, PerLimb, TELESCOPE_AXIS, each, may_have_telescope};

/// Generalised forces of arms, rotor of axis 4 and platform.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Reduced {
    /// Moments about the motor axes, N·m, or forces along the guides, N.
    arms: PerLimb<f64>,
    /// Moment about z, N·m.
    rotor: f64,
    /// Force on the platform, inertial axes, N.
    force: Vector3<f64>,
    /// Moment on the platform about its origin, inertial axes, N·m.
    moment: Vector3<f64>,
}

/// Equilibrium of wrenches with drive torques and strut forces at one pose.
pub(super) struct Reduction<'a> {
    geometry: &'a Geometry,
    motion: &'a Motion,
    carried: Carried,
}

/// What the arms carry.
#[expect(clippy::large_enum_variant, reason = "made and used at one instant, without an allocation for three limbs")]
enum Carried {
    /// Nothing: a disassembled machine.
    Nothing,
    /// The platform of three limbs.
    Platform(Three),
    /// Any plate.
    Plate(Box<PlateMotions>),
}

impl<'a> Reduction<'a> {
    pub(super) fn new(
        geometry: &'a Geometry,
        motion: &'a Motion,
        assembled: bool,
        with_struts: bool,
    ) -> Result<Self, KinematicsError> {
        let carried = if !assembled {
            Carried::Nothing
        } else if geometry.has_platform_of_three() {
            Carried::Platform(Three::new(geometry, motion, with_struts)?)
        } else {
            Carried::Plate(Box::new(PlateMotions::new(geometry, motion)?))
        };
        Ok(Self { geometry, motion, carried })
    }

    /// Drive torques (N·m) and axial strut forces (N) at elbow and platform that balance `wrenches`; forces not
    /// requested are zero.
    pub(super) fn balance(&self, wrenches: &[Twist; SLOTS]) -> Output {
        let mut wrenches = *wrenches;
        join_end_effector(self.geometry, self.motion, &mut wrenches);
        let wrenches = &wrenches;
        match &self.carried {
            Carried::Plate(plate) => self.balance_plate(plate, wrenches),
            Carried::Nothing => self.of_platform(wrenches, None),
            Carried::Platform(three) => self.of_platform(wrenches, Some(three)),
        }
    }

    fn of_platform(&self, wrenches: &[Twist; SLOTS], platform: Option<&Three>) -> Output {
        let sum = self.reduce(wrenches, platform.is_some());
        let load = Vector6::new(sum.force.x, sum.force.y, sum.force.z, sum.moment.x, sum.moment.y, sum.moment.z);
        let mut tau: PerAxis<f64> = each(0.0);
        let through = platform.map_or(Vector3::zeros(), |three| three.jacobian.tr_mul(&load));
        for (i, tau) in tau.iter_mut().enumerate().take(self.motion.limbs) {
            *tau = -(sum.arms[i] + through.get(i).copied().unwrap_or(0.0));
        }
        if may_have_telescope(self.motion.limbs) {
            tau[TELESCOPE_AXIS] = -sum.rotor;
        }
        let mut reactions = Reactions::ZERO;
        if let Some(gaps) = platform.and_then(|three| three.gaps.as_ref()) {
            reactions = self.at_both_ends(wrenches, gaps.tr_mul(&load).as_slice());
        }
        Output { tau, reactions }
    }

    /// Axial forces at both ends: a gap at the elbow moves the strut together with the platform.
    fn at_both_ends(&self, wrenches: &[Twist; SLOTS], axial: &[f64]) -> Reactions {
        let mut out = Reactions::ZERO;
        for s in 0..self.motion.struts() {
            out.lower[s] = axial[s];
            out.upper[s] = axial[s] + wrenches[strut(s)].0.dot(&self.motion.strut_axis[s]);
        }
        out
    }

    fn balance_plate(&self, plate: &PlateMotions, wrenches: &[Twist; SLOTS]) -> Output {
        let motion = self.motion;
        let mut on_parts = *wrenches;
        let mut arms = self.on_arms(wrenches);
        self.hand_on(wrenches, &mut arms, |s, pair| {
            let (carrier, ball) = (motion.carrier[s], motion.lower_ball(s));
            on_parts[carrier].0 += pair;
            on_parts[carrier].1 += (ball - motion.bodies[carrier].position).cross(&pair);
        });
        let axial = plate.balance(&on_parts, &arms);
        let mut tau: PerAxis<f64> = each(0.0);
        for (i, tau) in tau.iter_mut().enumerate().take(motion.driven) {
            let [a, b] = [2 * i, 2 * i + 1];
            *tau = -(arms[i] + plate.lever[a] * axial[a] + plate.lever[b] * axial[b]);
        }
        Output { tau, reactions: self.at_both_ends(wrenches, axial.as_slice()) }
    }

    fn on_arms(&self, wrenches: &[Twist; SLOTS]) -> PerLimb<f64> {
        let mut arms: PerLimb<f64> = each(0.0);
        for (limb, effort) in arms.iter_mut().enumerate().take(self.motion.limbs) {
            *effort = self.motion.arm_screw(limb).effort(&wrenches[arm(limb)]);
        }
        arms
    }

    /// Adds the loads on the struts to the `arms` and hands the forces on their lower balls to `below`.
    fn hand_on(&self, wrenches: &[Twist; SLOTS], arms: &mut PerLimb<f64>, mut below: impl FnMut(usize, Vector3<f64>)) {
        let motion = self.motion;
        for s in 0..motion.struts() {
            let (force, moment) = &wrenches[strut(s)];
            let limb = s / 2;
            // ω = u × (v_lower − v_upper)/ℓ: a moment is equivalent to a pair of forces at the ends.
            let pair = moment.cross(&motion.strut_axis[s]) / motion.strut_length[s];
            let lever = motion.bodies[strut(s)].position - motion.bodies[arm(limb)].position;
            let upper = force - pair;
            arms[limb] += motion.arm_screw(limb).effort(&(upper, lever.cross(&upper)));
            below(s, pair);
        }
    }

    fn reduce(&self, wrenches: &[Twist; SLOTS], assembled: bool) -> Reduced {
        let motion = self.motion;
        let mut sum = Reduced { arms: self.on_arms(wrenches), rotor: wrenches[ROTOR].1.z, ..Reduced::default() };
        if !assembled {
            return sum;
        }
        let (mut force, mut moment) = wrenches[PLATFORM];
        let origin = motion.bodies[PLATFORM].position;
        self.hand_on(wrenches, &mut sum.arms, |s, pair| {
            force += pair;
            moment += (motion.lower_ball(s) - origin).cross(&pair);
        });
        (sum.force, sum.moment) = (force, moment);
        self.reduce_chain(wrenches, &mut sum);
        sum
    }

    /// Adds the wrenches of end effector, rotor and both telescope parts.
    fn reduce_chain(&self, wrenches: &[Twist; SLOTS], sum: &mut Reduced) {
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

/// Where the end effector is part of the platform, so are the loads on it.
pub(crate) fn join_end_effector(geometry: &Geometry, motion: &Motion, wrenches: &mut [Twist; SLOTS]) {
    if geometry.has_end_effector() {
        return;
    }
    let lever = motion.bodies[END_EFFECTOR].position - motion.bodies[PLATFORM].position;
    let (force, moment) = std::mem::replace(&mut wrenches[END_EFFECTOR], STILL);
    wrenches[PLATFORM].0 += force;
    wrenches[PLATFORM].1 += moment + lever.cross(&force);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::Plant;
    use crate::dynamics::channels::{ChannelMap, gap_inverse};
    use crate::kinematics::JointState;
    use crate::machine::six_struts;
    use crate::model::testing::irb360;
    use crate::recording::Channel;

    /// Virtual work of random wrenches in the virtual motions of the channels.
    #[test]
    fn is_the_transpose_of_the_channels_twists() {
        let model = irb360();
        let plant = Plant::new(&model, &Default::default());
        let joints = JointState { q: [0.3, 0.5, 0.1, 0.7], qd: [1.0, -2.0, 0.5, 3.0], qdd: [5.0, 3.0, -4.0, 9.0] };
        let motion = plant.motion(&joints).unwrap();
        let mut wrenches = [STILL; SLOTS];
        for (b, (f, m)) in wrenches.iter_mut().enumerate() {
            let wave = |k: usize| (1.7 * (6 * b + k) as f64 + 0.3).sin();
            (*f, *m) = (Vector3::new(wave(0), wave(1), wave(2)), Vector3::new(wave(3), wave(4), wave(5)));
        }
        let channels: Vec<Channel> = Channel::TORQUES
            .into_iter()
            .chain(six_struts().map(Channel::StrutUpper))
            .chain(six_struts().map(Channel::StrutLower))
            .collect();
        for assembled in [true, false] {
            let count = if assembled { channels.len() } else { 4 };
            let map = ChannelMap::new(&plant.geometry, &motion, assembled, &channels[..count]).unwrap();
            let out = Reduction::new(&plant.geometry, &motion, assembled, true).unwrap().balance(&wrenches);
            let values: Vec<f64> = channels.iter().map(|c| out.of(*c)).collect();
            for (c, value) in values.iter().enumerate().take(count) {
                let work: f64 = wrenches.iter().enumerate().map(|(b, (f, m))| map.project(c, b, f, m)).sum();
                approx::assert_relative_eq!(*value, work, epsilon = 1e-12);
            }
        }
    }

    /// The general solution for plates against the two inverses of three limbs.
    #[test]
    fn any_plate_includes_the_platform_of_three_limbs() {
        let plant = Plant::new(&irb360(), &Default::default());
        let joints = JointState { q: [0.3, 0.5, 0.1, 0.7], ..JointState::default() };
        let motion = plant.motion(&joints).unwrap();
        let plate = PlateMotions::new(&plant.geometry, &motion).unwrap();
        let (jacobian, gaps) = (
            plant.geometry.jacobian(&motion.q, &motion.bodies[PLATFORM].position).unwrap(),
            gap_inverse(&motion).unwrap(),
        );
        for s in six_struts() {
            let found = plate.gap(s);
            approx::assert_relative_eq!(
                found.fixed_rows::<6>(0).into_owned(),
                gaps.column(s).into_owned(),
                epsilon = 1e-11
            );
        }
        let rates = plant.geometry.rates_per_drive(&motion).unwrap();
        for limb in 0..3 {
            let expected = jacobian.column(limb).into_owned();
            approx::assert_relative_eq!(rates[limb].position, expected, epsilon = 1e-12);
        }
    }
}
