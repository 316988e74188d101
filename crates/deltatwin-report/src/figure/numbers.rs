//! Numbers as text.

pub(super) fn superscript(exponent: i32) -> String {
    exponent
        .to_string()
        .chars()
        .map(|c| match c {
            '-' => '⁻',
            '1' => '¹',
            '2' => '²',
            '3' => '³',
            c => char::from_u32('⁰' as u32 + c.to_digit(10).unwrap_or(0)).unwrap_or(c),
        })
        .collect()
}

pub(super) fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(rest) if rest.chars().all(|c| c == '0' || c == '.') => rest.to_owned(),
        Some(rest) => format!("−{rest}"),
        None => text,
    }
}

/// `value` to three significant digits, in powers of ten if it is very large or small.
pub(super) fn significant(value: f64) -> String {
    if !value.is_finite() {
        return "–".into();
    }
    if value == 0.0 {
        return "0".into();
    }
    // Rounded first, because 0.9996 has the exponent of 1.00.
    let text = format!("{value:.2e}");
    let exponent: i32 = text.split('e').nth(1).and_then(|e| e.parse().ok()).unwrap_or(0);
    if (-3..6).contains(&exponent) {
        fixed(value, (2 - exponent).max(0) as usize)
    } else {
        let mantissa: f64 = text.split('e').next().and_then(|m| m.parse().ok()).unwrap_or_default();
        format!("{}·10{}", fixed(mantissa, 2), superscript(exponent))
    }
}
