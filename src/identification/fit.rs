//! Weighted least squares on what the data can tell (eq. 9), iterated where parameters enter nonlinearly.
//!
//! Directions of the parameter space whose standard deviation exceeds ten times the parameters' own size are left where
//! they are: the data say nothing about them. Standard errors come from block sums of the scores, so they stay right
//! when residuals are autocorrelated.

use nalgebra::{DMatrix, DVector};
use thiserror::Error;

use super::filtering::MIN_HALF_WIDTH;
use super::prediction::{Channels, columns, predict};
use super::{BaseParameter, Trace, base_parameters, consistency};
use crate::dynamics::{Plant, PlantParameter, in_configuration, set_parameters};
use crate::effects::Role;
use crate::kinematics::KinematicsError;
use crate::model::Model;

/// Why a fit cannot be made.
#[derive(Debug, Error)]
pub enum FitError {
    /// A measured pose is impossible for the model's geometry.
    #[error("recording {recording}: {source}; is it this robot, in radians, with axes in order?")]
    Kinematics {
        /// Name of the recording.
        recording: String,
        /// What is wrong.
        source: KinematicsError,
    },
    /// The robot was taken apart between recordings: no set of parameters fits both.
    #[error(
        "recordings {first} and {second} are of an assembled and of a disassembled robot, which have different parameters; \
         expected one configuration"
    )]
    Configurations {
        /// Name of a recording.
        first: String,
        /// Name of another one.
        second: String,
    },
    /// Too few samples.
    #[error("recording {recording}: {samples} samples are left after differentiation, at least {needed} are needed")]
    TooShort {
        /// Name of the recording.
        recording: String,
        /// Samples left.
        samples: usize,
        /// Samples needed.
        needed: usize,
    },
    /// The numbers ran away.
    #[error("the least-squares problem has no finite solution")]
    NotFinite,
}

/// A parameter with what the data say about it.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// Printed name.
    pub name: String,
    /// Unit.
    pub unit: &'static str,
    /// Value.
    pub value: f64,
    /// Standard error; infinite where the data cannot tell the parameter alone.
    pub std: f64,
}

/// Result of a fit.
#[derive(Clone)]
pub struct Fit {
    /// The model with estimated parameters.
    pub model: Model,
    /// All estimated parameters, in the order of [`Plant::parameters`] without fixed ones.
    pub parameters: Vec<Estimate>,
    /// The combinations the data determine.
    pub base: Vec<BaseParameter>,
    /// Parameters whose unconstrained estimate lies more than three standard errors outside the allowed range: the law is
    /// not what the data show.
    pub impossible: Vec<String>,
    /// Residual (measured − predicted) per recording and channel.
    pub residuals: Vec<Channels>,
    /// Root mean square residual per channel, over all recordings.
    pub rms: Vec<f64>,
}

const MIN_SAMPLES: usize = 200;
const MAX_ITERATIONS: usize = 8;
/// Fall of the weighted sum of squares, in units of its mean per row, that still counts as progress: a parameter moved by
/// its own standard error changes it by one.
const PROGRESS: f64 = 0.5;
/// Rounds of trimmed least squares on data without encoder noise.
const CLEAN_ROUNDS: usize = 4;
/// Blocks of time for the standard errors.
const BLOCKS: usize = 50;
/// Information (1/variance, in units of the parameters' own size) below which a direction counts as unknown.
const MIN_INFORMATION: f64 = 1e-2;

