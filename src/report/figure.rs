//! SVG figures: time series, stacked panels, falling errors, binned scatter, spectra, rankings.
//!
//! Every function returns a [`Figure`] whatever its data are: samples that are not finite leave
//! gaps, and where nothing can be drawn the figure says "no data".

use plotters::backend::DrawingBackend;
use plotters::prelude::{IntoFont, RGBAColor, RGBColor, SVGBackend, ShapeStyle, TextStyle};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color as _, FontStyle, FontTransform};

/// Width of every figure in CSS pixels.
pub const WIDTH: f64 = 920.0;

/// Internal units per CSS pixel: the backend draws at whole units.
const UNIT: f64 = 2.0;
/// Largest number of line points in one figure; ten bytes each bound its size.
const MAX_POINTS: usize = 14_000;
/// Largest number of pieces a line is broken into at its gaps.
const MAX_PIECES: usize = 100;
/// Largest number of scatter dots in one figure.
const MAX_DOTS: usize = 900;
/// Magnitudes above this are treated as missing: their differences would overflow.
const HUGE: f64 = 1e200;
/// Rows of marker labels above a spectrum.
const MARKER_ROWS: usize = 2;
const RIGHT: f64 = 18.0;
const TICK_SIZE: f64 = 11.0;
const LABEL_SIZE: f64 = 12.0;
const TITLE_SIZE: f64 = 14.5;

/// An sRGB colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Color(
    /// Red.
    pub u8,
    /// Green.
    pub u8,
    /// Blue.
    pub u8,
);

impl Color {
    /// Near-black, for measurements.
    pub const MEASURED: Color = Color(0x3b, 0x3b, 0x3b);
    /// Blue, for the model.
    pub const MODEL: Color = Color(0x00, 0x72, 0xb2);
    /// Vermilion, for the residual.
    pub const RESIDUAL: Color = Color(0xd5, 0x5e, 0x00);
    /// Green, for the improved state.
    pub const IMPROVED: Color = Color(0x00, 0x9e, 0x73);
    /// Grey, for what is in the background.
    pub const MUTED: Color = Color(0x9a, 0xa3, 0xad);

    /// The colours given in turn to curves without one, distinct for colour-blind readers.
    pub const CYCLE: [Color; 7] = [
        Color(0x00, 0x72, 0xb2),
        Color(0xd5, 0x5e, 0x00),
        Color(0x00, 0x9e, 0x73),
        Color(0xcc, 0x79, 0xa7),
        Color(0xe6, 0x9f, 0x00),
        Color(0x56, 0xb4, 0xe9),
        Color(0x3b, 0x3b, 0x3b),
    ];
}

const TEXT: Color = Color(0x22, 0x26, 0x2b);
const QUIET: Color = Color(0x5a, 0x62, 0x6b);
const GRID: Color = Color(0xe3, 0xe6, 0xea);
const MINOR: Color = Color(0xf0, 0xf2, 0xf4);
const FRAME: Color = Color(0xb4, 0xba, 0xc1);
const WHITE: Color = Color(0xff, 0xff, 0xff);

/// How a curve is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Style {
    /// A solid line.
    #[default]
    Line,
    /// A thin solid line.
    Thin,
    /// A dashed line.
    Dashed,
    /// Separate dots, thinned evenly when there are very many.
    Points,
}

/// One curve: pairs of coordinates under a label.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Name in the legend; an empty one is left out of it.
    pub label: String,
    /// Abscissae; what is longer than `y` is ignored.
    pub x: Vec<f64>,
    /// Ordinates; one that is not finite leaves a gap.
    pub y: Vec<f64>,
    /// Colour; without one the next of [`Color::CYCLE`].
    pub color: Option<Color>,
    /// How it is drawn.
    pub style: Style,
}

impl Curve {
    /// A solid line in the next free colour.
    pub fn new(label: impl Into<String>, x: Vec<f64>, y: Vec<f64>) -> Self {
        Self { label: label.into(), x, y, color: None, style: Style::Line }
    }

    /// The same curve in `color`.
    #[must_use]
    pub fn color(mut self, color: Color) -> Self {
        self.color = Some(color);
        self
    }

