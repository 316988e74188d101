//! Cause map: what limits a motion, over two factors.

use std::collections::BTreeMap;

use super::super::axis::{Axis, Rect, axes, left_margin, no_data, range};
use super::super::canvas::{Align, Canvas, Lettering, draw, text_width};
use super::super::color::{Color, TEXT, WHITE};
use super::super::curve::{Curve, Style, plot};
use super::super::legend::{Entry, Swatch, head, legend};
use super::super::numbers::fixed;
use super::super::{Figure, LABEL_SIZE, MAX_DOTS, RIGHT, TICK_SIZE, WIDTH};
use super::contour::contour;
use super::{on_ground, small, usable};

/// One run of a cause map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CausePoint {
    /// First factor, along the horizontal axis.
    pub x: f64,
    /// Second factor.
    pub y: f64,
    /// Least margin: 1 unloaded, 0 at the limit, negative beyond it.
    pub margin: f64,
    /// Limiting cause, an index of [`CauseMap::causes`].
    pub cause: usize,
}

/// Content of a cause map.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CauseMap {
    /// Title.
    pub title: String,
    /// Label of the horizontal axis, with unit.
    pub x_label: String,
    /// Label of the vertical axis, with unit.
    pub y_label: String,
    /// Runs; on a rectangular grid they give an area with contours of the margin, otherwise dots.
    pub points: Vec<CausePoint>,
    /// Names of the causes.
    pub causes: Vec<String>,
    /// Lines to compare with, such as the hand formula's limit or the rated payload.
    pub curves: Vec<Curve>,
}

const HEIGHT: f64 = 400.0;
/// Opacity of the colour where a run fails, and where it survives.
const FAILED: f64 = 0.85;
const SURVIVED: f64 = 0.26;
/// Margins with a contour; 0 is the limit and drawn bold.
const LEVELS: [f64; 7] = [-1.0, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75];

/// Colours of causes, the same in every figure: known kinds have their own, others the next free one.
pub fn cause_colors(causes: &[String]) -> Vec<Color> {
    // Apart from the other seven for every kind of colour vision, unlike yellow, which is close to orange.
    const BROWN: Color = Color(0x7a, 0x52, 0x30);
    let [blue, vermilion, green, pink, orange, sky, dark] = Color::CYCLE;
    let known = |name: &str| match name {
        "socket" => Some(vermilion),
        "drive torque" => Some(blue),
        "speed" => Some(sky),
        "telescope" => Some(green),
        "workspace" => Some(pink),
        "contact" => Some(orange),
        "trip" => Some(dark),
        "following error" => Some(BROWN),
        _ => None,
    };
    let all = [vermilion, blue, green, orange, pink, sky, BROWN, dark];
    let taken: Vec<Color> = causes.iter().filter_map(|name| known(name)).collect();
    let mut free = all.iter().filter(|c| !taken.contains(c)).chain(all.iter().cycle()).copied();
    causes.iter().map(|name| known(name).or_else(|| free.next()).unwrap_or(Color::MUTED)).collect()
}

/// Map of the limiting causes, strong where a run fails and pale where it survives, with contours of the margin; that of
/// the limit, margin 0, is bold.
pub fn cause_map(map: &CauseMap) -> Figure {
    let points: Vec<CausePoint> =
        map.points.iter().copied().filter(|p| usable(p.x) && usable(p.y) && p.cause < map.causes.len()).collect();
    let grid = Grid::of(&points);
    let colors = cause_colors(&map.causes);
    let entries = entries(map, &points, &colors, grid.is_some());
    let (x, y) = match &grid {
        Some(grid) => (Some(extent(&grid.x)), Some(extent(&grid.y))),
        None => (range(points.iter().map(|p| p.x)), range(points.iter().map(|p| p.y))),
    };
    let pad = if grid.is_some() { 0.0 } else { 0.03 };
    let axis = |values: Option<(f64, f64)>, count| values.map(|r| Axis::linear(r, pad, count));
    let (x, y) = (axis(x, 10), axis(y, 8));
    let top = head(&entries);
    let left = left_margin(y.as_ref().map_or(0.0, Axis::label_width));
    let r = Rect { x0: left, y0: top, x1: WIDTH - RIGHT, y1: top + HEIGHT };
    draw(&map.title, r.y1 + 44.0, |c| {
        legend(c, &entries);
        let none = Axis { hi: 1.0, ..Axis::default() };
        let frame = |c: &mut Canvas| {
            axes(c, r, x.as_ref().unwrap_or(&none), y.as_ref().unwrap_or(&none), Some(&map.x_label), &map.y_label);
        };
        frame(c);
        let (Some(x), Some(y)) = (&x, &y) else { return no_data(c, r) };
        match &grid {
            Some(grid) => {
                grid.areas(c, (r, x, y), &colors);
                let lines = grid.contours(c, (r, x, y));
                let names = grid.names(c, (r, x, y), &map.causes);
                levels(c, r, &lines, names);
            }
            None => dots(c, (r, x, y), &points, &colors),
        }
        for curve in &map.curves {
            plot(c, (r, x, y), curve, curve.color.unwrap_or(TEXT), map.curves.len());
        }
        c.frame(r);
    })
}