/// Fits all parameters of `model` to the traces; `noise[trace][channel]` weighs the channels.
pub fn fit(model: &Model, traces: &[Trace], noise: &[Vec<f64>]) -> Result<Fit, FitError> {
    for trace in traces {
        if trace.len() < MIN_SAMPLES {
            return Err(FitError::TooShort {
                recording: trace.name.clone(),
                samples: trace.len(),
                needed: MIN_SAMPLES,
            });
        }
    }
    if let Some(other) = traces.iter().find(|t| t.setup.configuration != traces[0].setup.configuration) {
        let [first, second] = [&traces[0], other].map(|t| t.name.clone());
        return Err(FitError::Configurations { first, second });
    }
    let prior = model;
    let mut model = in_configuration(prior, &traces[0].setup);
    let mut residuals = residuals(&model, traces)?;
    let mut cost = weighted_squares(&residuals, noise);
    let nonlinear = is_nonlinear(&model);
    let rows: usize = traces.iter().map(|t| t.len() * t.channels.len()).sum();
    for _ in 0..MAX_ITERATIONS {
        let system = System::new(&model, traces, noise, &residuals)?;
        let step = system.step();
        let before = cost;
        let mut damping = 1.0;
        loop {
            let mut next = model.clone();
            set_parameters(&mut next, &system.moved(&step, damping));
            let trial = self::residuals(&next, traces)?;
            let trial_cost = weighted_squares(&trial, noise);
            if trial_cost <= cost {
                (model, residuals, cost) = (next, trial, trial_cost);
                break;
            }
            damping *= 0.5;
            if damping < 1e-3 {
                break;
            }
        }
        if !cost.is_finite() {
            return Err(FitError::NotFinite);
        }
        if !nonlinear || before - cost < PROGRESS * cost / rows as f64 {
            break;
        }
    }
    if traces.iter().all(|t| t.half_width.iter().all(|m| *m == MIN_HALF_WIDTH)) {
        // Without encoder noise, what is left are the few samples around reversals that the derivatives blur.
        for _ in 0..CLEAN_ROUNDS {
            let trimmed = trimmed(&residuals);
            let system = System::new(&model, traces, noise, &trimmed)?;
            let mut next = model.clone();
            set_parameters(&mut next, &system.moved(&system.step(), 1.0));
            residuals = self::residuals(&next, traces)?;
            model = next;
        }
    }
    let mut system = System::new(&model, traces, noise, &residuals)?;
    let covariance = system.covariance();
    let base = base_parameters(&system.information, &covariance, &system.free_parameters(), MIN_INFORMATION);
    let impossible = system.impossible(&covariance);
    if (consistency::min_eigenvalue(&model.bodies) < 0.0 || system.out_of_range())
        && let Some(values) = system.consistent(&model, prior, traces)
    {
        set_parameters(&mut model, &values);
        residuals = self::residuals(&model, traces)?;
        for (p, value) in system.parameters.iter_mut().zip(values) {
            p.value = value;
        }
    }
    let known = system.known();
    let parameters = system
        .free
        .iter()
        .enumerate()
        .map(|(i, &k)| Estimate {
            name: system.parameters[k].name.clone(),
            unit: system.parameters[k].unit,
            value: system.parameters[k].value,
            std: if known[i] { covariance[(i, i)].max(0.0).sqrt() } else { f64::INFINITY },
        })
        .collect();
    let rms = channel_rms(&residuals);
    model.assembled = prior.assembled;
    Ok(Fit { model, parameters, base, impossible, residuals, rms })
}

/// Residuals with those beyond three robust standard deviations of their channel marked as missing.
fn trimmed(residuals: &[Channels]) -> Vec<Channels> {
    let trim = |series: &Vec<f64>| {
        let mut magnitude: Vec<f64> = series.iter().map(|r| r.abs()).collect();
        let middle = magnitude.len() / 2;
        let limit = 3.0 * *magnitude.select_nth_unstable_by(middle, f64::total_cmp).1 / 0.6745;
        series.iter().map(|r| if r.abs() > limit { f64::NAN } else { *r }).collect()
    };
    residuals.iter().map(|channels| channels.iter().map(trim).collect()).collect()
}

fn is_nonlinear(model: &Model) -> bool {
    model.effects.iter().any(|a| {
        a.effect.reads_reactions()
            || a.effect.reads_torque()
            || a.effect.kind().acts_on_the_whole()
            || a.effect.parameters().iter().any(|p| p.role == Role::Shape)
    })
}

/// Measured minus predicted for every trace.
pub fn residuals(model: &Model, traces: &[Trace]) -> Result<Vec<Channels>, FitError> {
    traces
        .iter()
        .map(|trace| {
            let predicted = predict(&Plant::new(model, &trace.setup), trace).map_err(kinematics(trace))?;
            let minus = |(m, p): (&Vec<f64>, Vec<f64>)| m.iter().zip(p).map(|(m, p)| m - p).collect();
            Ok(trace.measured.iter().zip(predicted).map(minus).collect())
        })
        .collect()
}

