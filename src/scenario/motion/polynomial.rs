//! Piecewise polynomials in time of four coordinates.

use nalgebra::Vector4;

/// Coefficients of one piece, Σₖ cₖ uᵏ with u = time since its start, s.
pub(super) type Coefficients = [Vector4<f64>; 6];

/// Sequence of polynomials of degree at most five; (x, y, z, ψ) in m, rad or (φ1, φ2, φ3, ψ) in rad.
///
/// Before its start it is constant at the first value. The builders join pieces with equal value, rate and
/// acceleration.
#[derive(Clone, Debug, PartialEq)]
pub struct Piecewise {
    starts: Vec<f64>,
    pieces: Vec<Coefficients>,
    lap: f64,
    laps: usize,
    first: Vector4<f64>,
    last: Vector4<f64>,
    /// Rate after the end, 1/s.
    drift: Vector4<f64>,
}

impl Piecewise {
    /// An empty sequence, constant at `value`.
    pub(super) fn new(value: Vector4<f64>) -> Self {
        let (starts, pieces) = (Vec::new(), Vec::new());
        Self { starts, pieces, lap: 0.0, laps: 1, first: value, last: value, drift: Vector4::zeros() }
    }

    /// Appends a piece of `duration` s.
    pub(super) fn push(&mut self, duration: f64, coefficients: Coefficients) {
        // Shorter pieces have no influence.
        if duration > 1e-12 {
            self.starts.push(self.lap);
            self.pieces.push(coefficients);
            self.lap += duration;
            self.last = evaluate(&coefficients, duration)[0];
        }
    }

    /// Appends a constant piece of `duration` s.
    pub(super) fn rest(&mut self, duration: f64) {
        let mut coefficients = [Vector4::zeros(); 6];
        coefficients[0] = self.last;
        self.push(duration, coefficients);
    }

    /// The sequence `laps` times in succession; it must end at its first value.
    pub(super) fn repeated(self, laps: usize) -> Self {
        Self { laps: laps.max(1), ..self }
    }

    /// The sequence continued beyond its end with the final rate.
    pub(super) fn drifting(mut self) -> Self {
        if let Some((start, piece)) = self.starts.last().zip(self.pieces.last()) {
            self.drift = evaluate(piece, self.lap - start)[1];
        }
        self
    }

    /// Duration of one lap, s.
    pub fn lap(&self) -> f64 {
        self.lap
    }

    /// Duration of all laps, s.
    pub fn length(&self) -> f64 {
        self.lap * self.laps as f64
    }

    /// Value, rate and acceleration at time `t` (s).
    pub fn at(&self, t: f64) -> [Vector4<f64>; 3] {
        let zero = Vector4::zeros();
        if t.is_nan() || t < 0.0 {
            return [self.first, zero, zero];
        }
        if t >= self.length() {
            return [self.last + self.drift * (t - self.length()), self.drift, zero];
        }
        let t = t % self.lap;
        let i = self.starts.partition_point(|&start| start <= t).saturating_sub(1);
        evaluate(&self.pieces[i], t - self.starts[i])
    }

    /// Duration (s) and coefficients of every piece of a lap.
    pub fn pieces(&self) -> impl Iterator<Item = (f64, &[Vector4<f64>; 6])> {
        let ends = self.starts.iter().skip(1).copied().chain([self.lap]);
        self.starts.iter().zip(ends).map(|(start, end)| end - start).zip(&self.pieces)
    }

    /// Start times of the pieces, s.
    #[cfg(test)]
    pub(super) fn joints(&self) -> &[f64] {
        &self.starts
    }
}

fn evaluate(c: &Coefficients, u: f64) -> [Vector4<f64>; 3] {
    let (mut value, mut rate, mut half) = (c[5], Vector4::zeros(), Vector4::zeros());
    for k in (0..5).rev() {
        half = half * u + rate;
        rate = rate * u + value;
        value = value * u + c[k];
    }
    [value, rate, half * 2.0]
}

/// Quintic of `duration` s between two values with given rates and accelerations.
pub(super) fn quintic(duration: f64, from: [Vector4<f64>; 3], to: [Vector4<f64>; 3]) -> Coefficients {
    let h = duration;
    let d = to[0] - from[0];
    // Rates and accelerations scaled to displacements over the piece.
    let (v0, v1) = (from[1] * h, to[1] * h);
    let (a0, a1) = (from[2] * (h * h), to[2] * (h * h));
    [
        from[0],
        from[1],
        from[2] * 0.5,
        (d * 20.0 - v1 * 8.0 - v0 * 12.0 - a0 * 3.0 + a1) / (2.0 * h.powi(3)),
        (d * -30.0 + v1 * 14.0 + v0 * 16.0 + a0 * 3.0 - a1 * 2.0) / (2.0 * h.powi(4)),
        (d * 12.0 - (v1 + v0) * 6.0 + a1 - a0) / (2.0 * h.powi(5)),
    ]
}
