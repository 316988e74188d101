//! The home pose, q = 0, and whether the struts close the loops there.

use nalgebra::Vector3;

use super::arm::Arm;
use super::{JointState, PlatformState};
use crate::machine::{Geometry, Limb};

/// Pose of the machine at q = 0; heights are measured from the shaft plane, up positive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Home {
    /// Origin of the plate, m.
    pub platform: Vector3<f64>,
    /// Height of the flange, m.
    pub flange: f64,
    /// Distance of the telescope's Hooke joints, m.
    pub telescope: f64,
}

impl Geometry {
    /// The pose at q = 0; `None` if the struts do not reach, or if the drives do not determine the plate there.
    pub fn home(&self) -> Option<Home> {
        let PlatformState { position, .. } = self.forward_motion(&JointState::default()).ok()?;
        let platform = position;
        let flange = platform.z + self.flange_height;
        Some(Home { platform, flange, telescope: self.telescope_length(&platform) })
    }

    /// Largest horizontal distance (m) that a strut of a platform in the middle spans while the arms move together through
    /// their limits.
    pub fn least_strut_length(&self) -> f64 {
        // |R − r + l₁ cos φ| has its maximum at an end of the range or at φ = 0, that of a carriage at an end.
        let span = |limb: &Limb| {
            let pair = self.pair(limb, 0.0).offset;
            let [low, high] = limb.limits;
            [low, 0.0, high].map(|q| (Arm::new(limb, q).elbow - pair).dot(&limb.radial()).abs())
        };
        self.limbs.iter().flat_map(span).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use crate::machine::testing::geometry;

    #[test]
    fn home_pose_is_where_the_cad_has_it() {
        let g = geometry();
        let home = g.home().unwrap();
        approx::assert_abs_diff_eq!(home.telescope, 0.9304, epsilon = 5e-5);
        approx::assert_abs_diff_eq!(home.flange - g.mounting_height, -1.2309, epsilon = 5e-5);
        approx::assert_abs_diff_eq!(home.platform.xy().norm(), 0.0, epsilon = 1e-12);
    }

    #[test]
    fn platform_keeps_the_strut_lengths() {
        let mut g = geometry();
        let lengths = |g: &mut crate::machine::Geometry, l: [f64; 3]| {
            g.limbs.iter_mut().zip(l).for_each(|(limb, l)| limb.strut_length = l);
        };
        lengths(&mut g, [1.106, 1.11, 1.1]);
        let q = [0.3, -0.2, 0.9];
        let p = g.forward(&q).unwrap();
        for (limb, q) in g.limbs.iter().zip(q) {
            let elbow = limb.radial() * (g.limbs[0].base_radius + limb.arm_length * q.cos())
                - nalgebra::Vector3::z() * limb.arm_length * q.sin();
            approx::assert_abs_diff_eq!((p + limb.point - elbow).norm(), limb.strut_length, epsilon = 1e-12);
        }
        assert!(p.z < 0.0);
        lengths(&mut g, [0.6; 3]);
        assert_eq!(g.home(), None);
    }
}
