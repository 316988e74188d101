//! Fragility: probability of failure over a demand, such as speed or wear.
//!
//! The lognormal fragility is P(failure | x) = Φ(ln(x/θ)/β) with the median θ in the unit of x and the dispersion β, the
//! standard deviation of ln x of the capacity. Both maximise the binomial likelihood of the trials [Baker 2015]. With
//! a = −ln θ/β and b = 1/β this is probit regression, P = Φ(a + b ln x), whose likelihood is concave; it is solved by
//! Fisher scoring, and the inverse Fisher information is the covariance.

use nalgebra::{Matrix2, Vector2};
use statrs::distribution::{Continuous, Normal};
use thiserror::Error;

use super::interval::{normal_cdf, normal_quantile};

/// Trials at one demand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trial {
    /// Demand x, not negative.
    pub demand: f64,
    /// Number of failures.
    pub failures: usize,
    /// Number of trials.
    pub of: usize,
}

/// Fitted lognormal fragility.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fragility {
    /// Median θ: the demand at which half of the trials fail.
    pub median: f64,
    /// Dispersion β.
    pub dispersion: f64,
    /// Covariance of (ln θ, β).
    pub covariance: [[f64; 2]; 2],
    /// Deviance: twice the log-likelihood that the fit lacks to a probability of its own for every demand. With many
    /// trials at each of m demands about m − 2 if the curve is lognormal.
    pub deviance: f64,
}

/// Reason why there is no fit.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum FragilityError {
    /// A demand is not usable.
    #[error("demand {value} of trial {row}: a lognormal fragility needs finite demands, above zero where trials fail")]
    Demand {
        /// Index of the trial.
        row: usize,
        /// Its demand.
        value: f64,
    },
    /// More failures than trials.
    #[error("trial {row} has {failures} failures in {of} trials")]
    Count {
        /// Index of the trial.
        row: usize,
        /// Failures.
        failures: usize,
        /// Trials.
        of: usize,
    },
    /// No failure, or only failures.
    #[error("{failures} of {of} trials failed: a fit needs both, failures and survivals")]
    OneSided {
        /// Failures.
        failures: usize,
        /// Trials.
        of: usize,
    },
    /// One demand separates failures from survivals, so that the likelihood grows without bound.
    #[error("every trial up to {low} survived and every trial from {high} failed: the dispersion is below resolution")]
    Separated {
        /// Largest demand survived.
        low: f64,
        /// Smallest demand failed.
        high: f64,
    },
    /// Failures do not become more frequent with the demand.
    #[error("failures do not become more frequent with the demand: slope {slope:.3} of the probit over ln x")]
    NotRising {
        /// Slope b.
        slope: f64,
    },
}

impl Fragility {
    /// Probability of failure at a demand.
    pub fn at(&self, demand: f64) -> f64 {
        normal_cdf((demand / self.median).ln() / self.dispersion)
    }

    /// Probability of failure at a demand with its pointwise confidence interval, `[estimate, low, high]`; the interval
    /// is that of the probit, z = ln(x/θ)/β, by the delta method.
    pub fn band(&self, demand: f64, confidence: f64) -> [f64; 3] {
        let probit = (demand / self.median).ln() / self.dispersion;
        // ∂z/∂(ln θ, β) = (−1, −z)/β
        let gradient = Vector2::new(-1.0, -probit) / self.dispersion;
        let half = normal_quantile(0.5 + 0.5 * confidence) * self.standard_error(gradient);
        if demand <= 0.0 {
            return [0.0, 0.0, 0.0];
        }
        [normal_cdf(probit), normal_cdf(probit - half), normal_cdf(probit + half)]
    }

