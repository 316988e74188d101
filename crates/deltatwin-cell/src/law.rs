//! Contact law between a link of the robot and another body.
//!
//! At a contact point with penetration δ (m, positive in contact), penetration rate δ̇, sliding velocity v_t (m/s, of
//! this body relative to the other) and relative angular velocity ω (rad/s):
//!
//! - normal force [Hunt 1975], [`hunt_crossley`] with stiffness k and dissipation d: f = k δ (1 + d δ̇) ≥ 0, N, repulsive;
//! - sliding friction, regularised Coulomb law: −μ f tanh(|v_t|/ε_v) v_t/|v_t|, N;
//! - rolling resistance: −c_r f tanh(|ω|/ε_ω) ω/|ω|, N·m.
//!
//! Only k δ stores energy, ½ k δ²; the other terms dissipate. The opposite load acts on the other body at the same
//! point.

use deltatwin::cell::Surface;
use deltatwin::effects::hunt_crossley;
use nalgebra::Vector3;

/// Sliding speed ε_v of the regularisation, m/s. It bounds the damping μ f/ε_v by friction and thus the step.
pub const SLIDING: f64 = 0.01;
/// Angular velocity ε_ω of the regularisation, rad/s.
pub const ROLLING: f64 = 1.0;

/// Load of one contact point on a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Load {
    /// Normal force f, N.
    pub normal: f64,
    /// Force at the contact point, N.
    pub force: Vector3<f64>,
    /// Free moment, N·m.
    pub moment: Vector3<f64>,
}

/// Load of a contact point with the share `weight` of the stiffness.
///
/// `normal` points to the loaded body; `velocity` and `spin` are its motion relative to the other body at that point.
pub fn load(
    surface: &Surface,
    weight: f64,
    depth: f64,
    normal: &Vector3<f64>,
    velocity: &Vector3<f64>,
    spin: &Vector3<f64>,
) -> Load {
    let approach = -normal.dot(velocity);
    // Linear in the depth, so k·δ in its place gives the force.
    let f = hunt_crossley(weight * surface.stiffness * depth, approach, surface.dissipation);
    let sliding = velocity + normal * approach;
    Load {
        normal: f,
        force: normal * f - saturated(&sliding, SLIDING) * (surface.friction * f),
        moment: -saturated(spin, ROLLING) * (surface.rolling * f),
    }
}

/// Slopes of the law at a contact point: how its load falls with small motions of the loaded body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slopes {
    /// Along the normal: stiffness, N/m, and damping, N·s/m.
    pub normal: (f64, f64),
    /// Damping along and across the sliding, N·s/m.
    pub sliding: (f64, f64),
    /// Damping of the relative angular velocity, the largest of all directions, N·m·s.
    pub rolling: f64,
}

/// Slopes at a contact point, for the arguments of [`load`] and the normal force it has returned.
pub fn slopes(surface: &Surface, weight: f64, depth: f64, normal: f64, sliding: f64, spin: f64) -> Slopes {
    if normal <= 0.0 {
        return Slopes { normal: (0.0, 0.0), sliding: (0.0, 0.0), rolling: 0.0 };
    }
    // f = k·δ·(1 + d·δ̇): ∂f/∂δ = f/δ, ∂f/∂δ̇ = k·δ·d
    let damping = weight * surface.stiffness * depth * surface.dissipation;
    let [along, across] = saturation(sliding, SLIDING);
    Slopes {
        normal: (normal / depth, damping),
        sliding: (surface.friction * normal * along, surface.friction * normal * across),
        rolling: surface.rolling * normal * saturation(spin, ROLLING)[1],
    }
}

/// Derivatives of [`saturated`] along and across a vector of this norm: (1 − tanh²(x))/ε and tanh(x)/(x·ε).
fn saturation(norm: f64, epsilon: f64) -> [f64; 2] {
    let x = norm / epsilon;
    let t = x.tanh();
    [(1.0 - t * t) / epsilon, if x > 1e-6 { t / (x * epsilon) } else { 1.0 / epsilon }]
}