    /// The same curve drawn as `style`.
    #[must_use]
    pub fn style(mut self, style: Style) -> Self {
        self.style = style;
        self
    }

    fn pairs(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        self.x.iter().copied().zip(self.y.iter().copied())
    }
}

/// One panel of a stack.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Panel {
    /// Name, written inside the panel's top margin.
    pub title: String,
    /// Label of the vertical axis.
    pub y_label: String,
    /// Curves; one label has one colour and one legend entry in the whole stack.
    pub curves: Vec<Curve>,
}

/// The errors of one quantity, such as one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct ErrorGroup {
    /// Name below the bars.
    pub name: String,
    /// One error per stage, in the order of the stages.
    pub values: Vec<f64>,
    /// The error which noise alone leaves, drawn as a dashed line.
    pub floor: Option<f64>,
}

/// A vertical line in a spectrum with a label.
#[derive(Debug, Clone, PartialEq)]
pub struct Marker {
    /// Abscissa.
    pub at: f64,
    /// Text at the top of the line.
    pub label: String,
}

/// One row of a ranking.
#[derive(Debug, Clone, PartialEq)]
pub struct RankRow {
    /// Name on the left.
    pub name: String,
    /// Share as a fraction; printed in per cent.
    pub share: f64,
    /// Annotation on the right, such as a p-value.
    pub note: String,
    /// Whether the bar is drawn in the strong colour.
    pub highlight: bool,
}

/// A finished figure.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    title: String,
    svg: String,
}

impl Figure {
    /// Title, also drawn in the figure.
    pub fn title(&self) -> &str {
        &self.title
    }

    /// The complete `<svg>` element.
    pub fn svg(&self) -> &str {
        &self.svg
    }
}

// ---------------------------------------------------------------------------------------------
// Canvas

struct Canvas<'a> {
    backend: SVGBackend<'a>,
}

fn unit(p: (f64, f64)) -> (i32, i32) {
    ((p.0 * UNIT).round() as i32, (p.1 * UNIT).round() as i32)
}

fn shape(color: Color, alpha: f64, width: f64, filled: bool) -> ShapeStyle {
    let rgba: RGBAColor = RGBColor(color.0, color.1, color.2).mix(alpha);
    ShapeStyle { color: rgba, filled, stroke_width: ((width * UNIT).round() as u32).max(1) }
}

/// Where a text stands about its point.
#[derive(Clone, Copy, PartialEq)]
enum Align {
    Left,
    Middle,
    Right,
}

