//! Detection of laws with values that are not finite.

use std::borrow::Cow;

use super::{ActiveEffect, Instant, Wrenches};
use crate::kinematics::{KinematicsError, LawFault};

impl ActiveEffect {
    /// Error that names the first term whose force or moment is not finite at an instant; `None` if all are finite.
    ///
    /// `along` evaluates the law along a given motion, see
    /// [`Effect::wrenches_along`](crate::effects::Effect::wrenches_along).
    pub fn fault(&self, at: &Instant, along: bool) -> Option<KinematicsError> {
        let mut first = None;
        let mut look = |k: usize, _: usize, force: nalgebra::Vector3<f64>, moment: nalgebra::Vector3<f64>| {
            let sum = force.sum() + moment.sum();
            if first.is_none() && !(sum * self.values[k]).is_finite() {
                first = Some((k, sum));
            }
        };
        let mut out = Wrenches::new(at.motion, &mut look);
        if along {
            self.effect.wrenches_along(&self.values(), at, &mut out);
        } else {
            self.effect.wrenches(&self.values(), at, &mut out);
        }
        let (k, value) = first?;
        let block = self.layout.starts.partition_point(|start| *start <= k).saturating_sub(1);
        let term = self.effect.parameters().get(block).map_or(Cow::Borrowed(""), |p| p.name.clone());
        let (q, qd) = (at.motion.q, at.motion.qd);
        let fault = LawFault { effect: self.effect.name(), term, value, sample: None, t: at.t, q, qd };
        Some(KinematicsError::Law(Box::new(fault)))
    }
}
