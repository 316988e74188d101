//! The mechanism in absolute coordinates with any set of open ball sockets: M·a + Gᵀ·λ = W, G·a = γ.
//!
//! All bodies with six velocities each (of the frame origin, and angular, inertial axes) and the rows of their joints, as
//! `structure` lists them for any limbs and any plate: of the robot with a telescope fourteen bodies and 74 rows, three
//! fewer per open socket. Used after a dislocation, and to verify the closed-form elimination in `closed`, with which it
//! shares the inertia parameters only.
//!
//! M is block diagonal, so that S = G·M⁻¹·Gᵀ couples only joints of the same body; it is factored along the branches of
//! the mechanism. The end effector may have no inertia of its own (M singular). Inertia is therefore shifted to it from
//! platform and telescope, *exactly*: for a row g_E·a_E + g_D·a_D = γ and any r,
//!
//! M_E + r·g_Eᵀg_E, M_D − r·g_Dᵀg_D, W_D − r·g_Dᵀγ give the same a, and λ = λ′ + r·g_E·a_E.
//!
//! With r at most half of the donor's inertia along g_D both stay positive definite. Any other body with singular
//! inertia (a point mass, a bar) is lent a millionth of the mechanism's, which iterative refinement removes again. If S
//! has lost rank (redundant struts, or a degenerate pose) it is regularised and refined as well; a is then unique, λ is
//! not. The result is [`SingularPose`] if refinement does not reach 1e-9 of the terms of either equation, or if an
//! inertia is not physically consistent.

mod added;
mod factor;
mod flexible;
mod rows;
mod schur;
mod structure;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
mod workspace;

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

pub use self::added::Added;
use self::factor::{Six, add};
pub(super) use self::flexible::Stretch;
pub use self::structure::MAX_ROWS;
use self::workspace::Workspace;
use super::SingularPose;
use super::state::{BodyState, rotation};
use crate::dynamics::Plant;
use crate::kinematics::{BodyMotion, Reactions, SocketSet};
use crate::machine::bodies::{BodyKind, SLOTS, body_kind, strut};
use crate::machine::{Bodies, Inertia, PerSocket, PerStrut, each};
use crate::numerics::worst;

/// Two vectors (inertial axes) at a body's origin: velocity and angular velocity, their derivatives, or force and
/// moment.
pub type Pair = (Vector3<f64>, Vector3<f64>);

/// Accelerations (or velocities after an impulse) and multipliers.
#[derive(Clone, Debug)]
pub struct Solution {
    /// Acceleration of the origin (m/s²) and angular acceleration (rad/s²) of every body, inertial axes.
    pub bodies: [Pair; SLOTS],
    /// Multiplier λ of every row, of a robot with three limbs in the order of [`rows`](super::constraints::rows), N or
    /// N·m; zero at open sockets. Joint forces are −Gᵀ·λ.
    pub multipliers: [f64; MAX_ROWS],
    /// ë of elastic struts, m/s², or the corresponding changes in a projection; zero for rigid ones.
    pub(super) stretches: PerStrut<f64>,
}

impl Solution {
    const NONE: Self = {
        const NOTHING: Pair = (Vector3::new(0., 0., 0.), Vector3::new(0., 0., 0.));
        Self { bodies: [NOTHING; SLOTS], multipliers: [0.0; MAX_ROWS], stretches: each(0.0) }
    };
}

/// Solver with its workspace; nothing is allocated after [`MaximalCoordinates::new`].
pub struct MaximalCoordinates(Box<Workspace>);

/// Violation below which a row counts as satisfied, m or 1.
const CLOSED: f64 = 1e-13;
const MAX_PROJECTIONS: usize = 12;

/// Terms of the equations besides rigid bodies.
#[derive(Clone, Copy, Default)]
pub(super) struct Extra<'a> {
    /// Addition to the blocks of the mass matrix.
    pub damping: Option<&'a [Added; SLOTS]>,
    /// Elastic struts; `None` if they are rigid.
    pub stretches: Option<&'a [Stretch]>,
}

