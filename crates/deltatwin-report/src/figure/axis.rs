//! Axes: ranges, ticks, grid and labels.

use super::canvas::{Align, Canvas, Lettering, shorten, text_width};
use super::color::{FRAME, GRID, MINOR, QUIET, TEXT};
use super::numbers::{fixed, superscript};
use super::{HUGE, LABEL_SIZE, TICK_SIZE};

#[derive(Debug, Clone, Default)]
pub(super) struct Axis {
    pub(super) lo: f64,
    pub(super) hi: f64,
    pub(super) log: bool,
    pub(super) ticks: Vec<(f64, String)>,
    pub(super) minor: Vec<f64>,
}

/// Range of the usable values; `None` without any.
pub(super) fn range(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    values
        .filter(|v| v.abs() < HUGE)
        .fold(None, |r, v| Some(r.map_or((v, v), |(lo, hi): (f64, f64)| (lo.min(v), hi.max(v)))))
}

fn nice_step(span: f64, count: usize) -> f64 {
    let raw = span / count.max(1) as f64;
    let base = 10f64.powf(raw.log10().floor());
    let m = raw / base;
    base * if m <= 1.0 {
        1.0
    } else if m <= 2.0 {
        2.0
    } else if m <= 5.0 {
        5.0
    } else {
        10.0
    }
}

fn tick_values(lo: f64, hi: f64, count: usize) -> (Vec<f64>, f64) {
    let step = nice_step(hi - lo, count);
    (multiples(lo, hi, step), step)
}

fn multiples(lo: f64, hi: f64, step: f64) -> Vec<f64> {
    let first = (lo / step - 1e-9).ceil();
    (0..100).map(|k| (first + f64::from(k)) * step).take_while(|v| *v <= hi + 1e-9 * step).collect()
}

fn tick_labels(ticks: &[f64], step: f64) -> Vec<String> {
    let largest = ticks.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    let step_exponent = (step.log10() + 1e-9).floor() as i32;
    if largest < 1e6 && step_exponent >= -4 {
        return ticks.iter().map(|&v| fixed(v, (-step_exponent).max(0) as usize)).collect();
    }
    let exponent = (largest.log10() + 1e-9).floor() as i32;
    let decimals = (exponent - step_exponent).clamp(0, 12) as usize;
    let scale = 10f64.powi(exponent);
    ticks
        .iter()
        .map(|&v| {
            if v.abs() < 1e-6 * step {
                "0".into()
            } else {
                format!("{}·10{}", fixed(v / scale, decimals), superscript(exponent))
            }
        })
        .collect()
}

impl Axis {
    /// Linear axis over the range, with `pad` of its span added on both sides.
    pub(super) fn linear((lo, hi): (f64, f64), pad: f64, count: usize) -> Self {
        let size = lo.abs().max(hi.abs());
        let (lo, hi) = if hi - lo <= 1e-9 * size || hi - lo < 1e-200 {
            let half = if size < 1e-190 { 1.0 } else { 0.05 * size };
            let mid = 0.5 * (lo + hi);
            (mid - half, mid + half)
        } else {
            (lo - pad * (hi - lo), hi + pad * (hi - lo))
        };
        let (mut lo, mut hi) = (lo, hi);
        let (mut ticks, mut step) = tick_values(lo, hi, count);
        if ticks.len() < 3 {
            (ticks, step) = tick_values(lo, hi, 2 * count);
        }
        // A range that ends close to a tick, such as 19.9996 s, is extended to it.
        if pad == 0.0 {
            let near = 0.005 * (hi - lo);
            let (below, above) = ((lo / step).floor() * step, (hi / step).ceil() * step);
            lo = if lo - below < near { below } else { lo };
            hi = if above - hi < near { above } else { hi };
            ticks = multiples(lo, hi, step);
        }
        let labels = tick_labels(&ticks, step);
        let ticks = ticks.into_iter().zip(labels).collect();
        Self { lo, hi, log: false, ticks, minor: vec![] }
    }

