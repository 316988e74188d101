//! Regressor and limits at one instant of a motion, and their derivatives with respect to position, velocity and
//! acceleration.

use nalgebra::DMatrix;

use super::limits::{LIMITS, Limits};
use super::series::{Basis, INPUTS, moved};
use crate::dynamics::{Plant, PlantParameter, Sample as MotionSample, regressor, steady_socket_loads};
use crate::effects::{ActiveEffect, Entry, Role};
use crate::identification::fit::nominal_size;
use crate::identification::{Dataset, columns};
use crate::kinematics::{JointState, KinematicsError, PlatformState};
use crate::machine::{PerAxis, Setup, every_axis};
use crate::model::Model;
use crate::numerics::parallel;
use crate::recording::Channel;

/// Steps of the finite differences by position (m, rad), velocity and acceleration.
///
/// They are small relative to the width of friction laws (10 mrad/s); the regressor is affine in accelerations.
const STEPS: [f64; 3] = [1e-5, 1e-5, 1e-3];
/// Factor on the steepness of friction laws in the search: their steps at reversals would fall between the samples.
const SOFTER: f64 = 0.1;
/// Name of a friction law's steepness parameter.
const STEEPNESS: &str = "steepness";

/// Machine whose parameters are to be identified.
pub struct Machine {
    plant: Plant,
    effects: Vec<ActiveEffect>,
    limits: Limits,
    /// Standard deviations of the torque samples, N·m.
    noise: PerAxis<f64>,
    /// Base columns as indices of the flat parameters, and the parameters' own sizes.
    columns: Vec<usize>,
    sizes: Vec<f64>,
    /// Effects that are not in the machine; their columns follow the base columns.
    candidates: Vec<Candidate>,
}

/// Effect that the machine may have.
struct Candidate {
    active: ActiveEffect,
    /// Its linear parameters with their own sizes.
    linear: Vec<(usize, f64)>,
}

/// Regressor and limits at one instant.
pub struct Sample {
    /// Base columns of the regressor in units of noise and parameter sizes.
    pub rows: DMatrix<f64>,
    /// Normalised limits; none may exceed 1.
    pub limits: [f64; LIMITS],
}

/// Derivatives at one instant with respect to its twelve inputs.
pub struct Slopes {
    /// Derivative of the objective.
    pub objective: [f64; INPUTS],
    /// Derivative of each limit.
    pub limits: [[f64; INPUTS]; LIMITS],
}

impl Machine {
    /// The machine of `model` without payload; with `soft`, friction laws are softened for the search.
    ///
    /// Its columns are all parameters that enter forces and inertia linearly; [`Machine::with_columns`] selects among
    /// them.
    pub fn new(model: &Model, limits: Limits, soft: bool) -> Self {
        let mut plant = Plant::new(model, &Setup::default());
        if soft {
            for active in &mut plant.effects {
                for (k, entry) in active.entries().iter().enumerate() {
                    if entry.parameter.name == STEEPNESS {
                        active.values[k] *= SOFTER;
                    }
                }
            }
        }
        let effects: Vec<ActiveEffect> =
            std::iter::once(plant.rigid_bodies()).chain(plant.effects.iter().cloned()).collect();
        let whole: Vec<bool> = effects
            .iter()
            .flat_map(|a| vec![a.effect.kind().acts_on_the_whole() || !a.effect.spec().identifiable; a.values.len()])
            .collect();
        let parameters = plant.parameters();
        let columns: Vec<usize> = parameters.linear().into_iter().filter(|&k| !whole[k]).collect();
        Self {
            limits,
            noise: model.noise.torque.map(|s| if s > 0.0 { s } else { 1.0 }),
            sizes: columns.iter().map(|&k| nominal_size(&parameters[k])).collect(),
            columns,
            effects,
            plant,
            candidates: Vec::new(),
        }
    }

    /// Adds the columns of effects that are not in the machine, as they are at one instant.
    pub fn with_candidates(mut self, candidates: &[ActiveEffect]) -> Self {
        let one = |active: &ActiveEffect| {
            let entries = active.entries().into_iter().zip(&active.values).enumerate();
            let linear = entries.filter(|(_, (e, _))| e.parameter.role == Role::Linear);
            let size = |(k, (e, v)): (usize, (Entry, &f64))| (k, v.abs().max(e.parameter.default.abs()).max(1e-9));
            Candidate { linear: linear.map(size).collect(), active: active.clone() }
        };
        self.candidates = candidates.iter().map(one).collect();
        self
    }

    /// Columns and sizes of each candidate: (column, present value in units of the column).
    pub fn candidates(&self) -> Vec<Vec<(usize, f64)>> {
        let mut column = self.columns.len();
        let mut next = |active: &ActiveEffect, (k, size): &(usize, f64)| {
            column += 1;
            (column - 1, active.values[*k] / size)
        };
        self.candidates.iter().map(|c| c.linear.iter().map(|l| next(&c.active, l)).collect()).collect()
    }

    /// Keeps the columns `kept` only, indices among the present ones.
    pub fn with_columns(mut self, kept: &[usize]) -> Self {
        self.columns = kept.iter().map(|&k| self.columns[k]).collect();
        self.sizes = kept.iter().map(|&k| self.sizes[k]).collect();
        self
    }

    /// The plant used in computations.
    pub fn plant(&self) -> &Plant {
        &self.plant
    }