// The backend writes into a string, which cannot fail: its results carry nothing.
impl Canvas<'_> {
    fn line(&mut self, a: (f64, f64), b: (f64, f64), color: Color, width: f64) {
        let _ = self.backend.draw_line(unit(a), unit(b), &shape(color, 1.0, width, false));
    }

    fn dashed(&mut self, points: &[(f64, f64)], color: Color, width: f64) {
        const ON: f64 = 6.0;
        const OFF: f64 = 4.0;
        let (mut on, mut left) = (true, ON);
        let mut dash: Vec<(f64, f64)> = points.first().copied().into_iter().collect();
        for pair in points.windows(2) {
            let (mut a, b) = (pair[0], pair[1]);
            loop {
                let length = (b.0 - a.0).hypot(b.1 - a.1);
                if length <= left {
                    left -= length;
                    if on {
                        dash.push(b);
                    }
                    break;
                }
                let t = left / length;
                a = (a.0 + t * (b.0 - a.0), a.1 + t * (b.1 - a.1));
                if on {
                    dash.push(a);
                    self.polyline(&dash, color, width);
                    dash.clear();
                } else {
                    dash = vec![a];
                }
                on = !on;
                left = if on { ON } else { OFF };
            }
        }
        if on {
            self.polyline(&dash, color, width);
        }
    }

    fn polyline(&mut self, points: &[(f64, f64)], color: Color, width: f64) {
        match points {
            [] => {}
            [p] => self.dot(*p, width, color, 1.0),
            _ => {
                let path = points.iter().map(|&p| unit(p));
                let _ = self.backend.draw_path(path, &shape(color, 1.0, width, false));
            }
        }
    }

    fn polygon(&mut self, points: &[(f64, f64)], color: Color, alpha: f64) {
        let path: Vec<_> = points.iter().map(|&p| unit(p)).collect();
        let _ = self.backend.fill_polygon(path, &shape(color, alpha, 1.0, true));
    }

    fn bar(&mut self, a: (f64, f64), b: (f64, f64), color: Color, alpha: f64) {
        let (low, high) = ((a.0.min(b.0), a.1.min(b.1)), (a.0.max(b.0), a.1.max(b.1)));
        let _ = self.backend.draw_rect(unit(low), unit(high), &shape(color, alpha, 1.0, true), true);
    }

    fn frame(&mut self, r: Rect) {
        let style = shape(FRAME, 1.0, 1.0, false);
        let _ = self.backend.draw_rect(unit((r.x0, r.y0)), unit((r.x1, r.y1)), &style, false);
    }

    fn dot(&mut self, at: (f64, f64), radius: f64, color: Color, alpha: f64) {
        let r = (radius * UNIT).round().max(1.0) as u32;
        let _ = self.backend.draw_circle(unit(at), r, &shape(color, alpha, 1.0, true), true);
    }

    fn write(&mut self, text: &str, at: (f64, f64), size: f64, color: Color, align: Align) {
        self.styled(text, at, size, color, align, false, false);
    }

    fn styled(&mut self, text: &str, at: (f64, f64), size: f64, color: Color, align: Align, bold: bool, upright: bool) {
        // A control character would make the file unreadable.
        let text: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
        if text.trim().is_empty() {
            return;
        }
        // The backend divides sizes by 1.24.
        let mut font = ("sans-serif", size * UNIT * 1.24).into_font();
        if bold {
            font = font.style(FontStyle::Bold);
        }
        if upright {
            font = font.transform(FontTransform::Rotate270);
        }
        let h = match align {
            Align::Left => HPos::Left,
            Align::Middle => HPos::Center,
            Align::Right => HPos::Right,
        };
        let rgb = RGBColor(color.0, color.1, color.2);
        let style = TextStyle::from(font).color(&rgb).pos(Pos::new(h, VPos::Center));
        let _ = self.backend.draw_text(&text, &style, unit(at));
    }
}

fn draw(title: &str, height: f64, body: impl FnOnce(&mut Canvas)) -> Figure {
    let (w, h) = ((WIDTH * UNIT) as u32, (height * UNIT).ceil() as u32);
    let mut raw = String::new();
    {
        let mut canvas = Canvas { backend: SVGBackend::with_string(&mut raw, (w, h)) };
        canvas.bar((0.0, 0.0), (WIDTH, height), WHITE, 1.0);
        let shown = shorten(title, WIDTH - 24.0, TITLE_SIZE * 1.06);
        canvas.styled(&shown, (12.0, 17.0), TITLE_SIZE, TEXT, Align::Left, true, false);
        body(&mut canvas);
        let _ = canvas.backend.present();
    }
    // The head is written anew: half the size of the drawing units, round joints, a name.
    let inner = raw.find('>').map_or("", |end| &raw[end + 1..]);
    let name = super::html::escape(title);
    let svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}\" height=\"{}\" \
         viewBox=\"0 0 {w} {h}\" stroke-linejoin=\"round\" role=\"img\" aria-label=\"{name}\">{inner}",
        WIDTH,
        f64::from(h) / UNIT
    );
    Figure { title: title.to_owned(), svg }
}

fn text_width(text: &str, size: f64) -> f64 {
    let em: f64 = text
        .chars()
        .map(|c| match c {
            'i' | 'j' | 'l' | '.' | ',' | ':' | ';' | '\'' | '|' | ' ' | '(' | ')' => 0.36,
            'm' | 'w' | 'M' | 'W' | '%' | '@' => 0.92,
            '⁰'..='⁹' | '⁻' | '¹' | '²' | '³' => 0.42,
            c if c.is_uppercase() => 0.70,
            _ => 0.60,
        })
        .sum();
    em * size
}

