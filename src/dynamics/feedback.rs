//! What a change of wrenches does to the loads of laws that depend on these loads.
//!
//! The drive torques and strut forces x of a motion satisfy x = P·(w + w_x(x)), with w the wrenches that do not depend on
//! them, w_x those that do and P the projection onto the channels ([`super::channels`]). Thus ∂x = (1 − K)⁻¹·P·∂w with K =
//! P·∂w_x/∂x: of channel c it is the projection by the virtual motion ξ_c + Σ_j r_cj·ξ_j, with r_c = (1 − K)⁻ᵀ·k_c over the
//! loads j that laws read and k_c the row of K of channel c. Internal states are kept.

use nalgebra::DMatrix;

use super::channels::ChannelMap;
use super::inverse::add_effects;
use super::reduction::Reduction;
use super::{Output, Plant};
use crate::kinematics::{KinematicsError, Motion, STILL, Twist};
use crate::machine::bodies::SLOTS;
use crate::recording::Channel;

/// Step of a load for the derivative of the laws, relative to its size or to 1 N·m or N.
const STEP: f64 = 1e-5;

/// Feedback of the laws of a plant through the loads that they read.
pub(crate) struct Feedback {
    /// Virtual motions of the loads that laws read.
    loads: ChannelMap,
}

impl Feedback {
    /// `None` for a plant whose laws depend on the motion alone.
    pub fn of(plant: &Plant) -> Option<Self> {
        let reads = |of: fn(&crate::effects::Reads) -> bool| plant.effects.iter().any(|a| of(&a.effect.spec().reads));
        let mut loads = Vec::new();
        if reads(|reads| reads.torque) {
            loads.extend(Channel::of_drives(plant.mechanism));
        }
        if reads(|reads| reads.reactions) {
            let struts = 0..plant.mechanism.struts();
            loads.extend(struts.flat_map(|s| [Channel::StrutUpper(s), Channel::StrutLower(s)]));
        }
        (!loads.is_empty()).then(|| Self { loads: ChannelMap::without_motion(&loads) })
    }

    /// Adds to the virtual motions of `map`, set at the same motion, those by which its channels follow the loads; `states`
    /// and `loads` are those of the plant at time `t`.
    ///
    /// # Errors
    /// Those of [`ChannelMap::set`] and of [`add_effects`].
    pub fn add_to(
        &mut self,
        map: &mut ChannelMap,
        plant: &Plant,
        (t, motion): (f64, &Motion),
        states: &[&[f64]],
        loads: &Output,
    ) -> Result<(), KinematicsError> {
        let reduction = Reduction::new(&plant.geometry, motion, plant.assembled, true)?;
        let laws = |loads: &Output, sum: &mut [Twist; SLOTS]| add_effects(plant, t, motion, states, Some(loads), sum);
        let mut here = [STILL; SLOTS];
        laws(loads, &mut here)?;
        here.iter_mut().for_each(|(force, moment)| (*force, *moment) = (-*force, -*moment));
        let slope = |channel: &Channel| -> Result<Output, KinematicsError> {
            let step = STEP * loads.of(*channel).abs().max(1.0);
            let (mut moved, mut by) = (*loads, here);
            moved.add(*channel, step);
            laws(&moved, &mut by)?;
            Ok(reduction.balance(&by).scaled(1.0 / step))
        };
        let read = &self.loads.channels;
        let slopes: Vec<Output> = read.iter().map(slope).collect::<Result<_, _>>()?;
        let (n, channels) = (slopes.len(), map.channels.len());
        let open = DMatrix::from_fn(n, n, |i, j| f64::from(i == j) - slopes[i].of(read[j]));
        let mut follows = DMatrix::from_fn(n, channels, |i, c| slopes[i].of(map.channels[c]));
        // Friction that jams leaves the loads undetermined.
        if open.lu().solve_mut(&mut follows) {
            self.loads.set(&plant.geometry, motion, plant.assembled)?;
            for (c, factors) in follows.column_iter().enumerate() {
                map.follow(c, &self.loads, factors.as_slice(), motion.slots());
            }
        }
        Ok(())
    }
}
