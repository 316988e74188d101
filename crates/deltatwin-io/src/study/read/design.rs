//! `[design]` → [`Design`].

use deltatwin::text::nearest;
use serde::Deserialize;
use toml::Spanned;
use toml::de::DeValue;

use super::factors::MOST_LEVELS;
use crate::source::{Checked, Interval, Source};
use crate::study::Design;
use crate::study::factor::{Factor, Range};

/// Largest number of runs of a study.
const MOST_RUNS: i64 = 100_000_000;
/// Default number of rays of two factors or more.
const RAYS: i64 = 16;
/// Default tolerance of a boundary point, as a share of its ray.
const TOLERANCE: f64 = 1e-3;
/// Defaults of subset simulation: samples per level, conditional probability, levels (Au & Beck 2001).
const SUBSET: (i64, f64, i64) = (1000, 0.1, 10);
/// Least number of samples with which a level of a subset simulation begins.
const SEEDS: f64 = 10.0;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DesignKeys {
    runs: Option<Spanned<i64>>,
    samples: Option<Spanned<i64>>,
    repeats: Option<Spanned<i64>>,
    along: Option<Spanned<Vec<Spanned<String>>>>,
    rays: Option<Spanned<i64>>,
    tolerance: Option<Spanned<f64>>,
    share: Option<Spanned<f64>>,
    levels: Option<Spanned<i64>>,
}

/// Word for a kind of design, and the keys that it has.
#[derive(Clone, Copy, PartialEq)]
enum Form {
    Grid,
    LatinHypercube,
    Sobol,
    MonteCarlo,
    Sensitivity,
    Boundary,
    WorstCase,
    Subset,
}

const FORMS: &[(&str, Form)] = &[
    ("grid", Form::Grid),
    ("latin_hypercube", Form::LatinHypercube),
    ("sobol", Form::Sobol),
    ("monte_carlo", Form::MonteCarlo),
    ("sensitivity", Form::Sensitivity),
    ("boundary", Form::Boundary),
    ("worst_case", Form::WorstCase),
    ("subset", Form::Subset),
];

/// Rejects the keys of a design that are none of its `own`.
fn only_keys(file: &Source, keys: &DesignKeys, own: &[&str], context: &str) -> Checked<()> {
    let is_foreign = |name: &str| !own.contains(&name);
    let key = |name: &str| format!("design.{name}");
    for (name, value) in [
        ("runs", &keys.runs),
        ("samples", &keys.samples),
        ("repeats", &keys.repeats),
        ("rays", &keys.rays),
        ("levels", &keys.levels),
    ] {
        if is_foreign(name) {
            file.foreign(&key(name), value, context)?;
        }
    }
    for (name, value) in [("tolerance", &keys.tolerance), ("share", &keys.share)] {
        if is_foreign(name) {
            file.foreign(&key(name), value, context)?;
        }
    }
    if is_foreign("along") { file.foreign("design.along", &keys.along, context) } else { Ok(()) }
}

