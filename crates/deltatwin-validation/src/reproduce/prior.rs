//! Regularisation values of the bodies from weighing and measuring (sections 3.3 and 6.3.2 of the paper).

use nalgebra::{Matrix3, Vector3};

use deltatwin::machine::Inertia;
use deltatwin::machine::bodies::{Bodies, PLATFORM, STRUT, TELESCOPE_LOWER, TELESCOPE_UPPER};

/// A homogeneous cylinder, hollow if `inner` is not zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cylinder {
    /// Mass, kg.
    pub mass: f64,
    /// Length, m.
    pub length: f64,
    /// Inner radius, m.
    pub inner: f64,
    /// Outer radius, m.
    pub outer: f64,
}

impl Cylinder {
    /// Inertia about the end from which the cylinder extends along `axis`, a unit vector.
    ///
    /// About the centre of mass ½m(r² + R²) and 1/12·m(L² + 3(r² + R²)), shifted by half the length.
    pub fn along(&self, axis: Vector3<f64>) -> Inertia {
        let radii = self.inner.powi(2) + self.outer.powi(2);
        let axial = 0.5 * self.mass * radii;
        let lateral = self.mass / 12.0 * (self.length.powi(2) + 3.0 * radii);
        let mut inertia = Inertia::point(self.mass, axis * 0.5 * self.length);
        inertia.tensor += Matrix3::identity() * lateral + axis * axis.transpose() * (axial - lateral);
        inertia
    }
}

/// Strut: weighed 0.150 kg, 1106 mm long, outer radius 8 mm measured, inner radius 7 mm assumed.
pub const STRUT_TUBE: Cylinder = Cylinder { mass: 0.150, length: 1.106, inner: 0.007, outer: 0.008 };
/// Platform, kg.
pub const PLATFORM_MASS: f64 = 1.12;
/// Both parts of the telescope, which cannot be taken apart, kg.
pub const TELESCOPE_MASS: f64 = 1.14;
/// Upper part: 6/10 of the mass, a solid cylinder of 760 mm and radius 6 mm.
pub const TELESCOPE_ROD: Cylinder = Cylinder { mass: 0.6 * TELESCOPE_MASS, length: 0.760, inner: 0.0, outer: 0.006 };
/// Lower part: 4/10 of the mass, a hollow cylinder of 800 mm, radii 6 and 16 mm.
pub const TELESCOPE_TUBE: Cylinder = Cylinder { mass: 0.4 * TELESCOPE_MASS, length: 0.800, inner: 0.006, outer: 0.016 };

/// `bodies` with the struts, the platform and the telescope as weighed and measured; other bodies are unchanged.
pub fn weighed(bodies: &Bodies) -> Bodies {
    let mut out = bodies.clone();
    for strut in STRUT..PLATFORM {
        out[strut] = STRUT_TUBE.along(Vector3::x());
    }
    let platform = &mut out[PLATFORM];
    // Centre of mass from the drawing, 20 mm below the balls; the size has no influence.
    *platform = *platform * (PLATFORM_MASS / platform.mass);
    // Frames at the Hooke joints, z up: the upper part extends downwards, the lower part upwards.
    out[TELESCOPE_UPPER] = TELESCOPE_ROD.along(-Vector3::z());
    out[TELESCOPE_LOWER] = TELESCOPE_TUBE.along(Vector3::z());
    out
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;

    use super::*;

    #[test]
    fn by_hand() {
        // Strut: m c_x = 0.150·0.553; Θ_xx = ½·0.150·(49 + 64)e-6;
        // Θ_yy = 0.0125·(1.106² + 3·113e-6) + 0.150·0.553² = 0.0125·1.223575 + 0.04587135.
        let strut = STRUT_TUBE.along(Vector3::x());
        assert_relative_eq!(strut.first_moment.x, 0.08295, epsilon = 1e-15);
        assert_relative_eq!(strut.tensor[(0, 0)], 8.475e-6, epsilon = 1e-18);
        assert_relative_eq!(strut.tensor[(1, 1)], 0.0152946875 + 0.04587135, epsilon = 1e-12);
        assert_relative_eq!(strut.tensor[(1, 1)], strut.tensor[(2, 2)]);
        // Upper part, 0.684 kg: m c_z = −0.684·0.38; Θ_zz = ½·0.684·36e-6;
        // Θ_xx = 0.057·(0.5776 + 108e-6) + 0.684·0.1444.
        let upper = TELESCOPE_ROD.along(-Vector3::z());
        assert_relative_eq!(upper.first_moment, Vector3::new(0.0, 0.0, -0.25992), epsilon = 1e-15);
        assert_relative_eq!(upper.tensor[(2, 2)], 1.2312e-5, epsilon = 1e-16);
        assert_relative_eq!(upper.tensor[(0, 0)], 0.032929356 + 0.0987696, epsilon = 1e-12);
        assert_relative_eq!(upper.tensor[(0, 0)], upper.tensor[(1, 1)], epsilon = 1e-15);
        // Lower part, 0.456 kg: m c_z = 0.456·0.4; Θ_zz = ½·0.456·292e-6; Θ_xx = 0.038·(0.64 + 876e-6) + 0.456·0.16.
        let lower = TELESCOPE_TUBE.along(Vector3::z());
        assert_relative_eq!(lower.first_moment, Vector3::new(0.0, 0.0, 0.1824), epsilon = 1e-15);
        assert_relative_eq!(lower.tensor[(2, 2)], 6.6576e-5, epsilon = 1e-16);
        assert_relative_eq!(lower.tensor[(0, 0)], 0.024353288 + 0.07296, epsilon = 1e-12);
        for body in [strut, upper, lower] {
            assert!(body.min_eigenvalue() > 0.0);
        }
    }

    #[test]
    fn only_what_was_weighed_changes() {
        let model = deltatwin_io::model::read(std::path::Path::new("../../models/irb360-6-1600.toml")).unwrap();
        let weighed = weighed(&model.bodies);
        assert_eq!(weighed[PLATFORM].mass, 1.12);
        assert_relative_eq!(weighed[PLATFORM].first_moment.z, -0.0224, epsilon = 1e-15);
        assert_eq!(weighed.0[..STRUT], model.bodies.0[..STRUT]);
        assert_eq!(weighed[deltatwin::machine::bodies::ROTOR], model.bodies[deltatwin::machine::bodies::ROTOR]);
    }
}
