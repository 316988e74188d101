//! Importance of factors: one at a time beside all together.

use super::super::axis::{Axis, Rect, axes, no_data, range};
use super::super::canvas::{Align, Canvas, Lettering, draw, shorten, text_width};
use super::super::color::{Color, FRAME, QUIET, TEXT};
use super::super::legend::{Entry, Swatch, head, legend};
use super::super::numbers::fixed;
use super::super::{Figure, LABEL_SIZE, RIGHT, TICK_SIZE, WIDTH};
use super::{on_ground, small, usable};

/// An estimate with its interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Value.
    pub value: f64,
    /// Lower end of its 95 % interval.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// Importance of one factor.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Importance {
    /// Factor.
    pub name: String,
    /// Its low and its high value with unit, such as `1 to 5 kg`; may be empty.
    pub span: String,
    /// Output at the low and at the high value, all other factors nominal.
    pub swing: Option<[f64; 2]>,
    /// First-order Sobol' index.
    pub first: Option<Estimate>,
    /// Total Sobol' index.
    pub total: Option<Estimate>,
}

const ROW: f64 = 34.0;
const LOW: Color = Color::SKY;
const HIGH: Color = Color::OCHRE;
const FIRST: Color = Color::MEASURED;
const TOTAL: Color = Color::MUTED;

/// Tornado diagram of `output` around its `nominal` value beside the Sobol' indices of the same factors, in the given
/// order. A half without data is left out.
pub fn importance(title: &str, output: &str, nominal: Option<f64>, rows: &[Importance]) -> Figure {
    let swings = rows.iter().any(|r| r.swing.is_some());
    let indices = rows.iter().any(|r| r.first.is_some() || r.total.is_some());
    let mut entries: Vec<Entry> = Vec::new();
    if swings {
        entries.push(("factor at its low value".into(), LOW, Swatch::Box));
        entries.push(("at its high value".into(), HIGH, Swatch::Box));
    }
    if indices {
        entries.push(("first order: alone".into(), FIRST, Swatch::Box));
        entries.push(("total: with all interactions; whiskers 95 %".into(), TOTAL, Swatch::Box));
    }
    let texts = rows.iter().flat_map(|r| [text_width(&r.name, LABEL_SIZE), text_width(&r.span, TICK_SIZE)]);
    let names = texts.fold(40.0, f64::max).min(230.0);
    let (x0, top) = (12.0 + names + 12.0, head(&entries) + 12.0);
    let y1 = top + ROW * rows.len().max(2) as f64;
    let both = swings && indices;
    let end = WIDTH - RIGHT;
    let middle = if both { x0 + 0.54 * (end - x0) } else { end };
    let left = Rect { x0, y0: top, x1: middle, y1 };
    let right = Rect { x0: if both { middle + 26.0 } else { x0 }, x1: end, ..left };
    draw(title, y1 + 44.0, |c| {
        legend(c, &entries);
        for (k, row) in rows.iter().enumerate() {
            let y = top + (k as f64 + 0.5) * ROW;
            let lift = if row.span.is_empty() { 0.0 } else { 7.0 };
            let name = shorten(&row.name, names, LABEL_SIZE);
            c.write(&name, (x0 - 8.0, y - lift), LABEL_SIZE, TEXT, Align::Right);
            c.write(&shorten(&row.span, names, TICK_SIZE), (x0 - 8.0, y + lift), TICK_SIZE, QUIET, Align::Right);
        }
        if swings {
            tornado(c, left, output, nominal, rows);
        }
        if indices {
            sobol(c, right, rows);
        }
        if !swings && !indices {
            axes(c, left, &none(), &none(), Some(output), "");
            no_data(c, left);
        }
    })
}

fn none() -> Axis {
    Axis { hi: 1.0, ..Axis::default() }
}

