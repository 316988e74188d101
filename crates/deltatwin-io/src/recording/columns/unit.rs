//! Units of recorded columns, with their factors to SI.

/// Physical quantity of a unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// s.
    Time,
    /// rad.
    Angle,
    /// rad/s.
    AngularRate,
    /// rad/s².
    AngularAcceleration,
    /// m.
    Length,
    /// m/s.
    Velocity,
    /// m/s².
    Acceleration,
    /// N·m.
    Torque,
    /// N.
    Force,
    /// A; proportional to the torque of a motor.
    Current,
    /// A signal proportional to torque without a physical unit of its own: percent, per mille, volt, increments.
    Signal,
}

/// A unit: value in SI = `factor` × value in the unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unit {
    /// Usual name.
    pub name: &'static str,
    /// Physical quantity.
    pub quantity: Quantity,
    /// SI units per unit.
    pub factor: f64,
}

const DEGREE: f64 = std::f64::consts::PI / 180.0;
const TURN: f64 = std::f64::consts::TAU;

const fn unit(name: &'static str, quantity: Quantity, factor: f64) -> Unit {
    Unit { name, quantity, factor }
}

/// All units, SI first among those of a quantity.
const UNITS: &[Unit] = &[
    unit("s", Quantity::Time, 1.0),
    unit("ms", Quantity::Time, 1e-3),
    unit("us", Quantity::Time, 1e-6),
    unit("ns", Quantity::Time, 1e-9),
    unit("rad", Quantity::Angle, 1.0),
    unit("mrad", Quantity::Angle, 1e-3),
    unit("deg", Quantity::Angle, DEGREE),
    unit("rev", Quantity::Angle, TURN),
    unit("rad/s", Quantity::AngularRate, 1.0),
    unit("deg/s", Quantity::AngularRate, DEGREE),
    unit("rev/s", Quantity::AngularRate, TURN),
    unit("rpm", Quantity::AngularRate, TURN / 60.0),
    unit("rad/s2", Quantity::AngularAcceleration, 1.0),
    unit("deg/s2", Quantity::AngularAcceleration, DEGREE),
    unit("m", Quantity::Length, 1.0),
    unit("cm", Quantity::Length, 1e-2),
    unit("mm", Quantity::Length, 1e-3),
    unit("um", Quantity::Length, 1e-6),
    unit("m/s", Quantity::Velocity, 1.0),
    unit("mm/s", Quantity::Velocity, 1e-3),
    unit("m/s2", Quantity::Acceleration, 1.0),
    unit("mm/s2", Quantity::Acceleration, 1e-3),
    unit("Nm", Quantity::Torque, 1.0),
    unit("Nmm", Quantity::Torque, 1e-3),
    unit("Ncm", Quantity::Torque, 1e-2),
    unit("mNm", Quantity::Torque, 1e-3),
    unit("kNm", Quantity::Torque, 1e3),
    unit("N", Quantity::Force, 1.0),
    unit("mN", Quantity::Force, 1e-3),
    unit("kN", Quantity::Force, 1e3),
    unit("A", Quantity::Current, 1.0),
    unit("mA", Quantity::Current, 1e-3),
    unit("%", Quantity::Signal, 1.0),
    unit("‰", Quantity::Signal, 1.0),
    unit("V", Quantity::Signal, 1.0),
    unit("inc", Quantity::Signal, 1.0),
];

/// Alternative names of units in headers.
const OTHER_NAMES: &[(&str, &str)] = &[
    ("sec", "s"),
    ("secs", "s"),
    ("second", "s"),
    ("seconds", "s"),
    ("msec", "ms"),
    ("milliseconds", "ms"),
    ("usec", "us"),
    ("µs", "us"),
    ("μs", "us"),
    ("nsec", "ns"),
    ("nanoseconds", "ns"),
    ("radian", "rad"),
    ("radians", "rad"),
    ("°", "deg"),
    ("degree", "deg"),
    ("degrees", "deg"),
    ("grad", "deg"),
    ("turn", "rev"),
    ("turns", "rev"),
    ("°/s", "deg/s"),
    ("º", "deg"),
    ("degs", "deg"),
    ("deg/sec2", "deg/s2"),
    ("u/min", "rpm"),
    ("min1", "rpm"),
    ("revs", "rev"),
    ("newtonmeter", "Nm"),
    ("newton", "N"),
    ("microseconds", "us"),
    ("millimeter", "mm"),
    ("deg/sec", "deg/s"),
    ("rad/sec", "rad/s"),
    ("1/min", "rpm"),
    ("rev/min", "rpm"),
    ("rps", "rev/s"),
    ("°/s2", "deg/s2"),
    ("µm", "um"),
    ("ampere", "A"),
    ("amperes", "A"),
    ("amp", "A"),
    ("milliamps", "mA"),
    ("amps", "A"),
    ("percent", "%"),
    ("permille", "‰"),
    ("permil", "‰"),
    ("promille", "‰"),
    ("count", "inc"),
    ("counts", "inc"),
    ("cnt", "inc"),
    ("cnts", "inc"),
    ("incs", "inc"),
    ("incr", "inc"),
    ("increments", "inc"),
    ("digits", "inc"),
    ("lsb", "inc"),
    ("ticks", "inc"),
];

impl Unit {
    /// The unit called `text`; spaces, dots and case are ignored.
    pub fn find(text: &str) -> Option<Self> {
        let plain: String = text.chars().filter(|c| !c.is_whitespace() && !"·*.^-_".contains(*c)).collect();
        let plain = plain.replace('²', "2").to_lowercase();
        let name = OTHER_NAMES.iter().find(|(other, _)| *other == plain).map_or(plain.as_str(), |(_, name)| *name);
        UNITS.iter().find(|u| u.name.eq_ignore_ascii_case(name)).copied()
    }

    /// The SI unit of a quantity.
    pub fn of(quantity: Quantity) -> Option<Self> {
        UNITS.iter().find(|u| u.quantity == quantity).copied()
    }

    /// Names of all units of `quantities`, separated by commas.
    pub fn names(quantities: &[Quantity]) -> String {
        let names = UNITS.iter().filter(|u| quantities.contains(&u.quantity)).map(|u| u.name);
        names.collect::<Vec<_>>().join(", ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_found_as_they_are_written() {
        for (text, name, factor) in [
            ("N·m", "Nm", 1.0),
            ("N m", "Nm", 1.0),
            ("mNm", "mNm", 1e-3),
            ("°", "deg", 0.017453292519943295),
            ("deg/s²", "deg/s2", 0.017453292519943295),
            ("1/min", "rpm", 0.10471975511965977),
            ("MS", "ms", 1e-3),
            ("rad/s^2", "rad/s2", 1.0),
            ("per mille", "‰", 1.0),
            ("counts", "inc", 1.0),
        ] {
            let unit = Unit::find(text).unwrap_or_else(|| panic!("{text}"));
            assert_eq!((unit.name, unit.factor), (name, factor), "{text}");
        }
        assert_eq!(Unit::find("furlong"), None);
        assert_eq!(Unit::find(""), None);
    }
}
