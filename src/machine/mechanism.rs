//! Which axes and parts a machine has.

use super::Unit;

/// The kind of machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mechanism {
    /// Delta robot: three arms, and axis 4 if a telescope turns the end effector; without, it is fixed to the platform.
    Delta {
        /// Whether there is a telescope with its drive.
        telescope: bool,
    },
    /// A single axis on a bench, without gravity.
    ///
    /// Inside, it is the first arm of a disassembled robot, all else at rest. Of a prismatic one, angles stand for
    /// metres, torques for newtons and moments of inertia for masses: the equations are the same.
    Axis(Joint),
}

/// What an axis moves through.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Joint {
    /// An angle: rad, N·m, kg·m².
    Revolute,
    /// A distance: m, N, kg.
    Prismatic,
}

/// A part of a machine that effects act on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Drives and their sensors; every machine has them.
    Drives,
    /// The drive of the telescope.
    Axis4,
    /// Bodies under gravity.
    Weight,
    /// Struts, platform and what it carries, all limbs moving together.
    Linkage,
    /// The telescope between its drive and the end effector.
    Telescope,
}

impl Part {
    /// In words.
    pub fn describe(self) -> &'static str {
        match self {
            Self::Drives => "the drives",
            Self::Axis4 => "the drive of axis 4",
            Self::Weight => "bodies under gravity",
            Self::Linkage => "struts and platform",
            Self::Telescope => "the telescope",
        }
    }
}

impl Default for Mechanism {
    fn default() -> Self {
        Self::Delta { telescope: true }
    }
}

impl Mechanism {
    /// Number of driven axes.
    pub fn axes(self) -> usize {
        self.arms() + usize::from(self.has_telescope())
    }

    /// Number of axes without the telescope's.
    pub fn arms(self) -> usize {
        match self {
            Self::Delta { .. } => super::ARMS,
            Self::Axis(_) => 1,
        }
    }

    /// Whether there is a telescope with its drive.
    pub fn has_telescope(self) -> bool {
        self == Self::Delta { telescope: true }
    }

    /// Whether the machine has `part` while it is assembled or not.
    pub fn has(self, part: Part, assembled: bool) -> bool {
        let delta = matches!(self, Self::Delta { .. });
        match part {
            Part::Drives => true,
            Part::Axis4 => self.has_telescope(),
            Part::Weight => delta,
            Part::Linkage => delta && assembled,
            Part::Telescope => self.has_telescope() && assembled,
        }
    }

    /// `unit` as this machine's drives have it: that of a prismatic axis without angles.
    pub fn unit(self, unit: Unit) -> Unit {
        match self {
            Self::Axis(Joint::Prismatic) => unit.on_slide(),
            Self::Axis(Joint::Revolute) | Self::Delta { .. } => unit,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MACHINES: [(Mechanism, usize); 4] = [
        (Mechanism::Delta { telescope: true }, 4),
        (Mechanism::Delta { telescope: false }, 3),
        (Mechanism::Axis(Joint::Revolute), 1),
        (Mechanism::Axis(Joint::Prismatic), 1),
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
            }
        }
    }

    #[test]
    fn no_angle_is_left_in_the_units_of_a_prismatic_axis() {
        let slide = Mechanism::Axis(Joint::Prismatic);
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
