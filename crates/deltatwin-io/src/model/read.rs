//! TOML → [`Model`], with errors that state file, line, key, value and what was expected.
//!
//! The file is traversed as a tree of spanned values instead of being deserialized into structs, so that every message
//! can quote the value, state its position and suggest the nearest known name.

use std::path::Path;
use std::sync::Arc;

use deltatwin::effects::{ActiveEffect, Count, Effect, Effects, Host, Parameter, REGISTRY, Role};
use deltatwin::machine::bodies::{self, SLOTS, body_name};
use deltatwin::machine::check::{self, Culprit};
use deltatwin::machine::{
    Actuator, Axis, Bodies, Drive, Effort, Geometry, Inertia, Joint, LinkParameters, Mechanism, Members, PerAxis,
    Stops, each,
};
use deltatwin::model::{Added, Model};
use miette::{Result, WrapErr, miette};
use toml::de::{DeTable, DeValue};

use super::schema::{self, Bounds, Shape};
use super::shipped;
use super::table::{Table, Value, keys, suggestion};
use super::{limbs, meshes};
use crate::file;
use crate::kind::Kind;
use crate::source::{Checked, Source};

mod formula;

/// Reads a model file, or the shipped model of that name.
///
/// # Errors
/// If the file cannot be read; else the first error in it, with its position.
pub fn read(path: &Path) -> Result<Model> {
    if let Some(text) = shipped::named(path) {
        return parse(text, path);
    }
    let known = || shipped::SHIPPED.map(|(name, _)| name).join(", ");
    let bare = path.extension().is_none() && path.parent().is_none_or(|folder| folder.as_os_str().is_empty());
    let unread = |e: std::io::Error| match bare {
        true => miette!(help = format!("expected a file, or a shipped model: {}", known()), "{e}"),
        false => miette!("{e}"),
    };
    let text =
        file::text(path).map_err(unread).wrap_err_with(|| format!("cannot read model file {}", path.display()))?;
    let other = Kind::instead_of(Kind::Model, &text);
    parse(&text, path)
        .map_err(|e| other.map_or(e, |other| miette!("{}: is a {other}; expected a model", path.display())))
}

/// Reads a model from `text`; `path` is named in errors.
///
/// # Errors
/// The first error in the text, with its position.
pub fn parse(text: &str, path: &Path) -> Result<Model> {
    let source = Source::new(path.display(), text);
    let root = DeTable::parse(text).map_err(|e| source.broken(&e))?;
    let top = Table { source: &source, path: String::new(), span: 0..0, entries: root.get_ref() };
    let mut model = read_model(&top)?;
    model.path = Some(path.to_path_buf());
    model.source = Some(Arc::from(text));
    Ok(model)
}

fn read_model(top: &Table) -> Checked<Model> {
    let name = top.string("name", "the machine's name, a string")?.to_string();
    let (mechanism, mut geometry) = read_mechanism(top)?;
    let regular = geometry.is_regular();
    let delta = matches!(mechanism, Mechanism::Delta { .. });
    let assembled = if delta { top.boolean("assembled")? } else { false };
    let mut numbers = schema::Top { gravity: 0.0, sample_time: 0.0 };
    top.fill(schema::top(mechanism), &mut numbers, true, mechanism)?;

    let table = top.table("geometry")?;
    table.only(&keys(schema::geometry(mechanism, regular)))?;
    table.fill(schema::geometry(mechanism, regular), &mut geometry, assembled, schema::of_links(mechanism))?;
    if !mechanism.has_telescope() {
        geometry.telescope_limits = NO_TELESCOPE;
    }
    match regular {
        true => check_geometry(&table, &geometry, mechanism, assembled)?,
        false if assembled => limbs::check(&table, &geometry)?,
        false => {}
    }

    let bodies = read_bodies(&top.table("bodies")?, mechanism, assembled)?;
    let drives = read_drives(&top.table("drives")?, mechanism)?;
    let (mut sockets, mut noise) = (schema::SOCKETS_ZERO, schema::NOISE_ZERO);
    if delta {
        top.fill_table("sockets", schema::SOCKETS, &mut sockets, assembled, schema::of_links(mechanism))?;
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
        link_parameters: LinkParameters { each_limb: read_limbs(top)?, ..LinkParameters::default() },
        drives,
        sockets,
        stops,
        noise,
        gravity: numbers.gravity,
        sample_time: numbers.sample_time,
        effects,
        history: read_history(top)?,
        meshes: meshes::read(top, mechanism)?,
    })
}