fn shorten(text: &str, width: f64, size: f64) -> String {
    if text_width(text, size) <= width {
        return text.to_owned();
    }
    let mut kept = String::new();
    for c in text.chars() {
        kept.push(c);
        if text_width(&kept, size) > width - size {
            kept.pop();
            break;
        }
    }
    format!("{}…", kept.trim_end())
}

// ---------------------------------------------------------------------------------------------
// Numbers and axes

fn superscript(exponent: i32) -> String {
    exponent
        .to_string()
        .chars()
        .map(|c| match c {
            '-' => '⁻',
            '1' => '¹',
            '2' => '²',
            '3' => '³',
            c => char::from_u32('⁰' as u32 + c.to_digit(10).unwrap_or(0)).unwrap_or(c),
        })
        .collect()
}

fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(rest) if rest.chars().all(|c| c == '0' || c == '.') => rest.to_owned(),
        Some(rest) => format!("−{rest}"),
        None => text,
    }
}

/// `value` to three significant digits, in powers of ten when it is very large or small.
fn significant(value: f64) -> String {
    if !value.is_finite() {
        return "–".into();
    }
    if value == 0.0 {
        return "0".into();
    }
    // Rounded first: 0.9996 has the exponent of 1.00.
    let text = format!("{value:.2e}");
    let exponent: i32 = text.split('e').nth(1).and_then(|e| e.parse().ok()).unwrap_or(0);
    if (-3..6).contains(&exponent) {
        fixed(value, (2 - exponent).max(0) as usize)
    } else {
        let mantissa: f64 = text.split('e').next().and_then(|m| m.parse().ok()).unwrap_or_default();
        format!("{}·10{}", fixed(mantissa, 2), superscript(exponent))
    }
}

#[derive(Debug, Clone, Default)]
struct Axis {
    lo: f64,
    hi: f64,
    log: bool,
    ticks: Vec<(f64, String)>,
    minor: Vec<f64>,
}

