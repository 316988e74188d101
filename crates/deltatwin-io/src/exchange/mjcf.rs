//! MJCF, the format of MuJoCo: the loops are closed by `connect`.

use deltatwin::cell::links::Cylinder;
use deltatwin::machine::Inertia;
use deltatwin::model::Model;
use nalgebra::{Translation3, Vector3};

use super::tree::{Freedom, Joint, Link, Loop, Tree};
use super::xml::Element;
use super::{identifier, stated};

/// Impedance of the closures, as close to a rigid joint as MuJoCo allows.
const IMPEDANCE: [f64; 5] = [0.9999, 0.9999, 0.001, 0.5, 2.0];

/// The text of the file; `notes` are sentences for its head.
pub(super) fn text(model: &Model, tree: &Tree, notes: &[String]) -> String {
    let step = model.sample_time;
    let root = Element::new("mujoco").with("model", identifier(&model.name));
    let root = notes.iter().fold(root, |root, note| root.note(note));
    let option = Element::new("option")
        .numbers("timestep", &[step])
        .numbers("gravity", &[0.0, 0.0, -model.gravity])
        .with("integrator", "implicitfast");
    // The time constant is the shortest that is stable, two steps.
    let closure = Element::new("equality").numbers("solref", &[2.0 * step, 1.0]).numbers("solimp", &IMPEDANCE);
    let shown = Element::new("geom").with("contype", "0").with("conaffinity", "0").with("group", "1");
    let light = Element::new("light").with("pos", "1 -1 2").with("dir", "-1 1 -2").with("diffuse", "0.8 0.8 0.8");
    let roots = (0..tree.links.len()).filter(|k| tree.links[*k].parent.is_none());
    root.and(
        Element::new("compiler").with("angle", "radian").with("autolimits", "true").with("inertiafromgeom", "false"),
    )
    .and(option)
    .and(Element::new("statistic").with("center", "0 0 -0.5").with("extent", "1.5"))
    .and(Element::new("default").and(shown).and(closure))
    .and(Element::new("worldbody").and(light).all(roots.map(|k| body(tree, k))))
    .and(
        Element::new("equality")
            .all(tree.loops.iter().map(|closed| connect(tree, closed)))
            .all(tree.links.iter().flat_map(|link| &link.joints).filter_map(coupled)),
    )
    .and(Element::new("actuator").all(driven(tree).map(|(joint, drive)| {
        let range = [-drive.max_torque, drive.max_torque];
        Element::new("motor").with("name", &*joint.name).with("joint", &*joint.name).numbers("ctrlrange", &range)
    })))
    .and(Element::new("sensor").all(driven(tree).flat_map(|(joint, _)| {
        ["jointpos", "jointvel"]
            .map(|kind| Element::new(kind).with("name", format!("{}_{kind}", joint.name)).with("joint", &*joint.name))
    })))
    .file()
}

fn driven(tree: &Tree) -> impl Iterator<Item = (&Joint, &deltatwin::machine::Drive)> {
    tree.links.iter().flat_map(|link| &link.joints).filter_map(|joint| Some((joint, joint.drive.as_ref()?)))
}

fn body(tree: &Tree, index: usize) -> Element {
    let link = &tree.links[index];
    let pose = link.origin * Translation3::from(link.offset);
    let q = pose.rotation.coords;
    let element = Element::new("body")
        .with("name", &*link.name)
        .numbers("pos", pose.translation.vector.iter())
        .numbers("quat", &[q.w, q.x, q.y, q.z]);
    let element = element.all(link.joints.iter().map(|j| joint(link, j))).and(inertial(&link.inertia));
    let element = element.all(link.shape.iter().map(geom));
    let sites = tree.loops.iter().flat_map(|closed| {
        let ends = [0, 1].map(|end| (closed.links[end], closed.points[end], site_name(closed, end)));
        ends.into_iter().filter(|(link, ..)| *link == index)
    });
    let element =
        element.all(sites.map(|(_, point, name)| Element::new("site").with("name", name).numbers("pos", point.iter())));
    let carried = (index + 1..tree.links.len()).filter(|k| tree.links[*k].parent == Some(index));
    element.all(carried.map(|k| body(tree, k)))
}

fn joint(link: &Link, joint: &Joint) -> Element {
    if let Freedom::Free = joint.freedom {
        return Element::new("freejoint").with("name", &*joint.name);
    }
    let element = Element::new("joint").with("name", &*joint.name);
    let element = match joint.freedom {
        Freedom::Turn(axis) => turned(element, "hinge", &axis),
        Freedom::Slide(axis) => turned(element, "slide", &axis),
        Freedom::Ball | Freedom::Free => element.with("type", "ball"),
    };
    let element = match link.offset == Vector3::zeros() {
        true => element,
        false => element.numbers("pos", (-link.offset).iter()),
    };
    let element = match joint.range {
        Some(range) => element.numbers("range", &range),
        None => element,
    };
    let friction = joint.friction;
    if friction.is_none() {
        return element;
    }
    element.numbers("frictionloss", &[friction.coulomb]).numbers("damping", &[friction.viscous])
}

fn turned(element: Element, kind: &str, axis: &Vector3<f64>) -> Element {
    element.with("type", kind).numbers("axis", axis.iter())
}

fn inertial(inertia: &Inertia) -> Element {
    let (mass, centre, tensor) = stated(inertia);
    let six = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)].map(|place| tensor[place]);
    let element = Element::new("inertial").numbers("pos", centre.iter());
    element.numbers("mass", &[mass]).numbers("fullinertia", &six)
}

fn geom(shape: &Cylinder) -> Element {
    Element::new("geom")
        .with("type", "cylinder")
        .numbers("fromto", shape.ends.iter().flatten())
        .numbers("size", &[shape.radius])
        .with("rgba", "0.55 0.6 0.65 1")
}

fn site_name(closed: &Loop, end: usize) -> String {
    format!("{}_{}", closed.name, ["ball", "cup"][1 - end])
}

/// The equation of a joint that follows another one.
fn coupled(joint: &Joint) -> Option<Element> {
    let (other, factor) = joint.follows.as_ref()?;
    let names = Element::new("joint").with("joint1", &*joint.name).with("joint2", &**other);
    Some(names.numbers("polycoef", &[0.0, *factor, 0.0, 0.0, 0.0]))
}

fn connect(tree: &Tree, closed: &Loop) -> Element {
    debug_assert!(closed.links.iter().all(|link| *link < tree.links.len()));
    Element::new("connect")
        .with("name", &*closed.name)
        .with("site1", site_name(closed, 0))
        .with("site2", site_name(closed, 1))
}
