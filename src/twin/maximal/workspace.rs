//! The equations at one pose: masses and rows factored, solved and refined.

use super::factor::{Root, Six, add, dot};
use super::flexible::{self, Eliminated};
use super::rows::Rows;
use super::schur::Schur;
use super::structure::{MAX_ROWS, Structure};
use super::{Added, Solution, Stretch, inertia, pair, spatial};
use crate::dynamics::Plant;
use crate::kinematics::{BodyMotion, SocketSet};
use crate::machine::bodies::{END_EFFECTOR, SLOTS};
use crate::machine::{PerStrut, each};
use crate::numerics::worst;
use crate::twin::SingularPose;

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

/// Steps to the prestress, each of which leaves a ratio of [`TIKHONOV`] to the least other eigenvalue.
const KERNEL_STEPS: usize = 3;
/// Ratio whose multiples have no common period.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// Rows, masses and factors at one pose, and the solution there.
pub(super) struct Workspace {
    pub(super) structure: Structure,
    pub(super) rows: Rows,
    mass: [[Six; 6]; SLOTS],
    roots: [Root; SLOTS],
    /// L⁻¹·Gᵀ block row by block row.
    y: Vec<Six>,
    /// The same matrix component by component.
    y_columns: [Vec<f64>; 6],
    schur: Schur,
    /// Weights r of the inertia shifts.
    shifts: Vec<f64>,
    /// Loss of rank of S while all sockets are closed and the struts are rigid.
    pub(super) redundant: usize,
    /// Orthonormal basis of the multipliers with Gᵀ·λ = 0, at such a pose: prestress.
    kernel: Vec<[f64; MAX_ROWS]>,
    /// Whether M or S was regularised, which requires refinement until the equations hold.
    pub(super) regularised: bool,
    accelerations: [Six; SLOTS],
    /// Elastic struts; empty if they are rigid.
    struts: Vec<Eliminated>,
    closed: SocketSet,
    pub(super) solution: Solution,
}

impl Workspace {
    /// An empty workspace for the joints of a machine.
    pub fn new(plant: &Plant) -> Self {
        let structure = Structure::new(plant);
        let blocks = structure.row.len();
        let plate = plant.assembled && !plant.geometry.has_platform_of_three();
        Self {
            rows: Rows::new(&structure),
            mass: [[[0.0; 6]; 6]; SLOTS],
            roots: [Root::ONE; SLOTS],
            y: vec![[0.0; 6]; blocks],
            y_columns: std::array::from_fn(|_| vec![0.0; blocks]),
            schur: Schur::new(&structure),
            shifts: vec![0.0; structure.shifts.len()],
            redundant: if plate { plant.geometry.redundant_struts() } else { 0 },
            kernel: Vec::new(),
            regularised: false,
            accelerations: [[0.0; 6]; SLOTS],
            struts: Vec::new(),
            closed: SocketSet::ALL,
            solution: Solution::NONE,
            structure,
        }
    }

    /// Computes rows, masses and factors at a pose.
    pub fn prepare(
        &mut self,
        plant: &Plant,
        bodies: &[BodyMotion; SLOTS],
        closed: SocketSet,
        damping: Option<&[Added; SLOTS]>,
        stretches: Option<&[Stretch]>,
    ) -> Result<(), SingularPose> {
        let Self { structure, rows, .. } = self;
        let mut lengths: PerStrut<f64> = each(0.0);
        for (s, length) in lengths.iter_mut().enumerate().take(structure.struts) {
            *length = stretches.map_or_else(|| plant.geometry.strut_length(s), |all| all[s].length());
        }
        rows.fill(structure, &plant.geometry, &lengths, bodies, closed);
        self.regularised = false;
        self.closed = closed;
        let total: f64 = plant.bodies.0.iter().map(|i| i.mass).sum();
        for &b in &self.structure.bodies {
            self.mass[b] = spatial(&inertia(plant, b, stretches), &bodies[b].rotation, damping.map(|d| &d[b]));
        }
        self.struts.clear();
        if let Some(all) = stretches {
            let Self { structure, mass, rows, struts, .. } = self;
            flexible::eliminate(all, (structure, bodies, closed), mass, rows, struts);
        }
        for k in 0..self.structure.bodies.len() {
            let b = self.structure.bodies[k];
            if b != END_EFFECTOR || self.shifts.is_empty() {
                self.root(b, total)?;
            }
        }
        self.shift(total)?;
        for &b in &self.structure.bodies {
            for k in self.structure.blocks[b].clone() {
                let y = self.roots[b].lower(&self.rows.blocks[k]);
                self.y[k] = y;
                for (column, y) in self.y_columns.iter_mut().zip(y) {
                    column[k] = y;
                }
            }
        }
        let mut factor = |tikhonov: f64| self.schur.factor(&self.y_columns, closed, &self.struts, tikhonov);
        let regular = self.redundant == 0 || stretches.is_some() || closed != plant.sockets();
        if !(regular && factor(0.0)) {
            self.regularised = true;
            if !factor(TIKHONOV) {
                return Err(SingularPose);
            }
        }
        self.find_kernel(if regular { 0 } else { self.redundant });
        Ok(())
    }

