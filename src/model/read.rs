//! TOML → [`Model`], with errors that name file, line, key, value and what was expected.
//!
//! The file is walked as a tree of spanned values rather than deserialized into structs, so that every message can
//! quote the value, point at it and suggest the nearest known name.

use std::fmt::Display;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use miette::{Diagnostic, IntoDiagnostic, NamedSource, Report, Result, SourceSpan, WrapErr};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::bodies::{self, BODIES, body_name};
use super::check::{self, Culprit};
use super::history::Added;
use super::schema::{self, Bounds, Field, Shape};
use super::{AXES, Bodies, Drive, Geometry, Inertia, Joint, LinkParameters, Mechanism, Model, Stops};
use crate::effects::{ActiveEffect, Effect, Effects, Host, Parameter, REGISTRY, Role};
use crate::text::nearest;

mod formula;

impl Model {
    /// Reads a model file.
    pub fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path)
            .into_diagnostic()
            .wrap_err_with(|| format!("cannot read model file {}", path.display()))?;
        Self::parse(&text, path)
    }

    /// Reads a model from `text`; `path` names it in errors.
    pub fn parse(text: &str, path: &Path) -> Result<Self> {
        let file = File { name: path.display().to_string(), text };
        let root = DeTable::parse(text).map_err(|e| {
            let message = e.message().trim_end().replace('\n', ", ");
            file.problem(e.span().unwrap_or(0..0), format!("not valid TOML: {message}"), "here".into())
        })?;
        let top = Table { file: &file, path: String::new(), span: 0..0, entries: root.get_ref() };
        let mut model = read_model(&top)?;
        model.path = Some(path.to_path_buf());
        model.source = Some(Arc::from(text));
        Ok(model)
    }
}

fn read_model(top: &Table) -> Result<Model> {
    let name = top.string("name", "the machine's name, a string")?.to_string();
    let mechanism = read_mechanism(top)?;
    let delta = matches!(mechanism, Mechanism::Delta { .. });
    let assembled = if delta { top.boolean("assembled")? } else { false };
    let mut numbers = schema::Top { gravity: 0.0, sample_time: 0.0 };
    top.fill(schema::top(mechanism), &mut numbers, true, mechanism)?;

    let mut geometry = schema::GEOMETRY_ZERO;
    let table = top.table("geometry")?;
    table.only(&keys(schema::geometry(mechanism)))?;
    table.fill(schema::geometry(mechanism), &mut geometry, assembled, mechanism)?;
    if !mechanism.has_telescope() {
        geometry.telescope_limits = NO_TELESCOPE;
    }
    check_geometry(&table, &geometry, mechanism, assembled)?;

    let bodies = read_bodies(&top.table("bodies")?, mechanism, assembled)?;
    let drives = read_drives(&top.table("drives")?, mechanism)?;
    let (mut sockets, mut noise) = (schema::SOCKETS_ZERO, schema::NOISE_ZERO);
    if delta {
        top.fill_table("sockets", schema::SOCKETS, &mut sockets, assembled, mechanism)?;
    }
    let stops = read_stops(top, &geometry, mechanism)?;
    top.fill_table("noise", schema::noise(mechanism), &mut noise, assembled, mechanism)?;
    let effects = match top.optional_table("effects")? {
        Some(table) => read_effects(&table, Host::new(mechanism, &drives[0]))?,
        None => Effects::default(),
    };
    Ok(Model {
        name,
        path: None,
        source: None,
        mechanism,
        assembled,
        geometry,
        bodies,
        link_parameters: LinkParameters::default(),
        drives,
        sockets,
        stops,
        noise,
        gravity: numbers.gravity,
        sample_time: numbers.sample_time,
        effects,
        history: read_history(top)?,
    })
}

