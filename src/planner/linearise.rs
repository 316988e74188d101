//! Reference motions at which force laws are linearised, and transfer of motions between grids.

use super::coefficients::Reference;
use super::jerk::GridProfile;
use super::pass::Passes;
use super::{Curve, Profile};

/// Ratio of the z at which force laws are linearised at an end of the path to z at the neighbouring grid point.
const DEPARTURE_SHARE: f64 = 0.25;
/// Least ṡ at which force laws are linearised, 1/s.
const LEAST_SPEED: f64 = 1e-6;

fn reference(z: &[f64], i: usize, acceleration: f64) -> Reference {
    let n = z.len() - 1;
    let z = match i {
        0 => DEPARTURE_SHARE * z[1],
        i if i == n => DEPARTURE_SHARE * z[n - 1],
        i => z[i],
    };
    Reference { speed: z.sqrt().max(LEAST_SPEED), acceleration }
}

/// Speed and mean s̈ of the adjacent intervals at every grid point.
pub(super) fn references_of_passes(passes: &Passes) -> Vec<Reference> {
    let n = passes.z.len() - 1;
    let mean = |i: usize| 0.5 * (passes.acceleration[i.saturating_sub(1)] + passes.acceleration[i.min(n - 1)]);
    (0..=n).map(|i| reference(&passes.z, i, mean(i))).collect()
}

/// Speed and s̈ at every grid point.
pub(super) fn references(profile: &GridProfile) -> Vec<Reference> {
    (0..profile.z.len()).map(|i| reference(&profile.z, i, profile.acceleration[i])).collect()
}

/// z and s̈ of `profile` at `places`, over the same parameter.
pub(super) fn resampled(profile: &Profile, places: &[f64]) -> GridProfile {
    let paces: Vec<_> = places.iter().map(|s| profile.pace(*s)).collect();
    GridProfile { z: paces.iter().map(|p| p.z).collect(), acceleration: paces.iter().map(|p| p.acceleration).collect() }
}

/// z and acceleration of the parameter of `curve` at `places`, for a `profile` over s; z is infinite where ds/dx = 0.
pub(super) fn reparametrised(profile: &Profile, curve: &Curve, places: &[f64]) -> GridProfile {
    let at = |x: &f64| {
        let [s, g1, g2, _] = curve.way(*x);
        let pace = profile.pace(s);
        let z = if g1 > 0.0 { pace.z / (g1 * g1) } else { f64::INFINITY };
        if z.is_finite() { (z, (pace.acceleration - g2 * z) / g1) } else { (z, 0.0) }
    };
    let (z, acceleration) = places.iter().map(at).unzip();
    GridProfile { z, acceleration }
}
