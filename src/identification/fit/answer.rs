//! Estimates of individual parameters, and reasons why data do not determine a parameter.

use crate::effects::Param;
use crate::machine::Unit;

/// A parameter with its estimate.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// Identity of the parameter.
    pub param: Param,
    /// Printed name.
    pub name: String,
    /// Unit.
    pub unit: Unit,
    /// Value.
    pub value: f64,
    /// Standard error; infinite if the data do not determine the parameter individually.
    pub std: f64,
    /// Smallest and largest permitted value.
    pub range: (f64, f64),
}

/// Distance from an end of the range, in standard errors, below which a value lies at it.
const AT_BOUND: f64 = 1e-3;

impl Estimate {
    /// The end of its range at which a determined parameter lies: its standard error, of the unconstrained estimate, says
    /// little there.
    pub fn bound(&self) -> Option<f64> {
        let (low, high) = self.range;
        let is_at = |end: &f64| self.identified() && (self.value - end).abs() <= AT_BOUND * self.std;
        [low, high].into_iter().find(is_at)
    }

    /// Whether the data determine the parameter individually. If not, its value is the one before the fit.
    pub fn identified(&self) -> bool {
        self.std.is_finite()
    }
}

/// A parameter that the data do not determine.
#[derive(Clone, Debug)]
pub struct Unidentified {
    /// Printed name.
    pub name: String,
    /// Reason.
    pub reason: Reason,
}

/// Reason why the data do not determine a parameter.
#[derive(Clone, Debug, PartialEq)]
pub enum Reason {
    /// It has no influence on any measured channel.
    NotExcited,
    /// It is determined only in combination with others.
    OnlyTogether(Vec<String>),
    /// Its standard error, as a share of its own size, is too large.
    Uncertain(f64),
}

impl std::fmt::Display for Reason {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::NotExcited => write!(f, "the motion does not excite it"),
            Self::OnlyTogether(names) => write!(f, "shows only together with {}", names.join(", ")),
            Self::Uncertain(share) => write!(f, "uncertain by {:.0} % of its size", 100.0 * share),
        }
    }
}

/// A parameter that was moved from its unconstrained estimate.
#[derive(Clone, Debug)]
pub struct Moved {
    /// Printed name.
    pub name: String,
    /// Unit.
    pub unit: Unit,
    /// Unconstrained estimate.
    pub free: f64,
    /// Corrected value.
    pub value: f64,
    /// Standard error of the unconstrained estimate.
    pub std: f64,
}

/// Cost of consistency.
#[derive(Clone, Copy, Debug)]
pub struct Correction {
    /// Increase of the cost ½Σr²/σ² over the unconstrained estimate.
    pub cost: f64,
    /// Gap between the cost and the lower bound of the convex programme, relative to `cost`; `None` for log-Cholesky.
    pub gap: Option<f64>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_determined_value_at_an_end_of_its_range_is_at_a_bound() {
        let param = Param { effect: "viscous_friction", block: 0, item: 0 };
        let of = |value: f64, std: f64| Estimate {
            param,
            name: "p".into(),
            unit: Unit::NMSPerRad,
            value,
            std,
            range: (0.0, 10.0),
        };
        assert_eq!(of(2.6e-14, 0.39).bound(), Some(0.0));
        assert_eq!(of(10.0, 0.1).bound(), Some(10.0));
        assert_eq!(of(0.01, 0.39).bound(), None);
        assert_eq!(of(0.0, f64::INFINITY).bound(), None);
    }
}