fn entries(map: &CauseMap, points: &[CausePoint], colors: &[Color], grid: bool) -> Vec<Entry> {
    let mut entries = Vec::new();
    for (k, name) in map.causes.iter().enumerate() {
        let of = |failed: bool| points.iter().filter(|p| p.cause == k && (p.margin < 0.0) == failed).count();
        let (failed, survived) = (of(true), of(false));
        if failed + survived > 0 {
            entries.push((format!("{name}: {failed} fail, {survived} survive"), colors[k], Swatch::Box));
        }
    }
    if !entries.is_empty() {
        if grid {
            entries.push(("strong: fails, pale: survives".into(), WHITE, Swatch::Curve(Style::Thin)));
            entries.push(("limit, margin 0; thin: other margins".into(), TEXT, Swatch::Curve(Style::Line)));
        } else {
            entries.push(("dot: fails, ring: survives".into(), WHITE, Swatch::Curve(Style::Thin)));
        }
    }
    let named = map.curves.iter().filter(|c| !c.label.is_empty());
    entries.extend(named.map(|c| (c.label.clone(), c.color.unwrap_or(TEXT), Swatch::Curve(c.style))));
    entries
}

/// Runs of a design that is not a grid.
fn dots(c: &mut Canvas, (r, x, y): (Rect, &Axis, &Axis), points: &[CausePoint], colors: &[Color]) {
    let every = points.len().div_ceil(2 * MAX_DOTS).max(1);
    let size = if points.len() <= 300 { 4.0 } else { 2.5 };
    for p in points.iter().step_by(every) {
        let Some(at) = r.x(x, p.x).zip(r.y(y, p.y)) else { continue };
        if p.margin < 0.0 {
            c.dot(at, size, colors[p.cause], 0.9);
        } else {
            c.ring(at, size, colors[p.cause], 1.0);
        }
    }
}

/// Runs on a rectangular grid; a node without a run is `None`.
struct Grid {
    x: Vec<f64>,
    y: Vec<f64>,
    /// `nodes[row][column]`, rows along y.
    nodes: Vec<Vec<Option<CausePoint>>>,
}

/// First and last value of an axis. Nothing is drawn beyond what was run, so that cells at the edge are half as wide.
fn extent(values: &[f64]) -> (f64, f64) {
    (values[0], values[values.len() - 1])
}

/// Ends of the cell around one value.
fn cell(values: &[f64], k: usize) -> (f64, f64) {
    let (first, last) = extent(values);
    let low = if k == 0 { first } else { 0.5 * (values[k - 1] + values[k]) };
    let high = if k + 1 == values.len() { last } else { 0.5 * (values[k] + values[k + 1]) };
    (low, high)
}

/// Distinct values in ascending order; those closer than a millionth of the range are one.
fn distinct(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    let near = match (sorted.first(), sorted.last()) {
        (Some(a), Some(b)) => 1e-6 * (b - a),
        _ => 0.0,
    };
    sorted.dedup_by(|b, a| *b - *a <= near);
    sorted
}

