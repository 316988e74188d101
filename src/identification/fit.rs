//! Weighted least squares with everyday knowledge (eq. 9–11), iterated where parameters enter nonlinearly.
//!
//! The cost is Σ r²/σ² over all samples plus γ·((p − p_reg)/size)² for every parameter. γ is small: it holds what the data
//! leave open and is not felt by what they determine. If a body of the estimate cannot exist, or an effect has a value its law
//! does not allow, the possible parameters of least cost take its place.

use nalgebra::{DMatrix, DVector};
use thiserror::Error;

use super::base_parameters::Structure;
use super::consistency::{self, Cost, cones, log_cholesky};
use super::estimator::{Estimator, PRIOR_INFORMATION};
use super::filtering::MIN_HALF_WIDTH;
use super::normal_equations::{ALIKE, NormalEquations, Weight};
use super::prediction::{Channels, predict};
use super::regularisation::{self, GroupWeight};
use super::{BaseParameter, Dataset};
use crate::dynamics::{Plant, PlantParameter, in_configuration, set_parameters};
use crate::effects::{Param, Role, payload};
use crate::evidence::{NEVER, Stop};
use crate::kinematics::KinematicsError;
use crate::machine::Unit;
use crate::machine::bodies::END_EFFECTOR;
use crate::model::Model;

/// Why a fit cannot be made.
#[derive(Debug, Error)]
pub enum FitError {
    /// A measured pose is impossible for the model's geometry.
    #[error("recording {recording}: {reason}; is it this robot, in radians, with axes in order?")]
    Kinematics {
        /// Name of the recording.
        recording: String,
        /// What is wrong.
        reason: KinematicsError,
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
    /// Every parameter is fixed.
    #[error("every parameter of the model is held; expected at least one to estimate")]
    NothingToEstimate,
    /// There is nothing a payload could hang at.
    #[error(
        "recording {recording} is of a machine without a flange (a lone axis, or a robot that is taken apart), which carries no \
         payload; expected an assembled delta robot"
    )]
    NoFlange {
        /// Name of the recording.
        recording: String,
    },
    /// A weight γ of something that is not there.
    #[error(
        "no parameter to estimate belongs to {group:?}; expected torque, bodies, friction, a kind of body or an effect: {known}"
    )]
    NoSuchGroup {
        /// What was asked for.
        group: String,
        /// What there is.
        known: String,
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
    pub unit: Unit,
    /// Value.
    pub value: f64,
    /// Standard error; infinite where the data cannot tell the parameter alone.
    pub std: f64,
}

impl Estimate {
    /// Whether the data determine the parameter alone. If not, its value is what it was before.
    pub fn identified(&self) -> bool {
        self.std.is_finite()
    }
}

/// A parameter the data do not determine.
#[derive(Clone, Debug)]
pub struct Unidentified {
    /// Printed name.
    pub name: String,
    /// Why.
    pub reason: Reason,
}

/// Why data do not determine a parameter.
#[derive(Clone, Debug, PartialEq)]
pub enum Reason {
    /// It has no part in any measured channel.
    NotExcited,
    /// It shows only in combination with others.
    OnlyTogether(Vec<String>),
    /// Its standard error, as a share of its own size, is too large.
    Uncertain(f64),
}

impl std::fmt::Display for Reason {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::NotExcited => write!(f, "the motion does not excite it"),
            Self::OnlyTogether(names) => write!(f, "shows only together with {}", names.join(", ")),
            Self::Uncertain(share) => write!(f, "uncertain by {:.0} % of its size", 100.0 * share),
        }
    }
}

/// What the rows of the regression are weighed with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Weighing {
    /// Noise of the channels: W = Σ⁻¹.
    #[default]
    Noise,
    /// Largest measured value of the channels: W = diag(max |τ|)⁻².
    Maximum,
}

/// How the possible parameters of least cost are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Consistency {
    /// Convex programme with second-order cones, and log-Cholesky where its solver proves none.
    #[default]
    Cones,
    /// Log-Cholesky variables, in which every value is possible.
    LogCholesky,
}

