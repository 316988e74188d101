//! Dimensions and joint limits of the mechanism.
//!
//! Inertial frame: origin on the vertical centre line in the plane of the motor shafts, z up.

use nalgebra::Vector3;

use super::{ARMS, Joint};

/// How the arms of all limbs are driven.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Actuator {
    /// Every arm turns about its shaft, the limb's tangential axis; q is its angle below the horizontal, rad.
    #[default]
    Revolute,
    /// Every arm is a carriage on a straight guide in the vertical plane of its limb; q is its distance from the shaft's
    /// place, m.
    Prismatic {
        /// Angle of the guide below the horizontal, rad; q grows outwards, and downwards along a vertical guide (π/2).
        inclination: f64,
    },
}

impl Actuator {
    /// Joint type of the arms.
    pub fn joint(self) -> Joint {
        match self {
            Self::Revolute => Joint::Revolute,
            Self::Prismatic { .. } => Joint::Prismatic,
        }
    }
}

/// Geometry of a delta robot with telescope; lengths in m, angles in rad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// How the arms are driven.
    pub arms: Actuator,
    /// Distance of the motor shafts, or of the carriages at q = 0, from the centre line.
    pub base_radius: f64,
    /// Distance of the elbow (middle of the ball pair) from the shaft; zero for carriages.
    pub arm_length: f64,
    /// Distance of the two balls of a strut, per limb: both struts of a pair have equal length.
    pub strut_length: [f64; ARMS],
    /// Distance of the middle of a ball pair from the platform centre.
    pub platform_radius: f64,
    /// Distance between the two balls of a pair.
    pub pair_distance: f64,
    /// Height of the mounting plane above the shaft plane.
    pub mounting_height: f64,
    /// Height of the upper Hooke joint above the shaft plane.
    pub upper_hooke_height: f64,
    /// Height of the lower Hooke joint above the platform's ball plane.
    pub lower_hooke_height: f64,
    /// Height of the flange face above the platform's ball plane (negative: below).
    pub flange_height: f64,
    /// Lower and upper limit of the arm angles, or of the carriages' distances in m.
    pub arm_limits: [f64; 2],
    /// Lower and upper limit of the distance between the telescope's Hooke joints; infinite upper limit without a
    /// telescope.
    pub telescope_limits: [f64; 2],
}

impl Geometry {
    /// Whether there is a telescope.
    pub fn has_telescope(&self) -> bool {
        self.telescope_limits[1].is_finite()
    }

    /// Azimuth of limb `i` (from 0), rad.
    pub fn azimuth(i: usize) -> f64 {
        i as f64 * std::f64::consts::TAU / 3.0
    }

    /// Horizontal unit vector from the centre line to the shaft of limb `i` (from 0).
    ///
    /// # Panics
    /// If there is no limb `i`.
    pub fn radial(i: usize) -> Vector3<f64> {
        RADIAL[i].into()
    }

    /// Unit vector along the axis of motor `i` (from 0): horizontal, tangential, `z × radial`.
    ///
    /// # Panics
    /// If there is no motor `i`.
    pub fn tangential(i: usize) -> Vector3<f64> {
        let u = RADIAL[i];
        Vector3::new(-u[1], u[0], 0.0)
    }

    /// Centre of the upper Hooke joint in the inertial frame, m.
    pub fn upper_hooke(&self) -> Vector3<f64> {
        Vector3::new(0.0, 0.0, self.upper_hooke_height)
    }

    /// Offset (m) of `strut` (0..6) from the middle of its pair along the limb's tangential axis.
    pub fn pair_offset(&self, strut: usize) -> f64 {
        if strut.is_multiple_of(2) { 0.5 * self.pair_distance } else { -0.5 * self.pair_distance }
    }
}

const H: f64 = 0.866_025_403_784_438_6; // √3/2
/// Radial unit vectors of the limbs at 0°, 120°, 240°.
const RADIAL: [[f64; 3]; ARMS] = [[1.0, 0.0, 0.0], [-0.5, H, 0.0], [-0.5, -H, 0.0]];
