//! Dimensions and joint limits of the mechanism, limb by limb.
//!
//! Inertial frame: origin on the vertical centre line in the plane of the motor shafts, z up.

use std::ops::{Deref, DerefMut};

use nalgebra::Vector3;

use super::Joint;
use super::layout::{ARMS, PerLimb, each, three_arms};
use super::plate::Plate;

/// How the arm of a limb moves.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Actuator {
    /// The arm turns about its shaft, the limb's tangential axis; q is its angle below the horizontal, rad.
    #[default]
    Revolute,
    /// The arm is a carriage on a straight guide in the vertical plane of its limb; q is its distance from the shaft's
    /// place, m.
    Prismatic {
        /// Angle of the guide below the horizontal, rad; q grows outwards, and downwards along a vertical guide (π/2).
        inclination: f64,
    },
}

impl Actuator {
    /// Whether the arm turns.
    pub fn is_revolute(self) -> bool {
        self == Self::Revolute
    }

    /// Joint type of the arms.
    pub fn joint(self) -> Joint {
        match self {
            Self::Revolute => Joint::Revolute,
            Self::Prismatic { .. } => Joint::Prismatic,
        }
    }
}

/// One limb: an arm, and a pair of struts from its elbow to the plate; lengths in m, angles in rad.
///
/// Arm and plate carry the pair's balls along the same direction, the limb's tangential axis, at the same distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limb {
    azimuth: f64,
    radial: [f64; 2],
    /// How the arm moves.
    pub actuator: Actuator,
    /// Whether the arm has a drive; a passive arm only follows.
    pub driven: bool,
    /// Distance of the shaft, or of the carriage at q = 0, from the centre line, along the radial axis.
    pub base_radius: f64,
    /// Offset of the shaft's middle along the tangential axis.
    pub base_offset: f64,
    /// Height of the shaft above the origin.
    pub base_height: f64,
    /// Distance of the elbow (middle of the ball pair) from the shaft; zero for carriages.
    pub arm_length: f64,
    /// Distance of the two balls of a strut: the mean of both struts of a pair.
    pub strut_length: f64,
    /// Length of the first strut of the pair (at +`tangential`) minus the second one's.
    pub strut_difference: f64,
    /// Distance between the two balls of a pair.
    pub pair_distance: f64,
    /// Part of the plate that carries the lower ball pair.
    pub part: usize,
    /// Middle of the lower ball pair in the frame of that part.
    pub point: Vector3<f64>,
    /// Lower and upper limit of the arm's angle, or of the carriage's distance in m.
    pub limits: [f64; 2],
}

impl Limb {
    /// A driven limb without dimensions at `azimuth`, rad, anticlockwise from x seen from above.
    pub fn at(azimuth: f64) -> Self {
        Self {
            azimuth,
            radial: direction(azimuth),
            actuator: Actuator::Revolute,
            driven: true,
            base_radius: 0.0,
            base_offset: 0.0,
            base_height: 0.0,
            arm_length: 0.0,
            strut_length: 0.0,
            strut_difference: 0.0,
            pair_distance: 0.0,
            part: 0,
            point: Vector3::zeros(),
            limits: [0.0; 2],
        }
    }

    /// Moves the limb to `azimuth`, rad.
    pub fn turn_to(&mut self, azimuth: f64) {
        (self.azimuth, self.radial) = (azimuth, direction(azimuth));
    }

    /// Azimuth, rad.
    pub fn azimuth(&self) -> f64 {
        self.azimuth
    }

    /// Horizontal unit vector from the centre line to the shaft.
    #[inline]
    pub fn radial(&self) -> Vector3<f64> {
        Vector3::new(self.radial[0], self.radial[1], 0.0)
    }

    /// Unit vector along the motor axis: horizontal, `z × radial`.
    #[inline]
    pub fn tangential(&self) -> Vector3<f64> {
        Vector3::new(-self.radial[1], self.radial[0], 0.0)
    }

