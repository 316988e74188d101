//! Stacked horizontal bars of shares.

use super::axis::{Axis, Rect, axes, no_data};
use super::canvas::{Align, draw, shorten, text_width};
use super::color::{Color, TEXT};
use super::legend::{Entry, Swatch, head, legend};
use super::numbers::fixed;
use super::{Figure, LABEL_SIZE, RIGHT, TICK_SIZE, WIDTH};

/// A whole and the shares of its parts.
#[derive(Debug, Clone, PartialEq)]
pub struct StackedBar {
    /// Name on the left.
    pub name: String,
    /// One share per part, as a fraction; shares that are not positive are not drawn.
    pub shares: Vec<f64>,
}

/// Stacked horizontal bars from 0 to 100 %; the first part is grey, the last ochre.
pub fn stacked(title: &str, x_label: &str, parts: &[&str], bars: &[StackedBar]) -> Figure {
    const ROW: f64 = 30.0;
    let middle = [Color::GREEN, Color::GREEN.pale(0.55), Color::GREEN.pale(0.8), Color::GREEN.pale(0.3)];
    let color = |k: usize| match k {
        0 => Color::MUTED,
        k if k + 1 == parts.len() => Color::OCHRE,
        k => middle[(k - 1) % middle.len()],
    };
    let entries: Vec<Entry> = parts.iter().enumerate().map(|(k, p)| ((*p).to_owned(), color(k), Swatch::Box)).collect();
    let top = head(&entries);
    let names = bars.iter().fold(0.0f64, |w, b| w.max(text_width(&b.name, LABEL_SIZE))).min(260.0);
    let x0 = 12.0 + names + 12.0;
    let r = Rect { x0, y0: top, x1: WIDTH - RIGHT, y1: top + ROW * bars.len().max(1) as f64 };
    draw(title, r.y1 + 44.0, |c| {
        legend(c, &entries);
        let axis = Axis::linear((0.0, 100.0), 0.0, 6);
        let none = Axis { hi: 1.0, ..Axis::default() };
        axes(c, r, &axis, &none, Some(x_label), "");
        if bars.is_empty() {
            return no_data(c, r);
        }
        for (row, bar) in bars.iter().enumerate() {
            let y = r.y0 + (row as f64 + 0.5) * ROW;
            let name = shorten(&bar.name, names, LABEL_SIZE);
            c.write(&name, (x0 - 8.0, y), LABEL_SIZE, TEXT, Align::Right);
            let positive = |s: &f64| if s.is_finite() { s.max(0.0) } else { 0.0 };
            // With negative parts the others exceed the whole.
            let whole = bar.shares.iter().take(parts.len()).map(positive).sum::<f64>().max(1.0);
            let mut from = x0;
            for (k, share) in bar.shares.iter().take(parts.len()).enumerate() {
                let to = from + (r.x1 - x0) * positive(share) / whole;
                if to - from >= 0.5 {
                    c.bar((from, y - 10.0), (to, y + 10.0), color(k), 1.0);
                }
                let text = format!("{} %", fixed(100.0 * share, 1));
                if to - from > text_width(&text, TICK_SIZE) + 6.0 {
                    c.write(&text, (0.5 * (from + to), y), TICK_SIZE, color(k).ink(), Align::Middle);
                }
                from = to;
            }
        }
    })
}
