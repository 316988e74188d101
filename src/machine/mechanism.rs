//! Kinds of machine, with their axes and parts.

use super::Unit;
use super::bodies::{ARM, END_EFFECTOR, PLATFORM, ROTOR, TELESCOPE_LOWER, TELESCOPE_UPPER, arm, strut};
use super::layout::ARMS;
use super::unit::Powers;

/// The kind of machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mechanism {
    /// Delta robot or one of its relatives: limbs with parallel struts that carry a plate. With a telescope axis 4 turns the
    /// end effector; without it the plate turns it, or it is rigidly attached to the platform.
    Delta {
        /// Whether there is a telescope with its drive.
        telescope: bool,
        /// Joint type of the arms: revolute, or prismatic for carriages on guides.
        arms: Joint,
        /// Number of limbs, and kind of plate.
        members: Members,
    },
    /// A single axis on a test bench, without gravity.
    ///
    /// It is represented by the first arm of a disassembled robot, all other bodies at rest. On a prismatic axis,
    /// angles stand for metres, torques for newtons and moments of inertia for masses; the equation of motion is the
    /// same. On an axis whose current is recorded, amperes stand for newton metres or newtons.
    Axis(Axis),
}

/// Limbs and plate of a robot, counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Members {
    /// Number of limbs.
    pub limbs: u8,
    /// Number of limbs with a drive, the first ones.
    pub driven: u8,
    /// Bodies of the plate, see [`Plate::bodies`](super::Plate::bodies).
    pub plate: &'static [usize],
}

impl Members {
    /// Three driven limbs and one platform.
    pub const DELTA: Self = Self { limbs: ARMS as u8, driven: ARMS as u8, plate: &[PLATFORM] };

    /// Limbs and plate of a geometry.
    pub fn of(geometry: &super::Geometry) -> Self {
        let driven = geometry.limbs.iter().filter(|limb| limb.driven).count();
        Self { limbs: geometry.limbs.len() as u8, driven: driven as u8, plate: geometry.plate.bodies() }
    }
}

/// A single axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Axis {
    /// Its joint.
    pub joint: Joint,
    /// What its recordings and its model state of its drive.
    pub effort: Effort,
}

impl From<Joint> for Axis {
    /// An axis whose torque or force is known.
    fn from(joint: Joint) -> Self {
        Self { joint, effort: Effort::Force }
    }
}

/// Quantity in which the effort of a drive is stated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Effort {
    /// Torque in N·m, or force in N.
    #[default]
    Force,
    /// Motor current in A: torque, friction and inertia are those divided by the unknown torque constant (N·m/A at the
    /// joint, or N/A).
    Current,
}

/// Joint type of a single axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Joint {
    /// The coordinate is an angle: rad, N·m, kg·m².
    Revolute,
    /// The coordinate is a distance: m, N, kg.
    Prismatic,
}

/// Part of a machine on which an effect acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Drives and their sensors; every machine has them.
    Drives,
    /// The drive of the telescope.
    Axis4,
    /// A fourth drive: the telescope's, or that of a fourth arm.
    FourthDrive,
    /// Bodies with weight.
    Weight,
    /// Struts and platform with its load, as a closed linkage.
    Linkage,
    /// One platform on three limbs, which may tilt.
    Delta,
    /// The telescope between its drive and the end effector.
    Telescope,
    /// A single turning axis with what it carries.
    TurningAxis,
    /// The drives of the arms of an assembled robot.
    ArmDrives,
}

impl Part {
    /// The part in words.
    pub fn describe(self) -> &'static str {
        match self {
            Self::Drives => "the drives",
            Self::Axis4 | Self::FourthDrive => "the drive of axis 4",
            Self::Weight => "bodies under gravity",
            Self::Linkage => "struts and platform",
            Self::Delta => "a platform on three limbs",
            Self::Telescope => "the telescope",
            Self::TurningAxis => "a single turning axis",
            Self::ArmDrives => "the drives of the arms",
        }
    }
}

impl Default for Mechanism {
    fn default() -> Self {
        Self::delta(true)
    }
}