    /// Demand with a given probability of failure and its confidence interval, `[estimate, low, high]`; the interval is
    /// symmetric in ln x, by the delta method.
    pub fn demand(&self, probability: f64, confidence: f64) -> [f64; 3] {
        let z = normal_quantile(probability);
        let half = normal_quantile(0.5 + 0.5 * confidence) * self.standard_error(Vector2::new(1.0, z));
        let middle = self.median * (self.dispersion * z).exp();
        [middle, middle * (-half).exp(), middle * half.exp()]
    }

    /// Standard error of the linear function of (ln θ, β) with a gradient.
    fn standard_error(&self, gradient: Vector2<f64>) -> f64 {
        let covariance = Matrix2::from_fn(|i, k| self.covariance[i][k]);
        gradient.dot(&(covariance * gradient)).max(0.0).sqrt()
    }
}

/// Lognormal fragility of the largest likelihood.
///
/// Trials at a demand of zero that survived say nothing and are left out.
///
/// # Errors
/// If a demand is unusable, the trials do not bound both parameters, or failures do not increase with the demand.
pub fn fit_lognormal(trials: &[Trial]) -> Result<Fragility, FragilityError> {
    let usable = usable(trials)?;
    // Centred and scaled, so that the information is well conditioned.
    let weight: f64 = usable.iter().map(|t| t.1).sum();
    let centre = usable.iter().map(|t| t.0 * t.1).sum::<f64>() / weight;
    let spread = (usable.iter().map(|t| (t.0 - centre).powi(2) * t.1).sum::<f64>() / weight).sqrt();
    let rows: Vec<(f64, f64, f64)> = usable.iter().map(|&(x, of, k)| ((x - centre) / spread, of, k)).collect();
    let failed: f64 = rows.iter().map(|r| r.2).sum();
    let mut beta = Vector2::new(normal_quantile(failed / weight), 0.0);
    let mut deviance = deviance_of(&rows, beta);
    const ITERATIONS: usize = 100;
    for _ in 0..ITERATIONS {
        let (score, information) = score(&rows, beta);
        let Some(step) = information.try_inverse().map(|inverse| inverse * score) else { break };
        // Halved until the likelihood does not fall: the scoring step may overshoot far from the maximum.
        let mut scale = 1.0;
        let mut next = deviance_of(&rows, beta + step);
        while next > deviance + 1e-12 * deviance.abs().max(1.0) && scale > 1e-6 {
            scale *= 0.5;
            next = deviance_of(&rows, beta + scale * step);
        }
        (beta, deviance) = (beta + scale * step, next);
        if (scale * step).amax() < 1e-12 * beta.amax().max(1.0) {
            break;
        }
    }
    let slope = beta[1] / spread;
    if slope <= 0.0 {
        return Err(FragilityError::NotRising { slope });
    }
    let dispersion = 1.0 / slope;
    let log_median = centre - beta[0] * dispersion;
    let (_, information) = score(&rows, beta);
    let covariance = information.try_inverse().unwrap_or_else(|| Matrix2::repeat(f64::INFINITY));
    // ln θ = c − s β₀/β₁, β = s/β₁ of the scaled coefficients, s the spread.
    let jacobian =
        Matrix2::new(-spread / beta[1], spread * beta[0] / (beta[1] * beta[1]), 0.0, -spread / (beta[1] * beta[1]));
    let c = jacobian * covariance * jacobian.transpose();
    let covariance = [[c[(0, 0)], c[(0, 1)]], [c[(1, 0)], c[(1, 1)]]];
    Ok(Fragility { median: log_median.exp(), dispersion, covariance, deviance })
}