impl Grid {
    /// The grid of the points; `None` if they are none, or fewer than three quarters of one.
    fn of(points: &[CausePoint]) -> Option<Self> {
        let (x, y) = (distinct(points.iter().map(|p| p.x)), distinct(points.iter().map(|p| p.y)));
        if x.len() < 2 || y.len() < 2 || 4 * points.len() < 3 * x.len() * y.len() {
            return None;
        }
        let mut nodes = vec![vec![None; x.len()]; y.len()];
        let nearest = |values: &[f64], v: f64| {
            let k = values.partition_point(|other| *other < v);
            let below = k.saturating_sub(1);
            if k == values.len() || v - values[below] < values[k] - v { below } else { k }
        };
        for p in points {
            nodes[nearest(&y, p.y)][nearest(&x, p.x)] = Some(*p);
        }
        Some(Self { x, y, nodes })
    }

    /// Cause of a node, and whether it failed.
    fn look(&self, row: usize, column: usize) -> Option<(usize, bool)> {
        self.nodes[row][column].map(|p| (p.cause, p.margin < 0.0))
    }

    /// Left, right, top and bottom of a cell in pixels.
    fn place(&self, (r, x, y): (Rect, &Axis, &Axis), row: usize, column: usize) -> Option<[f64; 4]> {
        let (left, right) = cell(&self.x, column);
        let (low, high) = cell(&self.y, row);
        let clip = |v: f64, a: f64, b: f64| v.clamp(a, b);
        Some([
            clip(r.x(x, left)?, r.x0, r.x1),
            clip(r.x(x, right)?, r.x0, r.x1),
            clip(r.y(y, high)?, r.y0, r.y1),
            clip(r.y(y, low)?, r.y0, r.y1),
        ])
    }

    /// One polygon per cause, for failed and for survived runs: cells drawn one by one would leave seams.
    fn areas(&self, c: &mut Canvas, frame: (Rect, &Axis, &Axis), colors: &[Color]) {
        for (cause, color) in colors.iter().enumerate() {
            for (failed, alpha) in [(true, FAILED), (false, SURVIVED)] {
                let loops = self.outlines((cause, failed));
                let Some(start) = loops.first().and_then(|l| l.first()).copied() else { continue };
                // All outlines in one: back to the start after each, along a line of no width.
                let corners = loops.iter().flat_map(|l| l.iter().chain(l.first()).copied().chain([start]));
                let polygon: Vec<(f64, f64)> = corners.filter_map(|corner| self.corner(frame, corner)).collect();
                c.polygon(&polygon, *color, alpha);
            }
        }
    }

    /// Closed outlines of the cells with a look, as corners (row, column) of the cells, the area to the left.
    fn outlines(&self, look: (usize, bool)) -> Vec<Vec<(usize, usize)>> {
        let (rows, columns) = (self.y.len(), self.x.len());
        let inside = |row: usize, column: usize| row < rows && column < columns && self.look(row, column) == Some(look);
        let mut next: BTreeMap<(usize, usize), Vec<(usize, usize)>> = BTreeMap::new();
        for row in 0..rows {
            for column in (0..columns).filter(|&k| inside(row, k)) {
                let corners = [(row, column), (row, column + 1), (row + 1, column + 1), (row + 1, column)];
                let beyond = [
                    inside(row.wrapping_sub(1), column),
                    inside(row, column + 1),
                    inside(row + 1, column),
                    inside(row, column.wrapping_sub(1)),
                ];
                for k in (0..4).filter(|&k| !beyond[k]) {
                    next.entry(corners[k]).or_default().push(corners[(k + 1) % 4]);
                }
            }
        }
        let mut loops = Vec::new();
        while let Some((&start, _)) = next.iter().find(|(_, ends)| !ends.is_empty()) {
            let (mut outline, mut at) = (Vec::new(), start);
            while let Some(end) = next.get_mut(&at).and_then(Vec::pop) {
                // Corners on a straight line are left out.
                let n = outline.len();
                let straight =
                    |a: (usize, usize), b: (usize, usize)| a.0 == b.0 && b.0 == end.0 || a.1 == b.1 && b.1 == end.1;
                if n == 0 || !straight(outline[n - 1], at) {
                    outline.push(at);
                }
                at = end;
            }
            loops.push(outline);
        }
        loops
    }

