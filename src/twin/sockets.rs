//! When ball sockets leave their balls.

use nalgebra::Vector3;

use crate::kinematics::motion::SOCKETS;
use crate::kinematics::{Motion, SocketSet};
use crate::model::STRUTS;

/// What holds the cups on the balls.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clamps {
    /// Force across the cup at which each socket leaves its ball, N; 0..6 at the elbows, 6..12 at the platform.
    pub hold: [f64; SOCKETS],
    /// Whether they leave; else margins are only reported.
    pub armed: bool,
}

impl Clamps {
    /// Healthy clamps that are only watched.
    pub fn watched(hold: f64) -> Self {
        Self { hold: [hold; SOCKETS], armed: false }
    }

    /// What each socket could still take, N: hold − |F⊥|, F⊥ the reaction's part across the cup. Zero once open.
    ///
    /// The cup opens along the strut's y, towards the other strut of the pair; the clamp springs pull along y and every
    /// force across it, tension or compression, pushes the cup off the ball.
    pub fn margins(&self, motion: &Motion, force: &[Vector3<f64>; SOCKETS], closed: SocketSet) -> [f64; SOCKETS] {
        std::array::from_fn(|s| {
            if !closed.contains(s) {
                return 0.0;
            }
            let y = motion.bodies[Motion::socket_bodies(s).0].rotation.column(1);
            let across = force[s] - y * force[s].dot(&y);
            self.hold[s] - across.norm()
        })
    }

    /// A socket has left: its clamp spring falls off, and the other strut of the pair is no longer held at this end.
    pub fn release(&mut self, socket: usize) {
        self.hold[socket] = 0.0;
        self.hold[partner(socket)] = 0.0;
    }
}

/// The socket that shares the clamp spring of `socket`: the other strut of the pair at the same end.
pub fn partner(socket: usize) -> usize {
    let (end, strut) = (socket / STRUTS, socket % STRUTS);
    end * STRUTS + (strut ^ 1)
}

/// Printed name, e.g. `strut 3 upper`.
pub fn socket_name(socket: usize) -> String {
    let end = if socket < STRUTS { "upper" } else { "lower" };
    format!("strut {} {end}", socket % STRUTS + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn force_along_the_clamp_does_not_count() {
        let clamps = Clamps::watched(200.0);
        let motion = crate::effects::testing::still();
        let mut force = [Vector3::zeros(); SOCKETS];
        // y is the cup's axis: 3-4-5 across it.
        force[2] = Vector3::new(30.0, 500.0, -40.0);
        let margins = clamps.margins(&motion, &force, SocketSet::ALL.without(5));
        approx::assert_relative_eq!(margins[2], 150.0, epsilon = 1e-12);
        assert_eq!((margins[0], margins[5]), (200.0, 0.0));
    }

    #[test]
    fn partner_loses_its_hold() {
        let mut clamps = Clamps::watched(200.0);
        clamps.release(7);
        let held: Vec<usize> = (0..SOCKETS).filter(|&s| clamps.hold[s] > 0.0).collect();
        assert_eq!(held, [0, 1, 2, 3, 4, 5, 8, 9, 10, 11]);
    }
}
