//! Where the margin along a ray is zero.

/// Interval of a ray at whose ends the margin has different signs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Largest known share of the ray with a margin of at least zero; `None` if it is negative at the start.
    pub low: Option<f64>,
    /// Smallest known share beyond it with a negative margin; `None` if it is nowhere.
    pub high: Option<f64>,
    /// Share of the ray at which the margin is zero, interpolated between `low` and `high`; 0 or 1 without a crossing.
    pub at: f64,
    /// Number of margins computed.
    pub evaluations: u32,
    /// Share of the ray from which the margin rises to the next one computed; `None` if it falls throughout.
    pub rises: Option<f64>,
}

/// Number of margins between start and end of a ray that are computed in any case: a failure between two that hold, and
/// a margin that rises, would otherwise not be seen.
const CHECKS: usize = 3;

/// Exponent and factor of the truncation of the ITP method.
const POWER: f64 = 2.0;
const FACTOR: f64 = 0.2;

/// Locates the first zero of a margin along a ray from 0 to 1 within `tolerance`: the first between margins at
/// [`CHECKS`] places of equal distance, at the start and at the end.
///
/// The ITP method [Oliveira and Takahashi 2021] takes the secant's point, moved towards the middle so far that there are
/// never more evaluations than one above those of bisection. An error of `margin` ends the search.
pub fn crossing<E>(tolerance: f64, mut margin: impl FnMut(f64) -> Result<f64, E>) -> Result<Crossing, E> {
    let start = margin(0.0)?;
    if start < 0.0 {
        return Ok(Crossing { low: None, high: Some(0.0), at: 0.0, evaluations: 1, rises: None });
    }
    let mut known = vec![(0.0, start)];
    for k in 1..=CHECKS + 1 {
        let at = k as f64 / (CHECKS + 1) as f64;
        known.push((at, margin(at)?));
    }
    let found = match known.iter().position(|(_, value)| *value < 0.0) {
        None => None,
        Some(first) => Some(between([known[first - 1], known[first]], tolerance, &mut known, margin)?),
    };
    known.sort_by(|a, b| a.0.total_cmp(&b.0));
    let rises = |w: &&[(f64, f64)]| w[1].1 > w[0].1 + ROUNDING * (1.0 + w[0].1.abs());
    let rises = known.windows(2).find(rises).map(|w| w[0].0);
    let evaluations = known.len() as u32;
    let Some([low, high]) = found else {
        return Ok(Crossing { low: Some(1.0), high: None, at: 1.0, evaluations, rises });
    };
    let share = if high.1.is_finite() { low.1 / (low.1 - high.1) } else { 0.5 };
    let at = low.0 + share * (high.0 - low.0);
    Ok(Crossing { low: Some(low.0), high: Some(high.0), at, evaluations, rises })
}

/// Narrows an interval with margins of different signs at its ends (place, margin) to `tolerance`; adds all margins to
/// `known`.
fn between<E>(
    [mut low, mut high]: [(f64, f64); 2],
    tolerance: f64,
    known: &mut Vec<(f64, f64)>,
    mut margin: impl FnMut(f64) -> Result<f64, E>,
) -> Result<[(f64, f64); 2], E> {
    let half = 0.5 * tolerance;
    // One evaluation more than bisection at most.
    let most = ((high.0 - low.0) / tolerance).log2().ceil().max(0.0) + 1.0;
    let mut step = 0.0;
    while high.0 - low.0 > tolerance {
        let width = high.0 - low.0;
        let middle = 0.5 * (low.0 + high.0);
        let radius = half * f64::powf(2.0, most - step) - 0.5 * width;
        // An infinite margin has no secant.
        let secant = (low.1 * high.0 - high.1 * low.0) / (low.1 - high.1);
        let secant = if secant.is_finite() { secant } else { middle };
        let towards = (middle - secant).signum();
        let truncated = if FACTOR * width.powf(POWER) <= (middle - secant).abs() {
            secant + towards * FACTOR * width.powf(POWER)
        } else {
            middle
        };
        let at = if (truncated - middle).abs() <= radius { truncated } else { middle - towards * radius };
        let value = margin(at)?;
        known.push((at, value));
        if value < 0.0 {
            high = (at, value);
        } else {
            low = (at, value);
        }
        step += 1.0;
    }
    Ok([low, high])
}

/// Rise of a margin that counts as rounding, relative to one plus its size.
const ROUNDING: f64 = 1e-9;

#[cfg(test)]
mod tests {
    use super::*;

    fn of(tolerance: f64, margin: impl Fn(f64) -> f64) -> Crossing {
        crossing(tolerance, |s| Ok::<f64, ()>(margin(s))).unwrap()
    }

    #[test]
    fn zeros_are_found_in_fewer_evaluations_than_by_bisection() {
        for zero in [1e-4, 0.1, 0.3, 0.777, 0.9999] {
            let straight = of(1e-6, |s| zero - s);
            assert!(
                (straight.at - zero).abs() < 1e-6 && straight.rises.is_none() && straight.evaluations <= 11,
                "{straight:?}"
            );
            let curved = of(1e-6, |s| 1.0 - (s / zero).powi(2));
            // The steeper, the more like a step.
            let most = if zero < 0.01 { 24 } else { 17 };
            assert!((curved.at - zero).abs() < 1e-6 && curved.evaluations <= most, "{curved:?}");
            // A step has no slope to follow: as many evaluations as bisection, and one, both ends, and the checks.
            let step = of(1e-6, |s| if s < zero { 1.0 } else { -1.0 });
            assert!((step.at - zero).abs() < 1e-6 && step.evaluations <= 24, "{step:?}");
            assert!(step.low.unwrap() < zero && step.high.unwrap() >= zero);
        }
    }

    #[test]
    fn rays_without_a_crossing_say_so() {
        let weak = of(1e-3, |s| -s - 0.1);
        assert_eq!((weak.low, weak.high, weak.at, weak.evaluations), (None, Some(0.0), 0.0, 1));
        let strong = of(1e-3, |s| 1.0 - 0.5 * s);
        assert_eq!((strong.low, strong.high, strong.at, strong.rises), (Some(1.0), None, 1.0, None));
        let rising = of(1e-3, |s| if s < 0.3 { 0.1 + s } else { 0.5 - s });
        assert_eq!(rising.rises, Some(0.0));
        assert!((rising.at - 0.5).abs() < 1e-3, "{rising:?}");
        let infinite = of(1e-3, |s| if s < 0.4 { 0.4 - s } else { f64::NEG_INFINITY });
        assert!((infinite.at - 0.4).abs() < 1e-3);
        assert_eq!(crossing(0.1, |_| Err::<f64, i32>(7)), Err(7));
    }

    /// Both ends hold and what lies between does not: the robot fails at a middle speed, where the motion meets a
    /// resonance.
    #[test]
    fn a_failure_between_two_that_hold_is_found_and_told() {
        let valley = of(1e-4, |s| (s - 0.3) * (s - 0.62));
        assert!((valley.at - 0.3).abs() < 1e-4 && valley.high.is_some(), "{valley:?}");
        assert_eq!(valley.rises, Some(0.5));
        let shallow = of(1e-4, |s| 0.5 + (s - 0.5).powi(2));
        assert_eq!((shallow.low, shallow.high, shallow.rises), (Some(1.0), None, Some(0.5)));
    }
}
