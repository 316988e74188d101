//! `[motion]`: one struct per kind.

use std::ops::Range;
use std::path::Path as FilePath;

use serde::Deserialize;
use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::DeValue;

use crate::source::{Checked, Interval, Source};
use deltatwin::machine::every_axis;
use deltatwin::scenario::motion::constant_speed::ConstantSpeed;
use deltatwin::scenario::motion::path::Path;
use deltatwin::scenario::motion::static_poses::StaticPoses;
use deltatwin::scenario::{Course, FourierMotion};

/// Default share of the limits, which leaves room for feedback and model errors.
const SHARE: f64 = 0.8;
const HARMONICS: usize = 5;
/// Largest number of harmonics of a given series; the check of a motion takes their square.
const MOST_HARMONICS: usize = 400;
/// Default path length of a rotation by 1 rad, m.
const TURN_RADIUS: f64 = 0.1;
/// Longest motion, s.
const LONGEST: f64 = 36000.0;

const KINDS: &[(&str, Reader)] = &[
    ("random_fourier", random_fourier),
    ("fourier", fourier),
    ("path", path),
    ("table", table),
    ("constant_speed", constant_speed),
    ("static_poses", static_poses),
];

/// Input of the reader of one kind.
struct Input<'a, 'i> {
    file: &'a Source<'a>,
    folder: &'a FilePath,
    /// The table without `kind`.
    value: Spanned<DeValue<'i>>,
}

type Reader = fn(Input) -> Checked<Course>;

impl Input<'_, '_> {
    fn keys<T: DeserializeOwned>(&self) -> Checked<T> {
        self.file.keys("motion", self.value.clone())
    }

    fn span(&self) -> Range<usize> {
        self.value.span()
    }
}

