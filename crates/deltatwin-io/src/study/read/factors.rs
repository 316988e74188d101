//! `[[factors]]` → [`Factor`]: keys, levels, intervals and distributions.

use serde::Deserialize;
use toml::{Spanned, Value};

use crate::source::{Checked, Interval, Source};
use crate::study::factor::{Change, Distribution, Factor, Level, Range};
use crate::study::tree;

/// Largest number of factors of a study, and of levels of one.
const MOST_FACTORS: usize = 32;
pub(super) const MOST_LEVELS: i64 = 100_000;
/// Largest number of a factor.
const LARGEST: f64 = 1e12;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FactorKeys {
    name: Spanned<String>,
    key: Spanned<Value>,
    unit: Option<String>,
    change: Option<Spanned<String>>,
    levels: Option<Spanned<Vec<Value>>>,
    from: Option<Spanned<f64>>,
    to: Option<Spanned<f64>>,
    count: Option<Spanned<i64>>,
    distribution: Option<Spanned<DistributionKeys>>,
    nominal: Option<Spanned<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DistributionKeys {
    kind: Spanned<String>,
    mean: Option<Spanned<f64>>,
    sigma: Option<Spanned<f64>>,
    median: Option<Spanned<f64>>,
    low: Option<Spanned<f64>>,
    mode: Option<Spanned<f64>>,
    high: Option<Spanned<f64>>,
    scale: Option<Spanned<f64>>,
    shape: Option<Spanned<f64>>,
}

/// The factors of a study, in the order of the file.
pub(super) fn factors(file: &Source, tables: &[Spanned<FactorKeys>]) -> Checked<Vec<Factor>> {
    let mut out: Vec<Factor> = Vec::new();
    for keys in tables {
        let factor = factor(file, keys)?;
        if out.iter().any(|other| other.name == factor.name) {
            let message = format!("factor `{}` is there twice; expected every name once", factor.name);
            return Err(file.problem(keys.get_ref().name.span(), message));
        }
        out.push(factor);
    }
    if out.is_empty() || out.len() > MOST_FACTORS {
        let message = format!("the study has {} factor(s); expected 1 to {MOST_FACTORS} tables [[factors]]", out.len());
        return Err(file.problem(0..0, message));
    }
    Ok(out)
}

fn factor(file: &Source, whole: &Spanned<FactorKeys>) -> Checked<Factor> {
    let keys = whole.get_ref();
    let name = keys.name.get_ref();
    let fine = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    if name.is_empty() || name.len() > 60 || !name.chars().all(fine) {
        let message =
            format!("`factors.name` is \"{name}\"; expected up to 60 small letters, digits and _, for a column's name");
        return Err(file.problem(keys.name.span(), message));
    }
    let change = match &keys.change {
        Some(word) => {
            let choices = [("set", Change::Set), ("multiply", Change::Multiply), ("add", Change::Add)];
            file.choice("factors.change", word, &choices)?
        }
        None => Change::Set,
    };
    let range = range(file, whole)?;
    Ok(Factor {
        name: name.clone(),
        unit: keys.unit.clone().unwrap_or_else(|| default_unit(&range).into()),
        keys: key_names(file, &keys.key)?,
        change,
        nominal: file.maybe("factors.nominal", &keys.nominal, Interval(-LARGEST, LARGEST, ""))?,
        range,
        place: keys.name.span(),
    })
}

fn default_unit(range: &Range) -> &'static str {
    match range {
        Range::Levels(levels) if levels.iter().any(|level| level.number.is_none()) => "",
        _ => "1",
    }
}

fn key_names(file: &Source, value: &Spanned<Value>) -> Checked<Vec<String>> {
    let names: Option<Vec<String>> = match value.get_ref() {
        Value::String(name) => Some(vec![name.clone()]),
        Value::Array(items) => items.iter().map(|item| item.as_str().map(String::from)).collect(),
        _ => None,
    };
    names.filter(|names| !names.is_empty()).ok_or_else(|| {
        let message = format!(
            "`factors.key` is {}; expected a key such as \"payload.mass\", or an array of them",
            file.quote(value.span())
        );
        file.problem(value.span(), message)
    })
}

