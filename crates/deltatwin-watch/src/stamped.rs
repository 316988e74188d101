//! Samples with the times of the machine's clock, in whole nanoseconds.
//!
//! A time on a Unix clock has no room for them in a number of 64 bits: near 1.8·10⁹ s, neighbouring values are 0.24 µs
//! apart. So times are converted from their decimals, and the monitor counts from the first second of the machine.

use deltatwin::machine::PerAxis;

/// Nanoseconds per second.
pub const SECOND: i64 = 1_000_000_000;
/// Largest magnitude of a time, s: more than a hundred years on either side of 1970 or of the start.
const LARGEST: i64 = 4_000_000_000;

/// One sample of a machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stamped {
    /// Time on the machine's clock, ns.
    pub time: i64,
    /// Joint angles, rad (m for a sliding axis).
    pub q: PerAxis<f64>,
    /// Drive torques at the gear output, N·m (N for a sliding axis).
    pub tau: PerAxis<f64>,
}

/// The time that a decimal number of seconds states, in ns to the nearest one; `None` if it is not a number or too
/// large for a time.
pub fn nanoseconds(text: &str) -> Option<i64> {
    let (is_negative, digits) = text.strip_prefix('-').map_or((false, text), |rest| (true, rest));
    let (whole, fraction) = digits.split_once('.').unwrap_or((digits, ""));
    let is_decimal = |part: &str| part.bytes().all(|b| b.is_ascii_digit());
    let time = if !whole.is_empty() && is_decimal(whole) && is_decimal(fraction) {
        let below: f64 = format!("0.{fraction}").parse().ok()?;
        let whole: i64 = whole.parse().ok().filter(|whole| *whole <= LARGEST)?;
        whole * SECOND + (below * SECOND as f64).round() as i64
    } else {
        let seconds: f64 = digits.parse().ok().filter(|seconds: &f64| seconds.is_finite() && *seconds >= 0.0)?;
        (seconds * SECOND as f64).round() as i64
    };
    (time.abs() <= LARGEST * SECOND).then_some(if is_negative { -time } else { time })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_digit_is_lost() {
        assert_eq!(nanoseconds("1795510000.000400001"), Some(1_795_510_000_000_400_001));
        assert_eq!(nanoseconds("-12.5"), Some(-12_500_000_000));
        assert_eq!(nanoseconds("-0.0004"), Some(-400_000));
        assert_eq!((nanoseconds("3"), nanoseconds("4e-4")), (Some(3 * SECOND), Some(400_000)));
        assert_eq!(nanoseconds("4000000000"), Some(LARGEST * SECOND));
        for wrong in ["", "-", ".", "x", "--1", "nan", "inf", "1e300", "4000000001", "99999999999999999999", "1.2.3"] {
            assert_eq!(nanoseconds(wrong), None, "{wrong}");
        }
    }
}
