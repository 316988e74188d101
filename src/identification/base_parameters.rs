//! Base parameters: the combinations of parameters the data determine [Gautier & Khalil 1990].
//!
//! A Cholesky factorisation of the information YᵀWY with pivoting is the rank-revealing QR of the weighted regressor.
//! Independent columns I carry the dependent ones D: Y_D = Y_I·K, so β = p_I + K·p_D.

use nalgebra::DMatrix;

use super::fit::own_size;
use crate::dynamics::PlantParameter;

/// One identifiable combination.
#[derive(Clone, Debug)]
pub struct BaseParameter {
    /// Name of the leading parameter.
    pub name: String,
    /// Unit of the leading parameter.
    pub unit: &'static str,
    /// Value of the combination.
    pub value: f64,
    /// Standard error.
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

/// Factors below this share of the leading parameter's size are left out of the printed combination.
const NEGLIGIBLE: f64 = 1e-6;

/// Base parameters for an information matrix and the covariance of an estimate.
pub fn base_parameters(
    information: &DMatrix<f64>,
    covariance: &DMatrix<f64>,
    parameters: &[&PlantParameter],
    min_information: f64,
) -> Vec<BaseParameter> {
    let n = parameters.len();
    let size: Vec<f64> = parameters.iter().map(|p| own_size(p)).collect();
    let mut schur = DMatrix::from_fn(n, n, |i, j| information[(i, j)] * size[i] * size[j]);
    let floor = min_information.max(1e-12 * schur.diagonal().amax());
    let mut independent: Vec<usize> = Vec::new();
    let mut left: Vec<usize> = (0..n).collect();
    while let Some(at) =
        (0..left.len()).max_by(|&a, &b| schur[(left[a], left[a])].total_cmp(&schur[(left[b], left[b])]))
    {
        let pivot = left[at];
        let d = schur[(pivot, pivot)];
        if d <= floor {
            break;
        }
        independent.push(pivot);
        left.remove(at);
        let column = schur.column(pivot).into_owned();
        schur -= &column * column.transpose() / d;
    }
    independent.sort_unstable();
    let r = independent.len();
    let inner = DMatrix::from_fn(r, r, |i, j| {
        information[(independent[i], independent[j])] * size[independent[i]] * size[independent[j]]
    });
    let Some(factor) = inner.cholesky() else { return Vec::new() };
    let cross = DMatrix::from_fn(r, left.len(), |i, j| {
        information[(independent[i], left[j])] * size[independent[i]] * size[left[j]]
    });
    let k = factor.solve(&cross);
    (0..r)
        .map(|i| {
            let lead = independent[i];
            let mut weights = vec![0.0; n];
            weights[lead] = 1.0;
            let mut others = Vec::new();
            for (j, &d) in left.iter().enumerate() {
                let weight = k[(i, j)] * size[lead] / size[d];
                weights[d] = weight;
                if k[(i, j)].abs() > NEGLIGIBLE {
                    others.push((parameters[d].name.clone(), weight));
                }
            }
            let value = weights.iter().zip(parameters).map(|(w, p)| w * p.value).sum();
            let mut variance = 0.0;
            for a in 0..n {
                for b in 0..n {
                    variance += weights[a] * covariance[(a, b)] * weights[b];
                }
            }
            BaseParameter {
                name: parameters[lead].name.clone(),
                unit: parameters[lead].unit,
                value,
                std: variance.max(0.0).sqrt(),
                others,
            }
        })
        .collect()
}
