//! Time-optimal motion along a path within limits on drives and constraint forces (section 5 of the paper).
//!
//! A [`Curve`] r(s) becomes [`PathPoint`]s in joint space; torques and constraint forces along it are
//! A s̈ + B ṡ² + C + D ṡ ([`Coefficients`]), so every limit is a row in z = ṡ² and s̈ ([`rows`]). Without jerk limits two passes
//! compute the optimal z(s) ([`pass`]), with jerk limits a sequence of linear programmes ([`jerk`]). The result, a
//! [`Profile`], is checked against the full model on a finer grid and rejected if a limit is exceeded ([`plan()`]).

mod accept;
pub mod certificate;
pub mod coefficients;
pub mod curve;
mod grid;
pub mod jerk;
pub mod limits;
mod linearise;
pub mod pass;
pub mod plan;
pub mod point;
pub mod profile;
mod programme;
pub mod refine;
pub mod relaxation;
pub mod rows;
mod search;
pub mod shape;
pub mod trajectory;
mod unknowns;
pub mod validation;
pub mod verify;

pub use coefficients::{Coefficients, Machine, Reference};
pub use curve::Curve;
pub use limits::{Limit, Limits};
pub use plan::{Options, Plan, plan};
pub use point::{PathPoint, PlaceError};
pub use profile::Profile;
pub use shape::Shape;

use thiserror::Error;

use crate::machine::{Mechanism, Setup};

/// Contents of a path file.
#[derive(Clone, Debug)]
pub struct Task {
    /// Name for reports: the stem of the file name.
    pub name: String,
    /// The path.
    pub shape: Shape,
    /// Payload.
    pub setup: Setup,
    /// Limits.
    pub limits: Limits,
    /// Options of the search.
    pub options: Options,
}

/// Objective with jerk limits; without jerk limits both have the same optimum.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Objective {
    /// The time ∫ ds/√z itself.
    #[default]
    Time,
    /// ∫ z ds, the paper's (43).
    Speed,
}

/// Reason why there is no plan.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum PlanError {
    /// The robot cannot follow the path.
    #[error("the path cannot be followed at s = {s:.4}, (x, y, z) = ({:.4}, {:.4}, {:.4}) m: {reason}", .at[0], .at[1], .at[2])]
    Place {
        /// Path parameter.
        s: f64,
        /// (x, y, z, ψ), m and rad.
        at: [f64; 4],
        /// Cause.
        reason: PlaceError,
    },
    /// A limit is exceeded even at rest.
    #[error(
        "no motion is within the limits at s = {s:.4}: at rest, {} is {value:.3} of {usable:.3} {} that may be used",
        .limit.title(*.machine), .limit.unit(*.machine)
    )]
    AtRest {
        /// The limit.
        limit: Limit,
        /// Path parameter.
        s: f64,
        /// Value at rest.
        value: f64,
        /// Usable value.
        usable: f64,
        /// Machine, which determines the unit and the title of the limit.
        machine: Mechanism,
    },
    /// The limits permit no motion through a place.
    #[error("the limits leave no motion through s = {s:.4}")]
    Stuck {
        /// Path parameter.
        s: f64,
    },
    /// The optimum of the paper's objective comes to rest on this path.
    #[error(
        "∫ ṡ² ds, the objective \"speed\", grows towards a motion that rests at s = {s:.4}, because it does not count the time \
         spent there; expected the objective \"time\" for this path"
    )]
    Rests {
        /// Path parameter.
        s: f64,
    },
    /// The solver of the jerk-limited programme did not converge.
    #[error("no motion within the jerk limits was found; fewer or more intervals may help")]
    Unsolved,
    /// The motion found exceeds a limit.
    #[error("{limit} cannot be kept: {:.2} % above what may be used at s = {s:.4}; more intervals may help", 1e2 * (.ratio - 1.0))]
    Violated {
        /// The limit.
        limit: Limit,
        /// Path parameter.
        s: f64,
        /// Ratio of the value to the usable limit.
        ratio: f64,
    },
}

impl PlanError {
    /// The error with the parameter of `curve` replaced by s.
    fn along(mut self, curve: &Curve) -> Self {
        match &mut self {
            Self::Place { s, .. }
            | Self::AtRest { s, .. }
            | Self::Stuck { s }
            | Self::Rests { s }
            | Self::Violated { s, .. } => *s = curve.way(*s)[0],
            Self::Unsolved => {}
        }
        self
    }
}
