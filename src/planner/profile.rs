//! Profile z(s) = ṡ² between the grid points, and the time along it (45).

use nalgebra::Vector3;

/// z over one interval of s; σ is measured from its start, h is its length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Piece {
    /// z = z₀ + 2bσ + cσ²: s̈ = b + cσ.
    Quadratic {
        /// z at the start.
        z: f64,
        /// s̈ at the start.
        b: f64,
        /// ds̈/ds.
        c: f64,
    },
    /// From rest with constant s⃛: z = z₁ (σ/h)^(4/3).
    Departure {
        /// z at the end.
        z: f64,
    },
    /// To rest with constant s⃛: z = z₀ ((h − σ)/h)^(4/3).
    Arrival {
        /// z at the start.
        z: f64,
    },
}

/// z, s̈ and s⃛ at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pace {
    /// ṡ², 1/s².
    pub z: f64,
    /// s̈, 1/s².
    pub acceleration: f64,
    /// s⃛, 1/s³.
    pub jerk: f64,
}

/// z along an entire path.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// Path parameter of the grid points, ascending.
    pub s: Vec<f64>,
    /// One piece per interval.
    pub pieces: Vec<Piece>,
}

impl Profile {
    /// Profile with z linear between the grid points.
    pub fn linear(s: &[f64], z: &[f64]) -> Self {
        let piece = |i: usize| Piece::Quadratic { z: z[i], b: 0.5 * (z[i + 1] - z[i]) / (s[i + 1] - s[i]), c: 0.0 };
        Self { s: s.to_vec(), pieces: (0..s.len() - 1).map(piece).collect() }
    }

    /// Profile with s̈ linear between the grid points and constant s⃛ at both ends of the path; `acceleration` at the
    /// grid points.
    pub fn quadratic(s: &[f64], z: &[f64], acceleration: &[f64]) -> Self {
        let n = s.len() - 1;
        let piece = |i: usize| match i {
            0 => Piece::Departure { z: z[1] },
            i if i + 1 == n => Piece::Arrival { z: z[i] },
            i => Piece::Quadratic {
                z: z[i],
                b: acceleration[i],
                c: (acceleration[i + 1] - acceleration[i]) / (s[i + 1] - s[i]),
            },
        };
        Self { s: s.to_vec(), pieces: (0..n).map(piece).collect() }
    }

    /// Profile with s̈ linear between the grid points, ends included; `acceleration` at the grid points.
    pub fn smooth(s: &[f64], z: &[f64], acceleration: &[f64]) -> Self {
        let slope = |i: usize| (acceleration[i + 1] - acceleration[i]) / (s[i + 1] - s[i]);
        let piece = |i: usize| Piece::Quadratic { z: z[i], b: acceleration[i], c: slope(i) };
        Self { s: s.to_vec(), pieces: (0..s.len() - 1).map(piece).collect() }
    }

    fn length(&self, i: usize) -> f64 {
        self.s[i + 1] - self.s[i]
    }

    /// z, s̈ and s⃛ at σ from the start of interval `i`.
    pub fn at(&self, i: usize, sigma: f64) -> Pace {
        let h = self.length(i);
        // z = z₁ x^(4/3), s̈ = (2/3) z₁/h x^(1/3), s⃛ = (2/9) z₁^(3/2)/h².
        let ramp = |z: f64, x: f64, sign: f64| Pace {
            z: z * x.cbrt().powi(4),
            acceleration: sign * 2.0 / 3.0 * z / h * x.cbrt(),
            jerk: 2.0 / 9.0 * z.powf(1.5) / (h * h),
        };
        match self.pieces[i] {
            Piece::Quadratic { z, b, c } => {
                let z = (z + (2.0 * b + c * sigma) * sigma).max(0.0);
                Pace { z, acceleration: b + c * sigma, jerk: c * z.sqrt() }
            }
            Piece::Departure { z } => ramp(z, (sigma / h).clamp(0.0, 1.0), 1.0),
            Piece::Arrival { z } => ramp(z, (1.0 - sigma / h).clamp(0.0, 1.0), -1.0),
        }
    }

    /// z, s̈ and s⃛ at `s`.
    pub fn pace(&self, s: f64) -> Pace {
        let i = self.s.partition_point(|&x| x <= s).saturating_sub(1).min(self.pieces.len() - 1);
        self.at(i, s - self.s[i])
    }

