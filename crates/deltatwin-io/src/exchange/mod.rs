//! The robot for other programs: MJCF for MuJoCo, URDF for those that read trees.
//!
//! Links have the frames, masses and inertias of the model, with payload and the effects on inertia and dimensions. All
//! joints are at zero in the pose q = 0, in which the robot is assembled. Frictions of the form −c·sign(v) − d·v are
//! exported; what else is left out is said.

mod friction;
mod mjcf;
mod tree;
mod urdf;
mod xml;

use miette::Diagnostic;
use nalgebra::{Matrix3, Vector3};
use thiserror::Error;

use deltatwin::dynamics::Plant;
use deltatwin::machine::check::inconsistency;
use deltatwin::machine::{Inertia, Part, Setup};
use deltatwin::model::Model;

use friction::Frictions;
use tree::Tree;

/// Format of a robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// MuJoCo's: closed loops, motors, friction.
    Mjcf,
    /// A tree, with the joints that close the loops beside it.
    Urdf,
}

/// A robot as text.
#[derive(Clone, Debug)]
pub struct Exported {
    /// Content of the file.
    pub text: String,
    /// Effects of the model that it does not have, a sentence each.
    pub left_out: Vec<String>,
    /// Number of links.
    pub links: usize,
    /// Number of joints that close a loop.
    pub loops: usize,
    /// Mass of all moving links, kg.
    pub mass: f64,
}

/// Why a model has no such file.
#[derive(Clone, Debug, Error, Diagnostic, PartialEq)]
pub enum ExportError {
    /// The machine is not an assembled delta robot or relative.
    #[error("{0} is not an assembled delta robot or relative; expected one, with `assembled = true`")]
    Machine(String),
    /// The struts do not reach in the pose q = 0.
    #[error("{0}: the struts do not reach in the pose q = 0, in which the links of the file are placed")]
    Home(String),
    /// A body with payload and effects is not a real one.
    #[error("{body}: {reason}, with payload and effects; other programs refuse it")]
    Body {
        /// Name of the body.
        body: String,
        /// What is wrong.
        reason: String,
    },
}

/// The robot of `model`, carrying the payload of `setup`, in `format`.
///
/// # Errors
/// An [`ExportError`] for a machine that is none, that does not reach its home pose, or whose bodies are impossible.
pub fn export(model: &Model, setup: &Setup, format: Format) -> Result<Exported, ExportError> {
    let plant = Plant::new(model, setup);
    if !plant.has(Part::Linkage) {
        return Err(ExportError::Machine(model.name.clone()));
    }
    let home = tree::home(&plant).ok_or_else(|| ExportError::Home(model.name.clone()))?;
    let (frictions, left_out) = Frictions::of(model);
    let tree = Tree::new(model, &plant, &home, &frictions);
    for link in &tree.links {
        if let Some((_, reason)) = inconsistency(&link.inertia) {
            return Err(ExportError::Body { body: link.name.clone(), reason });
        }
    }
    let mut notes = vec![
        format!("{}, written by deltatwin {}", model.name, env!("CARGO_PKG_VERSION")),
        "SI units and radians; all joints are at zero in the pose q = 0 of the model, arms horizontal".into(),
    ];
    notes.extend(left_out.iter().map(|what| format!("left out: {what}")));
    let text = match format {
        Format::Mjcf => mjcf::text(model, &tree, &notes),
        Format::Urdf => urdf::text(model, &tree, &notes),
    };
    let mass = tree.links.iter().map(|link| link.inertia.mass).sum();
    Ok(Exported { text, left_out, links: tree.links.len(), loops: tree.loops.len(), mass })
}

/// Least mass (kg) and principal moment of inertia (kg·m²) of a moving link: MuJoCo refuses less than 1e-15.
const LEAST: [f64; 2] = [1e-12, 1e-14];

/// Mass (kg), centre of mass (m) and inertia tensor about it (kg·m²) of a link, in the axes of its frame: those of the
/// body, or the [`LEAST`] where it has none, as the flange without a mass or a strut about its own axis.
fn stated(inertia: &Inertia) -> (f64, Vector3<f64>, Matrix3<f64>) {
    let [least_mass, least_moment] = LEAST;
    if inertia.mass < least_mass {
        return (least_mass, Vector3::zeros(), Matrix3::from_diagonal_element(least_moment));
    }
    let centre = inertia.first_moment / inertia.mass;
    let tensor = inertia.seen_from(&-centre).tensor;
    let lacking = (least_moment - tensor.symmetric_eigenvalues().min()).max(0.0);
    (inertia.mass, centre, tensor + Matrix3::from_diagonal_element(lacking))
}

