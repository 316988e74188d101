//! A table of a TOML file, with checks of its values.

use std::fmt::Display;
use std::ops::Range;

use deltatwin::machine::Mechanism;
use deltatwin::text::nearest;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::schema::{self, Bounds, Field, Shape};
use crate::source::{Checked, Problem, Source};

pub(super) type Value<'a> = Spanned<DeValue<'a>>;

/// A table of the file.
pub(super) struct Table<'a> {
    pub source: &'a Source<'a>,
    /// Dotted name, empty for the root.
    pub path: String,
    pub span: Range<usize>,
    pub entries: &'a DeTable<'a>,
}

impl<'a> Table<'a> {
    /// Keys and their spans in file order.
    pub fn sorted(&self) -> Vec<(&'a str, Range<usize>)> {
        let mut keys: Vec<_> = self.entries.keys().map(|k| (k.get_ref().as_ref(), k.span())).collect();
        keys.sort_by_key(|(_, span)| span.start);
        keys
    }

    pub fn entry(&self, key: &str) -> Option<&'a Value<'a>> {
        self.entries.get(key)
    }

    pub fn place(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_string() } else { format!("[{}] {key}", self.path) }
    }

    pub fn title(&self) -> String {
        if self.path.is_empty() { "the file".to_string() } else { format!("[{}]", self.path) }
    }

    /// Rejects keys that are not in `known`.
    pub fn only(&self, known: &[&str]) -> Checked<()> {
        match self.sorted().into_iter().find(|(key, _)| !known.contains(key)) {
            None => Ok(()),
            Some((key, _)) => {
                let message = format!("unknown key; expected one of {}", known.join(", "));
                Err(self.refuse_key(key, &message, suggestion(key, known)))
            }
        }
    }

    /// Error for the value of `key`.
    pub fn refuse(&self, key: &str, why: &str) -> Problem {
        match self.entry(key) {
            Some(value) => self.refuse_at(key, value.span(), why),
            None => self.lacks(&format!("`{key}`")),
        }
    }

    /// Error for the part of `key`'s value at `span`.
    pub fn refuse_at(&self, key: &str, span: Range<usize>, why: &str) -> Problem {
        let whole = self.entry(key).map_or(span.clone(), Spanned::span);
        let message = format!("{} = {}: {why}", self.place(key), self.source.quote(whole));
        let label = why.find("expected").map_or(why, |at| &why[at..]).to_string();
        self.source.labelled(span, message, label)
    }

    /// Error for `key` itself.
    pub fn refuse_key(&self, key: &str, why: &str, hint: Option<String>) -> Problem {
        let span = self.entries.get_key_value(key).map_or(self.span.clone(), |(k, _)| k.span());
        let hint = hint.map_or(String::new(), |h| format!("; {h}"));
        self.source.problem(span, format!("{}: {why}{hint}", self.place(key)))
    }

    pub fn lacks(&self, what: &str) -> Problem {
        let label = match what.split_once(": ") {
            Some((_, expected)) => expected.to_string(),
            None => format!("expected {what}"),
        };
        self.source.labelled(self.span.clone(), format!("{} lacks {what}", self.title()), label)
    }

    pub fn required(&self, key: &str, expected: &str) -> Checked<&'a Value<'a>> {
        self.entry(key).ok_or_else(|| self.lacks(&format!("`{key}`: expected {expected}")))
    }

    pub fn wrong_type(&self, key: &str, value: &Value, expected: &str) -> Problem {
        let found = value.get_ref().type_str();
        self.refuse_at(key, value.span(), &format!("found {}, expected {expected}", article(found)))
    }

    pub fn string(&self, key: &str, expected: &str) -> Checked<&'a str> {
        let value = self.required(key, expected)?;
        value.get_ref().as_str().ok_or_else(|| self.wrong_type(key, value, expected))
    }

    pub fn strings(&self, key: &str, expected: &str) -> Checked<Vec<String>> {
        let value = self.required(key, expected)?;
        let DeValue::Array(items) = value.get_ref() else { return Err(self.wrong_type(key, value, expected)) };
        let one = |item: &Value<'_>| {
            item.get_ref().as_str().ok_or_else(|| self.wrong_type(key, item, expected)).map(String::from)
        };
        items.iter().map(one).collect()
    }

    pub fn boolean(&self, key: &str) -> Checked<bool> {
        let value = self.required(key, "true or false")?;
        value.get_ref().as_bool().ok_or_else(|| self.wrong_type(key, value, "true or false"))
    }

    pub fn optional_boolean(&self, key: &str) -> Checked<Option<bool>> {
        self.entry(key).map(|_| self.boolean(key)).transpose()
    }

    pub fn table(&self, key: &str) -> Checked<Table<'a>> {
        let path = if self.path.is_empty() { key.to_string() } else { format!("{}.{key}", self.path) };
        self.optional_table(key)?.ok_or_else(|| self.lacks(&format!("table [{path}]")))
    }

    pub fn optional_table(&self, key: &str) -> Checked<Option<Table<'a>>> {
        let Some((name, value)) = self.entries.get_key_value(key) else {
            return Ok(None);
        };
        let path = if self.path.is_empty() { key.to_string() } else { format!("{}.{key}", self.path) };
        match value.get_ref().as_table() {
            Some(entries) => Ok(Some(Table { source: self.source, path, span: name.span(), entries })),
            None => Err(self.wrong_type(key, value, &format!("a table [{path}]"))),
        }
    }

    /// Fills `target` from this table; a disassembled robot may omit some keys.
    pub fn fill<T: ?Sized>(
        &self,
        fields: &[Field<T>],
        target: &mut T,
        assembled: bool,
        units: Mechanism,
    ) -> Checked<()> {
        for f in fields {
            let given = self.entry(f.key).is_some();
            match f.default {
                Some(default) if !given => (f.set)(target, &[default]),
                _ if given || assembled || f.always => {
                    (f.set)(target, &self.numbers(f.key, f.shape, &f.bounds, f.unit.map(|unit| units.unit(unit)))?);
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// Fills `target` from the table `key`, which may be missing unless `needed`.
    pub fn fill_table<T: ?Sized>(
        &self,
        key: &str,
        fields: &[Field<T>],
        target: &mut T,
        needed: bool,
        units: Mechanism,
    ) -> Checked<()> {
        if needed || self.entry(key).is_some() {
            let table = self.table(key)?;
            table.only(&keys(fields))?;
            table.fill(fields, target, true, units)?;
        }
        Ok(())
    }

    /// The numbers of `key`; a single number that stands for several is repeated.
    pub fn numbers(
        &self,
        key: &str,
        shape: Shape,
        bounds: &Bounds,
        unit: Option<impl Display + Copy>,
    ) -> Checked<Vec<f64>> {
        let expected = schema::expectation(shape, bounds, unit);
        let value = self.required(key, &expected)?;
        match value.get_ref() {
            DeValue::Array(items) => {
                if !shape.takes_array(items.len()) {
                    let why = format!("found an array of {}, expected {expected}", items.len());
                    return Err(self.refuse_at(key, value.span(), &why));
                }
                let each = schema::expectation(Shape::One, bounds, unit);
                items
                    .iter()
                    .enumerate()
                    .map(|(i, item)| self.number(key, item, bounds, &each, &format!("value {} ", i + 1)))
                    .collect()
            }
            _ if !shape.takes_number() => Err(self.wrong_type(key, value, &expected)),
            _ => {
                let number = self.number(key, value, bounds, &expected, "")?;
                Ok(match shape {
                    Shape::OneOrArray(n) => vec![number; n],
                    _ => vec![number],
                })
            }
        }
    }

    pub fn number(&self, key: &str, value: &Value, bounds: &Bounds, expected: &str, which: &str) -> Checked<f64> {
        let number = match value.get_ref() {
            DeValue::Float(f) => f.as_str().parse::<f64>().ok(),
            DeValue::Integer(i) => i128::from_str_radix(i.as_str(), i.radix()).ok().map(|i| i as f64),
            _ => None,
        };
        match number {
            Some(v) if bounds.allow(v) => Ok(v),
            Some(_) => {
                let text = self.source.quote(value.span());
                let found = if which.is_empty() { String::new() } else { format!("{which}is {text}, ") };
                Err(self.refuse_at(key, value.span(), &format!("{found}expected {expected}")))
            }
            None => {
                let found = article(value.get_ref().type_str());
                let is = if which.is_empty() { "found " } else { "is " };
                Err(self.refuse_at(key, value.span(), &format!("{which}{is}{found}, expected {expected}")))
            }
        }
    }
}

fn article(noun: &str) -> String {
    let an = noun.starts_with(['a', 'e', 'i', 'o', 'u']);
    format!("{} {noun}", if an { "an" } else { "a" })
}

pub(super) fn keys<T: ?Sized>(fields: &[Field<T>]) -> Vec<&'static str> {
    fields.iter().map(|f| f.key).collect()
}

/// Suggestion of the known name nearest to a misspelt one.
pub(super) fn suggestion(wrong: &str, known: &[&str]) -> Option<String> {
    nearest(wrong, known.iter().copied()).map(|name| format!("did you mean `{name}`?"))
}
