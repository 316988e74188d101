//! Projection of wrenches on bodies onto drive torques and strut forces, by the principle of virtual work.
//!
//! A drive torque does work on its joint angle, an axial strut force on a virtual gap at its socket while the drives
//! are locked. With ξ_c the twists of all bodies per unit of such a virtual motion and w the applied minus the inertial
//! wrenches, τ_c = −Σ ξ_c·w and T_c = +Σ ξ_c·w (tension positive).

use nalgebra::{Matrix4, Matrix6, Matrix6x3, Vector3, Vector6};

use crate::kinematics::{Closed, KinematicsError, Motion, PlateMotions, STILL, Twist};
use crate::machine::bodies::{END_EFFECTOR, PLATFORM, ROTOR, SLOTS, TELESCOPE_LOWER, TELESCOPE_UPPER, arm, strut};
use crate::machine::plate::{MAX_PARTS, PartPlace};
use crate::machine::{Bodies, Geometry, Inertia, PerLimb, each, six_struts};
use crate::recording::Channel;

/// Twists of all bodies per unit of each channel's virtual motion.
pub struct ChannelMap {
    /// Channels in order.
    pub channels: Vec<Channel>,
    twists: Vec<[Twist; SLOTS]>,
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
        let mut map = Self::without_motion(channels);
        map.set(geometry, motion, assembled)?;
        Ok(map)
    }

    /// Projection onto `channels` before it is [`Self::set`]: nothing moves.
    pub(crate) fn without_motion(channels: &[Channel]) -> Self {
        Self { channels: channels.to_vec(), twists: vec![[STILL; SLOTS]; channels.len()] }
    }

    /// Sets the projection at a pose of the machine for which it was set before.
    ///
    /// # Errors
    /// [`KinematicsError::Singular`] if the Jacobian or, with strut forces among the channels, the matrix of the strut
    /// lines is singular.
    pub(crate) fn set(&mut self, geometry: &Geometry, motion: &Motion, assembled: bool) -> Result<(), KinematicsError> {
        let with_struts = !self.channels.iter().all(|c| c.drive().is_some());
        let channels = self.twists.iter_mut().zip(&self.channels);
        if !assembled {
            for (xi, &channel) in channels {
                let (arms, rotor) = drives(channel, motion.limbs);
                set_drives(xi, motion, &arms, rotor);
            }
            return Ok(());
        }
        if geometry.has_platform_of_three() {
            let three = Three::new(geometry, motion, with_struts)?;
            channels.for_each(|(xi, channel)| three.set_twists(motion, *channel, xi));
        } else {
            let plate = AnyPlate::new(geometry, motion, with_struts)?;
            channels.for_each(|(xi, channel)| plate.set_twists(motion, *channel, xi));
        }
        let lever = motion.bodies[END_EFFECTOR].position - motion.bodies[PLATFORM].position;
        for (xi, &channel) in self.twists.iter_mut().zip(&self.channels) {
            if !geometry.has_end_effector() {
                let (v, omega) = xi[PLATFORM];
                xi[END_EFFECTOR] = (v + omega.cross(&lever), omega);
            }
            if let Channel::StrutUpper(s) = channel {
                xi[strut(s)].0 += motion.strut_axis[s];
            }
        }
        Ok(())
    }

    /// Adds to the virtual motion of channel number `c` those of `others`, so that its projection becomes the sum with
    /// `factors` times theirs; nothing acts on the bodies from `bodies` on.
    pub(crate) fn follow(&mut self, c: usize, others: &Self, factors: &[f64], bodies: usize) {
        let sign = |channel: &Channel| if channel.drive().is_some() { -1.0 } else { 1.0 };
        let own = sign(&self.channels[c]);
        for ((twists, other), factor) in others.twists.iter().zip(&others.channels).zip(factors) {
            let factor = own * sign(other) * factor;
            for (twist, other) in self.twists[c][..bodies].iter_mut().zip(twists) {
                twist.0 += other.0 * factor;
                twist.1 += other.1 * factor;
            }
        }
    }

    /// Adds to a motion without accelerations those of the bodies at the given second derivatives of the channels' coordinates.
    pub(crate) fn accelerate(&self, motion: &mut Motion, rates: &[f64]) {
        let bodies = motion.slots();
        for (twists, rate) in self.twists.iter().zip(rates) {
            for (body, (linear, angular)) in motion.bodies[..bodies].iter_mut().zip(twists) {
                body.acceleration += linear * *rate;
                body.angular_acceleration += angular * *rate;
            }
        }
    }

    /// Inertia of all bodies on the channels' virtual motions, Σ ξᵀ M ξ: of drives their mass matrix, kg·m² or kg.
    ///
    /// # Panics
    /// If there are more than four channels.
    pub(crate) fn mass(&self, bodies: &Bodies, motion: &Motion) -> Matrix4<f64> {
        let mut out = Matrix4::zeros();
        for (body, inertia) in bodies.0.iter().enumerate().filter(|(_, inertia)| **inertia != Inertia::ZERO) {
            let rotation = &motion.bodies[body].rotation;
            let mut own = [STILL; 4];
            for (d, twists) in self.twists.iter().enumerate().filter(|(_, twists)| twists[body] != STILL) {
                let (v, omega) = (rotation.tr_mul(&twists[body].0), rotation.tr_mul(&twists[body].1));
                own[d] = (v, omega);
                let linear = v * inertia.mass + omega.cross(&inertia.first_moment);
                let angular = inertia.first_moment.cross(&v) + inertia.tensor * omega;
                for (c, (v, omega)) in own[..=d].iter().enumerate() {
                    out[(c, d)] += v.dot(&linear) + omega.dot(&angular);
                }
            }
        }
        out.fill_lower_triangle_with_upper_triangle();
        out
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

/// Rates of the arms and of the rotor in the virtual motion of a channel.
fn drives(channel: Channel, limbs: usize) -> (PerLimb<f64>, f64) {
    let mut arms: PerLimb<f64> = each(0.0);
    match channel {
        Channel::Torque(axis) if axis < limbs => arms[axis] = 1.0,
        Channel::Torque(_) => return (arms, 1.0),
        _ => {}
    }
    (arms, 0.0)
}

/// Platform twists of three limbs: per arm rate, and per unit gap.
pub(super) struct Three {
    /// Per arm rate, m/rad and 1, or 1 and 1/m.
    pub jacobian: Matrix6x3<f64>,
    /// Per unit gap at each strut; `None` if strut forces are not requested.
    pub gaps: Option<Matrix6<f64>>,
}

impl Three {
    /// Twists at a pose, those of gaps if `with_struts`.
    ///
    /// # Errors
    /// [`KinematicsError::Singular`] if the Jacobian or the matrix of the strut lines is singular.
    pub fn new(geometry: &Geometry, motion: &Motion, with_struts: bool) -> Result<Self, KinematicsError> {
        let mut jacobian = Matrix6x3::zeros();
        if geometry.has_unequal_pairs() {
            let gaps = gap_inverse(motion)?;
            for s in six_struts() {
                let mut column = jacobian.column_mut(s / 2);
                column += gaps.column(s) * motion.upper_rate(s);
            }
            return Ok(Self { jacobian, gaps: with_struts.then_some(gaps) });
        }
        let translation = geometry.jacobian_along(motion)?;
        jacobian.fixed_rows_mut::<3>(0).copy_from(&translation);
        Ok(Self { jacobian, gaps: if with_struts { Some(gap_inverse(motion)?) } else { None } })
    }

    fn set_twists(&self, motion: &Motion, channel: Channel, xi: &mut [Twist; SLOTS]) {
        let (arms, rotor) = drives(channel, motion.limbs);
        let platform = match (channel, &self.gaps) {
            (Channel::Torque(axis), _) if axis < motion.limbs => twist(self.jacobian.column(axis).into_owned()),
            (Channel::StrutUpper(s) | Channel::StrutLower(s), Some(gaps)) => twist(gaps.column(s).into_owned()),
            _ => STILL,
        };
        spread(xi, motion, &arms, rotor, &platform);
    }
}

fn twist(column: Vector6<f64>) -> Twist {
    (column.fixed_rows::<3>(0).into_owned(), column.fixed_rows::<3>(3).into_owned())
}

/// Virtual motions of any plate: per arm rate, and per unit gap.
struct AnyPlate {
    rates: PerLimb<Closed>,
    parts: [PartPlace; MAX_PARTS],
    bodies: &'static [usize],
    gaps: Option<Box<PlateMotions>>,
}

impl AnyPlate {
    fn new(geometry: &Geometry, motion: &Motion, with_struts: bool) -> Result<Self, KinematicsError> {
        let psi = motion.plate_angle();
        Ok(Self {
            rates: geometry.rates_per_drive(motion)?,
            parts: std::array::from_fn(|k| geometry.plate.part(k).at(psi)),
            bodies: geometry.plate.bodies(),
            gaps: if with_struts { Some(Box::new(PlateMotions::new(geometry, motion)?)) } else { None },
        })
    }

    fn set_twists(&self, motion: &Motion, channel: Channel, xi: &mut [Twist; SLOTS]) {
        let (mut arms, rotor) = drives(channel, motion.driven);
        match (channel, &self.gaps) {
            (Channel::Torque(axis), _) if axis < motion.driven => {
                let Closed { position: velocity, psi, passive } = self.rates[axis];
                arms[motion.driven..motion.limbs].fill(passive);
                for (&body, part) in self.bodies.iter().zip(&self.parts) {
                    xi[body] = (velocity + part.slope * psi, Vector3::z() * (part.turning * psi));
                }
            }
            (Channel::StrutUpper(s) | Channel::StrutLower(s), Some(gaps)) => gaps.spread(&gaps.gap(s), &mut arms, xi),
            _ => self.bodies.iter().for_each(|&body| xi[body] = STILL),
        }
        set_drives(xi, motion, &arms, rotor);
        spread_struts(motion, xi);
    }
}

/// [`Motion::gap_twists`].
///
/// # Errors
/// [`KinematicsError::Singular`] where there are none.
pub(super) fn gap_inverse(motion: &Motion) -> Result<Matrix6<f64>, KinematicsError> {
    motion.gap_twists().ok_or_else(|| KinematicsError::Singular { q: motion.q[..motion.limbs].into() })
}

fn set_drives(xi: &mut [Twist; SLOTS], motion: &Motion, arms: &PerLimb<f64>, rotor: f64) {
    for (limb, rate) in arms.iter().enumerate().take(motion.limbs) {
        let screw = motion.arm_screw(limb);
        xi[arm(limb)] = (screw.linear * *rate, screw.angular * *rate);
    }
    xi[ROTOR].1 = Vector3::z() * rotor;
}

/// Sets the twists of all bodies of three limbs for given arm rates, rotor rate and platform twist; struts do not spin.
fn spread(xi: &mut [Twist; SLOTS], motion: &Motion, arms: &PerLimb<f64>, rotor: f64, platform: &Twist) {
    set_drives(xi, motion, arms, rotor);
    xi[PLATFORM] = *platform;
    spread_struts(motion, xi);
    for (k, twist) in spread_chain(motion, rotor, platform).into_iter().enumerate() {
        xi[END_EFFECTOR + k] = twist;
    }
}

/// Sets the twists of the struts from those of their ends; they do not spin.
fn spread_struts(motion: &Motion, xi: &mut [Twist; SLOTS]) {
    for s in 0..motion.struts() {
        let (body, arm, carrier) = (&motion.bodies[strut(s)], arm(s / 2), motion.carrier[s]);
        let upper = xi[arm].0 + xi[arm].1.cross(&(body.position - motion.bodies[arm].position));
        let lower = xi[carrier].0 + xi[carrier].1.cross(&(motion.lower_ball(s) - motion.bodies[carrier].position));
        let axis = &motion.strut_axis[s];
        xi[strut(s)] = (upper, axis.cross(&(lower - upper)) / motion.strut_length[s]);
    }
}

/// Number of bodies of the chain from the end effector to the lower part of the telescope.
const CHAIN: usize = TELESCOPE_LOWER + 1 - END_EFFECTOR;

/// Twists of end effector, rotor, upper and lower telescope part for a rotor rate and a platform twist.
pub(crate) fn spread_chain(motion: &Motion, rotor: f64, platform: &Twist) -> [Twist; CHAIN] {
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
    let mut xi = [STILL; CHAIN];
    xi[0] = (at_platform(END_EFFECTOR), omega + pivot * relative);
    xi[ROTOR - END_EFFECTOR] = (Vector3::zeros(), rotor_omega);
    xi[TELESCOPE_UPPER - END_EFFECTOR] = (Vector3::zeros(), telescope_omega);
    xi[TELESCOPE_LOWER - END_EFFECTOR] = (lower_hooke, telescope_omega);
    xi
}