/// Vector tanh(|v|/ε) v/|v|.
fn saturated(v: &Vector3<f64>, epsilon: f64) -> Vector3<f64> {
    let x = v.norm() / epsilon;
    // tanh(x)/x → 1
    v / epsilon * if x > 1e-6 { x.tanh() / x } else { 1.0 }
}

/// Surface properties of a contact pair: those of the less stiff surface.
pub fn between(a: &Surface, b: &Surface) -> Surface {
    if a.stiffness < b.stiffness { *a } else { *b }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    const SURFACE: Surface = Surface { stiffness: 1e5, dissipation: 2.0, friction: 0.5, rolling: 1e-3 };

    #[test]
    fn hunt_crossley_coulomb_and_rolling_by_hand() {
        // 0.1 mm deep, closing at 0.25 m/s: f = 1e5·1e-4·(1 + 2·0.25) = 15 N; sliding at 2·ε_v: tanh(2) = 0.9640275801;
        // rolling at 1 rad/s: tanh(1) = 0.7615941560.
        let velocity = Vector3::new(2.0 * SLIDING, 0.0, -0.25);
        let load = load(&SURFACE, 1.0, 1e-4, &Vector3::z(), &velocity, &Vector3::y());
        assert_relative_eq!(load.normal, 15.0, epsilon = 1e-12);
        assert_relative_eq!(load.force, Vector3::new(-7.230_206_850_6, 0.0, 15.0), epsilon = 1e-9);
        assert_relative_eq!(load.moment, Vector3::new(0.0, -0.011_423_912_34, 0.0), epsilon = 1e-11);
    }

    #[test]
    fn slopes_are_the_differences_of_the_law() {
        let (depth, velocity, spin) = (1e-4, Vector3::new(0.008, 0.0, -0.25), Vector3::new(0.3, 0.0, 0.0));
        let at = |depth: f64, velocity: Vector3<f64>, spin: Vector3<f64>| {
            load(&SURFACE, 0.5, depth, &Vector3::z(), &velocity, &spin)
        };
        let now = at(depth, velocity, spin);
        let got = slopes(&SURFACE, 0.5, depth, now.normal, velocity.x, spin.norm());
        let small = 1e-7;
        let of = |moved: Load, k: usize| (now.force[k] - moved.force[k]) / small;
        // A displacement along the normal reduces the depth, a velocity the approach.
        assert_relative_eq!(got.normal.0, of(at(depth - small, velocity, spin), 2), max_relative = 1e-5);
        assert_relative_eq!(got.normal.1, of(at(depth, velocity + Vector3::z() * small, spin), 2), max_relative = 1e-4);
        assert_relative_eq!(
            got.sliding.0,
            of(at(depth, velocity + Vector3::x() * small, spin), 0),
            max_relative = 1e-4
        );
        assert_relative_eq!(
            got.sliding.1,
            of(at(depth, velocity + Vector3::y() * small, spin), 1),
            max_relative = 1e-4
        );
        let rolled = at(depth, velocity, spin + Vector3::y() * small);
        assert_relative_eq!(got.rolling, (now.moment.y - rolled.moment.y) / small, max_relative = 1e-4);
        let parted = slopes(&SURFACE, 0.5, depth, 0.0, 0.1, 0.1);
        assert_eq!(parted, Slopes { normal: (0.0, 0.0), sliding: (0.0, 0.0), rolling: 0.0 });
    }

    #[test]
    fn a_contact_never_pulls() {
        // Opening at 1 m/s: 1 − 2·1 < 0
        let load = load(&SURFACE, 1.0, 1e-4, &Vector3::z(), &Vector3::z(), &Vector3::zeros());
        assert_eq!(load, Load { normal: 0.0, force: Vector3::zeros(), moment: Vector3::zeros() });
    }
}