/// (ln x, trials, failures) of the trials that say something, after checks of all.
fn usable(trials: &[Trial]) -> Result<Vec<(f64, f64, f64)>, FragilityError> {
    for (row, t) in trials.iter().enumerate() {
        if !t.demand.is_finite() || t.demand < 0.0 || t.demand == 0.0 && t.failures > 0 {
            return Err(FragilityError::Demand { row, value: t.demand });
        }
        if t.failures > t.of {
            return Err(FragilityError::Count { row, failures: t.failures, of: t.of });
        }
    }
    let rows: Vec<&Trial> = trials.iter().filter(|t| t.of > 0 && t.demand > 0.0).collect();
    let (failures, of) = rows.iter().fold((0, 0), |(k, n), t| (k + t.failures, n + t.of));
    if failures == 0 || failures == of {
        return Err(FragilityError::OneSided { failures, of });
    }
    let failed = || rows.iter().filter(|t| t.failures > 0).map(|t| t.demand);
    let survived = || rows.iter().filter(|t| t.failures < t.of).map(|t| t.demand);
    let (low, high) = (survived().fold(0.0, f64::max), failed().fold(f64::INFINITY, f64::min));
    if low <= high {
        return Err(FragilityError::Separated { low, high });
    }
    // Separated the other way round: the slope would be −∞.
    if failed().fold(0.0, f64::max) <= survived().fold(f64::INFINITY, f64::min) {
        return Err(FragilityError::NotRising { slope: f64::NEG_INFINITY });
    }
    Ok(rows.iter().map(|t| (t.demand.ln(), t.of as f64, t.failures as f64)).collect())
}

/// Score and Fisher information of the coefficients of the probit.
fn score(rows: &[(f64, f64, f64)], beta: Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
    let normal = Normal::standard();
    let (mut score, mut information) = (Vector2::zeros(), Matrix2::zeros());
    for &(x, of, k) in rows {
        let row = Vector2::new(1.0, x);
        let eta = beta.dot(&row);
        let (p, density) = (probability(eta), normal.pdf(eta));
        let variance = p * probability(-eta);
        score += row * ((k - of * p) * density / variance);
        information += row * row.transpose() * (of * density * density / variance);
    }
    (score, information)
}

/// Φ(η), bounded away from 0 so that a likelihood stays finite.
fn probability(eta: f64) -> f64 {
    normal_cdf(eta).max(1e-300)
}

fn deviance_of(rows: &[(f64, f64, f64)], beta: Vector2<f64>) -> f64 {
    // k ln(k/(n p)), zero without counts.
    let term = |k: f64, expected: f64| if k > 0.0 { k * (k / expected).ln() } else { 0.0 };
    let one = |&(x, of, k): &(f64, f64, f64)| {
        let eta = beta[0] + beta[1] * x;
        term(k, of * probability(eta)) + term(of - k, of * probability(-eta))
    };
    2.0 * rows.iter().map(one).sum::<f64>()
}

/// Single outcomes `(demand, failed)` as trials: at most `groups` groups of neighbouring demands of about the same size,
/// at the geometric mean of their demands (the arithmetic one if any is not positive). Equal demands stay together.
///
/// For the points of a figure; a fit takes the outcomes themselves.
pub fn equal_groups(outcomes: &[(f64, bool)], groups: usize) -> Vec<Trial> {
    let mut sorted: Vec<(f64, bool)> = outcomes.iter().copied().filter(|o| o.0.is_finite()).collect();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let size = sorted.len().div_ceil(groups.max(1)).max(1);
    let mut parts: Vec<Vec<(f64, bool)>> = Vec::new();
    for same in sorted.chunk_by(|a, b| a.0 == b.0) {
        match parts.last_mut() {
            Some(part) if part.len() + same.len() / 2 < size => part.extend_from_slice(same),
            _ => parts.push(same.to_vec()),
        }
    }
    let trial = |part: &Vec<(f64, bool)>| {
        let n = part.len() as f64;
        let positive = part.iter().all(|o| o.0 > 0.0);
        let demand = if part[0].0 == part[part.len() - 1].0 {
            part[0].0
        } else if positive {
            (part.iter().map(|o| o.0.ln()).sum::<f64>() / n).exp()
        } else {
            part.iter().map(|o| o.0).sum::<f64>() / n
        };
        Trial { demand, failures: part.iter().filter(|o| o.1).count(), of: part.len() }
    };
    parts.iter().map(trial).collect()
}
