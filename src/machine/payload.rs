//! Payload at the flange.

use nalgebra::{Matrix3, Vector3};

use super::Inertia;
use super::check::inconsistency;

/// Payload at the flange; frame: origin at the flange centre, z up, rotating with ψ.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Payload {
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass, m.
    pub com: Vector3<f64>,
    /// Inertia tensor about the centre of mass, kg·m²; Θ_xy = −∫xy dm etc. ([Gnad 2024], eq. 4).
    pub tensor: Matrix3<f64>,
    /// Areas of a box's faces across x, y and z, m²; zero if its shape is not known.
    pub faces: Vector3<f64>,
}

/// Largest radius of gyration of a payload, m: that of a bar of 17 m.
const MOST_GYRATION: f64 = 5.0;

impl Payload {
    /// Payload with a known moment about the vertical axis through its centre of mass, `inertia_zz` in kg·m².
    ///
    /// The other two moments are set equal to it and the products to zero. This is physically consistent, and an intact
    /// robot depends on the tensor only through Θ_zz, Θ_xz and Θ_yz.
    pub fn new(mass: f64, com: impl Into<Vector3<f64>>, inertia_zz: f64) -> Self {
        Self { mass, com: com.into(), tensor: Matrix3::identity() * inertia_zz, faces: Vector3::zeros() }
    }

    /// Payload with the full tensor xx, yy, zz, xy, xz, yz about the centre of mass, kg·m².
    pub fn with_tensor(mass: f64, com: [f64; 3], [xx, yy, zz, xy, xz, yz]: [f64; 6]) -> Self {
        let tensor = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        Self { mass, com: com.into(), tensor, faces: Vector3::zeros() }
    }

    /// A box of uniform density with edges of `size` (m) along x, y, z, which the flange holds at `grip`, a point given
    /// from the centre of the box, m.
    ///
    /// The centre of mass is at −grip, and Θ_xx = m/12·(b² + c²) for the edges a, b, c, etc.
    pub fn cuboid(mass: f64, size: [f64; 3], grip: [f64; 3]) -> Self {
        let [a, b, c] = size;
        let of = |x: f64, y: f64| mass / 12.0 * (x * x + y * y);
        let faces = Vector3::new(b * c, c * a, a * b);
        Self {
            faces,
            ..Self::with_tensor(mass, grip.map(std::ops::Neg::neg), [of(b, c), of(c, a), of(a, b), 0.0, 0.0, 0.0])
        }
    }

    /// Mean projected area of a box over all directions, m²: a quarter of its surface; zero if its shape is not known.
    pub fn mean_area(&self) -> f64 {
        0.5 * self.faces.sum()
    }

    /// Projected area of a box against `direction` (a unit vector in the end effector's axes), over its mean; 1 if its
    /// shape is not known.
    pub fn area_share(&self, direction: &Vector3<f64>) -> f64 {
        let mean = self.mean_area();
        if mean > 0.0 { self.faces.dot(&direction.abs()) / mean } else { 1.0 }
    }

    /// Payload from the keys of a file: `inertia_zz`, `inertia` (xx, yy, zz or xx, yy, zz, xy, xz, yz), or both, in
    /// kg·m².
    ///
    /// # Errors
    /// A description of the fault if `inertia` has neither 3 nor 6 numbers, if the two keys contradict each other, or
    /// if the tensor is not physically consistent, or that of no body of this mass.
    pub fn stated(mass: f64, com: [f64; 3], inertia_zz: Option<f64>, inertia: Option<&[f64]>) -> Result<Self, String> {
        let largest = inertia.into_iter().flatten().take(3).chain(&inertia_zz).fold(0.0_f64, |most, x| most.max(*x));
        if largest > mass * MOST_GYRATION * MOST_GYRATION {
            return Err(format!(
                "is {largest} kg·m² for a mass of {mass} kg; expected a radius of gyration of at most {MOST_GYRATION} m"
            ));
        }
        let payload = match inertia {
            None => return Ok(Self::new(mass, com, inertia_zz.unwrap_or(0.0))),
            Some(&[xx, yy, zz]) => Self::with_tensor(mass, com, [xx, yy, zz, 0.0, 0.0, 0.0]),
            Some(&[xx, yy, zz, xy, xz, yz]) => Self::with_tensor(mass, com, [xx, yy, zz, xy, xz, yz]),
            Some(other) => {
                return Err(format!("has {} numbers; expected xx, yy, zz or xx, yy, zz, xy, xz, yz", other.len()));
            }
        };
        let zz = payload.inertia_zz();
        if let Some(other) = inertia_zz.filter(|other| (other - zz).abs() > 1e-9 * zz.abs().max(other.abs())) {
            return Err(format!(
                "has zz = {zz}, but `inertia_zz` is {other}; expected the same number, or one of the keys"
            ));
        }
        match inconsistency(&Inertia { mass, first_moment: Vector3::zeros(), tensor: payload.tensor }) {
            Some((_, reason)) => Err(format!("{reason}; expected the tensor of a real body about its centre of mass")),
            None => Ok(payload),
        }
    }

