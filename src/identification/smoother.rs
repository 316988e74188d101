//! Fixed-interval smoother of one joint angle whose fourth derivative is white noise.
//!
//! State x = (q, q̇, q̈, q⃛) in sample times, reading z = q + noise. Between samples x follows the Taylor series,
//! driven by white noise in q⁗ of intensity `snap` and by white noise in q⃛ of an intensity `jerk` per step, where q̈
//! may jump. All quantities are in units of the reading's standard deviation. With jerk = 0 the estimate is the
//! smoothing spline of degree 7 [Wahba 1978]; the intensities are estimated by maximum likelihood. A forward Kalman
//! filter is followed by the backward recursion of Bryson and Frazier [Bryson 1963], which needs no matrix inverse
//! and O(n) operations.

type Vector = [f64; STATES];
type Matrix = [Vector; STATES];

const STATES: usize = 4;

/// Covariance of one step per unit intensity of the noise in q⁗, 1/((3−i)!·(3−j)!·(7−i−j)).
const SNAP: Matrix = [
    [1.0 / 252.0, 1.0 / 72.0, 1.0 / 30.0, 1.0 / 24.0],
    [1.0 / 72.0, 1.0 / 20.0, 1.0 / 8.0, 1.0 / 6.0],
    [1.0 / 30.0, 1.0 / 8.0, 1.0 / 3.0, 1.0 / 2.0],
    [1.0 / 24.0, 1.0 / 6.0, 1.0 / 2.0, 1.0],
];
/// Covariance of one step per unit intensity of the noise in q⃛; the fourth state is unaffected.
const JERK: Matrix = [
    [1.0 / 20.0, 1.0 / 8.0, 1.0 / 6.0, 0.0],
    [1.0 / 8.0, 1.0 / 3.0, 1.0 / 2.0, 0.0],
    [1.0 / 6.0, 1.0 / 2.0, 1.0, 0.0],
    [0.0; STATES],
];
/// Variance of the initial state relative to the smoother's own in the middle of a series, which is about width⁻²ⁱ:
/// large enough for a diffuse prior, small enough to avoid rounding errors.
const FREE: f64 = 1e12;
/// Number of initial readings that are not part of the likelihood.
const SETTLING: usize = 8;
/// Number of samples smoothed at a time.
const BLOCK: usize = 8192;

/// Mean and covariance of the state before a reading.
#[derive(Clone, Copy)]
struct Belief {
    mean: Vector,
    covariance: Matrix,
}

impl Belief {
    fn start(z: f64, snap: f64) -> Self {
        let variance = |i: usize| FREE * width(snap).powi(-2 * i as i32);
        let covariance = std::array::from_fn(|i| std::array::from_fn(|j| if i == j { variance(i) } else { 0.0 }));
        Self { mean: [z, 0.0, 0.0, 0.0], covariance }
    }

    /// Kalman update with a reading; returns its innovation and the innovation's variance.
    fn update(&mut self, z: f64) -> (f64, f64) {
        let p = &mut self.covariance;
        let (innovation, variance) = (z - self.mean[0], p[0][0] + 1.0);
        let cross = p[0];
        for i in 0..STATES {
            let gain = cross[i] / variance;
            self.mean[i] += gain * innovation;
            for j in i..STATES {
                p[i][j] -= gain * cross[j];
                p[j][i] = p[i][j]; // Rounding must not leave it unsymmetric: that would grow.
            }
        }
        (innovation, variance)
    }

    /// Prediction of the state by one sample.
    fn step(&mut self, snap: f64, jerk: f64) {
        taylor(&mut self.mean);
        let p = &mut self.covariance;
        for j in 0..STATES {
            p[0][j] += p[1][j] + 0.5 * p[2][j] + p[3][j] / 6.0;
            p[1][j] += p[2][j] + 0.5 * p[3][j];
            p[2][j] += p[3][j];
        }
        for (row, (s, k)) in p.iter_mut().zip(SNAP.iter().zip(&JERK)) {
            taylor(row);
            for j in 0..STATES {
                row[j] += snap * s[j] + jerk * k[j];
            }
        }
    }
}

/// x ← F·x.
fn taylor(x: &mut Vector) {
    x[0] += x[1] + 0.5 * x[2] + x[3] / 6.0;
    x[1] += x[2] + 0.5 * x[3];
    x[2] += x[3];
}

/// x ← Fᵀ·x.
fn taylor_transposed(x: &mut Vector) {
    x[3] += x[2] + 0.5 * x[1] + x[0] / 6.0;
    x[2] += x[1] + 0.5 * x[0];
    x[1] += x[0];
}

/// Sufficient statistics of the innovations for the likelihood.
#[derive(Clone, Copy, Default)]
pub struct Likelihood {
    /// Number of innovations.
    pub count: f64,
    /// Sum of the squares over their variances.
    pub squares: f64,
    /// Sum of the logarithms of their variances.
    pub log: f64,
}

