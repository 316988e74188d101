//! Recognition of channels by column names: `position_1`, `effort_1`, `time`, `joint_1`, …

use deltatwin::machine::{Effort, Joint, Mechanism};

use super::unit::{Quantity, Unit};
use crate::recording::check::known;

/// Parts of a column name.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Header {
    /// The complete text.
    pub text: String,
    /// The text without its unit.
    pub base: String,
    /// Text of the unit: in brackets or parentheses, or after the last underscore if it is a known unit.
    pub unit: Option<String>,
}

impl Header {
    pub fn new(text: &str) -> Self {
        let of = |base: &str, unit: Option<&str>| Self {
            text: text.into(),
            base: base.trim().into(),
            unit: unit.map(|u| u.trim().into()),
        };
        if known(text) {
            return of(text, None);
        }
        for (open, close) in [('[', ']'), ('(', ')')] {
            if let Some((base, rest)) = text.split_once(open)
                && let Some(unit) = rest.trim_end().strip_suffix(close)
                && !base.trim().is_empty()
            {
                // `position[0]` is an index, not a unit.
                return if unit.trim().parse::<u32>().is_ok() { of(text, None) } else { of(base, Some(unit)) };
            }
        }
        match text.rsplit_once(['_', ' ']) {
            Some((base, unit)) if Unit::find(unit).is_some_and(|u| plausible(base, u.quantity)) => of(base, Some(unit)),
            _ => of(text, None),
        }
    }
}

/// Whether the last word of a name may be a unit of `quantity`: `phase_a` is not in ampere, `current_A` is.
fn plausible(base: &str, quantity: Quantity) -> bool {
    match quantity {
        Quantity::Signal => false,
        Quantity::Current => matches!(guess(base), Some(Guess::Axis("tau" | CURRENT, _))),
        _ => true,
    }
}

/// Stem of a motor current, which is read as `tau` if no column has a torque.
pub(super) const CURRENT: &str = "current";

/// Channel inferred from a name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Guess {
    Time,
    /// Position, rate, acceleration, torque or motor current (`q`, `qd`, `qdd`, `tau`, [`CURRENT`]) of an axis, with the
    /// number in the name if there is one.
    Axis(&'static str, Option<usize>),
}

/// Words of names in drive software, robot interfaces and bags, with the stem of the quantity they stand for.
const WORDS: &[(&str, &[&str])] = &[
    ("q", &["q", "pos", "position", "positions", "angle", "angles", "phi", "theta", "actpos", "actualposition"]),
    ("q", &["posact", "istposition", "lageistwert", "lage", "winkel", "weg", "aipos", "msrpos", "qj", "jointposition"]),
    ("qd", &["qd", "dq", "qdot", "vel", "velo", "velocity", "velocities", "rate", "speed", "actvel", "actvelo", "dqj"]),
    ("qd", &["actualvelocity", "actualspeed", "velact", "nact", "drehzahl", "geschwindigkeit", "omega"]),
    ("qdd", &["qdd", "ddq", "qddot", "acc", "accel", "acceleration", "actacc", "beschleunigung"]),
    ("tau", &["tau", "torque", "torques", "trq", "effort", "efforts", "force", "acttrq", "acttorque", "actualtorque"]),
    ("tau", &["drehmoment", "moment", "kraft", "tauj", "msrtrq", "etq"]),
    (CURRENT, &["current", "currents", "curr", "cur", "iq", "iqact", "amps", "strom", "macur", "actcurrent"]),
    (CURRENT, &["actualcurrent", "iact"]),
];

/// Words without a meaning of their own for the channel.
const FILLERS: &[&str] = &[
    "arm",
    "drive",
    "motor",
    "actual",
    "act",
    "measured",
    "meas",
    "msr",
    "state",
    "states",
    "data",
    "value",
    "values",
    "present",
    "feedback",
    "fbk",
    "estimate",
    "estimated",
    "est",
    "encoder",
    "enc",
    "nc",
    "to",
    "plc",
    "field",
    "ist",
    "istwert",
    "robot",
    "jnt",
    "filtered",
    "smoothed",
    "servo",
    "js",
    "monitor",
];

/// Channel inferred from the words of a name outside the file format; `None` if a word is unknown.
pub(super) fn guess(base: &str) -> Option<Guess> {
    let words = words(base);
    let (mut stem, mut weak, mut number, mut time) = (None, None, None, false);
    for word in &words {
        let word = word.as_str();
        if let Some((found, _)) = WORDS.iter().find(|(_, all)| all.contains(&word)) {
            // A position does not displace what it is the position of; `q_dot` and `torque_current` are their last word.
            stem = if *found == "q" { stem.or(Some(*found)) } else { Some(*found) };
            continue;
        }
        match word {
            "t" | "time" | "timestamp" | "stamp" | "sec" | "elapsed" | "zeit" | "clock" => time = true,
            "dot" if stem == Some("q") => stem = Some("qd"),
            "ddot" if stem == Some("q") => stem = Some("qdd"),
            // Franka Emika's measured torque `tau_J` and angle `q_J`.
            "j" if stem.is_some() => {}
            "joint" | "axis" | "j" | "achse" => weak = Some("q"),
            filler if FILLERS.contains(&filler) => {}
            digits => number = Some((number.is_none()).then(|| digits.parse::<usize>().ok()).flatten()?),
        }
    }
    match (time, stem.or(weak)) {
        (true, None) if number.is_none() => Some(Guess::Time),
        (false, Some(stem)) => Some(Guess::Axis(stem, number)),
        _ => None,
    }
}

