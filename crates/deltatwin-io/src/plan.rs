//! Path files: TOML → [`Task`], with errors that state file, line, key, value and what was expected.

use std::ops::Range;
use std::path::Path;

use deltatwin::constraint_forces::Detail;
use deltatwin::machine::{PerAxis, Setup, every_axis};
use deltatwin::planner::shape::first_corner;
use deltatwin::planner::{Limits, Objective, Options, Shape, Task};
use serde::Deserialize;
use toml::Spanned;
use toml::de::DeValue;

use crate::kind;
use crate::outside::Access;
use crate::scenario::ScenarioError;
use crate::scenario::read::cell::{LoadKeys, payload};
use crate::source::{Checked, Interval, Source};

type Result<T> = std::result::Result<T, ScenarioError>;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    payload: Option<LoadKeys>,
    #[serde(default)]
    limits: LimitKeys,
    #[serde(default)]
    search: SearchKeys,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, default)]
struct LimitKeys {
    margin: Option<Spanned<f64>>,
    speed: Option<Spanned<Vec<f64>>>,
    acceleration: Option<Spanned<Vec<f64>>>,
    jerk: Option<Spanned<Vec<f64>>>,
    torque: Option<Spanned<Vec<f64>>>,
    bearing_moment: Option<Spanned<f64>>,
    bearing_force: Option<Spanned<f64>>,
    strut_lower: Option<Spanned<f64>>,
    strut_upper: Option<Spanned<f64>>,
    forces: Option<Spanned<String>>,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, default)]