/// Hard stops, which must leave the range of motion free; none without the table.
fn read_stops(top: &Table, geometry: &Geometry, mechanism: Mechanism) -> Result<Stops> {
    let mut stops = Stops::NONE;
    let delta = matches!(mechanism, Mechanism::Delta { .. });
    if !delta || top.entry("stops").is_none() {
        return Ok(stops);
    }
    top.fill_table("stops", schema::stops(mechanism), &mut stops, true, mechanism)?;
    let [low, high] = geometry.arm_limits;
    if stops.arm[0] > low || stops.arm[1] < high {
        let expected = format!("expected stops at or beyond geometry.arm_limits, {low} and {high} rad");
        return Err(top.table("stops")?.refuse("arm", &expected));
    }
    Ok(stops)
}

/// What was added to the model so far, `[[history]]`.
fn read_history(top: &Table) -> Result<Vec<Added>> {
    const KEYS: [&str; 6] = ["effect", "channels", "rms_before", "rms_after", "noise_floor", "held_out"];
    const EXPECTED: &str = "tables [[history]], one per effect that was added";
    let Some(value) = top.entry("history") else { return Ok(Vec::new()) };
    let DeValue::Array(items) = value.get_ref() else { return Err(top.wrong_type("history", value, EXPECTED)) };
    let one = |item: &Value<'_>| -> Result<Added> {
        let Some(entries) = item.get_ref().as_table() else { return Err(top.wrong_type("history", item, EXPECTED)) };
        let table = Table { file: top.file, path: "history".into(), span: item.span(), entries };
        table.only(&KEYS)?;
        let channels = table.strings("channels", "an array of names such as \"tau1\"")?;
        let rms = |key: &str| {
            let shape = Shape::Array(channels.len());
            table.numbers(key, shape, &Bounds::between(0.0, 1e9), Some("N·m or N, one per channel"))
        };
        Ok(Added {
            effect: table.string("effect", "the name of an effect")?.to_string(),
            rms_before: rms("rms_before")?,
            rms_after: rms("rms_after")?,
            noise_floor: rms("noise_floor")?,
            held_out: table.boolean("held_out")?,
            channels,
        })
    };
    items.iter().map(one).collect()
}

/// Limits of a telescope that is not there.
const NO_TELESCOPE: [f64; 2] = [0.0, f64::INFINITY];

/// Which machine the file describes; refuses the keys that other machines have.
fn read_mechanism(top: &Table) -> Result<Mechanism> {
    let kind = top.string("mechanism", "\"delta\" or \"axis\"")?;
    let (mechanism, own): (_, &[&str]) = match kind {
        "delta" => {
            let telescope = top.optional_boolean("telescope")?.unwrap_or(true);
            (Mechanism::Delta { telescope }, &["telescope", "assembled", "sockets", "stops"])
        }
        "axis" => {
            let joint = match top.string("joint", "\"revolute\" or \"prismatic\"")? {
                "revolute" => Joint::Revolute,
                "prismatic" => Joint::Prismatic,
                _ => return Err(top.refuse("joint", "expected \"revolute\" or \"prismatic\"")),
            };
            (Mechanism::Axis(joint), &["joint"])
        }
        _ => return Err(top.refuse("mechanism", "expected \"delta\" or \"axis\", the mechanisms known")),
    };
    let tables = ["name", "mechanism", "geometry", "bodies", "drives", "noise", "effects", "history"];
    top.only(&[&tables[..], own, &keys(schema::top(mechanism))].concat())?;
    Ok(mechanism)
}

