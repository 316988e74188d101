//! Errors over the stages of a correction.

use super::axis::{Axis, Rect, axes, left_margin, no_data, range};
use super::canvas::{Align, Lettering, draw, shorten, text_width};
use super::color::{Color, Role, TEXT, WHITE};
use super::curve::Style;
use super::legend::{Entry, Swatch, head, legend};
use super::numbers::significant;
use super::{Figure, LABEL_SIZE, RIGHT, TICK_SIZE, WIDTH};

/// Errors of one quantity, such as one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct ErrorGroup {
    /// Name below the bars.
    pub name: String,
    /// One error per stage, in the order of the stages.
    pub values: Vec<f64>,
    /// Error due to noise alone, drawn as a dashed line.
    pub floor: Option<f64>,
}

/// Errors of several quantities over the stages of a correction, as grouped bars.
///
/// The axis is logarithmic if the errors span more than a factor of 30. A group's noise floor is a dashed line across
/// its bars; every bar is labelled with its value.
pub fn falling_error(title: &str, y_label: &str, stages: &[(Role, &str)], groups: &[ErrorGroup]) -> Figure {
    let mut entries: Vec<Entry> = stages.iter().map(|(role, s)| ((*s).to_owned(), role.color(), Swatch::Box)).collect();
    if groups.iter().any(|g| g.floor.is_some()) {
        entries.push(("noise floor".into(), Color::NOISE, Swatch::Curve(Style::Dashed)));
    }
    let bars = || groups.iter().flat_map(|g| g.values.iter().take(stages.len()).copied());
    let every = || bars().chain(groups.iter().filter_map(|g| g.floor)).filter(|v| *v >= 0.0);
    let positive = range(every().filter(|v| *v > 0.0));
    let y = range(bars().filter(|v| *v >= 0.0)).map(|_| match positive {
        Some((lo, hi)) if hi / lo > 30.0 => {
            // Range with a visible shortest bar and space for the label of the highest one.
            let lo = (lo / 1.5).max(hi * 1e-9);
            let step = 10f64.powf(lo.log10().floor());
            let lo = [5.0, 2.0, 1.0].map(|f| f * step).into_iter().find(|v| *v <= lo);
            Axis::log((lo.unwrap_or(step), hi * (hi / lo.unwrap_or(step)).powf(0.1)), 7)
        }
        _ => Axis::linear((0.0, every().fold(0.0, f64::max) * 1.12), 0.0, 6),
    });
    let top = head(&entries);
    let left = left_margin(y.as_ref().map_or(0.0, Axis::label_width));
    let r = Rect { x0: left, y0: top, x1: WIDTH - RIGHT, y1: top + 260.0 };
    draw(title, r.y1 + 30.0, |c| {
        legend(c, &entries);
        let none = Axis { hi: 1.0, ..Axis::default() };
        axes(c, r, &none, y.as_ref().unwrap_or(&none), None, y_label);
        let Some(y) = y else { return no_data(c, r) };
        let slot = (r.x1 - r.x0) / groups.len().max(1) as f64;
        let bar = (0.78 * slot / stages.len().max(1) as f64).min(78.0);
        let mut texts = Vec::new();
        for (g, group) in groups.iter().enumerate() {
            let mid = r.x0 + (g as f64 + 0.5) * slot;
            let start = mid - 0.5 * bar * stages.len() as f64;
            for (k, &value) in group.values.iter().take(stages.len()).enumerate() {
                let (a, b) = (start + k as f64 * bar + 1.5, start + (k + 1) as f64 * bar - 1.5);
                let high = if value >= 0.0 { r.y(&y, value).unwrap_or(r.y1) } else { r.y1 };
                let high = high.clamp(r.y0, r.y1);
                c.bar((a, high), (b, r.y1), stages[k].0.color(), 1.0);
                texts.push((0.5 * (a + b), high, significant(value)));
            }
            let line = group.floor.filter(|f| *f >= 0.0).and_then(|f| r.y(&y, f));
            if let Some(py) = line.filter(|p| (r.y0..=r.y1).contains(p)) {
                let end = start + bar * stages.len() as f64;
                let (a, b) = ((start - 7.0, py), (end + 7.0, py));
                c.line(a, b, WHITE, 1.5);
                c.dashed(&[a, b], Color::NOISE, 1.5);
            }
            let name = shorten(&group.name, slot - 4.0, LABEL_SIZE);
            c.write(&name, (mid, r.y1 + 15.0), LABEL_SIZE, TEXT, Align::Middle);
        }
        for (x, high, text) in texts {
            let width = text_width(&text, TICK_SIZE);
            if width <= bar + 2.0 {
                let half = 0.5 * width + 1.0;
                c.bar((x - half, high - 15.0), (x + half, high - 3.0), WHITE, 0.85);
                c.write(&text, (x, high - 9.0), TICK_SIZE, TEXT, Align::Middle);
            } else if bar >= 10.0 {
                let base = (high - 4.0).max(r.y0 + width);
                c.bar((x - 6.0, base - width), (x + 6.0, base), WHITE, 0.85);
                let at = (x, base);
                c.styled(&text, at, Lettering::new(TICK_SIZE.min(bar), TEXT, Align::Left).upright());
            }
        }
    })
}
