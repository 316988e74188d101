//! Drawing in CSS pixels on the SVG backend.

use plotters::backend::DrawingBackend;
use plotters::prelude::{IntoFont, RGBAColor, RGBColor, SVGBackend, ShapeStyle, TextStyle};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color as _, FontStyle, FontTransform};

use super::axis::Rect;
use super::color::{Color, FRAME, TEXT, WHITE};
use super::{Figure, WIDTH};

/// Internal units per CSS pixel, because the backend draws at whole units.
const UNIT: f64 = 2.0;
const TITLE_SIZE: f64 = 14.5;

pub(super) struct Canvas<'a> {
    backend: SVGBackend<'a>,
}

fn unit(p: (f64, f64)) -> (i32, i32) {
    ((p.0 * UNIT).round() as i32, (p.1 * UNIT).round() as i32)
}

fn shape(color: Color, alpha: f64, width: f64, filled: bool) -> ShapeStyle {
    let rgba: RGBAColor = RGBColor(color.0, color.1, color.2).mix(alpha);
    ShapeStyle { color: rgba, filled, stroke_width: ((width * UNIT).round() as u32).max(1) }
}

/// Alignment of a text relative to its point.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Align {
    Left,
    Middle,
    Right,
}

/// Size, colour, alignment and orientation of a text.
#[derive(Clone, Copy)]
pub(super) struct Lettering {
    pub size: f64,
    pub color: Color,
    pub align: Align,
    pub bold: bool,
    /// Whether it is rotated to read upwards.
    pub upright: bool,
}

impl Lettering {
    /// Plain text.
    pub(super) fn new(size: f64, color: Color, align: Align) -> Self {
        Self { size, color, align, bold: false, upright: false }
    }

    pub(super) fn bold(self, bold: bool) -> Self {
        Self { bold, ..self }
    }

    /// Rotated to read upwards.
    pub(super) fn upright(self) -> Self {
        Self { upright: true, ..self }
    }
}

// The backend writes to a string, which cannot fail; its results are ignored.
impl Canvas<'_> {
    pub(super) fn line(&mut self, a: (f64, f64), b: (f64, f64), color: Color, width: f64) {
        let _ = self.backend.draw_line(unit(a), unit(b), &shape(color, 1.0, width, false));
    }

    pub(super) fn dashed(&mut self, points: &[(f64, f64)], color: Color, width: f64) {
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

    pub(super) fn polyline(&mut self, points: &[(f64, f64)], color: Color, width: f64) {
        match points {
            [] => {}
            [p] => self.dot(*p, width, color, 1.0),
            _ => {
                let path = points.iter().map(|&p| unit(p));
                let _ = self.backend.draw_path(path, &shape(color, 1.0, width, false));
            }
        }
    }

    pub(super) fn polygon(&mut self, points: &[(f64, f64)], color: Color, alpha: f64) {
        let path: Vec<_> = points.iter().map(|&p| unit(p)).collect();
        let _ = self.backend.fill_polygon(path, &shape(color, alpha, 1.0, true));
    }

    pub(super) fn bar(&mut self, a: (f64, f64), b: (f64, f64), color: Color, alpha: f64) {
        let (low, high) = ((a.0.min(b.0), a.1.min(b.1)), (a.0.max(b.0), a.1.max(b.1)));
        let _ = self.backend.draw_rect(unit(low), unit(high), &shape(color, alpha, 1.0, true), true);
    }

    pub(super) fn frame(&mut self, r: Rect) {
        let style = shape(FRAME, 1.0, 1.0, false);
        let _ = self.backend.draw_rect(unit((r.x0, r.y0)), unit((r.x1, r.y1)), &style, false);
    }

    pub(super) fn dot(&mut self, at: (f64, f64), radius: f64, color: Color, alpha: f64) {
        let r = (radius * UNIT).round().max(1.0) as u32;
        let _ = self.backend.draw_circle(unit(at), r, &shape(color, alpha, 1.0, true), true);
    }

    /// A hollow dot.
    pub(super) fn ring(&mut self, at: (f64, f64), radius: f64, color: Color, width: f64) {
        let r = (radius * UNIT).round().max(1.0) as u32;
        let _ = self.backend.draw_circle(unit(at), r, &shape(color, 1.0, width, false), false);
    }

    pub(super) fn write(&mut self, text: &str, at: (f64, f64), size: f64, color: Color, align: Align) {
        self.styled(text, at, Lettering::new(size, color, align));
    }

    pub(super) fn styled(&mut self, text: &str, at: (f64, f64), lettering: Lettering) {
        let Lettering { size, color, align, bold, upright } = lettering;
        // A control character would make the SVG invalid.
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

pub(super) fn draw(title: &str, height: f64, body: impl FnOnce(&mut Canvas)) -> Figure {
    let (w, h) = ((WIDTH * UNIT) as u32, (height * UNIT).ceil() as u32);
    let mut raw = String::new();
    {
        let mut canvas = Canvas { backend: SVGBackend::with_string(&mut raw, (w, h)) };
        canvas.bar((0.0, 0.0), (WIDTH, height), WHITE, 1.0);
        let shown = shorten(title, WIDTH - 24.0, TITLE_SIZE * 1.06);
        canvas.styled(&shown, (12.0, 17.0), Lettering::new(TITLE_SIZE, TEXT, Align::Left).bold(true));
        body(&mut canvas);
        let _ = canvas.backend.present();
    }
    // The header is replaced: half the size of the drawing units, round joins, an accessible name.
    let inner = raw.find('>').map_or("", |end| &raw[end + 1..]);
    let name = crate::html::escape(title);
    let svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}\" height=\"{}\" \
         viewBox=\"0 0 {w} {h}\" stroke-linejoin=\"round\" role=\"img\" aria-label=\"{name}\">{inner}",
        WIDTH,
        f64::from(h) / UNIT
    );
    Figure { title: title.to_owned(), svg, live: None }
}

pub(super) fn text_width(text: &str, size: f64) -> f64 {
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

pub(super) fn shorten(text: &str, width: f64, size: f64) -> String {
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