/// How a fit is made.
#[derive(Clone, Copy, Default)]
pub struct Options<'a> {
    /// Weights of the rows.
    pub weighing: Weighing,
    /// Whether outliers count less (Huber).
    pub robust: bool,
    /// Way to possible parameters.
    pub consistency: Consistency,
    /// Regularisation values p_reg (eq. 10–11); the model itself if none are given.
    pub prior: Option<&'a Model>,
    /// γ: information of the prior, per own size of a parameter squared; see [`PRIOR_INFORMATION`] for none given.
    pub prior_information: Option<f64>,
    /// Weights γ of eq. 10 that depart from `prior_information`.
    pub weights: &'a [GroupWeight],
    /// Effects whose parameters stay as they are.
    pub fixed: &'a [String],
    /// When to end with the best parameters so far; one step is always made.
    pub stop: Option<Stop<'a>>,
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
    /// Rank and singular values of the weighted regressor.
    pub structure: Structure,
    /// What the data do not determine, and why.
    pub unidentified: Vec<Unidentified>,
    /// Parameters whose unconstrained estimate lies more than three standard errors outside the allowed range, and by more
    /// than a fifth of the effect's largest: the law is not what the data show.
    pub impossible: Vec<Param>,
    /// How the estimate became possible; `None` if it was.
    pub correction: Option<Correction>,
    /// Identified parameters that this moved by more than their standard error.
    pub moved: Vec<Moved>,
    /// The pull of the data out of the possible, H·(p − p_free) by parameter, where it is more than noise: one vector for each
    /// kind of body and each end of a range that holds the estimate. Each is normal to its edge, so no sum of parameters
    /// along all of them can take up what else is missing.
    pub edges: Vec<Vec<(String, f64)>>,
    /// Residual (measured − predicted) per recording and channel.
    pub residuals: Vec<Channels>,
    /// Root mean square residual per channel, over all recordings.
    pub rms: Vec<f64>,
    /// What it cost.
    pub work: Work,
}

/// Work of a fit, in counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Passes over the data in which the columns of all parameters were computed.
    pub regressions: usize,
    /// Passes over the data in which the torques alone were predicted.
    pub predictions: usize,
    /// Iterations, or Newton steps, of the convex programme that found possible parameters; zero where it was not needed.
    pub corrections: usize,
}

impl std::ops::AddAssign for Work {
    fn add_assign(&mut self, other: Self) {
        self.regressions += other.regressions;
        self.predictions += other.predictions;
        self.corrections += other.corrections;
    }
}

/// A parameter that had to leave its unconstrained estimate.
#[derive(Clone, Debug)]
pub struct Moved {
    /// Printed name.
    pub name: String,
    /// Unit.
    pub unit: Unit,
    /// Estimate that no possible machine has.
    pub free: f64,
    /// Value it has now.
    pub value: f64,
    /// Standard error of the estimate.
    pub std: f64,
}

/// The price of possible parameters.
#[derive(Clone, Copy, Debug)]
pub struct Correction {
    /// Rise of the cost ½Σr²/σ² over the impossible estimate.
    pub cost: f64,
    /// Gap between it and the lower bound that the convex programme proves, relative to `cost`; `None` for log-Cholesky.
    pub gap: Option<f64>,
}

/// Share of an effect's largest parameter that one of its others may lie outside its range.
const NEARLY_NOTHING: f64 = 0.2;
const MIN_SAMPLES: usize = 200;
/// Cost of becoming possible beyond which it is no chance: five standard errors of one parameter.
const NOTABLE: f64 = 12.5;
/// Gap, relative to the cost, up to which the convex programme's answer is taken.
const CERTIFIED: f64 = 1e-5;
const MAX_ITERATIONS: usize = 8;
/// Fall of the cost that still counts as progress, in units of the mean cost of a residual if that is above the noise's:
/// a parameter moved by its own standard error changes the cost by about one of them.
const PROGRESS: f64 = 0.01;
/// Rounds of reweighting.
const ROUNDS: usize = 4;
/// Information on a mass that does not enter the torques, per own size squared: weighed to 20 %.
const SILENT_MASS: f64 = 25.0;
/// Residuals beyond this many scatters count less [Huber 1964: 95 % efficient for normal noise].
const HUBER: f64 = 1.345;
/// Residuals beyond this many scatters do not count.
const TRIM: f64 = 3.0;

/// Fits all parameters of `model` to the datasets; `noise[dataset][channel]` weighs the channels.
pub fn fit(model: &Model, datasets: &[Dataset], noise: &[Vec<f64>]) -> Result<Fit, FitError> {
    fit_with(model, datasets, noise, &Options::default())
}

