//! Identification of the model's parameters from recordings.
//!
//! A [`Dataset`] contains the smoothed joint motion of a recording; [`predict`] and [`columns`] give the predicted
//! channels of a plant along a dataset and their derivatives with respect to the parameters; [`mod@fit`] is weighted
//! least squares with a prior.

pub mod bandwidth;
pub mod base_parameters;
pub mod consistency;
pub mod dataset;
pub mod derivatives;
pub mod estimator;
pub mod filtering;
pub mod fit;
pub mod initial;
pub mod laps;
pub mod least_squares;
pub mod limbs;
pub mod lines;
pub mod noise;
pub mod normal_equations;
pub mod payload;
pub mod prediction;
pub mod regularisation;
pub mod repeats;
pub mod residuals;
pub mod smoother;
mod swapped;
mod together;
pub mod uncertainty;
pub mod zeros;

pub use base_parameters::BaseParameter;
pub use dataset::{Dataset, EncoderReadings};
pub use derivatives::Method;
pub use fit::{Estimate, Fit, FitError, fit, fit_with};
pub use laps::Laps;
pub use limbs::{LimbTest, limb_test};
pub use noise::NoiseLevel;
pub use payload::{PayloadFit, identify_payload};
pub use prediction::{KeptColumns, columns, predict};
pub use repeats::Repeats;
pub use residuals::{HeldOut, Residuals};
pub use swapped::swapped;
pub use together::check_together;
