//! Scatter plots with binned means.

use super::axis::{Axis, range};
use super::curve::{Curve, usable};
use super::framed::framed;
use super::legend::{Swatch, colours};
use super::{Figure, MAX_DOTS};

/// Abscissa, mean and standard deviation of the points in a bin.
type Bin = (f64, f64, f64);

/// Bins of a curve over a range; `None` for bins with fewer than three points.
fn binned(curve: &Curve, (lo, hi): (f64, f64), bins: usize) -> Vec<Option<Bin>> {
    let width = (hi - lo) / bins as f64;
    // Count, mean and sum of squared deviations of every bin.
    let mut sums = vec![(0.0, 0.0, 0.0); bins];
    for (x, y) in usable(std::slice::from_ref(curve)) {
        let k = if width > 0.0 { ((x - lo) / width) as usize } else { 0 };
        let s = &mut sums[k.min(bins - 1)];
        s.0 += 1.0;
        let d = y - s.1;
        s.1 += d / s.0;
        s.2 += d * (y - s.1);
    }
    let bin = |(k, s): (usize, &(f64, f64, f64))| {
        let x = lo + (k as f64 + 0.5) * width;
        (s.0 >= 3.0).then(|| (x, s.1, (s.2 / (s.0 - 1.0)).max(0.0).sqrt()))
    };
    sums.iter().enumerate().map(bin).collect()
}

/// Runs of consecutive non-empty bins.
fn runs(row: &[Option<Bin>]) -> Vec<Vec<Bin>> {
    let run = |run: &[Option<Bin>]| run.iter().flatten().copied().collect::<Vec<_>>();
    row.split(Option::is_none).map(run).filter(|run| !run.is_empty()).collect()
}

/// At most `most` points of a curve; the step is irregular, because regular thinning would alias with a periodic
/// motion.
fn thinned(curve: &Curve, most: usize) -> Vec<(f64, f64)> {
    let some: Vec<_> = usable(std::slice::from_ref(curve)).collect();
    let want = most.max(1).min(some.len());
    let point = |k: usize| {
        let jitter = (k as f64 * 0.618_033_988_75).fract();
        let index = ((k as f64 + jitter) * some.len() as f64 / want as f64) as usize;
        some[index.min(some.len() - 1)]
    };
    (0..want).map(point).collect()
}

/// Scatter plot: a thinned cloud of samples, and in each of `bins` equal bins the mean and a band of one standard
/// deviation on both sides.
///
/// Bins with fewer than three samples are omitted. The vertical range covers the bands and the middle 98 % of the
/// samples.
pub fn scatter_binned(title: &str, x_label: &str, y_label: &str, curves: &[Curve], bins: usize) -> Figure {
    let bins = bins.clamp(1, 400);
    let (colors, mut entries) = colours(curves.iter());
    for entry in &mut entries {
        entry.2 = Swatch::Band;
        entry.0.push_str(" (mean ± 1 s.d.)");
    }
    let x_range = range(usable(curves).map(|p| p.0));
    let mut means: Vec<Vec<Option<Bin>>> = Vec::new();
    let mut extent = None;
    if let Some(x_range) = x_range {
        means = curves.iter().map(|curve| binned(curve, x_range, bins)).collect();
        let mut ys: Vec<f64> = usable(curves).map(|p| p.1).collect();
        ys.sort_by(f64::total_cmp);
        let cut = if ys.len() > 100 { ys.len() / 100 } else { 0 };
        let bands = means.iter().flatten().flatten().flat_map(|m| [m.1 - m.2, m.1 + m.2]);
        extent = range(bands.chain([ys[cut], ys[ys.len() - 1 - cut]]));
    }
    let x = x_range.map(|r| Axis::linear(r, 0.01, 10));
    let y = extent.map(|r| Axis::linear(r, 0.05, 7));
    framed(title, &entries, 0.0, (x, x_label), (y, y_label), |c, r, x, y| {
        let at = |vx: f64, vy: f64| Some((r.x(x, vx)?, r.y(y, vy)?)).filter(|p| r.has(*p));
        for (curve, color) in curves.iter().zip(&colors) {
            for (vx, vy) in thinned(curve, MAX_DOTS / curves.len().max(1)) {
                if let Some(p) = at(vx, vy) {
                    c.dot(p, 1.0, *color, 0.3);
                }
            }
        }
        for (row, color) in means.iter().zip(&colors) {
            for run in runs(row) {
                let upper = run.iter().filter_map(|m| at(m.0, m.1 + m.2));
                let lower = run.iter().rev().filter_map(|m| at(m.0, m.1 - m.2));
                let outline: Vec<_> = upper.chain(lower).collect();
                if run.len() > 1 {
                    c.polygon(&outline, *color, 0.2);
                } else if let [a, b] = outline[..] {
                    c.line(a, b, *color, 1.0);
                }
            }
        }
        for (row, color) in means.iter().zip(&colors) {
            for run in runs(row) {
                let line: Vec<_> = run.iter().filter_map(|m| at(m.0, m.1)).collect();
                c.polyline(&line, *color, 2.0);
                if bins <= 60 {
                    for p in line {
                        c.dot(p, 2.5, *color, 1.0);
                    }
                }
            }
        }
    })
}
