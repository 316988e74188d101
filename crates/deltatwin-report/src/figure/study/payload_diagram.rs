//! Payload diagram: what the robot may carry, with how certain that is.

use super::super::axis::{Axis, Rect, axes, left_margin, no_data, range};
use super::super::canvas::{Align, Canvas, Lettering, draw, shorten};
use super::super::color::{Color, TEXT};
use super::super::curve::Style;
use super::super::legend::{Entry, Swatch, head, legend};
use super::super::{Figure, LABEL_SIZE, RIGHT, WIDTH};
use super::usable;

/// One diagram, such as that of one mass or of one rate.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PayloadPanel {
    /// Name above it.
    pub name: String,
    /// Limit of the nominal machine: largest permissible ordinate over the abscissa, ascending in the abscissa.
    pub nominal: Vec<(f64, f64)>,
    /// Limit that 95 % of the machines keep, over the uncertainty of model, hold and wear.
    pub likely: Vec<(f64, f64)>,
    /// Limit of the worst machine.
    pub worst: Vec<(f64, f64)>,
}

/// Content of a payload diagram.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PayloadDiagram {
    /// Title.
    pub title: String,
    /// Label of the horizontal axis, such as picks per minute.
    pub x_label: String,
    /// Label of the vertical axis, such as the permissible offset of the centre of mass.
    pub y_label: String,
    /// Panels with common axes, three in a row.
    pub panels: Vec<PayloadPanel>,
    /// Limit to compare with, such as the hand formula's or the data sheet's, with its name.
    pub reference: Option<(String, Vec<(f64, f64)>)>,
}

const COLUMNS: usize = 3;
const GAP: f64 = 18.0;

/// Payload diagram: permissible below the lines; green where the worst machine holds, amber between the worst and the
/// nominal one.
pub fn payload_diagram(diagram: &PayloadDiagram) -> Figure {
    let lines = |p: &PayloadPanel| [p.nominal.clone(), p.likely.clone(), p.worst.clone()].concat();
    let reference = diagram.reference.iter().flat_map(|(_, line)| line.iter().copied());
    let own: Vec<(f64, f64)> = diagram.panels.iter().flat_map(lines).filter(finite).collect();
    let all: Vec<(f64, f64)> = own.iter().copied().chain(reference).filter(finite).collect();
    let x = range(own.iter().map(|p| p.0)).map(|r| Axis::linear(r, 0.0, 6));
    let y = range(all.iter().map(|p| p.1)).map(|(_, high)| Axis::linear((0.0, 1.08 * high), 0.0, 6));
    let entries = entries(diagram);
    let columns = diagram.panels.len().clamp(1, COLUMNS);
    let rows = diagram.panels.len().max(1).div_ceil(COLUMNS);
    let left = left_margin(y.as_ref().map_or(0.0, Axis::label_width));
    let width = (WIDTH - RIGHT - left - (columns - 1) as f64 * GAP) / columns as f64;
    let height = if columns == 1 { 320.0 } else { 260.0 };
    let top = head(&entries) + 16.0;
    let full = top + rows as f64 * (height + 26.0) + 34.0;
    draw(&diagram.title, full, |c| {
        legend(c, &entries);
        let none = Axis { hi: 1.0, ..Axis::default() };
        for k in 0..diagram.panels.len().max(1) {
            let (row, column) = (k / COLUMNS, k % COLUMNS);
            let (x0, y0) = (left + column as f64 * (width + GAP), top + row as f64 * (height + 26.0));
            let r = Rect { x0, y0, x1: x0 + width, y1: y0 + height };
            let last = k + COLUMNS >= diagram.panels.len();
            // Ticks of the lowest panels only; the labels of the axes once.
            let x_label = last.then_some(if row + 1 == rows && column == columns / 2 { &*diagram.x_label } else { "" });
            let y_axis = Axis { ticks: ticks(y.as_ref(), column == 0), ..y.clone().unwrap_or(none.clone()) };
            let y_label = if column == 0 { &*diagram.y_label } else { "" };
            axes(c, r, x.as_ref().unwrap_or(&none), &y_axis, x_label, y_label);
            let (Some(x), Some(y), Some(panel)) = (&x, &y, diagram.panels.get(k)) else {
                no_data(c, r);
                continue;
            };
            areas(c, (r, x, y), panel);
            if let Some((_, line)) = &diagram.reference {
                c.dashed(&placed((r, x, y), line), TEXT, 1.0);
            }
            c.frame(r);
            let name = shorten(&panel.name, width, LABEL_SIZE);
            c.styled(&name, (r.x0, r.y0 - 9.0), Lettering::new(LABEL_SIZE, TEXT, Align::Left).bold(true));
        }
    })
}

const NOMINAL: Color = Color::BLUE;
const LIKELY: Color = Color::OCHRE;
const WORST: Color = Color::BAD;

fn entries(diagram: &PayloadDiagram) -> Vec<Entry> {
    let any = |line: fn(&PayloadPanel) -> &Vec<(f64, f64)>| diagram.panels.iter().any(|p| !line(p).is_empty());
    let mut entries: Vec<Entry> = Vec::new();
    if any(|p| &p.nominal) {
        entries.push(("nominal machine".into(), NOMINAL, Swatch::Curve(Style::Line)));
    }
    if any(|p| &p.likely) {
        entries.push(("95 % of machines".into(), LIKELY, Swatch::Curve(Style::Dashed)));
    }
    if any(|p| &p.worst) {
        entries.push(("worst machine; safe below it".into(), WORST, Swatch::Curve(Style::Line)));
    }
    entries.extend(diagram.reference.iter().map(|(name, _)| (name.clone(), TEXT, Swatch::Curve(Style::Dashed))));
    entries
}

fn finite(p: &(f64, f64)) -> bool {
    usable(p.0) && usable(p.1)
}

/// Ticks of an axis, without their texts if they are not shown.
fn ticks(axis: Option<&Axis>, shown: bool) -> Vec<(f64, String)> {
    let ticks = axis.map(|a| a.ticks.clone()).unwrap_or_default();
    ticks.into_iter().map(|(v, text)| (v, if shown { text } else { String::new() })).collect()
}

/// A line in pixels, inside the frame.
fn placed((r, x, y): (Rect, &Axis, &Axis), line: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let at = |p: &(f64, f64)| Some((r.x(x, p.0)?, r.y(y, p.1.max(0.0))?.clamp(r.y0, r.y1)));
    line.iter().filter(|p| finite(p)).filter_map(at).filter(|p| p.0 >= r.x0 - 1.0 && p.0 <= r.x1 + 1.0).collect()
}

/// Areas and lines of one panel.
fn areas(c: &mut Canvas, frame: (Rect, &Axis, &Axis), panel: &PayloadPanel) {
    let r = frame.0;
    let [nominal, likely, worst] = [&panel.nominal, &panel.likely, &panel.worst].map(|line| placed(frame, line));
    if worst.len() > 1 {
        let ends = worst.last().zip(worst.first());
        let down = ends.map(|(last, first)| [(last.0, r.y1), (first.0, r.y1)]);
        let safe: Vec<(f64, f64)> = worst.iter().copied().chain(down.into_iter().flatten()).collect();
        c.polygon(&safe, Color::GOOD, 0.20);
        if nominal.len() > 1 {
            let between: Vec<(f64, f64)> = nominal.iter().chain(worst.iter().rev()).copied().collect();
            c.polygon(&between, LIKELY, 0.20);
        }
    }
    c.polyline(&nominal, NOMINAL, 2.0);
    c.dashed(&likely, LIKELY, 2.0);
    c.polyline(&worst, WORST, 2.0);
}
