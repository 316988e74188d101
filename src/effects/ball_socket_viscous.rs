//! Viscous friction in the ball sockets of the struts.

use super::{About, Effect, Instant, Parameter, Part, Role, Spec, Unit, Values, Wrenches};

/// Moment M = −c·ω_rel on the strut at each of the 12 sockets, with its reaction on the body that carries the ball.
///
/// M in N·m; ω_rel in rad/s is the angular velocity of the strut relative to that body; c in N·m·s/rad, never negative.
/// Dissipates c·|ω_rel|² per socket.
pub struct BallSocketViscous;

const COEFFICIENT: usize = 0;

const PARAMETERS: &[Parameter] = &[Parameter::new("coefficient", Unit::NMSPerRad, Role::Linear, 0.30, (0.0, 10.0))];

static SPEC: Spec = Spec::new(
    "ball_socket_viscous",
    Part::Linkage,
    About {
        summary: "viscous friction in the 12 ball sockets of the struts",
        law: "M = −c·ω_rel on the strut at each socket, reaction on arm or platform",
        shows: "torque in phase with the arm rates that changes with the pose; looks like viscous drive friction",
        source: "Gnad et al. section 6.3.3 (friction of the sockets, not modelled there); 0.30 N·m·s/rad per ball \
                     explains the rise of p_v between the disassembled and the assembled robot (estimate, 0–0.45)",
    },
    PARAMETERS,
);

impl Effect for BallSocketViscous {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        for socket in at.closed.iter() {
            let rate = at.motion.socket_rate(socket);
            out.socket_moment(values.index(COEFFICIENT, 0), socket, &rate, -rate);
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::BallSocketViscous;
    use crate::effects::testing;
    use crate::machine::bodies::{self, PLATFORM};

    #[test]
    fn turning_strut_is_braked_at_both_ends() {
        let mut motion = testing::still();
        motion.bodies[bodies::strut(3)].angular_velocity = Vector3::new(0.0, 2.0, 0.0); // second strut of limb 2
        let total = testing::totals(&BallSocketViscous, &[&[0.3]], &motion);
        approx::assert_relative_eq!(total[bodies::strut(3)].1.y, -1.2, epsilon = 1e-12);
        approx::assert_relative_eq!(total[bodies::arm(1)].1.y, 0.6, epsilon = 1e-12);
        approx::assert_relative_eq!(total[PLATFORM].1.y, 0.6, epsilon = 1e-12);
    }
}
