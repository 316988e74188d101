//! Consistent parameters of least cost, for an estimate with an inconsistent body or with a value outside the range of
//! its law.

use nalgebra::{DMatrix, DVector};

use super::regression::Regression;
use super::{Consistency, Correction, Work};
use crate::dynamics::PlantParameter;
use crate::effects::{Param, payload};
use crate::identification::consistency::{BodyClass, Cost, Owner, classes, cones, log_cholesky};
use crate::machine::bodies::END_EFFECTOR;

/// Cost of consistency above which it is not due to noise: five standard errors of one parameter.
const NOTABLE_COST: f64 = 12.5;
/// Largest relative gap at which the result of the convex programme is accepted.
const MAX_GAP: f64 = 1e-5;
/// Prior information on a mass without influence on the torques, per own size squared: known to 20 %.
const SILENT_MASS: f64 = 25.0;

/// Consistent values nearest to an estimate.
pub(super) struct Possible {
    /// The estimated parameters, then the masses without a parameter.
    pub values: DVector<f64>,
    /// The same of the consistent machine before the fit.
    pub before: DVector<f64>,
    /// Kinds of bodies described by the values.
    pub classes: Vec<BodyClass>,
    pub correction: Option<Correction>,
    /// Constraint forces, see [`super::Fit::edges`].
    pub edges: Vec<Vec<(Param, f64)>>,
}

impl Regression<'_> {
    /// Consistent values nearest to `estimated`, with the `curvature` of the cost as metric.
    pub fn possible(&self, estimated: &[PlantParameter], curvature: &DMatrix<f64>) -> Possible {
        let cost = self.cost_of_leaving(estimated, curvature);
        let (values, correction) = match cost.allows(&cost.centre) {
            true => (cost.centre, None),
            false => self.corrected(&cost),
        };
        let mut possible =
            Possible { values, before: cost.start, classes: cost.classes, correction, edges: Vec::new() };
        if correction.is_some_and(|c| c.cost > NOTABLE_COST) {
            possible.edges = self.edges(estimated, &possible, curvature);
        }
        possible
    }

    /// Values of least `cost`.
    fn corrected(&self, cost: &Cost) -> (DVector<f64>, Option<Correction>) {
        let convex = match self.consistency {
            Consistency::Cones => cones::minimise(cost).filter(|c| c.gap <= MAX_GAP * cost.of(&c.x)),
            Consistency::LogCholesky => None,
        };
        self.count(Work { corrections: convex.as_ref().map_or(0, |c| c.iterations), ..Work::default() });
        let gap = convex.as_ref().map(|c| c.gap / cost.of(&c.x));
        let values = convex.map_or_else(|| log_cholesky::minimise(cost), |c| c.x);
        let cost = cost.of(&values);
        (values, Some(Correction { cost, gap }))
    }

    /// Cost of a deviation from the estimate, with the constraints on bodies and ranges.
    fn cost_of_leaving(&self, estimated: &[PlantParameter], curvature: &DMatrix<f64>) -> Cost {
        let rigid = self.before.rigid_bodies();
        // The links as in the model file, without contributions of effects and a stated payload; and these alone.
        let links = &self.before.links;
        let mut carried = self.before.bodies.clone();
        carried[END_EFFECTOR] += links[END_EFFECTOR] * -1.0;
        let mut owners = vec![Owner { first: 0, effect: &rigid, bodies: links }];
        let mut first = rigid.values.len();
        for effect in &self.before.effects {
            if effect.effect.name() == payload::NAME {
                owners.push(Owner { first, effect, bodies: &carried });
            }
            first += effect.values.len();
        }
        let (classes, masses) = classes(&owners, &self.free);
        let (n, m) = (self.free.len(), masses.len());
        let extended =
            |own: &dyn Fn(usize) -> f64| DVector::from_fn(n + m, |i, _| if i < n { own(i) } else { masses[i - n] });
        let size = extended(&|i| self.size[i]);
        Cost {
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
        }
    }

    /// Parameters at active constraints with the forces of these constraints.
    ///
    /// At the least cost H·(p − p_free) = Σ λ·n over the active constraints (Karush–Kuhn–Tucker conditions). No two of
    /// them share a parameter: the constraint of a kind of body involves its parameters only, that of a range a single
    /// one.
    fn edges(&self, free: &[PlantParameter], possible: &Possible, curvature: &DMatrix<f64>) -> Vec<Vec<(Param, f64)>> {
        /// Constraint force, relative to the largest, below which it is a residue of the iteration.
        const RESIDUE: f64 = 1e-3;
        let pull = curvature * DVector::from_fn(free.len(), |i, _| possible.values[i] - free[i].value);
        let scaled = |i: usize| (pull[i] * self.size[i]).abs();
        let largest = (0..free.len()).map(scaled).fold(0.0, f64::max);
        let mut owners: Vec<Vec<usize>> = possible.classes.iter().map(BodyClass::variables).collect();
        let alone = |i: &usize| !owners.iter().any(|o| o.contains(i));
        let ranges: Vec<Vec<usize>> = (0..free.len()).filter(alone).map(|i| vec![i]).collect();
        owners.extend(ranges);
        let fixed = |owned: &Vec<usize>| -> Vec<(Param, f64)> {
            let pulled = owned.iter().filter(|&&i| i < free.len() && scaled(i) > RESIDUE * largest);
            pulled.map(|&i| (free[i].param, pull[i])).collect()
        };
        owners.iter().map(fixed).filter(|edge| !edge.is_empty()).collect()
    }
}
