//! Bodies with all ten parameters as variables, in log-Cholesky coordinates [Rucker 2022].
//!
//! The pseudo-inertia is J = L·Lᵀ with L lower triangular and L_kk = e^{d_k}: every (d, L) is a consistent body, and
//! every consistent body has exactly one. The coordinates are d₀…d₃, then L₁₀, L₂₀, L₂₁, L₃₀, L₃₁, L₃₂.

use nalgebra::{DMatrix, DVector, Matrix4};

use crate::machine::Payload;
use crate::machine::bodies::Inertia;

/// Number of parameters and of coordinates.
pub const TEN: usize = 10;
/// Row and column of every coordinate in L.
const PLACES: [(usize, usize); TEN] = [(0, 0), (1, 1), (2, 2), (3, 3), (1, 0), (2, 0), (2, 1), (3, 0), (3, 1), (3, 2)];

/// Variables of m, h_x, h_y, h_z, Θ_xx, Θ_yy, Θ_zz, Θ_xy, Θ_xz and Θ_yz.
#[derive(Clone, Debug)]
pub struct Full(pub [usize; TEN]);

impl Full {
    /// The body, if each of its ten parameters is one of the variables with the given unit inertias.
    pub fn of(units: &[(usize, Inertia)]) -> Option<Self> {
        let mut own = [0; TEN];
        for (k, own) in own.iter_mut().enumerate() {
            *own = units.iter().find(|(_, u)| *u == unit(k))?.0;
        }
        Some(Self(own))
    }

    /// The body with the variables `x`.
    pub fn inertia(&self, x: &DVector<f64>) -> Inertia {
        (0..TEN).fold(Inertia::ZERO, |mut sum, k| {
            sum += unit(k) * x[self.0[k]];
            sum
        })
    }

    /// Smallest pivot of J relative to the least permitted one of second moments or mass; the first pivot that is not
    /// positive.
    pub fn slack(&self, x: &DVector<f64>, least: (f64, f64)) -> f64 {
        let pseudo = self.inertia(x).pseudo_inertia();
        let mut l = Matrix4::zeros();
        let mut slack = f64::INFINITY;
        for k in 0..4 {
            let pivot = column(&pseudo, &mut l, k, 0.0);
            slack = slack.min(pivot / if k < 3 { least.0 } else { least.1 });
            if slack <= 0.0 {
                break;
            }
        }
        slack
    }

    /// Coordinates of `x`, with pivots raised to the least permitted ones where necessary.
    pub fn coordinates(&self, x: &DVector<f64>, least: (f64, f64)) -> [f64; TEN] {
        let pseudo = self.inertia(x).pseudo_inertia();
        let mut l = Matrix4::zeros();
        for k in 0..4 {
            column(&pseudo, &mut l, k, if k < 3 { least.0 } else { least.1 });
        }
        PLACES.map(|(i, j)| if i == j { l[(i, i)].ln() } else { l[(i, j)] })
    }

    /// Writes the parameters of the coordinates from `start` on into `x`, and their derivatives into `slope`.
    pub fn parameters(&self, pi: &DVector<f64>, start: usize, x: &mut DVector<f64>, slope: &mut DMatrix<f64>) {
        let l = triangle(pi, start);
        for (k, &v) in self.0.iter().enumerate() {
            let weight = weight(k);
            x[v] = (l.transpose() * weight * l).trace();
            let gradient = 2.0 * weight * l;
            for (p, (i, j)) in PLACES.into_iter().enumerate() {
                slope[(v, start + p)] = gradient[(i, j)] * if i == j { l[(i, i)] } else { 1.0 };
            }
        }
    }

    /// Adds Σ gₖ·d²xₖ/dπ² of the coordinates from `start` on to `bend`.
    pub fn bend(&self, pi: &DVector<f64>, start: usize, g: &DVector<f64>, bend: &mut DMatrix<f64>) {
        let l = triangle(pi, start);
        let mut total = Matrix4::zeros();
        for (k, &v) in self.0.iter().enumerate() {
            total += weight(k) * g[v];
        }
        let gradient = 2.0 * total * l;
        // dL/dπ is L on the diagonal and 1 off the diagonal.
        let chain = |(i, j): (usize, usize)| if i == j { l[(i, i)] } else { 1.0 };
        for (p, a) in PLACES.into_iter().enumerate() {
            for (q, b) in PLACES.into_iter().enumerate() {
                if a.1 == b.1 {
                    bend[(start + p, start + q)] += 2.0 * total[(a.0, b.0)] * chain(a) * chain(b);
                }
            }
            if a.0 == a.1 {
                bend[(start + p, start + p)] += gradient[a] * l[a];
            }
        }
    }
}

/// Inertia of one unit of parameter `k`.
fn unit(k: usize) -> Inertia {
    let mut inertia = Inertia::ZERO;
    match k {
        0 => inertia.mass = 1.0,
        1..=3 => inertia.first_moment[k - 1] = 1.0,
        _ => {
            let mut moments = [0.0; 6];
            moments[k - 4] = 1.0;
            inertia.tensor = Payload::with_tensor(0.0, [0.0; 3], moments).tensor;
        }
    }
    inertia
}

/// Symmetric G with parameter `k` = tr(G·J): Θ_xx = J_yy + J_zz, Θ_xy = −J_xy and so on.
fn weight(k: usize) -> Matrix4<f64> {
    let mut g = Matrix4::zeros();
    match k {
        0 => g[(3, 3)] = 1.0,
        1..=3 => (g[(3, k - 1)], g[(k - 1, 3)]) = (0.5, 0.5),
        4..=6 => (0..3).filter(|&i| i != k - 4).for_each(|i| g[(i, i)] = 1.0),
        _ => {
            let (i, j) = [(0, 1), (0, 2), (1, 2)][k - 7];
            (g[(i, j)], g[(j, i)]) = (-0.5, -0.5);
        }
    }
    g
}

/// Computes column `k` of the Cholesky factor with its pivot raised to `least`; returns the original pivot.
fn column(pseudo: &Matrix4<f64>, l: &mut Matrix4<f64>, k: usize, least: f64) -> f64 {
    let rest = |l: &Matrix4<f64>, i: usize| pseudo[(i, k)] - (0..k).map(|j| l[(i, j)] * l[(k, j)]).sum::<f64>();
    let pivot = rest(l, k);
    l[(k, k)] = pivot.max(least).max(f64::MIN_POSITIVE).sqrt();
    for i in k + 1..4 {
        l[(i, k)] = rest(l, i) / l[(k, k)];
    }
    pivot
}

fn triangle(pi: &DVector<f64>, start: usize) -> Matrix4<f64> {
    let mut l = Matrix4::zeros();
    for (p, (i, j)) in PLACES.into_iter().enumerate() {
        l[(i, j)] = if i == j { pi[start + p].exp() } else { pi[start + p] };
    }
    l
}
