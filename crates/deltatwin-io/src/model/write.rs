//! [`Model`] → TOML: the original file with its comments, in which only changed numbers are replaced.

use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;

use deltatwin::effects::rigid_bodies::RigidBodies;
use deltatwin::effects::{ActiveEffect, Host, Parameter, Role};
use deltatwin::machine::bodies::{ARM, SLOTS, body_name};
use deltatwin::machine::{Axis, Effort, Inertia, Joint, Mechanism, Unit};
use deltatwin::model::{Added, Model, Provenance};
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use toml_edit::{Array, ArrayOfTables, DocumentMut, InlineTable, Item, Table, TableLike, Value};

use super::read::{
    ALWAYS_PRESENT, LONE_BODY, body_group, body_known, body_needed, default_values, drive_shape, groups,
};
use super::schema::{self, Field, Shape, Top};
use super::{limbs, meshes};
use crate::file::{WriteError, replace_text};

mod formula;
mod notes;
mod source;

pub use notes::{Note, noted_text, write_noted};

/// Writes the model to `path`: the text from which it was read with the changed numbers, or a new text.
///
/// # Errors
/// If the file format does not admit a number of the model, or a [`WriteError`]; the file is then unchanged.
pub fn write(model: &Model, path: &Path) -> Result<()> {
    write_text(model, path, None)
}

/// Writes a fitted model like [`write()`]; every changed number states its source.
///
/// # Errors
/// As for [`write()`].
pub fn write_fitted(model: &Model, path: &Path, provenance: &Provenance) -> Result<()> {
    write_text(model, path, Some(provenance))
}

fn write_text(model: &Model, path: &Path, provenance: Option<&Provenance>) -> Result<()> {
    let text = text(model.source.as_deref().unwrap_or(""), &placed(model, path), provenance)?;
    Ok(written(path, &text)?)
}

/// Replaces the file at `path` by `text`.
fn written(path: &Path, text: &str) -> Result<(), WriteError> {
    replace_text(path, text).map_err(|reason| WriteError::Io { file: path.into(), reason })
}

/// The model as a file at `path` states it.
fn placed<'m>(model: &'m Model, path: &Path) -> Cow<'m, Model> {
    let meshes = meshes::seen_from(model, path);
    if meshes == model.meshes { Cow::Borrowed(model) } else { Cow::Owned(Model { meshes, ..model.clone() }) }
}

/// `original` with the numbers of `model`: changed values are replaced in place, effects added or removed.
///
/// Comments and layout are preserved. The result reads back as exactly the numbers of `model`.
///
/// # Errors
/// If `original` is not valid TOML, or if the file format does not admit a number of `model`, e.g. a value outside its
/// range.
pub fn updated_text(original: &str, model: &Model) -> Result<String> {
    text(original, model, None)
}

/// `original` with the numbers of a fitted `model`, see [`updated_text`].
///
/// Every changed number gets a comment with recording, date, program and standard error in place of its old comment;
/// unchanged numbers keep theirs.
///
/// # Errors
/// As for [`updated_text`].
pub fn fitted_text(original: &str, model: &Model, provenance: &Provenance) -> Result<String> {
    text(original, model, Some(provenance))
}

fn text(original: &str, model: &Model, provenance: Option<&Provenance>) -> Result<String> {
    let mut document: DocumentMut = original.parse().into_diagnostic().wrap_err("the model file is not valid TOML")?;
    edit(&mut document, model, provenance)?;
    let text = document.to_string();
    verify(&text, model)?;
    Ok(text)
}

/// Text of a new model file for `model`, with unit and meaning of every key.
///
/// # Errors
/// If the file format does not admit a number of the model.
pub fn full_text(model: &Model) -> Result<String> {
    updated_text("", model)
}

