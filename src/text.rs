//! Formatting of numbers, and suggestions for misspelt names.

/// `x` with `digits` significant digits, in fixed-point notation for 1e-4 ≤ |x| < 1e6, else in scientific notation.
///
/// An infinite `x` or NaN gives "—".
pub fn significant(x: f64, digits: usize) -> String {
    if x == 0.0 || !x.is_finite() {
        return if x == 0.0 { "0".into() } else { "—".into() };
    }
    let exponent = x.abs().log10().floor() as i32;
    if (-4..6).contains(&exponent) {
        let decimals = (digits as i32 - 1 - exponent).max(0) as usize;
        format!("{x:.decimals$}")
    } else {
        format!("{x:.*e}", digits - 1)
    }
}

/// `value` and its standard error `std` with the same decimals, two digits of the error below 3 of its leading digit and
/// otherwise one, such as "0.15354 ± 0.00008"; in scientific notation where that would take many digits.
pub fn with_error(value: f64, std: f64) -> String {
    let order = |x: f64| if x == 0.0 { 0 } else { x.abs().log10().floor() as i32 };
    if !(std > 0.0 && std.is_finite()) || order(std) < -7 || order(value.abs().max(std)) > 5 {
        return format!("{} ± {}", significant(value, 4), significant(std, 2));
    }
    let leads_small = std / 10f64.powi(order(std)) < 3.0;
    let decimals = (i32::from(leads_small) - order(std)).max(0) as usize;
    format!("{value:.decimals$} ± {std:.decimals$}")
}

/// The element of `known` nearest to the misspelt name `wrong`; `None` if no name is near enough.
///
/// A name is near enough if its Damerau–Levenshtein distance is at most a third of its length, rounded up (at least 2),
/// or if one of the two contains the other and `wrong` has at least three bytes.
pub fn nearest<'a>(wrong: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let length = wrong.chars().count();
    let distance = |name: &str| {
        // The distance is at least the difference in length, and equal to it if one contains the other.
        let (least, most) = (length.abs_diff(name.chars().count()), name.len().div_ceil(3).max(2));
        let near = (least <= most).then(|| strsim::damerau_levenshtein(wrong, name)).filter(|d| *d <= most);
        near.or_else(|| (wrong.len() > 2 && (name.contains(wrong) || wrong.contains(name))).then_some(least))
    };
    let distances = known.into_iter().filter_map(|name| Some((distance(name)?, name)));
    distances.min_by_key(|(distance, _)| *distance).map(|(_, name)| name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_has_the_decimals_of_its_error() {
        for (value, std, text) in [
            (0.15353, 8.0e-5, "0.15353 ± 0.00008"),
            (-0.4055, 0.083, "-0.41 ± 0.08"),
            (12.345, 1.23, "12.3 ± 1.2"),
            (1234.5, 40.0, "1234 ± 40"),
            (1.5e9, 2.0e6, "1.500e9 ± 2.0e6"),
            (3.0, f64::INFINITY, "3.000 ± —"),
        ] {
            assert_eq!(with_error(value, std), text);
        }
    }

    #[test]
    fn only_near_names_are_suggested() {
        let known = ["air_drag", "base_tilt", "hose_spring"];
        assert_eq!(nearest("air_darg", known), Some("air_drag"));
        assert_eq!(nearest("spring", known), Some("hose_spring"));
        assert_eq!(nearest("quantum_foam", known), None);
        assert_eq!(nearest("xyz", known), None);
    }

    /// Text of any length in place of a name costs no table of distances, which would be gigabytes here.
    #[test]
    fn a_long_text_is_compared_at_once() {
        let long = "x".repeat(30_000_000);
        assert_eq!(nearest(&long, ["air_drag", "base_tilt"]), None);
        assert_eq!(nearest(&(long + "air_drag"), ["air_drag", "base_tilt"]), Some("air_drag"));
    }
}
