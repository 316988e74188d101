//! Figure of a force of unknown origin.

use crate::{Color, Curve, Figure, Style, time_series};
use deltatwin::diagnosis::unknown::Shape;
use deltatwin::machine::Unit;

/// Force as a function of the variable it depends on most, with its simultaneous 95 % band.
pub fn shape(shape: &Shape, title: &str, unit: Unit) -> Figure {
    let curve = |label: &str, y: &[f64]| Curve::new(label, shape.x.clone(), y.to_vec());
    let band = Color::MUTED;
    let curves = [
        curve("mean of what acts", &shape.mean).color(Color::MEASURED),
        curve("simultaneous 95 % band", &shape.low).color(band).style(Style::Dashed),
        curve("", &shape.high).color(band).style(Style::Dashed),
    ];
    let what = if shape.along { "force along the motion" } else { "force" };
    let over = match shape.period {
        Some((length, _)) => format!("{} within a period of {length:.4} / {}", shape.variable, shape.variable_unit()),
        None => format!("{} / {}", shape.variable, shape.variable_unit()),
    };
    time_series(title, &over, &format!("{what} / {unit}"), &curves)
}
