//! Figures common to several sections.

use deltatwin::identification::Dataset;
use deltatwin::machine::every_axis;
use deltatwin_report::{Color, Curve, Figure, Panel, Style, panels};

/// Colours of the computed curves, in order.
const COMPUTED: [Color; 2] = [Color::BLUE, Color::VERMILION];

/// Measured and computed torques of all axes over time.
pub fn measured_and_computed(title: &str, dataset: &Dataset, computed: &[(&str, &[Vec<f64>])]) -> Figure {
    let panel = |axis: usize| {
        let mut curves = vec![
            Curve::new("measured", dataset.t.clone(), dataset.measured[axis].to_vec())
                .color(Color::MUTED)
                .style(Style::Thin),
        ];
        for ((label, series), color) in computed.iter().zip(COMPUTED) {
            curves.push(Curve::new(*label, dataset.t.clone(), series[axis].clone()).color(color));
        }
        Panel { title: format!("axis {}", axis + 1), y_label: "torque / N·m".into(), curves }
    };
    panels(title, "time / s", &every_axis().map(panel).collect::<Vec<_>>())
}
