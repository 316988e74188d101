//! Decision variables: a Fourier series as a vector, and its basis on a grid over one period.

use nalgebra::Vector3;

use crate::kinematics::PlatformState;
use crate::scenario::FourierMotion;

/// Coordinates of the end effector: x, y, z (m) and ψ (rad).
pub const COORDINATES: usize = 4;
/// Number of inputs of a sample: position, velocity and acceleration of each coordinate.
pub const INPUTS: usize = 3 * COORDINATES;
/// Reciprocal of the resolution of written coefficients: a micrometre, a microradian.
const DECIMALS: f64 = 1e6;

/// Values and time derivatives of 1, sin(kωt), cos(kωt) at equally spaced instants of one period.
///
/// A coordinate is the product of a row with its coefficients, so the row is the derivative of position, velocity or
/// acceleration with respect to the coefficients.
pub struct Basis {
    frequency: f64,
    harmonics: usize,
    /// `[instant][derivative][function]`.
    rows: Vec<[Vec<f64>; 3]>,
}

impl Basis {
    /// Basis for a base frequency (Hz), `harmonics` harmonics and `instants` instants.
    pub fn new(frequency: f64, harmonics: usize, instants: usize) -> Self {
        let row = |k: usize| {
            let phase = std::f64::consts::TAU * k as f64 / instants as f64;
            let mut row = [vec![1.0], vec![0.0], vec![0.0]];
            for h in 1..=harmonics {
                let omega = std::f64::consts::TAU * frequency * h as f64;
                let (s, c) = (h as f64 * phase).sin_cos();
                row[0].extend([s, c]);
                row[1].extend([omega * c, -omega * s]);
                row[2].extend([-omega * omega * s, -omega * omega * c]);
            }
            row
        };
        Self { frequency, harmonics, rows: (0..instants).map(row).collect() }
    }

    /// Number of instants.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether there are no instants.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Number of coefficients per coordinate.
    pub fn functions(&self) -> usize {
        1 + 2 * self.harmonics
    }

    /// Number of decision variables.
    pub fn variables(&self) -> usize {
        COORDINATES * self.functions()
    }

    /// Platform state at `instant` for the decision variables `x`.
    pub fn state(&self, instant: usize, x: &[f64]) -> PlatformState {
        let n = self.functions();
        let value = |derivative: usize, coordinate: usize| {
            let row = &self.rows[instant][derivative];
            row.iter().zip(&x[coordinate * n..][..n]).map(|(b, c)| b * c).sum::<f64>()
        };
        let vector = |d: usize| Vector3::new(value(d, 0), value(d, 1), value(d, 2));
        PlatformState {
            position: vector(0),
            velocity: vector(1),
            acceleration: vector(2),
            psi: [value(0, 3), value(1, 3), value(2, 3)],
        }
    }

    /// Adds `factor` times the gradient with respect to the decision variables, given the gradient `inputs` with
    /// respect to the state.
    pub fn pull_back(&self, instant: usize, inputs: &[f64; INPUTS], factor: f64, gradient: &mut [f64]) {
        let n = self.functions();
        for coordinate in 0..COORDINATES {
            for derivative in 0..3 {
                let slope = factor * inputs[3 * coordinate + derivative];
                if slope != 0.0 {
                    let row = &self.rows[instant][derivative];
                    for (g, b) in gradient[coordinate * n..][..n].iter_mut().zip(row) {
                        *g += slope * b;
                    }
                }
            }
        }
    }

    /// Decision variables of a series: per coordinate the centre, then sine and cosine of every harmonic.
    pub fn vector(&self, motion: &FourierMotion) -> Vec<f64> {
        let mut x = Vec::with_capacity(self.variables());
        for i in 0..COORDINATES {
            x.push(motion.centre[i]);
            for h in 0..self.harmonics {
                x.push(motion.sine.get(h).map_or(0.0, |a| a[i]));
                x.push(motion.cosine.get(h).map_or(0.0, |b| b[i]));
            }
        }
        x
    }

    /// Fourier series with the decision variables `x`.
    pub fn motion(&self, x: &[f64]) -> FourierMotion {
        let n = self.functions();
        let all = |offset: usize| {
            (0..self.harmonics).map(|h| std::array::from_fn(|i| x[i * n + 1 + 2 * h + offset])).collect()
        };
        FourierMotion {
            frequency: self.frequency,
            centre: std::array::from_fn(|i| x[i * n]),
            sine: all(0),
            cosine: all(1),
        }
    }
}

/// `motion` with its amplitude about the centre scaled by `factor` and all numbers rounded for the file.
pub fn scaled(motion: &FourierMotion, factor: f64) -> FourierMotion {
    let round = |v: f64| (v * DECIMALS).round() / DECIMALS;
    let rows = |rows: &[[f64; 4]]| rows.iter().map(|r| r.map(|v| round(factor * v))).collect();
    FourierMotion {
        frequency: motion.frequency,
        centre: motion.centre.map(round),
        sine: rows(&motion.sine),
        cosine: rows(&motion.cosine),
    }
}

/// State with input `i` (3·coordinate + derivative) changed by `step`.
pub fn moved(state: &PlatformState, i: usize, step: f64) -> PlatformState {
    let mut state = *state;
    let (coordinate, derivative) = (i / 3, i % 3);
    if coordinate == 3 {
        state.psi[derivative] += step;
    } else {
        let target = [&mut state.position, &mut state.velocity, &mut state.acceleration];
        target[derivative][coordinate] += step;
    }
    state
}
