//! `[sockets]`, `[supervision]`, `[sensors]` and `[gains]`.

use serde::Deserialize;
use toml::Spanned;

use crate::source::{Checked, Interval, Source};
use deltatwin::machine::{PerSocket, PerStrut, each, every_strut, sockets_from};
use deltatwin::scenario::sockets::{MAX_SPRINGS, SocketSetup, spring_name};
use deltatwin::scenario::{Gains, Sensors, Supervision, Trip};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SocketKeys {
    #[serde(default)]
    armed: bool,
    hold: Option<Spanned<Vec<f64>>>,
    wear: Option<Spanned<Vec<f64>>>,
    #[serde(default)]
    missing_springs: Vec<Spanned<String>>,
    draw: Option<Spanned<DrawKeys>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DrawKeys {
    sigma: Spanned<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SupervisionKeys {
    torque: Option<Spanned<f64>>,
    tracking: Option<Spanned<f64>>,
    trip: Option<Spanned<String>>,
    brake_torque: Option<Spanned<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SensorKeys {
    #[serde(default)]
    strut_upper: Vec<Spanned<i64>>,
    #[serde(default)]
    strut_lower: Vec<Spanned<i64>>,
    record: Option<Vec<Spanned<String>>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct GainKeys {
    proportional: Option<Spanned<Vec<f64>>>,
    derivative: Option<Spanned<Vec<f64>>>,
    cutoff: Option<Spanned<f64>>,
}

pub(super) fn sockets(file: &Source, keys: &SocketKeys) -> Checked<SocketSetup> {
    let mut out = SocketSetup { armed: keys.armed, ..SocketSetup::default() };
    if let Some(hold) = &keys.hold {
        out.hold = Some(per_socket(file, "sockets.hold", hold, Interval(0.0, 1e6, "N"))?);
        out.given = hold.get_ref().len();
        let fixed = "sockets with `hold`, which is what is left of it";
        file.foreign("sockets.wear", &keys.wear, fixed)?;
        file.foreign("sockets.draw", &keys.draw, fixed)?;
    }
    if let Some(wear) = &keys.wear {
        out.wear = per_socket(file, "sockets.wear", wear, Interval(0.0, 1.0, "(shares of the hold)"))?;
        out.given = wear.get_ref().len();
    }
    if let Some(draw) = &keys.draw {
        out.sigma = Some(file.within("sockets.draw.sigma", &draw.get_ref().sigma, Interval(0.0, 1e5, "N"))?);
    }
    let names: Vec<String> = (0..MAX_SPRINGS).map(spring_name).collect();
    let choices: Vec<(&str, usize)> = names.iter().enumerate().map(|(i, n)| (n.as_str(), i)).collect();
    for name in &keys.missing_springs {
        let spring = file.choice("sockets.missing_springs", name, &choices)?;
        out.missing[spring] += 1;
        if out.missing[spring] > 2 {
            let message = format!(
                "`sockets.missing_springs` has {} a third time; expected each unit once per spring, of which it has two",
                name.get_ref()
            );
            return Err(file.problem(name.span(), message));
        }
    }
    Ok(out)
}

/// One number per socket, as many as a robot of some number of limbs has.
fn per_socket(file: &Source, key: &str, value: &Spanned<Vec<f64>>, interval: Interval) -> Checked<PerSocket<f64>> {
    let given = value.get_ref();
    let expected = format!("expected one number per socket (12 with three limbs, 4 more with every other) {interval}");
    if !given.len().is_multiple_of(4) || given.is_empty() || given.len() > sockets_from(0).len() {
        return Err(file.problem(value.span(), format!("`{key}` has {} value(s); {expected}", given.len())));
    }
    if let Some(v) = given.iter().find(|v| !interval.contains(**v)) {
        return Err(file.problem(value.span(), format!("`{key}` has {v}; {expected}")));
    }
    let mut out: PerSocket<f64> = each(0.0);
    out[..given.len()].copy_from_slice(given);
    Ok(out)
}

pub(super) fn supervision(file: &Source, keys: &SupervisionKeys) -> Checked<Supervision> {
    let brakes = match &keys.trip {
        Some(trip) => file.choice("supervision.trip", trip, &[("coast", false), ("brake", true)])?,
        None => false,
    };
    let trip = match (&keys.trip, brakes) {
        (Some(word), true) => {
            let torque =
                file.needed("supervision.brake_torque", &keys.brake_torque, "trip = \"brake\"", word.span())?;
            Trip::Brake { torque: file.within("supervision.brake_torque", torque, Interval(0.0, 1e5, "N·m"))? }
        }
        _ => {
            file.foreign("supervision.brake_torque", &keys.brake_torque, "trip = \"coast\"")?;
            Trip::Coast
        }
    };
    Ok(Supervision {
        torque: file.maybe("supervision.torque", &keys.torque, Interval(0.0, 1e5, "N·m"))?,
        tracking: file.maybe("supervision.tracking", &keys.tracking, Interval(0.0, 10.0, "rad"))?,
        trip,
    })
}

pub(super) fn sensors(file: &Source, keys: &SensorKeys) -> Checked<Sensors> {
    let mut out = Sensors {
        strut_upper: struts(file, "sensors.strut_upper", &keys.strut_upper)?,
        strut_lower: struts(file, "sensors.strut_lower", &keys.strut_lower)?,
        ..Sensors::default()
    };
    let Some(record) = &keys.record else { return Ok(out) };
    let mut kept = [false; 7];
    for name in record {
        let choices = [
            ("ee", 0),
            ("velocity", 1),
            ("acceleration", 2),
            ("sockets", 3),
            ("multipliers", 4),
            ("links", 5),
            ("load", 6),
        ];
        let i = file.choice("sensors.record", name, &choices)?;
        once(file, "sensors.record", &mut kept[i], name, "channel")?;
    }
    [out.ee, out.velocity, out.acceleration, out.sockets, out.multipliers, out.links, out.load] = kept;
    Ok(out)
}

fn struts(file: &Source, key: &str, numbers: &[Spanned<i64>]) -> Checked<PerStrut<bool>> {
    let mut fitted: PerStrut<bool> = each(false);
    for strut in numbers {
        let i = file.count(key, strut, 1, every_strut().end as i64)?;
        once(file, key, &mut fitted[i - 1], strut, "strut")?;
    }
    Ok(fitted)
}

/// Sets `flag`; an error if it is already set.
fn once<T: std::fmt::Display>(
    file: &Source,
    key: &str,
    flag: &mut bool,
    value: &Spanned<T>,
    what: &str,
) -> Checked<()> {
    if std::mem::replace(flag, true) {
        let message = format!("`{key}` has {} twice; expected every {what} once", value.get_ref());
        return Err(file.problem(value.span(), message));
    }
    Ok(())
}

pub(super) fn gains(file: &Source, keys: &GainKeys) -> Checked<Gains> {
    let each = |key: &str, value: &Option<Spanned<Vec<f64>>>, unit: &str| {
        value.as_ref().map(|v| file.per_axis(key, v, Interval(0.0, 1e7, unit))).transpose()
    };
    Ok(Gains {
        proportional: each("gains.proportional", &keys.proportional, "N·m/rad")?,
        derivative: each("gains.derivative", &keys.derivative, "N·m·s/rad")?,
        cutoff: file.maybe("gains.cutoff", &keys.cutoff, Interval(0.1, 1e5, "Hz"))?,
    })
}

#[cfg(test)]
mod tests {
    use super::super::tests::{GOOD, parse};
    use super::*;

    fn with(tables: &str) -> super::super::Result<deltatwin::scenario::Scenario> {
        parse(&format!("{GOOD}{tables}"))
    }

    const TWELVE: &str = "[0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0.5]";

    #[test]
    fn defaults_change_nothing() {
        let s = with("").unwrap();
        assert_eq!((s.sockets, s.supervision), (SocketSetup::default(), Supervision::default()));
        assert_eq!((s.sensors, s.gains), (Sensors::default(), Gains::default()));
        assert!(!s.sockets.armed && s.sensors.ee && s.supervision.torque.is_none());
    }

    #[test]
    fn all_keys_are_read() {
        let s = with(&format!(
            "[sockets]\narmed = true\nwear = {TWELVE}\nmissing_springs = [\"limb1_upper\"]\ndraw = {{ sigma = 5 }}\n\
             [supervision]\ntorque = 40\ntracking = 0.05\ntrip = \"brake\"\nbrake_torque = 30\n\
             [sensors]\nstrut_lower = [2]\nrecord = [\"velocity\", \"sockets\"]\n\
             [gains]\nproportional = [1, 2, 3, 4]\ncutoff = 80\n"
        ))
        .unwrap();
        assert!(
            s.sockets.armed && s.sockets.wear[11] == 0.5 && s.sockets.missing[0] == 1 && s.sockets.sigma == Some(5.0)
        );
        assert_eq!(s.supervision.trip, Trip::Brake { torque: 30.0 });
        assert_eq!((s.supervision.torque, s.supervision.tracking), (Some(40.0), Some(0.05)));
        assert!(s.sensors.strut_lower[1] && s.sensors.velocity && s.sensors.sockets);
        assert!(!s.sensors.ee && !s.sensors.acceleration && s.sensors.strut_upper == each(false));
        assert_eq!((s.gains.proportional, s.gains.derivative), (Some([1.0, 2.0, 3.0, 4.0]), None));
        let model = crate::model::read(&s.model).unwrap();
        let holds = s.socket_holds(&model);
        assert!(holds[0] < 120.0 && holds[1] < 120.0 && holds[2] > 150.0 && holds[11] < 130.0, "{holds:?}");
        let fixed = with(&format!("[sockets]\nhold = {TWELVE}\n")).unwrap();
        assert_eq!(fixed.socket_holds(&model)[11], 0.5);
    }

    #[test]
    fn mistakes_are_named_with_their_value() {
        for (tables, expected) in [
            ("[sockets]\nwear = [0.5]".into(), "`sockets.wear` has 1 value(s)"),
            (format!("[sockets]\nwear = {}", TWELVE.replace("0.5", "1.5")), "`sockets.wear` has 1.5"),
            (format!("[sockets]\nhold = {}", TWELVE.replace("0.5", "-1")), "`sockets.hold` has -1"),
            (format!("[sockets]\nhold = {TWELVE}\nwear = {TWELVE}"), "`sockets.wear` has no meaning"),
            ("[sockets]\nmissing_springs = [\"limb5_upper\"]".into(), "is \"limb5_upper\"; expected \"limb1_upper\", "),
            (
                "[sockets]\nmissing_springs = [\"limb1_upper\", \"limb1_upper\", \"limb1_upper\"]".into(),
                "limb1_upper a third time",
            ),
            ("[sockets]\ndraw = { sigma = -1 }".into(), "`sockets.draw.sigma` is -1"),
            ("[sockets]\ndraw = { mean = 1 }".into(), "unknown key `sockets.draw.mean`"),
            ("[sockets]\narm = true".into(), "unknown key `sockets.arm`"),
            ("[supervision]\ntorque = nan".into(), "`supervision.torque` is NaN"),
            (
                "[supervision]\ntrip = \"stop\"".into(),
                "`supervision.trip` is \"stop\"; expected \"coast\" or \"brake\"",
            ),
            ("[supervision]\ntrip = \"brake\"".into(), "trip = \"brake\" lacks `supervision.brake_torque`"),
            ("[supervision]\nbrake_torque = 3".into(), "no meaning for trip = \"coast\""),
            ("[sensors]\nstrut_lower = [9]".into(), "`sensors.strut_lower` is 9"),
            ("[sensors]\nstrut_upper = [1, 1]".into(), "`sensors.strut_upper` has 1 twice"),
            (
                "[sensors]\nrecord = [\"speed\"]".into(),
                "`sensors.record` is \"speed\"; expected \"ee\", \"velocity\", ",
            ),
            ("[gains]\nproportional = [1, 2]".into(), "`gains.proportional` has 2 number(s); expected one per axis"),
            ("[gains]\ncutoff = 0".into(), "`gains.cutoff` is 0"),
        ] {
            let e = with(&tables).unwrap_err().to_string();
            assert!(e.contains(expected) && e.contains("test.toml:"), "{expected}\n{e}");
        }
    }
}
