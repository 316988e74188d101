//! What was checked of every axis of a recording, and its measured over its predicted torque.

use std::fmt::Write as _;

use deltatwin::text::significant;

use crate::Report;
use crate::html::{escape, wide};

/// Outcome of a check.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// In order.
    Passed,
    /// To be looked at.
    Remark,
    /// A fit would be meaningless.
    Failed,
    /// Not decided.
    Open,
}

impl Outcome {
    /// Class of the colour, and a sign that shows the same without it.
    fn marks(self) -> (&'static str, &'static str) {
        match self {
            Self::Passed => ("good", "✓"),
            Self::Remark => ("warn", "!"),
            Self::Failed => ("bad", "✗"),
            Self::Open => ("open", "–"),
        }
    }
}

/// One axis of a recording.
pub struct Axis {
    /// Title of the channel.
    pub title: String,
    /// Unit of its torque.
    pub unit: String,
    /// Slope of measured over predicted torque and its standard error.
    pub slope: Option<(f64, f64)>,
    /// Outcome and words of every check.
    pub cells: Vec<(Outcome, String)>,
    /// Predicted and measured torques.
    pub points: Vec<[f64; 2]>,
}

/// Adds the table of the `checks` of all axes, and a picture of each axis.
pub fn add(report: &mut Report, checks: &[&str], axes: &[Axis]) {
    let mut html = wide("checks by axis") + "<table class=\"checks cards\"><thead><tr><th>axis</th><th>slope</th>";
    checks.iter().for_each(|name| html += &format!("<th>{}</th>", escape(name)));
    html += "</tr></thead><tbody>\n";
    for axis in axes {
        let slope = axis.slope.map_or("–".into(), |(slope, std)| deltatwin::text::with_error(slope, std));
        let _ = write!(html, "<tr><th scope=\"row\">{}</th><td data-label=\"slope\">{slope}</td>", escape(&axis.title));
        for (name, (outcome, text)) in checks.iter().zip(&axis.cells) {
            let ((class, sign), name, text) = (outcome.marks(), escape(name), escape(text));
            let _ = write!(
                html,
                "<td class=\"{class}\" data-label=\"{name}\"><span><i aria-hidden=\"true\">{sign}</i> {text}</span></td>"
            );
        }
        html += "</tr>\n";
    }
    html += "</tbody></table></div>\n<p class=\"small\">Slope of measured over predicted torque; ✓ in order, ! to be looked at, ✗ a fit would be meaningless. In the pictures a dot is an instant, the \
             dashed line is measured = predicted.</p>\n<div class=\"followed\">";
    axes.iter().for_each(|axis| html += &picture(axis));
    report.push(html + "</div>");
}

/// Side of a picture, in pixels.
const SIDE: f64 = 180.0;

/// The measured over the predicted torque, on equal scales.
fn picture(axis: &Axis) -> String {
    let largest = axis.points.iter().flatten().filter(|x| x.is_finite()).fold(0.0f64, |most, x| most.max(x.abs()));
    let scale = 0.47 * SIDE / largest.max(f64::MIN_POSITIVE);
    let at = |[x, y]: [f64; 2]| (0.5 * SIDE + scale * x, 0.5 * SIDE - scale * y);
    let mut dots = String::new();
    for (x, y) in axis.points.iter().filter(|p| p.iter().all(|x| x.is_finite())).map(|p| at(*p)) {
        let _ = write!(dots, "M{x:.1} {y:.1}h0");
    }
    let title = escape(&axis.title);
    let range = escape(&format!("± {} {}", significant(largest, 2), axis.unit));
    format!(
        "<figure><svg viewBox=\"0 0 {SIDE} {SIDE}\" role=\"img\" aria-label=\"{title}: measured over predicted\">\
         <path class=\"frame\" d=\"M0 {half}H{SIDE}M{half} 0V{SIDE}M.5 .5H{edge}V{edge}H.5Z\"/>\
         <path class=\"same\" d=\"M0 {SIDE}L{SIDE} 0\"/><path class=\"dots\" d=\"{dots}\"/></svg>\
         <figcaption>{title}: measured over predicted, {range}</figcaption></figure>\n",
        half = 0.5 * SIDE,
        edge = SIDE - 0.5,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outcomes_have_words_and_signs_and_dots_their_places() {
        let mut report = Report::new("t", "");
        let axis = Axis {
            title: "axis 1 torque".into(),
            unit: "N·m".into(),
            slope: Some((-1.002, 0.003)),
            cells: vec![(Outcome::Failed, "torque sign".into()), (Outcome::Passed, "ok".into())],
            points: vec![[2.0, -2.0], [f64::NAN, 1.0]],
        };
        add(&mut report, &["sign", "factor"], &[axis]);
        let page = report.render();
        for text in ["-1.002 ± 0.003", "class=\"bad\"", "✗</i> torque sign", "✓</i> ok", "M174.6 174.6h0"] {
            assert!(page.contains(text), "{text}\n{page}");
        }
        assert!(!page.contains("NaN"));
    }
}
