//! Shares with their confidence intervals.

use super::axis::{Axis, Rect, axes, left_margin, no_data, range};
use super::canvas::{Align, draw};
use super::color::{Color, QUIET};
use super::curve::Style;
use super::legend::{Entry, Swatch, head, legend};
use super::{Figure, RIGHT, TICK_SIZE, WIDTH};

/// Share of successes in a number of trials.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rate {
    /// Abscissa.
    pub x: f64,
    /// Share of successes.
    pub share: f64,
    /// Lower end of its interval.
    pub low: f64,
    /// Upper end of its interval.
    pub high: f64,
    /// Number of trials.
    pub of: usize,
}

/// Shares from 0 to 1 over a quantity, each with its interval and its number of trials. `diagonal` draws the
/// identity, the expected shares if the quantity is a claimed probability.
pub fn rates(title: &str, x_label: &str, y_label: &str, points: &[Rate], diagonal: bool) -> Figure {
    let extent = if diagonal { Some((0.0, 1.0)) } else { range(points.iter().map(|p| p.x)) };
    let x = extent.map(|r| Axis::linear(r, 0.03, 10));
    let y = Axis::linear((0.0, 1.0), 0.03, 6);
    let mut entries: Vec<Entry> =
        vec![("share, its 95 % interval and the number of trials".into(), Color::BLUE, Swatch::Curve(Style::Points))];
    if diagonal {
        entries.push(("as claimed".into(), Color::MUTED, Swatch::Curve(Style::Dashed)));
    }
    let y0 = head(&entries);
    let r = Rect { x0: left_margin(y.label_width()), y0, x1: WIDTH - RIGHT, y1: y0 + 300.0 };
    draw(title, r.y1 + 44.0, |c| {
        legend(c, &entries);
        let none = Axis { hi: 1.0, ..Axis::default() };
        axes(c, r, x.as_ref().unwrap_or(&none), &y, Some(x_label), y_label);
        let Some(x) = x.filter(|_| !points.is_empty()) else { return no_data(c, r) };
        let at = |vx: f64, vy: f64| Some((r.x(&x, vx)?, r.y(&y, vy.clamp(0.0, 1.0))?)).filter(|p| r.has(*p));
        if diagonal && let (Some(a), Some(b)) = (at(0.0, 0.0), at(1.0, 1.0)) {
            c.dashed(&[a, b], Color::MUTED, 1.5);
        }
        let line: Vec<_> = points.iter().filter_map(|p| at(p.x, p.share)).collect();
        c.polyline(&line, Color::BLUE, 1.0);
        for p in points {
            let (Some(low), Some(high), Some(mid)) = (at(p.x, p.low), at(p.x, p.high), at(p.x, p.share)) else {
                continue;
            };
            c.line(low, high, Color::BLUE, 1.5);
            for end in [low, high] {
                c.line((end.0 - 4.0, end.1), (end.0 + 4.0, end.1), Color::BLUE, 1.5);
            }
            c.dot(mid, 4.0, Color::BLUE, 1.0);
            // Next to the dot, on the side away from the edge.
            let right = mid.0 < r.x1 - 40.0;
            let (dx, align) = if right { (8.0, Align::Left) } else { (-8.0, Align::Right) };
            let below = if mid.1 > r.y1 - 16.0 { -9.0 } else { 9.0 };
            c.write(&p.of.to_string(), (mid.0 + dx, mid.1 + below), TICK_SIZE, QUIET, align);
        }
    })
}
