//! Solids bounded by triangles.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{Matrix3, Vector3};
use thiserror::Error;

/// Sine of the angle between two adjacent faces below which their edge counts as flat.
const FLAT: f64 = 0.01;
/// Smallest volume, m³: that of a cube with edges of 0.1 mm.
const MIN_VOLUME: f64 = 1e-12;
/// Largest number of triangles of a mesh; contact search treats single edges.
pub const MOST_TRIANGLES: usize = 200_000;

/// Fault of a mesh.
#[derive(Debug, Error)]
pub enum MeshError {
    /// The file cannot be read.
    #[error("{0}")]
    Read(#[from] std::io::Error),
    /// No mesh reader was given.
    #[error("nothing here reads meshes")]
    NoReader,
    /// Too few or too many triangles.
    #[error("it has {0} triangles; expected 4 to {MOST_TRIANGLES}")]
    Triangles(usize),
    /// An infinite coordinate or NaN.
    #[error("corner {0} is no number; expected finite coordinates")]
    NotFinite(usize),
    /// A triangle refers to a missing corner.
    #[error("triangle {0} has a corner that is not there")]
    NoCorner(usize),
    /// The surface is not closed, or adjacent faces are oriented inconsistently.
    #[error(
        "it is not closed: the edge from ({0}) to ({1}) bounds {2} triangle(s); expected two, turned the same way \
         (shape = \"hull\" takes any points)"
    )]
    Open(String, String, usize),
    /// The enclosed volume is too small.
    #[error("it encloses {0:.1e} m³; expected a solid (is `scale` right?)")]
    Flat(f64),
    /// The convex hull of the points cannot be computed.
    #[error("its convex hull fails: {0}")]
    Hull(String),
}

/// A closed surface of triangles with outward normals, about its centre of volume.
#[derive(Clone, Debug, PartialEq)]
pub struct Mesh {
    corners: Vec<Vector3<f64>>,
    triangles: Vec<[u32; 3]>,
    convex: bool,
    gyration: Matrix3<f64>,
}

/// An edge and the faces adjacent to it.
#[derive(Default)]
struct Seam {
    /// Triangles that traverse the edge from the lower to the higher corner index, and those in the opposite direction.
    faces: [Vec<usize>; 2],
}

impl Mesh {
    /// The solid bounded by `triangles` between `corners` (m), whose normals are turned outward if necessary.
    ///
    /// `convex` is not checked. Origin and inertia are set by [`Self::centred`].
    ///
    /// # Errors
    /// [`MeshError::NoCorner`] if a triangle refers to a missing corner, [`MeshError::Open`] if the surface is not
    /// closed or not consistently oriented, [`MeshError::Flat`] if the volume is too small.
    pub fn new(corners: Vec<Vector3<f64>>, triangles: Vec<[u32; 3]>, convex: bool) -> Result<Self, MeshError> {
        if let Some(i) = triangles.iter().position(|t| t.iter().any(|i| *i as usize >= corners.len())) {
            return Err(MeshError::NoCorner(i + 1));
        }
        let mut mesh = Self { corners, triangles, convex, gyration: Matrix3::zeros() };
        mesh.check_closed()?;
        let volume = mesh.volume();
        if volume.abs() < MIN_VOLUME {
            return Err(MeshError::Flat(volume.abs()));
        }
        if volume < 0.0 {
            mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
        Ok(mesh)
    }

    /// The mesh with its origin moved to `centre`, its centre of volume (m), and the inertia tensor `gyration` about it
    /// per unit of mass (m²).
    #[must_use]
    pub fn centred(mut self, centre: &Vector3<f64>, gyration: Matrix3<f64>) -> Self {
        self.corners.iter_mut().for_each(|c| *c -= centre);
        self.gyration = gyration;
        self
    }

    /// Signed volume, m³: a sum of tetrahedra over the faces.
    pub fn volume(&self) -> f64 {
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

    /// End points (m) of the convex edges.
    pub fn sharp_edges(&self) -> Vec<[Vector3<f64>; 2]> {
        self.sharp().into_iter().map(|ends| ends.map(|i| self.corners[i as usize])).collect()
    }

    /// End points (m) of the convex edges, each once.
    pub fn sharp_corners(&self) -> Vec<Vector3<f64>> {
        let mut ends: Vec<u32> = self.sharp().into_iter().flatten().collect();
        ends.sort_unstable();
        ends.dedup();
        ends.into_iter().map(|i| self.corners[i as usize]).collect()
    }

    fn sharp(&self) -> Vec<[u32; 2]> {
        let normals: Vec<_> = self.faces().map(|[a, b, c]| (b - a).cross(&(c - a)).normalize()).collect();
        let sticks_out = |ends: &[u32; 2], seam: &Seam| {
            let [Some(&f), Some(&g)] = [seam.faces[0].first(), seam.faces[1].first()] else { return false };
            // At a convex edge the cross product of the normals points along the edge.
            let along = (self.corners[ends[1] as usize] - self.corners[ends[0] as usize]).normalize();
            normals[f].cross(&normals[g]).dot(&along) > FLAT || normals[f].dot(&normals[g]) < FLAT - 1.0
        };
        self.seams().into_iter().filter(|(ends, seam)| sticks_out(ends, seam)).map(|(ends, _)| ends).collect()
    }

    /// Corners, m.
    pub fn corners(&self) -> &[Vector3<f64>] {
        &self.corners
    }

    /// Indices of each triangle's corners, counter-clockwise as seen from outside.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Whether the mesh is a convex hull.
    pub fn is_convex(&self) -> bool {
        self.convex
    }

    /// Inertia tensor about the origin per unit of mass at uniform density, m².
    pub fn gyration(&self) -> Matrix3<f64> {
        self.gyration
    }
}

/// Reader of mesh files: path, length unit of the file in m, and whether to form the convex hull of all points.
///
/// It returns the mesh and its centre of volume in the file's frame, m.
pub type MeshReader = fn(&Path, f64, bool) -> Result<(Mesh, Vector3<f64>), MeshError>;

/// A [`MeshReader`] that rejects every file, for scenarios whose shapes are given by dimensions.
///
/// # Errors
/// Always [`MeshError::NoReader`].
pub fn no_meshes(_: &Path, _: f64, _: bool) -> Result<(Mesh, Vector3<f64>), MeshError> {
    Err(MeshError::NoReader)
}