impl MaximalCoordinates {
    /// A solver with an empty workspace for the joints of a machine.
    pub fn new(plant: &Plant) -> Self {
        Self(Box::new(Workspace::new(plant)))
    }

    /// Whether the struts do not determine their forces while all sockets are closed.
    pub(super) fn is_redundant(&self) -> bool {
        self.0.redundant > 0
    }

    /// Bodies with joints.
    pub(super) fn bodies(&self) -> &[usize] {
        &self.0.structure.bodies
    }

    /// Accelerations and multipliers of M·a + Gᵀ·λ = W, G·a = γ.
    ///
    /// `bodies` holds poses and velocities; W is the sum of `wrenches` (applied forces and moments about the origins, N
    /// and N·m, inertial axes: effects, drives, contacts), weight and velocity products. `damping` is added to the
    /// blocks of M: h·γ·D of an implicit integrator.
    ///
    /// # Errors
    /// [`SingularPose`] if an inertia is not physically consistent or the equations cannot be solved to 1e-9 of their
    /// terms.
    pub fn solve(
        &mut self,
        plant: &Plant,
        bodies: &[BodyMotion; SLOTS],
        closed: SocketSet,
        wrenches: &[Pair; SLOTS],
        damping: Option<&[Added; SLOTS]>,
    ) -> Result<&Solution, SingularPose> {
        self.solve_with(plant, bodies, closed, wrenches, Extra { damping, stretches: None })
    }

    /// [`Self::solve`] with elastic struts.
    pub(super) fn solve_with(
        &mut self,
        plant: &Plant,
        bodies: &[BodyMotion; SLOTS],
        closed: SocketSet,
        wrenches: &[Pair; SLOTS],
        Extra { damping, stretches }: Extra,
    ) -> Result<&Solution, SingularPose> {
        let gravity = plant.gravity_vector();
        self.0.prepare(plant, bodies, closed, damping, stretches)?;
        let mut loads = std::array::from_fn(|b| {
            let (force, moment) = velocity_products(&inertia(plant, b, stretches), &bodies[b], &gravity);
            six(&(wrenches[b].0 - force, wrenches[b].1 - moment))
        });
        let mut demand: PerStrut<f64> = each(0.0);
        for (s, stretch) in stretches.into_iter().flatten().enumerate() {
            let b = &bodies[strut(s)];
            add(&mut loads[strut(s)], -1.0, &six(&stretch.coriolis(b)));
            demand[s] = stretch.demand(b, &gravity);
        }
        let gamma = self.0.rows.gamma;
        self.0.equations(&loads, &gamma, &demand)
    }

    /// Velocities after an impulsive load or a change of inertia, with all rows satisfied: `solution.bodies` are twists
    /// (m/s, rad/s) and its multipliers impulses (N·s, N·m·s).
    ///
    /// M₊·v⁺ = M₋·v⁻ + p − Gᵀ·λ, G·v⁺ = 0. M₊ is the inertia of `plant`, M₋ that of `before` (the momentum of an
    /// attached body is part of p), v⁻ the velocities in `bodies` and p the `impulses` about the origins, N·s and
    /// N·m·s.
    ///
    /// # Errors
    /// As for [`Self::solve`].
    pub fn impulse(
        &mut self,
        plant: &Plant,
        before: &Bodies,
        bodies: &[BodyMotion; SLOTS],
        closed: SocketSet,
        impulses: &[Pair; SLOTS],
    ) -> Result<&Solution, SingularPose> {
        self.0.prepare(plant, bodies, closed, None, None)?;
        let loads = std::array::from_fn(|b| {
            let (p, l) = momentum(&before[b], &bodies[b]);
            six(&(impulses[b].0 + p, impulses[b].1 + l))
        });
        self.0.equations(&loads, &[0.0; MAX_ROWS], &each(0.0))
    }

