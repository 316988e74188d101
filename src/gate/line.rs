//! Regression line of a measured on a predicted series.

use crate::identification::least_squares::least_squares;
use crate::identification::residuals::rms;
use crate::numerics::deviation;

/// Linear regression of a measured on a predicted series: measured ≈ offset + slope · predicted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// Slope.
    pub slope: f64,
    /// Standard error of the slope.
    pub slope_std: f64,
    /// Offset in the unit of the series.
    pub offset: f64,
    /// Correlation coefficient.
    pub correlation: f64,
    /// Share of the measured mean square, mean included, that no multiple of the predicted series explains.
    pub unexplained: f64,
}

impl Line {
    /// Regression line of `y` on `x`; `None` where either does not vary.
    pub fn of(x: &[f64], y: &[f64]) -> Option<Self> {
        let ones = vec![1.0; x.len()];
        let fit = least_squares(&[&ones, x], y)?;
        let [sx, sy] = [x, y].map(deviation);
        let (slope, correlation) = (fit.beta[1], fit.beta[1] * sx / sy);
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let unexplained = 1.0 - dot(x, y).powi(2) / (dot(x, x) * dot(y, y)).max(f64::MIN_POSITIVE);
        let moves = sx > 1e-9 * rms(x) && sy > 1e-9 * rms(y);
        (moves && correlation.is_finite()).then(|| Self {
            slope,
            slope_std: fit.std[1],
            offset: fit.beta[0],
            correlation: correlation.clamp(-1.0, 1.0),
            unexplained: unexplained.clamp(0.0, 1.0),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Worked by hand: x = 0, 1, 2, 3 and y = 1, 3, 2, 4 have slope 0.8, offset 1.3, correlation 0.8, Σr² = 1.8.
    #[test]
    fn a_line_worked_by_hand() {
        let line = Line::of(&[0.0, 1.0, 2.0, 3.0], &[1.0, 3.0, 2.0, 4.0]).unwrap();
        assert!((line.slope - 0.8).abs() < 1e-12 && (line.offset - 1.3).abs() < 1e-12, "{line:?}");
        assert!((line.correlation - 0.8).abs() < 1e-12, "{line:?}");
        // 1 − (Σxy)²/(Σx²·Σy²) = 1 − 19²/(14·30)
        assert!((line.unexplained - (1.0 - 361.0 / 420.0)).abs() < 1e-12, "{line:?}");
        // s² = 1.8/2, over Σ(x − 1.5)² = 5
        assert!((line.slope_std - (0.9f64 / 5.0).sqrt()).abs() < 1e-12, "{line:?}");
        assert_eq!(Line::of(&[1.0; 8], &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]), None);
    }
}
