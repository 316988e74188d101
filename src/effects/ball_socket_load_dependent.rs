//! Ball-socket friction proportional to the strut force.

use super::{
    About, Effect, Instant, MachineView, Parameter, Part, Reads, Role, Spec, Unit, Values, Wrenches, unit_direction,
};

/// Moment −μ·r·|F|·tanh(|ω|/ε)·ω/|ω| (N·m) on the strut at each socket, with F (N) the axial strut force at that end.
pub struct BallSocketLoadDependent;

const FRICTION: usize = 0;
const RADIUS: usize = 1;
const REGULARISATION: usize = 2;

const PARAMETERS: &[Parameter] = &[
    Parameter::new("friction", Unit::One, Role::Linear, 0.15, (0.0, 50.0)),
    Parameter::new("radius", Unit::M, Role::Fixed, 0.0095, (1e-3, 0.1)),
    Parameter::new("regularisation", Unit::RadPerS, Role::Fixed, 0.05, (1e-4, 1.0)),
];

static SPEC: Spec = Spec::new(
    "ball_socket_load_dependent",
    Part::Linkage,
    About {
        summary: "ball-socket friction that grows with the strut force",
        law: "M = −μ·r·|F|·tanh(|ω_rel|/ε)·ω_rel/|ω_rel| on the strut, reaction on arm or platform",
        shows: "arm torques at high strut forces, reversing with the socket rates",
        source: "Coulomb's law at the ball; μ 0.08–0.25 estimated from clamp preload and the paper's \
                  friction increments",
    },
    PARAMETERS,
)
.reads(Reads { reactions: true, ..Reads::MOTION })
.constants(constant);

fn constant(parameter: &str, model: &MachineView) -> Option<f64> {
    match parameter {
        "radius" if model.sockets.ball_radius > 0.0 => Some(model.sockets.ball_radius),
        _ => None,
    }
}

impl Effect for BallSocketLoadDependent {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        let (radius, epsilon) = (values.one(RADIUS), values.one(REGULARISATION));
        for socket in at.closed.iter() {
            let force = match socket.checked_sub(at.motion.struts()) {
                None => at.reactions.upper[socket],
                Some(strut) => at.reactions.lower[strut],
            };
            let rate = at.motion.socket_rate(socket);
            let direction = unit_direction(&rate, epsilon);
            out.socket_moment(values.index(FRICTION, 0), socket, &rate, direction * (-radius * force.abs()));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing;
    use crate::kinematics::Reactions;

    #[test]
    fn moment_is_friction_times_radius_times_force() {
        // Strut 1 turns at 1 rad/s about y against the arm under 100 N: 1 · 0.0095 m · 100 N = 0.95 N·m against it
        // (tanh(1/0.05) = 1), and the platform, at rest, sees the same with its own reaction of 50 N: 0.475 N·m.
        let mut motion = testing::still();
        motion.bodies[crate::machine::bodies::STRUT].angular_velocity.y = 1.0;
        let mut reactions = Reactions::default();
        (reactions.upper[0], reactions.lower[0]) = (100.0, -50.0);
        let w = testing::wrenches(&BallSocketLoadDependent, &motion, &reactions);
        let on_strut: f64 = w.iter().filter(|(_, b, ..)| *b == crate::machine::bodies::STRUT).map(|(.., m)| m.y).sum();
        approx::assert_relative_eq!(on_strut, -(0.95 + 0.475), epsilon = 1e-12);
    }
}