    /// Determines the prestress: S·v = 0 by v := (S + τ·D)⁻¹·τ·D·v.
    fn find_kernel(&mut self, count: usize) {
        self.kernel.clear();
        for k in 0..count {
            // Any start with a part in every combination.
            let mut v: [f64; MAX_ROWS] = std::array::from_fn(|i| (((i + 1) * (k + 1)) as f64 * GOLDEN).fract() - 0.5);
            v.iter_mut().enumerate().filter(|(row, _)| !self.structure.row.contains(row)).for_each(|(_, x)| *x = 0.0);
            for _ in 0..KERNEL_STEPS {
                self.schur.weigh(&mut v);
                self.schur.solve(&mut v);
                self.consistent(&mut v);
                let size = v.iter().map(|x| x * x).sum::<f64>().sqrt();
                v.iter_mut().for_each(|x| *x /= size);
            }
            self.kernel.push(v);
        }
    }

    /// Removes the inconsistent part of values of the rows. Redundant rows agree on the constraints only, which the stages of
    /// a step leave.
    fn consistent(&self, rows: &mut [f64; MAX_ROWS]) {
        for n in &self.kernel {
            let along: f64 = n.iter().zip(&*rows).map(|(n, x)| n * x).sum();
            rows.iter_mut().zip(n).for_each(|(x, n)| *x -= along * n);
        }
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
    fn shift(&mut self, total: f64) -> Result<(), SingularPose> {
        for (k, s) in self.structure.shifts.iter().enumerate() {
            let from = self.rows.blocks[s.from];
            let y = self.roots[s.donor].lower(&from);
            self.shifts[k] = s.share / dot(&y, &y);
            let to = self.rows.blocks[s.to];
            for j in 0..6 {
                add(&mut self.mass[s.donor][j], -self.shifts[k] * from[j], &from);
                add(&mut self.mass[END_EFFECTOR][j], self.shifts[k] * to[j], &to);
            }
        }
        for k in 0..self.structure.shifted.len() {
            self.root(self.structure.shifted[k], total)?;
        }
        Ok(())
    }

    /// Solves the factored equations for given W, γ and forces on the elongations.
    pub fn equations(
        &mut self,
        loads: &[Six; SLOTS],
        gamma: &[f64; MAX_ROWS],
        demand: &PerStrut<f64>,
    ) -> Result<&Solution, SingularPose> {
        let (mut w, mut gamma) = (*loads, *gamma);
        flexible::load(&self.struts, demand, (&self.structure, self.closed), &mut w, &mut gamma);
        self.consistent(&mut gamma);
        let gamma = &gamma;
        for (s, r) in self.structure.shifts.iter().zip(&self.shifts) {
            add(&mut w[s.donor], -r * gamma[self.structure.row[s.from]], &self.rows.blocks[s.from]);
        }
        self.accelerations = [[0.0; 6]; SLOTS];
        self.solution.multipliers = [0.0; MAX_ROWS];
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
        for (s, r) in self.structure.shifts.iter().zip(&self.shifts) {
            let along = dot(&self.rows.blocks[s.to], &self.accelerations[END_EFFECTOR]);
            self.solution.multipliers[self.structure.row[s.to]] += r * along;
        }
        flexible::rates(&self.struts, demand, &self.structure, &self.accelerations, &mut self.solution);
        for (out, a) in self.solution.bodies.iter_mut().zip(&self.accelerations) {
            *out = pair(a);
        }
        Ok(&self.solution)
    }

    /// Adds the solution of the factored equations to accelerations and multipliers.
    fn correct(&mut self, w: &[Six; SLOTS], gamma: &[f64; MAX_ROWS]) {
        let Self { structure, roots, y, .. } = self;
        let mut lambda = gamma.map(|x| -x);
        let mut z = [[0.0; 6]; SLOTS];
        for &b in &structure.bodies {
            z[b] = roots[b].lower(&w[b]);
            for k in structure.blocks[b].clone() {
                lambda[structure.row[k]] += dot(&y[k], &z[b]);
            }
        }
        self.schur.solve(&mut lambda);
        for &b in &structure.bodies {
            for k in structure.blocks[b].clone() {
                add(&mut z[b], -lambda[structure.row[k]], &y[k]);
            }
            add(&mut self.accelerations[b], 1.0, &roots[b].upper(&z[b]));
        }
        for (sum, x) in self.solution.multipliers.iter_mut().zip(&lambda) {
            *sum += x;
        }
    }

    /// W − M·a − Gᵀ·λ and γ − G·a, each with its magnitude relative to the largest terms of its kind.
    fn residuals(&self, w: &[Six; SLOTS], gamma: &[f64; MAX_ROWS]) -> (([Six; SLOTS], f64), ([f64; MAX_ROWS], f64)) {
        let structure = &self.structure;
        let (mut loads, mut rows) = (*w, *gamma);
        // Forces, moments, rows.
        let (mut terms, mut sizes) = ([f64::MIN_POSITIVE; 3], [0f64; 3]);
        for &b in &structure.bodies {
            let a = &self.accelerations[b];
            // Blocks consist of unit vectors and levers, so that terms of a row are as large as the accelerations; their sum may
            // vanish in every row.
            terms[2] = a.iter().fold(terms[2], |most, x| most.max(x.abs()));
            for k in 0..6 {
                let x = dot(&self.mass[b][k], a);
                loads[b][k] -= x;
                terms[k / 3] = terms[k / 3].max(x.abs()).max(w[b][k].abs());
            }
            for k in structure.blocks[b].clone() {
                let (row, block) = (structure.row[k], &self.rows.blocks[k]);
                rows[row] -= dot(block, a);
                add(&mut loads[b], -self.solution.multipliers[row], block);
            }
        }
        flexible::give(&self.struts, &self.solution.multipliers, structure, &mut rows);
        self.consistent(&mut rows);
        for load in structure.bodies.iter().map(|&b| &loads[b]) {
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
