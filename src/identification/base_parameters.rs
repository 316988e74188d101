//! Base parameters: the combinations of parameters that the data determine [Gautier 1990].
//!
//! A QR factorisation of the weighted regressor with column pivoting reveals its rank; singular values confirm it.
//! Dependent columns D are combinations of the independent ones I: Y_D = Y_I·K with R₁₁·K = R₁₂, so β = p_I + K·p_D.

use nalgebra::{DMatrix, DVector};

use crate::dynamics::PlantParameter;
use crate::machine::Unit;

/// One identifiable combination of parameters.
#[derive(Clone, Debug)]
pub struct BaseParameter {
    /// Name of the leading parameter.
    pub name: String,
    /// Unit of the leading parameter.
    pub unit: Unit,
    /// Value of the combination, in its unit.
    pub value: f64,
    /// Standard error, in its unit.
    pub std: f64,
    /// Factors of the other parameters in the combination.
    pub others: Vec<(String, f64)>,
}

impl BaseParameter {
    /// The combination in readable form, e.g. `platform_mass + 1·telescope_lower_mass`.
    pub fn combination(&self) -> String {
        let mut text = self.name.clone();
        for (name, factor) in &self.others {
            let sign = if *factor < 0.0 { '−' } else { '+' };
            text.push_str(&format!(" {sign} {:.4}·{name}", factor.abs()));
        }
        text
    }
}

/// Rank structure of a regressor.
#[derive(Clone, Debug)]
pub struct Structure {
    /// Independent columns.
    pub independent: Vec<usize>,
    /// Dependent columns.
    pub dependent: Vec<usize>,
    /// K in Y_D = Y_I·K, parameters in units of their own sizes.
    pub carried: DMatrix<f64>,
    /// Singular values of the weighted regressor over all samples, parameters in units of their own sizes, in
    /// descending order.
    pub singular_values: DVector<f64>,
    /// Number of linearly independent columns up to rounding.
    pub rank: usize,
}

/// Ratio to the largest singular value below which a singular value counts as zero.
const ROUNDING: f64 = 1e-10;
/// Ratio to the leading parameter's size below which a factor is omitted from the printed combination.
const NEGLIGIBLE: f64 = 1e-6;

impl Structure {
    /// Structure of a regressor given its weighted `rows` at every `stride`-th sample; columns are in units of
    /// `size`.
    ///
    /// Columns whose independent part has less than `least` information (1/variance) count as dependent.
    pub fn new(rows: &[Vec<f64>], stride: usize, size: &DVector<f64>, least: f64) -> Self {
        let n = size.len();
        let root = (stride as f64).sqrt();
        let y = DMatrix::from_fn(rows.len().max(n), n, |i, j| rows.get(i).map_or(0.0, |r| r[j] * size[j] * root));
        let factored = y.col_piv_qr();
        let mut order = DMatrix::from_fn(1, n, |_, j| j as f64);
        factored.p().permute_columns(&mut order);
        let order: Vec<usize> = order.iter().map(|j| *j as usize).collect();
        let r = factored.r();
        let mut singular_values = r.clone().singular_values();
        singular_values.as_mut_slice().sort_by(|a, b| b.total_cmp(a));
        let rounding = ROUNDING * singular_values.amax();
        let rank = singular_values.iter().filter(|s| **s > rounding).count();
        let floor = least.sqrt().max(rounding);
        let kept = (0..n).take_while(|&i| r[(i, i)].abs() > floor).count();
        let head = r.view((0, 0), (kept, kept)).into_owned();
        let tail = r.view((0, kept), (kept, n - kept)).into_owned();
        let solved = head.solve_upper_triangular(&tail).unwrap_or_else(|| DMatrix::zeros(kept, n - kept));
        // In the order of the parameters.
        let mut places: Vec<usize> = (0..kept).collect();
        places.sort_by_key(|&i| order[i]);
        let carried = DMatrix::from_fn(kept, n - kept, |i, j| solved[(places[i], j)]);
        Self {
            independent: places.iter().map(|&i| order[i]).collect(),
            dependent: order[kept..].to_vec(),
            carried,
            singular_values,
            rank,
        }
    }

    /// Ratio of the largest to the smallest non-zero singular value: the condition number of Y_B.
    pub fn condition(&self) -> f64 {
        match self.rank {
            0 => f64::INFINITY,
            r => self.singular_values[0] / self.singular_values[r - 1],
        }
    }

    /// The base parameters with their standard errors.
    pub fn base_parameters(
        &self,
        parameters: &[PlantParameter],
        size: &DVector<f64>,
        covariance: &DMatrix<f64>,
    ) -> Vec<BaseParameter> {
        let combination = |(i, &lead): (usize, &usize)| {
            let mut weights = DVector::zeros(parameters.len());
            weights[lead] = 1.0;
            let mut others = Vec::new();
            for (j, &d) in self.dependent.iter().enumerate() {
                if self.carried[(i, j)].abs() > NEGLIGIBLE {
                    weights[d] = self.carried[(i, j)] * size[lead] / size[d];
                    others.push((parameters[d].name.clone(), weights[d]));
                }
            }
            BaseParameter {
                name: parameters[lead].name.clone(),
                unit: parameters[lead].unit,
                value: weights.iter().zip(parameters).map(|(w, p)| w * p.value).sum(),
                std: weights.dot(&(covariance * &weights)).max(0.0).sqrt(),
                others,
            }
        };
        self.independent.iter().enumerate().map(combination).collect()
    }
}

/// Independent columns in the order of their parameters, by a pivoted Cholesky factorisation that stops at pivots of
/// `least`, or of 10⁻¹² of the largest.
pub fn independent(information: &DMatrix<f64>, least: f64) -> Vec<usize> {
    let mut schur = information.clone();
    let mut left: Vec<usize> = (0..schur.nrows()).collect();
    let mut chosen = Vec::new();
    let floor = least.max(if schur.is_empty() { 0.0 } else { 1e-12 * schur.diagonal().amax() });
    while let Some(at) = (0..left.len()).max_by(|&a, &b| {
        let pivot = |i: usize| schur[(left[i], left[i])];
        pivot(a).total_cmp(&pivot(b))
    }) {
        let pivot = left[at];
        let d = schur[(pivot, pivot)];
        if d.is_nan() || d <= floor {
            break;
        }
        chosen.push(pivot);
        left.remove(at);
        let column = schur.column(pivot).into_owned();
        schur -= &column * column.transpose() / d;
    }
    chosen.sort_unstable();
    chosen
}
