//! `[effects.formula]`: changed coefficients, or all terms of a new formula.

use deltatwin::effects::ActiveEffect;
use deltatwin::effects::formula::{Formula, NAME};
use deltatwin::model::{Model, Provenance};
use miette::{Result, miette};
use toml_edit::{Array, ArrayOfTables, InlineTable, Item, Table, TableLike, Value};

use super::{replace_decorated, source, table_at};

fn of(model: &Model) -> Option<(&ActiveEffect, &Formula)> {
    model.effects.iter().find_map(|active| Some((active, active.effect.formula()?)))
}

/// Keys of one term with their text.
fn texts(formula: &Formula, i: usize) -> [(&'static str, String); 3] {
    let term = &formula.terms[i];
    [("name", term.name.clone()), ("at", term.at.name().into()), ("law", term.law.text().into())]
}

/// Whether both models have the same formula with the same coefficients.
pub(super) fn same(a: &Model, b: &Model) -> bool {
    match (of(a), of(b)) {
        (None, None) => true,
        (Some((a_active, a_formula)), Some((b_active, b_formula))) => {
            let count = a_formula.terms.len();
            let bits = |active: &ActiveEffect| active.values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
            count == b_formula.terms.len()
                && a_formula.empirical == b_formula.empirical
                && bits(a_active) == bits(b_active)
                && (0..count).all(|i| texts(a_formula, i) == texts(b_formula, i))
        }
        _ => false,
    }
}

/// Writes the model's formula to the document; returns how many coefficients changed.
pub(super) fn edit(root: &mut Table, model: &Model, provenance: Option<&Provenance>) -> Result<usize> {
    let Some((active, formula)) = of(model) else { return Ok(0) };
    let unit = |i: usize| formula.terms[i].unit(model.mechanism);
    // Unit, source and standard error of a coefficient.
    let fitted = |i: usize| {
        let name = format!("{NAME}.{}", formula.terms[i].name);
        provenance.map(|p| format!("{}; {}: {}", unit(i), p.source(), source::error(p.error(&[name]))))
    };
    let comment = match formula.empirical {
        true => "an empirical fit, no physical finding: the sum of its terms acts on the machine",
        false => "the sum of its terms acts on the machine",
    };
    let (table, inline) = table_at(root, &["effects", NAME], Some(comment))?;
    if formula.empirical != table.get("empirical").and_then(Item::as_bool).unwrap_or(false) {
        table.insert("empirical", toml_edit::value(formula.empirical));
    }
    if let Some(moved) = keep(table, active, formula, &|i| fitted(i).filter(|_| !inline)) {
        return Ok(moved);
    }
    let mut rows = ArrayOfTables::new();
    let mut values = Array::new();
    for (i, coefficient) in active.values.iter().enumerate() {
        let mut row = Table::new();
        let mut value = InlineTable::new();
        for (key, text) in texts(formula, i) {
            row.insert(key, toml_edit::value(&text));
            value.insert(key, text.into());
        }
        row.insert("coefficient", Item::Value(number(*coefficient)?));
        value.insert("coefficient", number(*coefficient)?);
        if let Some(Item::Value(v)) = row.get_mut("coefficient") {
            v.decor_mut().set_suffix(format!(" # {}", fitted(i).unwrap_or_else(|| unit(i).to_string())));
        }
        rows.push(row);
        values.push(value);
    }
    let item = if inline { Item::Value(Value::Array(values)) } else { Item::ArrayOfTables(rows) };
    table.insert("terms", item);
    Ok(active.values.len())
}

/// Updates the coefficients if the table already has these terms; returns how many changed.
fn keep(
    table: &mut dyn TableLike,
    active: &ActiveEffect,
    formula: &Formula,
    fitted: &dyn Fn(usize) -> Option<String>,
) -> Option<usize> {
    let mut rows: Vec<&mut dyn TableLike> = match table.get_mut("terms") {
        Some(Item::ArrayOfTables(rows)) => rows.iter_mut().map(|row| row as &mut dyn TableLike).collect(),
        Some(Item::Value(Value::Array(rows))) => {
            let tables = rows.iter_mut().filter_map(|v| v.as_inline_table_mut());
            tables.map(|row| row as &mut dyn TableLike).collect()
        }
        _ => return None,
    };
    let alike = |(i, row): (usize, &&mut dyn TableLike)| {
        let found = |key: &str| row.get(key).and_then(Item::as_str).map(str::trim);
        texts(formula, i).iter().all(|(key, text)| found(key) == Some(text.as_str()))
    };
    if rows.len() != formula.terms.len() || !rows.iter().enumerate().all(alike) {
        return None;
    }
    let mut moved = 0;
    for (i, (row, &coefficient)) in rows.iter_mut().zip(&active.values).enumerate() {
        let Some(Item::Value(old)) = row.get_mut("coefficient") else { return None };
        let before = old.as_float().or_else(|| old.as_integer().map(|i| i as f64));
        replace_decorated(old, coefficient, number(coefficient).ok()?);
        if before.map(f64::to_bits) != Some(coefficient.to_bits()) {
            moved += 1;
            if let Some(comment) = fitted(i) {
                old.decor_mut().set_suffix(format!(" # {comment}; was {:?}", before.unwrap_or(f64::NAN)));
            }
        }
    }
    Some(moved)
}

/// The shortest text that reads back as the same number.
fn number(v: f64) -> Result<Value> {
    format!("{v:?}").parse().map_err(|_| miette!("cannot write the coefficient {v}"))
}