/// Attaches the recording's name to a kinematic error.
pub fn kinematics(trace: &Trace) -> impl Fn(KinematicsError) -> FitError + '_ {
    |source| FitError::Kinematics { recording: trace.name.clone(), source }
}

fn weighted_squares(residuals: &[Channels], noise: &[Vec<f64>]) -> f64 {
    let channel = |(r, s): (&Vec<f64>, &f64)| r.iter().map(|x| x * x).sum::<f64>() / (s * s);
    residuals.iter().zip(noise).flat_map(|(r, s)| r.iter().zip(s)).map(channel).sum()
}

/// Root mean square per channel over several recordings.
pub fn channel_rms(residuals: &[Channels]) -> Vec<f64> {
    let channels = residuals.iter().map(Vec::len).min().unwrap_or(0);
    (0..channels)
        .map(|c| {
            let n: usize = residuals.iter().map(|r| r[c].len()).sum();
            let sum: f64 = residuals.iter().flat_map(|r| &r[c]).map(|x| x * x).sum();
            (sum / n.max(1) as f64).sqrt()
        })
        .collect()
}

/// Normal equations at the present parameters.
struct System {
    parameters: Vec<PlantParameter>,
    /// Indices of the estimated parameters.
    free: Vec<usize>,
    /// Own size of each free parameter.
    scale: DVector<f64>,
    /// YᵀWY of the free parameters.
    information: DMatrix<f64>,
    /// YᵀWr.
    gradient: DVector<f64>,
    /// Block sums of YᵀWr.
    scores: Vec<DVector<f64>>,
}

impl System {
    fn new(model: &Model, traces: &[Trace], noise: &[Vec<f64>], residuals: &[Channels]) -> Result<Self, FitError> {
        let parameters = Plant::new(model, &traces[0].setup).parameters();
        let free: Vec<usize> = (0..parameters.len()).filter(|&k| parameters[k].role != Role::Fixed).collect();
        let n = free.len();
        let mut information = DMatrix::zeros(n, n);
        let mut gradient = DVector::zeros(n);
        let mut scores = Vec::new();
        for ((trace, sigma), residual) in traces.iter().zip(noise).zip(residuals) {
            let all = columns(&Plant::new(model, &trace.setup), trace, None).map_err(kinematics(trace))?;
            let length = trace.len().div_ceil(BLOCKS).max(1);
            for start in (0..trace.len()).step_by(length) {
                let range = start..(start + length).min(trace.len());
                let mut score = DVector::zeros(n);
                for (c, s) in sigma.iter().enumerate() {
                    // Missing residuals (NaN) do not count.
                    let rows: Vec<usize> = range.clone().filter(|&k| !residual[c][k].is_nan()).collect();
                    let block = DMatrix::from_fn(rows.len(), n, |i, j| all[free[j]][c][rows[i]] / s);
                    let r = DVector::from_fn(rows.len(), |i, _| residual[c][rows[i]] / s);
                    information += block.tr_mul(&block);
                    score += block.tr_mul(&r);
                }
                gradient += &score;
                scores.push(score);
            }
        }
        let scale = DVector::from_fn(n, |i, _| own_size(&parameters[free[i]]));
        Ok(Self { parameters, free, scale, information, gradient, scores })
    }

    fn free_parameters(&self) -> Vec<&PlantParameter> {
        self.free.iter().map(|&k| &self.parameters[k]).collect()
    }

    /// Eigenvectors (in scaled parameters) and eigenvalues the data determine.
    fn eigen(&self) -> (DMatrix<f64>, DVector<f64>) {
        let n = self.free.len();
        let scaled = DMatrix::from_fn(n, n, |i, j| self.information[(i, j)] * self.scale[i] * self.scale[j]);
        let eigen = scaled.symmetric_eigen();
        // Rounding of the largest eigenvalue must not pass for information.
        let floor = MIN_INFORMATION.max(1e-13 * eigen.eigenvalues.amax());
        let kept: Vec<usize> = (0..n).filter(|&i| eigen.eigenvalues[i] > floor).collect();
        let vectors = DMatrix::from_fn(n, kept.len(), |r, c| eigen.eigenvectors[(r, kept[c])]);
        (vectors, DVector::from_fn(kept.len(), |i, _| eigen.eigenvalues[kept[i]]))
    }