    /// Middle of the shaft, or of the carriage at q = 0, in the inertial frame, m.
    #[inline]
    pub fn shaft(&self) -> Vector3<f64> {
        self.radial() * self.base_radius + self.tangential() * self.base_offset + Vector3::z() * self.base_height
    }
}

/// Unit vector at `azimuth` (rad) in the plane; exact in its signs and halves at thirds of a turn.
fn direction(azimuth: f64) -> [f64; 2] {
    const H: f64 = 0.866_025_403_784_438_6; // √3/2
    match three_arms().find(|&i| azimuth == third(i)) {
        Some(0) => [1.0, 0.0],
        Some(1) => [-0.5, H],
        Some(_) => [-0.5, -H],
        None => [azimuth.cos(), azimuth.sin()],
    }
}

/// Azimuth of limb `i` (from 0) of three at equal angles, rad.
pub fn third(i: usize) -> f64 {
    i as f64 * std::f64::consts::TAU / 3.0
}

/// The limbs of a machine in order: the driven ones first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limbs {
    all: PerLimb<Limb>,
    count: usize,
}

impl Limbs {
    /// The given limbs.
    ///
    /// # Panics
    /// If there are more than a [`PerLimb`] holds.
    pub fn new(limbs: &[Limb]) -> Self {
        let mut all: PerLimb<_> = each(Limb::at(0.0));
        all[..limbs.len()].copy_from_slice(limbs);
        Self { all, count: limbs.len() }
    }
}

impl Deref for Limbs {
    type Target = [Limb];
    #[inline]
    fn deref(&self) -> &[Limb] {
        &self.all[..self.count]
    }
}

impl DerefMut for Limbs {
    fn deref_mut(&mut self) -> &mut [Limb] {
        &mut self.all[..self.count]
    }
}

/// Dimensions of three equal limbs at thirds of a turn; lengths in m, limits in rad or m.
#[derive(Clone, Copy, Debug)]
pub struct Delta {
    /// How the arms move.
    pub actuator: Actuator,
    /// See [`Limb::base_radius`].
    pub base_radius: f64,
    /// See [`Limb::arm_length`].
    pub arm_length: f64,
    /// See [`Limb::strut_length`].
    pub strut_length: f64,
    /// Distance of the middle of a ball pair from the platform centre.
    pub platform_radius: f64,
    /// See [`Limb::pair_distance`].
    pub pair_distance: f64,
    /// See [`Limb::limits`].
    pub arm_limits: [f64; 2],
}

/// Geometry of a machine; lengths in m, angles in rad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// The limbs.
    pub limbs: Limbs,
    /// What they carry.
    pub plate: Plate,
    /// Height of the mounting plane above the shaft plane.
    pub mounting_height: f64,
    /// Height of the upper Hooke joint above the shaft plane.
    pub upper_hooke_height: f64,
    /// Height of the lower Hooke joint above the platform's ball plane.
    pub lower_hooke_height: f64,
    /// Height of the flange face above the plane of the plate's origin (negative: below).
    pub flange_height: f64,
    /// Lower and upper limit of the distance between the telescope's Hooke joints; infinite upper limit without a
    /// telescope.
    pub telescope_limits: [f64; 2],
}

impl Geometry {
    /// Geometry of a machine without a telescope, all heights zero.
    pub fn new(limbs: &[Limb], plate: Plate) -> Self {
        Self {
            limbs: Limbs::new(limbs),
            plate,
            mounting_height: 0.0,
            upper_hooke_height: 0.0,
            lower_hooke_height: 0.0,
            flange_height: 0.0,
            telescope_limits: [0.0, f64::INFINITY],
        }
    }

    /// Geometry of a delta robot, all heights zero.
    pub fn delta(lengths: Delta) -> Self {
        let Delta { actuator, base_radius, arm_length, strut_length, platform_radius, pair_distance, arm_limits } =
            lengths;
        let limb = |i: usize| {
            let at = Limb::at(third(i));
            let point = at.radial() * platform_radius;
            Limb { actuator, base_radius, arm_length, strut_length, pair_distance, point, limits: arm_limits, ..at }
        };
        Self::new(&[0, 1, 2].map(limb), Plate::Rigid)
    }

