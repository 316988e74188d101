//! Solids bounded by triangles: convex hulls and meshes from STL and OBJ files.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{Matrix3, Vector3};
use parry3d::mass_properties::MassProperties;
use parry3d::math::Vector;
use parry3d::shape::{SharedShape, TriMesh, TriMeshFlags};
use parry3d::transformation::try_convex_hull;
use thiserror::Error;

/// Sine of the angle between two faces below which their edge is none.
const FLAT: f64 = 0.01;
/// Most triangles of a mesh; contacts look at single edges.
const MOST_TRIANGLES: usize = 200_000;
/// Smallest volume, m³: a cube of a tenth of a millimetre.
const SMALLEST: f64 = 1e-12;

/// What is wrong with a mesh.
#[derive(Debug, Error)]
pub enum MeshError {
    /// It cannot be read.
    #[error("{0}")]
    Read(#[from] std::io::Error),
    /// Too little or too much.
    #[error("it has {0} triangles; expected 4 to {MOST_TRIANGLES}")]
    Triangles(usize),
    /// Infinite coordinates or NaN.
    #[error("corner {0} is no number; expected finite coordinates")]
    NotFinite(usize),
    /// A hole, a fin, or faces turned inside out.
    #[error(
        "it is not closed: the edge from ({0}) to ({1}) bounds {2} triangle(s); expected two, turned the same way \
         (shape = \"hull\" takes any points)"
    )]
    Open(String, String, usize),
    /// No solid.
    #[error("it encloses {0:.1e} m³; expected a solid (is `scale` right?)")]
    Flat(f64),
    /// The points do not span a solid.
    #[error("its convex hull fails: {0}")]
    Hull(String),
}

/// A closed surface of triangles about its centre of volume, normals outward.
#[derive(Clone, Debug, PartialEq)]
pub struct Mesh {
    corners: Vec<Vector3<f64>>,
    triangles: Vec<[u32; 3]>,
    convex: bool,
    /// About the centre of volume, per unit of mass, m².
    gyration: Matrix3<f64>,
}

/// A line between two corners and the faces at it.
#[derive(Default)]
struct Seam {
    /// Triangles that run along it from the lower to the higher corner, and those that run back.
    faces: [Vec<usize>; 2],
}

impl Mesh {
    /// Reads an STL or OBJ file whose lengths are `scale` m; of `convex` solids the hull of all points.
    /// Returns the mesh and where its centre of volume was in the file's frame, m.
    ///
    /// # Errors
    /// If the file is unreadable or bounds no solid.
    pub fn read(file: &Path, scale: f64, convex: bool) -> Result<(Self, Vector3<f64>), MeshError> {
        let scene = mesh_loader::Loader::default().merge_meshes(true).load(file)?;
        let mesh = scene.meshes.into_iter().next().unwrap_or_default();
        let corners = mesh.vertices.iter().map(|v| Vector3::from(v.map(f64::from)) * scale).collect();
        Self::new(corners, mesh.faces, convex)
    }

