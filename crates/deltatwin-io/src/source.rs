//! A text file with checks of its values, whose errors are reported with file, line and column.

use std::fmt;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use deltatwin::machine::{Payload, PerAxis, every_axis};
use deltatwin::text::nearest;
use miette::{Diagnostic, SourceSpan};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use thiserror::Error;
use toml::Spanned;
use toml::de::{DeTable, DeValue, Deserializer, ValueDeserializer};

use crate::excerpt::Excerpt;
use crate::outside::Access;

/// An error in a text file.
#[derive(Clone, Debug, Error, Diagnostic)]
#[error("{place}: {message}")]
pub struct Problem {
    /// `file:line:column`.
    pub place: String,
    /// Key, value and what was expected.
    pub message: String,
    /// What is shown of the file.
    #[source_code]
    text: Arc<Excerpt>,
    /// Position of the error in what is shown.
    #[label("{label}")]
    span: SourceSpan,
    label: String,
}

/// Result of a check.
pub(crate) type Checked<T> = std::result::Result<T, Problem>;

/// Closed interval of numbers, with their unit; from [`f64::MIN_POSITIVE`] on it is the interval of positive numbers.
#[derive(Clone, Copy)]
pub(crate) struct Interval<'a>(pub f64, pub f64, pub &'a str);

impl Interval<'_> {
    pub(crate) fn contains(&self, value: f64) -> bool {
        (self.0..=self.1).contains(&value)
    }
}

impl fmt::Display for Interval<'_> {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Self(low, high, unit) = self;
        match *low {
            f64::MIN_POSITIVE => write!(f, "above 0, at most {high}")?,
            low => write!(f, "from {low} to {high}")?,
        }
        if unit.is_empty() { Ok(()) } else { write!(f, " {unit}") }
    }
}

/// The dotted name of the key at `span`, or of the one whose value is there.
fn key_at(table: &DeTable, span: &Range<usize>, path: &str) -> Option<String> {
    table.iter().find_map(|(key, value)| {
        let own = if path.is_empty() { key.get_ref().to_string() } else { format!("{path}.{}", key.get_ref()) };
        let inside = match value.get_ref() {
            DeValue::Table(inner) => key_at(inner, span, &own),
            DeValue::Array(items) => {
                items.iter().filter_map(|item| item.get_ref().as_table()).find_map(|inner| key_at(inner, span, &own))
            }
            _ => None,
        };
        let holds = |outer: Range<usize>| outer.start <= span.start && span.end <= outer.end;
        let is_value = !value.get_ref().is_table() && holds(value.span());
        inside.or_else(|| (key.span() == *span || is_value).then_some(own))
    })
}

/// An expectation without the names of types.
fn in_plain_words(expected: &str) -> &str {
    match expected {
        "f64" => "a number",
        "i64" | "u64" | "usize" => "a whole number",
        "a boolean" => "true or false",
        "a sequence" => "an array",
        _ if expected.starts_with("struct ") => "a table",
        _ => expected,
    }
}

/// A TOML file as text.
pub(crate) struct Source<'a> {
    /// Name of the file in errors.
    pub name: String,
    pub text: &'a str,
    /// What the file may name.
    pub access: Access,
}

impl<'a> Source<'a> {
    pub fn new(name: impl fmt::Display, text: &'a str) -> Self {
        Self { name: name.to_string(), text, access: Access::PLAIN }
    }

    /// An error about the text at `span`.
    pub fn problem(&self, span: Range<usize>, message: String) -> Problem {
        self.labelled(span, message, "here".into())
    }

    /// An error about the text at `span`, with a label.
    pub fn labelled(&self, span: Range<usize>, message: String, label: String) -> Problem {
        let before = self.text.get(..span.start).unwrap_or(self.text);
        let line = before.matches('\n').count() + 1;
        let column = before.chars().rev().take_while(|&c| c != '\n').count() + 1;
        let (excerpt, span) = Excerpt::new(&self.name, self.text, span);
        let place = format!("{}:{line}:{column}", self.name);
        Problem { place, message, text: excerpt.into(), span: span.into(), label }
    }

    /// An error of the TOML reader.
    pub fn broken(&self, error: &toml::de::Error) -> Problem {
        self.problem(error.span().unwrap_or(0..0), self.worded(error))
    }

