//! Fixed-interval smoother of one joint angle whose fourth derivative is white noise.
//!
//! State x = (q, q̇, q̈, q⃛) in sample times, reading z = q + noise. Between samples x follows the Taylor series,
//! driven by white noise in q⁗ of intensity `snap` and by white noise in q⃛ of an intensity `jerk` per step, where q̈
//! may jump. All quantities are in units of the reading's standard deviation. With jerk = 0 the estimate is the
//! smoothing spline of degree 7 [Wahba 1978]; the intensities are estimated by maximum likelihood. A forward Kalman
//! filter is followed by the backward recursion of Bryson and Frazier [Bryson 1963], which needs no matrix inverse
//! and O(n) operations.
//!
//! The time from one reading to the next may differ from step to step, and readings may be missing (NaN): then the state
//! at the instant follows from the others. Standard errors of the derivatives there follow from the same recursion.

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

/// Readings of one segment; a missing one is NaN.
#[derive(Clone, Copy)]
pub struct Samples<'a> {
    /// Samples in units of their standard deviation.
    pub z: &'a [f64],
    /// Durations of the steps in sample times; empty if all are 1.
    pub steps: &'a [f64],
    /// Intensity of the noise in q⃛ per step, `z.len() − 1` of them.
    pub jerk: &'a [f64],
}

impl Samples<'_> {
    fn window(&self, range: std::ops::Range<usize>) -> Self {
        let steps = range.start..range.end - 1;
        Self { z: &self.z[range], steps: self.steps.get(steps.clone()).unwrap_or(&[]), jerk: &self.jerk[steps] }
    }

    fn start(&self, snap: f64) -> Belief {
        Belief::start(self.z.iter().copied().find(|z| !z.is_nan()).unwrap_or(0.0), snap, self.steps.is_empty())
    }

    /// Prediction of the state by the step that ends with reading `k`.
    fn step(&self, belief: &mut Belief, snap: f64, k: usize) {
        match self.steps.get(k - 1) {
            None => belief.step(snap, self.jerk[k - 1]),
            Some(&h) => {
                // In units of the step's duration it is one of duration 1.
                belief.scale(h);
                belief.step(snap * h.powi(7), self.jerk[k - 1] * h.powi(5));
                belief.scale(h.recip());
            }
        }
    }
}

/// Mean and covariance of the state before a reading.
#[derive(Clone, Copy)]
struct Belief {
    mean: Vector,
    covariance: Matrix,
    /// Whether all steps have the duration 1.
    even: bool,
}

impl Belief {
    fn start(z: f64, snap: f64, even: bool) -> Self {
        let variance = |i: usize| FREE * width(snap).powi(-2 * i as i32);
        let covariance = std::array::from_fn(|i| std::array::from_fn(|j| if i == j { variance(i) } else { 0.0 }));
        Self { mean: [z, 0.0, 0.0, 0.0], covariance, even }
    }

    /// The state in time units that are longer by `h`.
    fn scale(&mut self, h: f64) {
        let powers = [1.0, h, h * h, h * h * h];
        for i in 0..STATES {
            self.mean[i] *= powers[i];
            for j in 0..STATES {
                self.covariance[i][j] *= powers[i] * powers[j];
            }
        }
    }

