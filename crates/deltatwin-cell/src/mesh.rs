//! Solids bounded by triangles: convex hulls and meshes from STL and OBJ files.

use std::io::{self, Read};
use std::path::Path;

use deltatwin::cell::{MOST_TRIANGLES, Mesh, MeshError};
use nalgebra::{Matrix3, Vector3};
use parry3d::mass_properties::MassProperties;
use parry3d::math::Vector;
use parry3d::shape::{SharedShape, TriMesh, TriMeshFlags};
use parry3d::transformation::try_convex_hull;

/// The mesh in an STL or OBJ file with the length unit `scale` (m), or with `convex` the convex hull of its points, and
/// its centre of volume in the file's frame, m.
///
/// # Errors
/// A [`MeshError`] if the file cannot be read, or as for [`closed`].
pub fn read(file: &Path, scale: f64, convex: bool) -> Result<(Mesh, Vector3<f64>), MeshError> {
    let loader = mesh_loader::Loader::default().merge_meshes(true);
    // Materials in other files do not matter.
    let no_other = |_: &Path| -> io::Result<Vec<u8>> { Err(io::ErrorKind::NotFound.into()) };
    let scene = loader.load_from_slice_with_reader(&bytes(file)?, file, no_other)?;
    let mesh = scene.meshes.into_iter().next().unwrap_or_default();
    let corners = mesh.vertices.iter().map(|v| Vector3::from(v.map(f64::from)) * scale).collect();
    closed(corners, mesh.faces, convex)
}

/// The content of a file of solids, which is neither a device nor a pipe.
fn bytes(file: &Path) -> io::Result<Vec<u8>> {
    if !std::fs::metadata(file)?.is_file() {
        return Err(io::Error::other("it is a device, a pipe or a folder; expected a file"));
    }
    let mut out = Vec::new();
    std::fs::File::open(file)?.take(LONGEST + 1).read_to_end(&mut out)?;
    if out.len() as u64 > LONGEST {
        return Err(io::Error::other(format!("it is longer than {} MB", LONGEST >> 20)));
    }
    Ok(out)
}

/// Size of the longest file of solids, bytes: several times the most triangles as text.
const LONGEST: u64 = 256 << 20;

/// The mesh of `triangles` between `corners` (m), or with `convex` the convex hull of the corners, and its centre of
/// volume, m.
///
/// # Errors
/// A [`MeshError`] if there are too few or too many triangles, or if they do not bound a solid.
pub fn closed(
    corners: Vec<Vector3<f64>>,
    triangles: Vec<[u32; 3]>,
    convex: bool,
) -> Result<(Mesh, Vector3<f64>), MeshError> {
    if !(4..=MOST_TRIANGLES).contains(&triangles.len()) {
        return Err(MeshError::Triangles(triangles.len()));
    }
    if let Some(i) = corners.iter().position(|c| c.iter().any(|x| !x.is_finite())) {
        return Err(MeshError::NotFinite(i + 1));
    }
    let points: Vec<Vector> = corners.iter().map(glam).collect();
    let (points, triangles) = if convex {
        try_convex_hull(&points).map_err(|e| MeshError::Hull(e.to_string()))?
    } else {
        (points, triangles)
    };
    let welding = TriMeshFlags::MERGE_DUPLICATE_VERTICES | TriMeshFlags::DELETE_DEGENERATE_TRIANGLES;
    let welded = TriMesh::with_flags(points, triangles, welding).map_err(|e| MeshError::Hull(e.to_string()))?;
    let mesh = Mesh::new(welded.vertices().iter().map(own).collect(), welded.indices().to_vec(), convex)?;
    let points: Vec<Vector> = mesh.corners().iter().map(glam).collect();
    let whole = MassProperties::from_trimesh(1.0, &points, mesh.triangles());
    let centre = own(&whole.local_com);
    let tensor = whole.reconstruct_inertia_matrix().to_cols_array();
    Ok((mesh.centred(&centre, Matrix3::from_column_slice(&tensor) / whole.mass()), centre))
}

/// The shape of a mesh for Rapier: a convex solid, or the surface.
pub fn solid(mesh: &Mesh) -> SharedShape {
    let points = mesh.corners().iter().map(glam).collect();
    let convex = mesh.is_convex().then(|| SharedShape::convex_mesh(points, mesh.triangles())).flatten();
    convex.unwrap_or_else(|| surface(mesh))
}

