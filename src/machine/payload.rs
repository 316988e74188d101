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
}

impl Payload {
    /// Payload with a known moment about the vertical axis through its centre of mass, `inertia_zz` in kg·m².
    ///
    /// The other two moments are set equal to it and the products to zero. This is physically consistent, and an intact
    /// robot depends on the tensor only through Θ_zz, Θ_xz and Θ_yz.
    pub fn new(mass: f64, com: impl Into<Vector3<f64>>, inertia_zz: f64) -> Self {
        Self { mass, com: com.into(), tensor: Matrix3::identity() * inertia_zz }
    }

    /// Payload with the full tensor xx, yy, zz, xy, xz, yz about the centre of mass, kg·m².
    pub fn with_tensor(mass: f64, com: [f64; 3], [xx, yy, zz, xy, xz, yz]: [f64; 6]) -> Self {
        Self { mass, com: com.into(), tensor: Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz) }
    }

    /// Payload from the keys of a file: `inertia_zz`, `inertia` (xx, yy, zz or xx, yy, zz, xy, xz, yz), or both, in
    /// kg·m².
    ///
    /// # Errors
    /// A description of the fault if `inertia` has neither 3 nor 6 numbers, if the two keys contradict each other, or
    /// if the tensor is not physically consistent.
    pub fn stated(mass: f64, com: [f64; 3], inertia_zz: Option<f64>, inertia: Option<&[f64]>) -> Result<Self, String> {
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
