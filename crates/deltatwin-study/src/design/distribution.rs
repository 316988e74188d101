//! Quantiles of distributions.

use deltatwin_io::study::Distribution;
use statrs::distribution::{ContinuousCDF, Normal};

/// Value below which a number so distributed is with probability `u`, from 0 to 1.
pub fn quantile(distribution: &Distribution, u: f64) -> f64 {
    match *distribution {
        Distribution::Normal { mean, sigma, low, high } => {
            let standard = Normal::standard();
            let [below, above] = [low, high].map(|x| standard.cdf((x - mean) / sigma));
            let share = below + (above - below) * u;
            (mean + sigma * standard.inverse_cdf(share)).clamp(low, high)
        }
        Distribution::LogNormal { median, sigma } => median * (sigma * Normal::standard().inverse_cdf(u)).exp(),
        Distribution::Uniform { low, high } => low + (high - low) * u,
        Distribution::Triangular { low, mode, high } => {
            let rising = (mode - low) / (high - low);
            if u < rising {
                low + (u * (high - low) * (mode - low)).sqrt()
            } else {
                high - ((1.0 - u) * (high - low) * (high - mode)).sqrt()
            }
        }
        Distribution::Weibull { scale, shape } => scale * (-(-u).ln_1p()).powf(1.0 / shape),
    }
}

/// Probability that a standard normal number is below `z`.
pub fn normal_share(z: f64) -> f64 {
    Normal::standard().cdf(z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_scipy() {
        // scipy.stats: truncnorm, lognorm, triang, weibull_min, all at 0.3.
        for (distribution, expected) in [
            (Distribution::Normal { mean: 2.0, sigma: 0.5, low: 1.5, high: 4.0 }, 1.887576533026396),
            (
                Distribution::Normal { mean: 2.0, sigma: 0.5, low: f64::NEG_INFINITY, high: f64::INFINITY },
                1.7377997436459796,
            ),
            (Distribution::LogNormal { median: 3.0, sigma: 0.4 }, 2.432335929776415),
            (Distribution::Uniform { low: 1.0, high: 3.0 }, 1.6),
            (Distribution::Triangular { low: 1.0, mode: 2.0, high: 5.0 }, 2.1017246507621126),
            (Distribution::Weibull { scale: 2.0, shape: 1.7 }, 1.0905885601962122),
        ] {
            let found = quantile(&distribution, 0.3);
            assert!((found - expected).abs() < 1e-9, "{distribution:?}: {found} {expected}");
        }
    }

    #[test]
    fn quantiles_rise_and_stay_within_bounds() {
        let cut = Distribution::Normal { mean: 0.0, sigma: 1.0, low: -1.0, high: 0.5 };
        assert!((quantile(&cut, 0.0) + 1.0).abs() < 1e-9 && (quantile(&cut, 1.0) - 0.5).abs() < 1e-9);
        let all: Vec<f64> = (1..100).map(|k| quantile(&cut, 0.01 * f64::from(k))).collect();
        assert!(all.windows(2).all(|w| w[0] < w[1]));
    }
}
