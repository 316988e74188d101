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

    const SURFACE: Surface = Surface { stiffness: 1e5, dissipation: 2.0, friction: 0.5, rolling: 1e-3 };

    #[test]
    fn hunt_crossley_coulomb_and_rolling_by_hand() {
        // 0.1 mm deep, closing at 0.25 m/s: f = 1e5·1e-4·(1 + 2·0.25) = 15 N; sliding at 2·ε_v: tanh(2) = 0.9640275801;
        // rolling at 1 rad/s: tanh(1) = 0.7615941560.
        let velocity = Vector3::new(2.0 * SLIDING, 0.0, -0.25);
        let load = load(&SURFACE, 1.0, 1e-4, &Vector3::z(), &velocity, &Vector3::y());
        approx::assert_relative_eq!(load.normal, 15.0, epsilon = 1e-12);
        approx::assert_relative_eq!(load.force, Vector3::new(-7.230_206_850_6, 0.0, 15.0), epsilon = 1e-9);
        approx::assert_relative_eq!(load.moment, Vector3::new(0.0, -0.011_423_912_34, 0.0), epsilon = 1e-11);
    }

    #[test]
    fn a_contact_never_pulls() {
        // Opening at 1 m/s: 1 − 2·1 < 0
        let load = load(&SURFACE, 1.0, 1e-4, &Vector3::z(), &Vector3::z(), &Vector3::zeros());
        assert_eq!(load, Load { normal: 0.0, force: Vector3::zeros(), moment: Vector3::zeros() });
    }
}
