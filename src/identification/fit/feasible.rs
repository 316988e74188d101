//! Consistent parameters where the linearisation at the free estimate does not reach them.
//!
//! The correction of a free estimate takes the cost for quadratic between both. Where parameters multiply each other, as the
//! factor of a torque sensor and the inertias that the drive moves, a free estimate may lie so far outside the possible that
//! its correction costs more than the machine that the fit began with. Then sequential quadratic programming [Nocedal 2006,
//! ch. 18] begins at that machine: steps to the consistent minimum of the cost linearised there.

use std::sync::Arc;

use nalgebra::DVector;

use super::gauss_newton::{MAX_ITERATIONS, PROGRESS, Solution, TRIALS};
use super::possible::Possible;
use super::regression::Regression;
use super::{Correction, FitError, is_nonlinear};
use crate::identification::Residuals;
use crate::identification::consistency::complete;
use crate::identification::normal_equations::UNIT_WEIGHTS;
use crate::model::Model;

/// Ratio of what a correction adds to the cost to what it promises, from which it is compared with the machine before.
const BROKEN_PROMISE: f64 = 2.0;

/// A machine with consistent parameters and its residuals.
pub(super) struct Feasible {
    pub model: Model,
    pub residuals: Arc<Residuals>,
}

impl Regression<'_> {
    /// The solution with its consistent values and the machine that has them. Where that machine leaves more than the one before
    /// the fit, unless it `is_corrected_once`, all are those of a consistent minimum of the cost, `solution` linearised next to it.
    ///
    /// # Errors
    /// [`FitError`] if the machine cannot be assembled along the recordings, or normal equations are not finite.
    pub fn settled(
        &self,
        solution: Solution,
        possible: Possible,
        is_corrected_once: bool,
    ) -> Result<(Solution, Possible, Feasible), FitError> {
        let (model, stayed) = self.with(&solution.model, &possible, &possible.values);
        let Some(correction) = possible.correction else {
            let residuals =
                if stayed { Arc::clone(&solution.normal.residuals) } else { Arc::new(self.residuals(&model)?) };
            return Ok((solution, possible, Feasible { model, residuals }));
        };
        let corrected = Feasible { residuals: Arc::new(self.residuals(&model)?), model };
        let free = self.cost(&solution.normal.residuals, &self.values(&solution.model), UNIT_WEIGHTS);
        let promised = BROKEN_PROMISE * correction.cost + self.scale(free);
        let is_linear = !is_nonlinear(&corrected.model);
        if is_corrected_once || is_linear || self.cost_of(&corrected) - free < promised {
            return Ok((solution, possible, corrected));
        }
        let before = self.feasible(&solution.model, &possible, &possible.before);
        let Some(mut here) = before.filter(|before| self.cost_of(before) < self.cost_of(&corrected)) else {
            return Ok((solution, possible, corrected));
        };
        let mut x = possible.before.clone();
        let started = Correction { cost: (self.cost_of(&here) - free).max(0.0), ..correction };
        let mut last = (solution, Possible { values: x.clone(), correction: Some(started), ..possible });
        for _ in 0..MAX_ITERATIONS {
            let linearised = self.linearised(here.model.clone(), UNIT_WEIGHTS)?;
            let Some((next, towards, free)) = self.feasible_step(&here, &x, &linearised) else { break };
            let change = self.cost_of(&here) - self.cost_of(&next);
            (here, x) = (next, towards.values.clone());
            last = (free, towards);
            if change < PROGRESS * self.scale(self.cost_of(&here)) || (self.stop)() {
                break;
            }
        }
        Ok((last.0, last.1, here))
    }

    /// A consistent machine of less cost than `here`, which has the values `x`; the values, and the free minimum of the cost
    /// linearised `here`.
    fn feasible_step(
        &self,
        here: &Feasible,
        x: &DVector<f64>,
        linearised: &Solution,
    ) -> Option<(Feasible, Possible, Solution)> {
        let values = x.rows(0, self.free.len()).into_owned();
        TRIALS.iter().find_map(|(damping, length)| {
            let damped = linearised.estimator.damped(*damping);
            let estimator = damped.as_ref().unwrap_or(&linearised.estimator);
            let step = self.step(&linearised.normal, estimator, &values);
            let mut centre = here.model.clone();
            self.set(&mut centre, &(&values + &step));
            let mut towards = self.possible(&self.estimated(&centre), &estimator.curvature());
            towards.values = x + (&towards.values - x) * *length;
            let next = self.feasible(&here.model, &towards, &towards.values)?;
            (self.cost_of(&next) < self.cost_of(here)).then(|| {
                let mut normal = linearised.normal.clone();
                normal.advance(&step);
                (next, towards, Solution { model: centre, normal, estimator: linearised.estimator.clone() })
            })
        })
    }

    /// `None` if the machine with the values `x` cannot be assembled along the recordings.
    fn feasible(&self, model: &Model, possible: &Possible, x: &DVector<f64>) -> Option<Feasible> {
        let (model, _) = self.with(model, possible, x);
        let residuals = Arc::new(self.residuals(&model).ok()?);
        Some(Feasible { model, residuals })
    }

    fn cost_of(&self, machine: &Feasible) -> f64 {
        self.cost(&machine.residuals, &self.values(&machine.model), UNIT_WEIGHTS)
    }

    /// `model` with the values `x`, those of the masses without a parameter included, and whether no such mass changed.
    fn with(&self, model: &Model, possible: &Possible, x: &DVector<f64>) -> (Model, bool) {
        let mut model = model.clone();
        self.set(&mut model, &x.rows(0, self.free.len()).into_owned());
        // The first owner is the links; a payload is not part of the machine.
        let links: Vec<_> = possible.classes.iter().filter(|c| c.owner == 0).cloned().collect();
        let stayed = complete(&links, x, &mut model.bodies);
        (model, stayed)
    }
}