    /// Logarithmic axis over a positive range.
    pub(super) fn log((lo, hi): (f64, f64), count: usize) -> Self {
        let lo = lo.max(1e-190);
        let (lo, hi) = if hi <= lo * 1.001 { (lo / 2.0, lo * 2.0) } else { (lo, hi) };
        let decades = (lo.log10() - 1e-9).floor() as i32..=(hi.log10() + 1e-9).ceil() as i32;
        let inside = |v: &f64| *v >= lo * (1.0 - 1e-9) && *v <= hi * (1.0 + 1e-9);
        let every = |factors: &[f64]| -> Vec<f64> {
            let values = decades.clone().flat_map(|e| factors.iter().map(move |f| f * 10f64.powi(e)));
            values.filter(inside).collect()
        };
        let span = (hi / lo).log10();
        let stride = (span / count as f64).ceil().max(1.0) as i32;
        let mut ticks: Vec<f64> =
            decades.clone().filter(|e| e.rem_euclid(stride) == 0).map(|e| 10f64.powi(e)).filter(inside).collect();
        let mut minor = if stride == 1 { every(&[2., 3., 4., 5., 6., 7., 8., 9.]) } else { vec![] };
        let plain = |v: f64| -> String {
            let e = (v.log10() + 1e-9).floor() as i32;
            let m = (v / 10f64.powi(e)).round();
            match (e, m as i32) {
                (-3..=4, _) => fixed(v, (-e).max(0) as usize),
                (_, 1) => format!("10{}", superscript(e)),
                _ => format!("{m}·10{}", superscript(e)),
            }
        };
        let mut labels = None;
        if span < 2.0 {
            ticks = every(&[1.0, 2.0, 5.0]);
            if ticks.len() < 3 {
                let (values, step) = tick_values(lo, hi, count);
                labels = Some(tick_labels(&values, step));
                ticks = values;
                minor.clear();
            }
        }
        let labels = labels.unwrap_or_else(|| ticks.iter().map(|&v| plain(v)).collect());
        Self { lo, hi, log: true, ticks: ticks.into_iter().zip(labels).collect(), minor }
    }

    /// Position of `value` as a fraction of the axis; `None` if it cannot be shown.
    pub(super) fn at(&self, value: f64) -> Option<f64> {
        if self.log && value <= 0.0 || value.abs() >= HUGE || value.is_nan() {
            return None;
        }
        Some(if self.log {
            (value / self.lo).ln() / (self.hi / self.lo).ln()
        } else {
            (value - self.lo) / (self.hi - self.lo)
        })
    }

    pub(super) fn label_width(&self) -> f64 {
        self.ticks.iter().fold(0.0, |w, (_, l)| text_width(l, TICK_SIZE).max(w))
    }
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Rect {
    pub(super) x0: f64,
    pub(super) y0: f64,
    pub(super) x1: f64,
    pub(super) y1: f64,
}

impl Rect {
    pub(super) fn x(&self, axis: &Axis, value: f64) -> Option<f64> {
        Some(self.x0 + axis.at(value)? * (self.x1 - self.x0))
    }

    pub(super) fn y(&self, axis: &Axis, value: f64) -> Option<f64> {
        Some(self.y1 - axis.at(value)? * (self.y1 - self.y0))
    }

    pub(super) fn has(&self, p: (f64, f64)) -> bool {
        (self.x0 - 1.0..=self.x1 + 1.0).contains(&p.0) && (self.y0 - 1.0..=self.y1 + 1.0).contains(&p.1)
    }
}

/// Grid, frame and labels of one plot.
pub(super) fn axes(c: &mut Canvas, r: Rect, x: &Axis, y: &Axis, x_label: Option<&str>, y_label: &str) {
    for &v in &x.minor {
        if let Some(px) = r.x(x, v) {
            c.line((px, r.y0), (px, r.y1), MINOR, 0.5);
        }
    }
    for &v in &y.minor {
        if let Some(py) = r.y(y, v) {
            c.line((r.x0, py), (r.x1, py), MINOR, 0.5);
        }
    }
    let mut free = f64::NEG_INFINITY;
    for (v, label) in &x.ticks {
        let Some(px) = r.x(x, *v) else { continue };
        c.line((px, r.y0), (px, r.y1), GRID, 0.5);
        let half = 0.5 * text_width(label, TICK_SIZE);
        if x_label.is_some() && px - half > free {
            c.line((px, r.y1), (px, r.y1 + 4.0), FRAME, 1.0);
            c.write(label, (px, r.y1 + 13.0), TICK_SIZE, QUIET, Align::Middle);
            free = px + half + 6.0;
        }
    }
    for (v, label) in &y.ticks {
        let Some(py) = r.y(y, *v) else { continue };
        let zero = *v == 0.0 && !y.log;
        c.line((r.x0, py), (r.x1, py), if zero { FRAME } else { GRID }, 0.5);
        c.line((r.x0 - 4.0, py), (r.x0, py), FRAME, 1.0);
        c.write(label, (r.x0 - 7.0, py), TICK_SIZE, QUIET, Align::Right);
    }
    c.frame(r);
    if let Some(label) = x_label {
        let mid = 0.5 * (r.x0 + r.x1);
        c.write(label, (mid, r.y1 + 31.0), LABEL_SIZE, TEXT, Align::Middle);
    }
    let shown = shorten(y_label, r.y1 - r.y0 + 30.0, LABEL_SIZE);
    let at = (14.0, 0.5 * (r.y0 + r.y1));
    c.styled(&shown, at, Lettering::new(LABEL_SIZE, TEXT, Align::Middle).upright());
}

pub(super) fn left_margin(width: f64) -> f64 {
    (26.0 + width + 10.0).max(48.0)
}

pub(super) fn no_data(c: &mut Canvas, r: Rect) {
    let mid = (0.5 * (r.x0 + r.x1), 0.5 * (r.y0 + r.y1));
    c.write("no data", mid, 13.0, QUIET, Align::Middle);
}
