//! A single plot with axes and a legend.

use super::axis::{Axis, Rect, axes, left_margin, no_data};
use super::canvas::{Canvas, draw};
use super::legend::{Entry, head, legend};
use super::{Figure, RIGHT, WIDTH};

/// Figure of one plot with labelled axes and a legend, `room` pixels apart; `body` draws the content.
///
/// If an axis is `None`, the plot shows "no data" instead.
pub(super) fn framed(
    title: &str,
    entries: &[Entry],
    room: f64,
    (x, x_label): (Option<Axis>, &str),
    (y, y_label): (Option<Axis>, &str),
    body: impl FnOnce(&mut Canvas, Rect, &Axis, &Axis),
) -> Figure {
    let top = head(entries) + room;
    let left = left_margin(y.as_ref().map_or(0.0, Axis::label_width));
    let r = Rect { x0: left, y0: top, x1: WIDTH - RIGHT, y1: top + 280.0 };
    draw(title, r.y1 + 44.0, |c| {
        legend(c, entries);
        let none = Axis { hi: 1.0, ..Axis::default() };
        axes(c, r, x.as_ref().unwrap_or(&none), y.as_ref().unwrap_or(&none), Some(x_label), y_label);
        match (&x, &y) {
            (Some(x), Some(y)) => body(c, r, x, y),
            _ => no_data(c, r),
        }
    })
}
