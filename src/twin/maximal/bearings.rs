//! Bodies in bearings only: arms and rotor of a disassembled robot, or a single axis.
//!
//! M·a + Gᵀ·λ = W, G·a = γ with five rows and six velocities per body; the bodies are decoupled.

use nalgebra::{SMatrix, SVector, UnitQuaternion};

use super::rows::{BODY, ROW, Rows, bearing_block};
use super::{Added, Pair, Solution, momentum, motions, pair, six, spatial, velocity_products};
use crate::dynamics::Plant;
use crate::kinematics::{BodyMotion, SocketSet};
use crate::machine::bodies::{ARM, BODIES, ROTOR, SLOTS};
use crate::machine::{ARMS, STRUTS};
use crate::twin::SingularPose;
use crate::twin::constraints::ROWS;
use crate::twin::state::BodyState;

/// Number of rows of a bearing; with the six velocities of the body, the size of the equations of one axis follows.
const BEARING: usize = 5;
const SIZE: usize = 6 + BEARING;

/// Violation below which a row counts as satisfied, m or 1.
const CLOSED: f64 = 1e-13;
const MAX_PROJECTIONS: usize = 12;

/// Solver for bodies in bearings.
pub(in crate::twin) struct Bearings {
    rows: Rows,
    solution: Solution,
}

impl Bearings {
    /// A solver with an empty workspace.
    pub fn new() -> Self {
        Self { rows: Rows::new(), solution: Solution::NONE }
    }

    /// Accelerations and multipliers, see [`MaximalCoordinates::solve`](super::MaximalCoordinates::solve).
    pub fn solve(
        &mut self,
        plant: &Plant,
        bodies: &[BodyMotion; SLOTS],
        wrenches: &[Pair; SLOTS],
        damping: Option<&[Added; BODIES]>,
    ) -> Result<&Solution, SingularPose> {
        let gravity = plant.gravity_vector();
        self.rows.fill(&plant.geometry, &lengths(plant), bodies, SocketSet::ALL);
        let gamma = self.rows.gamma;
        self.each(plant, bodies, damping, &gamma, |b| {
            let (force, moment) = velocity_products(&plant.bodies[b], &bodies[b], &gravity);
            (wrenches[b].0 - force, wrenches[b].1 - moment)
        })
    }

    /// Projects onto the rows, see [`MaximalCoordinates::project`](super::MaximalCoordinates::project).
    pub fn project(&mut self, plant: &Plant, bodies: &mut [BodyState; BODIES]) -> Result<usize, SingularPose> {
        for corrections in 0..MAX_PROJECTIONS {
            let motion = motions(bodies);
            self.rows.fill(&plant.geometry, &lengths(plant), &motion, SocketSet::ALL);
            let values = self.rows.values;
            let violation = |b: usize| (0..BEARING).map(move |k| values[ROW[first_block(b) + k]].abs());
            if axes(plant).flat_map(violation).all(|c| c < CLOSED) {
                let still = [0.0; ROWS];
                let solution = self.each(plant, &motion, None, &still, |b| momentum(&plant.bodies[b], &motion[b]))?;
                for b in axes(plant) {
                    bodies[b].velocity = solution.bodies[b].0;
                    bodies[b].angular_velocity = motion[b].rotation.tr_mul(&solution.bodies[b].1);
                }
                return Ok(corrections);
            }
            let back = self.rows.values.map(|c| -c);
            let nothing = Pair::default();
            let solution = self.each(plant, &motion, None, &back, |_| nothing)?;
            for b in axes(plant) {
                let (shift, turn) = solution.bodies[b];
                bodies[b].position += shift;
                let old = UnitQuaternion::new_normalize(bodies[b].orientation);
                bodies[b].orientation = *(UnitQuaternion::from_scaled_axis(turn) * old);
            }
        }
        Err(SingularPose)
    }

    /// Solves the equations of every body for its load and γ.
    fn each(
        &mut self,
        plant: &Plant,
        bodies: &[BodyMotion; SLOTS],
        damping: Option<&[Added; BODIES]>,
        gamma: &[f64; ROWS],
        load: impl Fn(usize) -> Pair,
    ) -> Result<&Solution, SingularPose> {
        for b in axes(plant) {
            let mass = spatial(&plant.bodies[b], &bodies[b].rotation, damping.map(|d| &d[b]));
            let mut matrix = SMatrix::<f64, SIZE, SIZE>::zeros();
            let mut right = SVector::<f64, SIZE>::zeros();
            for (i, w) in six(&load(b)).into_iter().enumerate() {
                right[i] = w;
                for j in 0..6 {
                    matrix[(i, j)] = mass[i][j];
                }
            }
            for k in 0..BEARING {
                let block = first_block(b) + k;
                right[6 + k] = gamma[ROW[block]];
                for (j, g) in self.rows.blocks[block].into_iter().enumerate() {
                    matrix[(6 + k, j)] = g;
                    matrix[(j, 6 + k)] = g;
                }
            }
            let x = matrix.full_piv_lu().solve(&right).ok_or(SingularPose)?;
            if !x.iter().all(|x| x.is_finite()) {
                return Err(SingularPose);
            }
            self.solution.bodies[b] = pair(&std::array::from_fn(|i| x[i]));
            for k in 0..BEARING {
                self.solution.multipliers[ROW[first_block(b) + k]] = x[6 + k];
            }
        }
        Ok(&self.solution)
    }
}

/// Bodies of the machine's axes.
fn axes(plant: &Plant) -> impl Iterator<Item = usize> + use<> {
    (0..plant.mechanism.axes()).map(|axis| if axis < ARMS { ARM + axis } else { ROTOR })
}

fn first_block(body: usize) -> usize {
    if body == ROTOR { BODY[ROTOR] } else { bearing_block(body - ARM) }
}

fn lengths(plant: &Plant) -> [f64; STRUTS] {
    std::array::from_fn(|s| plant.geometry.strut_length(s))
}
