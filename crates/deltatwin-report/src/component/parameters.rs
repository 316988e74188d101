//! Parameters with error bars beside their prior values.

use std::fmt::Write as _;

use deltatwin::dynamics::ParamTable;
use deltatwin::identification::Estimate;

use super::number;
use crate::Report;
use crate::html::escape;

/// Adds a table of all identified parameters: the value of the delivered model, the estimates of every stage with their
/// standard errors, and these as intervals on a common axis per parameter.
pub fn add(report: &mut Report, prior: &ParamTable, stages: &[(&str, &[Estimate])]) {
    let Some((_, last)) = stages.last() else { return };
    let values = prior.values();
    let mut html = String::from(
        "<div class=\"wide\"><table class=\"parameters\"><thead><tr><th>parameter</th><th>± 2 std, dashed: model</th><th class=\"n\">model</th>",
    );
    for (name, _) in stages {
        let _ = write!(html, "<th class=\"n\">{}</th>", escape(name));
    }
    html.push_str("<th>unit</th></tr></thead><tbody>\n");
    for p in last.iter().filter(|p| p.identified()) {
        let own = prior.index(p.param).map(|i| values[i]);
        let of = |estimates: &&[Estimate]| estimates.iter().find(|e| e.param == p.param && e.identified()).cloned();
        let all: Vec<Option<Estimate>> = stages.iter().map(|(_, estimates)| of(estimates)).collect();
        let _ = write!(
            html,
            "<tr><td><code>{}</code></td><td>{}</td><td class=\"n\">{}</td>",
            escape(&p.name),
            intervals(own, &all),
            own.map_or("–".into(), number)
        );
        for estimate in &all {
            let text = estimate
                .as_ref()
                .map_or("–".into(), |e| format!("{} ± {}", number(e.value), deltatwin::text::significant(e.std, 2)));
            let _ = write!(html, "<td class=\"n\">{text}</td>");
        }
        let _ = writeln!(html, "<td class=\"unit\">{}</td></tr>", escape(&p.unit.to_string()));
    }
    html.push_str("</tbody></table></div>");
    report.push(html);
    let not = last.iter().filter(|p| !p.identified()).count();
    if not > 0 {
        report.paragraph(&format!(
            "{not} more parameters are not determined individually and keep the values of the model."
        ));
    }
}

/// Width and height of a drawing, in pixels.
const SIZE: (f64, f64) = (150.0, 22.0);

/// The prior value as a tick and the estimates as intervals of two standard errors, as an SVG element.
fn intervals(prior: Option<f64>, stages: &[Option<Estimate>]) -> String {
    let (width, height) = SIZE;
    let ends = stages.iter().flatten().flat_map(|e| [e.value - 2.0 * e.std, e.value + 2.0 * e.std]);
    let all: Vec<f64> = ends.chain(prior).filter(|x| x.is_finite()).collect();
    let (low, high) = all.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(*x), b.max(*x)));
    if low > high {
        return String::new();
    }
    let span = (high - low).max(f64::MIN_POSITIVE);
    let at = |x: f64| 6.0 + (width - 12.0) * (x - low) / span;
    let mut svg = format!(
        "<svg class=\"intervals\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" aria-hidden=\"true\">"
    );
    if let Some(prior) = prior {
        let x = at(prior);
        let _ = write!(svg, "<line class=\"prior\" x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"1\" y2=\"{:.1}\"/>", height - 1.0);
    }
    let n = stages.len();
    for (s, estimate) in stages.iter().enumerate() {
        let Some(e) = estimate else { continue };
        let y = height * (s as f64 + 1.0) / (n as f64 + 1.0);
        let class = if s + 1 == n && n > 1 { "stage-last" } else { "stage-1" };
        let (a, b, x) = (at(e.value - 2.0 * e.std), at(e.value + 2.0 * e.std), at(e.value));
        let _ = write!(
            svg,
            "<g class=\"{class}\"><line x1=\"{a:.1}\" x2=\"{b:.1}\" y1=\"{y:.1}\" y2=\"{y:.1}\"/><circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"2.6\"/></g>"
        );
    }
    svg + "</svg>"
}