/// Limits in order, struts that reach, a telescope that fits.
fn check_geometry(table: &Table, g: &Geometry, mechanism: Mechanism, assembled: bool) -> Result<()> {
    let [low, high] = g.arm_limits;
    if matches!(mechanism, Mechanism::Axis(_)) {
        return match low < high {
            true => Ok(()),
            false => Err(table.refuse("limits", "expected the smallest position first, then the largest")),
        };
    }
    if low >= high {
        return Err(table.refuse("arm_limits", "expected the smallest angle first, then the largest"));
    }
    if !(low..=high).contains(&0.0) {
        return Err(table.refuse("arm_limits", "expected limits that contain the home pose, arm angle 0 rad"));
    }
    if !assembled {
        return Ok(());
    }
    let least = check::least_strut_length(g);
    let shortest = g.strut_length.iter().copied().fold(f64::INFINITY, f64::min);
    if shortest <= least {
        return Err(table.refuse(
            "strut_length",
            &format!(
                "expected more than {least:.4} m: a strut must span |base_radius − platform_radius + \
                 arm_length·cos(angle)| for every arm angle within arm_limits"
            ),
        ));
    }
    let Some(home) = check::home(g) else {
        return Err(
            table.refuse("strut_length", "expected lengths with which the three limbs meet at the home pose q = 0")
        );
    };
    if !mechanism.has_telescope() {
        return Ok(());
    }
    let [min, max] = g.telescope_limits;
    if min >= max {
        return Err(table.refuse("telescope_limits", "expected the smallest length first, then the largest"));
    }
    if !(min..=max).contains(&home.telescope) {
        return Err(table.refuse(
            "telescope_limits",
            &format!(
                "expected limits that contain the telescope's length at the home pose q = 0, {:.4} m",
                home.telescope
            ),
        ));
    }
    Ok(())
}

/// Bodies that come in numbers share one table, e.g. `[bodies.arm]`; `[bodies.arm2]` overrides it for one of them.
pub(super) const GROUPS: [(&str, Range<usize>); 2] =
    [("arm", bodies::ARM..bodies::STRUT), ("strut", bodies::STRUT..bodies::PLATFORM)];

/// Whether the file may describe body `b` of a delta robot.
pub(super) fn body_known(b: usize, mechanism: Mechanism) -> bool {
    b < bodies::ROTOR || mechanism.has_telescope()
}

/// Whether it must.
pub(super) fn body_needed(b: usize, mechanism: Mechanism, assembled: bool) -> bool {
    let axis = (bodies::ARM..bodies::STRUT).contains(&b) || b == bodies::ROTOR;
    body_known(b, mechanism) && (axis || (assembled && b != bodies::END_EFFECTOR))
}

/// The shared table of body `b`, if it has one.
pub(super) fn body_group(b: usize) -> Option<&'static str> {
    GROUPS.iter().find(|(_, range)| range.contains(&b)).map(|(name, _)| *name)
}

/// Name of the table of what moves on a lone axis.
pub(super) const LONE_BODY: &str = "axis";

fn read_bodies(table: &Table, mechanism: Mechanism, assembled: bool) -> Result<Bodies> {
    let mut all = Bodies([Inertia::ZERO; BODIES]);
    if matches!(mechanism, Mechanism::Axis(_)) {
        table.only(&[LONE_BODY])?;
        all[bodies::ARM] = read_inertia(&table.table(LONE_BODY)?, mechanism)?;
        return Ok(all);
    }
    let own = (0..BODIES).filter(|&b| body_known(b, mechanism)).map(body_name);
    let names: Vec<String> = GROUPS.iter().map(|(name, _)| name.to_string()).chain(own).collect();
    table.only(&names.iter().map(String::as_str).collect::<Vec<_>>())?;
    for b in 0..BODIES {
        let own = table.optional_table(&body_name(b))?;
        let shared = body_group(b).map(|name| table.optional_table(name)).transpose()?.flatten();
        match own.or(shared) {
            Some(t) => all[b] = read_inertia(&t, mechanism)?,
            None if body_needed(b, mechanism, assembled) => {
                return Err(table.lacks(&format!("table [bodies.{}]", body_group(b).unwrap_or(&body_name(b)))));
            }
            None => {}
        }
    }
    Ok(all)
}

fn read_inertia(table: &Table, mechanism: Mechanism) -> Result<Inertia> {
    let fields = schema::inertia(mechanism);
    table.only(&keys(fields))?;
    let mut inertia = Inertia::ZERO;
    table.fill(fields, &mut inertia, true, mechanism)?;
    match check::inconsistency(&inertia) {
        None => Ok(inertia),
        Some((culprit, reason)) => {
            let key = fields[match culprit {
                Culprit::Mass => schema::MASS,
                Culprit::FirstMoment => schema::FIRST_MOMENT,
                Culprit::Tensor => schema::TENSOR,
            }]
            .key;
            Err(table.refuse(key, &format!("{reason}; expected the inertia of a real body")))
        }
    }
}

