//! How a model came to be: the effects that were added to it, with the error before and after.

/// An effect that was added to a model.
#[derive(Clone, Debug, PartialEq)]
pub struct Added {
    /// Its name.
    pub effect: String,
    /// Measured channels, in the order of the numbers.
    pub channels: Vec<String>,
    /// RMS residual of each channel without it, refitted, N·m or N.
    pub rms_before: Vec<f64>,
    /// The same with it.
    pub rms_after: Vec<f64>,
    /// Standard deviation of the channel's noise.
    pub noise_floor: Vec<f64>,
    /// Whether the residuals are those of data that were not fitted.
    pub held_out: bool,
}

/// Decimals of the kept numbers: five significant digits.
const DIGITS: i32 = 5;

/// A number as it is kept in a file.
pub fn rounded(x: f64) -> f64 {
    rounded_to(x, DIGITS)
}

/// A number with some significant digits.
pub fn rounded_to(x: f64, digits: i32) -> f64 {
    if x == 0.0 || !x.is_finite() {
        return 0.0;
    }
    let decimals = (digits - 1 - x.abs().log10().floor() as i32).clamp(0, 15) as usize;
    format!("{x:.decimals$}").parse().unwrap_or(x)
}