/// Whether a name is that of a sliding axis' quantity.
pub(super) fn slides(base: &str) -> bool {
    words(base).iter().any(|w| matches!(w.as_str(), "force" | "kraft" | "weg"))
}

/// Words and numbers of a name in lower case: `ActPos_1` gives act, pos, 1.
fn words(base: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut before = ' ';
    for c in base.chars() {
        let breaks = !c.is_alphanumeric()
            || c.is_ascii_digit() != before.is_ascii_digit()
            || (c.is_uppercase() && before.is_lowercase());
        if breaks {
            words.push(String::new());
        }
        if c.is_alphanumeric()
            && let Some(word) = words.last_mut()
        {
            word.extend(c.to_lowercase());
        }
        before = c;
    }
    words.retain(|w| !w.is_empty());
    words
}

/// Quantities in which a channel may be measured, SI first, on a machine if it is known.
pub(super) fn quantities(channel: &str, machine: Option<Mechanism>) -> &'static [Quantity] {
    use Quantity::*;
    let linear = machine.map(|m| m.joint() == Joint::Prismatic);
    let effort = machine.map_or(Effort::Force, Mechanism::effort);
    let stem = channel.trim_end_matches(|c: char| c.is_ascii_digit());
    match (stem, linear) {
        ("t", _) => &[Time],
        ("q", Some(false)) => &[Angle],
        ("q", Some(true)) => &[Length],
        ("q", None) => &[Angle, Length],
        ("qd", Some(false)) => &[AngularRate],
        ("qd", Some(true)) => &[Velocity],
        ("qd", None) => &[AngularRate, Velocity],
        ("qdd", Some(false)) => &[AngularAcceleration],
        ("qdd", Some(true)) => &[Acceleration],
        ("qdd", None) => &[AngularAcceleration, Acceleration],
        ("tau", Some(_)) if effort == Effort::Current => &[Current],
        ("tau" | "load", Some(false)) => &[Torque],
        ("tau" | "load", Some(true)) => &[Force],
        ("tau" | "load", None) => &[Torque, Force],
        (ee, _) if ee.starts_with("ee") => &[Length],
        _ => &[Force],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_from_elsewhere_are_understood() {
        for (text, expected) in [
            ("time", Some(Guess::Time)),
            ("Timestamp", Some(Guess::Time)),
            ("joint_1", Some(Guess::Axis("q", Some(1)))),
            ("position_1", Some(Guess::Axis("q", Some(1)))),
            ("ActPos2", Some(Guess::Axis("q", Some(2)))),
            ("/joint_states/axis3/effort", Some(Guess::Axis("tau", Some(3)))),
            ("position[0]", Some(Guess::Axis("q", Some(0)))),
            ("q4_dot", Some(Guess::Axis("qd", Some(4)))),
            ("velocity_2", Some(Guess::Axis("qd", Some(2)))),
            ("torque", Some(Guess::Axis("tau", None))),
            ("desired_position_1", None),
            ("Axis 1.ActPos", Some(Guess::Axis("q", Some(1)))),
            ("ActVelo", Some(Guess::Axis("qd", None))),
            ("ActTrq", Some(Guess::Axis("tau", None))),
            ("Actual Torque", Some(Guess::Axis("tau", None))),
            ("Axis_1.ActualPosition", Some(Guess::Axis("q", Some(1)))),
            ("axis0.encoder.pos_estimate", Some(Guess::Axis("q", Some(0)))),
            ("Iq_measured", Some(Guess::Axis(CURRENT, None))),
            ("Iq_setpoint", None),
            ("Present Position", Some(Guess::Axis("q", None))),
            ("present_current", Some(Guess::Axis(CURRENT, None))),
            ("tau_J_3", Some(Guess::Axis("tau", Some(3)))),
            ("dq_2", Some(Guess::Axis("qd", Some(2)))),
            ("MACur.A1", None),
            ("Reference Velocity", None),
            ("field.position0", Some(Guess::Axis("q", Some(0)))),
            ("Zeit", Some(Guess::Time)),
            ("Drehmoment", Some(Guess::Axis("tau", None))),
            ("temperature_1", None),
            ("note", None),
            ("q1_2", None),
            ("", None),
        ] {
            assert_eq!(guess(&Header::new(text).base), expected, "{text}");
        }
    }

    #[test]
    fn units_stand_in_brackets_or_at_the_end() {
        let parts = |text: &str| {
            let h = Header::new(text);
            (h.base, h.unit)
        };
        assert_eq!(parts("q1 [deg]"), ("q1".into(), Some("deg".into())));
        assert_eq!(parts("Time (s)"), ("Time".into(), Some("s".into())));
        assert_eq!(parts("time_ms"), ("time".into(), Some("ms".into())));
        assert_eq!(parts("tau1_Nm"), ("tau1".into(), Some("Nm".into())));
        assert_eq!(parts("current_A"), ("current".into(), Some("A".into())));
        assert_eq!(parts("phase_A"), ("phase_A".into(), None));
        assert_eq!(parts("ee_x"), ("ee_x".into(), None));
        assert_eq!(parts("position[0]"), ("position[0]".into(), None));
        assert_eq!(parts("joint_1"), ("joint_1".into(), None));
    }
}
