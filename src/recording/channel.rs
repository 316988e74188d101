//! The table of channels: what a recording may contain, with its names in files, unit and place in a bag.

use std::collections::HashMap;
use std::fmt;
use std::sync::LazyLock;

use crate::machine::{Mechanism, PerAxis, Unit, every_axis, every_strut};

/// A scalar signal. Axes, struts, sockets, coordinates and rows count from 0; the order is that of the columns of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Channel {
    /// Joint angle φ1, φ2, φ3, ψ measured by the encoder, with elastic gears on the motor side, rad (m).
    Angle(usize),
    /// Drive torque at the gear output, N·m (N), or the motor current, A.
    Torque(usize),
    /// Rate of the angle, rad/s.
    Rate(usize),
    /// Acceleration of the angle, rad/s².
    Acceleration(usize),
    /// Link-side angle of an elastic gear, rad.
    LinkAngle(usize),
    /// Link-side rate of an elastic gear, rad/s.
    LinkRate(usize),
    /// What loads a single axis at its output, positive against positive motion, N·m (N).
    Load(usize),
    /// Axial force at the elbow end of a strut, tension positive, N.
    StrutUpper(usize),
    /// Axial force at the platform end of a strut, tension positive, N.
    StrutLower(usize),
    /// Coordinate x, y, z of the centre of the platform's ball plane in the inertial frame, m.
    EndEffector(usize),
    /// Component x, y, z of the force on the flange from outside, inertial axes, N.
    FlangeForce(usize),
    /// Remaining force margin of the ball socket at the elbow end of a strut, zero once open, N.
    MarginUpper(usize),
    /// Remaining force margin of the ball socket at the platform end of a strut, zero once open, N.
    MarginLower(usize),
    /// Multiplier of a constraint row, see [`multiplier_names`]; zero for inactive joints, N or N·m.
    Multiplier(usize),
}

/// Channels of one quantity.
pub struct Family {
    /// The quantity.
    pub name: &'static str,
    /// Its channels.
    pub of: fn(usize) -> Channel,
    /// Topic of a bag that carries it.
    pub topic: &'static str,
    /// Place in the messages of the topic.
    pub field: Field,
    /// Whether its channels are only usable together.
    pub whole: bool,
    count: Count,
    column: fn(usize) -> String,
    unit: Unit,
}

/// Place of a quantity in the messages of a topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Field {
    /// `position` of a `JointState`.
    Position,
    /// `velocity` of a `JointState`.
    Velocity,
    /// `effort` of a `JointState`.
    Effort,
    /// `accelerations` of the point of a `JointTrajectory`.
    Accelerations,
    /// `point` of a `PointStamped`.
    Point,
    /// `force` of a `WrenchStamped`.
    Force,
}

/// Number of channels of a family.
#[derive(Clone, Copy)]
enum Count {
    /// One per axis of the machine.
    Axes,
    /// One per strut.
    Struts,
    Fixed(usize),
}

/// Number of constraint rows of the assembled robot.
pub const ROWS: usize = 74;

const XYZ: [&str; 3] = ["x", "y", "z"];