    /// Projects poses and velocities onto the rows of all joints: poses to 1e-13 m (or 1), velocities to rounding; returns the
    /// number of corrections of the poses.
    ///
    /// Gauss–Newton iteration on the poses in the metric of M, δ = −M⁻¹·Gᵀ·S⁻¹·c with rotations exp(δω), then the
    /// orthogonal projection of the velocities: M·v⁺ + Gᵀ·μ = M·v, G·v⁺ = 0.
    ///
    /// # Errors
    /// [`SingularPose`] as for [`Self::solve`], or if the iteration does not converge.
    pub fn project(
        &mut self,
        plant: &Plant,
        bodies: &mut [BodyState; SLOTS],
        closed: SocketSet,
    ) -> Result<usize, SingularPose> {
        self.project_elastic(plant, bodies, closed, None)
    }

    /// [`Self::project`] with elastic struts, including their elongations and elongation rates.
    pub(super) fn project_elastic(
        &mut self,
        plant: &Plant,
        bodies: &mut [BodyState; SLOTS],
        closed: SocketSet,
        mut stretches: Option<&mut [Stretch]>,
    ) -> Result<usize, SingularPose> {
        let work = &mut *self.0;
        for corrections in 0..MAX_PROJECTIONS {
            let motion = motions(bodies);
            let now = stretches.as_deref();
            work.prepare(plant, &motion, closed, None, now)?;
            if work.rows.values.iter().all(|c| c.abs() < CLOSED) {
                let mut loads = std::array::from_fn(|b| six(&momentum(&inertia(plant, b, now), &motion[b])));
                let mut demand: PerStrut<f64> = each(0.0);
                for (s, stretch) in now.into_iter().flatten().enumerate() {
                    let b = &motion[strut(s)];
                    add(&mut loads[strut(s)], 1.0, &six(&(stretch.carried(b), Vector3::zeros())));
                    demand[s] = stretch.momentum(b);
                }
                let solution = work.equations(&loads, &[0.0; MAX_ROWS], &demand)?.clone();
                for &b in &work.structure.bodies {
                    let body = &mut bodies[b];
                    body.velocity = solution.bodies[b].0;
                    body.angular_velocity = motion[b].rotation.tr_mul(&solution.bodies[b].1);
                }
                for (s, stretch) in stretches.into_iter().flatten().enumerate() {
                    stretch.rate = solution.stretches[s];
                }
                return Ok(corrections);
            }
            let back = work.rows.values.map(|c| -c);
            let solution = work.equations(&[[0.0; 6]; SLOTS], &back, &each(0.0))?.clone();
            for &b in &work.structure.bodies {
                let (body, (shift, turn)) = (&mut bodies[b], &solution.bodies[b]);
                body.position += shift;
                let old = UnitQuaternion::new_normalize(body.orientation);
                body.orientation = *(UnitQuaternion::from_scaled_axis(*turn) * old);
            }
            for (s, stretch) in stretches.iter_mut().flat_map(|all| all.iter_mut()).enumerate() {
                stretch.elongation += solution.stretches[s];
            }
        }
        Err(SingularPose)
    }

    /// Largest violation of a row at the last pose, m or 1.
    pub fn violation(&self) -> f64 {
        self.0.rows.values.iter().copied().fold(0.0, worst)
    }

    /// Force on the strut at each socket from the last solution, N, inertial axes; zero where open.
    pub fn socket_forces(&self) -> PerSocket<Vector3<f64>> {
        let Workspace { structure, solution, .. } = &*self.0;
        let mut out: PerSocket<Vector3<f64>> = each(Vector3::zeros());
        for (k, force) in out.iter_mut().enumerate().take(2 * structure.struts) {
            *force = -Vector3::from_fn(|i, _| solution.multipliers[structure.socket[k] + i]);
        }
        out
    }

    /// Axial strut forces from the last solution, tension positive, N; `bodies` as passed to it.
    pub fn axial_forces(&self, bodies: &[BodyMotion; SLOTS]) -> Reactions {
        let (forces, struts) = (self.socket_forces(), self.0.structure.struts);
        let along = |s: usize, k: usize| bodies[strut(s)].rotation.column(0).dot(&forces[k]);
        let mut out = Reactions::ZERO;
        for s in 0..struts {
            (out.upper[s], out.lower[s]) = (-along(s, s), along(s, struts + s));
        }
        out
    }

