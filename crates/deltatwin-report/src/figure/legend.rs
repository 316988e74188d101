//! Legend above a plot.

use super::canvas::{Align, Canvas, shorten, text_width};
use super::color::{Color, TEXT};
use super::curve::{Curve, Style};
use super::{LABEL_SIZE, WIDTH};

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Swatch {
    Curve(Style),
    Box,
    Band,
}

pub(super) type Entry = (String, Color, Swatch);

const LEGEND_ROW: f64 = 18.0;

/// Positions of the entries in rows from left to right, and the number of rows.
fn flow(entries: &[Entry]) -> (Vec<(f64, usize)>, usize) {
    let (mut x, mut row) = (12.0, 0);
    let mut places = Vec::with_capacity(entries.len());
    for (label, ..) in entries {
        let width = 30.0 + text_width(&shorten(label, 400.0, LABEL_SIZE), LABEL_SIZE) + 16.0;
        if x > 12.0 && x + width > WIDTH {
            x = 12.0;
            row += 1;
        }
        places.push((x, row));
        x += width;
    }
    (places, if entries.is_empty() { 0 } else { row + 1 })
}

/// Top of the plot below the title and the legend.
pub(super) fn head(entries: &[Entry]) -> f64 {
    34.0 + LEGEND_ROW * flow(entries).1 as f64 + if entries.is_empty() { 2.0 } else { 6.0 }
}

pub(super) fn legend(c: &mut Canvas, entries: &[Entry]) {
    let (places, _) = flow(entries);
    for ((label, color, swatch), (x, row)) in entries.iter().zip(places) {
        let y = 41.0 + LEGEND_ROW * row as f64;
        let (a, b) = ((x, y), (x + 22.0, y));
        match swatch {
            Swatch::Curve(Style::Dashed) => c.dashed(&[a, b], *color, 2.0),
            Swatch::Curve(Style::Points) => c.dot((x + 11.0, y), 3.0, *color, 1.0),
            Swatch::Curve(_) => c.line(a, b, *color, 2.0),
            Swatch::Box => c.bar((x + 6.0, y - 5.5), (x + 20.0, y + 5.5), *color, 1.0),
            Swatch::Band => {
                c.bar((x, y - 5.5), (x + 22.0, y + 5.5), *color, 0.2);
                c.line(a, b, *color, 2.0);
            }
        }
        let text = shorten(label, 400.0, LABEL_SIZE);
        c.write(&text, (x + 28.0, y), LABEL_SIZE, TEXT, Align::Left);
    }
}

/// Colours of all curves and the legend entries; equal labels share a colour.
pub(super) fn colours<'a>(curves: impl Iterator<Item = &'a Curve>) -> (Vec<Color>, Vec<Entry>) {
    let (mut all, mut entries, mut next) = (Vec::new(), Vec::<Entry>::new(), 0);
    let curves: Vec<&Curve> = curves.collect();
    let taken: Vec<Color> = curves.iter().filter_map(|c| c.color).collect();
    for curve in curves {
        let known = entries.iter().find(|e| e.0 == curve.label).map(|e| e.1);
        let color = curve.color.or(known).unwrap_or_else(|| {
            let n = Color::CYCLE.len();
            let free = (0..n).map(|k| (next + k) % n).find(|&k| !taken.contains(&Color::CYCLE[k]));
            let chosen = free.unwrap_or(next % n);
            next = chosen + 1;
            Color::CYCLE[chosen]
        });
        all.push(color);
        let entry = (curve.label.clone(), color, Swatch::Curve(curve.style));
        if !curve.label.is_empty() && !entries.contains(&entry) {
            entries.push(entry);
        }
    }
    (all, entries)
}