/// Writes the numbers and effects of `model` to a TOML document.
fn edit(document: &mut DocumentMut, model: &Model, provenance: Option<&Provenance>) -> Result<()> {
    let root = document.as_table_mut();
    set_plain(root, "name", Value::from(model.name.as_str()));
    match model.mechanism {
        Mechanism::Delta { .. } if !model.geometry.is_regular() => {
            set_plain(root, "mechanism", Value::from("parallel"));
            set_plain(root, "assembled", Value::from(model.assembled));
            limbs::write(root, &model.geometry);
        }
        Mechanism::Delta { telescope, arms, .. } => {
            set_plain(root, "mechanism", Value::from("delta"));
            if arms == Joint::Prismatic {
                set_plain(root, "arms", Value::from("prismatic"));
            }
            if !telescope || root.contains_key("telescope") {
                set_plain(root, "telescope", Value::from(telescope));
            }
            let own = model.link_parameters.each_limb;
            if own || root.contains_key("limbs") {
                set_plain(root, "limbs", Value::from(if own { "own" } else { "alike" }));
            }
            set_plain(root, "assembled", Value::from(model.assembled));
        }
        Mechanism::Axis(Axis { joint, effort }) => {
            set_plain(root, "mechanism", Value::from("axis"));
            let name = if joint == Joint::Revolute { "revolute" } else { "prismatic" };
            set_plain(root, "joint", Value::from(name));
            match effort {
                Effort::Current => set_plain(root, "effort", Value::from("A")),
                Effort::Force => drop(root.remove("effort")),
            }
        }
    }
    let own: Vec<usize> = (0..SLOTS).filter(|&b| has_table(root, &["bodies", &body_name(b)])).collect();
    let mut moved = 0;
    for section in sections(model, &own) {
        moved += section.write(root, provenance)?;
    }
    moved += formula::edit(root, model, provenance)?;
    remove_absent_effects(root, model);
    write_history(root, &model.history, provenance)?;
    meshes::edit(root, &model.meshes);
    if let Some(provenance) = provenance.filter(|_| moved > 0) {
        write_change(root, moved, provenance);
    }
    Ok(())
}

/// Adds a line above the first key that states what a fit changed.
fn write_change(root: &mut Table, moved: usize, provenance: &Provenance) {
    let Some(mut key) = root.key_mut("name") else { return };
    let decor = key.leaf_decor_mut();
    let above = decor.prefix().and_then(|p| p.as_str()).unwrap_or("").to_string();
    let numbers = if moved == 1 { "1 number".to_string() } else { format!("{moved} numbers") };
    let what = format!("# `{}` moved {numbers}, {}.\n", provenance.command, provenance.source());
    decor.set_prefix(above + &what);
}

/// Appends the entries that `[[history]]` lacks; a history that differs from the model's is rewritten.
fn write_history(root: &mut Table, history: &[Added], provenance: Option<&Provenance>) -> Result<()> {
    let written = |t: &Table| t.get("effect").and_then(Item::as_str).map(str::to_string);
    let effects = |tables: &ArrayOfTables| tables.iter().map(written).collect::<Vec<_>>();
    let present = root.get("history").and_then(Item::as_array_of_tables).map(effects);
    let wanted: Vec<Option<String>> = history.iter().map(|a| Some(a.effect.clone())).collect();
    let kept = present.filter(|p| wanted.starts_with(p)).map_or(0, |p| p.len());
    if kept == 0 {
        root.remove("history");
    }
    if history.len() == kept {
        return Ok(());
    }
    let entry = root.entry("history").or_insert(Item::ArrayOfTables(ArrayOfTables::new()));
    let tables = entry.as_array_of_tables_mut().ok_or_else(|| miette!("`history` is not an array of tables"))?;
    let numbers = |v: &[f64]| v.iter().map(|x| Value::from(*x)).collect::<Array>();
    for (i, added) in history.iter().enumerate().skip(kept) {
        let mut table = Table::new();
        if i == 0 {
            table
                .decor_mut()
                .set_prefix("\n# Effects added so far: RMS residual without and with each, in N·m or N.\n");
        }
        let mut effect = Value::from(added.effect.as_str());
        if let Some(provenance) = provenance {
            effect.decor_mut().set_suffix(format!(" # {}", provenance.source()));
        }
        table.insert("effect", Item::Value(effect));
        table.insert("channels", Item::Value(added.channels.iter().map(String::as_str).collect::<Array>().into()));
        table.insert("rms_before", Item::Value(numbers(&added.rms_before).into()));
        table.insert("rms_after", Item::Value(numbers(&added.rms_after).into()));
        table.insert("noise_floor", Item::Value(numbers(&added.noise_floor).into()));
        table.insert("held_out", Item::Value(added.held_out.into()));
        tables.push(table);
    }
    Ok(())
}

/// Reads `text` back and compares every number.
fn verify(text: &str, model: &Model) -> Result<()> {
    let path = model.path.as_deref().unwrap_or(Path::new("model.toml"));
    let again = super::parse(text, path).wrap_err("the changed model would be refused")?;
    let everything: Vec<usize> = (0..SLOTS).collect();
    let (wanted, got) = (sections(model, &everything), sections(&again, &everything));
    for (wanted, got) in wanted.iter().zip(&got) {
        for (w, g) in wanted.lines.iter().zip(&got.lines) {
            if wanted.path != got.path || w.numbers != g.numbers {
                let (path, key) = (wanted.path.join("."), &w.key);
                return Err(miette!("cannot write [{path}] {key} = {:?}: it reads as {:?}", w.numbers, g.numbers));
            }
        }
    }
    if wanted.len() != got.len()
        || again.assembled != model.assembled
        || again.mechanism != model.mechanism
        || (!model.geometry.is_regular() && again.geometry != model.geometry)
        || again.name != model.name
        || again.history != model.history
        || again.meshes.files != model.meshes.files
        || !formula::same(&again, model)
    {
        return Err(miette!("cannot write the model: it reads differently"));
    }
    Ok(())
}

