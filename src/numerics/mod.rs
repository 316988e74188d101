//! Median, standard deviation and spectrum of a series, bisection for the value at which a condition becomes false,
//! fixed points, the elementary functions of the twin's innermost loop, and work on all cores.

mod anderson;
mod elementary;
pub mod fourier;
pub mod parallel;

use std::convert::Infallible;

pub use anderson::Anderson;
pub use elementary::{sin_cos, tanh};

use statrs::statistics::{Data, OrderStatistics};

/// Median of `values`: the mean of the middle two for an even number, NaN without values.
pub fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    Data::new(values.into_iter().collect::<Vec<f64>>()).median()
}

/// Standard deviation of `values` about their mean, with the divisor n; zero without values.
pub fn deviation(values: &[f64]) -> f64 {
    let count = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / count;
    (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / count).sqrt()
}

/// `angle` plus the full turns of `near`, rad.
pub fn with_turns(angle: f64, near: f64) -> f64 {
    angle + std::f64::consts::TAU * ((near - angle) / std::f64::consts::TAU).round()
}

/// The larger magnitude of two errors; NaN if one of them is NaN, which `f64::max` drops.
pub fn worst(a: f64, b: f64) -> f64 {
    let (a, b) = (a.abs(), b.abs());
    if a < b || b.is_nan() { b } else { a }
}

/// Subinterval of `bracket` after a number of `halvings`, around the largest value at which `holds` is true.
///
/// `holds` is assumed to be true at the lower end and false from some value to the upper end; it is not evaluated at
/// the ends.
pub fn bisect(bracket: [f64; 2], halvings: usize, mut holds: impl FnMut(f64) -> bool) -> [f64; 2] {
    let Ok(ends) = try_bisect(bracket, halvings, |x| Ok::<_, Infallible>(holds(x)));
    ends
}

/// Subinterval as in [`bisect`], for a condition that may return an error.
///
/// # Errors
/// The first error of `holds`.
pub fn try_bisect<E>(
    [mut low, mut high]: [f64; 2],
    halvings: usize,
    mut holds: impl FnMut(f64) -> Result<bool, E>,
) -> Result<[f64; 2], E> {
    for _ in 0..halvings {
        let middle = 0.5 * (low + high);
        if holds(middle)? { low = middle } else { high = middle }
    }
    Ok([low, high])
}

/// Number of halvings after which an interval of `width` is not wider than `tolerance`, in the same unit.
pub fn halvings(width: f64, tolerance: f64) -> usize {
    (width / tolerance).log2().ceil() as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_error_is_the_one_that_is_not_a_number() {
        assert_eq!([worst(-3.0, 1.0), worst(1.0, -3.0), worst(0.0, f64::NEG_INFINITY)], [3.0, 3.0, f64::INFINITY]);
        for errors in [[f64::NAN, 1.0, 2.0], [1.0, f64::NAN, 2.0], [1.0, 2.0, f64::NAN]] {
            assert!(errors.into_iter().fold(0.0, worst).is_nan(), "{errors:?}");
        }
    }

    #[test]
    fn medians_by_hand() {
        assert_eq!((median([3.0, 1.0, 2.0]), median([4.0, 1.0, 2.0, 3.0])), (2.0, 2.5));
        assert!(median([]).is_nan());
    }

    #[test]
    fn the_root_of_two_is_between_the_ends() {
        assert_eq!((halvings(1.0, 0.25), halvings(1.0, 2.0)), (2, 0));
        let [low, high] = bisect([1.0, 2.0], halvings(1.0, 1e-9), |x| x * x < 2.0);
        assert!(low * low < 2.0 && high * high >= 2.0 && high - low <= 1e-9, "{low} {high}");
        assert_eq!(try_bisect([0.0, 1.0], 3, |x| if x > 0.6 { Err(x) } else { Ok(true) }), Err(0.75));
    }
}