    /// What the TOML reader says, in the words of the other checks and with the key that it is about.
    fn worded(&self, error: &toml::de::Error) -> String {
        let said = error.message().trim().replace('\n', ", ");
        let span = error.span().unwrap_or(0..0);
        let Ok(table) = DeTable::parse(self.text) else {
            let what = if said == "duplicate key" { format!(" `{}`", self.quote(span)) } else { String::new() };
            return format!("not valid TOML: {said}{what}");
        };
        let key = key_at(table.get_ref(), &span, "");
        let (problem, expected) = said.split_once(", expected ").unwrap_or((&said, ""));
        let names: Vec<&str> = expected.split('`').skip(1).step_by(2).collect();
        let quoted = |start: &str| problem.strip_prefix(start).and_then(|rest| rest.strip_suffix('`'));
        let hint = |wrong: &str| match nearest(wrong, names.iter().copied()) {
            Some(name) => format!("; did you mean `{name}`?"),
            None => String::new(),
        };
        if let Some(wrong) = quoted("unknown field `") {
            let key = key.as_deref().unwrap_or(wrong);
            return format!("unknown key `{key}`; expected {expected}{}", hint(wrong));
        }
        if let Some(missing) = quoted("missing field `") {
            return format!("missing key `{missing}`");
        }
        let Some(key) = key.filter(|_| !expected.is_empty()) else { return said };
        match (quoted("unknown variant `"), problem.strip_prefix("invalid length ")) {
            (Some(wrong), _) => format!("`{key}` is \"{wrong}\"; expected {expected}{}", hint(wrong)),
            (_, Some(length)) => format!("`{key}` has {length} value(s); expected {expected}"),
            _ => format!("`{key}` is {}; expected {}", self.quote(span), in_plain_words(expected)),
        }
    }

    /// The file as a `T` without the table `apart`, whose keys depend on its `kind`, and that table.
    pub fn document<T: DeserializeOwned>(&self, apart: &str) -> Checked<(T, Option<Spanned<DeValue<'a>>>)> {
        let mut table = DeTable::parse(self.text).map_err(|e| self.broken(&e))?;
        let rest = table.get_mut().remove(apart);
        let document = T::deserialize(Deserializer::from(table)).map_err(|e| self.broken(&e))?;
        Ok((document, rest))
    }

    /// Removes `kind` from the table called `name`; `what` is the word for it in errors.
    pub fn kind(&self, name: &str, what: &str, table: &mut Spanned<DeValue>) -> Checked<Spanned<String>> {
        let span = table.span();
        let DeValue::Table(keys) = table.get_mut() else {
            return Err(self.problem(span, format!("`{name}` is not a table; expected [{name}]")));
        };
        let Some(kind) = keys.remove("kind") else {
            return Err(self.problem(span, format!("[{name}] lacks `kind`; expected the kind of {what}")));
        };
        Spanned::<String>::deserialize(ValueDeserializer::from(kind)).map_err(|e| self.broken(&e))
    }

    /// The keys of the table called `name` as a `T`.
    pub fn keys<T: DeserializeOwned>(&self, name: &str, table: Spanned<DeValue>) -> Checked<T> {
        let whole = table.span();
        T::deserialize(ValueDeserializer::from(table)).map_err(|e| {
            let span = e.span().filter(|s| !s.is_empty()).unwrap_or(whole);
            let said = self.worded(&e);
            let of = if said.starts_with("missing") { format!("[{name}]: ") } else { String::new() };
            self.problem(span, of + &said)
        })
    }

    /// The text of a value on one line, shortened to 60 characters.
    pub fn quote(&self, span: Range<usize>) -> String {
        let text: Vec<&str> = self.text.get(span).unwrap_or("").split_whitespace().collect();
        let text = text.join(" ");
        if text.chars().count() <= 60 { text } else { text.chars().take(57).chain("...".chars()).collect() }
    }

    /// Checks that this file may name the file `target` by the key `key`.
    pub fn may_name(&self, key: &str, name: &Spanned<String>, target: &Path) -> Checked<()> {
        let check = self.access.check(Path::new(&self.name), target);
        check.map_err(|what| self.problem(name.span(), format!("`{key}` is \"{}\", which {what}", name.get_ref())))
    }

    /// A number, which must be within `interval`.
    pub fn within(&self, key: &str, value: &Spanned<f64>, interval: Interval) -> Checked<f64> {
        let v = *value.get_ref();
        if interval.contains(v) {
            return Ok(v);
        }
        Err(self.problem(value.span(), format!("`{key}` is {v}; expected a number {interval}")))
    }