    /// A corner of the cells in pixels.
    fn corner(&self, (r, x, y): (Rect, &Axis, &Axis), (row, column): (usize, usize)) -> Option<(f64, f64)> {
        let low = |values: &[f64], k: usize| if k < values.len() { cell(values, k).0 } else { cell(values, k - 1).1 };
        let at = (r.x(x, low(&self.x, column))?, r.y(y, low(&self.y, row))?);
        Some((at.0.clamp(r.x0, r.x1), at.1.clamp(r.y0, r.y1)))
    }

    /// Contours of the margin with their levels, in pixels.
    fn contours(&self, c: &mut Canvas, (r, x, y): (Rect, &Axis, &Axis)) -> Vec<(f64, Vec<(f64, f64)>)> {
        let margin = |p: &Option<CausePoint>| p.map_or(f64::NAN, |p| p.margin);
        let z: Vec<Vec<f64>> = self.nodes.iter().map(|row| row.iter().map(margin).collect()).collect();
        let mut lines = Vec::new();
        for level in LEVELS {
            for line in contour(&self.x, &self.y, &z, level) {
                let at: Vec<(f64, f64)> = line.iter().filter_map(|p| r.x(x, p.0).zip(r.y(y, p.1))).collect();
                if level == 0.0 {
                    c.polyline(&at, WHITE, 5.0);
                    c.polyline(&at, TEXT, 3.0);
                } else {
                    c.polyline(&at, TEXT, 0.8);
                }
                lines.push((level, at));
            }
        }
        lines
    }

    /// The name of every cause in its largest areas of failed and of survived runs, where it fits; their places.
    fn names(&self, c: &mut Canvas, frame: (Rect, &Axis, &Axis), causes: &[String]) -> Vec<((f64, f64), f64)> {
        let mut placed = Vec::new();
        for (cause, failed) in (0..causes.len()).flat_map(|k| [(k, true), (k, false)]) {
            let Some((row, column, depth)) = self.deepest((cause, failed)) else { continue };
            let Some([left, right, top, bottom]) = self.place(frame, row, column) else { continue };
            let text = format!("{} {}", causes[cause], if failed { "fails" } else { "nearest" });
            // The area around the cell, from its distance to other cells.
            let reach = (2 * depth - 1) as f64;
            let room = ((right - left) * reach, (bottom - top) * reach);
            let width = text_width(&text, LABEL_SIZE) + 8.0;
            let lettering = Lettering::new(LABEL_SIZE, TEXT, Align::Middle).bold(failed);
            let at = (0.5 * (left + right), 0.5 * (top + bottom));
            if room.0 >= width && room.1 >= LABEL_SIZE + 4.0 {
                on_ground(c, &text, at, lettering);
                placed.push((at, 0.5 * width));
                continue;
            }
            // A tall and narrow area is named upwards; its height is that of its column.
            let same = |k: &usize| self.look(*k, column) == Some((cause, failed));
            let below = (0..=row).rev().take_while(same).count();
            let above = (row..self.y.len()).take_while(same).count();
            let middle = row + above - (above + below) / 2;
            if (above + below - 1) as f64 * (bottom - top) >= width
                && room.0 >= LABEL_SIZE
                && let Some([_, _, top, bottom]) = self.place(frame, middle.min(self.y.len() - 1), column)
            {
                let at = (at.0, 0.5 * (top + bottom));
                on_ground(c, &text, at, lettering.upright());
                placed.push((at, 0.5 * LABEL_SIZE));
            }
        }
        placed
    }

    /// The node of a look farthest from all others, in steps of the grid, and that distance.
    fn deepest(&self, look: (usize, bool)) -> Option<(usize, usize, usize)> {
        let (rows, columns) = (self.y.len(), self.x.len());
        let mut best: Option<(usize, usize, usize)> = None;
        for row in 0..rows {
            for column in 0..columns {
                if self.look(row, column) != Some(look) {
                    continue;
                }
                let edge = (row + 1).min(rows - row).min(column + 1).min(columns - column);
                let beyond = best.map_or(0, |b| b.2);
                // Only a node that is better than the best so far is worth its ring of neighbours.
                let clear = (1..edge).take_while(|&d| self.ring(row, column, d, look)).count() + 1;
                if clear > beyond {
                    best = Some((row, column, clear));
                }
            }
        }
        best
    }