/// One table of the file.
struct Section {
    path: Vec<String>,
    lines: Vec<Line>,
    /// Comment above the table if it is new.
    comment: Option<String>,
    /// Whether a missing table means that all its numbers are zero.
    optional: bool,
}

/// One key of a table.
struct Line {
    key: Cow<'static, str>,
    numbers: Vec<f64>,
    /// Names of the parameter that each number represents; empty if none.
    parameters: Vec<Vec<String>>,
    /// Numbers assumed for a missing key.
    default: Option<Vec<f64>>,
    shape: Shape,
    integer: bool,
    comment: String,
}

/// All tables of the model's file; bodies in `own` have a table of their own.
fn sections(model: &Model, own: &[usize]) -> Vec<Section> {
    let (mechanism, assembled) = (model.mechanism, model.assembled);
    let top = Top { gravity: model.gravity, sample_time: model.sample_time };
    let keys = schema::geometry(mechanism, model.geometry.is_regular());
    let mut all = vec![
        section(&[], schema::top(mechanism), &top, true, mechanism),
        section(&["geometry"], keys, &model.geometry, assembled, schema::of_links(mechanism)),
    ];
    all.extend(body_sections(model, own));
    for (name, range) in schema::drive_groups(mechanism) {
        let mut s = section(&["drives", name], schema::DRIVE, &model.drives[range.clone()], true, mechanism);
        s.lines.iter_mut().for_each(|line| line.shape = drive_shape(range.len()));
        all.push(s);
    }
    if matches!(mechanism, Mechanism::Delta { .. }) {
        let sockets = section(&["sockets"], schema::SOCKETS, &model.sockets, true, schema::of_links(mechanism));
        all.push(Section { optional: !assembled, ..sockets });
        let stops = section(&["stops"], schema::stops(mechanism), &model.stops, true, mechanism);
        all.push(Section { optional: true, ..stops });
    }
    let noise = section(&["noise"], schema::noise(mechanism), &model.noise, true, mechanism);
    all.push(Section { optional: !assembled, ..noise });
    all.extend(
        model
            .effects
            .iter()
            .filter(|e| e.effect.name() != ALWAYS_PRESENT && e.effect.formula().is_none())
            .map(|e| effect_section(e, model.host())),
    );
    all
}

fn section<T: ?Sized>(path: &[&str], fields: &[Field<T>], source: &T, assembled: bool, units: Mechanism) -> Section {
    let lines = fields.iter().map(|f| {
        let numbers = (f.get)(source);
        let unneeded = (!assembled && !f.always).then(|| vec![0.0; numbers.len()]);
        let default = f.default.map(|x| vec![x]).or(unneeded);
        let comment = comment(f.unit.map(|unit| units.unit(unit)), f.about);
        let parameters = Vec::new();
        Line { key: f.key.into(), numbers, parameters, default, shape: f.shape, integer: f.bounds.integer, comment }
    });
    Section {
        path: path.iter().map(|p| p.to_string()).collect(),
        lines: lines.collect(),
        comment: None,
        optional: false,
    }
}

fn body_sections(model: &Model, own: &[usize]) -> Vec<Section> {
    let mechanism = model.mechanism;
    let body = |name: &str, inertia: &Inertia, optional: bool| Section {
        optional,
        ..section(&["bodies", name], schema::inertia(mechanism), inertia, true, schema::of_links(mechanism))
    };
    let parameters = Parameters::of(model);
    if matches!(mechanism, Mechanism::Axis(_)) {
        return vec![parameters.name(ARM, body(LONE_BODY, &model.bodies[ARM], false))];
    }
    let mut all = Vec::new();
    for (name, members) in groups(mechanism) {
        let Some(&first) = members.iter().find(|b| !own.contains(b)) else {
            continue;
        };
        let own = body(name, &model.bodies[first], !body_needed(first, mechanism, model.assembled));
        all.push(parameters.name(first, own));
    }
    for b in (0..SLOTS).filter(|&b| body_known(b, mechanism)) {
        // a body of a group gets its own table if it already has one or differs from the group
        let members = groups(mechanism).into_iter().find(|(name, _)| Some(*name) == body_group(b));
        let shared = members
            .filter(|_| !own.contains(&b))
            .and_then(|(_, members)| members.into_iter().find(|b| !own.contains(b)).map(|first| model.bodies[first]));
        if shared != Some(model.bodies[b]) {
            // zero inertia of a group may be omitted, but not that of a body that differs from its group
            let optional = !body_needed(b, mechanism, model.assembled) && shared.is_none();
            all.push(parameters.name(b, body(&body_name(b), &model.bodies[b], optional)));
        }
    }
    all
}

