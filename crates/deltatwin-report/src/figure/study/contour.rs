//! Level lines of values on a rectangular grid, by marching squares.

use std::collections::HashMap;

type Point = (f64, f64);

/// An edge of the grid: the node at its lower end, and whether it runs upwards (else to the right).
type Edge = (usize, usize, bool);

/// Lines along which `z[row][column]`, linear along the edges of the grid, has the value `level`, in the coordinates of
/// the grid.
///
/// Lines are as long as possible; closed ones end at their first point. Squares with a value that is not finite have no
/// line. In a saddle the mean of the four corners decides.
pub(super) fn contour(x: &[f64], y: &[f64], z: &[Vec<f64>], level: f64) -> Vec<Vec<Point>> {
    let mut segments: Vec<(Edge, Edge)> = Vec::new();
    for row in 0..y.len().saturating_sub(1) {
        for column in 0..x.len().saturating_sub(1) {
            segments.extend(square(z, row, column, level).into_iter().flatten());
        }
    }
    let point = |(row, column, up): Edge| {
        let (next_row, next_column) = if up { (row + 1, column) } else { (row, column + 1) };
        let (a, b) = (z[row][column], z[next_row][next_column]);
        let t = (level - a) / (b - a);
        (x[column] + t * (x[next_column] - x[column]), y[row] + t * (y[next_row] - y[row]))
    };
    joined(&segments).into_iter().map(|line| line.into_iter().map(point).collect()).collect()
}

/// Segments of one square of the grid.
fn square(z: &[Vec<f64>], row: usize, column: usize, level: f64) -> [Option<(Edge, Edge)>; 2] {
    // Corners counterclockwise from the lower left, edges between them.
    let corners = [z[row][column], z[row][column + 1], z[row + 1][column + 1], z[row + 1][column]];
    if corners.iter().any(|v| !v.is_finite()) {
        return [None, None];
    }
    let edges = [(row, column, false), (row, column + 1, true), (row + 1, column, false), (row, column, true)];
    let above = corners.map(|v| v >= level);
    let crossed: Vec<Edge> = (0..4).filter(|&k| above[k] != above[(k + 1) % 4]).map(|k| edges[k]).collect();
    match crossed[..] {
        [a, b] => [Some((a, b)), None],
        [bottom, right, top, left] => {
            let middle = corners.iter().sum::<f64>() / 4.0 >= level;
            // The line separates the corners that differ from the middle.
            if middle == above[0] {
                [Some((bottom, right)), Some((top, left))]
            } else {
                [Some((left, bottom)), Some((right, top))]
            }
        }
        _ => [None, None],
    }
}

/// Segments joined at their common edges, in the order of their first segment.
fn joined(segments: &[(Edge, Edge)]) -> Vec<Vec<Edge>> {
    let mut at: HashMap<Edge, Vec<usize>> = HashMap::new();
    for (k, (a, b)) in segments.iter().enumerate() {
        at.entry(*a).or_default().push(k);
        at.entry(*b).or_default().push(k);
    }
    let mut used = vec![false; segments.len()];
    let mut lines = Vec::new();
    for start in 0..segments.len() {
        if used[start] {
            continue;
        }
        used[start] = true;
        let (a, b) = segments[start];
        let mut line = vec![a, b];
        for _ in 0..2 {
            // To one end, then to the other.
            while let Some(end) = line.last().copied() {
                let next = at.get(&end).into_iter().flatten().copied().find(|&k| !used[k]);
                let Some(next) = next else { break };
                used[next] = true;
                let (a, b) = segments[next];
                line.push(if a == end { b } else { a });
            }
            line.reverse();
        }
        lines.push(line);
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_circle_is_one_closed_line_of_its_radius() {
        let x: Vec<f64> = (0..=40).map(|k| -1.0 + 0.05 * f64::from(k)).collect();
        let z: Vec<Vec<f64>> = x.iter().map(|y| x.iter().map(|x| x.hypot(*y)).collect()).collect();
        let lines = contour(&x, &x, &z, 0.7);
        assert_eq!(lines.len(), 1);
        assert_eq!(lines[0].first(), lines[0].last());
        // The chord of a grid of 0.05 deviates by h²/(8 r) at most.
        assert!(lines[0].iter().all(|p| (p.0.hypot(p.1) - 0.7).abs() < 5e-4));
        assert!(contour(&x, &x, &z, 2.0).is_empty());
    }

    #[test]
    fn a_plane_has_one_straight_line_and_holes_interrupt_it() {
        let x = [0.0, 1.0, 2.0, 4.0];
        let mut z: Vec<Vec<f64>> = x.iter().map(|y| x.iter().map(|x| x + y).collect()).collect();
        let lines = contour(&x, &x, &z, 2.5);
        assert_eq!(lines.len(), 1);
        assert!(lines[0].iter().all(|p| (p.0 + p.1 - 2.5).abs() < 1e-12));
        z[1][1] = f64::NAN;
        assert_eq!(contour(&x, &x, &z, 2.5).len(), 2);
        assert!(contour(&[], &[], &[], 0.0).is_empty());
    }

    #[test]
    fn a_saddle_follows_its_middle() {
        let x = [0.0, 1.0];
        for (high, cuts_high_corners) in [(3.0, false), (0.5, true)] {
            let z = [vec![high, -1.0], vec![-1.0, high]];
            let lines = contour(&x, &x, &z, 0.0);
            assert_eq!(lines.len(), 2);
            // High middle: the low corners are cut off; low middle: the high ones.
            let near_origin = lines.iter().any(|l| l.iter().all(|p| p.0 + p.1 < 1.0));
            assert_eq!(near_origin, cuts_high_corners, "{lines:?}");
        }
    }
}