    /// Applies the pseudo-inverse of the information.
    fn pseudo_inverse(&self) -> DMatrix<f64> {
        let (vectors, values) = self.eigen();
        let scaled = DMatrix::from_fn(vectors.nrows(), vectors.ncols(), |r, c| {
            self.scale[r] * vectors[(r, c)] / values[c].sqrt()
        });
        &scaled * scaled.transpose()
    }

    fn step(&self) -> DVector<f64> {
        self.pseudo_inverse() * &self.gradient
    }

    /// All parameter values after a damped step; shape parameters move by half their value at most.
    fn moved(&self, step: &DVector<f64>, damping: f64) -> Vec<f64> {
        let mut values: Vec<f64> = self.parameters.iter().map(|p| p.value).collect();
        for (i, &k) in self.free.iter().enumerate() {
            let p = &self.parameters[k];
            let mut d = damping * step[i];
            if p.role == Role::Shape {
                d = d.clamp(-0.5 * p.value.abs(), 0.5 * p.value.abs());
                values[k] = (p.value + d).clamp(p.range.0, p.range.1);
            } else {
                values[k] += d;
            }
        }
        values
    }

    /// Names of parameters significantly outside their range.
    fn impossible(&self, covariance: &DMatrix<f64>) -> Vec<String> {
        let known = self.known();
        let outside = |&i: &usize| {
            let p = &self.parameters[self.free[i]];
            let margin = 3.0 * covariance[(i, i)].max(0.0).sqrt();
            known[i] && (p.value < p.range.0 - margin || p.value > p.range.1 + margin)
        };
        (0..self.free.len()).filter(outside).map(|i| self.parameters[self.free[i]].name.clone()).collect()
    }

    /// Whether an effect's parameter has a value its law does not allow, e.g. negative friction.
    fn out_of_range(&self) -> bool {
        self.parameters.iter().any(|p| !(p.range.0..=p.range.1).contains(&p.value))
    }

    /// All parameter values with every body and every effect possible, as near to the estimate as the data demand.
    fn consistent(&self, model: &Model, prior: &Model, traces: &[Trace]) -> Option<Vec<f64>> {
        let free = |all: &[f64]| DVector::from_fn(self.free.len(), |i, _| all[self.free[i]]);
        let mut values: Vec<f64> = self.parameters.iter().map(|p| p.value).collect();
        let before: Vec<f64> = Plant::new(prior, &traces[0].setup).parameters().into_iter().map(|p| p.value).collect();
        let nearest = consistency::nearest_consistent(
            &model.bodies,
            &Plant::new(model, &traces[0].setup).rigid_bodies(),
            &free(&values),
            &free(&before),
            &self.scale,
            &self.information,
            &self.free_parameters().iter().map(|p| p.range).collect::<Vec<_>>(),
        )?;
        for (i, &k) in self.free.iter().enumerate() {
            values[k] = nearest[i];
        }
        Some(values)
    }

    /// H⁺ (Σ s sᵀ) H⁺ over blocks, never below what white noise of the stated size would give.
    fn covariance(&self) -> DMatrix<f64> {
        let inverse = self.pseudo_inverse();
        let n = self.free.len();
        let mut meat = DMatrix::zeros(n, n);
        for s in &self.scores {
            meat += s * s.transpose();
        }
        // Small-sample factor of the block estimate.
        let b = self.scores.len() as f64;
        let robust = &inverse * meat * &inverse * (b / (b - 1.0).max(1.0));
        DMatrix::from_fn(n, n, |i, j| {
            let inflate = |i: usize| {
                if robust[(i, i)] > 0.0 { (inverse[(i, i)] / robust[(i, i)]).sqrt().max(1.0) } else { 1.0 }
            };
            robust[(i, j)] * inflate(i) * inflate(j)
        })
    }

    /// Whether the data determine each free parameter alone.
    fn known(&self) -> Vec<bool> {
        let (vectors, _) = self.eigen();
        (0..self.free.len()).map(|i| 1.0 - vectors.row(i).norm_squared() < 1e-4).collect()
    }
}

/// Size of a parameter for scaling: its value, or the usual magnitude where that is larger.
pub fn own_size(p: &PlantParameter) -> f64 {
    p.value.abs().max(p.usual).max(1e-9)
}
