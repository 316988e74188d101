//! Grids of path parameters.

use super::{Curve, Profile};

/// Least number of intervals over a piece of the path.
const MIN_PER_PIECE: usize = 6;

/// Grid of about `n` equal intervals over the path, at least [`MIN_PER_PIECE`] over each of its pieces.
pub(super) fn even(curve: &Curve, n: usize) -> Vec<f64> {
    let knots: Vec<f64> = curve.knots().collect();
    let mut grid = vec![0.0];
    for piece in knots.windows(2) {
        let length = piece[1] - piece[0];
        let count = ((n as f64 * length / curve.end()).round() as usize).max(MIN_PER_PIECE);
        grid.extend((1..=count).map(|k| piece[0] + length * k as f64 / count as f64));
    }
    grid
}

/// Grid of `n` intervals, equally spaced in the mean of time, path parameter and piece number.
pub(super) fn graded(profile: &Profile, curve: &Curve, n: usize) -> Vec<f64> {
    let m = profile.pieces.len();
    let (time, length) = (profile.time(), curve.end());
    let knots: Vec<f64> = curve.knots().collect();
    let pieces = (knots.len() - 1) as f64;
    let piece = |s: f64| {
        let i = knots.partition_point(|&k| k <= s).clamp(1, knots.len() - 1) - 1;
        (i as f64 + (s - knots[i]) / (knots[i + 1] - knots[i])) / pieces
    };
    let mut measure = vec![0.0];
    for i in 0..m {
        let (from, to) = (profile.s[i], profile.s[i + 1]);
        let share = profile.duration(i) / time + (to - from) / length + piece(to) - piece(from);
        measure.push(measure[i] + share / 3.0);
    }
    let mut i = 0;
    let mut grid: Vec<f64> = (0..=n)
        .map(|k| {
            let wanted = measure[m] * k as f64 / n as f64;
            while i + 1 < m && measure[i + 1] < wanted {
                i += 1;
            }
            let part = ((wanted - measure[i]) / (measure[i + 1] - measure[i])).clamp(0.0, 1.0);
            profile.s[i] + part * (profile.s[i + 1] - profile.s[i])
        })
        .collect();
    (grid[0], grid[n]) = (profile.s[0], profile.s[m]);
    grid
}
