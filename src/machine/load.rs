//! What loads a single axis from outside, as far as it is known.

use super::{Joint, Mechanism};

/// Standard acceleration of free fall, m/s²: a load hangs from a bench whose model has no gravity [ISO 80000-3].
pub const FREE_FALL: f64 = 9.806_65;

/// A known load at the output of a single axis: what hangs from it or pulls at it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Load {
    /// Mass m that hangs on a rope, kg.
    pub mass: f64,
    /// Radius r of the drum that winds up the rope, m, negative if positive motion lowers the mass; on a prismatic axis +1
    /// or −1, the direction in which its motion lifts the mass, +1 unless stated.
    pub radius: Option<f64>,
    /// Constant pull F at the rope, N.
    pub force: f64,
    /// Constant torque M against positive motion, N·m.
    pub torque: f64,
}

impl Load {
    /// Torque or force at rest against positive motion, (m·g + F)·r + M, N·m or N.
    pub fn at_rest(&self) -> f64 {
        (self.mass * FREE_FALL + self.force) * self.radius.unwrap_or(1.0) + self.torque
    }

    /// Moment of inertia m·r² (kg·m²) that it adds to the axis; of a prismatic axis the mass m, kg.
    pub fn inertia(&self) -> f64 {
        self.mass * self.radius.unwrap_or(1.0).powi(2)
    }

    /// Whether there is none.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// Why a machine cannot have this load; `None` if it can.
    pub fn misfit(&self, machine: Mechanism) -> Option<&'static str> {
        let pulls = self.mass != 0.0 || self.force != 0.0;
        match machine {
            _ if self.is_none() => None,
            Mechanism::Delta { .. } => Some("`[load]` is of a single axis; expected `[payload]`, what a robot carries"),
            Mechanism::Axis(axis) => match (axis.joint, self.radius) {
                (Joint::Revolute, None) if pulls => {
                    Some("`load.radius` is missing; expected the radius of the drum, m")
                }
                (Joint::Prismatic, Some(r)) if r.abs() != 1.0 => {
                    Some("`load.radius` is of a turning axis; expected 1 or −1, which way a slide lifts, or nothing")
                }
                (Joint::Prismatic, _) if self.torque != 0.0 => {
                    Some("`load.torque` is of a turning axis; expected `load.force`, N")
                }
                _ => None,
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Five kilograms on a drum of 40 mm: 1.961 N·m and 8e-3 kg·m² by hand.
    #[test]
    fn a_mass_on_a_drum() {
        let load = Load { mass: 5.0, radius: Some(0.04), ..Load::default() };
        approx::assert_relative_eq!(load.at_rest(), 1.961_33, epsilon = 1e-12);
        approx::assert_relative_eq!(load.inertia(), 8e-3, epsilon = 1e-15);
        let lowered = Load { radius: Some(-1.0), ..load };
        assert_eq!(lowered.inertia(), 5.0);
        approx::assert_relative_eq!(lowered.at_rest(), -49.033_25, epsilon = 1e-12);
    }

    #[test]
    fn loads_that_a_machine_cannot_have_are_named() {
        let [turning, slide] = [Joint::Revolute, Joint::Prismatic].map(Mechanism::axis);
        let load = Load { mass: 5.0, ..Load::default() };
        assert!(load.misfit(turning).is_some_and(|what| what.contains("radius of the drum")));
        assert_eq!(load.misfit(slide), None);
        assert!(load.misfit(Mechanism::default()).is_some_and(|what| what.contains("[payload]")));
        let wound = Load { radius: Some(0.04), ..load };
        assert!(wound.misfit(turning).is_none() && wound.misfit(slide).is_some());
        assert!(Load { torque: 1.0, ..Load::default() }.misfit(slide).is_some());
        assert_eq!(Load::default().misfit(Mechanism::default()), None);
    }
}