    /// Kalman update with a reading; returns its innovation and the innovation's variance.
    fn update(&mut self, z: f64) -> (f64, f64) {
        let p = &mut self.covariance;
        let (innovation, variance) = (z - self.mean[0], p[0][0] + 1.0);
        let cross = p[0];
        if z.is_nan() {
            return (innovation, variance);
        }
        for i in 0..STATES {
            let gain = cross[i] / variance;
            self.mean[i] += gain * innovation;
            for j in i..STATES {
                p[i][j] -= gain * cross[j];
                p[j][i] = p[i][j]; // Rounding must not leave it unsymmetric: that would grow.
            }
        }
        if !self.even {
            // After long steps the differences above are small ones of large numbers; these quotients are equal to them.
            for j in 0..STATES {
                p[0][j] = cross[j] / variance;
                p[j][0] = p[0][j];
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
    /// Likelihood of the readings.
    pub fn of(readings: Samples, snap: f64) -> Self {
        let mut out = Self::default();
        let mut belief = readings.start(snap);
        let mut product = 1.0;
        for (k, &z) in readings.z.iter().enumerate() {
            if k > 0 {
                readings.step(&mut belief, snap, k);
            }
            let (innovation, variance) = belief.update(z);
            if k >= SETTLING && !z.is_nan() {
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

/// Standard error of the `derivative`-th derivative (0 to 3) of evenly spaced readings far from the ends, in units of their
/// noise, per sample^derivative.
///
/// The spectrum of q is snap/ω⁸, that of the noise 1: the estimate leaves 1/(1 + ω⁸/snap) of the noise ω^2d of the
/// derivative, and ∫ w^2d/(1 + w⁸) dw/π = 1/(8·sin((2d + 1)·π/8)).
pub fn standard_error(snap: f64, derivative: u32) -> f64 {
    let part = f64::from(2 * derivative + 1) / 8.0;
    (snap.powf(part) / (8.0 * (part * std::f64::consts::PI).sin())).sqrt()
}

/// Smoothed value and first two derivatives with respect to the time in samples, at all readings and missing ones.
///
/// Long series are smoothed in blocks that overlap by the smoother's memory.
pub fn smooth(readings: Samples, snap: f64) -> Vec<[f64; 3]> {
    in_blocks(readings, snap, |_, _, state| state)
}

/// Smoothed value and first two derivatives, and the standard errors of the derivatives.
pub type WithErrors = ([f64; 3], [f64; 2]);

/// [`smooth`] with the standard errors of the first two derivatives; at the first readings they may be infinite.
pub fn smooth_with_errors(readings: Samples, snap: f64) -> Vec<WithErrors> {
    // A small difference of large numbers before as many readings as states: it may be negative.
    let error = |variance: f64| if variance >= 0.0 { variance.sqrt() } else { f64::INFINITY };
    in_blocks(readings, snap, |before, information, state| {
        let variance = |i: usize| {
            let p = &before.covariance[i];
            let known = |j: usize| p[j] * information[j].iter().zip(p).map(|(l, p)| l * p).sum::<f64>();
            p[i] - (0..STATES).map(known).sum::<f64>()
        };
        (state, [1, 2].map(|i| error(variance(i))))
    })
}

/// What `of` makes of every instant's belief before the reading, the information of the readings from there on, and the
/// smoothed state.
fn in_blocks<T: Instant>(readings: Samples, snap: f64, of: impl Fn(&Belief, &Matrix, [f64; 3]) -> T) -> Vec<T> {
    let (reach, n) = (memory(snap), readings.z.len());
    let mut out = Vec::with_capacity(n);
    let mut forward = Vec::with_capacity((BLOCK + 2 * reach).min(n));
    for start in (0..n).step_by(BLOCK) {
        let inside = start..(start + BLOCK).min(n);
        let seen = start.saturating_sub(reach)..(inside.end + reach).min(n);
        out.resize(inside.end, T::default());
        let skipped = start - seen.start;
        block(readings.window(seen), snap, &of, &mut forward, skipped, &mut out[inside]);
    }
    out
}

/// Result at an instant.
trait Instant: Default + Clone {
    /// Whether it takes the information of the readings into account.
    const ERRORS: bool;
}

impl Instant for [f64; 3] {
    const ERRORS: bool = false;
}

impl Instant for WithErrors {
    const ERRORS: bool = true;
}

/// Smooths one block and writes the samples after the first `skipped` ones.
fn block<T: Instant>(
    readings: Samples,
    snap: f64,
    of: &impl Fn(&Belief, &Matrix, [f64; 3]) -> T,
    forward: &mut Vec<(Belief, f64, f64)>,
    skipped: usize,
    out: &mut [T],
) {
    forward.clear();
    let mut belief = readings.start(snap);
    for (k, &z) in readings.z.iter().enumerate() {
        if k > 0 {
            readings.step(&mut belief, snap, k);
        }
        let before = belief;
        let (innovation, variance) = belief.update(z);
        forward.push((before, innovation, variance));
    }
    // x̂ = x + P·r with the scores r of the readings from here on, and their information Λ: P̂ = P − P·Λ·P.
    let mut score = [0.0; STATES];
    let mut information = [[0.0; STATES]; STATES];
    for (k, (before, innovation, variance)) in forward.iter().enumerate().skip(skipped).rev() {
        let h = readings.steps.get(k).copied();
        back(&mut score, h);
        let p = &before.covariance;
        if T::ERRORS {
            information.iter_mut().for_each(|row| back(row, h));
            transpose(&mut information);
            information.iter_mut().for_each(|row| back(row, h));
        }
        if !innovation.is_nan() {
            let explained: f64 = (0..STATES).map(|i| p[0][i] * score[i]).sum();
            score[0] += (innovation - explained) / variance;
            if T::ERRORS {
                // Λ ← (1 − e₀·kᵀ)·Λ·(1 − k·e₀ᵀ) + e₀·e₀ᵀ/variance with the gain k.
                for _ in 0..2 {
                    for row in &mut information {
                        row[0] -= (0..STATES).map(|i| row[i] * p[0][i] / variance).sum::<f64>();
                    }
                    transpose(&mut information);
                }
                information[0][0] += variance.recip();
            }
        }
        if let Some(out) = out.get_mut(k - skipped) {
            let smoothed = |i: usize| before.mean[i] + (0..STATES).map(|j| p[i][j] * score[j]).sum::<f64>();
            *out = of(before, &information, std::array::from_fn(smoothed));
        }
    }
}

/// x ← Fᵀ·x of a step of duration `h`, 1 if `None`.
fn back(x: &mut Vector, h: Option<f64>) {
    let Some(h) = h else { return taylor_transposed(x) };
    let powers = [1.0, h, h * h, h * h * h];
    (0..STATES).for_each(|i| x[i] /= powers[i]);
    taylor_transposed(x);
    (0..STATES).for_each(|i| x[i] *= powers[i]);
}

fn transpose(m: &mut Matrix) {
    for i in 0..STATES {
        for j in 0..i {
            (m[i][j], m[j][i]) = (m[j][i], m[i][j]);
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

    fn even<'a>(z: &'a [f64], jerk: &'a [f64]) -> Samples<'a> {
        Samples { z, steps: &[], jerk }
    }

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

    /// min Σ(z − x₀)² + Σ wᵀQ⁻¹w over all states, by dense linear algebra: estimates and standard errors, with equal and
    /// with unequal steps and missing readings.
    #[test]
    fn smoother_is_the_generalised_least_squares_estimate() {
        let n = 60;
        let (snap, jumps) = (1e-3, 30..34);
        let jerk: Vec<f64> = (0..n - 1).map(|k| if jumps.contains(&k) { 2.0 } else { 0.0 }).collect();
        let (_, mut z) = drawn(n, snap, 3);
        let uneven: Vec<f64> =
            (0..n - 1).map(|k| if k % 9 == 5 { 4.0 } else { 1.0 + 0.4 * (k as f64).sin() }).collect();
        for steps in [&[][..], &uneven] {
            if !steps.is_empty() {
                [20, 21, 40].iter().for_each(|k: &usize| z[*k] = f64::NAN);
            }
            let mut information = DMatrix::<f64>::zeros(4 * n, 4 * n);
            let mut right = DVector::<f64>::zeros(4 * n);
            for k in 0..n {
                if !z[k].is_nan() {
                    information[(4 * k, 4 * k)] += 1.0;
                    right[4 * k] += z[k];
                }
                if k + 1 < n {
                    let h = steps.get(k).copied().unwrap_or(1.0);
                    let of = |i: usize, j: usize| {
                        let [s, k] = [7, 5].map(|power| h.powi(power - (i + j) as i32));
                        (snap * s, k)
                    };
                    let q = DMatrix::from_fn(4, 4, |i, j| of(i, j).0 * SNAP[i][j] + jerk[k] * of(i, j).1 * JERK[i][j]);
                    let weight = q.try_inverse().unwrap();
                    let taylor = [1.0, h, h * h / 2.0, h * h * h / 6.0];
                    let step = DMatrix::from_fn(4, 8, |i, j| match j {
                        4.. => f64::from(u8::from(j - 4 == i)),
                        _ if j >= i => -taylor[j - i],
                        _ => 0.0,
                    });
                    let part = step.transpose() * weight * step;
                    let mut place = information.view_mut((4 * k, 4 * k), (8, 8));
                    place += part;
                }
            }
            let cholesky = information.cholesky().unwrap();
            let (exact, covariance) = (cholesky.solve(&right), cholesky.inverse());
            let samples = Samples { z: &z, steps, jerk: &jerk };
            let with_errors = smooth_with_errors(samples, snap);
            for (k, x) in smooth(samples, snap).iter().enumerate() {
                for i in 0..3 {
                    let (error, std) = ((x[i] - exact[4 * k + i]).abs(), covariance[(4 * k + i, 4 * k + i)].sqrt());
                    // Long steps make both ill-conditioned: they agree to a thousandth of the standard error.
                    let allowed = if steps.is_empty() { 1e-5 + 1e-6 * x[i].abs() } else { 1e-3 * std };
                    assert!(error < allowed, "{k}, {i}: {} {error}", x[i]);
                }
                assert_eq!(&with_errors[k].0, x);
                for i in (1..3).filter(|_| k >= STATES) {
                    let error = covariance[(4 * k + i, 4 * k + i)].sqrt();
                    approx::assert_relative_eq!(with_errors[k].1[i - 1], error, max_relative = 1e-3);
                }
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
            block(even(&z, &jerk), snap, &|_, _, state| state, &mut Vec::new(), 0, &mut whole);
            for (k, (a, b)) in smooth(even(&z, &jerk), snap).iter().zip(&whole).enumerate() {
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
                let one = |seed| Likelihood::of(even(&drawn(1000, snap, seed).1, &[0.0; 999]), snap * factor);
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
                let smoothed = smooth(even(&z, &[0.0; 1199]), assumed);
                let inside = smoothed.iter().zip(&truth).skip(100).take(1000);
                inside.map(|(a, b)| (a[2] - b[2]).powi(2)).sum()
            };
            ((0..40).map(squares).sum::<f64>() / 40_000.0).sqrt()
        };
        let best = error(snap);
        assert!(best < error(10.0 * snap) && best < error(0.1 * snap));
        let promised = standard_error(snap, 2);
        assert!((best / promised - 1.0).abs() < 0.1, "{best:e} {promised:e}");
    }
}
