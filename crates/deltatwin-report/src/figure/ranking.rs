//! Ranking of candidates as horizontal bars.

use super::axis::{Axis, Rect, axes, no_data, range};
use super::canvas::{Align, Lettering, draw, shorten, text_width};
use super::color::{Color, FRAME, QUIET, TEXT, WHITE};
use super::numbers::{fixed, significant};
use super::{Figure, LABEL_SIZE, RIGHT, TICK_SIZE, WIDTH};

/// One row of a ranking.
#[derive(Debug, Clone, PartialEq)]
pub struct RankRow {
    /// Name on the left.
    pub name: String,
    /// Share as a fraction; printed in per cent.
    pub share: f64,
    /// Annotation on the right, such as a p-value.
    pub note: String,
    /// Whether the bar is highlighted.
    pub highlight: bool,
}

/// Candidates as horizontal bars: names on the left, share and annotation on the right.
///
/// The rows keep their order; `x_label` names the quantity of the share.
pub fn ranking(title: &str, x_label: &str, rows: &[RankRow]) -> Figure {
    const ROW: f64 = 26.0;
    let widest = |texts: &mut dyn Iterator<Item = &str>, limit: f64| {
        texts.fold(0.0f64, |w, t| w.max(text_width(t, LABEL_SIZE))).min(limit)
    };
    let names = widest(&mut rows.iter().map(|r| r.name.as_str()), 300.0);
    let notes = widest(&mut rows.iter().map(|r| r.note.as_str()), 260.0);
    let x0 = 12.0 + names + 12.0;
    let x1 = WIDTH - RIGHT - if notes > 0.0 { notes + 14.0 } else { 0.0 };
    let y1 = 40.0 + ROW * rows.len().max(2) as f64;
    let r = Rect { x0, y0: 38.0, x1, y1 };
    let axis = range(rows.iter().map(|r| 100.0 * r.share)).map(|(lo, hi)| {
        // Space for the number next to the longest bar and before a negative one.
        let (lo, hi) = (lo.min(0.0), hi.max(0.0));
        let span = if hi > lo { hi - lo } else { 1.0 };
        let low = if lo < 0.0 { lo - 0.14 * span } else { 0.0 };
        Axis::linear((low, hi.max(0.01 * span) + 0.14 * span), 0.0, 8)
    });
    draw(title, y1 + 44.0, |c| {
        let none = Axis { hi: 1.0, ..Axis::default() };
        axes(c, r, axis.as_ref().unwrap_or(&none), &none, Some(x_label), "");
        for (k, row) in rows.iter().enumerate() {
            let y = r.y0 + 1.0 + (k as f64 + 0.5) * ROW;
            let name = shorten(&row.name, names, LABEL_SIZE);
            let at = (x0 - 8.0, y);
            c.styled(&name, at, Lettering::new(LABEL_SIZE, TEXT, Align::Right).bold(row.highlight));
            let note = shorten(&row.note, notes, LABEL_SIZE);
            c.write(&note, (x1 + 10.0, y), LABEL_SIZE, QUIET, Align::Left);
            let Some(axis) = &axis else { continue };
            let zero = r.x(axis, 0.0).unwrap_or(x0);
            let end = r.x(axis, 100.0 * row.share);
            let color = if row.highlight { Color::GREEN } else { Color::MUTED };
            let end_x = end.unwrap_or(zero);
            c.bar((zero, y - 8.0), (end_x, y + 8.0), color, 1.0);
            let percent = 100.0 * row.share;
            let text = match end {
                None => "–".to_owned(),
                Some(_) if percent.abs() < 0.05 => "0 %".to_owned(),
                Some(_) if percent.abs() < 1e4 => format!("{} %", fixed(percent, 1)),
                Some(_) => format!("{} %", significant(percent)),
            };
            let (at, align) = if end_x < zero { (end_x - 5.0, Align::Right) } else { (end_x + 5.0, Align::Left) };
            let width = text_width(&text, TICK_SIZE);
            let a = if align == Align::Left { at } else { at - width };
            c.bar((a - 1.0, y - 7.0), (a + width + 1.0, y + 7.0), WHITE, 0.85);
            c.write(&text, (at, y), TICK_SIZE, TEXT, align);
        }
        match &axis {
            None => no_data(c, r),
            Some(axis) => {
                if let Some(zero) = r.x(axis, 0.0) {
                    c.line((zero, r.y0), (zero, r.y1), FRAME, 1.0);
                }
            }
        }
    })
}
