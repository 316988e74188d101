//! Curves, decimated to the resolution of a figure.

use super::axis::{Axis, Rect};
use super::canvas::Canvas;
use super::color::Color;
use super::{HUGE, MAX_DOTS};

/// Largest number of line points in one figure, which bounds its file size (ten bytes each).
const MAX_POINTS: usize = 14_000;
/// Largest number of pieces of a line with gaps.
pub(super) const MAX_PIECES: usize = 100;

/// Largest number of dots that are drawn at full size.
const FEW_DOTS: usize = 60;

/// Drawing style of a curve.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Style {
    /// A solid line.
    #[default]
    Line,
    /// A thin solid line.
    Thin,
    /// A dashed line.
    Dashed,
    /// Separate dots, evenly thinned if there are too many.
    Points,
}

/// A curve: pairs of coordinates with a label.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Name in the legend; a curve with an empty one has no legend entry.
    pub label: String,
    /// Abscissae; excess values are ignored.
    pub x: Vec<f64>,
    /// Ordinates; a value that is not finite leaves a gap.
    pub y: Vec<f64>,
    /// Colour; `None`: the next of [`Color::CYCLE`].
    pub color: Option<Color>,
    /// Drawing style.
    pub style: Style,
}

impl Curve {
    /// Curve as a solid line in the next free colour.
    pub fn new(label: impl Into<String>, x: Vec<f64>, y: Vec<f64>) -> Self {
        Self { label: label.into(), x, y, color: None, style: Style::Line }
    }

    /// The curve in `color`.
    #[must_use]
    pub fn color(mut self, color: Color) -> Self {
        self.color = Some(color);
        self
    }

    /// The curve drawn as `style`.
    #[must_use]
    pub fn style(mut self, style: Style) -> Self {
        self.style = style;
        self
    }

    pub(super) fn pairs(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        self.x.iter().copied().zip(self.y.iter().copied())
    }
}

type Point = (f64, f64);

/// The lowest and the highest point of a pixel column, each with its index in the curve.
struct Bucket {
    number: i64,
    low: (usize, Point),
    high: (usize, Point),
}

/// Pieces of a line in pixels, with at most two points (lowest, highest) per column.
///
/// Gaps are kept where an entire column lacks values.
pub(super) fn decimate(points: &[Option<(f64, f64)>], x0: f64, x1: f64, columns: usize) -> Vec<Vec<(f64, f64)>> {
    let columns = columns.max(2);
    let sorted = points.iter().flatten().map(|p| p.0).is_sorted();
    let width = (x1 - x0).max(1.0) / columns as f64;
    let few = points.len() <= 2 * columns;
    let per_bucket = points.len().div_ceil(columns).max(1);
    let mut pieces: Vec<Vec<(f64, f64)>> = vec![vec![]];
    let mut bucket: Option<Bucket> = None;
    let mut missing = false;
    let flush = |bucket: &mut Option<Bucket>, pieces: &mut Vec<Vec<Point>>| {
        if let (Some(Bucket { low, high, .. }), Some(piece)) = (bucket.take(), pieces.last_mut()) {
            let (a, b) = if low.0 <= high.0 { (low, high) } else { (high, low) };
            piece.push(a.1);
            if a.0 != b.0 {
                piece.push(b.1);
            }
        }
    };
    for (index, point) in points.iter().enumerate() {
        let Some(p) = *point else {
            missing = true;
            continue;
        };
        let number = if few {
            index as i64
        } else if sorted {
            ((p.0 - x0) / width).floor() as i64
        } else {
            (index / per_bucket) as i64
        };
        match &mut bucket {
            // Pixel coordinates increase downwards.
            Some(b) if b.number == number => {
                if p.1 > b.low.1.1 {
                    b.low = (index, p);
                }
                if p.1 < b.high.1.1 {
                    b.high = (index, p);
                }
            }
            _ => {
                let jump = bucket.as_ref().is_some_and(|b| few || number - b.number > 1);
                flush(&mut bucket, &mut pieces);
                if missing && jump && pieces.len() < MAX_PIECES {
                    pieces.push(vec![]);
                }
                bucket = Some(Bucket { number, low: (index, p), high: (index, p) });
            }
        }
        missing = false;
    }
    flush(&mut bucket, &mut pieces);
    pieces.retain(|p| !p.is_empty());
    pieces
}

/// Draws one of `total` curves in a panel with its axes.
pub(super) fn plot(c: &mut Canvas, (r, x, y): (Rect, &Axis, &Axis), curve: &Curve, color: Color, total: usize) {
    let place = |(vx, vy): (f64, f64)| {
        let p = (r.x(x, vx)?, r.y(y, vy)?);
        r.has(p).then_some(p)
    };
    let points: Vec<Option<(f64, f64)>> = curve.pairs().map(place).collect();
    let total = total.max(1);
    if curve.style == Style::Points {
        let some: Vec<_> = points.into_iter().flatten().collect();
        let every = some.len().div_ceil((MAX_DOTS / total).max(1)).max(1);
        let radius = if some.len() <= FEW_DOTS { 3.0 } else { 1.5 };
        for p in some.iter().step_by(every) {
            c.dot(*p, radius, color, 0.8);
        }
        return;
    }
    let columns = ((r.x1 - r.x0) as usize).min(MAX_POINTS / (2 * total));
    // Dashes take more bytes than a line and are invisible in a dense band.
    let columns = if curve.style == Style::Dashed { columns / 4 } else { columns };
    for piece in decimate(&points, r.x0, r.x1, columns) {
        match curve.style {
            Style::Dashed if piece_length(&piece) < 4000.0 => c.dashed(&piece, color, 1.5),
            Style::Thin => c.polyline(&piece, color, 0.5),
            _ => c.polyline(&piece, color, if total > 8 || piece.len() > 600 { 1.0 } else { 1.5 }),
        }
    }
}

fn piece_length(piece: &[(f64, f64)]) -> f64 {
    piece.windows(2).map(|w| (w[1].0 - w[0].0).hypot(w[1].1 - w[0].1)).sum()
}

pub(super) fn usable(curves: &[Curve]) -> impl Iterator<Item = (f64, f64)> + '_ {
    let pairs = curves.iter().flat_map(Curve::pairs);
    pairs.filter(|(x, y)| x.abs() < HUGE && y.abs() < HUGE)
}
