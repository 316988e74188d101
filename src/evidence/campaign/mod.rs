//! Synthetic campaigns: false alarms, power, collinear pairs, invariances.

mod confidence;
mod robustness;
mod selection;
mod statistics;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::*;

/// Samples per channel.
const N: usize = 1500;
/// Channels.
const C: usize = 4;

/// A random smooth series per channel: five sinusoids of 0.3…8 periods per hundred samples.
fn smooth(rng: &mut ChaCha8Rng, channels: usize, n: usize) -> Vec<f64> {
    let mut out = Vec::with_capacity(channels * n);
    for _ in 0..channels {
        let waves: Vec<[f64; 3]> = (0..5)
            .map(|_| [rng.random_range(0.02..0.5), rng.random_range(0.0..6.3), StandardNormal.sample(rng)])
            .collect();
        let start = out.len();
        out.resize(start + n, 0.0);
        for w in waves {
            // sin by the recurrence s(t+1) = 2 cos ω s(t) − s(t−1), for speed.
            let (mut old, mut new) = (w[2] * (w[1] - w[0]).sin(), w[2] * w[1].sin());
            for x in &mut out[start..] {
                *x += new;
                (old, new) = (new, 2.0 * w[0].cos() * new - old);
            }
        }
    }
    out
}

fn column(name: &str, values: Vec<f64>) -> Column {
    Column { name: name.into(), values: values.into(), magnitude: 0.0 }
}

/// AR(1) noise, correlated over channels; with `uneven`, its standard deviation varies by a factor of five.
fn noise(rng: &mut ChaCha8Rng, n: usize, uneven: bool) -> Vec<f64> {
    let mut out = vec![0.0; C * n];
    let mut state = [0.0; C];
    for t in 0..n {
        let common: f64 = StandardNormal.sample(rng);
        let size = if uneven { 1.0 + 0.67 * (0.021 * t as f64).sin() } else { 1.0 };
        for c in 0..C {
            let own: f64 = StandardNormal.sample(rng);
            state[c] = 0.7 * state[c] + (c + 1) as f64 * (0.5 * common + own);
            out[c * n + t] = size * state[c];
        }
    }
    out
}

/// Ten base columns, twelve candidates: eight single columns, two of three columns, one shape grid, one of four columns.
fn null_problem(seed: u64, uneven: bool) -> Problem {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let base: Vec<Column> = (0..10).map(|i| column(&format!("base {i}"), smooth(&mut rng, C, N))).collect();
    let mut candidates = Vec::new();
    for (k, columns) in [1, 1, 1, 1, 1, 1, 1, 1, 3, 3, 1, 4].into_iter().enumerate() {
        let name = format!("candidate {k}");
        let mut variants = vec![Variant {
            label: String::new(),
            columns: (0..columns).map(|i| column(&format!("{name}.{i}"), smooth(&mut rng, C, N))).collect(),
        }];
        if k < 3 {
            // Friction-like: the sign of a smooth series.
            variants[0].columns[0].values.iter_mut().for_each(|x| *x = x.signum());
        }
        if k == 10 {
            let shape = variants[0].columns[0].values.clone();
            let grid = [0.1, 0.5, 2.0].map(|w| Variant {
                label: format!("width {w}"),
                columns: vec![column("tanh", shape.iter().map(|x| (x / w).tanh()).collect())],
            });
            variants = grid.to_vec();
        }
        candidates.push(Candidate { name, variants });
    }
    let mut y = noise(&mut rng, N, uneven);
    for b in &base {
        y.iter_mut().zip(&b.values).for_each(|(y, x)| *y += 3.0 * x);
    }
    let channels = (0..C).map(|c| Channel { name: format!("axis {c}"), noise_sigma: None }).collect();
    Problem { channels, samples: N, segments: vec![0..500, 500..1000, 1000..N], y: y.into(), base, candidates }
}

/// Adds a candidate's effect with the given RMS of the first column relative to the noise of channel 0, which is
/// about 1.6.
fn plant(problem: &mut Problem, candidate: usize, variant: usize, size: f64) {
    let columns = problem.candidates[candidate].variants[variant].columns.clone();
    for z in columns {
        let rms = (z.values.iter().map(|x| x * x).sum::<f64>() / z.values.len() as f64).sqrt();
        problem.y.iter_mut().zip(&z.values).for_each(|(y, x)| *y += 1.6 * size / rms * x);
    }
}

fn quick() -> Settings {
    Settings { flips: 199, ..Settings::default() }
}

/// Unit combination of `a` and an independent `b` with correlation of about `r` with `a`.
fn mix(a: &[f64], b: &[f64], r: f64) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| r * a + (1.0 - r * r).sqrt() * b).collect()
}

/// A null problem in which candidate 3 is nearly a column of 8, 5 nearly 6, and 7 nearly the sum of the columns of 9.
fn collinear_problem(seed: u64, uneven: bool) -> Problem {
    let mut p = null_problem(seed, uneven);
    let first = |p: &Problem, k: usize| p.candidates[k].variants[0].columns[0].values.clone();
    let mut sum = vec![0.0; C * N];
    for z in &p.candidates[9].variants[0].columns {
        sum.iter_mut().zip(&z.values).for_each(|(s, x)| *s += x / 3.0_f64.sqrt());
    }
    for (k, towards, r) in [(3, first(&p, 8), 0.95), (5, first(&p, 6), 0.9), (7, sum.into(), 0.9)] {
        p.candidates[k].variants[0].columns[0].values = mix(&towards, &first(&p, k), r).into();
    }
    p
}
