//! `[payload]`, `[[objects]]` and `[[actions]]`.

use std::path::Path;
use std::sync::Arc;

use nalgebra::{Rotation3, Vector3};
use serde::Deserialize;
use toml::Spanned;

use crate::source::{Checked, Interval, Source};
use deltatwin::cell::{Mobility, Object, Shape, Surface};
use deltatwin::machine::Payload;
use deltatwin::scenario::{Action, ActionKind, PayloadShape};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct LoadKeys {
    #[serde(rename = "box")]
    cuboid: Option<Spanned<[f64; 3]>>,
    density: Option<Spanned<f64>>,
    grip: Option<Spanned<[f64; 3]>>,
    pub(crate) drag_factor: Option<Spanned<f64>>,
    mass: Option<Spanned<f64>>,
    com: Option<Spanned<[f64; 3]>>,
    inertia_zz: Option<Spanned<f64>>,
    inertia: Option<Spanned<Vec<f64>>>,
    shape: Option<Spanned<String>>,
    size: Option<Spanned<[f64; 3]>>,
    radius: Option<Spanned<f64>>,
    height: Option<Spanned<f64>>,
    file: Option<Spanned<String>>,
    scale: Option<Spanned<f64>>,
    centre: Option<Spanned<[f64; 3]>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ObjectKeys {
    name: Spanned<String>,
    shape: Spanned<String>,
    size: Option<Spanned<[f64; 3]>>,
    radius: Option<Spanned<f64>>,
    height: Option<Spanned<f64>>,
    file: Option<Spanned<String>>,
    scale: Option<Spanned<f64>>,
    mobility: Option<Spanned<String>>,
    velocity: Option<Spanned<[f64; 3]>>,
    mass: Option<Spanned<f64>>,
    position: Spanned<[f64; 3]>,
    yaw: Option<Spanned<f64>>,
    friction: Option<Spanned<f64>>,
    stiffness: Option<Spanned<f64>>,
    dissipation: Option<Spanned<f64>>,
    rolling: Option<Spanned<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ActionKeys {
    t: Spanned<f64>,
    pick: Option<Spanned<String>>,
    release: Option<Spanned<bool>>,
}

/// Largest mass of a payload, kg, and largest density, kg/m³.
const HEAVIEST: f64 = 100.0;
const DENSEST: f64 = 25e3;
/// Rounding of the height at which a box is held, m.
const FLUSH: f64 = 1e-9;

/// A box: its edges, its mass or density, and the point at which the flange holds it.
fn cuboid(file: &Source, keys: &LoadKeys, edges: &Spanned<[f64; 3]>) -> Checked<(Payload, PayloadShape)> {
    let [low, high] = MEASURES;
    let size = file.numbers("payload.box", edges, Interval(low, high.min(2.0), "m"))?;
    let context = "a payload that is a box";
    file.foreign("payload.com", &keys.com, context)?;
    file.foreign("payload.inertia_zz", &keys.inertia_zz, context)?;
    file.foreign("payload.inertia", &keys.inertia, context)?;
    file.foreign("payload.shape", &keys.shape, context)?;
    file.foreign("payload.size", &keys.size, context)?;
    file.foreign("payload.radius", &keys.radius, context)?;
    file.foreign("payload.height", &keys.height, context)?;
    file.foreign("payload.file", &keys.file, context)?;
    file.foreign("payload.scale", &keys.scale, context)?;
    file.foreign("payload.centre", &keys.centre, context)?;
    let volume: f64 = size.iter().product();
    let mass = match (&keys.mass, &keys.density) {
        (Some(mass), None) => file.within("payload.mass", mass, Interval(0.0, HEAVIEST, "kg"))?,
        (None, Some(density)) => {
            let mass = file.within("payload.density", density, Interval(0.0, DENSEST, "kg/m³"))? * volume;
            if mass > HEAVIEST {
                let message = format!(
                    "`payload.density` is {}, which makes the box {mass:.1} kg; expected at most {HEAVIEST} kg",
                    density.get_ref()
                );
                return Err(file.problem(density.span(), message));
            }
            mass
        }
        (Some(_), Some(density)) => {
            let message = "`payload.density` stands beside `payload.mass`; expected one of them".into();
            return Err(file.problem(density.span(), message));
        }
        (None, None) => {
            let message = "`payload.box` lacks its mass; expected `mass` or `density` beside it".into();
            return Err(file.problem(edges.span(), message));
        }
    };
    let top = 0.5 * size[2];
    let grip = match &keys.grip {
        None => [0.0, 0.0, top],
        Some(grip) => {
            let place = file.numbers("payload.grip", grip, Interval(-2.0, 2.0, "m"))?;
            if place[2] < top - FLUSH {
                let message = format!(
                    "`payload.grip` has z = {}, so that the box would reach above the flange; expected {top} m (its top) \
                     or more",
                    place[2]
                );
                return Err(file.problem(grip.span(), message));
            }
            place
        }
    };
    let payload = Payload::cuboid(mass, size, grip);
    let shape = PayloadShape { shape: Shape::Box { size: size.into() }, centre: payload.com };
    Ok((payload, shape))
}

/// Drag factor c_w of the payload, if stated.
pub(crate) fn drag_factor(file: &Source, keys: &LoadKeys) -> Checked<Option<f64>> {
    if keys.cuboid.is_none() {
        file.foreign("payload.drag_factor", &keys.drag_factor, "a payload without `box`")?;
    }
    file.maybe("payload.drag_factor", &keys.drag_factor, Interval(0.0, 5.0, ""))
}

/// Payload and its shape.
pub(crate) fn payload(file: &Source, keys: &LoadKeys) -> Checked<(Payload, Option<PayloadShape>)> {
    if let Some(edges) = &keys.cuboid {
        return cuboid(file, keys, edges).map(|(payload, shape)| (payload, Some(shape)));
    }
    let without = "a payload without `box`";
    file.foreign("payload.density", &keys.density, without)?;
    file.foreign("payload.grip", &keys.grip, without)?;
    let Some(mass) = &keys.mass else {
        return Err(file.problem(0..0, "[payload] lacks `mass`; expected kg, or a `box` with its `density`".into()));
    };
    let vector = |key: &str, value: &Option<Spanned<[f64; 3]>>| -> Checked<Option<[f64; 3]>> {
        value.as_ref().map(|v| file.numbers(key, v, Interval(-2.0, 2.0, "m"))).transpose()
    };
    let mass = file.within("payload.mass", mass, Interval(0.0, HEAVIEST, "kg"))?;
    let com = vector("payload.com", &keys.com)?.unwrap_or_default();
    let vertical = file.maybe("payload.inertia_zz", &keys.inertia_zz, Interval(0.0, 100.0, "kg·m²"))?;
    let payload = file.payload(mass, com, vertical, &keys.inertia)?;
    let measures =
        Measures { size: &keys.size, radius: &keys.radius, height: &keys.height, file: &keys.file, scale: &keys.scale };
    let Some(kind) = &keys.shape else {
        let without = "a payload without `shape`";
        file.foreign("payload.size", &keys.size, without)?;
        file.foreign("payload.radius", &keys.radius, without)?;
        file.foreign("payload.height", &keys.height, without)?;
        file.foreign("payload.file", &keys.file, without)?;
        file.foreign("payload.scale", &keys.scale, without)?;
        file.foreign("payload.centre", &keys.centre, without)?;
        return Ok((payload, None));
    };
    let (shape, offset) = shape(file, "payload", kind, &measures)?;
    let centre = vector("payload.centre", &keys.centre)?.map_or(payload.com, |c| Vector3::from(c) + offset);
    Ok((payload, Some(PayloadShape { shape, centre })))
}

struct Measures<'a> {
    size: &'a Option<Spanned<[f64; 3]>>,
    radius: &'a Option<Spanned<f64>>,
    height: &'a Option<Spanned<f64>>,
    file: &'a Option<Spanned<String>>,
    scale: &'a Option<Spanned<f64>>,
}

#[derive(Clone, Copy)]
enum ShapeKind {
    Box,
    Cylinder,
    Sphere,
    Hull,
    Mesh,
}

/// Smallest and largest dimension of a shape, m.
const MEASURES: [f64; 2] = [1e-4, 20.0];

/// Smallest and largest length unit of a mesh file, m.
const SCALES: [f64; 2] = [1e-6, 1e3];

/// A shape, and its centre in the frame of its file, m.
fn shape(file: &Source, table: &str, kind: &Spanned<String>, measures: &Measures) -> Checked<(Shape, Vector3<f64>)> {
    let [low, high] = MEASURES;
    let key = |name: &str| format!("{table}.{name}");
    let context = format!("shape = \"{}\"", kind.get_ref());
    let length = |name: &str, value: &Option<Spanned<f64>>| {
        let value = file.needed(&key(name), value, &context, kind.span())?;
        file.within(&key(name), value, Interval(low, high, "m"))
    };
    let size = || {
        let value = file.needed(&key("size"), measures.size, &context, kind.span())?;
        file.numbers(&key("size"), value, Interval(low, high, "m"))
    };
    let kinds = [
        ("box", ShapeKind::Box),
        ("cylinder", ShapeKind::Cylinder),
        ("sphere", ShapeKind::Sphere),
        ("hull", ShapeKind::Hull),
        ("mesh", ShapeKind::Mesh),
    ];
    let chosen = file.choice(&key("shape"), kind, &kinds)?;
    if !matches!(chosen, ShapeKind::Box) {
        file.foreign(&key("size"), measures.size, &context)?;
    }
    if !matches!(chosen, ShapeKind::Cylinder) {
        file.foreign(&key("height"), measures.height, &context)?;
    }
    if !matches!(chosen, ShapeKind::Cylinder | ShapeKind::Sphere) {
        file.foreign(&key("radius"), measures.radius, &context)?;
    }
    if !matches!(chosen, ShapeKind::Hull | ShapeKind::Mesh) {
        file.foreign(&key("file"), measures.file, &context)?;
        file.foreign(&key("scale"), measures.scale, &context)?;
    }
    let shape = match chosen {
        ShapeKind::Box => Shape::Box { size: size()?.into() },
        ShapeKind::Cylinder => {
            Shape::Cylinder { radius: length("radius", measures.radius)?, height: length("height", measures.height)? }
        }
        ShapeKind::Sphere => Shape::Sphere { radius: length("radius", measures.radius)? },
        ShapeKind::Hull | ShapeKind::Mesh => {
            let name = file.needed(&key("file"), measures.file, &context, kind.span())?;
            let [low, high] = SCALES;
            let scale = file.optional(&key("scale"), measures.scale, 1.0, Interval(low, high, "m"))?;
            return mesh(file, &key("file"), name, scale, matches!(chosen, ShapeKind::Hull));
        }
    };
    Ok((shape, Vector3::zeros()))
}

/// The solid in the file `name`, relative to the scenario.
fn mesh(file: &Source, key: &str, name: &Spanned<String>, scale: f64, convex: bool) -> Checked<(Shape, Vector3<f64>)> {
    let path = Path::new(&file.name).parent().unwrap_or(Path::new("")).join(name.get_ref());
    file.may_name(key, name, &path)?;
    let (mesh, centre) = (file.access.meshes)(&path, scale, convex).map_err(|e| {
        let message = format!("`{key}` is \"{}\": {e}; expected an STL or OBJ file", name.get_ref());
        file.problem(name.span(), message)
    })?;
    Ok((Shape::Mesh(Arc::new(mesh)), centre))
}

/// The objects around the robot.
pub(super) fn objects(file: &Source, tables: &[ObjectKeys]) -> Checked<Vec<Object>> {
    let mut out: Vec<Object> = Vec::with_capacity(tables.len());
    for keys in tables {
        let name = keys.name.get_ref();
        if name.is_empty() || name.chars().count() > 64 || name.chars().any(char::is_control) {
            let message = format!("`objects.name` is {name:?}; expected 1 to 64 printable characters");
            return Err(file.problem(keys.name.span(), message));
        }
        if out.iter().any(|o| o.name == *name) {
            let message = format!("`objects.name` has \"{name}\" twice; expected every object to have its own name");
            return Err(file.problem(keys.name.span(), message));
        }
        out.push(object(file, keys)?);
    }
    Ok(out)
}

fn object(file: &Source, keys: &ObjectKeys) -> Checked<Object> {
    let measures =
        Measures { size: &keys.size, radius: &keys.radius, height: &keys.height, file: &keys.file, scale: &keys.scale };
    let default = Surface::default();
    let (shape, offset) = shape(file, "objects", &keys.shape, &measures)?;
    let mobility = mobility(file, keys)?;
    if let (Mobility::Free { .. }, "mesh") = (mobility, keys.shape.get_ref().as_str()) {
        let message = "`objects.shape` is \"mesh\" of a free object; expected \"hull\", or another mobility".into();
        return Err(file.problem(keys.shape.span(), message));
    }
    let position: Vector3<f64> = file.numbers("objects.position", &keys.position, Interval(-20.0, 20.0, "m"))?.into();
    let yaw = file.optional("objects.yaw", &keys.yaw, 0.0, Interval(-10.0, 10.0, "rad"))?;
    Ok(Object {
        name: keys.name.get_ref().clone(),
        shape,
        mobility,
        position: position + Rotation3::from_axis_angle(&Vector3::z_axis(), yaw) * offset,
        yaw,
        surface: Surface {
            stiffness: file.optional(
                "objects.stiffness",
                &keys.stiffness,
                default.stiffness,
                Interval(1.0, 1e9, "N/m"),
            )?,
            dissipation: file.optional(
                "objects.dissipation",
                &keys.dissipation,
                default.dissipation,
                Interval(0.0, 1e3, "s/m"),
            )?,
            friction: file.optional("objects.friction", &keys.friction, default.friction, Interval(0.0, 10.0, ""))?,
            rolling: file.optional("objects.rolling", &keys.rolling, default.rolling, Interval(0.0, 1.0, "m"))?,
        },
    })
}

fn mobility(file: &Source, keys: &ObjectKeys) -> Checked<Mobility> {
    let (word, place) = match &keys.mobility {
        Some(m) => (m.get_ref().as_str(), m.span()),
        None => ("fixed", keys.name.span()),
    };
    let context = format!("mobility = \"{word}\"");
    if word != "conveyor" {
        file.foreign("objects.velocity", &keys.velocity, &context)?;
    }
    if word != "free" {
        file.foreign("objects.mass", &keys.mass, &context)?;
    }
    match (word, &keys.mobility) {
        ("conveyor", _) => {
            let velocity = file.needed("objects.velocity", &keys.velocity, &context, place)?;
            Ok(Mobility::Conveyor {
                velocity: file.numbers("objects.velocity", velocity, Interval(-10.0, 10.0, "m/s"))?.into(),
            })
        }
        ("free", _) => {
            let mass = file.needed("objects.mass", &keys.mass, &context, place)?;
            Ok(Mobility::Free { mass: file.within("objects.mass", mass, Interval(1e-3, 1e3, "kg"))? })
        }
        ("fixed", _) | (_, None) => Ok(Mobility::Fixed),
        (_, Some(word)) => {
            file.choice("objects.mobility", word, &[("fixed", ()), ("conveyor", ()), ("free", ())])?;
            Ok(Mobility::Fixed)
        }
    }
}

/// Actions of the gripper on `objects` until `duration` (s).
pub(super) fn actions(file: &Source, tables: &[ActionKeys], objects: &[Object], duration: f64) -> Checked<Vec<Action>> {
    let mut out: Vec<Action> = Vec::with_capacity(tables.len());
    let mut held: Option<usize> = None;
    for keys in tables {
        let t = file.within("actions.t", &keys.t, Interval(0.0, duration, "s"))?;
        if let Some(last) = out.last().filter(|last| t <= last.t) {
            let message = format!("`actions.t` is {t} after {}; expected increasing times", last.t);
            return Err(file.problem(keys.t.span(), message));
        }
        let kind = match (&keys.pick, &keys.release) {
            (Some(name), None) => {
                let i = free(file, name, objects)?;
                if let Some(before) = held.replace(i).and_then(|i| objects.get(i)) {
                    let message = format!(
                        "`actions.pick` is \"{}\" while \"{}\" is held; expected a release before",
                        name.get_ref(),
                        before.name
                    );
                    return Err(file.problem(name.span(), message));
                }
                ActionKind::Pick(i)
            }
            (None, Some(release)) => {
                if !release.get_ref() {
                    let message = "`actions.release` is false; expected true, or a pick instead".into();
                    return Err(file.problem(release.span(), message));
                }
                if held.take().is_none() {
                    let message = "`actions.release` comes while nothing is held; expected a pick before".into();
                    return Err(file.problem(release.span(), message));
                }
                ActionKind::Release
            }
            _ => {
                let message = "[[actions]] needs one thing to do; expected either `pick` or `release`".into();
                return Err(file.problem(keys.t.span(), message));
            }
        };
        out.push(Action { t, kind });
    }
    Ok(out)
}

/// Index of the free object called `name`.
fn free(file: &Source, name: &Spanned<String>, objects: &[Object]) -> Checked<usize> {
    let found = objects.iter().position(|o| o.name == *name.get_ref());
    let problem = match found {
        Some(i) if matches!(objects[i].mobility, Mobility::Free { .. }) => return Ok(i),
        Some(_) => "which cannot move",
        None => "which is no object",
    };
    let names: Vec<&str> =
        objects.iter().filter(|o| matches!(o.mobility, Mobility::Free { .. })).map(|o| o.name.as_str()).collect();
    let names = if names.is_empty() { "there is none".into() } else { names.join(", ") };
    let message = format!("`actions.pick` is \"{}\", {problem}; expected a free object: {names}", name.get_ref());
    Err(file.problem(name.span(), message))
}

#[cfg(test)]
mod tests {
    use super::super::tests::{GOOD, parse};
    use super::*;

    const CELL: &str = "\n[[objects]]\nname = \"table\"\nshape = \"box\"\nsize = [1, 1, 0.1]\nposition = [0, 0, -1.3]\n\
                        [[objects]]\nname = \"belt\"\nshape = \"box\"\nsize = [1, 1, 0.1]\nposition = [0, 1, -1.3]\n\
                        mobility = \"conveyor\"\nvelocity = [0.1, 0, 0]\n\
                        [[objects]]\nname = \"can\"\nshape = \"cylinder\"\nradius = 0.03\nheight = 0.1\n\
                        position = [0, 0, -1.2]\nmobility = \"free\"\nmass = 0.5\nyaw = 0.1\nfriction = 0.5\n\
                        [[actions]]\nt = 0.2\npick = \"can\"\n[[actions]]\nt = 0.8\nrelease = true\n";

    #[test]
    fn objects_and_actions_are_read() {
        let scenario = parse(&format!("{GOOD}{CELL}")).unwrap();
        assert_eq!(scenario.objects.len(), 3);
        assert_eq!(scenario.objects[0].mobility, Mobility::Fixed);
        assert_eq!(scenario.objects[1].mobility, Mobility::Conveyor { velocity: [0.1, 0.0, 0.0].into() });
        let can = &scenario.objects[2];
        assert_eq!(can.shape, Shape::Cylinder { radius: 0.03, height: 0.1 });
        assert_eq!(can.mobility, Mobility::Free { mass: 0.5 });
        assert_eq!((can.yaw, can.surface), (0.1, Surface { friction: 0.5, ..Surface::default() }));
        let kinds: Vec<ActionKind> = scenario.actions.iter().map(|a| a.kind).collect();
        assert_eq!(kinds, [ActionKind::Pick(2), ActionKind::Release]);
    }

    #[test]
    fn a_payload_may_have_a_shape() {
        let load = "[payload]\nmass = 2\ncom = [0, 0, -0.1]\n";
        let plain = parse(&format!("{GOOD}{load}")).unwrap();
        assert_eq!((plain.payload_shape, plain.setup.payload.com.z), (None, -0.1));
        let ball = parse(&format!("{GOOD}{load}shape = \"sphere\"\nradius = 0.1\n")).unwrap().payload_shape.unwrap();
        assert_eq!(ball, PayloadShape { shape: Shape::Sphere { radius: 0.1 }, centre: [0.0, 0.0, -0.1].into() });
        let e = parse(&format!("{GOOD}{load}radius = 0.1\n")).unwrap_err().to_string();
        assert!(e.contains("`payload.radius` has no meaning for a payload without `shape`"), "{e}");
        let e = parse(&format!("{GOOD}{load}shape = \"box\"\n")).unwrap_err().to_string();
        assert!(e.contains("shape = \"box\" lacks `payload.size`"), "{e}");
    }

    #[test]
    fn a_payload_may_be_a_box() {
        let of = |keys: &str| parse(&format!("{GOOD}[payload]\nbox = [0.4, 0.3, 0.2]\n{keys}"));
        // 0.024 m³ at 125 kg/m³ are 3 kg; held at the middle of its top.
        let plain = of("density = 125\n").unwrap();
        assert_eq!(plain.setup.payload, Payload::cuboid(3.0, [0.4, 0.3, 0.2], [0.0, 0.0, 0.1]));
        assert_eq!((plain.setup.payload.com, plain.drag_factor), (Vector3::new(0.0, 0.0, -0.1), None));
        let beside = of("mass = 3\ngrip = [0.1, -0.05, 0.15]\ndrag_factor = 1.1\n").unwrap();
        assert_eq!(beside.setup.payload.com, Vector3::new(-0.1, 0.05, -0.15));
        let shape = Shape::Box { size: [0.4, 0.3, 0.2].into() };
        assert_eq!(beside.payload_shape, Some(PayloadShape { shape, centre: [-0.1, 0.05, -0.15].into() }));
        assert_eq!(beside.drag_factor, Some(1.1));
        for (keys, expected) in [
            ("", "test.toml:8:7: `payload.box` lacks its mass"),
            ("mass = 3\ndensity = 9", "test.toml:10:11: `payload.density` stands beside `payload.mass`"),
            ("density = 9e3", "which makes the box 216.0 kg; expected at most 100 kg"),
            ("mass = 3\ncom = [0, 0, 0]", "`payload.com` has no meaning for a payload that is a box"),
            ("mass = 3\ninertia_zz = 1", "`payload.inertia_zz` has no meaning for a payload that is a box"),
            ("mass = 3\nshape = \"box\"", "`payload.shape` has no meaning for a payload that is a box"),
            (
                "mass = 3\ngrip = [0, 0, 0]",
                "test.toml:10:8: `payload.grip` has z = 0, so that the box would reach above",
            ),
            ("mass = -3", "`payload.mass` is -3; expected"),
            ("mass = 3\ndrag_factor = -1", "`payload.drag_factor` is -1; expected"),
        ] {
            let e = of(keys).unwrap_err().to_string();
            assert!(e.contains(expected), "{expected}\n{e}");
        }
        for (keys, expected) in [
            ("com = [0, 0, 0]", "[payload] lacks `mass`"),
            ("mass = 1\ndensity = 9", "`payload.density` has no meaning for a payload without `box`"),
            ("mass = 1\ngrip = [0, 0, 0]", "`payload.grip` has no meaning for a payload without `box`"),
            ("mass = 1\ndrag_factor = 1", "`payload.drag_factor` has no meaning for a payload without `box`"),
        ] {
            let e = parse(&format!("{GOOD}[payload]\n{keys}\n")).unwrap_err().to_string();
            assert!(e.contains(expected), "{expected}\n{e}");
        }
    }

    #[test]
    fn the_controller_may_believe_another_payload() {
        let text = format!("{GOOD}[payload]\nmass = 4\n[believed_payload]\nmass = 1\ncom = [0, 0, -0.1]\n");
        let scenario = parse(&text).unwrap();
        assert_eq!(scenario.setup.payload.mass, 4.0);
        assert_eq!(scenario.believed_setup().payload, Payload::new(1.0, [0.0, 0.0, -0.1], 0.0));
        assert_eq!(parse(GOOD).unwrap().believed_setup(), parse(GOOD).unwrap().setup);
    }

    #[test]
    fn mistakes_are_named_with_their_value() {
        for (from, to, expected) in [
            ("\"belt\"", "\"table\"", "`objects.name` has \"table\" twice"),
            ("\"belt\"", "\"\"", "`objects.name` is \"\""),
            ("\"cylinder\"", "\"cone\"", "`objects.shape` is \"cone\"; expected \"box\", \"cylinder\", \"sphere\", "),
            ("\"cylinder\"", "\"sphere\"", "`objects.height` has no meaning for shape = \"sphere\""),
            ("height = 0.1\n", "", "shape = \"cylinder\" lacks `objects.height`"),
            ("radius = 0.03", "radius = 0", "`objects.radius` is 0; expected a number from 0.0001 to 20 m"),
            ("size = [1, 1, 0.1]", "size = [1, -1, 0.1]", "`objects.size` has -1; expected 3 numbers"),
            ("\"free\"", "\"loose\"", "`objects.mass` has no meaning for mobility = \"loose\""),
            (
                "\"free\"\nmass = 0.5",
                "\"loose\"",
                "`objects.mobility` is \"loose\"; expected \"fixed\", \"conveyor\" or",
            ),
            ("mass = 0.5\n", "", "mobility = \"free\" lacks `objects.mass`"),
            ("velocity = [0.1, 0, 0]\n", "", "mobility = \"conveyor\" lacks `objects.velocity`"),
            ("friction = 0.5", "friction = -1", "`objects.friction` is -1"),
            ("position = [0, 0, -1.2]\n", "", "missing key `position`"),
            ("yaw", "jaw", "unknown key `objects.jaw`"),
            (
                "pick = \"can\"",
                "pick = \"cap\"",
                "`actions.pick` is \"cap\", which is no object; expected a free object: can",
            ),
            ("pick = \"can\"", "pick = \"belt\"", "`actions.pick` is \"belt\", which cannot move"),
            ("t = 0.8", "t = 0.1", "`actions.t` is 0.1 after 0.2"),
            ("t = 0.8", "t = 1.8", "`actions.t` is 1.8; expected a number from 0 to 1 s"),
            ("pick = \"can\"", "release = true", "`actions.release` comes while nothing is held"),
            ("release = true", "pick = \"can\"", "`actions.pick` is \"can\" while \"can\" is held"),
            ("release = true", "release = false", "`actions.release` is false"),
            ("release = true", "", "expected either `pick` or `release`"),
        ] {
            assert!(CELL.contains(from), "{from}");
            let e = parse(&format!("{GOOD}{}", CELL.replacen(from, to, 1))).unwrap_err().to_string();
            assert!(e.contains(expected) && e.contains("test.toml:"), "{expected}\n{e}");
        }
    }
}