/// Fits the parameters of `model` to the datasets; `noise[dataset][channel]` are the channels' standard deviations.
pub fn fit_with(model: &Model, datasets: &[Dataset], noise: &[Vec<f64>], options: &Options) -> Result<Fit, FitError> {
    for dataset in datasets {
        if dataset.len() < MIN_SAMPLES {
            return Err(FitError::TooShort {
                recording: dataset.name.clone(),
                samples: dataset.len(),
                needed: MIN_SAMPLES,
            });
        }
    }
    if let Some(other) = datasets.iter().find(|t| t.setup.configuration != datasets[0].setup.configuration) {
        let [first, second] = [&datasets[0], other].map(|t| t.name.clone());
        return Err(FitError::Configurations { first, second });
    }
    let assembled = model.assembled;
    let mut model = in_configuration(model, &datasets[0].setup);
    let problem = Regression::new(&model, datasets, noise, options)?;
    let mut work = Work::default();
    let (mut normal, mut estimator) = problem.least_squares(&mut model, ALIKE, &mut work)?;
    // Without encoder noise, what is left are the few samples around reversals that the derivatives blur.
    let clean = datasets.iter().all(|t| t.half_width.iter().all(|m| *m == MIN_HALF_WIDTH));
    if options.robust || clean {
        for _ in 0..ROUNDS {
            if (problem.stop)() {
                break;
            }
            let scale = problem.scatter(&normal.residuals);
            let huber = |c: usize, r: f64| (HUBER * scale[c] / r.abs()).min(1.0);
            let trimmed = |c: usize, r: f64| f64::from(r.abs() <= TRIM * scale[c]);
            let weight: Weight = if options.robust { &huber } else { &trimmed };
            (normal, estimator) = problem.least_squares(&mut model, weight, &mut work)?;
        }
    }
    let mut fit = problem.finish(model, &normal, &estimator, work)?;
    fit.model.assembled = assembled;
    Ok(fit)
}

/// A regression with everything that stays the same while parameters move.
struct Regression<'a> {
    datasets: &'a [Dataset],
    sigma: Vec<Vec<f64>>,
    /// Whether `sigma` is the noise itself.
    white: bool,
    /// Indices of the estimated parameters.
    free: Vec<usize>,
    /// Own size of each estimated parameter.
    size: DVector<f64>,
    /// Regularisation values of the estimated parameters.
    prior: DVector<f64>,
    /// The machine before the fit, a possible one.
    before: Plant,
    /// Its estimated parameters, in the order of `free`.
    parameters: Vec<PlantParameter>,
    information: f64,
    /// γ of each estimated parameter.
    weights: DVector<f64>,
    consistency: Consistency,
    stop: Stop<'a>,
}

impl<'a> Regression<'a> {
    fn new(
        model: &Model,
        datasets: &'a [Dataset],
        noise: &[Vec<f64>],
        options: &Options<'a>,
    ) -> Result<Self, FitError> {
        let setup = &datasets[0].setup;
        let plant = Plant::new(model, setup);
        let parameters = plant.parameters();
        let regularised = options.prior.map_or_else(|| parameters.clone(), |p| Plant::new(p, setup).parameters());
        let free = parameters.free(options.fixed);
        if free.is_empty() {
            return Err(FitError::NothingToEstimate);
        }
        let own: Vec<PlantParameter> = free.iter().map(|&k| parameters[k].clone()).collect();
        let information = options.prior_information.unwrap_or(PRIOR_INFORMATION);
        let samples = datasets.iter().map(Dataset::len).sum();
        let weights = regularisation::weights(&own, information, options.weights, samples)?;
        // The prior may be another model: its parameters are the same by name.
        let known = |k: usize| regularised.named(&parameters[k].name).map_or(&parameters[k], |i| &regularised[i]);
        let sigma = match options.weighing {
            Weighing::Noise => noise.to_vec(),
            Weighing::Maximum => largest(datasets, noise),
        };
        Ok(Self {
            datasets,
            sigma,
            white: options.weighing == Weighing::Noise,
            size: DVector::from_iterator(free.len(), free.iter().map(|&k| nominal_size(known(k)))),
            prior: DVector::from_iterator(free.len(), free.iter().map(|&k| known(k).value)),
            parameters: own,
            before: plant,
            free,
            information,
            weights: DVector::from_vec(weights),
            consistency: options.consistency,
            stop: options.stop.unwrap_or(NEVER),
        })
    }

