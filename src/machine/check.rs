//! Feasibility of a machine: physically consistent inertia, and struts long enough to close the loops.

use nalgebra::Vector3;

use super::{ARMS, Actuator, Geometry, Inertia};

/// Pose of the machine at q = 0; heights are measured from the shaft plane, up positive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Home {
    /// Centre of the platform's ball plane, m.
    pub platform: Vector3<f64>,
    /// Height of the flange, m.
    pub flange: f64,
    /// Distance of the telescope's Hooke joints, m.
    pub telescope: f64,
}

/// The pose at q = 0; `None` if the struts do not reach.
pub fn home(geometry: &Geometry) -> Option<Home> {
    let platform = platform_at(geometry, [0.0; ARMS])?;
    let lower_hooke = platform + Vector3::z() * geometry.lower_hooke_height;
    Some(Home {
        platform,
        flange: platform.z + geometry.flange_height,
        telescope: (geometry.upper_hooke() - lower_hooke).norm(),
    })
}

/// Platform position (m) at given arm coordinates (rad or m): the lower intersection of three spheres; `None` if there is none.
///
/// Sphere i: centre (R − r + l₁ cos φ_i)·u_i − l₁ sin φ_i·z, radius l₂,i; of a carriage with q + l₁ in place of l₁ and
/// the guide's inclination in place of φ_i.
pub fn platform_at(geometry: &Geometry, arms: [f64; ARMS]) -> Option<Vector3<f64>> {
    let centre = |i: usize| {
        let (out, down) = elbow(geometry, arms[i]);
        Geometry::radial(i) * (out - geometry.platform_radius) - Vector3::z() * down
    };
    let [a, b, c] = std::array::from_fn(centre);
    let [ra, rb, rc] = geometry.strut_length;
    let along = (b - a).try_normalize(1e-9)?;
    let i = along.dot(&(c - a));
    let across = (c - a - i * along).try_normalize(1e-9)?;
    let (d, j) = ((b - a).norm(), across.dot(&(c - a)));
    let x = (ra * ra - rb * rb + d * d) / (2.0 * d);
    let y = (ra * ra - rc * rc + i * i + j * j) / (2.0 * j) - i / j * x;
    let height = ra * ra - x * x - y * y;
    let normal = along.cross(&across);
    // also refuses NaN
    if height.is_nan() || height <= 0.0 {
        return None;
    }
    let down = if normal.z > 0.0 { -normal } else { normal };
    Some(a + x * along + y * across + height.sqrt() * down)
}

/// Distance (m) of an elbow from the centre line, and its depth below the shaft plane, with the drive at `q` (rad or m).
fn elbow(geometry: &Geometry, q: f64) -> (f64, f64) {
    let (length, angle) = match geometry.arms {
        Actuator::Revolute => (geometry.arm_length, q),
        Actuator::Prismatic { inclination } => (geometry.arm_length + q, inclination),
    };
    (geometry.base_radius + length * angle.cos(), length * angle.sin())
}

/// Largest horizontal distance (m) that a strut spans while the arms move together through their limits.
pub fn least_strut_length(geometry: &Geometry) -> f64 {
    let [low, high] = geometry.arm_limits;
    // |R − r + l₁ cos φ| has its maximum at an end of the range or at φ = 0, that of a carriage at an end.
    [low, 0.0, high].map(|q| (elbow(geometry, q).0 - geometry.platform_radius).abs()).into_iter().fold(0.0, f64::max)
}

/// The inertial parameter that violates a consistency condition.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Culprit {
    /// Its mass.
    Mass,
    /// Its first moment.
    FirstMoment,
    /// Its inertia tensor.
    Tensor,
}