    /// Geometry without dimensions, of a single axis with the given limits (rad or m).
    pub fn single(limits: [f64; 2]) -> Self {
        Self::new(&[0, 1, 2].map(|i| Limb { limits, ..Limb::at(third(i)) }), Plate::Rigid)
    }

    /// Whether the limbs are those of [`Self::delta`], except for the lengths of the struts.
    pub fn is_regular(&self) -> bool {
        let first = &self.limbs[0];
        let radius = first.point.dot(&first.radial());
        let alike = |(i, limb): (usize, &Limb)| {
            let at = Limb::at(third(i));
            let point = at.radial() * radius;
            *limb == Limb { azimuth: at.azimuth, radial: at.radial, point, strut_length: limb.strut_length, ..*first }
        };
        self.has_platform_of_three()
            && first.base_offset == 0.0
            && first.base_height == 0.0
            && self.limbs.iter().enumerate().all(alike)
    }

    /// Whether three driven limbs carry one platform.
    #[inline]
    pub fn has_platform_of_three(&self) -> bool {
        self.limbs.len() == ARMS && !self.plate.turns()
    }

    /// Whether there is a telescope.
    pub fn has_telescope(&self) -> bool {
        self.telescope_limits[1].is_finite()
    }

    /// Whether the end effector moves relative to the platform; otherwise it is part of it.
    pub fn has_end_effector(&self) -> bool {
        self.has_telescope() || self.plate.turns()
    }

    /// How the arms of all limbs move; the inclination of guides is the first limb's.
    pub fn actuator(&self) -> Actuator {
        self.limbs[0].actuator
    }

    /// Lower and upper limit within which every arm stays, rad, or m for carriages.
    pub fn arm_limits(&self) -> [f64; 2] {
        let narrower = |a: [f64; 2], b: [f64; 2]| [a[0].max(b[0]), a[1].min(b[1])];
        self.limbs.iter().map(|limb| limb.limits).reduce(narrower).unwrap_or_default()
    }

    /// Sets the limits of all arms, rad or m.
    pub fn set_arm_limits(&mut self, limits: [f64; 2]) {
        self.limbs.iter_mut().for_each(|limb| limb.limits = limits);
    }

    /// Largest distance of a ball pair's middle from the axis of its part of the plate, m.
    pub fn platform_radius(&self) -> f64 {
        self.limbs.iter().map(|limb| limb.point.xy().norm()).fold(0.0, f64::max)
    }

    /// Centre of the upper Hooke joint in the inertial frame, m.
    pub fn upper_hooke(&self) -> Vector3<f64> {
        Vector3::new(0.0, 0.0, self.upper_hooke_height)
    }

    /// Offset (m) of `strut` from the middle of its pair along the limb's tangential axis.
    pub fn pair_offset(&self, strut: usize) -> f64 {
        let half = 0.5 * self.limbs[strut / 2].pair_distance;
        if strut.is_multiple_of(2) { half } else { -half }
    }

    /// Distance of the two balls of `strut`, m.
    pub fn strut_length(&self, strut: usize) -> f64 {
        let limb = &self.limbs[strut / 2];
        let half = 0.5 * limb.strut_difference;
        limb.strut_length + if strut.is_multiple_of(2) { half } else { -half }
    }

    /// Whether the struts of a pair differ in length, so that the platform of three limbs tilts.
    pub fn has_unequal_pairs(&self) -> bool {
        self.has_platform_of_three() && self.limbs.iter().any(|limb| limb.strut_difference != 0.0)
    }

    /// Upper ball of `strut` in the frame of its arm, m.
    pub fn elbow_ball(&self, strut: usize) -> Vector3<f64> {
        Vector3::new(self.limbs[strut / 2].arm_length, self.pair_offset(strut), 0.0)
    }

    /// Lower ball of `strut` in the frame of the part of the plate that carries it, m.
    pub fn platform_ball(&self, strut: usize) -> Vector3<f64> {
        let limb = &self.limbs[strut / 2];
        limb.point + limb.tangential() * self.pair_offset(strut)
    }
}
