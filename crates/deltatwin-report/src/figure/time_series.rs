//! Curves over a common abscissa, in one panel or stacked.

use super::axis::{Axis, Rect, axes, left_margin, no_data, range};
use super::canvas::{Align, Lettering, draw, shorten};
use super::color::{Color, TEXT};
use super::curve::{Curve, plot, usable};
use super::legend::{colours, head, legend};
use super::live::live;
use super::{Figure, LABEL_SIZE, RIGHT, WIDTH};

/// One panel of a stack.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Panel {
    /// Name, written inside the panel's top margin.
    pub title: String,
    /// Label of the vertical axis.
    pub y_label: String,
    /// Curves; equal labels share a colour and a legend entry in the entire stack.
    pub curves: Vec<Curve>,
}

/// Curves over a common abscissa, such as time.
///
/// Long curves are reduced to their lowest and highest value per pixel column.
pub fn time_series(title: &str, x_label: &str, y_label: &str, curves: &[Curve]) -> Figure {
    let panel = Panel { title: String::new(), y_label: y_label.into(), curves: curves.to_vec() };
    stack(title, x_label, std::slice::from_ref(&panel), 260.0)
}

/// Stack of panels with a common abscissa and a common legend.
pub fn panels(title: &str, x_label: &str, panels: &[Panel]) -> Figure {
    stack(title, x_label, panels, 128.0)
}

/// Share of the largest value of a quantity in a stack below which a panel shows rounding errors.
const ROUNDING: f64 = 1e-6;

/// Range of the values of each panel; `None` for a panel without values.
///
/// The range of a panel with rounding errors only is ± a thousandth of the largest value of its quantity, so that its
/// curves appear as zero.
fn ranges(panels: &[Panel]) -> Vec<Option<(f64, f64)>> {
    let own: Vec<_> = panels.iter().map(|panel| (&panel.y_label, range(usable(&panel.curves).map(|p| p.1)))).collect();
    let size = |(low, high): (f64, f64)| low.abs().max(high.abs());
    let one = |(label, range): &(&String, Option<(f64, f64)>)| {
        let same = own.iter().filter(|(other, _)| other == label).filter_map(|(_, range)| *range);
        let largest = same.map(size).fold(0.0, f64::max);
        range.map(|r| if size(r) < ROUNDING * largest { (-1e-3 * largest, 1e-3 * largest) } else { r })
    };
    own.iter().map(one).collect()
}

fn stack(title: &str, x_label: &str, panels: &[Panel], height: f64) -> Figure {
    let (colors, entries) = colours(panels.iter().flat_map(|p| &p.curves));
    let total = colors.len();
    let count = panels.len().max(1);
    let gap = if panels.iter().any(|p| !p.title.is_empty()) { 22.0 } else { 10.0 };
    let top = head(&entries) + if gap > 20.0 { 14.0 } else { 0.0 };
    let full = top + count as f64 * height + (count - 1) as f64 * gap + 44.0;
    let x_range = range(panels.iter().flat_map(|p| usable(&p.curves)).map(|p| p.0));
    let x = x_range.map(|r| Axis::linear(r, 0.0, 10));
    let y_ticks = if height > 200.0 { 7 } else { 4 };
    let y: Vec<Option<Axis>> =
        ranges(panels).into_iter().map(|range| range.map(|r| Axis::linear(r, 0.05, y_ticks))).collect();
    let left = left_margin(y.iter().flatten().fold(0.0, |w, a| a.label_width().max(w)));
    let drawn = draw(title, full, |c| {
        legend(c, &entries);
        let mut color = colors.iter();
        let empty = Axis { hi: 1.0, ..Axis::default() };
        for k in 0..count {
            let y0 = top + k as f64 * (height + gap);
            let r = Rect { x0: left, y0, x1: WIDTH - RIGHT, y1: y0 + height };
            let label = (k + 1 == count).then_some(x_label);
            let y_axis = y.get(k).and_then(Option::as_ref);
            let y_label = panels.get(k).map_or("", |p| &p.y_label);
            axes(c, r, x.as_ref().unwrap_or(&empty), y_axis.unwrap_or(&empty), label, y_label);
            let Some(panel) = panels.get(k) else {
                no_data(c, r);
                continue;
            };
            let name = shorten(&panel.title, r.x1 - r.x0, LABEL_SIZE);
            c.styled(&name, (r.x0, r.y0 - 10.0), Lettering::new(LABEL_SIZE, TEXT, Align::Left).bold(true));
            for curve in &panel.curves {
                let color = color.next().copied().unwrap_or(Color::BLUE);
                if let (Some(x), Some(y)) = (&x, y_axis) {
                    plot(c, (r, x, y), curve, color, total);
                }
            }
            if y_axis.is_none() {
                no_data(c, r);
            }
        }
    });
    Figure { live: live(x_label, panels, false), ..drawn }
}
