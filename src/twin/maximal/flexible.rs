//! Axially elastic struts: one additional velocity each, eliminated strut by strut.
//!
//! A strut is a [`Rod`] from ball a (elbow) to ball b (platform): v_b = v + ω × ℓu + ė·u with the axis u and the
//! present length ℓ. With s = m_ab + m_bb the equation of its elongation is
//!
//! m·ë + s·u·a + u·λ_b = f, f = m_bb·ℓ·|ω⊥|² + s·u·g − T, m = m_bb (plus the implicit terms of a stage),
//!
//! and ë enters the force equation with s·u·ë and the rows of ball b with u·ë. Eliminating ë yields the equations of a
//! rigid body with
//!
//! M − s²/m·u·uᵀ for M, (1 − s/m·u·uᵀ) applied to the strut's block of the rows, W − s/m·f·u and γ − f/m·u on the
//! right-hand side, and G·a − E·λ = γ with E = u·uᵀ/m at ball b. A rigid strut is the limit 1/m → 0.

use nalgebra::Vector3;

use super::Solution;
use super::factor::{Six, add};
use super::rows::Rows;
use super::structure::{MAX_ROWS, Structure};
use crate::kinematics::{BodyMotion, SocketSet};
use crate::machine::bodies::{SLOTS, strut};
use crate::machine::{Inertia, PerStrut};
use crate::twin::rod::Rod;

/// An elastic strut at one instant.
#[derive(Clone, Copy, Debug)]
pub(in crate::twin) struct Stretch {
    pub rod: Rod,
    /// Elongation e, m.
    pub elongation: f64,
    /// Elongation rate ė, m/s.
    pub rate: f64,
    /// Force on the elongation, −T with the implicit terms of a stage, N.
    pub force: f64,
    /// Implicit addition to m_bb: h·γ·damping + h²γ²·stiffness, kg.
    pub added: f64,
}

impl Stretch {
    /// Present length, m.
    pub fn length(&self) -> f64 {
        self.rod.length + self.elongation
    }

    /// Inertia of the strut at its present length.
    pub fn inertia(&self) -> Inertia {
        self.rod.stretched(self.length())
    }

    /// First moment per length, s, kg.
    fn first(&self) -> f64 {
        self.rod.ab + self.rod.bb
    }

    /// Right-hand side f of the elongation equation, N.
    pub(super) fn demand(&self, b: &BodyMotion, gravity: &Vector3<f64>) -> f64 {
        let u = b.rotation.column(0);
        let swing = b.angular_velocity.norm_squared() - b.angular_velocity.dot(&u).powi(2);
        self.rod.bb * self.length() * swing + self.first() * u.dot(gravity) + self.force
    }

    /// Momentum of the elongation, s·u·v + m_bb·ė, N·s.
    pub(super) fn momentum(&self, b: &BodyMotion) -> f64 {
        self.first() * b.rotation.column(0).dot(&b.velocity) + self.rod.bb * self.rate
    }

    /// Contribution of ė to the strut's momentum: s·u·ė, N·s.
    pub(super) fn carried(&self, b: &BodyMotion) -> Vector3<f64> {
        b.rotation.column(0) * (self.first() * self.rate)
    }

    /// Contribution of ė to the velocity products of a rigid strut of this length, force and moment: the Coriolis
    /// acceleration 2·ė·ω × u of ball b.
    pub(super) fn coriolis(&self, b: &BodyMotion) -> (Vector3<f64>, Vector3<f64>) {
        let u = b.rotation.column(0);
        let a = b.angular_velocity.cross(&u) * (2.0 * self.rate);
        (a * self.first(), u.cross(&a) * (self.length() * self.rod.bb))
    }
}

/// Result of eliminating the elongation of a strut.
#[derive(Clone, Copy)]
pub(super) struct Eliminated {
    pub u: Vector3<f64>,
    /// s, kg.
    first: f64,
    /// 1/m, 1/kg.
    pub inverse: f64,
}

impl Eliminated {
    fn of(stretch: &Stretch, b: &BodyMotion) -> Self {
        let inverse = 1.0 / (stretch.rod.bb + stretch.added);
        Self { u: b.rotation.column(0).into_owned(), first: stretch.first(), inverse }
    }
}

/// Eliminates the elongations from mass matrices and rows, and adds their results to `out`.
pub(super) fn eliminate(
    stretches: &[Stretch],
    (structure, bodies, closed): (&Structure, &[BodyMotion; SLOTS], SocketSet),
    mass: &mut [[Six; 6]; SLOTS],
    rows: &mut Rows,
    out: &mut Vec<Eliminated>,
) {
    for (s, stretch) in stretches.iter().enumerate() {
        let b = &bodies[strut(s)];
        let rod = Eliminated::of(stretch, b);
        let linear = [rod.u.x, rod.u.y, rod.u.z, 0.0, 0.0, 0.0];
        for (k, row) in mass[strut(s)].iter_mut().take(3).enumerate() {
            add(row, -rod.first * rod.first * rod.inverse * rod.u[k], &linear);
        }
        if closed.contains(structure.struts + s) {
            let coriolis = b.angular_velocity.cross(&rod.u) * (2.0 * stretch.rate);
            // The rows of the lower ball follow those of the upper one.
            let block = structure.blocks[strut(s)].start + 3;
            for k in 0..3 {
                add(&mut rows.blocks[block + k], -rod.first * rod.inverse * rod.u[k], &linear);
                rows.gamma[structure.ball(s) + k] -= coriolis[k];
            }
        }
        out.push(rod);
    }
}

/// Adds the contributions of f to the right-hand sides.
pub(super) fn load(
    eliminated: &[Eliminated],
    f: &PerStrut<f64>,
    (structure, closed): (&Structure, SocketSet),
    w: &mut [Six; SLOTS],
    gamma: &mut [f64; MAX_ROWS],
) {
    for (s, rod) in eliminated.iter().enumerate() {
        let rate = f[s] * rod.inverse;
        for k in 0..3 {
            w[strut(s)][k] -= rod.first * rate * rod.u[k];
            if closed.contains(structure.struts + s) {
                gamma[structure.ball(s) + k] -= rate * rod.u[k];
            }
        }
    }
}

/// Adds E·λ to the rows' residual.
pub(super) fn give(
    eliminated: &[Eliminated],
    lambda: &[f64; MAX_ROWS],
    structure: &Structure,
    rows: &mut [f64; MAX_ROWS],
) {
    for (s, rod) in eliminated.iter().enumerate() {
        let along = rod.inverse * rod.u.dot(&at(lambda, structure.ball(s)));
        for k in 0..3 {
            rows[structure.ball(s) + k] += rod.u[k] * along;
        }
    }
}

/// Writes ë of every elastic strut, m/s².
pub(super) fn rates(
    eliminated: &[Eliminated],
    f: &PerStrut<f64>,
    structure: &Structure,
    accelerations: &[Six; SLOTS],
    solution: &mut Solution,
) {
    for (s, rod) in eliminated.iter().enumerate() {
        let a = &accelerations[strut(s)];
        let moved = rod.u.dot(&Vector3::new(a[0], a[1], a[2]));
        let held = rod.u.dot(&at(&solution.multipliers, structure.ball(s)));
        solution.stretches[s] = rod.inverse * (f[s] - rod.first * moved - held);
    }
}

fn at(lambda: &[f64; MAX_ROWS], row: usize) -> Vector3<f64> {
    Vector3::from_fn(|k, _| lambda[row + k])
}