impl Likelihood {
    /// Likelihood of the readings `z`; `jerk` contains one intensity per step, `z.len() − 1`.
    pub fn of(z: &[f64], snap: f64, jerk: &[f64]) -> Self {
        let mut out = Self::default();
        let Some(&first) = z.first() else { return out };
        let mut belief = Belief::start(first, snap);
        let mut product = 1.0;
        for (k, &z) in z.iter().enumerate() {
            if k > 0 {
                belief.step(snap, jerk[k - 1]);
            }
            let (innovation, variance) = belief.update(z);
            if k >= SETTLING {
                out.count += 1.0;
                out.squares += innovation * innovation / variance;
                // One logarithm for many factors.
                product *= variance;
                if product > 1e100 {
                    out.log += product.ln();
                    product = 1.0;
                }
            }
        }
        out.log += product.ln();
        out
    }

    /// Log-likelihood of the readings for their `variance`, up to a constant.
    pub fn ln(&self, variance: f64) -> f64 {
        -0.5 * (self.squares / variance + self.count * variance.ln() + self.log)
    }

    /// Maximum-likelihood variance of the readings, in units of which the intensities are given.
    pub fn variance(&self) -> f64 {
        self.squares / self.count
    }
}

impl std::iter::Sum for Likelihood {
    fn sum<I: Iterator<Item = Self>>(parts: I) -> Self {
        let add =
            |a: Self, b: Self| Self { count: a.count + b.count, squares: a.squares + b.squares, log: a.log + b.log };
        parts.fold(Self::default(), add)
    }
}

/// Number of samples after which the influence of a reading is negligible: weights decay by e about every (4/snap)^⅛
/// samples.
fn memory(snap: f64) -> usize {
    (40.0 * width(snap)) as usize + 100
}

/// Time scale of the smoother, samples: frequencies above its inverse (radians per sample) are damped.
pub fn width(snap: f64) -> f64 {
    snap.powf(-1.0 / 8.0)
}

/// Smoothed value and first two derivatives with respect to the sample number; `jerk` contains one intensity per
/// step.
///
/// Long series are smoothed in blocks that overlap by the smoother's memory.
pub fn smooth(z: &[f64], snap: f64, jerk: &[f64]) -> Vec<[f64; 3]> {
    let reach = memory(snap);
    let mut out = Vec::with_capacity(z.len());
    let mut forward = Vec::with_capacity((BLOCK + 2 * reach).min(z.len()));
    for start in (0..z.len()).step_by(BLOCK) {
        let inside = start..(start + BLOCK).min(z.len());
        let seen = start.saturating_sub(reach)..(inside.end + reach).min(z.len());
        let steps = seen.start..seen.end - 1;
        out.resize(inside.end, [0.0; 3]);
        let skipped = start - seen.start;
        block(&z[seen], snap, &jerk[steps], &mut forward, skipped, &mut out[inside]);
    }
    out
}

