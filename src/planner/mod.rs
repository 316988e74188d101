//! Time-optimal motion along a path within limits on drives and constraint forces (paper section 5).

pub mod coefficients;
pub mod curve;
pub mod limits;
pub mod pass;
pub mod point;
pub mod profile;
pub mod rows;
pub mod shape;
pub mod verify;

pub use coefficients::{Coefficients, Machine, Reference};
pub use curve::Curve;
pub use limits::{Limit, Limits};
pub use point::{PathPoint, PlaceError};
pub use profile::Profile;
pub use shape::Shape;

use thiserror::Error;

use pass::{Passes, Stuck};
use rows::{Room, Stations};

/// Why there is no plan.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum PlanError {
    /// The path leads where the robot cannot go.
    #[error("the path cannot be followed at s = {s:.4}, (x, y, z) = ({:.4}, {:.4}, {:.4}) m: {source}", .at[0], .at[1], .at[2])]
    Place {
        /// Path parameter.
        s: f64,
        /// (x, y, z, ψ), m and rad.
        at: [f64; 4],
        /// What is wrong.
        source: PlaceError,
    },
    /// A limit is exceeded even at rest.
    #[error(
        "no motion keeps {limit} at s = {s:.4}: at rest it is {value:.3} {} of {usable:.3} {} that may be used",
        .limit.unit(), .limit.unit()
    )]
    AtRest {
        /// The limit.
        limit: Limit,
        /// Path parameter.
        s: f64,
        /// Value at rest.
        value: f64,
        /// What may be used.
        usable: f64,
    },
    /// The limits leave no room for any motion through a place.
    #[error("the limits leave no motion through s = {s:.4}")]
    Stuck {
        /// Path parameter.
        s: f64,
    },
}

/// Plans without jerk limits on a uniform grid of `intervals`; returns stations, passes.
pub fn without_jerk(machine: &Machine, limits: &Limits, stations: &mut Stations, room: &Room) -> Result<(Passes, usize), PlanError> {
    let explain = |stuck: Stuck, stations: &Stations| {
        let station = &stations.list[stuck.station];
        let s = station.point.s;
        match stuck.row {
            None => PlanError::Stuck { s },
            Some(row) => {
                let k = stations.quantities[row];
                let usable = limits.usable()[k];
                PlanError::AtRest { limit: Limit::affine(k), s, value: usable * station.rows[row].tangent(station.reference).2, usable }
            }
        }
    };
    let mut found = pass::solve(stations, room).map_err(|e| explain(e, stations))?;
    for iteration in 0..30 {
        let references = references(&found);
        stations.load(machine, limits, &references)?;
        let next = pass::solve(stations, room).map_err(|e| explain(e, stations))?;
        let change = next.z.iter().zip(&found.z).map(|(a, b)| (a - b).abs() / (a + b).max(f64::MIN_POSITIVE)).fold(0.0, f64::max);
        found = next;
        if iteration > 0 && change < 1e-6 {
            return Ok((found, iteration + 1));
        }
    }
    Ok((found, 30))
}

/// Where force laws are linearised: speed and mean acceleration at every station.
fn references(passes: &Passes) -> Vec<Reference> {
    let n = passes.z.len() - 1;
    (0..=n)
        .map(|i| {
            let z = match i {
                0 => 0.25 * passes.z[1],
                i if i == n => 0.25 * passes.z[n - 1],
                i => passes.z[i],
            };
            let (before, after) = (passes.acceleration[i.saturating_sub(1)], passes.acceleration[i.min(n - 1)]);
            Reference { speed: z.sqrt().max(1e-6), acceleration: 0.5 * (before + after) }
        })
        .collect()
}
