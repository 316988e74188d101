//! Medians, and bisection: where along an interval a condition ceases to hold.

use std::convert::Infallible;

use statrs::statistics::{Data, OrderStatistics};

/// Median, of an even number of values the mean of the middle two; NaN of nothing.
pub fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    Data::new(values.into_iter().collect::<Vec<f64>>()).median()
}

/// `bracket` halved so many times, about the value from which on `holds` no longer does.
///
/// It holds at the lower end and, once not, never again; the ends themselves are not asked.
pub fn bisect(bracket: [f64; 2], halvings: usize, mut holds: impl FnMut(f64) -> bool) -> [f64; 2] {
    let Ok(ends) = try_bisect(bracket, halvings, |x| Ok::<_, Infallible>(holds(x)));
    ends
}

/// The same of a condition that may fail.
///
/// # Errors
///
/// The first failure of `holds`.
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

/// Halvings after which an interval of `width` is no wider than `tolerance`.
pub fn halvings(width: f64, tolerance: f64) -> usize {
    (width / tolerance).log2().ceil() as usize
}

#[cfg(test)]
mod tests {
    use super::*;

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
