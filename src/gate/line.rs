//! Regression line of a measured on a predicted series.

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

/// Deviation of a series relative to its RMS below which it does not vary.
const VARIES: f64 = 3e-5;

impl Line {
    /// Regression line of `y` on `x`, [Gauss 1823] for one feature: slope Sxy/Sxx with the variance s²/Sxx; `None` with less
    /// than four samples or where either does not vary.
    pub fn of(x: &[f64], y: &[f64]) -> Option<Self> {
        let n = y.len() as f64;
        let (mx, my) = (x.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
        let (mut sxx, mut sxy, mut syy) = (0.0, 0.0, 0.0);
        for (x, y) in x.iter().zip(y) {
            let (x, y) = (x - mx, y - my);
            sxx += x * x;
            sxy += x * y;
            syy += y * y;
        }
        let (xx, xy, yy) = (sxx + n * mx * mx, sxy + n * mx * my, syy + n * my * my);
        let moves = |own: f64, whole: f64| own > VARIES * VARIES * whole;
        let slope = sxy / sxx;
        let is_line = y.len() >= 4 && moves(sxx, xx) && moves(syy, yy) && slope.is_finite();
        is_line.then(|| Self {
            slope,
            slope_std: ((syy - slope * sxy).max(0.0) / (n - 2.0) / sxx).sqrt(),
            offset: my - slope * mx,
            correlation: (sxy / (sxx * syy).sqrt()).clamp(-1.0, 1.0),
            unexplained: (1.0 - xy * xy / (xx * yy)).clamp(0.0, 1.0),
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
