//! Triangle meshes of the robot's parts: surfaces of revolution, tapered beams, plates and springs.

use nalgebra::Vector3;
use rerun::archetypes as a;

use super::point;

/// Number of corners of a circle.
const ROUND: usize = 24;

/// Triangles with a normal at every corner.
#[derive(Clone, Debug, Default)]
pub(super) struct Mesh {
    corners: Vec<Vector3<f64>>,
    normals: Vec<Vector3<f64>>,
    triangles: Vec<[u32; 3]>,
}

/// Two directions that form a right-handed frame with `axis`.
fn across(axis: Vector3<f64>) -> [Vector3<f64>; 2] {
    let other = if axis.z.abs() < 0.9 { Vector3::z() } else { Vector3::x() };
    let first = axis.cross(&other).normalize();
    [first, axis.cross(&first)]
}

impl Mesh {
    /// Surface of revolution about the line from `base` along the unit vector `axis`: (position along it, radius) of each
    /// ring in m. Edges are sharp; radius zero closes an end.
    pub fn lathe(base: Vector3<f64>, axis: Vector3<f64>, profile: &[(f64, f64)]) -> Self {
        let [side, up] = across(axis);
        let mut mesh = Self::default();
        for pair in profile.windows(2) {
            let [(from, lower), (to, upper)] = [pair[0], pair[1]];
            // Normal of the cone between two rings, in its plane through the axis.
            let slope = Vector3::new(to - from, -(upper - lower), 0.0).try_normalize(0.0).unwrap_or(Vector3::x());
            let first = mesh.corners.len() as u32;
            for k in 0..=ROUND {
                let (sin, cos) = (k as f64 * std::f64::consts::TAU / ROUND as f64).sin_cos();
                let out = side * cos + up * sin;
                for (place, radius) in [(from, lower), (to, upper)] {
                    mesh.corners.push(base + axis * place + out * radius);
                    mesh.normals.push(out * slope.x + axis * slope.y);
                }
            }
            for k in 0..ROUND as u32 {
                let i = first + 2 * k;
                mesh.triangles.extend([[i, i + 2, i + 1], [i + 1, i + 2, i + 3]]);
            }
        }
        mesh
    }

    /// A beam along x from 0 to `length` whose rectangular section, half widths along y and z in m, tapers linearly from
    /// `from` to `to`.
    pub fn beam(length: f64, from: [f64; 2], to: [f64; 2]) -> Self {
        let section = |x: f64, [y, z]: [f64; 2]| {
            [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[a, b]| Vector3::new(x, a * y, b * z))
        };
        let (start, end) = (section(0.0, from), section(length, to));
        let mut mesh = Self::default();
        for k in 0..4 {
            let next = (k + 1) % 4;
            mesh.face(&[start[k], start[next], end[next], end[k]]);
        }
        mesh.face(&[start[3], start[2], start[1], start[0]]);
        mesh.face(&end);
        mesh
    }

    /// A plate of the given half thickness, m, about a convex polygon at z = 0.
    pub fn plate(outline: &[Vector3<f64>], half: f64) -> Self {
        let mut outline = outline.to_vec();
        let area: f64 = (1..outline.len()).map(|k| outline[k - 1].cross(&outline[k]).z).sum();
        if area < 0.0 {
            outline.reverse();
        }
        let level = |z: f64| outline.iter().map(|p| p + Vector3::z() * z).collect::<Vec<_>>();
        let (bottom, top) = (level(-half), level(half));
        let mut mesh = Self::default();
        for k in 0..outline.len() {
            let next = (k + 1) % outline.len();
            mesh.face(&[bottom[k], bottom[next], top[next], top[k]]);
        }
        mesh.face(&top);
        mesh.face(&bottom.into_iter().rev().collect::<Vec<_>>());
        mesh
    }

