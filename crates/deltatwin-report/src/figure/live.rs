//! Curves of a figure as data, from which a page draws them again to be zoomed.

use serde_json::{Value, json};

use super::color::Color;
use super::curve::{Curve, Style};
use super::legend::colours;
use super::time_series::Panel;

/// Largest number of points of a curve in a page; a longer one is reduced to the extremes of pieces of equal length.
const MOST: usize = 2000;

/// What a page needs to draw the panels of a figure; `None` if a curve runs back and forth, or has no points.
pub(super) fn live(x_label: &str, panels: &[Panel], logarithmic: bool) -> Option<String> {
    let (colors, _) = colours(panels.iter().flat_map(|p| &p.curves));
    let mut colors = colors.iter();
    let mut out = Vec::new();
    for panel in panels {
        let mut curves = Vec::new();
        // Curves mostly share their abscissae.
        let mut abscissae: Vec<Vec<f64>> = Vec::new();
        for curve in &panel.curves {
            let color = colors.next().copied().unwrap_or(Color::BLUE);
            let (x, y) = thinned(curve)?;
            let place = abscissae.iter().position(|other| *other == x).unwrap_or_else(|| {
                abscissae.push(x);
                abscissae.len() - 1
            });
            let style = match curve.style {
                Style::Line => "line",
                Style::Thin => "thin",
                Style::Dashed => "dashed",
                Style::Points => "points",
            };
            let y: Vec<Value> = y.iter().map(|y| number(*y, 5)).collect();
            curves.push(json!({"label": curve.label, "color": color.variable().map_or_else(|| color.hex(), |name| format!("var(--{name})")), "style": style, "x": place, "y": y}));
        }
        let abscissae: Vec<Vec<Value>> = abscissae.iter().map(|x| x.iter().map(|x| number(*x, 7)).collect()).collect();
        out.push(json!({"title": panel.title, "unit": panel.y_label, "x": abscissae, "curves": curves}));
    }
    let any = panels.iter().flat_map(|p| &p.curves).any(|c| !c.x.is_empty());
    any.then(|| json!({"x": x_label, "logarithmic": logarithmic, "panels": out}).to_string())
}

/// A number with few digits; null if there is none.
fn number(x: f64, digits: usize) -> Value {
    let text = format!("{x:.*e}", digits - 1);
    text.parse::<f64>().ok().filter(|x| x.is_finite()).map_or(Value::Null, |x| json!(x))
}

/// Ascending abscissae of a curve with their ordinates; `None` if it runs back and forth.
fn thinned(curve: &Curve) -> Option<(Vec<f64>, Vec<f64>)> {
    let mut pairs: Vec<(f64, f64)> = curve.pairs().filter(|(x, _)| x.is_finite()).collect();
    if curve.style == Style::Points {
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    }
    if !pairs.is_sorted_by(|a, b| a.0 <= b.0) {
        return None;
    }
    let size = pairs.len().div_ceil(MOST / 2);
    if pairs.len() <= MOST {
        return Some(pairs.into_iter().unzip());
    }
    let ends = |piece: &[(f64, f64)]| {
        let some = || piece.iter().enumerate().filter(|(_, p)| p.1.is_finite());
        let low = some().min_by(|a, b| a.1.1.total_cmp(&b.1.1)).map_or((0, f64::NAN), |(k, p)| (k, p.1));
        let high = some().max_by(|a, b| a.1.1.total_cmp(&b.1.1)).map_or((0, f64::NAN), |(k, p)| (k, p.1));
        let [first, last] = if low.0 <= high.0 { [low.1, high.1] } else { [high.1, low.1] };
        [(piece[0].0, first), (piece[piece.len() - 1].0, last)]
    };
    Some(pairs.chunks(size).flat_map(ends).unzip())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_curve_keeps_its_peaks_and_one_that_turns_back_is_not_drawn_again() {
        let x: Vec<f64> = (0..100_000).map(|k| 1e-3 * f64::from(k)).collect();
        let mut y = vec![0.0; x.len()];
        (y[31_337], y[77_777]) = (7.25, -3.0);
        let curve = Curve::new("c", x.clone(), y);
        let (thin, low) = thinned(&curve).unwrap();
        assert!(thin.len() <= MOST + 2 && thin.is_sorted() && thin[0] == 0.0 && thin.last() == x.last());
        assert!(low.contains(&7.25) && low.contains(&-3.0));
        let back = Curve::new("c", vec![0.0, 1.0, 0.5], vec![0.0; 3]);
        assert_eq!(thinned(&back), None);
        assert!(thinned(&back.style(Style::Points)).is_some());
    }

    #[test]
    fn curves_share_abscissae_and_gaps_are_null() {
        let x = vec![0.0, 0.123_456_789, 1.0];
        let panel = Panel {
            title: "p".into(),
            y_label: "N".into(),
            curves: vec![Curve::new("a", x.clone(), vec![1.0, f64::NAN, 3.0]), Curve::new("b", x, vec![0.0; 3])],
        };
        let text = live("t / s", &[panel], false).unwrap();
        let data: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(data["panels"][0]["x"], json!([[0.0, 0.123_456_8, 1.0]]));
        assert_eq!(data["panels"][0]["curves"][0]["y"], json!([1.0, null, 3.0]));
        assert_eq!(data["panels"][0]["curves"][1]["x"], 0);
        assert_eq!(live("t", &[], false), None);
    }
}