impl Mechanism {
    /// Number of driven axes.
    pub fn axes(self) -> usize {
        self.arms() + usize::from(self.has_telescope())
    }

    /// Number of axes without that of the telescope.
    pub fn arms(self) -> usize {
        match self {
            Self::Delta { members, .. } => members.driven.into(),
            Self::Axis(_) => 1,
        }
    }

    /// Number of limbs; one for a single axis.
    pub fn limbs(self) -> usize {
        match self {
            Self::Delta { members, .. } => members.limbs.into(),
            Self::Axis(_) => 1,
        }
    }

    /// Number of struts of the assembled machine.
    pub fn struts(self) -> usize {
        match self {
            Self::Delta { members, .. } => 2 * usize::from(members.limbs),
            Self::Axis(_) => 0,
        }
    }

    /// Whether the plate turns the end effector, by its own coordinate ψ.
    pub fn plate_turns(self) -> bool {
        matches!(self, Self::Delta { members, .. } if members.plate.contains(&END_EFFECTOR))
    }

    /// Whether `body` is a part of the plate.
    pub fn is_part_of_plate(self, body: usize) -> bool {
        matches!(self, Self::Delta { members, .. } if members.plate.contains(&body))
    }

    /// Whether it is a robot with three limbs and one platform, with or without a telescope.
    pub fn is_delta(self) -> bool {
        matches!(self, Self::Delta { members: Members::DELTA, .. })
    }

    /// Whether the machine, assembled, has `body`. The end effector is one on every robot: without a telescope and a plate
    /// that turns, it is part of the platform.
    pub fn has_body(self, body: usize) -> bool {
        let Self::Delta { members, .. } = self else { return body == ARM };
        match body {
            END_EFFECTOR => true,
            ROTOR | TELESCOPE_UPPER | TELESCOPE_LOWER => self.has_telescope(),
            _ => {
                members.plate.contains(&body)
                    || (0..self.limbs()).any(|i| body == arm(i))
                    || (0..self.struts()).any(|s| body == strut(s))
            }
        }
    }

    /// Whether the end effector moves relative to the platform; otherwise it is part of it.
    pub fn has_end_effector(self) -> bool {
        self.has_telescope() || self.plate_turns()
    }

    /// Whether there is a telescope with its drive.
    pub fn has_telescope(self) -> bool {
        matches!(self, Self::Delta { telescope: true, .. })
    }

    /// Whether the machine has `part`; linkage, telescope and turning arms only while `assembled`.
    pub fn has(self, part: Part, assembled: bool) -> bool {
        let delta = matches!(self, Self::Delta { .. });
        match part {
            Part::Drives => true,
            Part::Axis4 => self.has_telescope(),
            Part::FourthDrive => self.axes() == 4,
            Part::Weight => delta,
            Part::Linkage => delta && assembled,
            Part::Telescope => self.has_telescope() && assembled,
            Part::TurningAxis => matches!(self, Self::Axis(axis) if axis.joint == Joint::Revolute),
            Part::Delta => self.is_delta() && assembled,
            Part::ArmDrives => delta && assembled,
        }
    }

    /// A single axis whose torque or force is known.
    pub const fn axis(joint: Joint) -> Self {
        Self::Axis(Axis { joint, effort: Effort::Force })
    }

    /// A delta robot whose arms turn.
    pub const fn delta(telescope: bool) -> Self {
        Self::Delta { telescope, arms: Joint::Revolute, members: Members::DELTA }
    }

    /// A delta robot whose arms are carriages on guides; it has no telescope.
    pub const LINEAR_DELTA: Self = Self::Delta { telescope: false, arms: Joint::Prismatic, members: Members::DELTA };

    /// Joint type of its axes, as far as their coordinates are concerned; of a robot that of the arms.
    pub fn joint(self) -> Joint {
        match self {
            Self::Axis(axis) => axis.joint,
            Self::Delta { arms, .. } => arms,
        }
    }

    /// Whether its arms are carriages on guides.
    pub fn has_carriages(self) -> bool {
        matches!(self, Self::Delta { arms: Joint::Prismatic, .. })
    }

