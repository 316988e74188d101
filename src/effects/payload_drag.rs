//! Aerodynamic drag on the payload.

use super::{About, Effect, Instant, Parameter, Part, Role, Spec, Unit, Values, Wrenches};
use crate::machine::bodies::END_EFFECTOR;

/// Quadratic drag F = −c·a·|v|·v at the payload's centre of mass, with its moment about the flange.
///
/// F in N, v the velocity of that centre in m/s, c in N·s²/m². For a box, a is its projected area against v over the
/// mean of all directions ([`Payload::area_share`](crate::machine::Payload::area_share)), and c belongs to that mean;
/// for another payload a = 1. The payload is the one stated for the run; without
/// payload there is no drag. Dissipates c·|v|³.
pub struct PayloadDrag;

const PARAMETERS: &[Parameter] = &[Parameter::new("coefficient", Unit::NS2PerM2, Role::Linear, 0.1, (0.0, 50.0))];

static SPEC: Spec = Spec::new(
    "payload_drag",
    Part::Linkage,
    About {
        summary: "drag of the air on the payload",
        law: "F = −c·a·|v|·v at the payload's centre of mass; a: a box's area against v over its mean, otherwise 1",
        shows: "torque of all arms against the payload's velocity, growing with its square; with the payload beside \
                the flange also of axis 4",
        source: "turbulent drag ½·ρ·c_w·A; a box of 0.4 × 0.3 m has 0.08 N/(m/s)² (c_w = 1.1)",
    },
    PARAMETERS,
);

impl Effect for PayloadDrag {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        if at.payload.mass <= 0.0 {
            return;
        }
        let flange = &at.motion.bodies[END_EFFECTOR];
        let lever = flange.rotation * at.payload.com;
        let v = flange.velocity + flange.angular_velocity.cross(&lever);
        let speed = v.norm();
        let against = flange.rotation.tr_mul(&v) / speed.max(f64::MIN_POSITIVE);
        let force = -v * (speed * at.payload.area_share(&against));
        out.wrench(values.index(0, 0), END_EFFECTOR, force, lever.cross(&force));
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::effects::testing;
    use crate::machine::Payload;

    #[test]
    fn a_box_has_less_drag_with_its_small_face_ahead() {
        // 0.2 × 0.4 × 0.5 m at 2 m/s along x, then turned by 90°: faces of 0.2 and 0.1 m² against a mean of 0.19 m²,
        // 0.1·4·0.2/0.19 and 0.1·4·0.1/0.19 N.
        let mut motion = testing::still();
        motion.bodies[END_EFFECTOR].velocity.x = 2.0;
        let payload = Payload::cuboid(1.0, [0.2, 0.4, 0.5], [0.0, 0.0, 0.25]);
        for (turn, face) in [(0.0, 0.2), (std::f64::consts::FRAC_PI_2, 0.1)] {
            let rotation = nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), turn);
            motion.bodies[END_EFFECTOR].rotation = rotation.into_inner();
            let (force, moment) = testing::carrying(&PayloadDrag, &[&[0.1]], &motion, payload)[END_EFFECTOR];
            approx::assert_relative_eq!(force, Vector3::x() * (-0.4 * face / 0.19), epsilon = 1e-12);
            // Its centre is 0.25 m below the flange.
            approx::assert_relative_eq!(moment, Vector3::y() * (0.25 * 0.4 * face / 0.19), epsilon = 1e-12);
        }
    }

    #[test]
    fn a_box_beside_the_flange() {
        // 0.2 m along x from the flange that moves at 3 m/s along y and turns at 10 rad/s about z: 5 m/s along y, 0.1·5² =
        // 2.5 N against it, with −0.5 N·m about z.
        let mut motion = testing::still();
        motion.bodies[END_EFFECTOR].velocity.y = 3.0;
        motion.bodies[END_EFFECTOR].angular_velocity.z = 10.0;
        let payload = Payload::new(1.0, [0.2, 0.0, 0.0], 0.0);
        let (force, moment) = testing::carrying(&PayloadDrag, &[&[0.1]], &motion, payload)[END_EFFECTOR];
        approx::assert_relative_eq!(force, Vector3::new(0.0, -2.5, 0.0), epsilon = 1e-12);
        approx::assert_relative_eq!(moment, Vector3::new(0.0, 0.0, -0.5), epsilon = 1e-12);
        let nothing = testing::carrying(&PayloadDrag, &[&[0.1]], &motion, Payload::default());
        assert!(nothing.iter().all(|(f, m)| f.norm() + m.norm() == 0.0));
    }
}
