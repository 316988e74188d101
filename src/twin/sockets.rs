//! Dislocation of ball sockets.
//!
//! A cup is a spherical shell pressed on its ball by the clamp unit, which pulls it towards the other strut of the pair
//! with the preload P. Let n be the unit vector along the cup's opening, perpendicular to the strut and towards the
//! other strut, and F the force of the ball on the cup due to the load. The clamp adds −P·d with d its direction, so
//! that the total force of the ball on the cup is
//!
//! C = F − P·d, N.
//!
//! The contact is unilateral: the ball pushes from its centre towards the shell. The shell covers the ball up to an
//! angle α from −n. A direction of C within that cone is supported by the shell; beyond it the rim slides over the
//! ball. The socket holds while
//!
//! |C⊥| ≤ tan α·(−C·n), C⊥ = C − (C·n)·n.
//!
//! With d = n that is |F⊥| ≤ tan α·(P − Q) with the pull Q = F·n along the opening: Q reduces the hold force, and opens
//! the cup by itself once it reaches the preload; a negative Q seats the cup more firmly. At Q = 0 the hold force is
//! tan α·P, the dislocation force of the model file; friction at the rim is included in α.

use nalgebra::Vector3;

use crate::dynamics::{Output, Plant, SocketLoads, steady_socket_loads};
use crate::kinematics::{KinematicsError, Motion, SocketSet};
use crate::machine::bodies::strut;
use crate::machine::{PerSocket, Sockets, each};

/// Clamps of the cups: one per strut at the elbows, then one per strut at the plate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clamps {
    /// Lateral force at which each socket dislocates under zero load along the opening, N: tan α·P.
    pub hold: PerSocket<f64>,
    /// Preload P of each cup on its ball, N.
    pub preload: PerSocket<f64>,
    /// Share of the clamp's own lateral force that counts against the hold force, see [`Sockets::clamp_share`].
    pub share: f64,
    /// Whether sockets dislocate; otherwise margins are only reported.
    pub armed: bool,
}

/// Components of the total force of the ball on a cup, clamp included, N.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CupLoad {
    /// |C⊥|, lateral to the opening.
    pub across: f64,
    /// Force along the opening in addition to the clamp's, N; positive opens the cup, negative seats it.
    pub pull: f64,
}

impl Clamps {
    /// Healthy clamps of a machine, not armed.
    pub fn watched(sockets: &Sockets) -> Self {
        Self {
            hold: each(sockets.dislocation_force),
            preload: each(sockets.preload),
            share: sockets.clamp_share,
            armed: false,
        }
    }

    /// Clamps of a machine without struts, with infinite hold force.
    pub fn none() -> Self {
        Self { hold: each(f64::INFINITY), preload: each(f64::INFINITY), share: 0.0, armed: false }
    }

    /// Remaining lateral force margin of each socket, N: tan α·(−C·n) − |C⊥|; zero once open, and the hold where there is none.
    ///
    /// `force` is that of the ball on the strut's cup without the clamps' own, inertial axes, N.
    pub fn margins(&self, motion: &Motion, force: &PerSocket<Vector3<f64>>, closed: SocketSet) -> PerSocket<f64> {
        std::array::from_fn(|s| {
            if s >= 2 * motion.struts() {
                return self.hold[s];
            }
            if !closed.contains(s) {
                return 0.0;
            }
            let load = self.load(motion, &force[s], s);
            if self.preload[s] > 0.0 {
                self.hold[s] * (1.0 - load.pull / self.preload[s]) - load.across
            } else {
                // Without preload, any load that does not seat the cup removes it.
                -load.across - load.pull.max(0.0)
            }
        })
    }

    /// Drive torques and strut forces of an assembled robot along a known motion, and the margins of its closed sockets,
    /// N.
    ///
    /// # Errors
    /// Those of [`steady_socket_loads`].
    pub fn along(&self, plant: &Plant, t: f64, motion: &Motion) -> Result<(Output, PerSocket<f64>), KinematicsError> {
        let SocketLoads { output, sockets } = steady_socket_loads(plant, t, motion)?;
        Ok((output, self.margins(motion, &sockets, plant.sockets())))
    }

