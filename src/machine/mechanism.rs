//! Kinds of machine, with their axes and parts.

use super::Unit;

/// The kind of machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mechanism {
    /// Delta robot with three arms; with a telescope axis 4 turns the end effector, without it the end effector is
    /// rigidly attached to the platform.
    Delta {
        /// Whether there is a telescope with its drive.
        telescope: bool,
    },
    /// A single axis on a test bench, without gravity.
    ///
    /// It is represented by the first arm of a disassembled robot, all other bodies at rest. On a prismatic axis,
    /// angles stand for metres, torques for newtons and moments of inertia for masses; the equation of motion is the
    /// same.
    Axis(Joint),
}

/// Joint type of a single axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
    /// Bodies with weight.
    Weight,
    /// Struts and platform with its load, as a closed linkage.
    Linkage,
    /// The telescope between its drive and the end effector.
    Telescope,
    /// A single turning axis with what it carries.
    TurningAxis,
}

impl Part {
    /// The part in words.
    pub fn describe(self) -> &'static str {
        match self {
            Self::Drives => "the drives",
            Self::Axis4 => "the drive of axis 4",
            Self::Weight => "bodies under gravity",
            Self::Linkage => "struts and platform",
            Self::Telescope => "the telescope",
            Self::TurningAxis => "a single turning axis",
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

    /// Number of axes without that of the telescope.
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

    /// Whether the machine has `part`; linkage and telescope only while `assembled`.
    pub fn has(self, part: Part, assembled: bool) -> bool {
        let delta = matches!(self, Self::Delta { .. });
        match part {
            Part::Drives => true,
            Part::Axis4 => self.has_telescope(),
            Part::Weight => delta,
            Part::Linkage => delta && assembled,
            Part::Telescope => self.has_telescope() && assembled,
            Part::TurningAxis => self == Self::Axis(Joint::Revolute),
        }
    }

    /// `unit` on this machine's axes: converted by [`Unit::on_slide`] for a prismatic axis, else unchanged.
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
                assert_eq!(machine.has(Part::TurningAxis, assembled), machine == Mechanism::Axis(Joint::Revolute));
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
