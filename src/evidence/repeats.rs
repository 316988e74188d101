//! Is anything left? An exact test from repeats, without a noise model (rotation test; Langsrud 2005).
//!
//! Independent Gaussian noise keeps its distribution when the R repeats of a motion are multiplied by a random orthogonal
//! matrix, whatever its colour, its correlation over channels and its dependence on speed; a systematic error does not.
//! The mean over repeats of rotated rows is `uᵀ X / √R` with u uniform on the sphere, so only u has to be drawn.

use nalgebra::{Cholesky, Complex, DMatrix, DVector};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

use super::Error;

/// Neighbouring lines on either side that share a noise covariance.
const NEIGHBOURS: usize = 2;

/// Residuals of one motion: repeats × channels × samples, all repeats equally long and aligned in time.
#[derive(Clone, Debug, Default)]
pub struct Motion {
    /// `repeats[r][c]` is the residual of repeat r in channel c.
    pub repeats: Vec<Vec<Vec<f64>>>,
}

/// What the repeats say.
#[derive(Clone, Debug, PartialEq)]
pub struct RotationTest {
    /// `R Σ mᴴ V⁻¹ m` over motions and lines.
    pub statistic: f64,
    /// Share of rotations that reach it.
    pub p: f64,
    /// Lines of the discrete Fourier transform used.
    pub lines: usize,
}

/// Noise and systematic error per channel from repeats.
#[derive(Clone, Debug, PartialEq)]
pub struct Scatter {
    /// Standard deviation of the noise.
    pub noise: Vec<f64>,
    /// Mean square of the systematic error, corrected for noise; may be negative by chance.
    pub systematic: Vec<f64>,
}

/// `σ² = mean (e − ē)² R/(R−1)`, `s² = mean ē² − σ²/R` per channel; `None` without a motion with two repeats.
pub fn scatter(motions: &[Motion]) -> Option<Scatter> {
    let channels = shape(motions).ok()?;
    let mut noise = vec![0.0; channels];
    let mut systematic = vec![0.0; channels];
    let used: Vec<&Motion> = motions.iter().filter(|m| m.repeats.len() > 1).collect();
    let samples: f64 = used.iter().map(|m| m.repeats[0][0].len() as f64).sum();
    if samples <= 0.0 {
        return None;
    }
    for c in 0..channels {
        for m in &used {
            let r = m.repeats.len() as f64;
            for t in 0..m.repeats[0][c].len() {
                let mean = m.repeats.iter().map(|x| x[c][t]).sum::<f64>() / r;
                let spread = m.repeats.iter().map(|x| (x[c][t] - mean).powi(2)).sum::<f64>() / (r - 1.0);
                noise[c] += spread / samples;
                systematic[c] += (mean * mean - spread / r) / samples;
            }
        }
    }
    noise.iter_mut().for_each(|v| *v = v.sqrt());
    Some(Scatter { noise, systematic })
}

/// Test lines 1…`lines` against `draws` rotations. Motions with one repeat are ignored.
pub fn rotation_test(motions: &[Motion], lines: usize, draws: usize, seed: u64) -> Result<RotationTest, Error> {
    let channels = shape(motions)?;
    let used: Vec<&Motion> = motions.iter().filter(|m| m.repeats.len() > 1).collect();
    let shortest = used.iter().map(|m| m.repeats[0][0].len()).min().ok_or(Error::Empty)?;
    let lines = lines.min(shortest.saturating_sub(1) / 2);
    let freedom: usize = used.iter().map(|m| m.repeats.len() - 1).sum();
    if lines == 0 || freedom * (NEIGHBOURS + 1).min(lines) < channels {
        let values = freedom * (NEIGHBOURS + 1).min(lines);
        return Err(Error::Undetermined { values, parameters: channels });
    }
    let spectra: Vec<Spectra> = used.par_iter().map(|m| Spectra::new(m, channels, lines)).collect();
    let straight: Vec<Vec<f64>> = spectra.iter().map(|s| vec![(s.repeats as f64).sqrt().recip(); s.repeats]).collect();
    let statistic = statistic(&spectra, &straight, lines, channels);
    if !statistic.is_finite() {
        return Err(Error::NotFinite("residual of a repeat".into()));
    }
    let draw = |i: u64| {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(i + 1);
        let u: Vec<Vec<f64>> = spectra.iter().map(|s| direction(&mut rng, s.repeats)).collect();
        self::statistic(&spectra, &u, lines, channels)
    };
    let hits = (0..draws as u64).into_par_iter().filter(|&i| draw(i) >= statistic * (1.0 - 1e-12)).count();
    Ok(RotationTest { statistic, p: (1 + hits) as f64 / (draws + 1) as f64, lines })
}

