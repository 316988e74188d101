//! The mechanism in absolute coordinates with any set of open ball sockets: M·a + Gᵀ·λ = W, G·a = γ.
//!
//! Fourteen bodies with 84 velocities (of each frame origin, and angular, inertial axes) and 74 rows, three fewer per
//! open socket. Used after a dislocation, and to verify the closed-form elimination in `closed`, with which it shares
//! the inertia parameters only.
//!
//! M is block diagonal, so that S = G·M⁻¹·Gᵀ couples only joints of the same body; it is factored along the branches of
//! the mechanism. The end effector may have no inertia of its own (M singular). Inertia is therefore shifted to it from
//! platform and telescope, *exactly*: for a row g_E·a_E + g_D·a_D = γ and any r,
//!
//! M_E + r·g_Eᵀg_E, M_D − r·g_Dᵀg_D, W_D − r·g_Dᵀγ give the same a, and λ = λ′ + r·g_E·a_E.
//!
//! With r at most half of the donor's inertia along g_D both stay positive definite. Any other body with singular
//! inertia (a point mass, a bar) is lent a millionth of the mechanism's, which iterative refinement removes again. If S
//! has lost rank (redundant rows in a degenerate pose) it is regularised and refined as well; a is then unique, λ is
//! not. The result is [`SingularPose`] if refinement does not reach 1e-9 of the terms of either equation, or if an
//! inertia is not physically consistent.

mod added;
mod bearings;
mod factor;
mod flexible;
mod rows;
mod schur;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

pub use self::added::Added;
pub(super) use self::bearings::Bearings;
use self::factor::{Root, Six, add, dot};
use self::flexible::Eliminated;
pub(super) use self::flexible::{Stretch, Stretches};
use self::rows::*;
use self::schur::Schur;
use super::SingularPose;
use super::constraints::ROWS;
use super::state::{BodyState, rotation};
use crate::dynamics::Plant;
use crate::kinematics::motion::MAX_SOCKETS;
use crate::kinematics::{BodyMotion, Reactions, SocketSet};
use crate::machine::bodies::{BODIES, END_EFFECTOR, PLATFORM, SLOTS, STRUT, TELESCOPE_LOWER};
use crate::machine::{Bodies, Inertia, STRUTS};
use crate::numerics::worst;

/// Two vectors (inertial axes) at a body's origin: velocity and angular velocity, their derivatives, or force and
/// moment.
pub type Pair = (Vector3<f64>, Vector3<f64>);

/// Accelerations (or velocities after an impulse) and multipliers.
#[derive(Clone, Debug)]
pub struct Solution {
    /// Acceleration of the origin (m/s²) and angular acceleration (rad/s²) of every body, inertial axes.
    pub bodies: [Pair; SLOTS],
    /// Multiplier λ of every row in the order of [`rows`](super::constraints::rows), N or N·m; zero at open sockets.
    /// Joint forces are −Gᵀ·λ.
    pub multipliers: [f64; ROWS],
    /// ë of elastic struts, m/s², or the corresponding changes in a projection; zero for rigid ones.
    pub(super) stretches: [f64; STRUTS],
}

impl Solution {
    const NONE: Self = {
        const NOTHING: Pair = (Vector3::new(0., 0., 0.), Vector3::new(0., 0., 0.));
        Self { bodies: [NOTHING; SLOTS], multipliers: [0.0; ROWS], stretches: [0.0; STRUTS] }
    };
}

/// Solver with its workspace; nothing is allocated after [`MaximalCoordinates::new`].
pub struct MaximalCoordinates(Box<Workspace>);