fn read_drives(table: &Table, mechanism: Mechanism) -> Result<[Drive; AXES]> {
    let groups = schema::drive_groups(mechanism);
    table.only(&groups.iter().map(|(name, _)| *name).collect::<Vec<_>>())?;
    let mut drives = [schema::DRIVE_ZERO; AXES];
    for (name, range) in groups {
        let drives = &mut drives[range.clone()];
        let table = table.table(name)?;
        table.only(&keys(schema::DRIVE))?;
        for field in schema::DRIVE {
            let (shape, unit) = (drive_shape(drives.len()), field.unit.map(|unit| mechanism.unit(unit)));
            (field.set)(drives, &table.numbers(field.key, shape, &field.bounds, unit)?);
        }
    }
    Ok(drives)
}

/// Numbers per key of a drive table that describes `n` drives.
pub(super) fn drive_shape(n: usize) -> Shape {
    if n == 1 { Shape::One } else { Shape::OneOrArray(n) }
}

fn read_effects(table: &Table, host: Host) -> Result<Effects> {
    let names: Vec<&str> = REGISTRY.iter().map(|e| e.name()).filter(|n| *n != ALWAYS_PRESENT).collect();
    if table.entry(ALWAYS_PRESENT).is_some() {
        return Err(table.refuse_key(
            ALWAYS_PRESENT,
            "is always present and takes its numbers from [bodies]; expected no table for it",
            None,
        ));
    }
    if let Some((key, _)) = table.sorted().into_iter().find(|(key, _)| !names.contains(key)) {
        let message = format!("unknown effect; expected one of {}", names.join(", "));
        return Err(table.refuse_key(key, &message, suggestion(key, &names)));
    }
    let mut active = Effects::default();
    for effect in REGISTRY.iter() {
        if let Some(own) = table.optional_table(effect.name())? {
            // An effect on what is only dismounted may stay.
            let part = effect.acts_on();
            if !host.mechanism.has(part, true) {
                let why =
                    format!("acts on {}, which this machine does not have; expected no table for it", part.describe());
                return Err(table.refuse_key(effect.name(), &why, None));
            }
            active.push(read_effect(&own, Arc::clone(effect), host)?);
        }
    }
    Ok(active)
}

/// The effect that needs no table.
pub(super) const ALWAYS_PRESENT: &str = "rigid_bodies";

fn read_effect(table: &Table, effect: Arc<dyn Effect>, host: Host) -> Result<ActiveEffect> {
    if effect.formula().is_some() {
        return formula::read(table, host);
    }
    let parameters: Vec<Parameter> = effect.parameters().iter().map(|p| host.parameter(p)).collect();
    table.only(&parameters.iter().map(|p| &*p.name).collect::<Vec<_>>())?;
    let mut blocks = Vec::new();
    for p in &parameters {
        let present = p.role == Role::Linear || table.entry(&p.name).is_some();
        blocks.push(if present {
            table.numbers(
                &p.name,
                Shape::of(p, host.mechanism),
                &Bounds::between(p.range.0, p.range.1),
                Some(p.unit),
            )?
        } else {
            default_values(p, host.mechanism)
        });
    }
    let blocks: Vec<&[f64]> = blocks.iter().map(Vec::as_slice).collect();
    Ok(ActiveEffect { host, ..ActiveEffect::new(effect, &blocks) })
}

/// Values of an optional parameter that the file leaves out.
pub(super) fn default_values(p: &Parameter, mechanism: Mechanism) -> Vec<f64> {
    vec![p.default; p.count.on(mechanism)]
}

fn keys<T: ?Sized>(fields: &[Field<T>]) -> Vec<&'static str> {
    fields.iter().map(|f| f.key).collect()
}