    /// Adds a flat convex face, corners counterclockwise from outside.
    fn face(&mut self, corners: &[Vector3<f64>]) {
        let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
        let normal = normal.try_normalize(0.0).unwrap_or(Vector3::z());
        let first = self.corners.len() as u32;
        self.corners.extend(corners);
        self.normals.extend(corners.iter().map(|_| normal));
        self.triangles.extend((2..corners.len() as u32).map(|k| [first, first + k - 1, first + k]));
    }

    /// This mesh and another one.
    pub fn and(mut self, other: Self) -> Self {
        let first = self.corners.len() as u32;
        self.corners.extend(other.corners);
        self.normals.extend(other.normals);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|k| k + first)));
        self
    }

    /// This mesh at another place, m.
    pub fn moved(mut self, by: Vector3<f64>) -> Self {
        self.corners.iter_mut().for_each(|corner| *corner += by);
        self
    }

    /// The mesh for Rerun, without colour.
    pub fn bare(&self) -> a::Mesh3D {
        a::Mesh3D::new(self.corners.iter().map(|c| point(*c)))
            .with_vertex_normals(self.normals.iter().map(|n| point(*n)))
            .with_triangle_indices(self.triangles.iter().copied())
    }

    /// The mesh for Rerun with a colour for all times.
    pub fn solid(&self, [r, g, b]: [u8; 3]) -> a::Mesh3D {
        self.bare().with_albedo_factor(rerun::Rgba32::from_rgb(r, g, b))
    }
}

/// Helix of a spring between two points, m, its radius and number of turns.
pub(super) fn spring(ends: [Vector3<f64>; 2], radius: f64, turns: usize) -> Vec<[f32; 3]> {
    const STEPS: usize = 12;
    let axis = ends[1] - ends[0];
    let [side, up] = across(axis.normalize());
    let count = turns * STEPS;
    (0..=count)
        .map(|k| {
            let (sin, cos) = (k as f64 * std::f64::consts::TAU / STEPS as f64).sin_cos();
            // The hooks at both ends lie on the axis.
            let wide = if k == 0 || k == count { 0.0 } else { radius };
            point(ends[0] + axis * (k as f64 / count as f64) + (side * cos + up * sin) * wide)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Volume enclosed by a mesh, by the divergence theorem; positive if all faces look outward.
    fn volume(mesh: &Mesh) -> f64 {
        let corner = |k: u32| mesh.corners[k as usize];
        mesh.triangles.iter().map(|t| corner(t[0]).dot(&corner(t[1]).cross(&corner(t[2]))) / 6.0).sum()
    }

    #[test]
    fn surfaces_are_closed_and_look_outward() {
        let cylinder =
            Mesh::lathe(Vector3::new(1.0, 2.0, 3.0), Vector3::x(), &[(0.0, 0.0), (0.0, 0.5), (2.0, 0.5), (2.0, 0.0)]);
        let polygon = ROUND as f64 * 0.5 * (std::f64::consts::TAU / ROUND as f64).sin();
        assert!((volume(&cylinder) - polygon * 0.25 * 2.0).abs() < 1e-12, "{}", volume(&cylinder));
        let frustum = Mesh::beam(3.0, [1.0, 1.0], [0.5, 0.5]);
        assert!((volume(&frustum) - (4.0 + 1.0 + 2.0)).abs() < 1e-12, "{}", volume(&frustum));
        let square = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[x, y]| Vector3::new(x, y, 0.0));
        assert!((volume(&Mesh::plate(&square, 0.25)) - 2.0).abs() < 1e-12);
        let clockwise = [square[3], square[2], square[1], square[0]];
        assert!((volume(&Mesh::plate(&clockwise, 0.25)) - 2.0).abs() < 1e-12);
        let both = frustum.clone().and(cylinder.clone());
        assert!((volume(&both) - volume(&frustum) - volume(&cylinder)).abs() < 1e-12);
        assert!(both.normals.iter().all(|n| (n.norm() - 1.0).abs() < 1e-12));
    }

    #[test]
    fn a_spring_reaches_both_ends() {
        let coil = spring([Vector3::x(), Vector3::y()], 0.1, 5);
        assert_eq!((coil[0], coil[coil.len() - 1]), ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]));
    }
}