struct Workspace {
    rows: Rows,
    mass: [[Six; 6]; BODIES],
    roots: [Root; BODIES],
    /// L⁻¹·Gᵀ block row by block row.
    y: [Six; BLOCK_ROWS],
    /// The same matrix component by component.
    y_columns: [[f64; BLOCK_ROWS]; 6],
    schur: Schur,
    /// Weights r of the inertia shifts.
    shifts: [f64; SHIFTS.len()],
    /// Whether M or S was regularised, which requires refinement until the equations hold.
    regularised: bool,
    accelerations: [Six; BODIES],
    struts: [Eliminated; STRUTS],
    closed: SocketSet,
    solution: Solution,
}

/// Donor, and the block rows of one row on donor and end effector.
struct Shift {
    donor: usize,
    from: usize,
    to: usize,
}

/// Five shifts along the pivot's rows from the platform, one about the lower Hooke joint's normal from the telescope.
const SHIFTS: [Shift; 6] = {
    let (p, e) = (PIVOT_ON_PLATFORM, PIVOT_ON_END_EFFECTOR);
    [
        Shift { donor: PLATFORM, from: p, to: e },
        Shift { donor: PLATFORM, from: p + 1, to: e + 1 },
        Shift { donor: PLATFORM, from: p + 2, to: e + 2 },
        Shift { donor: PLATFORM, from: p + 3, to: e + 3 },
        Shift { donor: PLATFORM, from: p + 4, to: e + 4 },
        Shift { donor: TELESCOPE_LOWER, from: LOWER_HOOKE_ON_LOWER + 3, to: LOWER_HOOKE_ON_END_EFFECTOR + 3 },
    ]
};
/// Fraction of the donor's inertia shifted along each row: the platform donates along five rows, for which 1/(2·5) each
/// is safe.
const PLATFORM_SHARE: f64 = 0.1;
const TELESCOPE_SHARE: f64 = 0.5;

/// Inertia lent to a body without inertia, relative to the mechanism's mass and, for rotation, with a lever of 0.1 m.
const LENT: f64 = 1e-6;
const LENT_LEVER: f64 = 0.1;
/// Relative regularisation of S if it has lost rank.
const TIKHONOV: f64 = 1e-9;
/// Residuals, relative to the largest term of their equation, at which refinement stops and above which a pose is
/// singular.
const REFINED: f64 = 1e-13;
const ACCEPTED: f64 = 1e-9;
const MAX_REFINEMENTS: usize = 8;

/// Violation below which a row counts as satisfied, m or 1.
const CLOSED: f64 = 1e-13;
const MAX_PROJECTIONS: usize = 12;

impl Default for MaximalCoordinates {
    fn default() -> Self {
        Self::new()
    }
}

/// Terms of the equations besides rigid bodies.
#[derive(Clone, Copy, Default)]
pub(super) struct Extra<'a> {
    /// Addition to the blocks of the mass matrix.
    pub damping: Option<&'a [Added; BODIES]>,
    /// Elastic struts; `None` if they are rigid.
    pub stretches: Option<&'a Stretches>,
}