/// The design of a study over its `factors`.
pub(super) fn design(file: &Source, mut value: Spanned<DeValue>, factors: &[Factor]) -> Checked<Design> {
    let kind = file.kind("design", "design", &mut value)?;
    let form = file.choice("design.kind", &kind, FORMS)?;
    let keys: DesignKeys = file.keys("design", value)?;
    let context = format!("kind = \"{}\"", kind.get_ref());
    let foreign = |own: &[&str]| only_keys(file, &keys, own, &context);
    let number = |name: &str, value: &Option<Spanned<i64>>, most: i64| {
        let key = format!("design.{name}");
        let value = file.needed(&key, value, &context, kind.span())?;
        file.count(&key, value, 1, most).map(|n| n as u64)
    };
    let repeats =
        || keys.repeats.as_ref().map_or(Ok(1), |n| file.count("design.repeats", n, 1, 1_000_000)).map(|n| n as u64);
    Ok(match form {
        Form::Grid => {
            foreign(&["repeats"])?;
            if let Some(factor) = factors.iter().find(|f| matches!(f.range, Range::Interval { .. })) {
                let message =
                    format!("factor `{}` lacks `count`; expected the number of its levels in a grid", factor.name);
                return Err(file.problem(factor.place.clone(), message));
            }
            Design::Grid { repeats: repeats()? }
        }
        Form::LatinHypercube | Form::Sobol | Form::MonteCarlo | Form::WorstCase => {
            foreign(&["runs"])?;
            let runs = number("runs", &keys.runs, MOST_RUNS)?;
            match form {
                Form::LatinHypercube => Design::LatinHypercube { runs },
                Form::Sobol => Design::Sobol { runs },
                Form::MonteCarlo => Design::MonteCarlo { runs },
                _ => Design::WorstCase { runs },
            }
        }
        Form::Sensitivity => {
            foreign(&["samples"])?;
            Design::Sensitivity { samples: number("samples", &keys.samples, MOST_RUNS / 100)? }
        }
        Form::Boundary => {
            foreign(&["along", "rays", "tolerance", "repeats"])?;
            boundary(file, &keys, factors, (&kind, repeats()?))?
        }
        Form::Subset => {
            foreign(&["samples", "share", "levels"])?;
            let (samples, share, levels) = SUBSET;
            let count = |name: &str, value: &Option<Spanned<i64>>, default: i64, low: i64, high: i64| {
                value.as_ref().map_or(Ok(default as usize), |n| file.count(&format!("design.{name}"), n, low, high))
            };
            if let Some(factor) = factors.iter().find(|f| matches!(f.range, Range::Levels(_))) {
                let message = format!(
                    "factor `{}` has levels; expected a `distribution`, or `from` and `to`, in a subset simulation",
                    factor.name
                );
                return Err(file.problem(factor.place.clone(), message));
            }
            let samples = count("samples", &keys.samples, samples, 20, 1_000_000)?;
            let share = file.optional("design.share", &keys.share, share, Interval(0.01, 0.5, ""))?;
            let least = (SEEDS / share).ceil() as usize;
            if samples < least {
                let message = format!(
                    "`design.samples` is {samples}, of which {share} begin the next level; expected at least {least}"
                );
                return Err(file.problem(kind.span(), message));
            }
            Design::Subset {
                samples: samples as u64,
                share,
                levels: count("levels", &keys.levels, levels, 1, 50)? as u64,
            }
        }
    })
}

fn boundary(
    file: &Source,
    keys: &DesignKeys,
    factors: &[Factor],
    (kind, repeats): (&Spanned<String>, u64),
) -> Checked<Design> {
    let names = file.needed("design.along", &keys.along, "kind = \"boundary\"", kind.span())?;
    let mut along = Vec::new();
    for name in names.get_ref() {
        let k = named(file, "design.along", name, factors)?;
        if along.contains(&k) || !matches!(factors[k].range, Range::Interval { .. }) {
            let message = format!(
                "`design.along` has \"{}\"; expected each factor once, with `from` and `to` and no `count`",
                name.get_ref()
            );
            return Err(file.problem(name.span(), message));
        }
        along.push(k);
    }
    if along.is_empty() {
        return Err(file.problem(names.span(), "`design.along` is empty; expected at least one factor".into()));
    }
    let beside = |k: &usize| !along.contains(k) && matches!(factors[*k].range, Range::Interval { .. });
    if let Some(k) = (0..factors.len()).find(beside) {
        let message = format!(
            "factor `{}` is not in `design.along` and lacks `count`; expected the number of its levels",
            factors[k].name
        );
        return Err(file.problem(factors[k].place.clone(), message));
    }
    if along.len() == 1 {
        file.foreign("design.rays", &keys.rays, "one factor, along which there is one ray")?;
    }
    let rays = match &keys.rays {
        Some(rays) => file.count("design.rays", rays, 1, MOST_LEVELS)? as u64,
        None if along.len() == 1 => 1,
        None => RAYS as u64,
    };
    let tolerance = file.optional("design.tolerance", &keys.tolerance, TOLERANCE, Interval(1e-9, 0.5, ""))?;
    Ok(Design::Boundary { along, rays, tolerance, repeats })
}

/// Index of the factor that a key names.
pub(super) fn named(file: &Source, key: &str, name: &Spanned<String>, factors: &[Factor]) -> Checked<usize> {
    factors.iter().position(|f| f.name == *name.get_ref()).ok_or_else(|| {
        let known: Vec<&str> = factors.iter().map(|f| f.name.as_str()).collect();
        let hint = nearest(name.get_ref(), known.iter().copied());
        let hint = hint.map_or(String::new(), |near| format!("; did you mean \"{near}\"?"));
        let message = format!("`{key}` has \"{}\"; expected factors: {}{hint}", name.get_ref(), known.join(", "));
        file.problem(name.span(), message)
    })
}