/// The known name nearest to a misspelt one.
fn suggestion(wrong: &str, known: &[&str]) -> Option<String> {
    nearest(wrong, known.iter().copied()).map(|name| format!("did you mean `{name}`?"))
}

/// A model file as text.
struct File<'a> {
    name: String,
    text: &'a str,
}

impl File<'_> {
    fn problem(&self, span: Range<usize>, message: String, label: String) -> Report {
        let before = self.text.get(..span.start).unwrap_or(self.text);
        let line_start = before.rfind('\n').map_or(0, |i| i + 1);
        Problem {
            file: self.name.clone(),
            line: before.matches('\n').count() + 1,
            column: before[line_start..].chars().count() + 1,
            message,
            text: NamedSource::new(&self.name, self.text.to_string()).with_language("toml"),
            span: span.into(),
            label,
        }
        .into()
    }

    /// The text of a value, on one line and not too long.
    fn quote(&self, span: Range<usize>) -> String {
        let text: Vec<&str> = self.text.get(span).unwrap_or("").split_whitespace().collect();
        let text = text.join(" ");
        if text.chars().count() <= 60 { text } else { text.chars().take(57).chain("...".chars()).collect() }
    }
}

/// A refused model file.
#[derive(Debug, thiserror::Error, Diagnostic)]
#[error("{file}:{line}:{column}: {message}")]
struct Problem {
    file: String,
    line: usize,
    column: usize,
    message: String,
    #[source_code]
    text: NamedSource<String>,
    #[label("{label}")]
    span: SourceSpan,
    label: String,
}

type Value<'a> = Spanned<DeValue<'a>>;

/// A table of the file.
struct Table<'a> {
    file: &'a File<'a>,
    /// Dotted name, empty at the top.
    path: String,
    span: Range<usize>,
    entries: &'a DeTable<'a>,
}

impl<'a> Table<'a> {
    /// Keys and their spans in the order of the file.
    fn sorted(&self) -> Vec<(&'a str, Range<usize>)> {
        let mut keys: Vec<_> = self.entries.keys().map(|k| (k.get_ref().as_ref(), k.span())).collect();
        keys.sort_by_key(|(_, span)| span.start);
        keys
    }

    fn entry(&self, key: &str) -> Option<&'a Value<'a>> {
        self.entries.get(key)
    }