    /// [`Self::within`], or `default` for a missing key.
    pub fn optional(&self, key: &str, value: &Option<Spanned<f64>>, default: f64, interval: Interval) -> Checked<f64> {
        value.as_ref().map_or(Ok(default), |v| self.within(key, v, interval))
    }

    /// [`Self::within`], or `None` for a missing key.
    pub fn maybe(&self, key: &str, value: &Option<Spanned<f64>>, interval: Interval) -> Checked<Option<f64>> {
        value.as_ref().map(|v| self.within(key, v, interval)).transpose()
    }

    /// An array of numbers, each of which must be within `interval`.
    pub fn numbers<const N: usize>(
        &self,
        key: &str,
        value: &Spanned<[f64; N]>,
        interval: Interval,
    ) -> Checked<[f64; N]> {
        match value.get_ref().iter().find(|v| !interval.contains(**v)) {
            None => Ok(*value.get_ref()),
            Some(v) => Err(self.problem(value.span(), format!("`{key}` has {v}; expected {N} numbers {interval}"))),
        }
    }

    /// One number per axis of the machine; those of missing axes are zero.
    pub fn per_axis(&self, key: &str, value: &Spanned<Vec<f64>>, interval: Interval) -> Checked<PerAxis<f64>> {
        let (given, most) = (value.get_ref(), every_axis().len());
        let problem = match given.iter().find(|v| !interval.contains(**v)) {
            Some(v) => Some(v.to_string()),
            None if ![1, 3, most].contains(&given.len()) => Some(format!("{} number(s)", given.len())),
            None => None,
        };
        if let Some(what) = problem {
            let message = format!("`{key}` has {what}; expected one per axis, 1, 3 or {most} numbers {interval}");
            return Err(self.problem(value.span(), message));
        }
        Ok(std::array::from_fn(|i| given.get(i).copied().unwrap_or(0.0)))
    }

    /// An integer, which must be within `low` to `high`.
    pub fn count(&self, key: &str, value: &Spanned<i64>, low: i64, high: i64) -> Checked<usize> {
        let v = *value.get_ref();
        if (low..=high).contains(&v) {
            return Ok(v as usize);
        }
        Err(self.problem(value.span(), format!("`{key}` is {v}; expected a whole number from {low} to {high}")))
    }

    /// One of several words.
    pub fn choice<T: Copy>(&self, key: &str, value: &Spanned<String>, choices: &[(&str, T)]) -> Checked<T> {
        let word = value.get_ref();
        if let Some((_, choice)) = choices.iter().find(|(name, _)| name == word) {
            return Ok(*choice);
        }
        let names: Vec<String> = choices.iter().map(|(name, _)| format!("\"{name}\"")).collect();
        let names = match names.split_last() {
            Some((last, rest)) if !rest.is_empty() => format!("{} or {last}", rest.join(", ")),
            _ => names.concat(),
        };
        let near = nearest(word, choices.iter().map(|(name, _)| *name));
        let hint = near.map_or(String::new(), |name| format!("; did you mean \"{name}\"?"));
        Err(self.problem(value.span(), format!("`{key}` is \"{word}\"; expected {names}{hint}")))
    }

    /// The value of a key that `context` requires.
    pub fn needed<'v, T>(
        &self,
        key: &str,
        value: &'v Option<Spanned<T>>,
        context: &str,
        at: Range<usize>,
    ) -> Checked<&'v Spanned<T>> {
        value.as_ref().ok_or_else(|| self.problem(at, format!("{context} lacks `{key}`; expected this key beside it")))
    }

    /// Rejects a key that is not applicable in `context`.
    pub fn foreign<T>(&self, key: &str, value: &Option<Spanned<T>>, context: &str) -> Checked<()> {
        match value {
            None => Ok(()),
            Some(v) => {
                Err(self.problem(v.span(), format!("`{key}` has no meaning for {context}; expected it to be left out")))
            }
        }
    }

    /// The payload of a table `[payload]`, whose keys except the tensor have been checked.
    pub fn payload(
        &self,
        mass: f64,
        com: [f64; 3],
        vertical: Option<f64>,
        tensor: &Option<Spanned<Vec<f64>>>,
    ) -> Checked<Payload> {
        let moments = tensor.as_ref().map(|v| v.get_ref().as_slice());
        Payload::stated(mass, com, vertical, moments).map_err(|what| {
            let span = tensor.as_ref().map_or(0..0, Spanned::span);
            self.problem(span, format!("`payload.inertia` {what}"))
        })
    }
}
