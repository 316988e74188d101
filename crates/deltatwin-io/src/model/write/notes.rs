//! Comments that state how the numbers of a first model were found.

use std::path::Path;

use deltatwin::machine::bodies::SLOTS;
use deltatwin::model::Model;
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use toml_edit::{DocumentMut, Item, Table};

use super::{sections, table_at, updated_text, verify};

/// Origin of one number of a model file.
#[derive(Clone, Debug)]
pub struct Note {
    /// Table, with dots; empty for the keys above all tables.
    pub table: String,
    /// Key in the table.
    pub key: String,
    /// How its number was found.
    pub text: String,
}

/// Text of a model file with the numbers of `model`, in which every number of `notes` states its origin.
///
/// With an `original` the comments of all other numbers stay; without one every key has its unit and meaning. `heading`
/// is written above everything, a line each.
///
/// # Errors
/// If `original` is not valid TOML, if the file format does not admit a number of the model, or if a note is about a key
/// that is not there.
pub fn noted_text(original: &str, model: &Model, notes: &[Note], heading: &[String]) -> Result<String> {
    let text = updated_text(original, model)?;
    let mut document: DocumentMut = text.parse().into_diagnostic().wrap_err("the model file is not valid TOML")?;
    let all: Vec<usize> = (0..SLOTS).collect();
    let sections = sections(model, &all);
    for note in notes {
        let path: Vec<&str> = note.table.split('.').filter(|p| !p.is_empty()).collect();
        let lines = sections.iter().filter(|s| s.path == path).flat_map(|s| &s.lines);
        let meaning =
            lines.into_iter().find(|l| l.key == note.key).map_or(String::new(), |l| format!("{}; ", l.comment));
        let item = item(document.as_table_mut(), &path, &note.key)
            .ok_or_else(|| miette!("the model file has no {}.{}", note.table, note.key))?;
        if let Item::Value(value) = item {
            value.decor_mut().set_suffix(format!(" # {meaning}{}", note.text));
        }
    }
    head(document.as_table_mut(), heading);
    let text = document.to_string();
    verify(&text, model)?;
    Ok(text)
}

fn item<'a>(root: &'a mut Table, path: &[&str], key: &str) -> Option<&'a mut Item> {
    let (table, _) = table_at(root, path, None).ok()?;
    table.get_mut(key)
}

/// Puts lines above the first key, before the comments there.
fn head(root: &mut Table, heading: &[String]) {
    let Some(first) = root.iter().next().map(|(key, _)| key.to_string()) else { return };
    if let Some(mut key) = root.key_mut(&first) {
        let lines: String = heading.iter().map(|line| format!("# {line}\n")).collect();
        let decor = key.leaf_decor_mut();
        let there = decor.prefix().and_then(|p| p.as_str()).unwrap_or("").to_string();
        let gap = if there.is_empty() { "\n" } else { "#\n" };
        decor.set_prefix(lines + gap + &there);
    }
}

/// Writes a first model to `path`, see [`noted_text`].
///
/// # Errors
/// As for [`noted_text`], or if the file cannot be written; the file is then unchanged.
pub fn write_noted(model: &Model, path: &Path, original: &str, notes: &[Note], heading: &[String]) -> Result<()> {
    let text = noted_text(original, &super::placed(model, path), notes, heading)?;
    Ok(super::written(path, &text)?)
}