/// Names of the links' parameters, assigned to the numbers of the file.
struct Parameters {
    /// Parameters of the machine in its configuration, and disassembled.
    tables: [(Arc<RigidBodies>, Vec<String>); 2],
}

impl Parameters {
    fn of(model: &Model) -> Self {
        let named = |assembled: bool| {
            let links = RigidBodies::with(model.mechanism, assembled, model.link_parameters);
            let entries = ActiveEffect::absent_on(links.clone(), model.host()).entries();
            (links, entries.iter().map(deltatwin::effects::Entry::full_name).collect())
        };
        Self { tables: [named(model.assembled), named(false)] }
    }

    /// The section of body `b` with the names of its parameters added.
    fn name(&self, b: usize, mut section: Section) -> Section {
        let all =
            self.tables.iter().flat_map(|(links, names)| names.iter().enumerate().map(move |(k, n)| (links, k, n)));
        for (links, k, name) in all {
            let Some((key, places)) = links.place(k, b) else { continue };
            for line in section.lines.iter_mut().filter(|line| key.is_none_or(|key| key == line.key)) {
                line.parameters.resize(line.numbers.len(), Vec::new());
                for &i in places.iter().filter(|i| **i < line.numbers.len()) {
                    line.parameters[i].push(name.clone());
                }
            }
        }
        section
    }
}

fn effect_section(active: &ActiveEffect, host: Host) -> Section {
    let entries = active.entries();
    let line = |(b, p): (usize, &Parameter)| {
        let p = host.parameter(active.effect.acts_on(), p);
        let numbers = active.values().block(b).to_vec();
        Line {
            parameters: entries.iter().filter(|e| e.param.block == b).map(|e| vec![e.full_name()]).collect(),
            numbers,
            default: (p.role != Role::Linear).then(|| default_values(&p, host.mechanism)),
            shape: Shape::of(&p, host.mechanism),
            integer: false,
            comment: p.unit.to_string(),
            key: p.name,
        }
    };
    let about = active.effect.spec().about;
    Section {
        path: vec!["effects".into(), active.effect.name().into()],
        lines: active.effect.parameters().iter().enumerate().map(line).collect(),
        comment: Some(format!("{}: {}", about.summary, about.law)),
        optional: false,
    }
}

fn comment(unit: Option<Unit>, about: &str) -> String {
    unit.map_or(about.to_string(), |unit| format!("{unit}; {about}"))
}

impl Section {
    /// Writes the numbers to the document; returns how many changed.
    fn write(&self, root: &mut Table, provenance: Option<&Provenance>) -> Result<usize> {
        let path: Vec<&str> = self.path.iter().map(String::as_str).collect();
        let new = !has_table(root, &path);
        if new && self.optional && self.lines.iter().all(|l| l.numbers.iter().all(|&v| v == 0.0)) {
            return Ok(0);
        }
        let (table, inline) = table_at(root, &path, self.comment.as_deref())?;
        let mut moved = 0;
        for line in &self.lines {
            let assumed = line.default.as_ref() == Some(&line.numbers);
            // a new effect also shows its constants; zeros of an incomplete geometry are omitted
            let shown = new && self.comment.is_some();
            match table.get_mut(&line.key) {
                Some(item) => {
                    let before = source::Before::of(item);
                    line.replace(item);
                    if let Some(provenance) = provenance.filter(|_| !inline) {
                        moved += source::restate(item, line, &before, provenance);
                    }
                }
                None if assumed && !shown => {}
                None => {
                    table.insert(&line.key, Item::Value(line.value(true)));
                    let fitted = provenance.filter(|p| line.parameters.iter().any(|names| p.error(names).is_some()));
                    let comment = match fitted {
                        Some(provenance) => source::sourced(line, &vec![true; line.numbers.len()], provenance),
                        None => line.comment.clone(),
                    };
                    moved += fitted.map_or(0, |_| line.numbers.len());
                    if !comment.is_empty()
                        && !inline
                        && let Some(Item::Value(v)) = table.get_mut(&line.key)
                    {
                        v.decor_mut().set_suffix(format!(" # {comment}"));
                    }
                }
            }
        }
        Ok(moved)
    }
}