struct SearchKeys {
    intervals: Option<Spanned<i64>>,
    objective: Option<Spanned<String>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LineKeys {
    points: Vec<Spanned<[f64; 4]>>,
    blend: Option<Spanned<f64>>,
    turn_radius: Option<Spanned<f64>>,
    #[serde(default)]
    closed: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ThroughKeys {
    points: Vec<Spanned<[f64; 4]>>,
    turn_radius: Option<Spanned<f64>>,
    #[serde(default)]
    closed: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SplineKeys {
    points: Vec<Spanned<[f64; 4]>>,
    degree: Option<Spanned<i64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ArchKeys {
    from: Spanned<[f64; 4]>,
    to: Spanned<[f64; 4]>,
    height: Spanned<f64>,
    blend: Spanned<f64>,
    turn_radius: Option<Spanned<f64>>,
}

/// Default path length of a rotation by 1 rad, m.
const TURN_RADIUS: f64 = 0.1;
/// Default number of intervals without jerk limits, at which computation is fast.
const WITHOUT_JERK: usize = 1000;
/// Smallest distance between consecutive waypoints, m.
const NEAREST: f64 = 1e-3;

/// Reads a path file without solids; limits that it omits are taken from `given`.
///
/// # Errors
/// A [`ScenarioError`]: the file cannot be read, or the first error in it, with its position.
pub fn read(path: &Path, given: Limits) -> Result<Task> {
    read_with(path, given, Access::PLAIN)
}

/// Reads a path file like [`read`], with `access` to the files it names.
///
/// # Errors
/// As for [`read`].
pub fn read_with(path: &Path, given: Limits, access: Access) -> Result<Task> {
    let text = ScenarioError::text(path)?;
    parse_with(&text, path, given, access).map_err(|e| e.unless_other(kind::Kind::Path, &text, path))
}

/// Reads a path file from `text`; `path` is named in errors.
///
/// # Errors
/// The first error in the text, with its position.
pub fn parse(text: &str, path: &Path, given: Limits) -> Result<Task> {
    parse_with(text, path, given, Access::PLAIN)
}

fn parse_with(text: &str, path: &Path, given: Limits, access: Access) -> Result<Task> {
    let file = &Source { access, ..Source::new(path.display(), text) };
    let (document, shape) = file.document::<Document>("path")?;
    let Some(shape) = shape else {
        return Err(file.problem(0..0, "[path] is missing; expected the path to follow".into()).into());
    };
    let setup = match &document.payload {
        Some(keys) => {
            file.foreign("payload.drag_factor", &keys.drag_factor, "a path; the model's payload_drag acts in plans")?;
            Setup { payload: payload(file, keys)?.0, ..Setup::default() }
        }
        None => Setup::default(),
    };
    let limits = limits(file, &document.limits, given)?;
    Ok(Task {
        name: path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
        shape: read_shape(file, shape)?,
        setup,
        limits,
        options: options(file, &document.search, &limits)?,
    })
}

fn limits(file: &Source, keys: &LimitKeys, given: Limits) -> Checked<Limits> {
    // An axis that the model does not have is not limited.
    let own = match given.torque.iter().filter(|limit| limit.is_finite()).count() {
        0 => every_axis().len(),
        own => own,
    };
    let axes = |key: &str, value: &Option<Spanned<Vec<f64>>>, default: PerAxis<f64>, most: f64, unit: &str| {
        let Some(value) = value else { return Ok(default) };
        let key = format!("limits.{key}");
        let mut limit = file.per_axis(&key, value, Interval(1e-3, most, unit))?;
        let count = value.get_ref().len();
        if count != own {
            return Err(
                file.problem(value.span(), format!("`{key}` has {count} numbers; expected {own}, one per axis"))
            );
        }
        limit[own..].fill(f64::INFINITY);
        Ok(limit)
    };
    let force = |key: &str, value: &Option<Spanned<f64>>, unit: &str| {
        file.optional(&format!("limits.{key}"), value, f64::INFINITY, Interval(1e-3, 1e6, unit))
    };
    Ok(Limits {
        speed: axes("speed", &keys.speed, given.speed, 1e4, "rad/s")?,
        acceleration: axes("acceleration", &keys.acceleration, given.acceleration, 1e6, "rad/s²")?,
        jerk: axes("jerk", &keys.jerk, given.jerk, f64::INFINITY, "rad/s³ (inf for none)")?,
        torque: axes("torque", &keys.torque, given.torque, 1e5, "N·m")?,
        bearing_moment: force("bearing_moment", &keys.bearing_moment, "N·m")?,
        bearing_force: force("bearing_force", &keys.bearing_force, "N")?,
        strut_lower: force("strut_lower", &keys.strut_lower, "N")?,
        strut_upper: force("strut_upper", &keys.strut_upper, "N")?,
        margin: file.optional("limits.margin", &keys.margin, given.margin, Interval(0.0, 0.9, ""))?,
        detail: match &keys.forces {
            Some(word) => {
                file.choice("limits.forces", word, &[("complete", Detail::Complete), ("reduced", Detail::Reduced)])?
            }
            None => given.detail,
        },
    })
}

fn options(file: &Source, keys: &SearchKeys, limits: &Limits) -> Checked<Options> {
    let default = Options::default();
    Ok(Options {
        intervals: match &keys.intervals {
            Some(n) => file.count("search.intervals", n, 20, 5000)?,
            None if limits.has_jerk() => default.intervals,
            None => WITHOUT_JERK,
        },
        objective: match &keys.objective {
            Some(word) => {
                file.choice("search.objective", word, &[("time", Objective::Time), ("speed", Objective::Speed)])?
            }
            None => default.objective,
        },
        ..default
    })
}

#[derive(Clone, Copy)]
enum Kind {
    Lines,
    BSpline,
    Through,
    Arch,
}

fn read_shape(file: &Source, mut value: Spanned<DeValue>) -> Checked<Shape> {
    let span = value.span();
    let word = file.kind("path", "path", &mut value)?;
    let kinds = [("lines", Kind::Lines), ("b_spline", Kind::BSpline), ("through", Kind::Through), ("arch", Kind::Arch)];
    let radius =
        |value: &Option<Spanned<f64>>| file.optional("path.turn_radius", value, TURN_RADIUS, Interval(1e-3, 10.0, "m"));
    let blend = |value: &Spanned<f64>| file.within("path.blend", value, Interval(1e-3, 10.0, "m"));
    let kind = file.choice("path.kind", &word, &kinds)?;
    match kind {
        Kind::Lines => {
            let keys: LineKeys = file.keys("path", value)?;
            let turn_radius = radius(&keys.turn_radius)?;
            let points = points(file, &keys.points, 2, keys.closed, turn_radius, &span)?;
            let blend = match (&keys.blend, first_corner(&points, turn_radius)) {
                (Some(value), _) => blend(value)?,
                (None, None) => 0.0,
                (None, Some(i)) => {
                    let message = format!(
                        "`path.blend` is missing; expected the distance in m from a corner at which its blend begins, \
                         because the path has a corner at point {}",
                        i + 1
                    );
                    return Err(file.problem(keys.points[i].span(), message));
                }
            };
            Ok(Shape::Lines { points, blend, turn_radius })
        }
        Kind::Through => {
            let keys: ThroughKeys = file.keys("path", value)?;
            let turn_radius = radius(&keys.turn_radius)?;
            Ok(Shape::Through { points: points(file, &keys.points, 2, keys.closed, turn_radius, &span)?, turn_radius })
        }
        Kind::BSpline => {
            let keys: SplineKeys = file.keys("path", value)?;
            let degree = match &keys.degree {
                Some(n) => file.count("path.degree", n, 4, 7)?,
                None => 5,
            };
            let points = points(file, &keys.points, degree + 1, false, TURN_RADIUS, &span)?;
            Ok(Shape::BSpline { points, degree })
        }
        Kind::Arch => {
            let keys: ArchKeys = file.keys("path", value)?;
            let turn_radius = radius(&keys.turn_radius)?;
            let height = file.within("path.height", &keys.height, Interval(NEAREST, 2.0, "m"))?;
            let ends = [pose(file, "path.from", &keys.from)?, pose(file, "path.to", &keys.to)?];
            let shape = Shape::arch(ends[0], ends[1], height, blend(&keys.blend)?, turn_radius);
            if let Shape::Lines { points, .. } = &shape
                && let Some(i) = too_near(points, turn_radius)
            {
                let message = format!("`path` has corners {} and {} less than {NEAREST} m apart", i + 1, i + 2);
                return Err(file.problem(span, message));
            }
            Ok(shape)
        }
    }
}

fn pose(file: &Source, key: &str, value: &Spanned<[f64; 4]>) -> Checked<[f64; 4]> {
    file.numbers(key, value, Interval(-1e3, 1e3, "in m (x, y, z) and rad (ψ)"))
}

/// Index of the first of two consecutive points that are too close.
fn too_near(points: &[[f64; 4]], turn_radius: f64) -> Option<usize> {
    points.windows(2).position(|w| {
        let turn = turn_radius * (w[1][3] - w[0][3]);
        (0..3).map(|i| (w[1][i] - w[0][i]).powi(2)).sum::<f64>() + turn * turn < NEAREST * NEAREST
    })
}

fn points(
    file: &Source,
    values: &[Spanned<[f64; 4]>],
    least: usize,
    closed: bool,
    turn_radius: f64,
    span: &Range<usize>,
) -> Checked<Vec<[f64; 4]>> {
    if values.len() < least || values.len() > 1000 {
        let message = format!("`path.points` has {} points; expected {least} to 1000", values.len());
        return Err(file.problem(span.clone(), message));
    }
    let mut points = values.iter().map(|v| pose(file, "path.points", v)).collect::<Checked<Vec<_>>>()?;
    if closed {
        points.push(points[0]);
    }
    match too_near(&points, turn_radius) {
        Some(i) => {
            let at = values.get(i + 1).unwrap_or(&values[0]).span();
            Err(file.problem(at, format!("points {} and {} are less than {NEAREST} m apart", i + 1, i + 2)))
        }
        None => Ok(points),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const GOOD: &str = "[path]\nkind = \"lines\"\npoints = [[0, 0, -1, 0], [0.1, 0, -1, 0], [0.1, 0.1, -1, 0]]\n\
                        blend = 0.02\n[payload]\nmass = 1.0\n[limits]\nstrut_upper = 120.0\n";

    fn parse(text: &str) -> Result<Task> {
        super::parse(text, Path::new("p.toml"), Limits::NONE)
    }

    #[test]
    fn what_is_left_out_is_given() {
        let task = parse(GOOD).unwrap();
        assert_eq!(task.limits.strut_upper, 120.0);
        assert_eq!(task.limits.bearing_force, f64::INFINITY);
        // Without other limits there is no jerk limit.
        let expected = Options { intervals: 1000, ..Options::default() };
        let chosen = |o: &Options| (o.intervals, o.objective, o.certify, o.tighten, o.refine);
        assert_eq!((chosen(&task.options), task.setup.payload.mass), (chosen(&expected), 1.0));
        let limited = parse(&format!("{GOOD}jerk = [1e3, 1e3, 1e3, 1e3]\n")).unwrap();
        assert_eq!(chosen(&limited.options), chosen(&Options::default()));
    }

    #[test]
    fn mistakes_are_named_with_line_and_value() {
        for (from, to, expected) in [
            ("\"lines\"", "\"spiral\"", "p.toml:2:8: `path.kind` is \"spiral\""),
            ("blend = 0.02", "blend = -1", "p.toml:4:9: `path.blend` is -1"),
            ("blend = 0.02", "blned = 1", "unknown key `path.blned`"),
            ("[0.1, 0, -1, 0]", "[0, 0, -1, 0]", "p.toml:3:26: points 1 and 2 are less than 0.001 m apart"),
            ("strut_upper = 120.0", "strut_upper = -3", "p.toml:8:15: `limits.strut_upper` is -3"),
            (
                "strut_upper = 120.0",
                "speed = [1, 2, 3]",
                "p.toml:8:9: `limits.speed` has 3 numbers; expected 4, one per axis",
            ),
            ("strut_upper = 120.0", "strut = 3", "p.toml:8:1: unknown key `limits.strut`"),
            ("[limits]", "[search]\nintervals = 3\n[limits]", "p.toml:8:13: `search.intervals` is 3"),
            ("[limits]", "[search]\nobjective = \"fun\"\n[limits]", "`search.objective` is \"fun\""),
            ("[path]", "[route]", "p.toml:1:2: unknown key `route`"),
            ("mass = 1.0", "mass = nan", "`payload.mass` is NaN"),
        ] {
            assert!(GOOD.contains(from), "{from}");
            let e = parse(&GOOD.replacen(from, to, 1)).unwrap_err().to_string();
            assert!(e.contains(expected), "{expected}\n{e}");
        }
    }

    proptest! {
        #[test]
        fn damaged_files_are_read_or_refused_with_a_place(
            file in prop::sample::select(vec!["u-turn", "cycle"]),
            at in any::<prop::sample::Index>(),
            length in 0..30usize,
            put in prop::sample::select(vec!["", "nan", "-1", "1e300", "inf", "[", "\"\"", "9223372036854775807", "ψ", "\n"]),
        ) {
            let path = format!("../../scenarios/{file}.toml");
            let text: Vec<char> = std::fs::read_to_string(&path).unwrap().chars().collect();
            let at = at.index(text.len());
            let end = (at + length).min(text.len());
            let damaged: String =
                text[..at].iter().copied().chain(put.chars()).chain(text[end..].iter().copied()).collect();
            match super::parse(&damaged, Path::new(&path), Limits::NONE) {
                Err(e) => prop_assert!(e.to_string().starts_with(&format!("{path}:")), "{e}"),
                Ok(task) => prop_assert!(task.shape.curve().end() == 1.0),
            }
        }
    }
}