/// The violated condition of physical consistency in words, with the parameter to correct; `None` for a consistent
/// inertia.
///
/// An inertia is consistent if and only if its pseudo-inertia is positive semidefinite; eigenvalues down to −1e-9 times
/// the largest entry count as zero.
pub fn inconsistency(inertia: &Inertia) -> Option<(Culprit, String)> {
    let pseudo = inertia.pseudo_inertia();
    if !pseudo.iter().all(|v| v.is_finite()) {
        return Some((Culprit::Tensor, "has a number that is not finite".into()));
    }
    let tolerance = 1e-9 * pseudo.amax();
    if inertia.min_eigenvalue() >= -tolerance {
        return None;
    }
    let m = inertia.mass;
    if m < 0.0 {
        return Some((Culprit::Mass, format!("the mass {m} kg is negative")));
    }
    let moments = inertia.tensor.symmetric_eigenvalues();
    let (a, b, c) = {
        let mut s = [moments[0], moments[1], moments[2]];
        s.sort_by(f64::total_cmp);
        (s[0], s[1], s[2])
    };
    if a < -tolerance {
        return Some((Culprit::Tensor, format!("the principal moment of inertia {a:.4e} kg·m² is negative")));
    }
    if c > a + b + tolerance {
        return Some((
            Culprit::Tensor,
            format!(
                "violates the triangle inequality: the principal moment {c:.4e} kg·m² exceeds the sum of the other \
                 two, {a:.4e} + {b:.4e}"
            ),
        ));
    }
    if m == 0.0 {
        return Some((Culprit::FirstMoment, "has a first moment but no mass".into()));
    }
    let com = inertia.first_moment / m;
    Some((
        Culprit::FirstMoment,
        format!(
            "puts the centre of mass outside the body: at ({:.4}, {:.4}, {:.4}) m the mass alone needs more inertia \
             about the joint than the tensor has",
            com.x, com.y, com.z
        ),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::testing::geometry;

    #[test]
    fn home_pose_is_where_the_cad_has_it() {
        let g = geometry();
        let home = home(&g).unwrap();
        approx::assert_abs_diff_eq!(home.telescope, 0.9304, epsilon = 5e-5);
        approx::assert_abs_diff_eq!(home.flange - g.mounting_height, -1.2309, epsilon = 5e-5);
        approx::assert_abs_diff_eq!(home.platform.xy().norm(), 0.0, epsilon = 1e-12);
    }

    #[test]
    fn platform_keeps_the_strut_lengths() {
        let mut g = geometry();
        g.strut_length = [1.106, 1.11, 1.1];
        let q = [0.3, -0.2, 0.9];
        let p = platform_at(&g, q).unwrap();
        for i in 0..ARMS {
            let elbow = Geometry::radial(i) * (g.base_radius + g.arm_length * q[i].cos())
                - Vector3::z() * g.arm_length * q[i].sin();
            let ball = p + Geometry::radial(i) * g.platform_radius;
            approx::assert_abs_diff_eq!((ball - elbow).norm(), g.strut_length[i], epsilon = 1e-12);
        }
        assert!(p.z < 0.0);
        g.strut_length = [0.6; 3];
        assert_eq!(platform_at(&g, [0.0; 3]), None);
    }

    #[test]
    fn real_bodies_are_consistent() {
        assert_eq!(inconsistency(&Inertia::ZERO), None);
        assert_eq!(inconsistency(&Inertia::point(2.5, Vector3::new(0.3, -0.2, -0.8))), None);
        assert_eq!(inconsistency(&Inertia::diagonal(0.0, [0.0; 3], [0.0015, 0.0015, 0.003])), None);
    }

    #[test]
    fn each_impossible_body_names_its_condition() {
        let reason = |m, c, i| inconsistency(&Inertia::diagonal(m, c, i)).unwrap();
        assert_eq!(reason(-1.0, [0.0; 3], [1.0; 3]).0, Culprit::Mass);
        assert!(reason(1.0, [0.0; 3], [0.1, 0.1, 0.3]).1.contains("triangle"));
        assert!(reason(1.0, [0.0; 3], [-0.1, 0.1, 0.1]).1.contains("negative"));
        assert!(reason(0.0, [0.1, 0.0, 0.0], [1.0; 3]).1.contains("no mass"));
        let (culprit, text) = reason(0.179, [0.3, 0.0, 0.0], [1.5e-5, 0.075, 0.075]);
        assert_eq!(culprit, Culprit::FirstMoment);
        assert!(text.contains("centre of mass"), "{text}");
    }
}
