//! Amplitude spectra.

use super::axis::{Axis, range};
use super::canvas::{Align, text_width};
use super::color::{Color, QUIET};
use super::curve::{Curve, plot, usable};
use super::framed::framed;
use super::legend::colours;
use super::live::live;
use super::time_series::Panel;
use super::{Figure, TICK_SIZE, WIDTH};

/// Number of rows of marker labels above a spectrum.
const MARKER_ROWS: usize = 2;

/// Vertical line in a spectrum with a label.
#[derive(Debug, Clone, PartialEq)]
pub struct Marker {
    /// Abscissa.
    pub at: f64,
    /// Text at the top of the line.
    pub label: String,
}

/// The highest point in each of `columns` equal steps of the logarithm of the abscissa.
fn peaks(curve: &Curve, (lo, hi): (f64, f64), columns: usize) -> Curve {
    let step = ((hi / lo).ln() / columns as f64).max(1e-12);
    let mut best: Vec<Option<(f64, f64)>> = vec![None; columns];
    for (x, y) in usable(std::slice::from_ref(curve)).filter(|(x, y)| *x > 0.0 && *y > 0.0) {
        let cell = &mut best[(((x / lo).ln() / step) as usize).min(columns - 1)];
        if cell.is_none_or(|b| y > b.1) {
            *cell = Some((x, y));
        }
    }
    let (x, y) = best.into_iter().flatten().unzip();
    Curve { x, y, label: curve.label.clone(), ..*curve }
}

/// Amplitude spectra on two logarithmic axes of at most six decades in height, with vertical markers.
///
/// Of several lines within two pixels the highest is drawn, so that all peaks are visible.
pub fn spectrum(title: &str, x_label: &str, y_label: &str, curves: &[Curve], markers: &[Marker]) -> Figure {
    let (colors, entries) = colours(curves.iter());
    let positive = || usable(curves).filter(|(x, y)| *x > 0.0 && *y > 0.0);
    let x_range = range(positive().map(|p| p.0));
    let x = x_range.map(|r| Axis::log(r, 8));
    let curves: Vec<Curve> = match x_range {
        Some(r) => curves.iter().map(|c| peaks(c, r, 420)).collect(),
        None => vec![],
    };
    let y = range(usable(&curves).map(|p| p.1)).map(|(lo, hi)| Axis::log((lo.max(hi * 1e-6) / 1.3, hi * 1.6), 7));
    // Overlapping labels are moved to further rows; those that do not fit are omitted.
    let mut rows: Vec<f64> = Vec::new();
    let room = 14.0 * markers.len().min(MARKER_ROWS) as f64;
    let panel = Panel { title: String::new(), y_label: y_label.into(), curves: curves.clone() };
    let drawn = framed(title, &entries, room, (x, x_label), (y, y_label), |c, r, x, y| {
        let mut places: Vec<(f64, &str)> = markers
            .iter()
            .filter_map(|m| Some((r.x(x, m.at)?, m.label.as_str())))
            .filter(|(px, _)| (r.x0..=r.x1).contains(px))
            .collect();
        places.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (px, label) in places {
            c.dashed(&[(px, r.y0), (px, r.y1)], Color::MUTED, 1.0);
            let half = 0.5 * text_width(label, TICK_SIZE);
            let mid = px.min(WIDTH - half - 4.0).max(half + 4.0);
            let row = rows.iter().position(|end| mid - half > *end).unwrap_or(rows.len());
            if row < MARKER_ROWS {
                rows.resize(rows.len().max(row + 1), 0.0);
                rows[row] = mid + half + 6.0;
                let y = r.y0 - 9.0 - 14.0 * row as f64;
                c.write(label, (mid, y), TICK_SIZE, QUIET, Align::Middle);
            }
        }
        for (curve, color) in curves.iter().zip(&colors) {
            plot(c, (r, x, y), curve, *color, curves.len());
        }
    });
    Figure { live: live(x_label, &[panel], true), ..drawn }
}