    /// A mesh of `triangles` between `corners`, m; of `convex` solids the hull of the corners. Returns the mesh and where
    /// its centre of volume was.
    ///
    /// # Errors
    /// If it bounds no solid.
    pub fn new(
        corners: Vec<Vector3<f64>>,
        triangles: Vec<[u32; 3]>,
        convex: bool,
    ) -> Result<(Self, Vector3<f64>), MeshError> {
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
        let mut mesh = Self {
            corners: welded.vertices().iter().map(own).collect(),
            triangles: welded.indices().to_vec(),
            convex,
            gyration: Matrix3::zeros(),
        };
        mesh.check_closed()?;
        let volume = mesh.volume();
        if volume.abs() < SMALLEST {
            return Err(MeshError::Flat(volume.abs()));
        }
        if volume < 0.0 {
            mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
        let centre = mesh.centre();
        Ok((mesh, centre))
    }

    /// Moves the origin into the centre of volume, which is returned.
    fn centre(&mut self) -> Vector3<f64> {
        let points: Vec<Vector> = self.corners.iter().map(glam).collect();
        let whole = MassProperties::from_trimesh(1.0, &points, &self.triangles);
        let centre = own(&whole.local_com);
        let tensor = whole.reconstruct_inertia_matrix().to_cols_array();
        self.gyration = Matrix3::from_column_slice(&tensor) / whole.mass();
        self.corners.iter_mut().for_each(|c| *c -= centre);
        centre
    }

    /// Signed volume, m³: a sum of tetrahedra over the faces.
    fn volume(&self) -> f64 {
        self.faces().map(|[a, b, c]| a.dot(&b.cross(&c)) / 6.0).sum()
    }

    fn faces(&self) -> impl Iterator<Item = [Vector3<f64>; 3]> {
        self.triangles.iter().map(|t| t.map(|i| self.corners[i as usize]))
    }

    fn seams(&self) -> BTreeMap<[u32; 2], Seam> {
        let mut seams: BTreeMap<[u32; 2], Seam> = BTreeMap::new();
        for (f, t) in self.triangles.iter().enumerate() {
            for k in 0..3 {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                let way = usize::from(a > b);
                seams.entry([a.min(b), a.max(b)]).or_default().faces[way].push(f);
            }
        }
        seams
    }

    fn check_closed(&self) -> Result<(), MeshError> {
        let seams = self.seams();
        let Some((ends, seam)) = seams.iter().find(|(_, s)| s.faces.iter().any(|f| f.len() != 1)) else {
            return Ok(());
        };
        let text = |i: u32| {
            let c = self.corners[i as usize];
            format!("{:.4}, {:.4}, {:.4}", c.x, c.y, c.z)
        };
        Err(MeshError::Open(text(ends[0]), text(ends[1]), seam.faces.iter().map(Vec::len).sum()))
    }

    /// Ends of the edges that stick out, m.
    pub fn sharp_edges(&self) -> Vec<[Vector3<f64>; 2]> {
        self.sharp().into_iter().map(|ends| ends.map(|i| self.corners[i as usize])).collect()
    }

    /// Corners at which such edges end, m.
    pub fn corners(&self) -> Vec<Vector3<f64>> {
        let mut ends: Vec<u32> = self.sharp().into_iter().flatten().collect();
        ends.sort_unstable();
        ends.dedup();
        ends.into_iter().map(|i| self.corners[i as usize]).collect()
    }

    fn sharp(&self) -> Vec<[u32; 2]> {
        let normals: Vec<_> = self.faces().map(|[a, b, c]| (b - a).cross(&(c - a)).normalize()).collect();
        let sticks_out = |ends: &[u32; 2], seam: &Seam| {
            let [Some(&f), Some(&g)] = [seam.faces[0].first(), seam.faces[1].first()] else { return false };
            // The normals of an edge that sticks out part: their cross product runs along the edge.
            let along = (self.corners[ends[1] as usize] - self.corners[ends[0] as usize]).normalize();
            normals[f].cross(&normals[g]).dot(&along) > FLAT || normals[f].dot(&normals[g]) < FLAT - 1.0
        };
        self.seams().into_iter().filter(|(ends, seam)| sticks_out(ends, seam)).map(|(ends, _)| ends).collect()
    }

    /// Corners, m, and triangles, for whoever draws it.
    pub fn geometry(&self) -> (&[Vector3<f64>], &[[u32; 3]]) {
        (&self.corners, &self.triangles)
    }

    /// Whether it is a convex hull.
    pub fn is_convex(&self) -> bool {
        self.convex
    }

    /// Inertia tensor about the origin when filled evenly with unit mass, m².
    pub fn gyration(&self) -> Matrix3<f64> {
        self.gyration
    }

    /// The solid for Rapier.
    pub fn solid(&self) -> SharedShape {
        let points = self.corners.iter().map(glam).collect();
        let convex = self.convex.then(|| SharedShape::convex_mesh(points, &self.triangles)).flatten();
        convex.unwrap_or_else(|| self.surface())
    }

    /// The surface, which knows inside from outside.
    pub fn surface(&self) -> SharedShape {
        let points: Vec<Vector> = self.corners.iter().map(glam).collect();
        // Indices were checked by `new`; a surface that cannot be oriented is none, and nothing touches it.
        SharedShape::trimesh_with_flags(points, self.triangles.clone(), TriMeshFlags::ORIENTED)
            .unwrap_or_else(|_| SharedShape::ball(0.0))
    }
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

    /// Corners of a box, m, and its twelve faces.
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
            let (mesh, centre) = Mesh::new(moved.clone(), triangles, convex).unwrap();
            approx::assert_relative_eq!(centre, Vector3::new(1.0, -2.0, 0.5), epsilon = 1e-12);
            approx::assert_relative_eq!(mesh.volume(), 0.006, epsilon = 1e-12);
            // (y² + z²)/12 and so on
            let expected = Matrix3::from_diagonal(&Vector3::new(0.13, 0.1, 0.05)) / 12.0;
            approx::assert_relative_eq!(mesh.gyration(), expected, epsilon = 1e-9);
            // The diagonals of the faces are no edges.
            assert_eq!((mesh.sharp_edges().len(), mesh.corners().len()), (12, 8));
        }
    }

    #[test]
    fn bad_meshes_are_refused() {
        let (corners, triangles) = block(0.1, 0.1, 0.1);
        let refused = |c: Vec<_>, t: Vec<_>, convex| Mesh::new(c, t, convex).err().map(|e| e.to_string());
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
        // An L: a box of 2 × 2 × 1 without its upper right quarter; 6 corners, 18 edges, one of them inward.
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
        let (mesh, _) = Mesh::new(corners, triangles, false).unwrap();
        approx::assert_relative_eq!(mesh.volume(), 3.0, epsilon = 1e-12);
        assert_eq!(mesh.sharp_edges().len(), 17);
    }
}