    /// Whether z vanishes between the ends of the path.
    pub fn stalls(&self) -> bool {
        let n = self.pieces.len();
        self.pieces.iter().enumerate().any(|(i, piece)| match *piece {
            Piece::Departure { z } | Piece::Arrival { z } => z <= 0.0,
            Piece::Quadratic { z, b, c } => {
                let lowest = -b / c;
                let dips = c > 0.0 && lowest > 0.0 && lowest < self.length(i) && z - b * b / c <= 0.0;
                dips || (i > 0 && z <= 0.0) || (i + 1 < n && self.at(i, self.length(i)).z <= 0.0)
            }
        })
    }

    /// Time over interval `i`, s.
    pub fn duration(&self, i: usize) -> f64 {
        let h = self.length(i);
        match self.pieces[i] {
            Piece::Departure { z } | Piece::Arrival { z } => 3.0 * h / z.sqrt(),
            Piece::Quadratic { z, b, c } => {
                let end = self.at(i, h).z;
                let guess = 2.0 * h / (z.sqrt() + end.sqrt());
                if c == 0.0 {
                    return guess;
                }
                let mut t = guess;
                for _ in 0..20 {
                    let x = travel(z.sqrt(), b, c, t);
                    let step = (x[0] - h) / x[1];
                    t -= step;
                    if step.abs() <= 1e-15 * t {
                        break;
                    }
                }
                t
            }
        }
    }

    /// Time over the whole path, s.
    pub fn time(&self) -> f64 {
        (0..self.pieces.len()).map(|i| self.duration(i)).sum()
    }

    /// s, ṡ and s̈ at ascending times in s; at rest before and after the motion.
    pub fn sample(&self, times: impl IntoIterator<Item = f64>) -> Vec<[f64; 3]> {
        let durations: Vec<f64> = (0..self.pieces.len()).map(|i| self.duration(i)).collect();
        let (mut i, mut start) = (0, 0.0);
        let mut out = Vec::new();
        for t in times {
            while i < durations.len() && t >= start + durations[i] {
                start += durations[i];
                i += 1;
            }
            out.push(match self.pieces.get(i) {
                None => [self.s[self.s.len() - 1], 0.0, 0.0],
                Some(piece) => {
                    let (t, h) = ((t - start).max(0.0), self.length(i));
                    // Constant s⃛ = (2/9) z^(3/2)/h² from the end at rest.
                    let ramp = |z: f64, t: f64| {
                        let j = 2.0 / 9.0 * z.powf(1.5) / (h * h);
                        Vector3::new(j * t.powi(3) / 6.0, 0.5 * j * t * t, j * t)
                    };
                    match *piece {
                        Piece::Quadratic { z, b, c } => {
                            let x = travel(z.max(0.0).sqrt(), b, c, t);
                            [self.s[i] + x[0], x[1], x[2]]
                        }
                        Piece::Departure { z } => {
                            let x = ramp(z, t);
                            [self.s[i] + x[0], x[1], x[2]]
                        }
                        Piece::Arrival { z } => {
                            let x = ramp(z, durations[i] - t);
                            [self.s[i + 1] - x[0], x[1], -x[2]]
                        }
                    }
                }
            });
        }
        out
    }
}

/// σ, σ̇ and σ̈ at time `t` for σ̈ = b + cσ, σ(0) = 0, σ̇(0) = `speed`.
fn travel(speed: f64, b: f64, c: f64, t: f64) -> Vector3<f64> {
    // S = sinh(kt)/k and C = (cosh(kt) − 1)/k², k² = c; sine and cosine for c < 0, power series for small c t².
    let x = c * t * t;
    let (s, half) = if x.abs() < 1e-3 {
        let s = t * (1.0 + x / 6.0 * (1.0 + x / 20.0 * (1.0 + x / 42.0)));
        (s, t * t * (0.5 + x / 24.0 * (1.0 + x / 30.0 * (1.0 + x / 56.0))))
    } else {
        let k = c.abs().sqrt();
        let turn = k * t;
        let (sine, half) = if c > 0.0 { (turn.sinh(), (0.5 * turn).sinh()) } else { (turn.sin(), (0.5 * turn).sin()) };
        (sine / k, 2.0 * half * half / (k * k))
    };
    let sigma = speed * s + b * half;
    Vector3::new(sigma, speed * (1.0 + c * half) + b * s, b + c * sigma)
}
