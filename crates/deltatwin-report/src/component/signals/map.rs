//! Residuals over the workspace: RMS in cells seen from above and from the side.

use deltatwin::identification::Dataset;
use deltatwin::model::Model;
use serde_json::{Value, json};

use super::places::short;

/// Number of cells along the longer side of the workspace.
const CELLS: usize = 24;
/// Least number of samples of a cell.
const FEW: u32 = 10;

/// RMS residuals in noise floors per cell of the x-y and the x-z plane, for every channel and stage and, first, for the
/// root mean square over all channels; null for a machine without platform.
pub fn of(model: &Model, dataset: &Dataset, left: &[Vec<Vec<f64>>], noise: &[f64]) -> Value {
    let plant = dataset.plant(model);
    if !plant.assembled {
        return Value::Null;
    }
    let points: Result<Vec<[f64; 3]>, _> =
        dataset.joints.iter().map(|j| plant.geometry.forward(&j.q).map(Into::into)).collect();
    let Ok(points) = points else { return Value::Null };
    let views = [("from above", 0, 1), ("from the side", 0, 2)];
    let view = |(name, a, b): (&str, usize, usize)| {
        let Some(grid) = Grid::of(&points, a, b) else { return Value::Null };
        let stages: Vec<Value> = left.iter().map(|l| grid.stage(l, noise)).collect();
        let axes = ["x", "y", "z"];
        json!({
            "name": name, "axes": [axes[a], axes[b]], "low": grid.low, "cell": grid.cell, "size": grid.size,
            "stages": stages,
        })
    };
    views.into_iter().map(view).collect()
}

/// Square cells over two coordinates.
struct Grid {
    low: [f64; 2],
    cell: f64,
    size: [usize; 2],
    /// Cell of every sample.
    of: Vec<usize>,
}

impl Grid {
    fn of(points: &[[f64; 3]], a: usize, b: usize) -> Option<Self> {
        let range = |k: usize| {
            points.iter().map(|p| p[k]).fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)))
        };
        let (first, second) = (range(a), range(b));
        let longer = (first.1 - first.0).max(second.1 - second.0);
        if !longer.is_finite() || longer <= 0.0 {
            return None;
        }
        let cell = longer / CELLS as f64;
        let count = |(low, high): (f64, f64)| (((high - low) / cell).ceil() as usize).clamp(1, CELLS);
        let size = [count(first), count(second)];
        let at = |x: f64, low: f64, n: usize| (((x - low) / cell) as usize).min(n - 1);
        let of = points.iter().map(|p| at(p[b], second.0, size[1]) * size[0] + at(p[a], first.0, size[0])).collect();
        Some(Self { low: [first.0, second.0], cell, size, of })
    }

    /// RMS in noise floors per cell: over all channels, then per channel.
    fn stage(&self, left: &[Vec<f64>], noise: &[f64]) -> Value {
        let cells = self.size[0] * self.size[1];
        let mut count = vec![0_u32; cells];
        self.of.iter().for_each(|cell| count[*cell] += 1);
        let mut all = vec![0.0; cells];
        let known = |c: usize| noise.get(c).copied().filter(|n| *n > 0.0);
        let with_noise = (0..left.len()).filter(|c| known(*c).is_some()).count().max(1);
        let mut layers = Vec::new();
        for (c, series) in left.iter().enumerate() {
            let mut squares = vec![0.0; cells];
            let floor = known(c).unwrap_or(1.0);
            self.of.iter().zip(series).for_each(|(cell, r)| squares[*cell] += (r / floor).powi(2));
            if known(c).is_some() {
                all.iter_mut().zip(&squares).for_each(|(sum, s)| *sum += s / with_noise as f64);
            }
            layers.push(rooted(&squares, &count));
        }
        layers.insert(0, rooted(&all, &count));
        layers.into()
    }
}

/// Root mean squares of sums of squares; null for cells of few samples.
fn rooted(squares: &[f64], count: &[u32]) -> Value {
    let one = |(s, n): (&f64, &u32)| if *n < FEW { Value::Null } else { short((s / f64::from(*n)).sqrt()) };
    squares.iter().zip(count).map(one).collect()
}
