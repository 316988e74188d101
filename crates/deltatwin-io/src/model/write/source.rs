//! Comments on fitted numbers: unit, recording, date, program and standard errors.

use deltatwin::model::history::rounded_to;
use deltatwin::model::provenance::{FITTED, Provenance};
use toml_edit::{Decor, Item, RawString, Value};

use super::Line;

/// Separator before the comment on the unchanged numbers of an array.
const UNMOVED: &str = "; unmoved: ";
/// Placeholder for the standard error of an unchanged number.
const STAYED: &str = "–";

/// Numbers and comments of a key before it was written.
pub(super) struct Before {
    numbers: Vec<f64>,
    comment: String,
}

impl Before {
    pub(super) fn of(item: &Item) -> Self {
        let Some(value) = item.as_value() else { return Self { numbers: Vec::new(), comment: String::new() } };
        let number = |v: &Value| v.as_float().or_else(|| v.as_integer().map(|i| i as f64)).unwrap_or(f64::NAN);
        let (numbers, mut comments) = match value {
            Value::Array(items) => {
                let inside = items.iter().flat_map(|v| comments(v.decor())).chain(text(Some(items.trailing())));
                (items.iter().map(number).collect(), inside.collect())
            }
            one => (vec![number(one)], Vec::new()),
        };
        comments.extend(comments_after(value.decor()));
        Self { numbers, comment: comments.join("; ") }
    }

    /// Whether each of `now` differs from the previous number.
    fn moved(&self, now: &[f64]) -> Vec<bool> {
        let old = |i: usize| if self.numbers.len() == 1 { self.numbers.first() } else { self.numbers.get(i) };
        now.iter().enumerate().map(|(i, v)| old(i).is_none_or(|o| o.to_bits() != v.to_bits())).collect()
    }
}

fn text(raw: Option<&RawString>) -> Vec<String> {
    let comment = |line: &str| line.split_once('#').map(|(_, c)| c.trim().to_string());
    raw.and_then(RawString::as_str).map_or(Vec::new(), |s| s.lines().filter_map(comment).collect())
}

fn comments_after(decor: &Decor) -> Vec<String> {
    text(decor.suffix())
}

fn comments(decor: &Decor) -> Vec<String> {
    [text(decor.prefix()), text(decor.suffix())].concat()
}

/// Writes the source of the numbers of a line that differ from `before`; returns how many do.
///
/// The comment on changed numbers is replaced, that on unchanged numbers is kept after it.
pub(super) fn restate(item: &mut Item, line: &Line, before: &Before, provenance: &Provenance) -> usize {
    let moved = before.moved(&line.numbers);
    let count = moved.iter().filter(|m| **m).count();
    let Some(value) = item.as_value_mut().filter(|_| count > 0) else { return 0 };
    let blank = |raw: Option<&RawString>| -> String {
        let text = raw.and_then(RawString::as_str).unwrap_or("");
        text.split('#').next().unwrap_or("").trim_end_matches('\n').to_string()
    };
    let (prefix, mut gap) = (blank(value.decor().prefix()), blank(value.decor().suffix()));
    if let Value::Array(items) = value
        && (items.iter().any(|v| !comments(v.decor()).is_empty()) || !text(Some(items.trailing())).is_empty())
    {
        // Comments between the numbers would become outdated.
        *value = line.value(false);
    }
    if gap.is_empty() {
        gap = " ".into();
    }
    let mut comment = sourced(line, &moved, provenance);
    let old: Vec<String> = before.numbers.iter().map(|v| format!("{:?}", rounded_to(*v, 5))).collect();
    if !old.is_empty() {
        comment += &format!("; was {}", old.join(", "));
    }
    let kept = before.kept(&moved, line);
    if count < moved.len() && !kept.is_empty() {
        comment += &format!("{UNMOVED}{kept}");
    }
    *value.decor_mut() = Decor::new(prefix, format!("{gap}# {comment}"));
    count
}

impl Before {
    /// The part of the comment that refers to unchanged numbers.
    fn kept(&self, moved: &[bool], line: &Line) -> String {
        let comment = self.comment.strip_prefix(&line.comment).unwrap_or(&self.comment).trim_start_matches("; ");
        let Some((own, rest)) = comment.strip_prefix(FITTED).map(|c| c.split_once(UNMOVED).unwrap_or((c, ""))) else {
            return comment.to_string();
        };
        // The statement of an earlier fit is obsolete if all numbers it changed have changed again.
        let errors = own.split_once(": ").map_or("", |(_, e)| e.split(';').next().unwrap_or(""));
        let again = errors.split(", ").zip(moved).all(|(error, now)| error == STAYED || *now);
        if again { rest.to_string() } else { comment.to_string() }
    }
}

/// Unit and meaning of a line, with the source and standard errors of its changed numbers.
pub(super) fn sourced(line: &Line, moved: &[bool], provenance: &Provenance) -> String {
    let error = |(i, moved): (usize, &bool)| match line.parameters.get(i) {
        Some(names) if *moved => error(provenance.error(names)),
        None if *moved => error(None),
        _ => STAYED.to_string(),
    };
    let errors: Vec<String> = moved.iter().enumerate().map(error).collect();
    let unit = if line.comment.is_empty() { String::new() } else { format!("{}; ", line.comment) };
    format!("{unit}{}: {}", provenance.source(), errors.join(", "))
}

/// A standard error in words.
pub(super) fn error(std: Option<f64>) -> String {
    match std {
        Some(std) if std.is_finite() => format!("±{:?}", rounded_to(std, 2)),
        Some(_) => "not determined alone".into(),
        None => "follows from the others".into(),
    }
}