/// Number of channels, when all repeats agree in shape.
fn shape(motions: &[Motion]) -> Result<usize, Error> {
    let first = motions.first().and_then(|m| m.repeats.first()).ok_or(Error::Empty)?;
    for (k, m) in motions.iter().enumerate() {
        let expected = m.repeats.first().and_then(|r| r.first()).map_or(0, Vec::len);
        for r in &m.repeats {
            let found = r.iter().find(|c| c.len() != expected).map_or(expected, Vec::len);
            if r.len() != first.len() || found != expected || expected == 0 {
                return Err(Error::Length { name: format!("motion {k}"), found, expected });
            }
        }
    }
    if first.is_empty() { Err(Error::Empty) } else { Ok(first.len()) }
}

/// Uniform direction: the mean of Haar-rotated rows.
fn direction(rng: &mut ChaCha8Rng, n: usize) -> Vec<f64> {
    let x: Vec<f64> = (0..n).map(|_| StandardNormal.sample(rng)).collect();
    let norm = x.iter().map(|v| v * v).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
    x.into_iter().map(|v| v / norm).collect()
}

/// Fourier lines of one motion.
struct Spectra {
    repeats: usize,
    /// Per line: channels × repeats.
    rows: Vec<DMatrix<Complex<f64>>>,
    /// Per line: `Σ_r x xᴴ`, which rotations keep.
    total: Vec<DMatrix<Complex<f64>>>,
}

impl Spectra {
    fn new(motion: &Motion, channels: usize, lines: usize) -> Self {
        let repeats = motion.repeats.len();
        let mut rows = vec![DMatrix::zeros(channels, repeats); lines];
        for (r, repeat) in motion.repeats.iter().enumerate() {
            for (c, series) in repeat.iter().enumerate() {
                let scale = (series.len() as f64).sqrt().recip();
                for (l, matrix) in rows.iter_mut().enumerate() {
                    matrix[(c, r)] = fourier(series, l + 1) * scale;
                }
            }
        }
        let total = rows.iter().map(|x| x * x.adjoint()).collect();
        Self { repeats, rows, total }
    }
}

/// One line of the discrete Fourier transform, with the phase restarted from an exact value every 64 samples.
fn fourier(series: &[f64], line: usize) -> Complex<f64> {
    let n = series.len();
    let step = Complex::cis(-std::f64::consts::TAU * line as f64 / n as f64);
    let mut sum = Complex::new(0.0, 0.0);
    for (k, part) in series.chunks(64).enumerate() {
        let turns = (64 * k * line % n) as f64 / n as f64;
        let mut phase = Complex::cis(-std::f64::consts::TAU * turns);
        for x in part {
            sum += phase * *x;
            phase *= step;
        }
    }
    sum
}