    /// −Gᵀ·λ of one joint on one body.
    #[cfg(test)]
    fn wrench(&self, body: usize, joint: usize) -> Pair {
        let Workspace { structure, solution, rows, .. } = &*self.0;
        let mut sum = [0.0; 6];
        let (first, block) = structure.on(body, joint);
        for (k, block) in (block..block + first.len()).enumerate() {
            add(&mut sum, -solution.multipliers[first.start + k], &rows.blocks[block]);
        }
        pair(&sum)
    }
}

/// Inertia of body `b`; of an elastic strut at its present length.
fn inertia(plant: &Plant, b: usize, stretches: Option<&[Stretch]>) -> Inertia {
    match (stretches, body_kind(b)) {
        (Some(all), BodyKind::Strut(s)) if s < all.len() => all[s].inertia(),
        _ => plant.bodies[b],
    }
}

/// Spatial inertia about the body's origin, inertial axes: [m + D_v, −h× + D_cᵀ; h× + D_c, Θ + D_ω] with h = m·c.
fn spatial(inertia: &Inertia, r: &Matrix3<f64>, damping: Option<&Added>) -> [Six; 6] {
    let h = r * inertia.first_moment;
    let mut tensor = r * inertia.tensor * r.transpose();
    let mut m = [[0.0; 6]; 6];
    if let Some(added) = damping {
        tensor += added.angular;
        for k in 0..3 {
            for i in 0..3 {
                m[k][i] = added.linear[(i, k)];
            }
        }
    }
    for k in 0..3 {
        m[k][k] += inertia.mass;
        for i in 0..3 {
            m[3 + k][3 + i] = 0.5 * (tensor[(i, k)] + tensor[(k, i)]);
        }
    }
    // M = h × a: moment per unit of acceleration.
    for (i, k, x) in [(0, 1, -h.z), (0, 2, h.y), (1, 0, h.z), (1, 2, -h.x), (2, 0, -h.y), (2, 1, h.x)] {
        m[k][3 + i] = x;
        m[3 + i][k] = x;
    }
    if let Some(added) = damping {
        for k in 0..3 {
            for i in 0..3 {
                m[k][3 + i] += added.coupling[(i, k)];
                m[3 + i][k] += added.coupling[(i, k)];
            }
        }
    }
    m
}

/// `dynamics::inertial_wrench` at zero acceleration: F = ω × (ω × h) − m·g, M = ω × Θω − h × g.
fn velocity_products(inertia: &Inertia, b: &BodyMotion, gravity: &Vector3<f64>) -> Pair {
    let h = b.rotation * inertia.first_moment;
    let omega = &b.angular_velocity;
    let spin = b.rotation * (inertia.tensor * b.rotation.tr_mul(omega));
    (omega.cross(&omega.cross(&h)) - gravity * inertia.mass, omega.cross(&spin) - h.cross(gravity))
}

/// Momentum p = m·v + ω × h and angular momentum about the origin l = h × v + Θω.
pub(super) fn momentum(inertia: &Inertia, b: &BodyMotion) -> Pair {
    let h = b.rotation * inertia.first_moment;
    let spin = b.rotation * (inertia.tensor * b.rotation.tr_mul(&b.angular_velocity));
    (b.velocity * inertia.mass + b.angular_velocity.cross(&h), h.cross(&b.velocity) + spin)
}

fn motions(bodies: &[BodyState; SLOTS]) -> [BodyMotion; SLOTS] {
    let mut out = [BodyMotion::REST; SLOTS];
    for (out, b) in out.iter_mut().zip(bodies) {
        let rotation = rotation(&b.orientation);
        out.place(rotation, b.position, b.velocity, rotation * b.angular_velocity);
    }
    out
}

fn six(p: &Pair) -> Six {
    [p.0.x, p.0.y, p.0.z, p.1.x, p.1.y, p.1.z]
}

fn pair(x: &Six) -> Pair {
    (Vector3::new(x[0], x[1], x[2]), Vector3::new(x[3], x[4], x[5]))
}