/// The range of the usable values, if any.
fn range(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
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
    /// A linear axis over the range with `pad` of its span added on both sides.
    fn linear((lo, hi): (f64, f64), pad: f64, count: usize) -> Self {
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
        // A range that nearly ends at a tick, as 19.9996 s does, ends there.
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

    /// A logarithmic axis over a positive range.
    fn log((lo, hi): (f64, f64), count: usize) -> Self {
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

    /// Position of `value` as a fraction of the axis, if it has one.
    fn at(&self, value: f64) -> Option<f64> {
        if self.log && value <= 0.0 || value.abs() >= HUGE || value.is_nan() {
            return None;
        }
        Some(if self.log {
            (value / self.lo).ln() / (self.hi / self.lo).ln()
        } else {
            (value - self.lo) / (self.hi - self.lo)
        })
    }

    fn label_width(&self) -> f64 {
        self.ticks.iter().fold(0.0, |w, (_, l)| text_width(l, TICK_SIZE).max(w))
    }
}

#[derive(Debug, Clone, Copy)]
struct Rect {
    x0: f64,
    y0: f64,
    x1: f64,
    y1: f64,
}

impl Rect {
    fn x(&self, axis: &Axis, value: f64) -> Option<f64> {
        Some(self.x0 + axis.at(value)? * (self.x1 - self.x0))
    }

    fn y(&self, axis: &Axis, value: f64) -> Option<f64> {
        Some(self.y1 - axis.at(value)? * (self.y1 - self.y0))
    }

    fn has(&self, p: (f64, f64)) -> bool {
        (self.x0 - 1.0..=self.x1 + 1.0).contains(&p.0) && (self.y0 - 1.0..=self.y1 + 1.0).contains(&p.1)
    }
}

/// Grid, frame and labels of one plot.
fn axes(c: &mut Canvas, r: Rect, x: &Axis, y: &Axis, x_label: Option<&str>, y_label: &str) {
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
    c.styled(&shown, at, LABEL_SIZE, TEXT, Align::Middle, false, true);
}

fn left_margin(width: f64) -> f64 {
    (26.0 + width + 10.0).max(48.0)
}

fn no_data(c: &mut Canvas, r: Rect) {
    let mid = (0.5 * (r.x0 + r.x1), 0.5 * (r.y0 + r.y1));
    c.write("no data", mid, 13.0, QUIET, Align::Middle);
}

// ---------------------------------------------------------------------------------------------
// Legend

#[derive(Debug, Clone, Copy, PartialEq)]
enum Swatch {
    Curve(Style),
    Box,
    Band,
}

type Entry = (String, Color, Swatch);

const LEGEND_ROW: f64 = 18.0;

/// Places of the entries, flowing from left to right, and the number of rows.
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

/// The top of the plot below the title and the legend.
fn head(entries: &[Entry]) -> f64 {
    34.0 + LEGEND_ROW * flow(entries).1 as f64 + if entries.is_empty() { 2.0 } else { 6.0 }
}

fn legend(c: &mut Canvas, entries: &[Entry]) {
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

/// Colours of all curves and the legend: one label has one colour throughout.
fn colours<'a>(curves: impl Iterator<Item = &'a Curve>) -> (Vec<Color>, Vec<Entry>) {
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

// ---------------------------------------------------------------------------------------------
// Curves

type Point = (f64, f64);

/// The lowest and the highest point of a column, each with its place in the curve.
struct Bucket {
    number: i64,
    low: (usize, Point),
    high: (usize, Point),
}

/// Pieces of a line in pixels, at most two points (lowest, highest) per column.
///
/// Gaps are kept where a whole column lacks values.
fn decimate(points: &[Option<(f64, f64)>], x0: f64, x1: f64, columns: usize) -> Vec<Vec<(f64, f64)>> {
    let columns = columns.max(2);
    let sorted = points.iter().flatten().map(|p| p.0).is_sorted();
    let width = (x1 - x0).max(1.0) / columns as f64;
    let few = points.len() <= 2 * columns;
    let per_bucket = points.len().div_ceil(columns).max(1);
    let mut pieces: Vec<Vec<(f64, f64)>> = vec![vec![]];
    let mut bucket: Option<Bucket> = None;
    let mut missing = false;
    let flush = |bucket: &mut Option<Bucket>, pieces: &mut Vec<Vec<Point>>| {
        if let (Some(Bucket { low, high, .. }), Some(piece)) = (bucket.take(), pieces.last_mut()) {
            let (a, b) = if low.0 <= high.0 { (low, high) } else { (high, low) };
            piece.push(a.1);
            if a.0 != b.0 {
                piece.push(b.1);
            }
        }
    };
    for (index, point) in points.iter().enumerate() {
        let Some(p) = *point else {
            missing = true;
            continue;
        };
        let number = if few {
            index as i64
        } else if sorted {
            ((p.0 - x0) / width).floor() as i64
        } else {
            (index / per_bucket) as i64
        };
        match &mut bucket {
            // Pixels grow downwards.
            Some(b) if b.number == number => {
                if p.1 > b.low.1.1 {
                    b.low = (index, p);
                }
                if p.1 < b.high.1.1 {
                    b.high = (index, p);
                }
            }
            _ => {
                let jump = bucket.as_ref().is_some_and(|b| few || number - b.number > 1);
                flush(&mut bucket, &mut pieces);
                if missing && jump && pieces.len() < MAX_PIECES {
                    pieces.push(vec![]);
                }
                bucket = Some(Bucket { number, low: (index, p), high: (index, p) });
            }
        }
        missing = false;
    }
    flush(&mut bucket, &mut pieces);
    pieces.retain(|p| !p.is_empty());
    pieces
}

fn plot(c: &mut Canvas, r: Rect, x: &Axis, y: &Axis, curve: &Curve, color: Color, total: usize) {
    let place = |(vx, vy): (f64, f64)| {
        let p = (r.x(x, vx)?, r.y(y, vy)?);
        r.has(p).then_some(p)
    };
    let points: Vec<Option<(f64, f64)>> = curve.pairs().map(place).collect();
    let total = total.max(1);
    if curve.style == Style::Points {
        let some: Vec<_> = points.into_iter().flatten().collect();
        let every = some.len().div_ceil((MAX_DOTS / total).max(1)).max(1);
        for p in some.iter().step_by(every) {
            c.dot(*p, 1.5, color, 0.8);
        }
        return;
    }
    let columns = ((r.x1 - r.x0) as usize).min(MAX_POINTS / (2 * total));
    // Dashes cost more bytes than a line and cannot be seen in a dense band.
    let columns = if curve.style == Style::Dashed { columns / 4 } else { columns };
    for piece in decimate(&points, r.x0, r.x1, columns) {
        match curve.style {
            Style::Dashed if piece_length(&piece) < 4000.0 => c.dashed(&piece, color, 1.5),
            Style::Thin => c.polyline(&piece, color, 0.5),
            _ => c.polyline(&piece, color, if total > 8 || piece.len() > 600 { 1.0 } else { 1.5 }),
        }
    }
}

fn piece_length(piece: &[(f64, f64)]) -> f64 {
    piece.windows(2).map(|w| (w[1].0 - w[0].0).hypot(w[1].1 - w[0].1)).sum()
}

fn usable(curves: &[Curve]) -> impl Iterator<Item = (f64, f64)> + '_ {
    let pairs = curves.iter().flat_map(Curve::pairs);
    pairs.filter(|(x, y)| x.abs() < HUGE && y.abs() < HUGE)
}

// ---------------------------------------------------------------------------------------------
// Figures

/// Curves against a common abscissa, such as time.
///
/// Long curves are reduced to their lowest and highest value in every pixel column.
pub fn time_series(title: &str, x_label: &str, y_label: &str, curves: &[Curve]) -> Figure {
    let panel = Panel { title: String::new(), y_label: y_label.into(), curves: curves.to_vec() };
    stack(title, x_label, std::slice::from_ref(&panel), 260.0)
}

/// A stack of panels with one shared abscissa and one legend.
pub fn panels(title: &str, x_label: &str, panels: &[Panel]) -> Figure {
    stack(title, x_label, panels, 128.0)
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
        panels.iter().map(|p| range(usable(&p.curves).map(|p| p.1)).map(|r| Axis::linear(r, 0.05, y_ticks))).collect();
    let left = left_margin(y.iter().flatten().fold(0.0, |w, a| a.label_width().max(w)));
    draw(title, full, |c| {
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
            c.styled(&name, (r.x0, r.y0 - 10.0), LABEL_SIZE, TEXT, Align::Left, true, false);
            for curve in &panel.curves {
                let color = color.next().copied().unwrap_or(Color::MODEL);
                if let (Some(x), Some(y)) = (&x, y_axis) {
                    plot(c, r, x, y, curve, color, total);
                }
            }
            if y_axis.is_none() {
                no_data(c, r);
            }
        }
    })
}

/// Errors of several quantities through the stages of a correction, as grouped bars.
///
/// The axis is logarithmic when the errors span more than a factor of 30. A group's noise floor
/// is a dashed line across its bars; every bar carries its value.
pub fn falling_error(title: &str, y_label: &str, stages: &[&str], groups: &[ErrorGroup]) -> Figure {
    let palette = |k: usize| match (k, stages.len()) {
        (0, n) if n > 1 => Color::RESIDUAL,
        (k, n) if k + 1 == n => Color::MODEL,
        (k, _) => [Color(0xe6, 0x9f, 0x00), Color(0xcc, 0x79, 0xa7), Color(0x56, 0xb4, 0xe9)][(k - 1) % 3],
    };
    let mut entries: Vec<Entry> =
        stages.iter().enumerate().map(|(k, s)| ((*s).to_owned(), palette(k), Swatch::Box)).collect();
    if groups.iter().any(|g| g.floor.is_some()) {
        entries.push(("noise floor".into(), TEXT, Swatch::Curve(Style::Dashed)));
    }
    let bars = || groups.iter().flat_map(|g| g.values.iter().take(stages.len()).copied());
    let every = || bars().chain(groups.iter().filter_map(|g| g.floor)).filter(|v| *v >= 0.0);
    let positive = range(every().filter(|v| *v > 0.0));
    let y = range(bars().filter(|v| *v >= 0.0)).map(|_| match positive {
        Some((lo, hi)) if hi / lo > 30.0 => {
            // Low enough for the shortest bar to be seen, high enough for its number.
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
                c.bar((a, high), (b, r.y1), palette(k), 1.0);
                texts.push((0.5 * (a + b), high, significant(value)));
            }
            let line = group.floor.filter(|f| *f >= 0.0).and_then(|f| r.y(&y, f));
            if let Some(py) = line.filter(|p| (r.y0..=r.y1).contains(p)) {
                let end = start + bar * stages.len() as f64;
                let (a, b) = ((start - 7.0, py), (end + 7.0, py));
                c.line(a, b, WHITE, 1.5);
                c.dashed(&[a, b], TEXT, 1.5);
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
                c.styled(&text, at, TICK_SIZE.min(bar), TEXT, Align::Left, false, true);
            }
        }
    })
}

