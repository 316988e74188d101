//! Physical consistency of inertia.

use super::Inertia;

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
    use nalgebra::Vector3;

    use super::*;

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