impl Line {
    fn scalar(&self, v: f64) -> Value {
        // `{:?}` is the shortest text that reads back as the same number
        let text = if self.integer { format!("{v:.0}") } else { format!("{v:?}") };
        text.parse().unwrap_or_else(|_| Value::from(v))
    }

    /// The numbers as a value; a single number if `short` and all are equal.
    fn value(&self, short: bool) -> Value {
        let alike = self.numbers.windows(2).all(|w| w[0] == w[1]);
        match (self.shape, self.numbers.first()) {
            (Shape::One, Some(&v)) => self.scalar(v),
            (Shape::OneOrArray(_), Some(&v)) if short && alike => self.scalar(v),
            _ => Value::Array(self.numbers.iter().map(|&v| self.scalar(v)).collect::<Array>()),
        }
    }

    /// Replaces the numbers that differ and keeps the comments around them.
    fn replace(&self, item: &mut Item) {
        let Item::Value(old) = item else {
            *item = Item::Value(self.value(true));
            return;
        };
        let decor = old.decor().clone();
        if let Value::Array(items) = old
            && items.len() == self.numbers.len()
        {
            for (old, &v) in items.iter_mut().zip(&self.numbers) {
                self.replace_number(old, v);
            }
            return;
        }
        match self.value(!old.is_array()) {
            Value::Array(items) => *old = Value::Array(items),
            _ => self.replace_number(old, self.numbers[0]),
        }
        *old.decor_mut() = decor;
    }

    fn replace_number(&self, old: &mut Value, v: f64) {
        replace_decorated(old, v, self.scalar(v));
    }
}

/// Replaces a number by `new`, the text of `v`, and keeps the comments.
fn replace_decorated(old: &mut Value, v: f64, new: Value) {
    let same = match old {
        Value::Float(f) => f.value().to_bits() == v.to_bits(),
        Value::Integer(i) => *i.value() as f64 == v,
        _ => false,
    };
    if !same {
        let decor = old.decor().clone();
        *old = new;
        *old.decor_mut() = decor;
    }
}

fn set_plain(root: &mut Table, key: &str, value: Value) {
    match root.get_mut(key) {
        Some(Item::Value(old)) => {
            let same = match (&*old, &value) {
                (Value::String(a), Value::String(b)) => a.value() == b.value(),
                (Value::Boolean(a), Value::Boolean(b)) => a.value() == b.value(),
                _ => false,
            };
            if !same {
                let decor = old.decor().clone();
                *old = value;
                *old.decor_mut() = decor;
            }
        }
        _ => {
            root.insert(key, Item::Value(value));
        }
    }
}

fn has_table(root: &Table, path: &[&str]) -> bool {
    let mut table: &dyn TableLike = root;
    for key in path {
        match table.get(key).and_then(Item::as_table_like) {
            Some(next) => table = next,
            None => return false,
        }
    }
    true
}

/// The table at `path`, created with `comment` above it if missing.
///
/// The second result is whether it is inline or has dotted keys, which admit neither comments nor headers.
fn table_at<'a>(root: &'a mut Table, path: &[&str], comment: Option<&str>) -> Result<(&'a mut dyn TableLike, bool)> {
    let mut table: &mut dyn TableLike = root;
    let mut inline = false;
    for (i, key) in path.iter().enumerate() {
        if table.get(key).is_none() {
            let item = if inline {
                Item::Value(Value::InlineTable(InlineTable::new()))
            } else {
                let mut new = Table::new();
                new.set_implicit(i + 1 < path.len());
                if let Some(comment) = comment.filter(|_| i + 1 == path.len()) {
                    new.decor_mut().set_prefix(format!("\n# {comment}\n"));
                }
                Item::Table(new)
            };
            table.insert(key, item);
        }
        let item = table.get_mut(key).ok_or_else(|| miette!("cannot add [{}]", path[..=i].join(".")))?;
        inline |= item.is_value();
        table = item.as_table_like_mut().ok_or_else(|| miette!("{} is not a table", path[..=i].join(".")))?;
        inline |= table.is_dotted();
    }
    Ok((table, inline))
}

fn remove_absent_effects(root: &mut Table, model: &Model) {
    let Some(effects) = root.get_mut("effects").and_then(Item::as_table_like_mut) else {
        return;
    };
    let absent: Vec<String> = effects
        .iter()
        .map(|(key, _)| key.to_string())
        .filter(|key| !model.effects.iter().any(|e| e.effect.name() == key))
        .collect();
    for key in absent {
        effects.remove(&key);
    }
}
