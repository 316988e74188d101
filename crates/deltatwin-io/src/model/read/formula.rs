//! `[effects.formula]`: terms with their laws as text.

use std::ops::Range;
use std::sync::Arc;

use deltatwin::effects::formula::{Expression, Formula, LIMIT, Place, Term};
use deltatwin::effects::{ActiveEffect, Host};
use toml::de::DeValue;

use super::super::schema::{Bounds, Shape};
use super::super::table::{Table, Value, suggestion};
use crate::source::Checked;

const TERMS: &str = "an array of tables [[effects.formula.terms]] with name, at, law and coefficient";

/// Reads the table of a formula.
pub(super) fn read(table: &Table, host: Host) -> Checked<ActiveEffect> {
    table.only(&["empirical", "terms"])?;
    let empirical = table.optional_boolean("empirical")?.unwrap_or(false);
    let value = table.required("terms", TERMS)?;
    let DeValue::Array(items) = value.get_ref() else {
        return Err(table.wrong_type("terms", value, TERMS));
    };
    if items.is_empty() {
        return Err(table.refuse("terms", "expected at least one term"));
    }
    let mut terms: Vec<(Term, f64)> = Vec::new();
    for (i, item) in items.iter().enumerate() {
        let path = format!("{}.terms.{}", table.path, i + 1);
        let Some(entries) = item.get_ref().as_table() else {
            return Err(table.refuse_at(
                "terms",
                item.span(),
                &format!("value {} is no table, expected {TERMS}", i + 1),
            ));
        };
        let own = Table { source: table.source, path, span: item.span(), entries };
        let (term, coefficient) = read_term(&own, host)?;
        if terms.iter().any(|(other, _)| other.name == term.name) {
            return Err(own.refuse("name", "expected a name that no other term has"));
        }
        terms.push((term, coefficient));
    }
    let values: Vec<[f64; 1]> = terms.iter().map(|(_, coefficient)| [*coefficient]).collect();
    let blocks: Vec<&[f64]> = values.iter().map(|v| &v[..]).collect();
    Ok(ActiveEffect { host, ..ActiveEffect::new(Arc::new(Formula::new(terms, empirical, host.mechanism)), &blocks) })
}

fn read_term(table: &Table, host: Host) -> Checked<(Term, f64)> {
    table.only(&["name", "at", "law", "coefficient", "unit"])?;
    let name = table.string("name", "a name for the coefficient, a string")?;
    if name.is_empty() || !name.chars().all(|c| c.is_alphanumeric() || "_-".contains(c)) {
        return Err(table.refuse("name", "expected letters, digits, `_` and `-`"));
    }
    let places: Vec<&str> = Place::on(host.mechanism).map(Place::name).collect();
    let known = places.join(", ");
    let at = table.string("at", &format!("one of {known}"))?;
    let Some(at) = Place::named(at).filter(|place| places.contains(&place.name())) else {
        let hint = suggestion(at, &places).map_or(String::new(), |h| format!("; {h}"));
        return Err(table.refuse("at", &format!("this machine has no such place; expected one of {known}{hint}")));
    };
    let text = table.string("law", "an expression such as \"-tanh(50*qd1)\"")?;
    let law = Expression::parse(text).map_err(|e| {
        let whole = table.entry("law").map_or(table.span.clone(), Value::span);
        table.refuse_at("law", within(table.source.text, whole, text, &e.at), &e.problem)
    })?;
    if let Some(variable) = law.variables().find(|v| !v.exists_on(host.mechanism)) {
        return Err(table.refuse("law", &format!("this machine has no `{}`; expected what it has", variable.name())));
    }
    let term = Term { name: name.into(), at, law };
    let unit = term.unit(host.mechanism);
    let bounds = Bounds::between(-LIMIT, LIMIT);
    let coefficient = table.numbers("coefficient", Shape::One, &bounds, Some(unit))?[0];
    if table.entry("unit").is_some() && table.string("unit", &format!("\"{unit}\""))? != unit.to_string() {
        let problem = format!("expected \"{unit}\", the unit of a coefficient at {}", at.name());
        return Err(table.refuse("unit", &problem));
    }
    Ok((term, coefficient))
}

/// Position in the file of a part of a string; exact unless the string contains escapes.
fn within(file: &str, whole: Range<usize>, text: &str, part: &Range<usize>) -> Range<usize> {
    let written = file.get(whole.clone()).unwrap_or("");
    match written.find(text) {
        Some(from) if !text.is_empty() => {
            let from = whole.start + from;
            let end = (from + part.end).max(from + part.start + 1).min(whole.end);
            (from + part.start).min(end)..end
        }
        _ => whole,
    }
}