    fn values(&self, model: &Model) -> DVector<f64> {
        let parameters = Plant::new(model, &self.datasets[0].setup).parameters();
        DVector::from_iterator(self.free.len(), self.free.iter().map(|&k| parameters[k].value))
    }

    fn set(&self, model: &mut Model, values: &DVector<f64>) {
        let mut all: Vec<f64> = Plant::new(model, &self.datasets[0].setup).parameters().values();
        for (i, &k) in self.free.iter().enumerate() {
            all[k] = values[i];
        }
        set_parameters(model, &all);
    }

    /// Cost at the present parameters.
    fn cost(&self, residuals: &[Channels], values: &DVector<f64>, weight: Weight) -> f64 {
        let series =
            |(c, (r, s)): (usize, (&Vec<f64>, &f64))| r.iter().map(|x| weight(c, x / s) * x * x).sum::<f64>() / (s * s);
        let dataset = |(channels, sigma): (&Channels, &Vec<f64>)| -> f64 {
            channels.iter().zip(sigma).enumerate().map(series).sum()
        };
        let data: f64 = residuals.iter().zip(&self.sigma).map(dataset).sum();
        0.5 * data + self.prior_cost(values)
    }

    /// The prior's part of the cost.
    fn prior_cost(&self, values: &DVector<f64>) -> f64 {
        let apart = (values - &self.prior).component_div(&self.size);
        0.5 * apart.component_mul(&apart).dot(&self.weights)
    }

    /// Gauss–Newton from the present parameters of `model` to those of least cost.
    fn least_squares(
        &self,
        model: &mut Model,
        weight: Weight,
        work: &mut Work,
    ) -> Result<(NormalEquations, Estimator), FitError> {
        let solve =
            |normal: &NormalEquations| Estimator::new(normal, &self.size, &self.weights).ok_or(FitError::NotFinite);
        let mut normal = self.pass(model, weight, work)?;
        let mut values = self.values(model);
        let mut estimator = solve(&normal)?;
        if !is_nonlinear(model) {
            let step = estimator.step(&normal, &(&values - &self.prior), &[]);
            self.set(model, &(&values + &step));
            normal.advance(&step);
            normal.residuals = self.predict(model, work)?;
            return Ok((normal, estimator));
        }
        let mut cost = self.cost(&normal.residuals, &values, weight);
        for iteration in 0..MAX_ITERATIONS {
            if iteration > 0 && (self.stop)() {
                break;
            }
            let progress = PROGRESS * self.scale(cost);
            let offset = &values - &self.prior;
            let free = estimator.step(&normal, &offset, &[]);
            let step = estimator.step(&normal, &offset, &self.at_bound(&values, &free));
            if 0.5 * step.dot(&(&normal.information * &step)) < progress {
                break;
            }
            let before = cost;
            let mut damping = 1.0;
            let mut taken = None;
            while damping > 1e-3 {
                let mut next = model.clone();
                let trial = self.moved(&values, &step, damping);
                self.set(&mut next, &trial);
                // Trials need no columns. Where the machine cannot be assembled, the step was too long.
                let there = self.predict(&next, work).ok();
                let trial_cost = there.as_ref().map_or(f64::INFINITY, |there| self.cost(there, &trial, weight));
                if let Some(there) = there.filter(|_| trial_cost <= cost) {
                    let step = &trial - &values;
                    let promised = normal.score.dot(&step) - 0.5 * step.dot(&(&normal.information * &step))
                        + self.prior_cost(&values)
                        - self.prior_cost(&trial);
                    taken = Some((step, promised));
                    normal.residuals = there;
                    (*model, values, cost) = (next, trial, trial_cost);
                    break;
                }
                if iteration > 0 && (self.stop)() {
                    break;
                }
                damping *= 0.25;
            }
            if !cost.is_finite() {
                return Err(FitError::NotFinite);
            }
            let Some((step, promised)) = taken else { break };
            let change = before - cost;
            if (change - promised).abs() < progress {
                // The columns are as good as at the new place.
                normal.advance(&step);
                break;
            }
            if (self.stop)() {
                // The columns are a little old; only the standard errors feel it.
                normal.advance(&step);
                break;
            }
            normal = self.pass(model, weight, work)?;
            estimator = solve(&normal)?;
            if change < progress.max(1e-12 * cost) {
                break;
            }
        }
        Ok((normal, estimator))
    }

