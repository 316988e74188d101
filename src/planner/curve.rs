//! Geometric paths r(s) = (x, y, z, ψ): polynomials in s, three times continuously differentiable.

use nalgebra::Vector4;

use crate::numerics::bisect;

/// Number of coefficients of a piece of degree seven.
const TERMS: usize = 8;
/// Bisection steps that determine a parameter to rounding.
const HALVINGS: usize = 60;

/// Path r(s) over s from 0 to [`Curve::end`], m and rad.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    starts: Vec<f64>,
    pieces: Vec<[Vector4<f64>; TERMS]>,
    end: f64,
    eased: bool,
}

impl Curve {
    /// Curve of pieces with their lengths in s; coefficients belong to powers of s from the start of the piece.
    pub(super) fn new(pieces: impl IntoIterator<Item = (f64, Vec<Vector4<f64>>)>) -> Self {
        let mut out = Self { starts: Vec::new(), pieces: Vec::new(), end: 0.0, eased: false };
        for (length, terms) in pieces {
            if length > 1e-12 {
                out.starts.push(out.end);
                out.pieces.push(std::array::from_fn(|k| terms.get(k).copied().unwrap_or_default()));
                out.end += length;
            }
        }
        out
    }

    /// The same path with s from 0 to `end`.
    #[must_use]
    pub fn rescaled(mut self, end: f64) -> Self {
        let k = end / self.end;
        self.starts.iter_mut().for_each(|s| *s *= k);
        for piece in &mut self.pieces {
            let mut factor = 1.0;
            for term in piece {
                *term *= factor;
                factor /= k;
            }
        }
        self.end = end;
        self
    }

    /// The path with the coordinates multiplied by `factors`.
    #[must_use]
    pub(super) fn scaled(mut self, factors: &Vector4<f64>) -> Self {
        self.pieces.iter_mut().flatten().for_each(|term| term.component_mul_assign(factors));
        self
    }

    /// Largest s.
    pub fn end(&self) -> f64 {
        self.end
    }

    /// The path over a parameter x with s = g(x), x from 0 to the same end, whose ds/dx vanishes at the ends of the
    /// path.
    ///
    /// g = E (10u³ − 15u⁴ + 6u⁵), u = x/E: a motion from rest to rest with s ∝ t³ at both ends has ẋ > 0 throughout,
    /// and smooth functions of time are smooth functions of x. Intervals of x therefore resolve a jerk-limited
    /// departure of any duration.
    #[must_use]
    pub fn eased(mut self) -> Self {
        self.eased = true;
        self
    }

    /// Whether the parameter is x instead of s.
    pub fn is_eased(&self) -> bool {
        self.eased
    }

    /// s at parameter `x`, and its first three derivatives with respect to the parameter.
    pub fn way(&self, x: f64) -> [f64; 4] {
        if !self.eased {
            return [x, 1.0, 0.0, 0.0];
        }
        let (e, u) = (self.end, x / self.end);
        let v = 1.0 - u;
        [
            e * u.powi(3) * (10.0 - 15.0 * u + 6.0 * u * u),
            30.0 * (u * v).powi(2),
            60.0 * u * v * (v - u) / e,
            (60.0 - 360.0 * u * v) / (e * e),
        ]
    }

    /// Parameter x at `s`.
    fn parameter(&self, s: f64) -> f64 {
        if !self.eased {
            return s;
        }
        let [low, high] = bisect([0.0, self.end], HALVINGS, |x| self.way(x)[0] < s);
        0.5 * (low + high)
    }

    /// r at parameter `x` and its first three derivatives with respect to the parameter; m, rad.
    pub fn at(&self, x: f64) -> [Vector4<f64>; 4] {
        let [s, g1, g2, g3] = self.way(x);
        let [r, r1, r2, r3] = self.by_s(s);
        [r, r1 * g1, r2 * (g1 * g1) + r1 * g2, r3 * g1.powi(3) + r2 * (3.0 * g1 * g2) + r1 * g3]
    }

    /// r at `s` and its first three derivatives with respect to s; m, rad.
    fn by_s(&self, s: f64) -> [Vector4<f64>; 4] {
        let i = self.starts.partition_point(|&start| start <= s).saturating_sub(1);
        let Some(c) = self.pieces.get(i) else { return [Vector4::zeros(); 4] };
        let u = s - self.starts[i];
        // Horner's scheme for value, r′, r″/2 and r‴/6 at once.
        let mut d = [c[TERMS - 1], Vector4::zeros(), Vector4::zeros(), Vector4::zeros()];
        for k in (0..TERMS - 1).rev() {
            d = [d[0] * u + c[k], d[1] * u + d[0], d[2] * u + d[1], d[3] * u + d[2]];
        }
        [d[0], d[1], d[2] * 2.0, d[3] * 6.0]
    }

    /// Parameters at which pieces meet, both ends included.
    pub fn knots(&self) -> impl Iterator<Item = f64> + '_ {
        std::iter::once(0.0).chain(self.starts.iter().skip(1).map(|&s| self.parameter(s))).chain([self.end])
    }
}