/// The values of a factor: `levels`, `from` and `to` with or without `count`, or a `distribution`.
fn range(file: &Source, whole: &Spanned<FactorKeys>) -> Checked<Range> {
    let keys = whole.get_ref();
    let name = keys.name.get_ref();
    let ways = [keys.levels.is_some(), keys.from.is_some() || keys.to.is_some(), keys.distribution.is_some()];
    if ways.iter().filter(|given| **given).count() != 1 {
        let named = [
            ("levels", keys.levels.is_some()),
            ("from", keys.from.is_some()),
            ("to", keys.to.is_some()),
            ("distribution", keys.distribution.is_some()),
        ];
        let given: Vec<String> = named.iter().filter(|(_, is)| *is).map(|(key, _)| format!("`{key}`")).collect();
        let what = if given.is_empty() { "has no values".into() } else { format!("has {}", given.join(" and ")) };
        let message = format!("factor `{name}` {what}; expected one of `levels`, `from` with `to`, or `distribution`");
        return Err(file.problem(keys.name.span(), message));
    }
    if let Some(levels) = &keys.levels {
        file.foreign("factors.count", &keys.count, "a factor with `levels`")?;
        let all: Vec<Level> = levels.get_ref().iter().map(level).collect();
        if all.is_empty() || all.len() > MOST_LEVELS as usize {
            let message = format!("`factors.levels` has {} value(s); expected 1 to {MOST_LEVELS}", all.len());
            return Err(file.problem(levels.span(), message));
        }
        if all.iter().any(|level| level.number.is_some_and(|x| !x.is_finite())) {
            let message = "`factors.levels` has a number that is not finite; expected finite numbers".into();
            return Err(file.problem(levels.span(), message));
        }
        let numbers = all.iter().filter(|level| level.number.is_some()).count();
        if numbers != 0 && numbers != all.len() {
            let message = format!("`factors.levels` is {}; expected numbers, or no numbers", file.quote(levels.span()));
            return Err(file.problem(levels.span(), message));
        }
        return Ok(Range::Levels(all));
    }
    if let Some(keys) = &keys.distribution {
        return distribution(file, keys).map(Range::Distributed);
    }
    let context = "a factor with a range";
    let end = |key: &str, value: &Option<Spanned<f64>>| {
        let value = file.needed(key, value, context, keys.name.span())?;
        file.within(key, value, Interval(-LARGEST, LARGEST, ""))
    };
    let (from, to) = (end("factors.from", &keys.from)?, end("factors.to", &keys.to)?);
    if from == to {
        let message = format!("factor `{name}` runs from {from} to {to}; expected two different numbers");
        return Err(file.problem(keys.name.span(), message));
    }
    match &keys.count {
        None => Ok(Range::Interval { from, to }),
        Some(count) => {
            let count = file.count("factors.count", count, 2, MOST_LEVELS)?;
            // The ends exactly.
            let at = |k: usize| if k + 1 == count { to } else { from + (to - from) * k as f64 / (count - 1) as f64 };
            Ok(Range::Levels((0..count).map(|k| level(&Value::Float(at(k)))).collect()))
        }
    }
}

fn level(value: &Value) -> Level {
    let number = value.as_float().or_else(|| value.as_integer().map(|n| n as f64));
    Level { text: tree::text(value), number, value: value.clone() }
}

/// Rejects the numbers of a distribution that are none of its `own`.
fn only_numbers(file: &Source, keys: &DistributionKeys, own: &[&str], context: &str) -> Checked<()> {
    for (name, value) in [
        ("mean", &keys.mean),
        ("sigma", &keys.sigma),
        ("median", &keys.median),
        ("low", &keys.low),
        ("mode", &keys.mode),
        ("high", &keys.high),
        ("scale", &keys.scale),
        ("shape", &keys.shape),
    ] {
        if !own.contains(&name) {
            file.foreign(&format!("distribution.{name}"), value, context)?;
        }
    }
    Ok(())
}

fn distribution(file: &Source, whole: &Spanned<DistributionKeys>) -> Checked<Distribution> {
    #[derive(Clone, Copy, PartialEq)]
    enum Shape {
        Normal,
        LogNormal,
        Uniform,
        Triangular,
        Weibull,
    }
    let keys = whole.get_ref();
    let choices = [
        ("normal", Shape::Normal),
        ("log_normal", Shape::LogNormal),
        ("uniform", Shape::Uniform),
        ("triangular", Shape::Triangular),
        ("weibull", Shape::Weibull),
    ];
    let shape = file.choice("distribution.kind", &keys.kind, &choices)?;
    let context = format!("kind = \"{}\"", keys.kind.get_ref());
    let own: &[&str] = match shape {
        Shape::Normal => &["mean", "sigma", "low", "high"],
        Shape::LogNormal => &["median", "sigma"],
        Shape::Uniform => &["low", "high"],
        Shape::Triangular => &["low", "mode", "high"],
        Shape::Weibull => &["scale", "shape"],
    };
    only_numbers(file, keys, own, &context)?;
    let number = |name: &str, value: &Option<Spanned<f64>>, low: f64| {
        let key = format!("distribution.{name}");
        let value = file.needed(&key, value, &context, keys.kind.span())?;
        file.within(&key, value, Interval(low, LARGEST, ""))
    };
    let positive = f64::MIN_POSITIVE;
    let any = -LARGEST;
    let found = match shape {
        Shape::Normal => Distribution::Normal {
            mean: number("mean", &keys.mean, any)?,
            sigma: number("sigma", &keys.sigma, positive)?,
            low: file.maybe("distribution.low", &keys.low, Interval(any, LARGEST, ""))?.unwrap_or(f64::NEG_INFINITY),
            high: file.maybe("distribution.high", &keys.high, Interval(any, LARGEST, ""))?.unwrap_or(f64::INFINITY),
        },
        Shape::LogNormal => Distribution::LogNormal {
            median: number("median", &keys.median, positive)?,
            sigma: number("sigma", &keys.sigma, positive)?,
        },
        Shape::Uniform => {
            Distribution::Uniform { low: number("low", &keys.low, any)?, high: number("high", &keys.high, any)? }
        }
        Shape::Triangular => Distribution::Triangular {
            low: number("low", &keys.low, any)?,
            mode: number("mode", &keys.mode, any)?,
            high: number("high", &keys.high, any)?,
        },
        Shape::Weibull => Distribution::Weibull {
            scale: number("scale", &keys.scale, positive)?,
            shape: number("shape", &keys.shape, positive)?,
        },
    };
    let ordered = match found {
        Distribution::Normal { low, high, .. } | Distribution::Uniform { low, high } => low < high,
        Distribution::Triangular { low, mode, high } => low < high && (low..=high).contains(&mode),
        _ => true,
    };
    if ordered {
        return Ok(found);
    }
    let message =
        format!("distribution with {context}: its numbers are out of order; expected low < high, a mode between");
    Err(file.problem(whole.span(), message))
}