/// The oriented surface of a mesh, which distinguishes inside and outside.
pub fn surface(mesh: &Mesh) -> SharedShape {
    let points: Vec<Vector> = mesh.corners().iter().map(glam).collect();
    // The constructor of `Mesh` checked the indices; a surface that cannot be oriented is replaced by a sphere of
    // radius zero.
    SharedShape::trimesh_with_flags(points, mesh.triangles().to_vec(), TriMeshFlags::ORIENTED)
        .unwrap_or_else(|_| SharedShape::ball(0.0))
}

fn glam(v: &Vector3<f64>) -> Vector {
    Vector::new(v.x, v.y, v.z)
}

fn own(v: &Vector) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Corners of a box (m) and its twelve triangles.
    pub fn block(x: f64, y: f64, z: f64) -> (Vec<Vector3<f64>>, Vec<[u32; 3]>) {
        let corner = |i: u32| {
            let side = |axis: u32, length: f64| if i >> axis & 1 == 1 { length / 2.0 } else { -length / 2.0 };
            Vector3::new(side(0, x), side(1, y), side(2, z))
        };
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
        ((0..8).map(corner).collect(), triangles)
    }

    #[test]
    fn a_box_of_triangles_is_a_box() {
        let (corners, triangles) = block(0.1, 0.2, 0.3);
        let moved: Vec<_> = corners.iter().map(|c| c + Vector3::new(1.0, -2.0, 0.5)).collect();
        let inside_out = triangles.iter().map(|t| [t[0], t[2], t[1]]).collect();
        for (triangles, convex) in [(triangles.clone(), false), (inside_out, false), (triangles, true)] {
            let (mesh, centre) = closed(moved.clone(), triangles, convex).unwrap();
            approx::assert_relative_eq!(centre, Vector3::new(1.0, -2.0, 0.5), epsilon = 1e-12);
            approx::assert_relative_eq!(mesh.volume(), 0.006, epsilon = 1e-12);
            // (y² + z²)/12 and so on
            let expected = Matrix3::from_diagonal(&Vector3::new(0.13, 0.1, 0.05)) / 12.0;
            approx::assert_relative_eq!(mesh.gyration(), expected, epsilon = 1e-9);
            // The diagonals of the faces are not edges.
            assert_eq!((mesh.sharp_edges().len(), mesh.sharp_corners().len()), (12, 8));
        }
    }

    #[test]
    fn bad_meshes_are_refused() {
        let (corners, triangles) = block(0.1, 0.1, 0.1);
        let refused = |c: Vec<_>, t: Vec<_>, convex| closed(c, t, convex).err().map(|e| e.to_string());
        let e = refused(corners.clone(), triangles[1..].to_vec(), false).unwrap();
        assert!(e.contains("it is not closed") && e.contains("bounds 1 triangle(s)"), "{e}");
        assert_eq!(refused(corners.clone(), triangles[1..].to_vec(), true), None);
        assert!(refused(corners.clone(), vec![], false).unwrap().contains("0 triangles"));
        let mut broken = corners.clone();
        broken[2].y = f64::NAN;
        assert!(refused(broken, triangles.clone(), true).unwrap().contains("corner 3"));
        let tiny = corners.iter().map(|c| c * 1e-4).collect();
        assert!(refused(tiny, triangles, false).unwrap().contains("`scale`"));
    }

    #[test]
    fn a_notch_is_no_edge_that_sticks_out() {
        // An L: a box of 2 × 2 × 1 without its upper right quarter; 6 corners, 18 edges, one of them concave.
        let outline = [[0., 0.], [2., 0.], [2., 1.], [1., 1.], [1., 2.], [0., 2.]];
        let corner = |z: f64| move |p: &[f64; 2]| Vector3::new(p[0], p[1], z);
        let corners: Vec<_> = outline.iter().map(corner(0.0)).chain(outline.iter().map(corner(1.0))).collect();
        let mut triangles = Vec::new();
        for [a, b, c] in [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]] {
            triangles.extend([[a, c, b], [a + 6, b + 6, c + 6]]);
        }
        for i in 0..6 {
            let j = (i + 1) % 6;
            triangles.extend([[i, j, j + 6], [i, j + 6, i + 6]]);
        }
        let (mesh, _) = closed(corners, triangles, false).unwrap();
        approx::assert_relative_eq!(mesh.volume(), 3.0, epsilon = 1e-12);
        assert_eq!(mesh.sharp_edges().len(), 17);
    }
}