fn tornado(c: &mut Canvas, r: Rect, output: &str, nominal: Option<f64>, rows: &[Importance]) {
    let values = rows.iter().filter_map(|row| row.swing).flatten();
    let extent = range(values.chain(nominal));
    // Hundredths of the whole range.
    let span = extent.map_or(1.0, |(lo, hi)| (hi - lo).max(1e-6));
    let decimals = (2.0 - (span + 1e-9).log10().floor() + 0.5).clamp(0.0, 8.0) as usize;
    let axis = extent.map(|(lo, hi)| {
        // Space for the numbers beside the longest bars.
        let pad = 0.17 * if hi > lo { hi - lo } else { 1.0 };
        Axis::linear((lo - pad, hi + pad), 0.0, 6)
    });
    axes(c, r, axis.as_ref().unwrap_or(&none()), &none(), Some(output), "");
    let Some(axis) = axis else { return no_data(c, r) };
    for (k, row) in rows.iter().enumerate() {
        let Some(swing) = row.swing else { continue };
        let y = r.y0 + (k as f64 + 0.5) * ROW;
        let centre = nominal.or(Some(0.5 * (swing[0] + swing[1]))).and_then(|v| r.x(&axis, v));
        let Some(centre) = centre.map(|v| v.clamp(r.x0, r.x1)) else { continue };
        let ends = swing.map(|v| r.x(&axis, v).map(|x| x.clamp(r.x0, r.x1)));
        // Two bars on the same side lie one above the other.
        let same = ends[0].zip(ends[1]).is_some_and(|(a, b)| (a - centre) * (b - centre) > 0.0);
        for (end, color, half) in [(ends[0], LOW, (-9.0, 0.0)), (ends[1], HIGH, (0.0, 9.0))] {
            let (above, below) = if same { half } else { (-9.0, 9.0) };
            if let Some(end) = end {
                c.bar((centre, y + above), (end, y + below), color, 1.0);
            }
        }
        for (k, (end, value)) in ends.iter().zip(swing).enumerate() {
            let Some(end) = end else { continue };
            let (dx, align) = if *end < centre { (-4.0, Align::Right) } else { (4.0, Align::Left) };
            let dy = if same { if k == 0 { -6.0 } else { 6.0 } } else { 0.0 };
            c.write(&fixed(value, decimals), (end + dx, y + dy), TICK_SIZE, TEXT, align);
        }
    }
    if let Some(x) = nominal.and_then(|v| r.x(&axis, v)) {
        c.line((x, r.y0), (x, r.y1), TEXT, 1.2);
        on_ground(c, "nominal", (x, r.y0 - 8.0), small(Align::Middle));
    }
}

fn sobol(c: &mut Canvas, r: Rect, rows: &[Importance]) {
    let all = || rows.iter().flat_map(|row| [row.first, row.total]).flatten();
    let (lo, hi) = range(all().flat_map(|e| [e.value, e.low, e.high])).unwrap_or((0.0, 1.0));
    let axis = Axis::linear((lo.clamp(-1.0, 0.0), hi.clamp(0.1, 2.0) * 1.14), 0.0, 5);
    axes(c, r, &axis, &none(), Some("share of the variance"), "");
    let zero = r.x(&axis, 0.0).unwrap_or(r.x0);
    for (k, row) in rows.iter().enumerate() {
        let y = r.y0 + (k as f64 + 0.5) * ROW;
        for (estimate, color, dy) in [(row.first, FIRST, -6.5), (row.total, TOTAL, 6.5)] {
            let Some(estimate) = estimate.filter(|e| usable(e.value)) else { continue };
            let at = |v: f64| r.x(&axis, v).map_or(zero, |x| x.clamp(r.x0, r.x1));
            let end = at(estimate.value);
            c.bar((zero, y + dy - 5.0), (end, y + dy + 5.0), color, 1.0);
            let (low, high) = (at(estimate.low), at(estimate.high));
            c.line((low, y + dy), (high, y + dy), TEXT, 1.0);
            for x in [low, high] {
                c.line((x, y + dy - 3.0), (x, y + dy + 3.0), TEXT, 1.0);
            }
            let text = format!("{:.2}", estimate.value).replace('-', "−");
            let x = end.max(high) + 4.0;
            if x + text_width(&text, TICK_SIZE) < r.x1 {
                c.write(&text, (x, y + dy), TICK_SIZE, TEXT, Align::Left);
            }
        }
    }
    c.line((zero, r.y0), (zero, r.y1), FRAME, 1.0);
    let title = Lettering::new(TICK_SIZE, QUIET, Align::Left);
    c.styled("Sobol' indices", (r.x0, r.y0 - 8.0), title);
}
