//! Brackets of a number: an interval at whose lower end a condition holds and at whose upper end it does not.

use std::convert::Infallible;

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