/// `name` in characters that every program accepts.
fn identifier(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '_' }).collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use deltatwin::machine::Payload;
    use nalgebra::{Isometry3, Point3, Translation3};

    use super::*;

    fn shipped(name: &str) -> Model {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../models/{name}.toml"));
        crate::model::read(&file).unwrap()
    }

    #[test]
    fn links_stand_as_on_the_robot_and_its_loops_are_closed() {
        let robots = [("irb360-6-1600", 6, 14), ("irb360-1-1130", 6, 14), ("clavel-delta", 6, 10), ("par2", 8, 13)];
        let turning = [("par4", 9, 16), ("h4", 8, 15), ("i4", 8, 15)];
        for (name, loops, links) in robots.into_iter().chain(turning) {
            let model = shipped(name);
            let plant = Plant::new(&model, &Setup::default());
            let home = tree::home(&plant).unwrap();
            let tree = Tree::new(&model, &plant, &home, &Frictions::default());
            let mut poses: Vec<Isometry3<f64>> = Vec::new();
            for link in &tree.links {
                let base = link.parent.map_or_else(Isometry3::identity, |p| poses[p]);
                poses.push(base * link.origin * Translation3::from(link.offset));
                let body = (0..home.bodies.len()).find(|b| deltatwin::machine::bodies::body_name(*b) == link.name);
                let own = home.poses()[body.unwrap()];
                let gap = (poses[poses.len() - 1].translation.vector - own.translation.vector).norm();
                let turn = poses[poses.len() - 1].rotation.angle_to(&own.rotation);
                assert!(gap < 1e-14 && turn < 1e-7, "{name}: {}: {gap:e} m, {turn:e} rad", link.name);
            }
            assert_eq!((tree.loops.len(), tree.links.len()), (loops, links), "{name}");
            for closed in &tree.loops {
                let [a, b] = [0, 1].map(|end| poses[closed.links[end]] * Point3::from(closed.points[end]));
                assert!((a - b).norm() < 1e-14, "{name}: {}: {:e} m", closed.name, (a - b).norm());
            }
        }
    }

    /// What MuJoCo wants of every moving body: a mass, and principal moments none of which exceeds the sum of the others.
    #[test]
    fn every_moving_link_has_a_mass_and_an_inertia_that_a_body_can_have() {
        for name in
            ["irb360-6-1600", "irb360-6-1600-truth", "irb360-1-1130", "clavel-delta", "linear-delta", "par4", "par2"]
        {
            let text = export(&shipped(name), &Setup::default(), Format::Urdf).unwrap().text;
            let number = |part: &str, key: &str| -> f64 {
                let rest = part.split_once(&format!("{key}=\"")).unwrap().1;
                rest.split_once('"').unwrap().0.parse().unwrap()
            };
            let links: Vec<&str> = text.split("<link name=\"").skip(1).collect();
            assert!(links[0].starts_with("base\""));
            for link in &links[1..] {
                let own = link.split("<joint").next().unwrap();
                assert!(own.contains("<inertial>"), "{name}: {own}");
                let mass = number(own.split_once("<mass").unwrap().1, "value");
                let [xx, xy, xz, yy, yz, zz] = ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"].map(|key| number(own, key));
                let moments = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz).symmetric_eigenvalues();
                assert!(mass >= 1e-12 && moments.min() > 0.99e-14, "{name}: {own}");
                assert!(moments.sum() - 2.0 * moments.max() > -1e-12 * moments.max(), "{name}: {own}");
            }
        }
    }

    #[test]
    fn masses_are_those_of_the_file_with_the_payload_and_friction_is_that_of_the_drives() {
        let model = shipped("irb360-6-1600");
        let setup = Setup { payload: Payload::new(2.5, [0.0, 0.0, -0.1], 0.01), ..Setup::default() };
        // 3 · 1.6 + 6 · 0.179 + 1.2 + 1.0 + 0.922 + 0.557 kg and the payload.
        for (setup, mass) in [(Setup::default(), 9.553), (setup, 12.053)] {
            for format in [Format::Mjcf, Format::Urdf] {
                let made = export(&model, &setup, format).unwrap();
                approx::assert_relative_eq!(made.mass, mass, epsilon = 1e-12);
                assert!(made.left_out.iter().any(|what| what.starts_with("axis4_friction")), "{:?}", made.left_out);
                assert!(made.text.contains("4.667") && made.text.contains("1.247"), "{}", made.text);
            }
        }
        let none = export(&shipped("servo-axis"), &Setup::default(), Format::Urdf).unwrap_err();
        assert!(none.to_string().contains("assembled delta robot"), "{none}");
        let apart = export(&shipped("irb360-6-1600-disassembled"), &Setup::default(), Format::Mjcf);
        assert!(matches!(apart, Err(ExportError::Machine(_))));
    }
}
