//! History of a model: the effects added to it, with the error before and after.

/// An effect that was added to a model.
#[derive(Clone, Debug, PartialEq)]
pub struct Added {
    /// Name of the effect.
    pub effect: String,
    /// Measured channels, in the order of the numbers below.
    pub channels: Vec<String>,
    /// RMS residual of each channel, refitted without the effect, N·m or N.
    pub rms_before: Vec<f64>,
    /// RMS residual of each channel, refitted with the effect, N·m or N.
    pub rms_after: Vec<f64>,
    /// Standard deviation of each channel's noise, N·m or N.
    pub noise_floor: Vec<f64>,
    /// Whether the residuals are those of held-out data.
    pub held_out: bool,
}

/// Significant digits of numbers stored in files.
const DIGITS: i32 = 5;

/// `x` with the precision stored in files, five significant digits.
pub fn rounded(x: f64) -> f64 {
    rounded_to(x, DIGITS)
}

/// `x` rounded to `digits` significant digits; zero if it is not finite.
pub fn rounded_to(x: f64, digits: i32) -> f64 {
    if x == 0.0 || !x.is_finite() {
        return 0.0;
    }
    let decimals = (digits - 1 - x.abs().log10().floor() as i32).clamp(0, 15) as usize;
    format!("{x:.decimals$}").parse().unwrap_or(x)
}
