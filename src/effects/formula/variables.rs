//! Variables of formula expressions.

use crate::effects::Instant;
use crate::machine::bodies::PLATFORM;
use crate::machine::unit::Powers;
use crate::machine::{Mechanism, Part, Unit};

/// Quantity of an instant, by its index in the list of names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Variable(u8);

/// Family of a quantity and its index within the family.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Time,
    Angle(usize),
    Rate(usize),
    Acceleration(usize),
    Position(usize),
    Velocity(usize),
    PlatformAcceleration(usize),
    TelescopeLength,
    TelescopeRate,
    StrutUpper(usize),
    StrutLower(usize),
    Torque(usize),
}

const ALL: [(&str, Kind); 40] = [
    ("t", Kind::Time),
    ("q1", Kind::Angle(0)),
    ("q2", Kind::Angle(1)),
    ("q3", Kind::Angle(2)),
    ("q4", Kind::Angle(3)),
    ("qd1", Kind::Rate(0)),
    ("qd2", Kind::Rate(1)),
    ("qd3", Kind::Rate(2)),
    ("qd4", Kind::Rate(3)),
    ("qdd1", Kind::Acceleration(0)),
    ("qdd2", Kind::Acceleration(1)),
    ("qdd3", Kind::Acceleration(2)),
    ("qdd4", Kind::Acceleration(3)),
    ("x", Kind::Position(0)),
    ("y", Kind::Position(1)),
    ("z", Kind::Position(2)),
    ("vx", Kind::Velocity(0)),
    ("vy", Kind::Velocity(1)),
    ("vz", Kind::Velocity(2)),
    ("ax", Kind::PlatformAcceleration(0)),
    ("ay", Kind::PlatformAcceleration(1)),
    ("az", Kind::PlatformAcceleration(2)),
    ("s", Kind::TelescopeLength),
    ("sd", Kind::TelescopeRate),
    ("strut1_upper", Kind::StrutUpper(0)),
    ("strut2_upper", Kind::StrutUpper(1)),
    ("strut3_upper", Kind::StrutUpper(2)),
    ("strut4_upper", Kind::StrutUpper(3)),
    ("strut5_upper", Kind::StrutUpper(4)),
    ("strut6_upper", Kind::StrutUpper(5)),
    ("strut1_lower", Kind::StrutLower(0)),
    ("strut2_lower", Kind::StrutLower(1)),
    ("strut3_lower", Kind::StrutLower(2)),
    ("strut4_lower", Kind::StrutLower(3)),
    ("strut5_lower", Kind::StrutLower(4)),
    ("strut6_lower", Kind::StrutLower(5)),
    ("tau1", Kind::Torque(0)),
    ("tau2", Kind::Torque(1)),
    ("tau3", Kind::Torque(2)),
    ("tau4", Kind::Torque(3)),
];

impl Variable {
    /// The variable called `name`.
    pub fn named(name: &str) -> Option<Self> {
        ALL.iter().position(|(known, _)| *known == name).map(|i| Self(i as u8))
    }

    /// Names of all variables.
    pub fn names() -> impl Iterator<Item = &'static str> {
        ALL.iter().map(|(name, _)| *name)
    }

    /// Index among all variables.
    pub fn index(self) -> usize {
        self.0 as usize
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        ALL[self.0 as usize].0
    }

    fn kind(self) -> Kind {
        ALL[self.0 as usize].1
    }

    /// Value at an instant, SI units.
    pub fn read(self, at: &Instant) -> f64 {
        let motion = at.motion;
        match self.kind() {
            Kind::Time => at.t,
            Kind::Angle(i) => motion.q[i],
            Kind::Rate(i) => motion.qd[i],
            Kind::Acceleration(i) => motion.qdd[i],
            Kind::Position(i) => motion.bodies[PLATFORM].position[i],
            Kind::Velocity(i) => motion.bodies[PLATFORM].velocity[i],
            Kind::PlatformAcceleration(i) => motion.bodies[PLATFORM].acceleration[i],
            Kind::TelescopeLength => motion.telescope.length,
            Kind::TelescopeRate => motion.telescope.rate,
            Kind::StrutUpper(i) => at.reactions.upper[i],
            Kind::StrutLower(i) => at.reactions.lower[i],
            Kind::Torque(i) => at.torque[i],
        }
    }

    /// Unit on `machine` as powers of N, A, m, s and rad.
    pub fn powers(self, machine: Mechanism) -> Powers {
        let length = Powers { m: 1, ..Powers::ONE };
        let angle = |s| machine.drive_powers(Powers { rad: 1, s, ..Powers::ONE });
        match self.kind() {
            Kind::Time => Powers { s: 1, ..Powers::ONE },
            Kind::Angle(_) => angle(0),
            Kind::Rate(_) => angle(-1),
            Kind::Acceleration(_) => angle(-2),
            Kind::Position(_) | Kind::TelescopeLength => length,
            Kind::Velocity(_) | Kind::TelescopeRate => Powers { s: -1, ..length },
            Kind::PlatformAcceleration(_) => Powers { s: -2, ..length },
            Kind::StrutUpper(_) | Kind::StrutLower(_) => Powers::N,
            Kind::Torque(_) => machine.drive_powers(Powers::NM),
        }
    }

    /// Unit on `machine`.
    pub fn unit(self, machine: Mechanism) -> Unit {
        Unit::Derived(self.powers(machine))
    }

    /// Whether it is a strut force.
    pub fn is_reaction(self) -> bool {
        matches!(self.kind(), Kind::StrutUpper(_) | Kind::StrutLower(_))
    }

    /// Whether it is a drive torque.
    pub fn is_torque(self) -> bool {
        matches!(self.kind(), Kind::Torque(_))
    }

    /// Whether it is an acceleration.
    pub fn is_acceleration(self) -> bool {
        matches!(self.kind(), Kind::Acceleration(_) | Kind::PlatformAcceleration(_))
    }

    /// The part of the machine required by the variable.
    pub fn part(self) -> Part {
        match self.kind() {
            Kind::Angle(3) | Kind::Rate(3) | Kind::Acceleration(3) | Kind::Torque(3) => Part::FourthDrive,
            Kind::Time | Kind::Angle(_) | Kind::Rate(_) | Kind::Acceleration(_) | Kind::Torque(_) => Part::Drives,
            Kind::TelescopeLength | Kind::TelescopeRate => Part::Telescope,
            _ => Part::Linkage,
        }
    }

    /// Whether the assembled `machine` has the variable.
    pub fn exists_on(self, machine: Mechanism) -> bool {
        match self.kind() {
            Kind::Angle(i) | Kind::Rate(i) | Kind::Acceleration(i) | Kind::Torque(i) => i < machine.axes(),
            _ => machine.has(self.part(), true),
        }
    }
}
