//! Zero offset of the encoders.

use super::{About, Count, Effect, Kind, Parameter, Part, Role, Sensor, Spec, Unit, Values};
use crate::kinematics::JointState;
use crate::machine::PerAxis;

/// Encoder reading q_i + o_i of axis i.
///
/// o in rad, either sign; positive if the reading is too large. The controller of the twin uses the same reading.
/// Identification shifts the recorded motion by −o.
pub struct JointZeroOffset;

const PARAMETERS: &[Parameter] =
    &[Parameter::new("offset", Unit::Rad, Role::Linear, 0.002, (-0.2, 0.2)).counted(Count::PerAxis)];

static SPEC: Spec = Spec::new(
    "joint_zero_offset",
    Part::Drives,
    About {
        summary: "an encoder's zero is not the joint's",
        law: "q_reported,i = q_i + o_i",
        shows: "torque of the arms that changes with the pose, platform beside its stated position; \
                  none of axis 4 without lateral payload",
        source: "0.05° typical, 0.2° at worst (estimate)",
    },
    PARAMETERS,
)
.kind(Kind::Encoder);

impl Effect for JointZeroOffset {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn sensor(&self) -> Option<&dyn Sensor> {
        Some(self)
    }
}

impl Sensor for JointZeroOffset {
    fn encoder(&self, values: &Values, _state: &[f64], angles: &mut PerAxis<f64>) {
        for (angle, offset) in angles.iter_mut().zip(values.block(0)) {
            *angle += offset;
        }
    }

    fn joint(&self, values: &Values, motion: &mut JointState) {
        for (angle, offset) in motion.q.iter_mut().zip(values.block(0)) {
            *angle -= offset;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::ActiveEffect;

    #[test]
    fn reading_is_angle_plus_offset() {
        let active = ActiveEffect::new(Arc::new(JointZeroOffset), &[&[0.001, -0.002, 0.0, 0.01]]);
        let mut angles = [0.5, 0.5, 0.5, 3.0];
        JointZeroOffset.encoder(&active.values(), &[], &mut angles);
        approx::assert_relative_eq!(angles.as_slice(), [0.501, 0.498, 0.5, 3.01].as_slice());
        let mut motion = JointState { q: angles, qd: [1.0; 4], qdd: [2.0; 4] };
        active.joint(&mut motion);
        approx::assert_relative_eq!(motion.q.as_slice(), [0.5, 0.5, 0.5, 3.0].as_slice());
        assert_eq!((motion.qd, motion.qdd), ([1.0; 4], [2.0; 4]));
    }
}