    /// Residuals with the columns of all parameters.
    fn pass(&self, model: &Model, weight: Weight, work: &mut Work) -> Result<NormalEquations, FitError> {
        work.regressions += 1;
        NormalEquations::new(model, self.datasets, &self.sigma, &self.free, weight)
    }

    /// Residuals alone.
    fn predict(&self, model: &Model, work: &mut Work) -> Result<Vec<Channels>, FitError> {
        work.predictions += 1;
        residuals(model, self.datasets)
    }

    /// Mean cost of a residual over that of one of the stated noise; one if it is less.
    fn scale(&self, cost: f64) -> f64 {
        let residuals: usize = self.datasets.iter().map(|t| t.len() * t.channels.len()).sum();
        (2.0 * cost / residuals.max(1) as f64).max(1.0)
    }

    /// Shape parameters at a bound that the step would cross.
    fn at_bound(&self, values: &DVector<f64>, step: &DVector<f64>) -> Vec<usize> {
        let crosses = |&i: &usize| {
            let p = &self.parameters[i];
            let out = (values[i] <= p.range.0 && step[i] < 0.0) || (values[i] >= p.range.1 && step[i] > 0.0);
            p.role == Role::Shape && out
        };
        (0..values.len()).filter(crosses).collect()
    }

    /// Values after a damped step; shape parameters move by half their value at most, those that may be zero by half their
    /// usual size if that is more, and stay in range.
    fn moved(&self, values: &DVector<f64>, step: &DVector<f64>, damping: f64) -> DVector<f64> {
        DVector::from_fn(values.len(), |i, _| {
            let p = &self.parameters[i];
            let d = damping * step[i];
            if p.role == Role::Shape {
                let least = if p.range.0 <= 0.0 { p.usual } else { 0.0 };
                let most = 0.5 * values[i].abs().max(least);
                (values[i] + d.clamp(-most, most)).clamp(p.range.0, p.range.1)
            } else {
                values[i] + d
            }
        })
    }

    /// Robust standard deviation of each channel in units of its sigma, over all datasets.
    fn scatter(&self, residuals: &[Channels]) -> Vec<f64> {
        let channels = self.sigma.iter().map(Vec::len).min().unwrap_or(0);
        let one = |c: usize| {
            let scaled = |(r, s): (&Channels, &Vec<f64>)| r[c].iter().map(|x| (x / s[c]).abs()).collect::<Vec<f64>>();
            let mut magnitude: Vec<f64> = residuals.iter().zip(&self.sigma).flat_map(scaled).collect();
            let middle = magnitude.len() / 2;
            (*magnitude.select_nth_unstable_by(middle, f64::total_cmp).1 / 0.6745).max(f64::MIN_POSITIVE)
        };
        (0..channels).map(one).collect()
    }

