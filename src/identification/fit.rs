//! Weighted least squares with a prior (eqs. 9–11), iterated where parameters enter nonlinearly.
//!
//! The cost is Σ r²/σ² over all samples plus γ·((p − p_reg)/size)² for every parameter. γ is a weak ridge prior: it
//! fixes unidentifiable directions, and shifts an estimate with a standard error of 10 % of its size by 1e-4 of its
//! distance from the prior. If a body of the estimate is physically inconsistent, or an effect's parameter is outside
//! the range of its law, the consistent parameters of least cost are taken instead.

mod answer;
mod error;
mod feasible;
mod gauss_newton;
mod possible;
mod regression;
mod work;

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use self::feasible::Feasible;
use self::regression::Regression;
use super::base_parameters::Structure;
use super::normal_equations::{NormalEquations, UNIT_WEIGHTS};
use super::prediction::KeptColumns;
use super::regularisation::GroupWeight;
use super::{BaseParameter, Dataset, Residuals, check_together};
use crate::dynamics::{PlantParameter, in_configuration};
use crate::effects::{Param, Role};
use crate::evidence::Stop;
use crate::model::Model;

pub use answer::{Correction, Estimate, Moved, Reason, Unidentified};
pub use error::{FitError, kinematics};
pub use regression::nominal_size;
pub use work::Work;

/// Weights of the rows of the regression.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Weighing {
    /// Noise of the channels: W = Σ⁻¹.
    #[default]
    Noise,
    /// Largest measured magnitude of the channels: W = diag(max |τ|)⁻².
    Maximum,
}

/// Method for the consistent parameters of least cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Consistency {
    /// Second-order cone programme, or log-Cholesky where its solver gives no certificate.
    #[default]
    Cones,
    /// Log-Cholesky variables, in which every value is consistent.
    LogCholesky,
}

/// Options of a fit.
#[derive(Clone, Copy, Default)]
pub struct Options<'a> {
    /// Weights of the rows.
    pub weighing: Weighing,
    /// Whether outliers are downweighted (Huber).
    pub robust: bool,
    /// Method for consistent parameters.
    pub consistency: Consistency,
    /// Whether they may be next to the consistent minimum, even where they leave more than the machine before.
    pub is_approximate: bool,
    /// Regularisation values p_reg (eqs. 10–11); `None`: those of the model itself.
    pub prior: Option<&'a Model>,
    /// γ: prior information, per own size of a parameter squared; `None`: [`super::estimator::PRIOR_INFORMATION`].
    pub prior_information: Option<f64>,
    /// Weights γ of eq. 10 that differ from `prior_information`.
    pub weights: &'a [GroupWeight],
    /// Effects whose parameters are held.
    pub fixed: &'a [String],
    /// The datasets of the fit with the columns that the models of several fits share; ignored for other datasets.
    pub kept: Option<&'a [KeptColumns<'a>]>,
    /// Condition that ends the fit with the best parameters so far; at least one step is made.
    pub stop: Option<Stop<'a>>,
}

/// Result of a fit.
#[derive(Clone)]
pub struct Fit {
    /// The model with estimated parameters.
    pub model: Model,
    /// Estimated parameters, in the order of [`Plant::parameters`](crate::dynamics::Plant::parameters) without fixed ones.
    pub parameters: Vec<Estimate>,
    /// Their covariance, with that of directions that the data do not determine.
    pub covariance: DMatrix<f64>,
    /// Base parameters: the combinations that the data determine.
    pub base: Vec<BaseParameter>,
    /// Rank and singular values of the weighted regressor.
    pub structure: Structure,
    /// Parameters that the data do not determine, and why.
    pub unidentified: Vec<Unidentified>,
    /// Parameters whose unconstrained estimate lies outside the permitted range by more than three standard errors
    /// and by more than a fifth of the effect's largest parameter: the law contradicts the data.
    pub impossible: Vec<Param>,
    /// Correction that made the estimate consistent; `None` if it was.
    pub correction: Option<Correction>,
    /// Identified parameters that the correction moved by more than their standard error.
    pub moved: Vec<Moved>,
    /// Constraint forces H·(p − p_free) by parameter, where they exceed noise: one vector for each kind of body and
    /// each range end that is active. Each is normal to its constraint, so no combination of parameters along all
    /// active constraints can absorb a missing effect.
    pub edges: Vec<Vec<(Param, f64)>>,
    /// Residuals of the fitted model.
    pub residuals: Arc<Residuals>,
    /// Work of the fit.
    pub work: Work,
}

