//! What a fit says about single parameters.

use crate::effects::Param;
use crate::machine::Unit;

/// A parameter with what the data say about it.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// Its identity.
    pub param: Param,
    /// Printed name.
    pub name: String,
    /// Unit.
    pub unit: Unit,
    /// Value.
    pub value: f64,
    /// Standard error; infinite where the data cannot tell the parameter alone.
    pub std: f64,
}

impl Estimate {
    /// Whether the data determine the parameter alone. If not, its value is what it was before.
    pub fn identified(&self) -> bool {
        self.std.is_finite()
    }
}

/// A parameter the data do not determine.
#[derive(Clone, Debug)]
pub struct Unidentified {
    /// Printed name.
    pub name: String,
    /// Why.
    pub reason: Reason,
}

/// Why data do not determine a parameter.
#[derive(Clone, Debug, PartialEq)]
pub enum Reason {
    /// It has no part in any measured channel.
    NotExcited,
    /// It shows only in combination with others.
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

/// A parameter that had to leave its unconstrained estimate.
#[derive(Clone, Debug)]
pub struct Moved {
    /// Printed name.
    pub name: String,
    /// Unit.
    pub unit: Unit,
    /// Estimate that no possible machine has.
    pub free: f64,
    /// Value it has now.
    pub value: f64,
    /// Standard error of the estimate.
    pub std: f64,
}

/// The price of possible parameters.
#[derive(Clone, Copy, Debug)]
pub struct Correction {
    /// Rise of the cost ½Σr²/σ² over the impossible estimate.
    pub cost: f64,
    /// Gap between it and the lower bound that the convex programme proves, relative to `cost`; `None` for log-Cholesky.
    pub gap: Option<f64>,
}
