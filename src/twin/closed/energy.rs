//! Energy of elastic struts.

use super::super::rod;
use super::{Frame, Mechanism};
use crate::dynamics::Plant;
use crate::kinematics::Motion;
use crate::machine::{SixStruts, six_struts};

impl Mechanism {
    /// Energy of stretched struts in excess of rigid ones, J, for velocities linear between their ends.
    pub fn stretch_energy(&self, plant: &Plant, motion: &Motion) -> f64 {
        if self.springs.is_none() {
            return 0.0;
        }
        let rates: SixStruts<f64> = std::array::from_fn(|s| rod::length_rate(motion, s));
        rod::stretch_energy(&self.rods, plant, motion, &rates)
    }

    /// Power of the elastic struts on the bodies, W.
    pub fn spring_power(&self, frame: &Frame) -> f64 {
        let Some(springs) = &self.springs else { return 0.0 };
        six_struts()
            .map(|s| {
                let stretch = frame.motion.strut_length[s] - self.rods[s].length;
                let tension = springs[s].stiffness * stretch + springs[s].damping * frame.length_rate[s];
                -tension * frame.length_rate[s]
            })
            .sum()
    }
}
