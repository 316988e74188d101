//! URDF: a tree only; the joints that close the loops are stated beside it.

use deltatwin::cell::links::Cylinder;
use deltatwin::machine::Inertia;
use deltatwin::model::Model;
use nalgebra::{Isometry3, Vector3};

use super::tree::{Freedom, Joint, Link, Loop, Tree};
use super::xml::Element;
use super::{identifier, stated};

/// Name of the link at the inertial frame.
const BASE: &str = "base";

/// The text of the file; `notes` are sentences for its head.
pub(super) fn text(model: &Model, tree: &Tree, notes: &[String]) -> String {
    let root = Element::new("robot").with("name", identifier(&model.name));
    let root = notes.iter().fold(root, |root, note| root.note(note));
    let root = root.and(Element::new("link").with("name", BASE));
    let root = tree.links.iter().fold(root, |root, link| carried(root, tree, link));
    let root = root.note("Loops: the two links of a pair coincide in their origins; they may turn against each other.");
    tree.loops.iter().fold(root, |root, closed| ends(root, tree, closed)).file()
}

/// A single freedom of a joint of the tree.
struct Step<'a> {
    name: String,
    axis: Vector3<f64>,
    slides: bool,
    of: &'a Joint,
}

/// The joints of a link with links of the least mass between them, then the link.
fn carried(root: Element, tree: &Tree, link: &Link) -> Element {
    let mut parent = link.parent.map_or(BASE.to_string(), |p| tree.links[p].name.clone());
    let mut origin = link.origin;
    let steps: Vec<Step> = link.joints.iter().flat_map(steps).collect();
    let is_offset = link.offset != Vector3::zeros();
    let mut root = root;
    for (k, step) in steps.iter().enumerate() {
        let is_last = k + 1 == steps.len() && !is_offset;
        let child = if is_last { link.name.clone() } else { format!("{}_link", step.name) };
        let inner = Element::new("link").with("name", &*child);
        root = root.and(if is_last { filled(inner, link) } else { inner.and(inertial(&Inertia::ZERO)) });
        root = root.and(moving(step, [&parent, &child], &origin));
        (parent, origin) = (child, Isometry3::identity());
    }
    if !is_offset {
        return root;
    }
    let mount = Isometry3::translation(link.offset.x, link.offset.y, link.offset.z);
    root.and(filled(Element::new("link").with("name", &*link.name), link)).and(placed(
        &format!("{}_mount", link.name),
        "fixed",
        [&parent, &link.name],
        &mount,
    ))
}

/// The single freedoms of a joint.
fn steps(joint: &Joint) -> Vec<Step<'_>> {
    let name = &joint.name;
    let one = |axis, slides| vec![Step { name: name.clone(), axis, slides, of: joint }];
    let three = |parts: [(&str, Vector3<f64>); 3], slides: bool| {
        parts.map(|(part, axis)| Step { name: format!("{name}_{part}"), axis, slides, of: joint }).into()
    };
    let [x, y, z] = [Vector3::x(), Vector3::y(), Vector3::z()];
    match joint.freedom {
        Freedom::Turn(axis) => one(axis, false),
        Freedom::Slide(axis) => one(axis, true),
        // Singular only for a strut along the motor axis.
        Freedom::Ball => three([("swing", y), ("tilt", z), ("spin", x)], false),
        // The struts keep the platform from turning.
        Freedom::Free => three([("x", x), ("y", y), ("z", z)], true),
    }
}

fn moving(step: &Step, ends: [&str; 2], origin: &Isometry3<f64>) -> Element {
    let Step { name, axis, slides, of: joint } = step;
    let kind = match (slides, joint.range) {
        (true, _) => "prismatic",
        (false, Some(_)) => "revolute",
        (false, None) => "continuous",
    };
    let element = placed(name, kind, ends, origin).and(Element::new("axis").numbers("xyz", axis.iter()));
    let friction = joint.friction;
    let element = match friction.is_none() {
        true => element,
        false => element.and(
            Element::new("dynamics").numbers("damping", &[friction.viscous]).numbers("friction", &[friction.coulomb]),
        ),
    };
    let element = match &joint.follows {
        Some((other, factor)) => {
            element.and(Element::new("mimic").with("joint", &**other).numbers("multiplier", &[*factor]))
        }
        None => element,
    };
    limited(element, *slides, joint)
}