    /// Moment of inertia about the vertical axis through the centre of mass, kg·m².
    pub fn inertia_zz(&self) -> f64 {
        self.tensor[(2, 2)]
    }

    /// Entries xx, yy, zz, xy, xz, yz of the tensor, kg·m².
    pub fn moments(&self) -> [f64; 6] {
        let t = &self.tensor;
        [t[(0, 0)], t[(1, 1)], t[(2, 2)], t[(0, 1)], t[(0, 2)], t[(1, 2)]]
    }

    /// Inertia about the flange centre in the end-effector frame.
    pub fn inertia(&self) -> Inertia {
        let mut i = Inertia::point(self.mass, self.com);
        i.tensor += self.tensor;
        i
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dumbbell_at_45_degrees() {
        // Two points of 1 kg at ±(0.1, 0, 0.1) m from their centre: Θ_xx = Θ_zz = 2·0.01, Θ_yy = 2·0.02, Θ_xz = −2·0.01 kg·m².
        let stated = Payload::with_tensor(2.0, [0.03, -0.02, -0.3], [0.02, 0.04, 0.02, 0.0, -0.02, 0.0]);
        let mut points = Inertia::point(1.0, [0.13, -0.02, -0.2].into());
        points += Inertia::point(1.0, [-0.07, -0.02, -0.4].into());
        let inertia = stated.inertia();
        approx::assert_relative_eq!(inertia.first_moment, points.first_moment, epsilon = 1e-15);
        approx::assert_relative_eq!(inertia.tensor, points.tensor, epsilon = 1e-15);
    }

    #[test]
    fn a_box_gripped_beside_its_centre() {
        // 6 kg, 0.4 × 0.3 × 0.2 m, held at the top, 0.1 m from its middle along x: 6/12·(0.09 + 0.04), (0.04 + 0.16),
        // (0.16 + 0.09) kg·m²; faces 0.06, 0.08, 0.12 m².
        let load = Payload::cuboid(6.0, [0.4, 0.3, 0.2], [0.1, 0.0, 0.1]);
        assert_eq!(load.com, Vector3::new(-0.1, 0.0, -0.1));
        for (got, expected) in load.moments().iter().zip([0.065, 0.1, 0.125, 0.0, 0.0, 0.0]) {
            approx::assert_relative_eq!(*got, expected, epsilon = 1e-15);
        }
        approx::assert_relative_eq!(load.faces, Vector3::new(0.06, 0.08, 0.12), epsilon = 1e-15);
        // About the flange, by hand: Θ_yy + 6·(0.1² + 0.1²) = 0.22, Θ_xz = −6·(−0.1)·(−0.1) = −0.06 kg·m².
        let inertia = load.inertia();
        approx::assert_relative_eq!(inertia.tensor[(1, 1)], 0.22, epsilon = 1e-15);
        approx::assert_relative_eq!(inertia.tensor[(0, 2)], -0.06, epsilon = 1e-15);
        // A quarter of the surface, 2·0.26/4; along x a face of 0.06, along the diagonal of the xy plane (0.06 +
        // 0.08)/√2.
        approx::assert_relative_eq!(load.mean_area(), 0.13, epsilon = 1e-15);
        approx::assert_relative_eq!(load.area_share(&Vector3::x()), 0.06 / 0.13, epsilon = 1e-15);
        let diagonal = Vector3::new(1.0, -1.0, 0.0).normalize();
        approx::assert_relative_eq!(load.area_share(&diagonal), 0.14 / 2f64.sqrt() / 0.13, epsilon = 1e-15);
        assert_eq!(Payload::new(1.0, [0.0; 3], 0.0).area_share(&Vector3::x()), 1.0);
    }

    #[test]
    fn contradictions_are_refused() {
        let of = |zz, inertia: Option<&[f64]>| Payload::stated(1.0, [0.0; 3], zz, inertia);
        assert_eq!(of(Some(0.02), None), Ok(Payload::new(1.0, [0.0; 3], 0.02)));
        assert_eq!(of(Some(0.02), Some(&[0.01, 0.03, 0.02])).unwrap().moments(), [0.01, 0.03, 0.02, 0.0, 0.0, 0.0]);
        assert!(of(Some(0.03), Some(&[0.01, 0.03, 0.02])).unwrap_err().contains("`inertia_zz` is 0.03"));
        assert!(of(None, Some(&[0.01, 0.01, 0.03])).unwrap_err().contains("triangle"));
        assert!(of(None, Some(&[0.01, 0.01])).unwrap_err().starts_with("has 2 numbers"));
        assert!(of(None, Some(&[0.01, 0.01, 0.01, 0.0, 0.02, 0.0])).is_err());
    }
}