/// A quantity against another: a thinned cloud of samples, and in each of `bins` equal bins the
/// mean and a band of one standard deviation on both sides.
///
/// Bins with fewer than three samples are left out. The vertical range follows the bands and the
/// middle 98 % of the samples.
pub fn scatter_binned(title: &str, x_label: &str, y_label: &str, curves: &[Curve], bins: usize) -> Figure {
    let bins = bins.clamp(1, 400);
    let (colors, mut entries) = colours(curves.iter());
    for entry in &mut entries {
        entry.2 = Swatch::Band;
        entry.0.push_str(" (mean ± 1 s.d.)");
    }
    let x_range = range(usable(curves).map(|p| p.0));
    let mut means: Vec<Vec<Option<(f64, f64, f64)>>> = Vec::new();
    let mut extent = None;
    if let Some((lo, hi)) = x_range {
        let width = (hi - lo) / bins as f64;
        for curve in curves {
            // Count, mean and sum of squared deviations of every bin.
            let mut sums = vec![(0.0, 0.0, 0.0); bins];
            for (x, y) in usable(std::slice::from_ref(curve)) {
                let k = if width > 0.0 { ((x - lo) / width) as usize } else { 0 };
                let s = &mut sums[k.min(bins - 1)];
                s.0 += 1.0;
                let d = y - s.1;
                s.1 += d / s.0;
                s.2 += d * (y - s.1);
            }
            let row = sums.iter().enumerate().map(|(k, s)| {
                let x = lo + (k as f64 + 0.5) * width;
                (s.0 >= 3.0).then(|| (x, s.1, (s.2 / (s.0 - 1.0)).max(0.0).sqrt()))
            });
            means.push(row.collect());
        }
        let mut ys: Vec<f64> = usable(curves).map(|p| p.1).collect();
        ys.sort_by(f64::total_cmp);
        let cut = if ys.len() > 100 { ys.len() / 100 } else { 0 };
        let bands = means.iter().flatten().flatten().flat_map(|m| [m.1 - m.2, m.1 + m.2]);
        extent = range(bands.chain([ys[cut], ys[ys.len() - 1 - cut]]));
    }
    let x = x_range.map(|r| Axis::linear(r, 0.01, 10));
    let y = extent.map(|r| Axis::linear(r, 0.05, 7));
    let top = head(&entries);
    let left = left_margin(y.as_ref().map_or(0.0, Axis::label_width));
    let r = Rect { x0: left, y0: top, x1: WIDTH - RIGHT, y1: top + 280.0 };
    draw(title, r.y1 + 44.0, |c| {
        legend(c, &entries);
        let none = Axis { hi: 1.0, ..Axis::default() };
        let (xa, ya) = (x.as_ref().unwrap_or(&none), y.as_ref().unwrap_or(&none));
        axes(c, r, xa, ya, Some(x_label), y_label);
        let (Some(x), Some(y)) = (x, y) else { return no_data(c, r) };
        let at = |vx: f64, vy: f64| Some((r.x(&x, vx)?, r.y(&y, vy)?)).filter(|p| r.has(*p));
        for (curve, color) in curves.iter().zip(&colors) {
            let some: Vec<_> = usable(std::slice::from_ref(curve)).collect();
            // Regular thinning would follow a periodic motion: the step is not a whole number.
            let want = (MAX_DOTS / curves.len().max(1)).max(1).min(some.len());
            for k in 0..want {
                let jitter = (k as f64 * 0.618_033_988_75).fract();
                let index = ((k as f64 + jitter) * some.len() as f64 / want as f64) as usize;
                let (vx, vy) = some[index.min(some.len() - 1)];
                if let Some(p) = at(vx, vy) {
                    c.dot(p, 1.0, *color, 0.3);
                }
            }
        }
        let runs = |row: &[Option<(f64, f64, f64)>]| -> Vec<Vec<(f64, f64, f64)>> {
            row.split(Option::is_none)
                .map(|run| run.iter().flatten().copied().collect::<Vec<_>>())
                .filter(|run| !run.is_empty())
                .collect()
        };
        for (row, color) in means.iter().zip(&colors) {
            for run in runs(row) {
                let upper = run.iter().filter_map(|m| at(m.0, m.1 + m.2));
                let lower = run.iter().rev().filter_map(|m| at(m.0, m.1 - m.2));
                let outline: Vec<_> = upper.chain(lower).collect();
                if run.len() > 1 {
                    c.polygon(&outline, *color, 0.2);
                } else if let [a, b] = outline[..] {
                    c.line(a, b, *color, 1.0);
                }
            }
        }
        for (row, color) in means.iter().zip(&colors) {
            for run in runs(row) {
                let line: Vec<_> = run.iter().filter_map(|m| at(m.0, m.1)).collect();
                c.polyline(&line, *color, 2.0);
                if bins <= 60 {
                    for p in line {
                        c.dot(p, 2.5, *color, 1.0);
                    }
                }
            }
        }
    })
}