/// All families in the order of the columns of a file: a sensor is one row here and one variant of [`Channel`].
pub const FAMILIES: [Family; 14] = {
    use Channel as C;
    use Count::{Axes, Fixed, Struts};
    const fn row(
        name: &'static str,
        of: fn(usize) -> Channel,
        (topic, field): (&'static str, Field),
        (count, whole): (Count, bool),
        column: fn(usize) -> String,
        unit: Unit,
    ) -> Family {
        Family { name, of, topic, field, whole, count, column, unit }
    }
    [
        row("q", C::Angle, ("/joint_states", Field::Position), (Axes, true), |k| axis("q", k), Unit::Rad),
        row("tau", C::Torque, ("/joint_states", Field::Effort), (Axes, true), |k| axis("tau", k), Unit::NM),
        row("qd", C::Rate, ("/joint_states", Field::Velocity), (Axes, true), |k| axis("qd", k), Unit::RadPerS),
        row(
            "qdd",
            C::Acceleration,
            ("/joint_acceleration", Field::Accelerations),
            (Axes, true),
            |k| axis("qdd", k),
            Unit::RadPerS2,
        ),
        row("link_q", C::LinkAngle, ("/links", Field::Position), (Axes, true), |k| axis("link_q", k), Unit::Rad),
        row("link_qd", C::LinkRate, ("/links", Field::Velocity), (Axes, true), |k| axis("link_qd", k), Unit::RadPerS),
        row("load", C::Load, ("/loads", Field::Effort), (Axes, false), |k| axis("load", k), Unit::NM),
        row(
            "strut force",
            C::StrutUpper,
            ("/strut_forces", Field::Effort),
            (Struts, false),
            |s| format!("strut{}_upper", s + 1),
            Unit::N,
        ),
        row(
            "strut force",
            C::StrutLower,
            ("/strut_forces", Field::Effort),
            (Struts, false),
            |s| format!("strut{}_lower", s + 1),
            Unit::N,
        ),
        row("ee", C::EndEffector, ("/end_effector", Field::Point), (Fixed(3), true), |k| named("ee", k), Unit::M),
        row(
            "flange force",
            C::FlangeForce,
            ("/flange_force", Field::Force),
            (Fixed(3), true),
            |k| named("force", k),
            Unit::N,
        ),
        row(
            "socket margin",
            C::MarginUpper,
            ("/socket_margins", Field::Effort),
            (Struts, true),
            |s| format!("margin{}_upper", s + 1),
            Unit::N,
        ),
        row(
            "socket margin",
            C::MarginLower,
            ("/socket_margins", Field::Effort),
            (Struts, true),
            |s| format!("margin{}_lower", s + 1),
            Unit::N,
        ),
        row(
            "multiplier",
            C::Multiplier,
            ("/multipliers", Field::Effort),
            (Fixed(ROWS), true),
            |row| multiplier_names()[row].clone(),
            Unit::N,
        ),
    ]
};

fn axis(stem: &str, k: usize) -> String {
    format!("{stem}{}", k + 1)
}

fn named(stem: &str, k: usize) -> String {
    format!("{stem}_{}", XYZ[k])
}

impl Family {
    /// Its channels on a machine, in order.
    pub fn channels(&self, machine: Mechanism) -> impl Iterator<Item = Channel> + use<> {
        self.of_counts(machine.axes(), machine.struts())
    }

    fn of_counts(&self, axes: usize, struts: usize) -> impl Iterator<Item = Channel> + use<> {
        let of = self.of;
        let count = match self.count {
            Count::Axes => axes,
            Count::Struts => struts,
            Count::Fixed(count) => count,
        };
        (0..count).map(of)
    }

    /// Whether there is one channel per axis.
    pub fn is_of_axes(&self) -> bool {
        matches!(self.count, Count::Axes)
    }
}

impl Channel {
    /// The four drive torques.
    pub const TORQUES: PerAxis<Self> = [Self::Torque(0), Self::Torque(1), Self::Torque(2), Self::Torque(3)];

    /// Efforts of the drives of a machine, in order.
    pub fn of_drives(machine: Mechanism) -> Vec<Self> {
        (0..machine.axes()).map(Self::Torque).collect()
    }

    /// The quantity of the channel.
    pub fn family(self) -> &'static Family {
        const TABLE: &[Family] = &FAMILIES;
        let place = match self {
            Self::Angle(_) => 0,
            Self::Torque(_) => 1,
            Self::Rate(_) => 2,
            Self::Acceleration(_) => 3,
            Self::LinkAngle(_) => 4,
            Self::LinkRate(_) => 5,
            Self::Load(_) => 6,
            Self::StrutUpper(_) => 7,
            Self::StrutLower(_) => 8,
            Self::EndEffector(_) => 9,
            Self::FlangeForce(_) => 10,
            Self::MarginUpper(_) => 11,
            Self::MarginLower(_) => 12,
            Self::Multiplier(_) => 13,
        };
        &TABLE[place]
    }

    /// Margins of the sockets of a machine, in order.
    pub fn of_sockets(machine: Mechanism) -> Vec<Self> {
        let struts = || 0..machine.struts();
        struts().map(Self::MarginUpper).chain(struts().map(Self::MarginLower)).collect()
    }

    /// The quantity in comparisons of recordings.
    pub fn quantity(self) -> &'static str {
        match self {
            Self::Multiplier(row) if is_force(row) => "multiplier (force)",
            Self::Multiplier(_) => "multiplier (moment)",
            other => other.family().name,
        }
    }

    /// Place in its family, from 0.
    pub fn index(self) -> usize {
        match self {
            Self::Angle(k)
            | Self::Torque(k)
            | Self::Rate(k)
            | Self::Acceleration(k)
            | Self::LinkAngle(k)
            | Self::LinkRate(k)
            | Self::Load(k)
            | Self::StrutUpper(k)
            | Self::StrutLower(k)
            | Self::EndEffector(k)
            | Self::FlangeForce(k)
            | Self::MarginUpper(k)
            | Self::MarginLower(k)
            | Self::Multiplier(k) => k,
        }
    }

    /// The channel whose column has this name.
    pub fn named(column: &str) -> Option<Self> {
        static NAMES: LazyLock<HashMap<String, Channel>> = LazyLock::new(|| {
            let all = FAMILIES.iter().flat_map(|family| family.of_counts(every_axis().end, every_strut().end));
            all.map(|channel| (channel.to_string(), channel)).collect()
        });
        NAMES.get(column).copied()
    }

    /// Title in tables and figures.
    pub fn title(self, machine: Mechanism) -> String {
        let effort = match machine.unit(Unit::NM) {
            Unit::NM => "torque",
            Unit::N => "force",
            _ => "current",
        };
        match self {
            Self::Torque(i) => format!("axis {} {effort}", i + 1),
            Self::StrutUpper(i) => format!("strut {} upper force", i + 1),
            Self::StrutLower(i) => format!("strut {} lower force", i + 1),
            other => other.to_string(),
        }
    }

    /// Index of its drive, from 0; `None` unless it is the effort of one.
    pub fn drive(self) -> Option<usize> {
        if let Self::Torque(i) = self { Some(i) } else { None }
    }

    /// Index of its drive, or of the strut's limb, from 0.
    pub fn limb(self) -> usize {
        match self {
            Self::StrutUpper(s) | Self::StrutLower(s) => s / 2,
            other => other.index(),
        }
    }

    /// Unit of the channel.
    pub fn unit(self, machine: Mechanism) -> Unit {
        match self {
            // A load is known where the torque constant is not.
            Self::Load(_) => Mechanism::axis(machine.joint()).unit(Unit::NM),
            Self::Multiplier(row) if !is_force(row) => Unit::NM,
            other if other.family().is_of_axes() => machine.unit(other.family().unit),
            other => other.family().unit,
        }
    }
}