    /// Turns the estimate into possible parameters with their standard errors.
    fn finish(
        &self,
        mut model: Model,
        normal: &NormalEquations,
        estimator: &Estimator,
        mut work: Work,
    ) -> Result<Fit, FitError> {
        let plant = Plant::new(&model, &self.datasets[0].setup);
        let all = plant.parameters();
        let estimated: Vec<&PlantParameter> = self.free.iter().map(|&k| &all[k]).collect();
        let covariance = estimator.covariance(normal, self.white);
        let structure = Structure::new(&normal.rows, normal.stride, &self.size, self.information);
        // Largest linear parameter of the effect: one of several that is nearly nothing has either sign.
        let largest = |own: &PlantParameter| {
            let same =
                |p: &&&PlantParameter| p.param.effect == own.param.effect && p.unit == own.unit && p.role == own.role;
            estimated.iter().filter(same).map(|p| p.value.abs()).fold(0.0, f64::max)
        };
        let outside = |&i: &usize| {
            let (p, margin) = (estimated[i], 3.0 * covariance[(i, i)].max(0.0).sqrt());
            let beyond = (p.range.0 - p.value).max(p.value - p.range.1);
            margin < 3.0 * self.size[i] && beyond > margin && beyond > NEARLY_NOTHING * largest(p)
        };
        let impossible = (0..self.free.len()).filter(outside).map(|i| estimated[i].param).collect();
        let base = structure.base_parameters(&estimated, &self.size, &covariance);
        let curvature = estimator.curvature();
        let (values, classes, correction) = self.possible(&estimated, &curvature, &mut work);
        let edges = match correction {
            Some(c) if c.cost > NOTABLE => self.edges(&estimated, &values, &curvature, &classes),
            _ => Vec::new(),
        };
        let corrected = correction.is_some();
        self.set(&mut model, &values.rows(0, self.free.len()).into_owned());
        // The payload is no part of the machine.
        let links: Vec<_> = classes.into_iter().filter(|c| !c.bodies.contains(&END_EFFECTOR)).collect();
        consistency::complete(&links, &values, &mut model.bodies);
        let residuals = if corrected { self.predict(&model, &mut work)? } else { normal.residuals.clone() };
        let mut parameters = Vec::new();
        let mut unidentified = Vec::new();
        let mut moved = Vec::new();
        for (i, p) in estimated.iter().enumerate() {
            let std = covariance[(i, i)].max(0.0).sqrt();
            let known = std < self.size[i];
            if !known {
                unidentified.push(Unidentified { name: p.name.clone(), reason: self.reason(normal, &base, p, i, std) });
            } else if (values[i] - p.value).abs() > std {
                moved.push(Moved { name: p.name.clone(), unit: p.unit, free: p.value, value: values[i], std });
            }
            parameters.push(Estimate {
                name: p.name.clone(),
                unit: p.unit,
                value: values[i],
                std: if known { std } else { f64::INFINITY },
            });
        }
        let rms = channel_rms(&residuals);
        Ok(Fit {
            model,
            parameters,
            base,
            structure,
            unidentified,
            impossible,
            correction,
            moved,
            edges,
            residuals,
            rms,
            work,
        })
    }

    /// Parameters that edges of the possible hold, with the pull on them.
    ///
    /// At the least cost H·(p − p_free) = Σ λ·n over the active constraints (Karush, Kuhn & Tucker), and no two of them share
    /// a parameter: that of a kind of body has its parameters only, that of a range its own.
    fn edges(
        &self,
        free: &[&PlantParameter],
        values: &DVector<f64>,
        curvature: &DMatrix<f64>,
        classes: &[consistency::BodyClass],
    ) -> Vec<Vec<(String, f64)>> {
        /// Pull, relative to the largest, that is the end of an iteration.
        const RESIDUE: f64 = 1e-3;
        let pull = curvature * DVector::from_fn(free.len(), |i, _| values[i] - free[i].value);
        let scaled = |i: usize| (pull[i] * self.size[i]).abs();
        let largest = (0..free.len()).map(scaled).fold(0.0, f64::max);
        let mut owners: Vec<Vec<usize>> = classes.iter().map(consistency::BodyClass::variables).collect();
        let alone = |i: &usize| !owners.iter().any(|o| o.contains(i));
        let ranges: Vec<Vec<usize>> = (0..free.len()).filter(alone).map(|i| vec![i]).collect();
        owners.extend(ranges);
        let fixed = |owned: &Vec<usize>| -> Vec<(String, f64)> {
            let pulled = owned.iter().filter(|&&i| i < free.len() && scaled(i) > RESIDUE * largest);
            pulled.map(|&i| (free[i].name.clone(), pull[i])).collect()
        };
        owners.iter().map(fixed).filter(|edge| !edge.is_empty()).collect()
    }

    fn reason(
        &self,
        normal: &NormalEquations,
        base: &[BaseParameter],
        p: &PlantParameter,
        i: usize,
        std: f64,
    ) -> Reason {
        if normal.information[(i, i)] * self.size[i] * self.size[i] < 1.0 {
            return Reason::NotExcited;
        }
        let mut with: Vec<String> = Vec::new();
        for b in base {
            let members = std::iter::once(&b.name).chain(b.others.iter().map(|(n, _)| n));
            if members.clone().any(|n| *n == p.name) {
                with.extend(members.filter(|n| **n != p.name).cloned());
            }
        }
        with.sort_unstable();
        with.dedup();
        if with.is_empty() { Reason::Uncertain(std / self.size[i]) } else { Reason::OnlyTogether(with) }
    }

