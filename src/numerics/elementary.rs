//! Elementary functions that a stage of the twin evaluates tens of times: shorter than those of the system's library,
//! with stated errors.

use std::f64::consts::FRAC_PI_4;

/// Magnitude from which tanh rounds to one: 2·exp(−2x) is below half a unit in the last place.
const SATURATED: f64 = 19.07;
/// Magnitude below which the continued fraction is used.
const SMALL: f64 = 0.625;

/// Hyperbolic tangent of `x`, within two units in the last place.
///
/// Below 0.625 it is Lambert's continued fraction x/(1 + x²/(3 + x²/(5 + …))) with nine terms, whose remainder is below
/// 1e-20; above, 1 − 2/(exp(2x) + 1).
#[inline]
pub fn tanh(x: f64) -> f64 {
    let size = x.abs();
    if size < SMALL {
        let z = x * x;
        let missing = 11_486_475.0 + z * (810_810.0 + z * (12_870.0 + z * 44.0));
        let whole = 34_459_425.0 + z * (16_216_200.0 + z * (945_945.0 + z * (13_860.0 + z * 45.0)));
        (size - size * z * missing / whole).copysign(x)
    } else if size > SATURATED {
        1f64.copysign(x)
    } else {
        (1.0 - 2.0 / ((2.0 * size).exp() + 1.0)).copysign(x)
    }
}

/// Sine and cosine of `x` (rad), within one unit in the last place.
///
/// Up to π/4 they are the Taylor series with remainders below 3e-18 of the value; above, the functions of the standard
/// library.
#[inline]
pub fn sin_cos(x: f64) -> (f64, f64) {
    if x.abs() > FRAC_PI_4 || x.is_nan() {
        return x.sin_cos();
    }
    // Reciprocals of factorials, the highest power first.
    const SINE: [f64; 8] = [
        1.0 / 355_687_428_096_000.0,
        -1.0 / 1_307_674_368_000.0,
        1.0 / 6_227_020_800.0,
        -1.0 / 39_916_800.0,
        1.0 / 362_880.0,
        -1.0 / 5_040.0,
        1.0 / 120.0,
        -1.0 / 6.0,
    ];
    const COSINE: [f64; 7] = [
        1.0 / 20_922_789_888_000.0,
        -1.0 / 87_178_291_200.0,
        1.0 / 479_001_600.0,
        -1.0 / 3_628_800.0,
        1.0 / 40_320.0,
        -1.0 / 720.0,
        1.0 / 24.0,
    ];
    let z = x * x;
    let of = |series: &[f64]| series.iter().fold(0.0, |sum, c| sum * z + c);
    // 1 − z/2 is not exact; its error is added to the small terms.
    let half = 0.5 * z;
    let first = 1.0 - half;
    (x + x * z * of(&SINE), first + ((1.0 - first - half) + z * z * of(&COSINE)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Distance in units in the last place of `exact`.
    fn ulps(value: f64, exact: f64) -> f64 {
        let size = exact.abs().max(f64::MIN_POSITIVE);
        let ulp = f64::from_bits(size.to_bits() + 1) - size;
        (value - exact).abs() / ulp
    }

    fn range(from: f64, to: f64) -> impl Iterator<Item = f64> {
        const COUNT: usize = 200_000;
        (0..=COUNT).map(move |k| from + (to - from) * (k as f64 + 0.37) / COUNT as f64)
    }

    /// The values to thirty digits are from the power series and exp in rational arithmetic.
    #[test]
    fn tanh_at_known_points() {
        for (x, exact) in [
            (0.125, 0.124_353_001_771_596_21),
            (0.5, 0.462_117_157_260_009_76),
            (0.75, 0.635_148_952_387_287_3),
            (1.0, 0.761_594_155_955_764_9),
            (2.5, 0.986_614_298_151_430_3),
            (10.0, 0.999_999_995_877_692_8),
        ] {
            assert!(ulps(tanh(x), exact) <= 2.0 && tanh(-x) == -tanh(x), "{x}: {} {exact}", tanh(x));
        }
        assert_eq!([tanh(0.0), tanh(19.1), tanh(-700.0), tanh(f64::INFINITY)], [0.0, 1.0, -1.0, 1.0]);
        assert!(tanh(f64::NAN).is_nan() && tanh(-0.0).is_sign_negative());
        // Up to x⁵: x − x³/3.
        assert_eq!(tanh(1e-8), 1e-8);
        assert!(ulps(tanh(1e-4), 1e-4 - 1e-12 / 3.0) <= 1.0);
    }

    /// The library's own functions are within one unit (sin, cos) and two units (tanh).
    #[test]
    fn elementary_functions_agree_with_the_library() {
        let worst = |mut errors: Box<dyn Iterator<Item = f64>>| errors.by_ref().fold(0.0, f64::max);
        let of_tanh = worst(Box::new(range(-22.0, 22.0).chain(range(-0.7, 0.7)).map(|x| ulps(tanh(x), x.tanh()))));
        let of_sine = worst(Box::new(range(-0.8, 0.8).map(|x| ulps(sin_cos(x).0, x.sin()))));
        let of_cosine = worst(Box::new(range(-0.8, 0.8).map(|x| ulps(sin_cos(x).1, x.cos()))));
        println!("tanh {of_tanh}, sine {of_sine}, cosine {of_cosine} units in the last place");
        assert!(of_tanh <= 3.0 && of_sine <= 1.0 && of_cosine <= 1.0);
        assert_eq!(sin_cos(100.0), 100f64.sin_cos());
        assert!(sin_cos(f64::NAN).0.is_nan());
    }
}