    fn place(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_string() } else { format!("[{}] {key}", self.path) }
    }

    fn title(&self) -> String {
        if self.path.is_empty() { "the file".to_string() } else { format!("[{}]", self.path) }
    }

    /// Refuses keys that are not in `known`.
    fn only(&self, known: &[&str]) -> Result<()> {
        match self.sorted().into_iter().find(|(key, _)| !known.contains(key)) {
            None => Ok(()),
            Some((key, _)) => {
                let message = format!("unknown key; expected one of {}", known.join(", "));
                Err(self.refuse_key(key, &message, suggestion(key, known)))
            }
        }
    }

    /// The value of `key` will not do.
    fn refuse(&self, key: &str, why: &str) -> Report {
        match self.entry(key) {
            Some(value) => self.refuse_at(key, value.span(), why),
            None => self.lacks(&format!("`{key}`")),
        }
    }

    /// The part of `key`'s value at `span` will not do.
    fn refuse_at(&self, key: &str, span: Range<usize>, why: &str) -> Report {
        let whole = self.entry(key).map_or(span.clone(), Spanned::span);
        let message = format!("{} = {}: {why}", self.place(key), self.file.quote(whole));
        let label = why.find("expected").map_or(why, |at| &why[at..]).to_string();
        self.file.problem(span, message, label)
    }

    /// `key` itself will not do.
    fn refuse_key(&self, key: &str, why: &str, hint: Option<String>) -> Report {
        let span = self.entries.get_key_value(key).map_or(self.span.clone(), |(k, _)| k.span());
        let hint = hint.map_or(String::new(), |h| format!("; {h}"));
        self.file.problem(span, format!("{}: {why}{hint}", self.place(key)), "here".into())
    }

    fn lacks(&self, what: &str) -> Report {
        self.file.problem(self.span.clone(), format!("{} lacks {what}", self.title()), format!("expected {what}"))
    }

    fn required(&self, key: &str, expected: &str) -> Result<&'a Value<'a>> {
        self.entry(key).ok_or_else(|| self.lacks(&format!("`{key}`: expected {expected}")))
    }

    fn wrong_type(&self, key: &str, value: &Value, expected: &str) -> Report {
        let found = value.get_ref().type_str();
        self.refuse_at(key, value.span(), &format!("found {}, expected {expected}", article(found)))
    }

    fn string(&self, key: &str, expected: &str) -> Result<&'a str> {
        let value = self.required(key, expected)?;
        value.get_ref().as_str().ok_or_else(|| self.wrong_type(key, value, expected))
    }

    fn strings(&self, key: &str, expected: &str) -> Result<Vec<String>> {
        let value = self.required(key, expected)?;
        let DeValue::Array(items) = value.get_ref() else { return Err(self.wrong_type(key, value, expected)) };
        let one = |item: &Value<'_>| {
            item.get_ref().as_str().ok_or_else(|| self.wrong_type(key, item, expected)).map(String::from)
        };
        items.iter().map(one).collect()
    }

    fn boolean(&self, key: &str) -> Result<bool> {
        let value = self.required(key, "true or false")?;
        value.get_ref().as_bool().ok_or_else(|| self.wrong_type(key, value, "true or false"))
    }

    fn optional_boolean(&self, key: &str) -> Result<Option<bool>> {
        self.entry(key).map(|_| self.boolean(key)).transpose()
    }

    fn table(&self, key: &str) -> Result<Table<'a>> {
        let path = if self.path.is_empty() { key.to_string() } else { format!("{}.{key}", self.path) };
        self.optional_table(key)?.ok_or_else(|| self.lacks(&format!("table [{path}]")))
    }

    fn optional_table(&self, key: &str) -> Result<Option<Table<'a>>> {
        let Some((name, value)) = self.entries.get_key_value(key) else {
            return Ok(None);
        };
        let path = if self.path.is_empty() { key.to_string() } else { format!("{}.{key}", self.path) };
        match value.get_ref().as_table() {
            Some(entries) => Ok(Some(Table { file: self.file, path, span: name.span(), entries })),
            None => Err(self.wrong_type(key, value, &format!("a table [{path}]"))),
        }
    }

    /// Fills `target` from this table; keys that a disassembled robot does not need may be missing from it.
    fn fill<T: ?Sized>(&self, fields: &[Field<T>], target: &mut T, assembled: bool, units: Mechanism) -> Result<()> {
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
    fn fill_table<T: ?Sized>(
        &self,
        key: &str,
        fields: &[Field<T>],
        target: &mut T,
        needed: bool,
        units: Mechanism,
    ) -> Result<()> {
        if needed || self.entry(key).is_some() {
            let table = self.table(key)?;
            table.only(&keys(fields))?;
            table.fill(fields, target, true, units)?;
        }
        Ok(())
    }

    /// The numbers of `key`; a lone number that stands for several is repeated.
    fn numbers(&self, key: &str, shape: Shape, bounds: &Bounds, unit: Option<impl Display + Copy>) -> Result<Vec<f64>> {
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

    fn number(&self, key: &str, value: &Value, bounds: &Bounds, expected: &str, which: &str) -> Result<f64> {
        let number = match value.get_ref() {
            DeValue::Float(f) => f.as_str().parse::<f64>().ok(),
            DeValue::Integer(i) => i128::from_str_radix(i.as_str(), i.radix()).ok().map(|i| i as f64),
            _ => None,
        };
        match number {
            Some(v) if bounds.allow(v) => Ok(v),
            Some(_) => {
                let text = self.file.quote(value.span());
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