    /// Possible values nearest to the present ones: the estimated parameters, then masses that no parameter holds.
    fn possible(
        &self,
        estimated: &[&PlantParameter],
        curvature: &DMatrix<f64>,
        work: &mut Work,
    ) -> (DVector<f64>, Vec<consistency::BodyClass>, Option<Correction>) {
        let rigid = self.before.rigid_bodies();
        let mut owners = vec![(0, &rigid)];
        let mut first = rigid.values.len();
        for active in &self.before.effects {
            if active.effect.name() == payload::NAME {
                owners.push((first, active));
            }
            first += active.values.len();
        }
        // The links as the model file has them, without what effects and a stated payload add; of the payload, its own.
        let mut bodies = self.before.links.clone();
        bodies[END_EFFECTOR] = self.before.bodies[END_EFFECTOR];
        let (classes, masses) = consistency::classes(&bodies, &owners, &self.free);
        let (n, m) = (self.free.len(), masses.len());
        let extended =
            |own: &dyn Fn(usize) -> f64| DVector::from_fn(n + m, |i, _| if i < n { own(i) } else { masses[i - n] });
        let size = extended(&|i| self.size[i]);
        let cost = Cost {
            centre: extended(&|i| estimated[i].value),
            start: extended(&|i| self.parameters[i].value),
            curvature: DMatrix::from_fn(n + m, n + m, |i, j| match (i < n, j < n) {
                (true, true) => curvature[(i, j)],
                _ if i == j => SILENT_MASS / (size[i] * size[i]),
                _ => 0.0,
            }),
            range: (0..n + m).map(|i| estimated.get(i).map_or((0.0, f64::INFINITY), |p| p.range)).collect(),
            size,
            classes,
        };
        if cost.allows(&cost.centre) {
            return (cost.centre, cost.classes, None);
        }
        let convex = match self.consistency {
            Consistency::Cones => cones::minimise(&cost).filter(|c| c.gap <= CERTIFIED * cost.of(&c.x)),
            Consistency::LogCholesky => None,
        };
        work.corrections += convex.as_ref().map_or(0, |c| c.iterations);
        let gap = convex.as_ref().map(|c| c.gap / cost.of(&c.x));
        let values = convex.map_or_else(|| log_cholesky::minimise(&cost), |c| c.x);
        let correction = Correction { cost: cost.of(&values), gap };
        (values, cost.classes, Some(correction))
    }
}

/// Largest measured magnitude of every channel, in the proportion that leaves the mean weight of a row.
fn largest(datasets: &[Dataset], noise: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let one = |(dataset, sigma): (&Dataset, &Vec<f64>)| {
        let peak = |m: &Vec<f64>| m.iter().fold(f64::MIN_POSITIVE, |a, b| a.max(b.abs()));
        let peaks: Vec<f64> = dataset.measured.iter().map(peak).collect();
        let ratio: f64 = sigma.iter().zip(&peaks).map(|(s, p)| (s / p).powi(2)).sum::<f64>() / peaks.len() as f64;
        peaks.into_iter().map(|p| p * ratio.sqrt()).collect()
    };
    datasets.iter().zip(noise).map(one).collect()
}

/// Whether some parameter enters the prediction nonlinearly.
pub fn is_nonlinear(model: &Model) -> bool {
    model.effects.iter().any(|a| {
        a.effect.spec().reads.reactions
            || a.effect.spec().reads.torque
            || a.effect.kind().acts_on_the_whole()
            || a.effect.parameters().iter().any(|p| p.role == Role::Shape)
    })
}

/// Measured minus predicted for every dataset.
pub fn residuals(model: &Model, datasets: &[Dataset]) -> Result<Vec<Channels>, FitError> {
    datasets
        .iter()
        .map(|dataset| {
            let predicted = predict(&Plant::new(model, &dataset.setup), dataset).map_err(kinematics(dataset))?;
            let minus = |(m, p): (&Vec<f64>, Vec<f64>)| m.iter().zip(p).map(|(m, p)| m - p).collect();
            Ok(dataset.measured.iter().zip(predicted).map(minus).collect())
        })
        .collect()
}

/// Attaches the recording's name to a kinematic error.
pub fn kinematics(dataset: &Dataset) -> impl Fn(KinematicsError) -> FitError + '_ {
    |reason| FitError::Kinematics { recording: dataset.name.clone(), reason }
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

/// Size of a parameter for scaling: its value, or the usual magnitude where that is larger.
pub fn nominal_size(p: &PlantParameter) -> f64 {
    p.value.abs().max(p.usual).max(1e-9)
}