/// A joint between two links, without what moves.
fn placed(name: &str, kind: &str, [parent, child]: [&str; 2], origin: &Isometry3<f64>) -> Element {
    let (roll, pitch, yaw) = origin.rotation.euler_angles();
    let place = Element::new("origin").numbers("xyz", origin.translation.vector.iter());
    Element::new("joint")
        .with("name", name)
        .with("type", kind)
        .and(place.numbers("rpy", &[roll, pitch, yaw]))
        .and(Element::new("parent").with("link", parent))
        .and(Element::new("child").with("link", child))
}

/// Limits where the format wants them: of drives, and of every joint that slides.
fn limited(element: Element, slides: bool, joint: &Joint) -> Element {
    /// What stands for no limit, m, N and m/s: the format has no word for it.
    const NONE: f64 = 1e3;
    let range = joint.range.or(slides.then_some([-NONE, NONE]));
    if range.is_none() && joint.drive.is_none() {
        return element;
    }
    let (effort, velocity) = joint.drive.as_ref().map_or((NONE, NONE), |d| (d.max_torque, d.max_speed));
    let limit = Element::new("limit");
    let limit = match range {
        Some([lower, upper]) => limit.numbers("lower", &[lower]).numbers("upper", &[upper]),
        None => limit,
    };
    element.and(limit.numbers("effort", &[effort]).numbers("velocity", &[velocity]))
}

/// A link with its inertia and shape.
fn filled(element: Element, link: &Link) -> Element {
    element.and(inertial(&link.inertia)).all(link.shape.iter().map(visual))
}

fn inertial(inertia: &Inertia) -> Element {
    let (mass, centre, tensor) = stated(inertia);
    let places = [("ixx", (0, 0)), ("ixy", (0, 1)), ("ixz", (0, 2)), ("iyy", (1, 1)), ("iyz", (1, 2)), ("izz", (2, 2))];
    let moments = places.iter().fold(Element::new("inertia"), |e, (name, place)| e.numbers(name, &[tensor[*place]]));
    Element::new("inertial")
        .and(Element::new("origin").numbers("xyz", centre.iter()).with("rpy", "0 0 0"))
        .and(Element::new("mass").numbers("value", &[mass]))
        .and(moments)
}

fn visual(shape: &Cylinder) -> Element {
    let pitch = if shape.is_along_x() { std::f64::consts::FRAC_PI_2 } else { 0.0 };
    let cylinder = Element::new("cylinder").numbers("radius", &[shape.radius]).numbers("length", &[shape.length()]);
    Element::new("visual")
        .and(Element::new("origin").numbers("xyz", &shape.centre()).numbers("rpy", &[0.0, pitch, 0.0]))
        .and(Element::new("geometry").and(cylinder))
}

/// The two ends of a loop as links of the least mass, and the joint between them for programs that know `loop_joint`.
fn ends(root: Element, tree: &Tree, closed: &Loop) -> Element {
    let names = [0, 1].map(|end| tree.links[closed.links[end]].name.clone());
    let mut root = root;
    let mut loop_joint = Element::new("loop_joint").with("name", &*closed.name).with("type", "spherical");
    for (end, key) in ["link1", "link2"].into_iter().enumerate() {
        let (point, child) = (closed.points[end], format!("{}_{}", closed.name, ["cup", "ball"][end]));
        let at = Isometry3::translation(point.x, point.y, point.z);
        let fixed = placed(&format!("{child}_mount"), "fixed", [&names[end], &child], &at);
        let frame = Element::new("link").with("name", &*child).and(inertial(&Inertia::ZERO));
        root = root.and(frame).and(fixed);
        let placed = Element::new(key).with("link", &*names[end]).numbers("xyz", point.iter()).with("rpy", "0 0 0");
        loop_joint = loop_joint.and(placed);
    }
    root.and(loop_joint)
}