/// The highest point of each of `columns` equal steps of the logarithm of the abscissa.
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

/// Amplitude spectra on two logarithmic axes, at most six decades high, with vertical markers.
///
/// Where several lines share two pixels the highest is drawn, so that no peak is lost.
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
    // Labels that would overlap go into further rows, the last ones left out.
    let mut rows: Vec<f64> = Vec::new();
    let top = head(&entries) + 14.0 * markers.len().min(MARKER_ROWS) as f64;
    let left = left_margin(y.as_ref().map_or(0.0, Axis::label_width));
    let r = Rect { x0: left, y0: top, x1: WIDTH - RIGHT, y1: top + 280.0 };
    draw(title, r.y1 + 44.0, |c| {
        legend(c, &entries);
        let none = Axis { hi: 1.0, ..Axis::default() };
        let (xa, ya) = (x.as_ref().unwrap_or(&none), y.as_ref().unwrap_or(&none));
        axes(c, r, xa, ya, Some(x_label), y_label);
        let (Some(x), Some(y)) = (x, y) else { return no_data(c, r) };
        let mut places: Vec<(f64, &str)> = markers
            .iter()
            .filter_map(|m| Some((r.x(&x, m.at)?, m.label.as_str())))
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
            plot(c, r, &x, &y, curve, *color, curves.len());
        }
    })
}

/// Candidates as horizontal bars: names on the left, share and annotation on the right.
///
/// The rows keep their order; `x_label` says what the share is of.
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
        // Room for the number behind the longest bar, and before a negative one.
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
            c.styled(&name, at, LABEL_SIZE, TEXT, Align::Right, row.highlight, false);
            let note = shorten(&row.note, notes, LABEL_SIZE);
            c.write(&note, (x1 + 10.0, y), LABEL_SIZE, QUIET, Align::Left);
            let Some(axis) = &axis else { continue };
            let zero = r.x(axis, 0.0).unwrap_or(x0);
            let end = r.x(axis, 100.0 * row.share);
            let color = if row.highlight { Color::RESIDUAL } else { Color::MUTED };
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

#[cfg(test)]
#[path = "figure_tests.rs"]
mod tests;
