//! Tail probabilities and quantiles.

use statrs::distribution::{ChiSquared, ContinuousCDF, FisherSnedecor, StudentsT};
use statrs::function::beta::beta_reg;
use statrs::function::gamma::{gamma_ur, ln_gamma};

use crate::numerics::bisect;

/// `P(F(m, d) > f)`.
pub fn f_tail(f: f64, m: f64, d: f64) -> f64 {
    if f.is_infinite() && f > 0.0 {
        return 0.0;
    }
    match FisherSnedecor::new(m, d) {
        Ok(dist) if f > 0.0 => dist.sf(f),
        _ => 1.0,
    }
}

/// Quantile of F(m, d).
pub fn f_quantile(p: f64, m: f64, d: f64) -> f64 {
    FisherSnedecor::new(m, d).map_or(f64::INFINITY, |dist| dist.inverse_cdf(p))
}

/// `P(F'(m, d; λ) > f)` of the non-central F, a Poisson mixture of beta tails.
pub fn noncentral_f_tail(f: f64, m: usize, d: f64, lambda: f64) -> f64 {
    if lambda > CERTAIN {
        return 1.0;
    }
    let (h, x) = (0.5 * m as f64, d / (d + m as f64 * f));
    let mut weight = (-0.5 * lambda).exp();
    let mut sum = 0.0;
    for i in 0..60 + (2.0 * lambda) as usize {
        sum += weight * beta_reg(0.5 * d, h + i as f64, x);
        weight *= 0.5 * lambda / (i + 1) as f64;
    }
    sum.min(1.0)
}

/// Non-centrality beyond any critical value in use.
const CERTAIN: f64 = 500.0;

/// Natural logarithm of `P(χ²(k) > x)`, exact in the bulk and asymptotic where the probability underflows.
pub fn ln_chi2_tail(x: f64, k: f64) -> f64 {
    let (a, h) = (0.5 * k, 0.5 * x);
    if h.is_nan() || h <= 0.0 || a <= 0.0 {
        return 0.0;
    }
    if h < 600.0 {
        return gamma_ur(a, h).max(f64::MIN_POSITIVE).ln();
    }
    -h + (a - 1.0) * h.ln() - ln_gamma(a) + ((a - 1.0) / h).ln_1p()
}

/// Quantile of Student's t; infinite without degrees of freedom.
pub fn t_quantile(p: f64, d: f64) -> f64 {
    StudentsT::new(0.0, 1.0, d).map_or(f64::INFINITY, |t| t.inverse_cdf(p))
}

/// Non-centrality at which a test at level `alpha` on m degrees of freedom has the given power.
///
/// The non-central χ² is a Poisson mixture of central ones.
pub fn noncentrality(m: usize, alpha: f64, power: f64) -> f64 {
    let Ok(chi) = ChiSquared::new(m.max(1) as f64) else {
        return f64::INFINITY;
    };
    let critical = chi.inverse_cdf(1.0 - alpha);
    let reached = |lambda: f64| {
        let terms = 40 + (2.0 * lambda) as usize;
        let mut weight = (-0.5 * lambda).exp();
        let mut sum = 0.0;
        for i in 0..terms {
            sum += weight * gamma_ur(0.5 * (m.max(1) + 2 * i) as f64, 0.5 * critical);
            weight *= 0.5 * lambda / (i + 1) as f64;
        }
        sum
    };
    let [low, high] = bisect([0.0, 200.0], 50, |lambda| reached(lambda) < power);
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    /// Tabulated non-centralities [Haynam 1970], to the digits printed there.
    #[test]
    fn noncentrality_matches_table() {
        for (m, table) in [(1, 12.995), (2, 15.443), (3, 17.170), (4, 18.572)] {
            assert_relative_eq!(noncentrality(m, 0.05, 0.95), table, epsilon = 2e-3);
        }
    }

    /// With zero non-centrality it is the F tail; with many degrees of freedom the non-central χ² of the table above.
    #[test]
    fn noncentral_f_has_the_right_limits() {
        assert_relative_eq!(noncentral_f_tail(2.5, 3, 40.0, 0.0), f_tail(2.5, 3.0, 40.0), epsilon = 1e-12);
        for (m, lambda, critical) in [(1, 12.995, 3.841_459), (3, 17.170, 7.814_728)] {
            let tail = noncentral_f_tail(critical / m as f64, m, 1e7, lambda);
            assert_relative_eq!(tail, 0.95, epsilon = 1e-4);
        }
    }

    /// The asymptotic branch joins the exact one: neglected terms are of order (a/h)² = 1e-4.
    #[test]
    fn log_tail_is_continuous() {
        for k in [1.0, 3.0, 8.0] {
            let step = ln_chi2_tail(1200.02, k) - ln_chi2_tail(1199.98, k);
            assert!((step + 0.02).abs() < 1e-3, "{k}: {step}");
        }
        assert_relative_eq!(ln_chi2_tail(3.841_458_8, 1.0).exp(), 0.05, epsilon = 1e-6);
    }
}
