//! Consistent parameters where the linearisation at the free estimate does not reach them.
//!
//! The correction of a free estimate takes the cost for quadratic between both. Where parameters multiply each other, as the
//! factor of a torque sensor and the inertias that the drive moves, or a shape enters nonlinearly, as the fixed end of a spring,
//! the corrected machine may cost much more than that promises. Then sequential quadratic programming [Nocedal 2006, ch. 18]
//! goes on from there, or from the machine that the fit began with if that costs less: steps to the consistent minimum of the
//! cost linearised there.

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

/// Ratio of what a correction adds to the cost to what it promises, up to which it is taken.
const BROKEN_PROMISE: f64 = 2.0;
/// Most steps to an approximate minimum.
const FEW_STEPS: usize = 3;

/// A machine with consistent parameters and its residuals.
pub(super) struct Feasible {
    pub model: Model,
    pub residuals: Arc<Residuals>,
}

impl Regression<'_> {
    /// The solution, its consistent values, and the machine that has them. Where the corrected machine leaves more than the
    /// correction promises, steps to the consistent minimum of the cost follow, and `solution` is linearised next to the last one.
    /// For an approximate minimum, few steps begin at the corrected machine and end at the first that keeps the promise; it may
    /// leave more than the machine before the fit. With fewer than two shapes it is the corrected machine.
    ///
    /// # Errors
    /// [`FitError`] if the machine cannot be assembled along the recordings, or normal equations are not finite.
    pub fn settled(
        &self,
        solution: Solution,
        possible: Possible,
        is_approximate: bool,
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
        let is_final = !is_nonlinear(&corrected.model) || is_approximate && !self.has_several_shapes();
        if is_final || self.cost_of(&corrected) - free < promised {
            return Ok((solution, possible, corrected));
        }
        let before = if is_approximate { None } else { self.feasible(&solution.model, &possible, &possible.before) };
        let before = before.filter(|before| self.cost_of(before) < self.cost_of(&corrected));
        let (mut here, mut x) = match before {
            Some(before) => (before, possible.before.clone()),
            None => (corrected, possible.values.clone()),
        };
        let started = Correction { cost: (self.cost_of(&here) - free).max(0.0), ..correction };
        let mut last = (solution, Possible { values: x.clone(), correction: Some(started), ..possible });
        let mut damping = 0;
        let most = if is_approximate { FEW_STEPS } else { MAX_ITERATIONS };
        for _ in 0..most {
            let linearised = self.linearised(here.model.clone(), UNIT_WEIGHTS)?;
            let Some((place, next, towards, around)) = self.feasible_step(&here, &x, &linearised, damping) else {
                break;
            };
            let change = self.cost_of(&here) - self.cost_of(&next);
            damping = place.saturating_sub(1);
            (here, x) = (next, towards.values.clone());
            last = (around, towards);
            let is_kept = is_approximate && self.cost_of(&here) - free < promised;
            if is_kept || change < PROGRESS * self.scale(self.cost_of(&here)) || (self.stop)() {
                break;
            }
        }
        Ok((last.0, last.1, here))
    }

    /// The first trial from `first` on that leads to a consistent machine of less cost than `here`, which has the values `x`: its
    /// place, the machine, its values, and the free minimum of the cost linearised `here`.
    fn feasible_step(
        &self,
        here: &Feasible,
        x: &DVector<f64>,
        linearised: &Solution,
        first: usize,
    ) -> Option<(usize, Feasible, Possible, Solution)> {
        let values = x.rows(0, self.free.len()).into_owned();
        (first..TRIALS.len()).find_map(|place| {
            let estimator = &self.damped(place, &linearised.estimator)?;
            let step = self.step(&linearised.normal, estimator, &values);
            let mut centre = here.model.clone();
            self.set(&mut centre, &(&values + &step));
            let mut towards = self.possible(&self.estimated(&centre), &estimator.curvature());
            towards.values = x + (&towards.values - x) * TRIALS[place].length;
            let next = self.feasible(&here.model, &towards, &towards.values)?;
            (self.cost_of(&next) < self.cost_of(here)).then(|| {
                let mut normal = linearised.normal.clone();
                normal.advance(&step);
                (place, next, towards, Solution { model: centre, normal, estimator: linearised.estimator.clone() })
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