    /// Quantity in which the efforts of its drives are stated.
    pub fn effort(self) -> Effort {
        match self {
            Self::Axis(axis) => axis.effort,
            Self::Delta { .. } => Effort::Force,
        }
    }

    /// `unit` of a parameter of an effect on `part`: as [`Self::unit`] for drives, unchanged for other
    /// parts of a robot.
    pub fn unit_on(self, part: Part, unit: Unit) -> Unit {
        match self {
            Self::Delta { .. } if !matches!(part, Part::Drives | Part::ArmDrives) => unit,
            _ => self.unit(unit),
        }
    }

    /// `unit` on this machine's axes: converted by [`Unit::on_slide`] for a prismatic axis, and by
    /// [`Unit::per_torque_constant`] for one whose current is recorded.
    pub fn unit(self, unit: Unit) -> Unit {
        let joint = self.joint();
        let unit = if joint == Joint::Prismatic { unit.on_slide() } else { unit };
        match self.effort() {
            Effort::Force => unit,
            Effort::Current => unit.per_torque_constant(),
        }
    }

    /// Powers of a quantity of a drive, stated for a revolute drive with known torque, on this machine's axes.
    pub fn drive_powers(self, powers: Powers) -> Powers {
        let joint = self.joint();
        let powers = if joint == Joint::Prismatic { powers.on_slide() } else { powers };
        match self.effort() {
            Effort::Force => powers,
            Effort::Current => powers.per_torque_constant(joint),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MACHINES: [(Mechanism, usize); 4] = [
        (Mechanism::delta(true), 4),
        (Mechanism::delta(false), 3),
        (Mechanism::axis(Joint::Revolute), 1),
        (Mechanism::axis(Joint::Prismatic), 1),
    ];

    #[test]
    fn parts_go_with_the_machine_and_its_state() {
        for (machine, axes) in MACHINES {
            assert_eq!(machine.axes(), axes);
            for assembled in [true, false] {
                let delta = axes > 1;
                assert!(machine.has(Part::Drives, assembled));
                assert_eq!(machine.has(Part::Axis4, assembled), axes == 4);
                assert_eq!(machine.has(Part::Weight, assembled), delta);
                assert_eq!(machine.has(Part::Linkage, assembled), delta && assembled);
                assert_eq!(machine.has(Part::Telescope, assembled), axes == 4 && assembled);
                assert_eq!(
                    machine.has(Part::TurningAxis, assembled),
                    matches!(machine, Mechanism::Axis(axis) if axis.joint == Joint::Revolute)
                );
            }
        }
    }

    #[test]
    fn neither_newtons_nor_kilograms_are_left_on_an_axis_in_amperes() {
        for joint in [Joint::Revolute, Joint::Prismatic] {
            let axis = Mechanism::Axis(Axis { joint, effort: Effort::Current });
            let links: std::sync::Arc<dyn crate::effects::Effect> =
                crate::effects::rigid_bodies::RigidBodies::of(axis, false);
            let laws = crate::effects::REGISTRY.iter().filter(|e| e.name() != links.name());
            for effect in laws.filter(|e| axis.has(e.acts_on(), true)).chain([&links]) {
                for p in effect.parameters() {
                    let text = axis.unit(p.unit).to_string();
                    assert!(!text.contains('N') && !text.contains("kg"), "{}.{}: {text}", effect.name(), p.name);
                }
            }
        }
    }

    #[test]
    fn no_angle_is_left_in_the_units_of_a_prismatic_axis() {
        let slide = Mechanism::axis(Joint::Prismatic);
        for effect in crate::effects::REGISTRY.iter().filter(|e| slide.has(e.acts_on(), true)) {
            for p in effect.parameters() {
                let unit = slide.unit(p.unit);
                let text = unit.to_string().replace("rad/m", "");
                assert!(!text.contains("rad") && !text.contains("N·m"), "{}.{}: {unit}", effect.name(), p.name);
                assert_eq!(Mechanism::default().unit(p.unit), p.unit);
            }
        }
    }
}
