//! Detection of torques that are assigned to the wrong axes.
//!
//! The torque of a drive depends on its own axis more than on any other, because friction acts on that axis alone,
//! and its inertia and weight dominate. τ_i is regressed on 1, cos q_j, sin q_j, q̇_j, q̈_j and tanh(k·q̇_j) for
//! every pair of axes; the unexplained share of its variance is smallest for j = i, unless columns are swapped.

use nalgebra::{SMatrix, SVector};

use super::Dataset;
use super::dataset::stride_for;

/// Number of features of the motion of one axis.
const FEATURES: usize = 6;
/// Steepness of the friction feature, s/rad (eq. 48).
const STEEPNESS: f64 = 100.0;
/// Ratio of the unexplained share to the axis' own from which another axis explains a torque significantly better.
const DECIDED: f64 = 1.0 / 3.0;
/// Number of samples that suffices.
const SAMPLES: usize = 20_000;
/// Eigenvalue of the scaled normal equations, relative to the largest, below which features are collinear.
const COLLINEAR: f64 = 1e-10;

type Features = SVector<f64, FEATURES>;

/// Description of the axes, in order, that the torques of axes 1, 2, … seem to belong to; `None` if every torque is
/// assigned correctly or the motion is not informative.
pub fn swapped(dataset: &Dataset) -> Option<String> {
    let axes = dataset.channels.iter().take_while(|c| c.drive().is_some()).count();
    let own: Vec<usize> = (0..axes).collect();
    if axes < 2 || dataset.is_empty() {
        return None;
    }
    let unexplained: Vec<Vec<f64>> =
        own.iter().map(|&i| own.iter().map(|&j| unexplained(dataset, i, j)).collect()).collect();
    let better = |i: usize, j: usize| unexplained[i][j] < DECIDED * unexplained[i][i];
    let order: Vec<usize> = (0..axes)
        .map(|i| {
            let best = (0..axes).min_by(|&a, &b| unexplained[i][a].total_cmp(&unexplained[i][b])).unwrap_or(i);
            if better(i, best) { best } else { i }
        })
        .collect();
    let permuted = own.iter().all(|j| order.contains(j));
    if order == own || !permuted {
        return None;
    }
    let moved = own.iter().filter(|&&i| order[i] != i);
    let sentence = |&i: &usize| {
        let (j, percent) = (order[i], |share: f64| format!("{:.0} %", 100.0 * share));
        format!(
            "tau{} follows q{} (all but {}) and not q{} (all but {})",
            i + 1,
            j + 1,
            percent(unexplained[i][j]),
            i + 1,
            percent(unexplained[i][i])
        )
    };
    let sentences: Vec<String> = moved.map(sentence).collect();
    Some(format!("{}: are the axes swapped?", sentences.join(", ")))
}

/// Share of the variance of the torque of axis `i` that the motion of axis `j` does not explain.
fn unexplained(dataset: &Dataset, i: usize, j: usize) -> f64 {
    let rows = (0..dataset.len()).step_by(stride_for(dataset.len(), SAMPLES)).map(|k| {
        let m = &dataset.joints[k];
        let (s, c) = m.q[j].sin_cos();
        let friction = (STEEPNESS * m.qd[j]).tanh();
        (Features::from([1.0, c, s, m.qd[j], m.qdd[j], friction]), dataset.measured[i][k])
    });
    let mut normal = SMatrix::<f64, FEATURES, FEATURES>::zeros();
    let mut right = Features::zeros();
    let (mut sum, mut squares, mut n) = (0.0, 0.0, 0.0);
    for (x, y) in rows {
        normal += x * x.transpose();
        right += x * y;
        sum += y;
        squares += y * y;
        n += 1.0;
    }
    let variance = squares - sum * sum / n;
    if variance <= 0.0 {
        return 1.0;
    }
    let scale = normal.diagonal().map(|d| if d > 0.0 { 1.0 / d.sqrt() } else { 0.0 });
    let eigen =
        SMatrix::<f64, FEATURES, FEATURES>::from_fn(|a, b| normal[(a, b)] * scale[a] * scale[b]).symmetric_eigen();
    let projected = eigen.eigenvectors.tr_mul(&right.component_mul(&scale));
    let floor = COLLINEAR * eigen.eigenvalues.max();
    let explained: f64 =
        projected.iter().zip(&eigen.eigenvalues).filter(|(_, l)| **l > floor).map(|(p, l)| p * p / l).sum();
    ((squares - explained) / variance).clamp(0.0, 1.0)
}
