//! Geometric paths r(s) = (x, y, z, ψ): polynomials in s, three times continuously differentiable.

use nalgebra::Vector4;

/// Number of coefficients of a piece: degree seven.
const TERMS: usize = 8;

/// A path over s from 0 to [`Curve::end`], m and rad.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    starts: Vec<f64>,
    pieces: Vec<[Vector4<f64>; TERMS]>,
    end: f64,
}

impl Curve {
    /// Pieces with their lengths in s; coefficients are of powers of s from the start of the piece.
    pub(super) fn new(pieces: impl IntoIterator<Item = (f64, Vec<Vector4<f64>>)>) -> Self {
        let mut out = Self { starts: Vec::new(), pieces: Vec::new(), end: 0.0 };
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

    /// The coordinates multiplied by `factors`.
    #[must_use]
    pub(super) fn scaled(mut self, factors: &Vector4<f64>) -> Self {
        self.pieces.iter_mut().flatten().for_each(|term| term.component_mul_assign(factors));
        self
    }

    /// Largest s.
    pub fn end(&self) -> f64 {
        self.end
    }

    /// Value and three derivatives by s.
    pub fn at(&self, s: f64) -> [Vector4<f64>; 4] {
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

    /// Where pieces meet, both ends included.
    pub fn knots(&self) -> impl Iterator<Item = f64> + '_ {
        self.starts.iter().copied().chain([self.end])
    }
}