/// Smooths one block and writes the samples after the first `skipped` ones.
fn block(
    z: &[f64],
    snap: f64,
    jerk: &[f64],
    forward: &mut Vec<(Belief, f64, f64)>,
    skipped: usize,
    out: &mut [[f64; 3]],
) {
    forward.clear();
    let mut belief = Belief::start(z[0], snap);
    for (k, &z) in z.iter().enumerate() {
        if k > 0 {
            belief.step(snap, jerk[k - 1]);
        }
        let before = belief;
        let (innovation, variance) = belief.update(z);
        forward.push((before, innovation, variance));
    }
    // x̂ = x + P·r with the scores r of the readings from here on.
    let mut score = [0.0; STATES];
    for (k, (before, innovation, variance)) in forward.iter().enumerate().skip(skipped).rev() {
        taylor_transposed(&mut score);
        let p = &before.covariance;
        let explained: f64 = (0..STATES).map(|i| p[0][i] * score[i]).sum();
        score[0] += (innovation - explained) / variance;
        if let Some(out) = out.get_mut(k - skipped) {
            for (i, x) in out.iter_mut().enumerate() {
                *x = before.mean[i] + (0..STATES).map(|j| p[i][j] * score[j]).sum::<f64>();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    fn white(n: usize, seed: u64) -> Vec<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        (0..n).map(|_| StandardNormal.sample(&mut rng)).collect()
    }

    /// A motion drawn from the model: q⁗ is white noise of intensity `snap` at 16 instants per sample.
    fn drawn(n: usize, snap: f64, seed: u64) -> (Vec<[f64; 3]>, Vec<f64>) {
        let noise = white(17 * n, seed);
        let mut x = [0.0; 4];
        let mut truth = Vec::new();
        let h = 1.0 / 16.0f64;
        for k in 0..n {
            truth.push([x[0], x[1], x[2]]);
            for s in 0..16 {
                x[0] += h * (x[1] + h * (x[2] / 2.0 + h * x[3] / 6.0));
                x[1] += h * (x[2] + h * x[3] / 2.0);
                x[2] += h * x[3];
                x[3] += (snap * h).sqrt() * noise[16 * k + s];
            }
        }
        let z = truth.iter().zip(&noise[16 * n..]).map(|(x, e)| x[0] + e).collect();
        (truth, z)
    }

    /// min Σ(z − x₀)² + Σ wᵀQ⁻¹w over all states, by dense linear algebra.
    #[test]
    fn smoother_is_the_generalised_least_squares_estimate() {
        let n = 60;
        let (snap, jumps) = (1e-3, 30..34);
        let jerk: Vec<f64> = (0..n - 1).map(|k| if jumps.contains(&k) { 2.0 } else { 0.0 }).collect();
        let (_, z) = drawn(n, snap, 3);
        let mut information = DMatrix::<f64>::zeros(4 * n, 4 * n);
        let mut right = DVector::<f64>::zeros(4 * n);
        for k in 0..n {
            information[(4 * k, 4 * k)] += 1.0;
            right[4 * k] += z[k];
            if k + 1 < n {
                let q = DMatrix::from_fn(4, 4, |i, j| snap * SNAP[i][j] + jerk[k] * JERK[i][j]);
                let weight = q.try_inverse().unwrap();
                let factorial = [1.0, 1.0, 2.0, 6.0];
                let step = DMatrix::from_fn(4, 8, |i, j| match j {
                    4.. => f64::from(u8::from(j - 4 == i)),
                    _ => {
                        if j >= i {
                            -1.0 / factorial[j - i]
                        } else {
                            0.0
                        }
                    }
                });
                let part = step.transpose() * weight * step;
                let mut place = information.view_mut((4 * k, 4 * k), (8, 8));
                place += part;
            }
        }
        let exact = information.cholesky().unwrap().solve(&right);
        for (k, x) in smooth(&z, snap, &jerk).iter().enumerate() {
            for i in 0..3 {
                approx::assert_relative_eq!(x[i], exact[4 * k + i], epsilon = 1e-5, max_relative = 1e-6);
            }
        }
    }

    #[test]
    fn blocks_leave_no_seams() {
        let n = 2 * BLOCK + 1000;
        let wave = |k: usize| 1e5 * (k as f64 * 2e-3).sin() + 1e3 * (k as f64 * 0.02).cos();
        let z: Vec<f64> = white(n, 5).iter().enumerate().map(|(k, e)| wave(k) + e).collect();
        let jerk = vec![0.0; n - 1];
        for snap in [1e-9, 1e-6, 1e-2] {
            let mut whole = vec![[0.0; 3]; n];
            block(&z, snap, &jerk, &mut Vec::new(), 0, &mut whole);
            for (k, (a, b)) in smooth(&z, snap, &jerk).iter().zip(&whole).enumerate() {
                for i in 0..3 {
                    assert!((a[i] - b[i]).abs() < 1e-6, "snap {snap:e}, sample {k}: {a:?} {b:?}");
                }
            }
        }
    }

    /// The likelihood is largest near the true intensity; by its curvature the relative standard error of an
    /// intensity is about √(2·8·width/n), here a quarter.
    #[test]
    fn likelihood_finds_the_intensity() {
        for snap in [1e-7, 1e-4] {
            let at = |factor: f64| -> f64 {
                let one = |seed| Likelihood::of(&drawn(1000, snap, seed).1, snap * factor, &[0.0; 999]);
                (0..20).map(one).sum::<Likelihood>().ln(1.0)
            };
            assert!(at(1.0) > at(2.0) && at(1.0) > at(0.5), "{} {} {}", at(0.5), at(1.0), at(2.0));
        }
    }

    #[test]
    fn errors_are_as_small_as_the_model_promises() {
        let snap = 1e-6;
        let error = |assumed: f64| -> f64 {
            let squares = |seed| -> f64 {
                let (truth, z) = drawn(1200, snap, seed);
                let smoothed = smooth(&z, assumed, &[0.0; 1199]);
                let inside = smoothed.iter().zip(&truth).skip(100).take(1000);
                inside.map(|(a, b)| (a[2] - b[2]).powi(2)).sum()
            };
            ((0..40).map(squares).sum::<f64>() / 40_000.0).sqrt()
        };
        let best = error(snap);
        assert!(best < error(10.0 * snap) && best < error(0.1 * snap));
        // Spectrum of q: snap/ω⁸; of the readings' noise: 1. The optimal estimate leaves 1/(1 + ω⁸/snap) of the noise
        // ω⁴ of q̈: var q̈ = snap^(5/8)·∫ w⁴/(1 + w⁸) dw/π.
        let integral: f64 =
            (0..4000).map(|k| f64::from(k) * 5e-3 + 2.5e-3).map(|w| w.powi(4) / (1.0 + w.powi(8))).sum();
        let promised = (snap.powf(5.0 / 8.0) * integral * 5e-3 / std::f64::consts::PI).sqrt();
        assert!((best / promised - 1.0).abs() < 0.1, "{best:e} {promised:e}");
    }
}
