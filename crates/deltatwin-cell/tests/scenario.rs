//! Solids of a scenario read from files.

use std::path::Path;

use deltatwin::cell::Shape;
use deltatwin::scenario::Scenario;
use deltatwin_cell::mesh;
use deltatwin_io::outside::Access;
use deltatwin_io::scenario::{ScenarioError, parse_with};
use nalgebra::Vector3;

/// A scenario with `more` appended.
fn scenario(more: &str) -> String {
    format!(
        "model = \"../../models/irb360-6-1600.toml\"\nduration = 1.0\n[motion]\nkind = \"fourier\"\nfrequency = 0.5\n\
         centre = [0.0, 0.0, -1.0, 0.0]\n{more}"
    )
}

fn parse(more: &str) -> Result<Scenario, ScenarioError> {
    parse_with(&scenario(more), Path::new("test.toml"), Access::with(mesh::read))
}

/// A pyramid with a base of 60 mm × 60 mm centred at the origin and a height of 40 mm, in mm.
const PYRAMID: &str = "v -30 -30 0\nv 30 -30 0\nv 30 30 0\nv -30 30 0\nv 0 0 40\n\
                       f 1 3 2\nf 1 4 3\nf 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\n";

#[test]
fn solids_come_from_files() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("pyramid.obj");
    std::fs::write(&file, PYRAMID).unwrap();
    std::fs::write(folder.path().join("open.obj"), PYRAMID.replace("f 4 1 5\n", "")).unwrap();
    let of = |kind: &str, name: &str, more: &str| {
        let name = folder.path().join(name);
        let keys = format!("shape = \"{kind}\"\nfile = {:?}\nscale = 0.001\n{more}", name.to_string_lossy());
        let object = format!("\n[[objects]]\nname = \"part\"\nposition = [1, 0, 0]\nyaw = 0.5\n{keys}");
        parse(&object)
    };
    for (kind, more) in [("mesh", ""), ("hull", "mobility = \"free\"\nmass = 2\n")] {
        let scenario = of(kind, "pyramid.obj", more).unwrap();
        let part = &scenario.objects[0];
        let Shape::Mesh(mesh) = &part.shape else { panic!("{part:?}") };
        assert_eq!((mesh.sharp_edges().len(), mesh.sharp_corners().len()), (8, 5));
        // The centre of volume is at a quarter of the height.
        approx::assert_relative_eq!(part.position, Vector3::new(1.0, 0.0, 0.01), epsilon = 1e-8);
    }
    for (kind, name, more, expected) in [
        ("mesh", "open.obj", "", "it is not closed: the edge from ("),
        ("mesh", "none.obj", "", "none.obj\": No such file"),
        ("mesh", "pyramid.obj", "mobility = \"free\"\nmass = 2\n", "\"mesh\" of a free object; expected \"hull\""),
        ("mesh", "pyramid.obj", "radius = 1\n", "`objects.radius` has no meaning for shape = \"mesh\""),
        ("sphere", "pyramid.obj", "radius = 1\n", "`objects.file` has no meaning for shape = \"sphere\""),
    ] {
        let e = of(kind, name, more).unwrap_err().to_string();
        assert!(e.contains(expected) && e.contains("test.toml:"), "{expected}\n{e}");
    }
    let text = "\n[[objects]]\nname = \"part\"\nposition = [1, 0, 0]\nshape = \"hull\"\n";
    let e = parse(text).unwrap_err().to_string();
    assert!(e.contains("shape = \"hull\" lacks `objects.file`"), "{e}");
    // Without a mesh reader the error has a position as well.
    let solid = "\n[[objects]]\nname = \"part\"\nposition = [1, 0, 0]\nshape = \"hull\"\nfile = \"part.stl\"\n";
    let e = deltatwin_io::scenario::parse(&scenario(solid), Path::new("test.toml")).unwrap_err().to_string();
    assert!(e.starts_with("test.toml:12:8: `objects.file` is \"part.stl\": nothing here reads meshes"), "{e}");
}