/// Reads `[motion]`; the files it names are relative to `folder`.
pub(super) fn course(file: &Source, folder: &FilePath, mut value: Spanned<DeValue>) -> Checked<Course> {
    let span = value.span();
    let read = file.choice("motion.kind", &file.kind("motion", "motion", &mut value)?, KINDS)?;
    let course = read(Input { file, folder, value })?;
    match course.length() {
        Some(length) if !(0.0..=LONGEST).contains(&length) => {
            Err(file.problem(span, format!("[motion] takes {length} s; expected at most {LONGEST} s")))
        }
        _ => Ok(course),
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RandomFourierKeys {
    frequency: Spanned<f64>,
    seed: Option<u64>,
    harmonics: Option<Spanned<i64>>,
    share: Option<Spanned<f64>>,
}

fn random_fourier(input: Input) -> Checked<Course> {
    let (file, keys) = (input.file, input.keys::<RandomFourierKeys>()?);
    Ok(Course::RandomFourier {
        seed: keys.seed.unwrap_or(0),
        frequency: frequency(file, &keys.frequency)?,
        harmonics: match &keys.harmonics {
            Some(n) => file.count("motion.harmonics", n, 1, 50)?,
            None => HARMONICS,
        },
        share: file.optional("motion.share", &keys.share, SHARE, Interval(0.01, 1.0, ""))?,
    })
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FourierKeys {
    frequency: Spanned<f64>,
    centre: Spanned<Vec<f64>>,
    #[serde(default)]
    sine: Vec<Spanned<Vec<f64>>>,
    #[serde(default)]
    cosine: Vec<Spanned<Vec<f64>>>,
}

fn fourier(input: Input) -> Checked<Course> {
    let (file, keys) = (input.file, input.keys::<FourierKeys>()?);
    let row = |key: &str, row: &Spanned<Vec<f64>>| coordinates(file, key, row);
    let rows = |key: &str, rows: &[Spanned<Vec<f64>>]| rows.iter().map(|r| row(key, r)).collect::<Checked<Vec<_>>>();
    let (mut sine, mut cosine) = (rows("motion.sine", &keys.sine)?, rows("motion.cosine", &keys.cosine)?);
    let harmonics = sine.len().max(cosine.len());
    if harmonics > MOST_HARMONICS {
        let message = format!("[motion] has {harmonics} harmonics; expected at most {MOST_HARMONICS} rows each");
        return Err(file.problem(input.span(), message));
    }
    sine.resize(harmonics, [0.0; 4]);
    cosine.resize(harmonics, [0.0; 4]);
    let centre = row("motion.centre", &keys.centre)?;
    Ok(Course::Fourier(FourierMotion { frequency: frequency(file, &keys.frequency)?, centre, sine, cosine }))
}

fn frequency(file: &Source, value: &Spanned<f64>) -> Checked<f64> {
    file.within("motion.frequency", value, Interval(1e-3, 20.0, "Hz"))
}

/// Coordinates of the motion: x, y, z and ψ of a platform (no ψ on a three-axis robot), or the angles of independent
/// axes.
///
/// Axis 4 may make many turns; lengths are checked against the workspace later.
fn coordinates(file: &Source, key: &str, value: &Spanned<Vec<f64>>) -> Checked<[f64; 4]> {
    file.per_axis(key, value, Interval(-1e3, 1e3, "(m for x, y, z; rad for angles)"))
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PathKeys {
    waypoints: Vec<Spanned<Vec<f64>>>,
    speed: Spanned<f64>,
    acceleration: Spanned<f64>,
    jerk: Spanned<f64>,
    blend: Option<Spanned<f64>>,
    turn_radius: Option<Spanned<f64>>,
    #[serde(default)]
    stops: Vec<Spanned<i64>>,
    dwell: Option<Spanned<f64>>,
    #[serde(default)]
    closed: bool,
    repeat: Option<Spanned<i64>>,
}

fn path(input: Input) -> Checked<Course> {
    let (file, keys) = (input.file, input.keys::<PathKeys>()?);
    let path = Path {
        waypoints: waypoints(file, &input, "motion.waypoints", &keys.waypoints, 2, keys.closed)?,
        blend: file.optional("motion.blend", &keys.blend, 0.0, Interval(0.0, 1.0, "m"))?,
        speed: file.within("motion.speed", &keys.speed, Interval(1e-4, 20.0, "m/s"))?,
        acceleration: file.within("motion.acceleration", &keys.acceleration, Interval(1e-3, 500.0, "m/s²"))?,
        jerk: file.within("motion.jerk", &keys.jerk, Interval(1e-2, 1e5, "m/s³"))?,
        turn_radius: file.optional("motion.turn_radius", &keys.turn_radius, TURN_RADIUS, Interval(1e-3, 10.0, "m"))?,
        stops: stops(file, &keys)?,
        dwell: file.optional("motion.dwell", &keys.dwell, 0.0, Interval(0.0, 3600.0, "s"))?,
        closed: keys.closed,
        laps: match &keys.repeat {
            Some(n) if !keys.closed && *n.get_ref() != 1 => {
                let message = "`motion.repeat` needs closed = true; expected a path that ends where it begins".into();
                return Err(file.problem(n.span(), message));
            }
            Some(n) => file.count("motion.repeat", n, 1, 100_000)?,
            None => 1,
        },
    };
    Ok(Course::Path(path))
}

/// Stops, numbered from 1 in the file and from 0 in the result; they must be in ascending order.
fn stops(file: &Source, keys: &PathKeys) -> Checked<Vec<usize>> {
    let last = keys.waypoints.len() as i64 - i64::from(!keys.closed);
    let mut out: Vec<usize> = Vec::new();
    for stop in &keys.stops {
        if last < 2 {
            let message = "`motion.stops` has no meaning without inner waypoints; expected it to be left out".into();
            return Err(file.problem(stop.span(), message));
        }
        let i = file.count("motion.stops", stop, 2, last)? - 1;
        if out.last().is_some_and(|before| i <= *before) {
            let message = format!("`motion.stops` has {} out of order; expected increasing numbers", i + 1);
            return Err(file.problem(stop.span(), message));
        }
        out.push(i);
    }
    Ok(out)
}

/// Poses of which consecutive ones must differ.
fn waypoints(
    file: &Source,
    input: &Input,
    key: &str,
    rows: &[Spanned<Vec<f64>>],
    least: usize,
    closed: bool,
) -> Checked<Vec<[f64; 4]>> {
    if !(least..=MOST_POSES).contains(&rows.len()) {
        let message = format!("`{key}` has {} row(s); expected {least} to {MOST_POSES} rows x, y, z, ψ", rows.len());
        return Err(file.problem(input.span(), message));
    }
    let mut out: Vec<[f64; 4]> = Vec::with_capacity(rows.len());
    for row in rows {
        let row_here = coordinates(file, key, row)?;
        let same = |other: Option<&[f64; 4]>| {
            other.is_some_and(|o| o.iter().zip(row_here).all(|(a, b)| (a - b).abs() < NEAREST))
        };
        let wraps = closed && out.len() + 1 == rows.len() && same(out.first());
        if same(out.last()) || wraps {
            let message = format!("`{key}` has {row_here:?} twice in a row; expected neighbours to differ");
            return Err(file.problem(row.span(), message));
        }
        out.push(row_here);
    }
    Ok(out)
}

const MOST_POSES: usize = 100_000;
/// Distance below which two poses count as equal, m or rad.
const NEAREST: f64 = 1e-6;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TableKeys {
    file: Spanned<String>,
    ends: Option<Spanned<String>>,
}

fn table(input: Input) -> Checked<Course> {
    let (file, keys) = (input.file, input.keys::<TableKeys>()?);
    let moving = match &keys.ends {
        Some(ends) => file.choice("motion.ends", ends, &[("rest", false), ("moving", true)])?,
        None => false,
    };
    let name = keys.file.get_ref();
    file.may_name("motion.file", &keys.file, &input.folder.join(name))?;
    let table = super::super::table::read(&input.folder.join(name), moving)
        .map_err(|e| file.problem(keys.file.span(), format!("`motion.file` is \"{name}\": {e}")))?;
    Ok(Course::Table(table))
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ConstantSpeedKeys {
    axis: Spanned<i64>,
    pose: Spanned<Vec<f64>>,
    between: Spanned<[f64; 2]>,
    speeds: Vec<Spanned<f64>>,
    acceleration: Spanned<f64>,
    repeat: Option<Spanned<i64>>,
}

fn constant_speed(input: Input) -> Checked<Course> {
    let (file, keys) = (input.file, input.keys::<ConstantSpeedKeys>()?);
    let runs = ConstantSpeed {
        axis: file.count("motion.axis", &keys.axis, 1, every_axis().end as i64)? - 1,
        pose: coordinates(file, "motion.pose", &keys.pose)?,
        between: file.numbers("motion.between", &keys.between, Interval(-1e4, 1e4, "rad"))?,
        speeds: keys
            .speeds
            .iter()
            .map(|v| file.within("motion.speeds", v, Interval(1e-4, 1e3, "rad/s")))
            .collect::<Checked<Vec<f64>>>()?,
        acceleration: file.within("motion.acceleration", &keys.acceleration, Interval(1e-3, 1e5, "rad/s²"))?,
        repeat: match &keys.repeat {
            Some(n) => file.count("motion.repeat", n, 1, 1000)?,
            None => 1,
        },
    };
    if !(1..=1000).contains(&runs.speeds.len()) {
        let message = format!("`motion.speeds` has {} entries; expected 1 to 1000 speeds", runs.speeds.len());
        return Err(file.problem(input.span(), message));
    }
    let range = (runs.between[1] - runs.between[0]).abs();
    for (speed, place) in runs.speeds.iter().zip(&keys.speeds) {
        let ramps = runs.ramps(*speed);
        if ramps > range {
            let message = format!(
                "`motion.speeds` has {speed} rad/s, which takes {ramps:.3} rad to reach and to leave; \
                 expected `between` to be that far apart, not {range:.3} rad"
            );
            return Err(file.problem(place.span(), message));
        }
    }
    Ok(Course::ConstantSpeed(runs))
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct StaticPosesKeys {
    poses: Vec<Spanned<Vec<f64>>>,
    hold: Spanned<f64>,
    #[serde(rename = "move")]
    travel: Spanned<f64>,
}

fn static_poses(input: Input) -> Checked<Course> {
    let (file, keys) = (input.file, input.keys::<StaticPosesKeys>()?);
    Ok(Course::StaticPoses(StaticPoses {
        poses: waypoints(file, &input, "motion.poses", &keys.poses, 1, false)?,
        hold: file.within("motion.hold", &keys.hold, Interval(0.0, 3600.0, "s"))?,
        travel: file.within("motion.move", &keys.travel, Interval(1e-3, 3600.0, "s"))?,
    }))
}

#[cfg(test)]
mod tests {
    use super::super::tests::{HEAD, parse};
    use super::*;

    const PATH: &str = "[motion]\nkind = \"path\"\nwaypoints = [[0, 0, -1, 0], [0.1, 0, -1, 0], [0.1, 0.1, -1, 0]]\n\
                        speed = 1.0\nacceleration = 20\njerk = 1000\n";
    const RUNS: &str = "[motion]\nkind = \"constant_speed\"\naxis = 4\npose = [0, 0, -1, 0]\nbetween = [0, 6]\n\
                        speeds = [1, 5]\nacceleration = 50\n";
    const POSES: &str =
        "[motion]\nkind = \"static_poses\"\nposes = [[0, 0, -1, 0], [0, 0, -0.9, 0]]\nhold = 0.5\nmove = 0.2\n";
    const TABLE: &str = "[motion]\nkind = \"table\"\nfile = \"tables/circle.csv\"\n";

    fn refusal(motion: &str, from: &str, to: &str) -> String {
        assert!(motion.contains(from));
        parse(&format!("{HEAD}{}", motion.replace(from, to))).unwrap_err().to_string()
    }

    #[test]
    fn every_kind_is_read() {
        for (motion, length) in [(POSES, 1.2), (RUNS, 2.0 * (6.0 + 6.0 / 5.0) + 2.0 * 1.5 * (1.0 + 5.0) / 50.0)] {
            let scenario = parse(&format!("{HEAD}{motion}")).unwrap();
            assert!((scenario.motion.length().unwrap() - length).abs() < 1e-9, "{motion}");
            assert_eq!(scenario.duration, 1.0);
        }
        let Course::Path(path) =
            parse(&format!("{HEAD}{PATH}closed = true\nrepeat = 2\nstops = [2, 3]")).unwrap().motion
        else {
            panic!("not a path")
        };
        assert!(path.closed && path.laps == 2 && path.stops == [1, 2] && path.blend == 0.0);
        let Course::Table(table) = parse(&format!("{HEAD}{TABLE}ends = \"moving\"")).unwrap().motion else {
            panic!("not a table")
        };
        assert!(table.moving && table.t.len() > 2);
    }

    #[test]
    fn a_run_is_as_long_as_its_motion_by_default() {
        let head = HEAD.replace("duration = 1.0\n", "");
        assert!((parse(&format!("{head}{POSES}")).unwrap().duration - 1.2).abs() < 1e-12);
        let endless = format!("{head}[motion]\nkind = \"random_fourier\"\nfrequency = 1\n");
        assert!(parse(&endless).unwrap_err().to_string().contains("lacks `duration`"));
        let long = HEAD.replace("1.0", "1000.0");
        let e = parse(&format!("{long}{TABLE}ends = \"moving\"")).unwrap_err().to_string();
        assert!(e.contains("test.toml:2:") && e.contains("1000"), "{e}");
    }

    #[test]
    fn mistakes_are_named_with_line_and_value() {
        for (motion, from, to, expected) in [
            (PATH, "kind = \"path\"\n", "", "lacks `kind`"),
            (PATH, "\"path\"", "\"spiral\"", ":4:8: `motion.kind` is \"spiral\"; expected \"random_fourier\", "),
            (PATH, "\"path\"", "3", ":4:8: "),
            (PATH, "speed = 1.0\n", "", "[motion]: missing key `speed`"),
            (PATH, "speed = 1.0", "speed = nan", ":6:9: `motion.speed` is NaN"),
            (PATH, "jerk = 1000", "jerk = 1000\nshare = 0.5", ":9:1: unknown key `motion.share`"),
            (PATH, "[0.1, 0, -1, 0]", "[0, 0, -1, 0]", ":5:29: `motion.waypoints` has [0.0, 0.0, -1.0, 0.0] twice"),
            (PATH, "[0.1, 0, -1, 0]", "[0, -1]", ":5:29: `motion.waypoints` has 2 number(s); expected one per axis"),
            (PATH, "[0.1, 0, -1, 0], [0.1, 0.1, -1, 0]", "", "`motion.waypoints` has 1 row(s)"),
            (PATH, "[0.1, 0.1, -1, 0]]", "[0, 0, -1, 0]]\nclosed = true", "twice in a row"),
            (PATH, "jerk = 1000", "jerk = 1000\nrepeat = 2", ":9:10: `motion.repeat` needs closed"),
            (PATH, "jerk = 1000", "jerk = 1000\nstops = [3]", ":9:10: `motion.stops` is 3; expected a whole number"),
            (RUNS, "axis = 4", "axis = 5", ":5:8: `motion.axis` is 5"),
            (RUNS, "[1, 5]", "[1, 50]", ":8:14: `motion.speeds` has 50 rad/s, which takes 75.000 rad"),
            (RUNS, "[1, 5]", "[]", "`motion.speeds` has 0 entries"),
            (RUNS, "[0, 6]", "[0, inf]", ":7:11: `motion.between` has inf"),
            (POSES, "hold = 0.5", "hold = -0.5", ":6:8: `motion.hold` is -0.5"),
            (POSES, "move = 0.2", "", "missing key `move`"),
            (TABLE, "circle", "square", ":5:8: `motion.file` is \"tables/square.csv\": cannot be read"),
            (
                TABLE,
                "table\"",
                "table\"\nends = \"open\"",
                ":5:8: `motion.ends` is \"open\"; expected \"rest\" or \"moving\"",
            ),
        ] {
            let e = refusal(motion, from, to);
            assert!(e.contains(expected), "{expected}\n{e}");
        }
    }
}
