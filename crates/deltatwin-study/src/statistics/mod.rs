//! Sensitivity indices, probabilities of rare failures, fragility, and confidence intervals.
//!
//! Everything here is a function of numbers: a study brings its points and what came out of them.

mod fragility;
mod interval;
mod power;
mod sobol;
mod subset;
#[cfg(test)]
mod tests;
mod tornado;

pub use fragility::{Fragility, FragilityError, Trial, equal_groups, fit_lognormal};
pub use interval::{normal_quantile, order_interval, quantile, wilson};
pub use power::{Attempt, PowerCurve, power_curves};
pub use sobol::{Index, SobolError, SobolIndices, sobol_indices, sobol_points};
pub use subset::{Ended, Level, Sample, Subset, SubsetError, SubsetOptions, subset};
pub use tornado::{Swing, tornado};