/// Share of an effect's largest parameter by which another one may lie outside its range.
const MIN_EXCESS: f64 = 0.2;
/// Number of samples from which nonlinear parameters are first fitted to some pieces.
const MANY_SAMPLES: usize = 10_000;
/// Samples of a piece, and number of such pieces out of which one is taken.
const PIECE: (usize, usize) = (256, 6);

/// Fit of all parameters of `model` to the datasets with default options; `noise[dataset][channel]` are the standard
/// deviations of the channels.
///
/// # Errors
/// As [`fit_with`].
///
/// # Panics
/// If `datasets` is empty.
pub fn fit(model: &Model, datasets: &[Dataset], noise: &[Vec<f64>]) -> Result<Fit, FitError> {
    fit_with(model, datasets, noise, &Options::default())
}

/// Fit of the parameters of `model` to the datasets; `noise[dataset][channel]` are the standard deviations of the
/// channels.
///
/// # Errors
/// [`FitError`], if a recording is too short or has an impossible pose, configurations or channels are mixed, no parameter
/// or an unknown group of parameters is to be estimated, or the normal equations are not finite.
///
/// # Panics
/// If `datasets` is empty.
pub fn fit_with(model: &Model, datasets: &[Dataset], noise: &[Vec<f64>], options: &Options) -> Result<Fit, FitError> {
    check_together(datasets)?;
    let mounted = in_configuration(model, &datasets[0].setup);
    let regression = Regression::new(&mounted, datasets, noise, options)?;
    regression.check_length()?;
    let start = approached(&mounted, datasets, noise, options).unwrap_or(mounted);
    let mut solution = regression.least_squares(start, UNIT_WEIGHTS)?;
    if options.robust || regression.is_clean() {
        solution = regression.reweighted(solution, options.robust)?;
    }
    let estimated = regression.estimated(&solution.model);
    let possible = regression.possible(&estimated, &solution.estimator.curvature());
    let (solution, possible, settled) = regression.settled(solution, possible, options.is_approximate)?;
    let normal = &solution.normal;
    let estimated = regression.estimated(&solution.model);
    let covariance = solution.estimator.covariance(normal, regression.white);
    let structure = Structure::new(&normal.rows, normal.stride, &regression.size, regression.information);
    let base = structure.base_parameters(&estimated, &regression.size, &covariance);
    let said = regression.said(normal, &base, (&estimated, &possible.values), &covariance);
    let impossible = regression.impossible(&estimated, &covariance);
    let Feasible { model: mut fitted, residuals } = settled;
    fitted.assembled = model.assembled;
    Ok(Fit {
        model: fitted,
        parameters: said.parameters,
        covariance,
        base,
        structure,
        unidentified: said.unidentified,
        impossible,
        correction: possible.correction,
        moved: said.moved,
        edges: possible.edges,
        residuals,
        work: regression.work.get(),
    })
}

/// Parameters of least cost over some pieces of long recordings, from which the iteration over all samples needs few steps;
/// `None` where that saves nothing: if all parameters enter linearly, recordings are short, or gears ring longer than a piece
/// runs up.
fn approached(model: &Model, datasets: &[Dataset], noise: &[Vec<f64>], options: &Options) -> Option<Model> {
    let samples: usize = datasets.iter().map(Dataset::len).sum();
    let rings = model.effects.iter().any(|active| active.gear_springs().is_some());
    if samples < MANY_SAMPLES || !is_nonlinear(model) || rings {
        return None;
    }
    let pieces: Vec<Dataset> = datasets.iter().map(|dataset| dataset.sparse(PIECE.0, PIECE.1)).collect();
    let regression = Regression::new(model, &pieces, noise, options).ok()?;
    regression.least_squares(model.clone(), UNIT_WEIGHTS).ok().map(|solution| solution.model)
}