impl fmt::Display for Channel {
    /// The name of its column.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&(self.family().column)(self.index()))
    }
}

/// Column names `lambda_<joint>_<row>` of the constraint multipliers, in the order of the rows.
///
/// Joints are `arm1 … arm3` and `rotor` (bearings), `strut1_upper`, `strut1_lower` … (sockets), `end_effector` (its
/// bearing on the platform), and `upper_hooke`, `slide` and `lower_hooke` of the telescope. Rows `x`, `y`, `z` make two
/// points coincide; their multipliers are forces (N) along the inertial axes. Numbered rows are scalar: moments (N·m)
/// about the cross product of two axes that the row keeps perpendicular, and for `slide_4` and `slide_5` forces (N).
pub fn multiplier_names() -> &'static [String; ROWS] {
    static NAMES: LazyLock<[String; ROWS]> = LazyLock::new(|| {
        let mut names = Vec::with_capacity(ROWS);
        let mut add = |joint: &str, rows: &[&str]| names.extend(rows.iter().map(|row| format!("lambda_{joint}_{row}")));
        let bearing = ["x", "y", "z", "4", "5"];
        for i in 1..=3 {
            add(&format!("arm{i}"), &bearing);
        }
        add("rotor", &bearing);
        for s in 1..=6 {
            add(&format!("strut{s}_upper"), &XYZ);
            add(&format!("strut{s}_lower"), &XYZ);
        }
        add("end_effector", &bearing);
        add("upper_hooke", &["x", "y", "z", "4"]);
        add("slide", &["1", "2", "3", "4", "5"]);
        add("lower_hooke", &["x", "y", "z", "4"]);
        std::array::from_fn(|row| names[row].clone())
    });
    &NAMES
}

/// Whether the multiplier of `row` is a force (N); otherwise it is a moment (N·m).
fn is_force(row: usize) -> bool {
    let name = &multiplier_names()[row];
    ["_x", "_y", "_z"].iter().any(|end| name.ends_with(end)) || name == "lambda_slide_4" || name == "lambda_slide_5"
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::Joint;

    #[test]
    fn every_channel_has_one_name_and_is_found_by_it() {
        let mut seen = std::collections::BTreeSet::new();
        for (place, family) in FAMILIES.iter().enumerate() {
            for (k, channel) in family.channels(Mechanism::default()).enumerate() {
                assert_eq!((channel.index(), Channel::named(&channel.to_string())), (k, Some(channel)));
                // Its own family makes it, and each family makes channels of its own.
                assert_eq!((channel.family().of)(k), channel, "{place}");
                assert!(seen.insert(channel.to_string()));
            }
        }
        assert_eq!(seen.len(), 7 * 4 + 2 * 6 + 6 + 2 * 6 + ROWS);
        assert_eq!([Channel::named("q5"), Channel::named("strut9_upper"), Channel::named("tau")], [None; 3]);
    }

    #[test]
    fn rows_are_forces_or_moments() {
        let names = multiplier_names();
        assert_eq!((names[0].as_str(), names[19].as_str()), ("lambda_arm1_x", "lambda_rotor_5"));
        assert_eq!((names[23].as_str(), names[55].as_str()), ("lambda_strut1_lower_x", "lambda_strut6_lower_z"));
        assert_eq!((names[68].as_str(), names[73].as_str()), ("lambda_slide_4", "lambda_lower_hooke_4"));
        let unit = |row| Channel::Multiplier(row).unit(Mechanism::default());
        assert_eq!([unit(68), unit(67), unit(19)], [Unit::N, Unit::NM, Unit::NM]);
    }

    #[test]
    fn units_are_those_of_the_machine() {
        let slide = Mechanism::axis(Joint::Prismatic);
        assert_eq!(Channel::Angle(0).unit(slide), Unit::M);
        assert_eq!((Channel::Torque(0).unit(slide), Channel::Load(0).unit(slide)), (Unit::N, Unit::N));
        assert_eq!(Channel::Torque(0).title(slide), "axis 1 force");
        assert_eq!(Channel::StrutUpper(5).unit(Mechanism::LINEAR_DELTA), Unit::N);
    }
}