/// Reads the hard stops, which must be outside the range of motion; [`Stops::NONE`] without the table.
fn read_stops(top: &Table, geometry: &Geometry, mechanism: Mechanism) -> Checked<Stops> {
    let mut stops = Stops::NONE;
    let delta = matches!(mechanism, Mechanism::Delta { .. });
    if !delta || top.entry("stops").is_none() {
        return Ok(stops);
    }
    top.fill_table("stops", schema::stops(mechanism), &mut stops, true, mechanism)?;
    let [low, high] = geometry.arm_limits();
    if stops.arm[0] > low || stops.arm[1] < high {
        let expected = format!("expected stops at or beyond geometry.arm_limits(), {low} and {high} rad");
        return Err(top.table("stops")?.refuse("arm", &expected));
    }
    Ok(stops)
}

/// Reads the effects added to the model, `[[history]]`.
fn read_history(top: &Table) -> Checked<Vec<Added>> {
    const KEYS: [&str; 6] = ["effect", "channels", "rms_before", "rms_after", "noise_floor", "held_out"];
    const EXPECTED: &str = "tables [[history]], one per effect that was added";
    let Some(value) = top.entry("history") else { return Ok(Vec::new()) };
    let DeValue::Array(items) = value.get_ref() else { return Err(top.wrong_type("history", value, EXPECTED)) };
    let one = |item: &Value<'_>| -> Checked<Added> {
        let Some(entries) = item.get_ref().as_table() else { return Err(top.wrong_type("history", item, EXPECTED)) };
        let table = Table { source: top.source, path: "history".into(), span: item.span(), entries };
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

/// Limits in place of those of a telescope.
const NO_TELESCOPE: [f64; 2] = [0.0, f64::INFINITY];

/// Kind of machine described by the file; rejects the keys of other machines.
fn read_mechanism(top: &Table) -> Checked<(Mechanism, Geometry)> {
    const EXPECTED: &str = "\"delta\", \"parallel\" or \"axis\"";
    let kind = top.string("mechanism", EXPECTED)?;
    let empty = Geometry { telescope_limits: [0.0; 2], ..Geometry::single([0.0; 2]) };
    let geometry = if kind == "parallel" { limbs::read(top)? } else { empty };
    let (mechanism, own): (_, &[&str]) = match kind {
        "delta" => {
            let telescope = top.optional_boolean("telescope")?.unwrap_or(true);
            let arms = if top.entry("arms").is_some() { read_joint(top, "arms")? } else { Joint::Revolute };
            if telescope && arms == Joint::Prismatic {
                return Err(top.refuse("arms", "expected `telescope = false` beside arms that are carriages"));
            }
            (
                Mechanism::Delta { telescope, arms, members: Members::DELTA },
                &["telescope", "arms", "limbs", "assembled", "sockets", "stops"],
            )
        }
        "parallel" => {
            let (arms, members) = (geometry.actuator().joint(), Members::of(&geometry));
            let own: &[&str] = &["limbs", "plate", "coupling", "assembled", "sockets", "stops"];
            (Mechanism::Delta { telescope: false, arms, members }, own)
        }
        "axis" => {
            let joint = read_joint(top, "joint")?;
            (Mechanism::Axis(Axis { joint, effort: read_effort(top, joint)? }), &["joint", "effort"])
        }
        _ => return Err(top.refuse("mechanism", &format!("expected {EXPECTED}, the mechanisms known"))),
    };
    let tables = ["name", "mechanism", "geometry", "bodies", "drives", "noise", "effects", "history", "meshes"];
    top.only(&[&tables[..], own, &keys(schema::top(mechanism))].concat())?;
    Ok((mechanism, geometry))
}

/// Whether every limb has parameters of its own.
fn read_limbs(top: &Table) -> Checked<bool> {
    const EXPECTED: &str = "\"alike\" or \"own\"";
    if top.entry("limbs").is_none_or(|value| value.get_ref().is_array()) {
        return Ok(false);
    }
    match top.string("limbs", EXPECTED)? {
        "alike" => Ok(false),
        "own" => Ok(true),
        _ => Err(top.refuse("limbs", &format!("expected {EXPECTED}: whether all limbs share their parameters"))),
    }
}

/// The joint type that `key` states.
fn read_joint(top: &Table, key: &str) -> Checked<Joint> {
    const EXPECTED: &str = "\"revolute\" or \"prismatic\"";
    match top.string(key, EXPECTED)? {
        "revolute" => Ok(Joint::Revolute),
        "prismatic" => Ok(Joint::Prismatic),
        _ => Err(top.refuse(key, &format!("expected {EXPECTED}"))),
    }
}

/// Quantity in which the efforts of a single axis are stated: current with `effort = "A"`, else torque or force.
fn read_effort(top: &Table, joint: Joint) -> Checked<Effort> {
    if top.entry("effort").is_none() {
        return Ok(Effort::Force);
    }
    let (unit, plain) = if joint == Joint::Revolute { ("N·m", "Nm") } else { ("N", "N") };
    let expected =
        format!("\"A\" for an axis whose motor current is recorded, or \"{unit}\", which holds without the key");
    match top.string("effort", &expected)? {
        "A" => Ok(Effort::Current),
        text if text == unit || text == plain => Ok(Effort::Force),
        _ => Err(top.refuse("effort", &format!("expected {expected}"))),
    }
}

/// Checks the order of limits, the reach of the struts and the length of the telescope.
fn check_geometry(table: &Table, g: &Geometry, mechanism: Mechanism, assembled: bool) -> Checked<()> {
    let [low, high] = g.arm_limits();
    if matches!(mechanism, Mechanism::Axis(_)) {
        return match low < high {
            true => Ok(()),
            false => Err(table.refuse("limits", "expected the smallest position first, then the largest")),
        };
    }
    let (what, home) = match g.actuator() {
        Actuator::Revolute => ("angle", "arm angle 0 rad"),
        Actuator::Prismatic { .. } => ("position", "carriages at 0 m"),
    };
    if low >= high {
        return Err(table.refuse("arm_limits", &format!("expected the smallest {what} first, then the largest")));
    }
    if !(low..=high).contains(&0.0) {
        return Err(table.refuse("arm_limits", &format!("expected limits that contain the home pose, {home}")));
    }
    if !assembled {
        return Ok(());
    }
    let least = g.least_strut_length();
    let shortest = g.limbs.iter().map(|limb| limb.strut_length).fold(f64::INFINITY, f64::min);
    if shortest <= least {
        let (reach, position) = match g.actuator() {
            Actuator::Revolute => ("arm_length·cos(angle)", "arm angle"),
            Actuator::Prismatic { .. } => ("q·cos(inclination)", "carriage position q"),
        };
        return Err(table.refuse(
            "strut_length",
            &format!(
                "expected more than {least:.4} m: a strut must span |base_radius − platform_radius + {reach}| for every \
                 {position} within arm_limits"
            ),
        ));
    }
    let Some(home) = g.home() else {
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

/// Bodies that share one table, e.g. `[bodies.arm]`; `[bodies.arm2]` overrides it for one of them.
pub(super) fn groups(mechanism: Mechanism) -> [(&'static str, Vec<usize>); 2] {
    let (limbs, struts) = (0..mechanism.limbs(), 0..mechanism.struts());
    [("arm", limbs.map(bodies::arm).collect()), ("strut", struts.map(bodies::strut).collect())]
}

/// Whether the file may describe body `b` of the machine.
pub(super) fn body_known(b: usize, mechanism: Mechanism) -> bool {
    mechanism.has_body(b)
}

/// Whether the file must describe body `b`.
pub(super) fn body_needed(b: usize, mechanism: Mechanism, assembled: bool) -> bool {
    let axis = body_group(b) == Some("arm") || b == bodies::ROTOR;
    let carries = b != bodies::END_EFFECTOR || mechanism.plate_turns();
    body_known(b, mechanism) && (axis || (assembled && carries))
}

/// Name of the shared table of body `b`, if any.
pub(super) fn body_group(b: usize) -> Option<&'static str> {
    ["arm", "strut"].into_iter().find(|group| body_name(b).starts_with(group))
}

/// Name of the table of the moving part of a single axis.
pub(super) const LONE_BODY: &str = "axis";

fn read_bodies(table: &Table, mechanism: Mechanism, assembled: bool) -> Checked<Bodies> {
    let mut all = Bodies([Inertia::ZERO; SLOTS]);
    if matches!(mechanism, Mechanism::Axis(_)) {
        table.only(&[LONE_BODY])?;
        all[bodies::ARM] = read_inertia(&table.table(LONE_BODY)?, mechanism)?;
        return Ok(all);
    }
    let own = (0..SLOTS).filter(|&b| body_known(b, mechanism)).map(body_name);
    let names: Vec<String> = groups(mechanism).iter().map(|(name, _)| name.to_string()).chain(own).collect();
    table.only(&names.iter().map(String::as_str).collect::<Vec<_>>())?;
    for b in (0..SLOTS).filter(|&b| body_known(b, mechanism)) {
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

fn read_inertia(table: &Table, mechanism: Mechanism) -> Checked<Inertia> {
    let fields = schema::inertia(mechanism);
    table.only(&keys(fields))?;
    let mut inertia = Inertia::ZERO;
    table.fill(fields, &mut inertia, true, schema::of_links(mechanism))?;
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

fn read_drives(table: &Table, mechanism: Mechanism) -> Checked<PerAxis<Drive>> {
    let groups = schema::drive_groups(mechanism);
    table.only(&groups.iter().map(|(name, _)| *name).collect::<Vec<_>>())?;
    let mut drives: PerAxis<_> = each(schema::DRIVE_ZERO);
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

/// Shape of the keys of a drive table that describes `n` drives.
pub(super) fn drive_shape(n: usize) -> Shape {
    if n == 1 { Shape::One } else { Shape::OneOrArray(n) }
}

fn read_effects(table: &Table, host: Host) -> Checked<Effects> {
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
            // An effect on a part that is only dismounted is allowed.
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

/// The effect without a table.
pub(super) const ALWAYS_PRESENT: &str = "rigid_bodies";

fn read_effect(table: &Table, effect: Arc<dyn Effect>, host: Host) -> Checked<ActiveEffect> {
    if effect.formula().is_some() {
        return formula::read(table, host);
    }
    let parameters: Vec<Parameter> = effect.parameters().iter().map(|p| host.parameter(effect.acts_on(), p)).collect();
    table.only(&parameters.iter().map(|p| &*p.name).collect::<Vec<_>>())?;
    let mut blocks = Vec::new();
    for p in &parameters {
        let present = p.role == Role::Linear || p.count == Count::List || table.entry(&p.name).is_some();
        blocks.push(if present {
            table.numbers(
                &p.name,
                Shape::of(p, host.mechanism),
                &Bounds::between(p.least(), p.range.1),
                Some(p.unit),
            )?
        } else {
            default_values(p, host.mechanism)
        });
    }
    check_lists(table, &parameters, &blocks, host)?;
    let blocks: Vec<&[f64]> = blocks.iter().map(Vec::as_slice).collect();
    Ok(ActiveEffect { host, ..ActiveEffect::new(effect, &blocks) })
}

/// Checks that values of lists differ, and that every parameter that refers to a list has its number of values.
fn check_lists(table: &Table, parameters: &[Parameter], blocks: &[Vec<f64>], host: Host) -> Checked<()> {
    for (p, values) in parameters.iter().zip(blocks) {
        match p.count {
            Count::List if (1..values.len()).any(|i| values[..i].contains(&values[i])) => {
                return Err(table.refuse(&p.name, "expected numbers that all differ"));
            }
            Count::PerArmOf(list) => {
                let (names, expected) = (&parameters[list].name, p.count.on(host.mechanism) * blocks[list].len());
                if values.len() != expected {
                    let why = format!(
                        "found {} values, expected {expected}: one per arm for each of `{names}`",
                        values.len()
                    );
                    return Err(table.refuse(&p.name, &why));
                }
            }
            _ => {}
        }
    }
    Ok(())
}

/// Values of an optional parameter that the file omits.
pub(super) fn default_values(p: &Parameter, mechanism: Mechanism) -> Vec<f64> {
    vec![p.default; p.count.on(mechanism)]
}