/// Estimates of all parameters, with the undetermined and the moved ones.
#[derive(Default)]
struct Said {
    parameters: Vec<Estimate>,
    unidentified: Vec<Unidentified>,
    moved: Vec<Moved>,
}

impl Regression<'_> {
    /// Fewer values than parameters determine none of them with a standard error.
    fn check_length(&self) -> Result<(), FitError> {
        let needed = self.free.len() / self.datasets[0].channels.len().max(1) + 1;
        let samples = self.datasets.iter().map(Dataset::len).sum();
        if samples > needed {
            return Ok(());
        }
        Err(FitError::TooShort { recording: self.datasets[0].name.clone(), samples, needed: needed + 1 })
    }

    /// The estimated parameters with their values in `model`.
    fn estimated(&self, model: &Model) -> Vec<PlantParameter> {
        let all = self.datasets[0].plant(model).parameters();
        self.free.iter().map(|&k| all[k].clone()).collect()
    }

    /// Determined parameters that lie outside their range by more than three standard errors and by more than the share
    /// [`MIN_EXCESS`] of their effect's largest parameter.
    fn impossible(&self, estimated: &[PlantParameter], covariance: &DMatrix<f64>) -> Vec<Param> {
        // Largest linear parameter of the effect; the sign of one that is nearly zero is arbitrary.
        let largest = |own: &PlantParameter| {
            let same =
                |p: &&PlantParameter| p.param.effect == own.param.effect && p.unit == own.unit && p.role == own.role;
            estimated.iter().filter(same).map(|p| p.value.abs()).fold(0.0, f64::max)
        };
        let outside = |&i: &usize| {
            let (p, margin) = (&estimated[i], 3.0 * covariance[(i, i)].max(0.0).sqrt());
            let beyond = (p.range.0 - p.value).max(p.value - p.range.1);
            margin < 3.0 * self.size[i] && beyond > margin && beyond > MIN_EXCESS * largest(p)
        };
        (0..self.free.len()).filter(outside).map(|i| estimated[i].param).collect()
    }

    /// Estimates of all parameters with the consistent `values`, reasons for the undetermined parameters, and the
    /// parameters that the correction moved by more than their standard error.
    fn said(
        &self,
        normal: &NormalEquations,
        base: &[BaseParameter],
        (estimated, values): (&[PlantParameter], &DVector<f64>),
        covariance: &DMatrix<f64>,
    ) -> Said {
        let mut said = Said::default();
        for (i, p) in estimated.iter().enumerate() {
            let std = covariance[(i, i)].max(0.0).sqrt();
            let known = std < self.size[i];
            let (param, name, unit, value) = (p.param, p.name.clone(), p.unit, values[i]);
            if !known {
                let reason = self.reason(normal, base, p, i, std);
                said.unidentified.push(Unidentified { name: name.clone(), reason });
            } else if (value - p.value).abs() > std {
                said.moved.push(Moved { name: name.clone(), unit, free: p.value, value, std });
            }
            let std = if known { std } else { f64::INFINITY };
            said.parameters.push(Estimate { param, name, unit, value, std, range: p.range });
        }
        said
    }

    /// Reason why the data do not determine parameter `i`, which has the standard error `std`.
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
}

/// Whether any parameter enters the prediction nonlinearly: in itself, or as the factor of another one, as a tilt of the base
/// is of the masses.
pub fn is_nonlinear(model: &Model) -> bool {
    model.effects.iter().any(|a| {
        let reads = a.effect.spec().reads;
        reads.reactions
            || reads.torque
            || reads.inertia
            || a.effect.kind().acts_on_the_whole()
            || a.effect.parameters().iter().any(|p| p.role == Role::Shape)
    })
}