/// The statistic when the mean of motion k is `u_kᵀ X / √R`; then `R m mᴴ = (X u)(X u)ᴴ`.
fn statistic(spectra: &[Spectra], u: &[Vec<f64>], lines: usize, channels: usize) -> f64 {
    let zero = DMatrix::<Complex<f64>>::zeros(channels, channels);
    let mut means: Vec<Vec<DVector<Complex<f64>>>> = Vec::with_capacity(lines);
    let mut within: Vec<DMatrix<Complex<f64>>> = Vec::with_capacity(lines);
    for l in 0..lines {
        let mut pooled = zero.clone();
        let mut line = Vec::with_capacity(spectra.len());
        for (s, u) in spectra.iter().zip(u) {
            let weights = DVector::from_iterator(u.len(), u.iter().map(|&x| Complex::new(x, 0.0)));
            let m = &s.rows[l] * weights;
            pooled += &s.total[l] - &m * m.adjoint();
            line.push(m);
        }
        means.push(line);
        within.push(pooled);
    }
    let freedom: usize = spectra.iter().map(|s| s.repeats - 1).sum();
    let mut sum = 0.0;
    for l in 0..lines {
        let near = l.saturating_sub(NEIGHBOURS)..(l + NEIGHBOURS + 1).min(lines);
        let count = (freedom * near.len()) as f64;
        let mut v = near.fold(zero.clone(), |v, k| v + &within[k]).unscale(count);
        // A channel without noise must not make the matrix singular.
        let ridge = 1e-12 * v.diagonal().iter().map(|x| x.re).fold(0.0, f64::max) + f64::MIN_POSITIVE;
        for c in 0..channels {
            v[(c, c)] += Complex::new(ridge, 0.0);
        }
        let Some(root) = Cholesky::new(v) else {
            continue;
        };
        for m in &means[l] {
            sum += m.dotc(&root.solve(m)).re;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three motions, four repeats, two correlated channels, random-walk-like noise that grows with time.
    fn campaign(seed: u64, effect: f64) -> Vec<Motion> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut repeat = |k: usize| {
            let mut x = vec![vec![0.0; 200]; 2];
            let mut state = [0.0; 2];
            for t in 0..200 {
                let e: [f64; 2] = std::array::from_fn(|_| StandardNormal.sample(&mut rng));
                let size = 0.5 + t as f64 / 200.0;
                state = [0.9 * state[0] + e[0], 0.9 * state[1] + 0.6 * e[0] + 0.8 * e[1]];
                let phase = (0.05 * (k + 1) as f64 * t as f64).sin();
                x[0][t] = size * state[0] + effect * phase;
                x[1][t] = size * state[1] - 0.5 * effect * phase;
            }
            x
        };
        (0..3).map(|k| Motion { repeats: (0..4).map(|_| repeat(k)).collect() }).collect()
    }

    /// 300 campaigns at 5 %: standard error 1.26 points, so 2…9 % is about three of them.
    #[test]
    fn holds_its_level_and_finds_an_effect() {
        let p = |seed, effect| rotation_test(&campaign(seed, effect), 12, 99, 7).unwrap().p;
        let alarms = (0..300).filter(|&s| p(s, 0.0) <= 0.05).count();
        assert!((6..=27).contains(&alarms), "{alarms}");
        let found = (0..20).filter(|&s| p(s, 2.5) <= 0.05).count();
        assert!(found >= 18, "{found}");
    }

    /// 2400 correlated samples: the noise estimate is within 15 % of its expectation, here the one of 40 campaigns.
    #[test]
    fn scatter_separates_noise_from_error() {
        let with: Vec<Motion> = campaign(1, 3.0);
        let without = campaign(1, 0.0);
        let (a, b) = (scatter(&with).unwrap(), scatter(&without).unwrap());
        for c in 0..2 {
            // The same noise: the planted effect is common to all repeats and leaves the scatter unchanged.
            assert!((a.noise[c] - b.noise[c]).abs() < 1e-9);
            assert!(a.systematic[c] > b.systematic[c]);
        }
    }

    #[test]
    fn degenerate_input_is_an_error() {
        assert!(rotation_test(&[], 4, 9, 1).is_err());
        assert!(rotation_test(&[Motion::default()], 4, 9, 1).is_err());
        let one = Motion { repeats: vec![vec![vec![0.0; 50]]] };
        assert!(rotation_test(&[one], 4, 9, 1).is_err());
        let zero = Motion { repeats: vec![vec![vec![0.0; 50]]; 3] };
        assert_eq!(rotation_test(&[zero], 4, 9, 1).unwrap().p, 1.0);
        let ragged = Motion { repeats: vec![vec![vec![0.0; 50]], vec![vec![0.0; 49]]] };
        assert!(rotation_test(&[ragged], 4, 9, 1).is_err());
        assert!(scatter(&[]).is_none());
    }
}