    /// Limits of the motion.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// Own sizes of the parameters of the columns, in their units.
    pub fn sizes(&self) -> &[f64] {
        &self.sizes
    }

    /// Parameters of the columns.
    pub fn parameters(&self) -> Vec<PlantParameter> {
        let all = self.plant.parameters();
        self.columns.iter().map(|&k| all[k].clone()).collect()
    }

    /// Regressor and limits at a platform state.
    ///
    /// # Errors
    /// The error of the kinematics if the pose is unreachable, or of a force law that gives no finite value.
    pub fn sample(&self, platform: &PlatformState) -> Result<Sample, KinematicsError> {
        let joints = self.plant.geometry.inverse_motion(platform)?;
        let motion = self.plant.motion(&joints)?;
        let mut own = vec![self.effects[0].initial_state()];
        own.extend(self.plant.steady_states(0.0, &motion));
        let states: Vec<&[f64]> = own.iter().map(Vec::as_slice).collect();
        let loads = steady_socket_loads(&self.plant, 0.0, &motion)?;
        let effects: Vec<&ActiveEffect> = self.effects.iter().collect();
        let all = regressor(
            &self.plant,
            &effects,
            &MotionSample { t: 0.0, motion: &motion, loads: &loads.output },
            &states,
            &Channel::TORQUES,
        )?;
        let extra = self.candidate_columns(&joints)?;
        let own = self.columns.len();
        let rows = DMatrix::from_fn(every_axis().len(), own + extra.len(), |i, j| match j.checked_sub(own) {
            None => all[(i, self.columns[j])] * self.sizes[j] / self.noise[i],
            Some(k) => extra[k][i] / self.noise[i],
        });
        let limits = self.limits.values(&self.plant.geometry, platform, &joints, (&motion, &loads));
        if rows.iter().chain(&limits).any(|x| !x.is_finite()) {
            return Err(KinematicsError::Singular { q: joints.q.into() });
        }
        Ok(Sample { rows, limits })
    }

    /// Columns of the candidates at an instant, in units of their sizes.
    fn candidate_columns(&self, joints: &JointState) -> Result<Vec<PerAxis<f64>>, KinematicsError> {
        if self.candidates.is_empty() {
            return Ok(Vec::new());
        }
        let instant =
            Dataset::exact(self.plant.mechanism, Setup::default(), Channel::TORQUES.to_vec(), 1.0, vec![*joints]);
        let mut out = Vec::new();
        for candidate in &self.candidates {
            let all = columns(&self.plant, &instant, Some(&candidate.active))?;
            let column = |&(k, size): &(usize, f64)| std::array::from_fn(|i| all[k][i][0] * size);
            out.extend(candidate.linear.iter().map(column));
        }
        Ok(out)
    }

    /// Samples at all instants of the motion `x`; `None` if a pose is unreachable.
    pub fn samples(&self, basis: &Basis, x: &[f64]) -> Option<Vec<Sample>> {
        parallel::map(basis.len(), |k| self.sample(&basis.state(k, x)).ok()).into_iter().collect()
    }

    /// Derivatives at every instant of the motion `x`, with `weights[k]` the derivative of the objective with respect
    /// to the rows of sample k.
    ///
    /// Position and velocity: central differences of the instant's regressor; acceleration: a forward difference,
    /// which is exact because everything is affine in it. The chain to the decision variables is exact, see
    /// [`Basis::pull_back`].
    pub fn slopes(
        &self,
        basis: &Basis,
        x: &[f64],
        samples: &[Sample],
        weights: &[DMatrix<f64>],
    ) -> Option<Vec<Slopes>> {
        let at = |k: usize| {
            let state = basis.state(k, x);
            let mut slopes = Slopes { objective: [0.0; INPUTS], limits: [[0.0; INPUTS]; LIMITS] };
            for i in 0..INPUTS {
                let step = STEPS[i % 3];
                let ahead = self.sample(&moved(&state, i, step)).ok()?;
                let behind = match i % 3 {
                    2 => None,
                    _ => Some(self.sample(&moved(&state, i, -step)).ok()?),
                };
                let (back, width) = behind.as_ref().map_or((&samples[k], step), |b| (b, 2.0 * step));
                slopes.objective[i] = (weights[k].dot(&ahead.rows) - weights[k].dot(&back.rows)) / width;
                for (slope, (a, b)) in slopes.limits.iter_mut().zip(ahead.limits.iter().zip(&back.limits)) {
                    slope[i] = (a - b) / width;
                }
            }
            Some(slopes)
        };
        parallel::map(basis.len(), at).into_iter().collect()
    }
}

/// Information per sample of the columns.
pub fn information(samples: &[Sample]) -> DMatrix<f64> {
    let n = samples.first().map_or(0, |s| s.rows.ncols());
    let mut sum = DMatrix::zeros(n, n);
    for sample in samples {
        sum.gemm_tr(1.0, &sample.rows, &sample.rows, 1.0);
    }
    sum / samples.len().max(1) as f64
}

/// Largest value of each limit along the samples.
pub fn worst(samples: &[Sample]) -> [f64; LIMITS] {
    let mut worst = [f64::NEG_INFINITY; LIMITS];
    for sample in samples {
        for (w, value) in worst.iter_mut().zip(sample.limits) {
            *w = w.max(value);
        }
    }
    worst
}
