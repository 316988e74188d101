//! Coulomb friction in the ball sockets of the struts under constant preload of the clamp springs.

use super::{About, Effect, Instant, Parameter, Part, Role, Spec, Unit, Values, Wrenches, unit_direction};

/// Moment M = −m·tanh(|ω|/ε)·ω/|ω| on the strut at each of the 12 sockets, with its reaction on the body that carries
/// the ball.
///
/// M in N·m; ω in rad/s is the angular velocity of the strut relative to that body. m = μ·r·P in N·m with the ball
/// radius r and the clamp force P, never negative; ε in rad/s. For |ω| → 0 the law becomes −m·ω/ε. Dissipates
/// m·|ω|·tanh(|ω|/ε) per socket.
pub struct BallSocketCoulomb;

const MOMENT: usize = 0;
const REGULARISATION: usize = 1;

const PARAMETERS: &[Parameter] = &[
    Parameter::new("moment", Unit::NM, Role::Linear, 0.285, (0.0, 10.0)),
    Parameter::new("regularisation", Unit::RadPerS, Role::Fixed, 0.05, (1e-4, 10.0)),
];

static SPEC: Spec = Spec::new(
    "ball_socket_coulomb",
    Part::Linkage,
    About {
        summary: "Coulomb friction in the 12 ball sockets of the struts",
        law: "M = −m·tanh(|ω_rel|/ε)·ω_rel/|ω_rel| on the strut at each socket, reaction on arm or platform",
        shows: "torque that follows the direction of the motion and changes with the pose; \
                    looks mostly like viscous drive friction",
        source: "Gnad et al. section 6.3.3 (friction of the sockets, not modelled there); m = μ·r·P with μ 0.15, \
                     r 9.5 mm, P 200 N (estimate)",
    },
    PARAMETERS,
);

impl Effect for BallSocketCoulomb {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        let epsilon = values.one(REGULARISATION);
        for socket in at.closed.iter() {
            let rate = at.motion.socket_rate(socket);
            out.socket_moment(values.index(MOMENT, 0), socket, &rate, -unit_direction(&rate, epsilon));
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::BallSocketCoulomb;
    use crate::effects::testing;
    use crate::effects::unit_direction;
    use crate::machine::bodies::{ARM, STRUT};

    #[test]
    fn moment_saturates_and_opposes_the_motion() {
        let mut motion = testing::still();
        motion.bodies[STRUT].angular_velocity = Vector3::new(3.0, 0.0, 4.0);
        let total = testing::totals(&BallSocketCoulomb, &[&[0.25], &[0.05]], &motion);
        approx::assert_relative_eq!(total[STRUT].1, Vector3::new(-0.3, 0.0, -0.4), epsilon = 1e-12);
        approx::assert_relative_eq!(total[ARM].1, Vector3::new(0.15, 0.0, 0.2), epsilon = 1e-12);
    }

    #[test]
    fn direction_is_smooth_through_rest() {
        assert_eq!(unit_direction(&Vector3::zeros(), 0.05), Vector3::zeros());
        let tiny = unit_direction(&Vector3::new(1e-12, 0.0, 0.0), 0.05).x;
        approx::assert_relative_eq!(tiny, 2e-11, max_relative = 1e-12);
    }
}