    /// Share of its hold that each socket uses where `margins` (N) are left, 1 at the limit; 1 without hold, 0 with an
    /// infinite one.
    pub fn used(&self, margins: &[f64]) -> PerSocket<f64> {
        std::array::from_fn(|s| match (self.hold[s], margins.get(s)) {
            (f64::INFINITY, _) | (_, None) => 0.0,
            (hold, Some(margin)) if hold > 0.0 => 1.0 - margin / hold,
            _ => 1.0,
        })
    }

    /// Load on the cup of socket `s` for the force of the ball on the strut, N, inertial axes.
    ///
    /// The clamp force acts along the pair, from ball to ball; `share` of its deviation from n is taken into account.
    pub fn load(&self, motion: &Motion, force: &Vector3<f64>, s: usize) -> CupLoad {
        let opening = opening(motion, s);
        let across = |f: &Vector3<f64>| f - opening * f.dot(&opening);
        let (mut off, mut pull) = (across(force), force.dot(&opening));
        if self.share > 0.0 {
            let pair = ball(motion, partner(s)) - ball(motion, s);
            let clamp = pair * (self.share * self.preload[s] / pair.norm());
            off -= across(&clamp);
            pull += self.share * self.preload[s] - clamp.dot(&opening);
        }
        CupLoad { across: off.norm(), pull }
    }

    /// Removes the clamp force at `socket` and at its partner, the other strut of the pair at the same end, after a
    /// dislocation.
    ///
    /// # Panics
    /// If there is no `socket`.
    pub fn release(&mut self, socket: usize) {
        for s in [socket, partner(socket)] {
            (self.hold[s], self.preload[s]) = (0.0, 0.0);
        }
    }
}

/// Unit vector along the opening of a cup, inertial axes: ∓y of the strut, towards the other strut of the pair.
///
/// The first strut of a pair is at +v, so that its cups open along −y.
fn opening(motion: &Motion, socket: usize) -> Vector3<f64> {
    let (s, _) = motion.strut_of(socket);
    motion.bodies[strut(s)].rotation.column(1) * if s.is_multiple_of(2) { -1.0 } else { 1.0 }
}

/// Centre of the ball of a socket in the inertial frame, m.
fn ball(motion: &Motion, socket: usize) -> Vector3<f64> {
    let (s, along) = motion.strut_of(socket);
    motion.bodies[strut(s)].position + motion.strut_axis[s] * along
}

/// The socket that shares the clamp spring of `socket`: the other strut of the pair at the same end.
pub fn partner(socket: usize) -> usize {
    socket ^ 1
}

