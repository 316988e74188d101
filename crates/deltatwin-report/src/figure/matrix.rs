//! Matrix of shares, such as a confusion matrix or correlations.

use super::canvas::{Align, Lettering, draw, shorten, text_width};
use super::color::{Color, FRAME, GRID, QUIET, TEXT};
use super::{Figure, LABEL_SIZE, RIGHT, TICK_SIZE, WIDTH};

/// One cell of a matrix.
#[derive(Debug, Clone, PartialEq)]
pub struct Cell {
    /// Depth of the colour, from 0 to 1.
    pub share: f64,
    /// Text in the cell.
    pub text: String,
    /// Its colour at a share of 1.
    pub color: Color,
}

/// Matrix of cells with row and column names; `cells[row][column]`, missing cells stay empty.
pub fn matrix(title: &str, rows: &[String], columns: &[String], cells: &[Vec<Cell>]) -> Figure {
    const ROW: f64 = 19.0;
    const WIDEST: f64 = 90.0;
    let longest = |names: &[String]| names.iter().fold(0.0f64, |w, n| w.max(text_width(n, LABEL_SIZE))).min(230.0);
    let x0 = 12.0 + longest(rows) + 10.0;
    let column = ((WIDTH - RIGHT - x0) / columns.len().max(1) as f64).min(WIDEST);
    // Names wider than their column are rotated.
    let upright = columns.iter().any(|n| text_width(n, LABEL_SIZE) > column - 4.0);
    let y0 = 34.0 + if upright { longest(columns) + 10.0 } else { 22.0 };
    let (x1, y1) = (x0 + column * columns.len() as f64, y0 + ROW * rows.len() as f64);
    draw(title, y1 + 12.0, |c| {
        for (k, name) in columns.iter().enumerate() {
            let x = x0 + (k as f64 + 0.5) * column;
            let shown = shorten(name, 230.0, LABEL_SIZE);
            if upright {
                c.styled(&shown, (x, y0 - 6.0), Lettering::new(LABEL_SIZE, TEXT, Align::Left).upright());
            } else {
                c.write(&shown, (x, y0 - 10.0), LABEL_SIZE, TEXT, Align::Middle);
            }
        }
        for (i, name) in rows.iter().enumerate() {
            let y = y0 + i as f64 * ROW;
            let shown = shorten(name, 230.0, LABEL_SIZE);
            c.write(&shown, (x0 - 7.0, y + 0.5 * ROW), LABEL_SIZE, TEXT, Align::Right);
            for (k, cell) in cells.get(i).into_iter().flatten().enumerate().take(columns.len()) {
                let (a, b) = (x0 + k as f64 * column, x0 + (k + 1) as f64 * column);
                let share = if cell.share.is_finite() { cell.share.clamp(0.0, 1.0) } else { 0.0 };
                let mut ink = QUIET;
                if share > 0.0 {
                    let color = cell.color.pale(0.15 + 0.85 * share);
                    c.bar((a, y), (b, y + ROW), color, 1.0);
                    ink = color.ink();
                }
                let text = shorten(&cell.text, column - 2.0, TICK_SIZE);
                c.write(&text, (0.5 * (a + b), y + 0.5 * ROW), TICK_SIZE, ink, Align::Middle);
            }
        }
        for k in 0..=columns.len() {
            let x = x0 + k as f64 * column;
            c.line((x, y0), (x, y1), GRID, 0.5);
        }
        for i in 0..=rows.len() {
            let y = y0 + i as f64 * ROW;
            c.line((x0, y), (x1, y), GRID, 0.5);
        }
        c.frame(super::axis::Rect { x0, y0, x1, y1 });
        if rows.is_empty() || columns.is_empty() {
            c.write("no data", (0.5 * WIDTH, y0 + 10.0), 13.0, FRAME, Align::Middle);
        }
    })
}