    /// Whether all nodes at the distance `d` from a node have a look.
    fn ring(&self, row: usize, column: usize, d: usize, look: (usize, bool)) -> bool {
        let (rows, columns) = (row - d..=row + d, column - d..=column + d);
        let mut at = rows.flat_map(|i| columns.clone().map(move |k| (i, k)));
        at.all(|(i, k)| i.abs_diff(row).max(k.abs_diff(column)) < d || self.look(i, k) == Some(look))
    }
}

/// Writes the level of each contour on it, clear of the texts at `taken` (middle and half width).
fn levels(c: &mut Canvas, r: Rect, lines: &[(f64, Vec<(f64, f64)>)], mut taken: Vec<((f64, f64), f64)>) {
    for (level, line) in lines {
        let length: f64 = line.windows(2).map(|w| (w[1].0 - w[0].0).hypot(w[1].1 - w[0].1)).sum();
        let text = if *level == 0.0 { "limit".to_owned() } else { fixed(*level, 2) };
        let half = 0.5 * text_width(&text, TICK_SIZE) + 3.0;
        let free = |at: &(f64, f64)| {
            let apart = |(p, other): &((f64, f64), f64)| {
                (p.0 - at.0).abs() > half + other || (p.1 - at.1).abs() > TICK_SIZE + 5.0
            };
            at.0 - half > r.x0 && at.0 + half < r.x1 && taken.iter().all(apart)
        };
        let places = [0.62, 0.35, 0.8, 0.5, 0.2].map(|share| along(line, share, length));
        if let Some(at) = places.into_iter().find(free).filter(|_| length > 60.0) {
            on_ground(c, &text, at, small(Align::Middle).bold(*level == 0.0));
            taken.push((at, half));
        }
    }
}

/// Point of a line at a share of its length.
fn along(line: &[(f64, f64)], share: f64, length: f64) -> (f64, f64) {
    let mut left = share * length;
    for w in line.windows(2) {
        let step = (w[1].0 - w[0].0).hypot(w[1].1 - w[0].1);
        if step >= left && step > 0.0 {
            let t = left / step;
            return (w[0].0 + t * (w[1].0 - w[0].0), w[0].1 + t * (w[1].1 - w[0].1));
        }
        left -= step;
    }
    line.last().copied().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(rows: &[&str]) -> Grid {
        let letters = |(i, row): (usize, &&str)| -> Vec<CausePoint> {
            let point = |(k, letter): (usize, char)| CausePoint {
                x: k as f64,
                y: i as f64,
                margin: -1.0,
                cause: usize::from(letter == 'b'),
            };
            row.chars().enumerate().map(point).collect()
        };
        Grid::of(&rows.iter().enumerate().flat_map(letters).collect::<Vec<_>>()).unwrap()
    }

    /// Twice the signed area of an outline, positive counterclockwise.
    fn area(outline: &[(usize, usize)]) -> i64 {
        let next = outline.iter().cycle().skip(1);
        outline.iter().zip(next).map(|(a, b)| (a.1 * b.0) as i64 - (b.1 * a.0) as i64).sum()
    }

    #[test]
    fn outlines_enclose_their_cells_and_spare_holes() {
        let ring = grid(&["aaaa", "abba", "aaaa", "aaba"]);
        let (outer, inner) = (ring.outlines((0, true)), ring.outlines((1, true)));
        let sum = |loops: &[Vec<(usize, usize)>]| loops.iter().map(|l| area(l)).sum::<i64>();
        assert_eq!((sum(&outer), sum(&inner)), (2 * 13, 2 * 3));
        assert_eq!((outer.len(), inner.len()), (2, 2));
        assert!(ring.outlines((0, false)).is_empty());
        // A straight side is one edge, but for the corner at which an outline starts.
        assert!(grid(&["aa", "aa"]).outlines((0, true))[0].len() <= 5);
        let checks = grid(&["abab", "baba", "abab"]);
        assert_eq!(sum(&checks.outlines((0, true))), 2 * 6);
    }
}