/// Printed name of a socket of a machine with this number of struts, e.g. `strut 3 upper`.
pub fn socket_name(socket: usize, struts: usize) -> String {
    let end = if socket < struts { "upper" } else { "lower" };
    format!("strut {} {end}", socket % struts.max(1) + 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing;

    const SOCKETS_OF_A_MODEL: Sockets =
        Sockets { ball_radius: 0.0095, preload: 100.0, dislocation_force: 200.0, clamp_share: 0.0, spin_damping: 0.0 };

    fn margin(clamps: &Clamps, motion: &Motion, socket: usize, force: [f64; 3]) -> f64 {
        let mut all: PerSocket<Vector3<f64>> = each(Vector3::zeros());
        all[socket] = force.into();
        clamps.margins(motion, &all, SocketSet::ALL)[socket]
    }

    #[test]
    fn a_pull_along_the_opening_lowers_the_hold_and_opens_the_cup_above_the_preload() {
        let clamps = Clamps::watched(&SOCKETS_OF_A_MODEL);
        let motion = testing::still();
        // tan α = 200/100 = 2; 3-4-5 across the cup: 50 N. Strut 3 is the first of its pair, its cup opens along −y.
        let off = |y: f64| margin(&clamps, &motion, 2, [30.0, y, -40.0]);
        approx::assert_relative_eq!(off(0.0), 150.0, epsilon = 1e-12);
        // A pull of 60 N leaves 40 of 100 N preload: 2·40 − 50 = 30; seating with 60 N: 2·160 − 50 = 270.
        approx::assert_relative_eq!(off(-60.0), 30.0, epsilon = 1e-12);
        approx::assert_relative_eq!(off(60.0), 270.0, epsilon = 1e-12);
        // Pull alone: the cup opens between 99.9 N and 100.1 N.
        let alone = |y: f64| margin(&clamps, &motion, 2, [0.0, y, 0.0]);
        assert!(alone(-99.9) > 0.0 && alone(-100.1) < 0.0 && alone(1e4) > 0.0);
        // The other strut of the pair, and its lower end, open along +y.
        for socket in [3, 9] {
            approx::assert_relative_eq!(margin(&clamps, &motion, socket, [0.0, 60.0, 50.0]), 30.0, epsilon = 1e-12);
        }
    }

    #[test]
    fn an_open_socket_has_no_margin() {
        let clamps = Clamps::watched(&SOCKETS_OF_A_MODEL);
        let margins = clamps.margins(&testing::still(), &each(Vector3::zeros()), SocketSet::ALL.without(5));
        assert_eq!((margins[0], margins[5]), (200.0, 0.0));
    }

    #[test]
    fn a_sheared_pair_spends_a_part_of_its_clamps_on_the_struts_length() {
        // A pair sheared by 30°: balls 100 mm apart along v, struts at 60° to v. Per newton of clamp force, cos 30°
        // presses the cup on its ball and sin 30° acts along the strut.
        let mut motion = testing::still();
        let (sin, cos) = 30f64.to_radians().sin_cos();
        for (s, side) in [(0, 0.05), (1, -0.05)] {
            let x = Vector3::new(cos, sin, 0.0);
            let y = Vector3::new(-sin, cos, 0.0);
            let strut = &mut motion.bodies[strut(s)];
            strut.position = Vector3::new(0.0, side, 0.0);
            strut.rotation = nalgebra::Matrix3::from_columns(&[x, y, Vector3::z()]);
            (motion.strut_axis[s], motion.strut_length[s]) = (x, 1.106);
        }
        let gross = Clamps { share: 1.0, ..Clamps::watched(&SOCKETS_OF_A_MODEL) };
        for socket in [0, 1, 6, 7] {
            // 2·100·cos 30° − 100·sin 30° = 173.205 − 50 N.
            approx::assert_relative_eq!(margin(&gross, &motion, socket, [0.0; 3]), 123.205_080_757, epsilon = 1e-8);
            let net = Clamps { share: 0.0, ..gross };
            approx::assert_relative_eq!(margin(&net, &motion, socket, [0.0; 3]), 200.0, epsilon = 1e-9);
        }
        // The clamp needs 50 N along +x at the first strut's cup and along −x at the second's; 20 N of tension pull the
        // upper end of a strut along −x: 173.205 − 30 and 173.205 − 70 N.
        let tension = Vector3::new(cos, sin, 0.0) * -20.0;
        for (socket, expected) in [(0, 143.205_080_757), (1, 103.205_080_757)] {
            approx::assert_relative_eq!(margin(&gross, &motion, socket, tension.into()), expected, epsilon = 1e-8);
        }
    }

    #[test]
    fn partner_loses_its_hold() {
        let mut clamps = Clamps::watched(&SOCKETS_OF_A_MODEL);
        clamps.release(7);
        let held: Vec<usize> = (0..12).filter(|&s| clamps.hold[s] > 0.0 && clamps.preload[s] > 0.0).collect();
        assert_eq!(held, [0, 1, 2, 3, 4, 5, 8, 9, 10, 11]);
        // A cup without clamp force dislocates under any load that does not seat it.
        let motion = testing::still();
        assert!(margin(&clamps, &motion, 6, [0.0, -1e-3, 0.0]) < 0.0);
        assert!(margin(&clamps, &motion, 6, [1e-3, 1.0, 0.0]) < 0.0);
    }
}
