//! What a force of unknown origin looks like.

use deltatwin::diagnosis::unknown::Shape;
use deltatwin_report::{Color, Curve, Figure, Style, time_series};

    /// The force over its variable.
    pub fn figure(&self, title: &str, unit: &str) -> Figure {
        let curve = |label: &str, y: &[f64]| Curve::new(label, self.x.clone(), y.to_vec());
        let band = Color::CYCLE[1];
        let curves = [
            curve("mean of what acts", &self.mean).color(Color::CYCLE[0]),
            curve("simultaneous 95 % band", &self.low).color(band).style(Style::Dashed),
            curve("", &self.high).color(band).style(Style::Dashed),
        ];
        let what = if self.along { "force along the motion" } else { "force" };
        let over = match self.period {
            Some((length, _)) => format!("{} within a period of {length:.4} / {}", self.variable, self.variable_unit),
            None => format!("{} / {}", self.variable, self.variable_unit),
        };
        time_series(title, &over, &format!("{what} / {unit}"), &curves)
    }
}

