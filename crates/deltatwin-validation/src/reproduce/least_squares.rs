//! Weighted least squares on a stacked regressor (eq. 9) as in the paper: without prior and consistency constraints.

use nalgebra::{DMatrix, DVector};

use deltatwin::dynamics::PlantParameter;
use deltatwin::effects::Role;
use deltatwin::identification::base_parameters::independent;
use deltatwin::identification::{Dataset, columns};
use deltatwin::kinematics::KinematicsError;
use deltatwin::machine::{PerAxis, every_axis};
use deltatwin::model::Model;

/// Number of blocks of time for the standard errors.
const BLOCKS: usize = 50;

/// Regressor and torques of a recording: one row per axis and sample.
pub struct Stack {
    /// Parameters of the columns.
    pub parameters: Vec<PlantParameter>,
    /// `[column][axis][sample]`, zero where a column does not act.
    columns: Vec<PerAxis<Vec<f64>>>,
    /// `[axis][sample]`, N·m.
    torque: PerAxis<Vec<f64>>,
}

/// Least-squares estimate.
pub struct Solution {
    /// Values; zero for columns that depend on others.
    pub values: Vec<f64>,
    /// Standard errors from sums of the scores over blocks of time, valid for autocorrelated residuals.
    pub std: Vec<f64>,
    /// Columns that were estimated: the base parameters.
    pub base: Vec<usize>,
}

impl Stack {
    /// Regressor of all parameters of `model` that enter linearly.
    ///
    /// # Errors
    /// If a pose is impossible for the model's geometry or a law gives no finite value.
    pub fn new(model: &Model, dataset: &Dataset) -> Result<Self, KinematicsError> {
        let plant = dataset.plant(model);
        let all = columns(&plant, dataset, None)?;
        let (parameters, columns) = plant
            .parameters()
            .into_iter()
            .zip(all)
            .filter(|(p, _)| p.role == Role::Linear)
            .map(|(p, mut column)| (p, std::array::from_fn(|axis| std::mem::take(&mut column[axis]))))
            .unzip();
        Ok(Self { parameters, columns, torque: std::array::from_fn(|axis| dataset.measured[axis].to_vec()) })
    }

    /// Regressor with a separate parameter for every axis on which a column acts, in the order of the axes (eqs.
    /// 46–47), and the axis of each column.
    ///
    /// Without couplings the axes then share no parameter.
    pub fn by_axis(self) -> (Self, Vec<usize>) {
        let samples = self.torque[0].len();
        let (mut parameters, mut columns, mut axes) = (Vec::new(), Vec::new(), Vec::new());
        for axis in every_axis() {
            for (parameter, column) in self.parameters.iter().zip(&self.columns) {
                if column[axis].iter().any(|x| *x != 0.0) {
                    let only = |a: usize| if a == axis { column[a].clone() } else { vec![0.0; samples] };
                    parameters.push(parameter.clone());
                    columns.push(std::array::from_fn(only));
                    axes.push(axis);
                }
            }
        }
        (Self { parameters, columns, torque: self.torque }, axes)
    }

    /// Minimises Σ (residual / scale)², with `scale` per axis in N·m.
    ///
    /// # Panics
    /// Never: the triangular factor of independent columns is invertible.
    pub fn solve(&self, scale: &PerAxis<f64>) -> Solution {
        let (samples, n) = (self.torque[0].len(), self.columns.len());
        let row = |k: usize| (k / samples, k % samples);
        let weighted = |axis: usize, x: f64| x / scale[axis];
        // With columns of unit length the pivots are independent of the units.
        let length: Vec<f64> = self
            .columns
            .iter()
            .map(|c| {
                let squares = |axis: usize| c[axis].iter().map(move |x| weighted(axis, *x).powi(2)).sum::<f64>();
                every_axis().map(squares).sum::<f64>().sqrt().max(f64::MIN_POSITIVE)
            })
            .collect();
        let matrix = DMatrix::from_fn(every_axis().len() * samples, n, |k, j| {
            let (axis, sample) = row(k);
            weighted(axis, self.columns[j][axis][sample]) / length[j]
        });
        let torque = DVector::from_fn(every_axis().len() * samples, |k, _| {
            let (axis, sample) = row(k);
            weighted(axis, self.torque[axis][sample])
        });
        let base = independent(&matrix.tr_mul(&matrix), 0.0);
        let reduced = matrix.select_columns(&base);
        let qr = reduced.clone().qr();
        let mut right = torque.clone();
        qr.q_tr_mul(&mut right);
        let r = qr.r();
        let x = r.solve_upper_triangular(&right.rows(0, base.len()).into_owned()).expect("independent columns");
        let residual = torque - &reduced * &x;
        let inverse = r.try_inverse().expect("independent columns");
        let covariance = covariance(&reduced, &residual, &inverse, samples);
        let (mut values, mut std) = (vec![0.0; n], vec![f64::INFINITY; n]);
        for (i, &k) in base.iter().enumerate() {
            values[k] = x[i] / length[k];
            std[k] = covariance[(i, i)].max(0.0).sqrt() / length[k];
        }
        Solution { values, std, base }
    }

    /// Torques for the given parameter values, `[axis][sample]`, N·m.
    pub fn torques(&self, values: &[f64]) -> PerAxis<Vec<f64>> {
        std::array::from_fn(|axis| {
            let mut sum = vec![0.0; self.torque[axis].len()];
            for (column, value) in self.columns.iter().zip(values).filter(|(_, v)| **v != 0.0) {
                for (s, x) in sum.iter_mut().zip(&column[axis]) {
                    *s += value * x;
                }
            }
            sum
        })
    }
}

/// R⁻¹ (Σ s sᵀ) R⁻ᵀ of the scores s of blocks of time, all axes together. Unlike that of the library's fit there is no prior,
/// and no score is corrected for its block's own pull on the estimate.
fn covariance(rows: &DMatrix<f64>, residual: &DVector<f64>, inverse: &DMatrix<f64>, samples: usize) -> DMatrix<f64> {
    let n = rows.ncols();
    let length = samples.div_ceil(BLOCKS).max(1);
    let mut meat = DMatrix::zeros(n, n);
    let mut blocks: f64 = 0.0;
    for start in (0..samples).step_by(length) {
        let count = length.min(samples - start);
        let mut score = DVector::zeros(n);
        for axis in every_axis() {
            let first = axis * samples + start;
            score += rows.rows(first, count).tr_mul(&residual.rows(first, count));
        }
        meat += &score * score.transpose();
        blocks += 1.0;
    }
    let normal = inverse * inverse.transpose();
    &normal * meat * &normal * (blocks / (blocks - 1.0).max(1.0))
}
