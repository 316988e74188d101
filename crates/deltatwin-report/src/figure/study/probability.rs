//! Probabilities over a quantity, with their intervals and fitted curves.

use super::super::axis::{Axis, Rect, range};
use super::super::canvas::{Align, Canvas};
use super::super::color::{Color, QUIET, TEXT};
use super::super::framed::framed;
use super::super::legend::{Entry, Swatch};
use super::super::rates::Rate;
use super::super::{Figure, TICK_SIZE};
use super::{on_ground, small, usable};

/// A fitted curve at one abscissa.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Banded {
    /// Abscissa.
    pub x: f64,
    /// Probability.
    pub value: f64,
    /// Lower end of its interval.
    pub low: f64,
    /// Upper end of its interval.
    pub high: f64,
}

/// Measured shares and the curve fitted to them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ProbabilityCurve {
    /// Name in the legend.
    pub name: String,
    /// Shares with their intervals.
    pub points: Vec<Rate>,
    /// Fitted curve with its band, ascending in x; empty without a fit.
    pub fit: Vec<Banded>,
    /// Abscissa at which the curve has the figure's reference probability, with its interval `[value, low, high]`.
    pub mark: Option<[f64; 3]>,
}

/// Fragility curves: probability of failure over a demand, with the demand at which half fail.
///
/// Dots are shares of runs with their intervals, lines the fitted curves with their bands. The horizontal axis is
/// logarithmic if the demands span more than a factor of 12.
pub fn fragility(title: &str, x_label: &str, curves: &[ProbabilityCurve]) -> Figure {
    probability(title, (x_label, "probability of failure"), curves, 0.5)
}

/// Power curves: probability of naming an effect over its size, with the size that is named in four of five cases.
pub fn power(title: &str, x_label: &str, curves: &[ProbabilityCurve]) -> Figure {
    probability(title, (x_label, "probability of naming it"), curves, 0.8)
}

fn probability(title: &str, labels: (&str, &str), curves: &[ProbabilityCurve], reference: f64) -> Figure {
    let values = || {
        let points = curves.iter().flat_map(|c| c.points.iter().map(|p| p.x));
        points.chain(curves.iter().flat_map(|c| c.fit.iter().map(|p| p.x)))
    };
    let x = range(values()).map(|(lo, hi)| {
        if lo > 0.0 && hi / lo > 12.0 { Axis::log((lo / 1.1, hi * 1.1), 8) } else { Axis::linear((lo, hi), 0.03, 10) }
    });
    let color = |k: usize| Color::CYCLE[k % Color::CYCLE.len()];
    let entries: Vec<Entry> = curves
        .iter()
        .enumerate()
        .map(|(k, c)| (c.name.clone(), color(k), Swatch::Band))
        .filter(|e| !e.0.is_empty())
        .collect();
    let y = x.as_ref().map(|_| Axis::linear((0.0, 1.0), 0.03, 6));
    framed(title, &entries, 0.0, (x, labels.0), (y, labels.1), |c, r, x, y| {
        let level = r.y(y, reference).unwrap_or(r.y0);
        c.dashed(&[(r.x0, level), (r.x1, level)], Color::MUTED, 1.0);
        // All bands first, so that none covers a line.
        for (k, curve) in curves.iter().enumerate() {
            band(c, (r, x, y), curve, color(k));
        }
        for (k, curve) in curves.iter().enumerate() {
            line(c, (r, x, y), curve, color(k));
        }
        let mut row = 0;
        for (k, curve) in curves.iter().enumerate() {
            let Some(mark) = curve.mark.filter(|m| m.iter().all(|v| usable(*v))) else { continue };
            marked(c, (r, x, y), mark, (color(k), level));
            let decimals = super::super::numbers::significant;
            let text = format!("{} ({}–{})", decimals(mark[0]), decimals(mark[1]), decimals(mark[2]));
            let text = if curve.name.is_empty() { text } else { format!("{}: {text}", curve.name) };
            let at = (r.x1 - 8.0, r.y1 - 14.0 - 16.0 * f64::from(row));
            on_ground(c, &text, at, super::Lettering { color: color(k), ..small(Align::Right) });
            row += 1;
        }
        if row > 0 {
            let text = format!("{:.0} % at (95 % interval)", 100.0 * reference);
            let at = (r.x1 - 8.0, r.y1 - 14.0 - 16.0 * f64::from(row));
            on_ground(c, &text, at, super::Lettering { color: QUIET, ..small(Align::Right) });
        }
    })
}

fn place((r, x, y): (Rect, &Axis, &Axis), vx: f64, vy: f64) -> Option<(f64, f64)> {
    Some((r.x(x, vx)?, r.y(y, vy.clamp(0.0, 1.0))?)).filter(|p| r.has(*p))
}

fn band(c: &mut Canvas, frame: (Rect, &Axis, &Axis), curve: &ProbabilityCurve, color: Color) {
    let side = |end: fn(&Banded) -> f64| -> Vec<(f64, f64)> {
        curve.fit.iter().filter_map(|p| place(frame, p.x, end(p))).collect()
    };
    let mut outline = side(|p| p.low);
    outline.extend(side(|p| p.high).into_iter().rev());
    if outline.len() > 3 {
        c.polygon(&outline, color, 0.16);
    }
}

fn line(c: &mut Canvas, frame: (Rect, &Axis, &Axis), curve: &ProbabilityCurve, color: Color) {
    let fit: Vec<_> = curve.fit.iter().filter_map(|p| place(frame, p.x, p.value)).collect();
    c.polyline(&fit, color, 2.0);
    for p in &curve.points {
        let ends = place(frame, p.x, p.low).zip(place(frame, p.x, p.high)).zip(place(frame, p.x, p.share));
        let Some(((low, high), middle)) = ends else { continue };
        c.line(low, high, color, 1.2);
        for end in [low, high] {
            c.line((end.0 - 3.5, end.1), (end.0 + 3.5, end.1), color, 1.2);
        }
        c.dot(middle, 3.5, color, 1.0);
        // Without a curve to follow, the dots are joined and their numbers written.
        if curve.fit.is_empty() {
            c.write(&p.of.to_string(), (middle.0 + 7.0, middle.1 + 9.0), TICK_SIZE, TEXT, Align::Left);
        }
    }
    if curve.fit.is_empty() {
        let joined: Vec<_> = curve.points.iter().filter_map(|p| place(frame, p.x, p.share)).collect();
        c.polyline(&joined, color, 0.8);
    }
}

/// Where a curve has the reference probability, with the interval on the axis.
fn marked(c: &mut Canvas, (r, x, _): (Rect, &Axis, &Axis), mark: [f64; 3], (color, level): (Color, f64)) {
    let [Some(at), Some(low), Some(high)] = mark.map(|v| r.x(x, v)) else { return };
    if at < r.x0 || at > r.x1 {
        return;
    }
    c.dashed(&[(at, level), (at, r.y1)], color, 1.0);
    let (low, high) = (low.clamp(r.x0, r.x1), high.clamp(r.x0, r.x1));
    c.line((low, r.y1 - 3.0), (high, r.y1 - 3.0), color, 3.0);
}