impl MaximalCoordinates {
    /// A solver with an empty workspace.
    pub fn new() -> Self {
        Self(Box::new(Workspace {
            rows: Rows::new(),
            mass: [[[0.0; 6]; 6]; BODIES],
            roots: [Root::ONE; BODIES],
            y: [[0.0; 6]; BLOCK_ROWS],
            y_columns: [[0.0; BLOCK_ROWS]; 6],
            schur: Schur::new(),
            shifts: [0.0; SHIFTS.len()],
            regularised: false,
            accelerations: [[0.0; 6]; BODIES],
            struts: [Eliminated::RIGID; STRUTS],
            closed: SocketSet::ALL,
            solution: Solution::NONE,
        }))
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
        damping: Option<&[Added; BODIES]>,
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
        let mut demand = [0.0; STRUTS];
        for (s, stretch) in stretches.into_iter().flatten().enumerate() {
            let b = &bodies[STRUT + s];
            add(&mut loads[STRUT + s], -1.0, &six(&stretch.coriolis(b)));
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
        self.0.equations(&loads, &[0.0; ROWS], &[0.0; STRUTS])
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
        bodies: &mut [BodyState; BODIES],
        closed: SocketSet,
    ) -> Result<usize, SingularPose> {
        self.project_elastic(plant, bodies, closed, None)
    }

    /// [`Self::project`] with elastic struts, including their elongations and elongation rates.
    pub(super) fn project_elastic(
        &mut self,
        plant: &Plant,
        bodies: &mut [BodyState; BODIES],
        closed: SocketSet,
        mut stretches: Option<&mut Stretches>,
    ) -> Result<usize, SingularPose> {
        let work = &mut *self.0;
        for corrections in 0..MAX_PROJECTIONS {
            let motion = motions(bodies);
            let now = stretches.as_deref();
            work.prepare(plant, &motion, closed, None, now)?;
            if work.rows.values.iter().all(|c| c.abs() < CLOSED) {
                let mut loads = std::array::from_fn(|b| six(&momentum(&inertia(plant, b, now), &motion[b])));
                let mut demand = [0.0; STRUTS];
                for (s, stretch) in now.into_iter().flatten().enumerate() {
                    let b = &motion[STRUT + s];
                    add(&mut loads[STRUT + s], 1.0, &six(&(stretch.carried(b), Vector3::zeros())));
                    demand[s] = stretch.momentum(b);
                }
                let solution = work.equations(&loads, &[0.0; ROWS], &demand)?;
                for (b, body) in bodies.iter_mut().enumerate() {
                    body.velocity = solution.bodies[b].0;
                    body.angular_velocity = motion[b].rotation.tr_mul(&solution.bodies[b].1);
                }
                for (s, stretch) in stretches.into_iter().flatten().enumerate() {
                    stretch.rate = solution.stretches[s];
                }
                return Ok(corrections);
            }
            let back = work.rows.values.map(|c| -c);
            let solution = work.equations(&[[0.0; 6]; BODIES], &back, &[0.0; STRUTS])?;
            for (body, (shift, turn)) in bodies.iter_mut().zip(&solution.bodies) {
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
    pub fn socket_forces(&self) -> [Vector3<f64>; MAX_SOCKETS] {
        let lambda = &self.0.solution.multipliers;
        let mut out = [Vector3::zeros(); MAX_SOCKETS];
        for (k, force) in out.iter_mut().enumerate().take(2 * STRUTS) {
            *force = -Vector3::from_fn(|i, _| lambda[socket(k) + i]);
        }
        out
    }

    /// Axial strut forces from the last solution, tension positive, N; `bodies` as passed to it.
    pub fn axial_forces(&self, bodies: &[BodyMotion; SLOTS]) -> Reactions {
        let forces = self.socket_forces();
        let along = |s: usize, k: usize| bodies[STRUT + s].rotation.column(0).dot(&forces[k]);
        let upper: [f64; STRUTS] = std::array::from_fn(|s| -along(s, s));
        Reactions::of(&upper, &std::array::from_fn::<_, STRUTS, _>(|s| along(s, STRUTS + s)))
    }

    /// −Gᵀ·λ of one joint on one body.
    #[cfg(test)]
    fn wrench(&self, block: usize, n: usize) -> Pair {
        let mut sum = [0.0; 6];
        for k in block..block + n {
            add(&mut sum, -self.0.solution.multipliers[ROW[k]], &self.0.rows.blocks[k]);
        }
        pair(&sum)
    }
}

/// Inertia of body `b`; of an elastic strut at its present length.
fn inertia(plant: &Plant, b: usize, stretches: Option<&Stretches>) -> Inertia {
    match stretches {
        Some(all) if (STRUT..PLATFORM).contains(&b) => all[b - STRUT].inertia(),
        _ => plant.bodies[b],
    }
}

impl Workspace {
    /// Computes rows, masses and factors at a pose.
    fn prepare(
        &mut self,
        plant: &Plant,
        bodies: &[BodyMotion; SLOTS],
        closed: SocketSet,
        damping: Option<&[Added; BODIES]>,
        stretches: Option<&Stretches>,
    ) -> Result<(), SingularPose> {
        let rigid = |s: usize| plant.geometry.strut_length(s);
        let lengths = std::array::from_fn(|s| stretches.map_or(rigid(s), |all| all[s].length()));
        self.rows.fill(&plant.geometry, &lengths, bodies, closed);
        self.regularised = false;
        self.closed = closed;
        let total: f64 = plant.bodies.0.iter().map(|i| i.mass).sum();
        for b in 0..BODIES {
            self.mass[b] = spatial(&inertia(plant, b, stretches), &bodies[b].rotation, damping.map(|d| &d[b]));
        }
        self.struts = stretches.map_or([Eliminated::RIGID; STRUTS], |all| {
            flexible::eliminate(all, bodies, closed, &mut self.mass, &mut self.rows)
        });
        for b in 0..BODIES {
            if b != END_EFFECTOR {
                self.root(b, total)?;
            }
        }
        self.shift();
        for b in [PLATFORM, END_EFFECTOR, TELESCOPE_LOWER] {
            self.root(b, total)?;
        }
        for b in 0..BODIES {
            for k in BODY[b]..BODY[b + 1] {
                let y = self.roots[b].lower(&self.rows.blocks[k]);
                self.y[k] = y;
                for (column, y) in self.y_columns.iter_mut().zip(y) {
                    column[k] = y;
                }
            }
        }
        if !self.schur.factor(&self.y_columns, closed, &self.struts, 0.0) {
            self.regularised = true;
            if !self.schur.factor(&self.y_columns, closed, &self.struts, TIKHONOV) {
                return Err(SingularPose);
            }
        }
        Ok(())
    }

    /// Factors the mass matrix of a body, lending inertia if it is singular.
    fn root(&mut self, b: usize, total: f64) -> Result<(), SingularPose> {
        if let Some(root) = Root::new(&self.mass[b]) {
            self.roots[b] = root;
            return Ok(());
        }
        self.regularised = true;
        let mut lent = self.mass[b];
        for k in 0..6 {
            lent[k][k] += LENT * total * if k < 3 { 1.0 } else { LENT_LEVER * LENT_LEVER };
        }
        self.roots[b] = Root::new(&lent).ok_or(SingularPose)?;
        Ok(())
    }

    /// Shifts inertia from platform and telescope to the end effector.
    fn shift(&mut self) {
        for (k, s) in SHIFTS.iter().enumerate() {
            let from = self.rows.blocks[s.from];
            let y = self.roots[s.donor].lower(&from);
            let share = if s.donor == PLATFORM { PLATFORM_SHARE } else { TELESCOPE_SHARE };
            self.shifts[k] = share / dot(&y, &y);
            let to = self.rows.blocks[s.to];
            for j in 0..6 {
                add(&mut self.mass[s.donor][j], -self.shifts[k] * from[j], &from);
                add(&mut self.mass[END_EFFECTOR][j], self.shifts[k] * to[j], &to);
            }
        }
    }

    /// Solves the factored equations for given W, γ and forces on the elongations.
    fn equations(
        &mut self,
        loads: &[Six; BODIES],
        gamma: &[f64; ROWS],
        demand: &[f64; STRUTS],
    ) -> Result<&Solution, SingularPose> {
        let (mut w, mut gamma) = (*loads, *gamma);
        flexible::load(&self.struts, demand, self.closed, &mut w, &mut gamma);
        let gamma = &gamma;
        for (s, r) in SHIFTS.iter().zip(&self.shifts) {
            add(&mut w[s.donor], -r * gamma[ROW[s.from]], &self.rows.blocks[s.from]);
        }
        self.accelerations = [[0.0; 6]; BODIES];
        self.solution.multipliers = [0.0; ROWS];
        self.correct(&w, gamma);
        let (mut loads_left, mut rows_left) = self.residuals(&w, gamma);
        for _ in 0..MAX_REFINEMENTS {
            if loads_left.1 < REFINED && rows_left.1 < REFINED {
                break;
            }
            let (w_left, gamma_left) = (loads_left.0, rows_left.0);
            self.correct(&w_left, &gamma_left);
            let worst = loads_left.1.max(rows_left.1);
            (loads_left, rows_left) = self.residuals(&w, gamma);
            if !self.regularised && loads_left.1.max(rows_left.1) > 0.5 * worst {
                break; // at rounding
            }
        }
        let holds = loads_left.1 < ACCEPTED && rows_left.1 < ACCEPTED; // false for NaN
        if !holds {
            return Err(SingularPose);
        }
        for (s, r) in SHIFTS.iter().zip(&self.shifts) {
            let along = dot(&self.rows.blocks[s.to], &self.accelerations[END_EFFECTOR]);
            self.solution.multipliers[ROW[s.to]] += r * along;
        }
        self.solution.stretches =
            flexible::rates(&self.struts, demand, &self.accelerations, &self.solution.multipliers);
        for (out, a) in self.solution.bodies.iter_mut().zip(&self.accelerations) {
            *out = pair(a);
        }
        Ok(&self.solution)
    }

    /// Adds the solution of the factored equations to accelerations and multipliers.
    fn correct(&mut self, w: &[Six; BODIES], gamma: &[f64; ROWS]) {
        let mut lambda = gamma.map(|x| -x);
        let mut z = [[0.0; 6]; BODIES];
        for b in 0..BODIES {
            z[b] = self.roots[b].lower(&w[b]);
            for k in BODY[b]..BODY[b + 1] {
                lambda[ROW[k]] += dot(&self.y[k], &z[b]);
            }
        }
        self.schur.solve(&mut lambda);
        for b in 0..BODIES {
            for k in BODY[b]..BODY[b + 1] {
                add(&mut z[b], -lambda[ROW[k]], &self.y[k]);
            }
            add(&mut self.accelerations[b], 1.0, &self.roots[b].upper(&z[b]));
        }
        for (sum, x) in self.solution.multipliers.iter_mut().zip(&lambda) {
            *sum += x;
        }
    }

    /// W − M·a − Gᵀ·λ and γ − G·a, each with its magnitude relative to the largest terms of its kind.
    fn residuals(&self, w: &[Six; BODIES], gamma: &[f64; ROWS]) -> (([Six; BODIES], f64), ([f64; ROWS], f64)) {
        let (mut loads, mut rows) = (*w, *gamma);
        // Forces, moments, rows.
        let (mut terms, mut sizes) = ([f64::MIN_POSITIVE; 3], [0f64; 3]);
        for b in 0..BODIES {
            let a = &self.accelerations[b];
            for k in 0..6 {
                let x = dot(&self.mass[b][k], a);
                loads[b][k] -= x;
                terms[k / 3] = terms[k / 3].max(x.abs()).max(w[b][k].abs());
            }
            for k in BODY[b]..BODY[b + 1] {
                let x = dot(&self.rows.blocks[k], a);
                rows[ROW[k]] -= x;
                terms[2] = terms[2].max(x.abs());
                add(&mut loads[b], -self.solution.multipliers[ROW[k]], &self.rows.blocks[k]);
            }
        }
        flexible::give(&self.struts, &self.solution.multipliers, &mut rows);
        for load in &loads {
            for k in 0..6 {
                sizes[k / 3] = worst(sizes[k / 3], load[k]);
            }
        }
        for (x, g) in rows.iter().zip(gamma) {
            terms[2] = terms[2].max(g.abs());
            sizes[2] = worst(sizes[2], *x);
        }
        let load = worst(sizes[0] / terms[0], sizes[1] / terms[1]);
        ((loads, load), (rows, sizes[2] / terms[2]))
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

fn motions(bodies: &[BodyState; BODIES]) -> [BodyMotion; SLOTS] {
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
