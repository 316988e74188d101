//! Parameters with error bars beside their prior values, and how their estimates depend on each other.

use std::fmt::Write as _;

use deltatwin::dynamics::ParamTable;
use deltatwin::identification::Estimate;
use deltatwin::text::with_error;
use nalgebra::DMatrix;

use super::number;
use crate::html::{escape, wide};
use crate::{Cell, Color, Report, Role, matrix};

/// Parameters of a model at several stages.
pub struct Parameters<'a> {
    /// Those of the delivered model.
    pub prior: &'a ParamTable,
    /// Stage of the model, its name and estimates.
    pub stages: &'a [(Role, &'a str, &'a [Estimate])],
    /// Covariance of the last stage's estimates, in natural units.
    pub covariance: &'a DMatrix<f64>,
}

/// Adds a table of all identified parameters: the value of the delivered model, the estimates of every stage with their
/// standard errors, and these as intervals on a common axis per parameter; and the correlation of the last estimates.
pub fn add(report: &mut Report, parameters: &Parameters) {
    let Parameters { prior, stages, covariance } = parameters;
    let Some((_, last_name, last)) = stages.last() else { return };
    let values = prior.values();
    let key = |(role, name, _): &(Role, &str, &[Estimate])| {
        format!("<span><i class=\"{}\"></i>{} ± 2 std</span>", role.class(), escape(name))
    };
    let keys: String = stages.iter().map(key).collect();
    report.push(format!("<p class=\"keys\">{keys}<span><i class=\"dashed\"></i>model</span></p>"));
    let mut html = wide("parameters") + "<table class=\"parameters cards\"><thead><tr><th>parameter</th>";
    for (_, name, _) in *stages {
        let _ = write!(html, "<th class=\"n\">{}</th>", escape(name));
    }
    html.push_str("<th class=\"n\">model</th><th>unit</th><th>± 2 std, dashed: model</th></tr></thead><tbody>\n");
    for p in last.iter().filter(|p| p.identified()) {
        let own = prior.index(p.param).map(|i| values[i]);
        let of = |estimates: &&[Estimate]| estimates.iter().find(|e| e.param == p.param && e.identified()).cloned();
        let all: Vec<(Role, Option<Estimate>)> =
            stages.iter().map(|(role, _, estimates)| (*role, of(estimates))).collect();
        let (effect, name) = p.name.split_once('.').unwrap_or(("", &p.name));
        let _ =
            write!(html, "<tr><th scope=\"row\"><small>{}</small> <code>{}</code></th>", broken(effect), broken(name));
        for ((_, stage, _), (_, estimate)) in stages.iter().zip(&all) {
            let text = estimate.as_ref().map_or("–".into(), text);
            let _ = write!(html, "<td class=\"n\" data-label=\"{}\">{text}</td>", escape(stage));
        }
        let _ = writeln!(
            html,
            "<td class=\"n\" data-label=\"model\">{}</td><td class=\"unit\" data-label=\"unit\">{}</td><td data-label=\"± 2 std\">{}</td></tr>",
            own.map_or("–".into(), number),
            escape(&p.unit.to_string()),
            intervals(own, &all),
        );
    }
    html.push_str("</tbody></table></div>");
    report.push(html);
    let not = last.iter().filter(|p| !p.identified()).count();
    if not > 0 {
        report.paragraph(&format!(
            "{not} more parameters are not determined individually and keep the values of the model."
        ));
    }
    correlation(report, last_name, last, covariance);
}

/// A name that may be broken after its underscores.
fn broken(name: &str) -> String {
    escape(name).replace('_', "_<wbr>")
}

/// An estimate with its standard error, or the end of its range at which it lies; without its unit.
pub fn text(estimate: &Estimate) -> String {
    match estimate.bound() {
        Some(bound) => format!("at its bound {}", number(bound)),
        None => with_error(estimate.value, estimate.std),
    }
}

/// Correlation from which two estimates are worth a look, and most parameters in the picture.
const CORRELATED: f64 = 0.5;
const MOST: usize = 20;
/// Colours of positive and negative correlations.
const ALIKE: Color = Color::SKY;
const OPPOSED: Color = Color::OCHRE;

/// Adds the correlations of the `estimates` of a `stage` that are at least [`CORRELATED`] with another one.
fn correlation(report: &mut Report, stage: &str, estimates: &[Estimate], covariance: &DMatrix<f64>) {
    let known: Vec<usize> =
        (0..estimates.len().min(covariance.nrows())).filter(|&i| estimates[i].identified()).collect();
    let of = |i: usize, j: usize| covariance[(i, j)] / (covariance[(i, i)] * covariance[(j, j)]).sqrt();
    let largest = |i: usize| known.iter().filter(|j| **j != i).map(|&j| of(i, j).abs()).fold(0.0, f64::max);
    let mut shown: Vec<usize> = known.iter().copied().filter(|&i| largest(i) >= CORRELATED).collect();
    if shown.is_empty() {
        if known.len() > 1 {
            report.paragraph(&format!("No two of these estimates are correlated by {CORRELATED} or more."));
        }
        return;
    }
    shown.sort_by(|a, b| largest(*b).total_cmp(&largest(*a)));
    shown.truncate(MOST);
    shown.sort_unstable();
    let names: Vec<String> = shown.iter().map(|&i| short(&estimates[i].name)).collect();
    let cell = |i: usize, j: usize| {
        let r = of(i, j);
        let text = if i == j { "1".into() } else { format!("{:.2}", (100.0 * r).round() / 100.0 + 0.0) };
        Cell { share: if i == j { 0.0 } else { r.abs() }, text, color: if r > 0.0 { ALIKE } else { OPPOSED } }
    };
    let cells: Vec<Vec<Cell>> = shown.iter().map(|&i| shown.iter().map(|&j| cell(i, j)).collect()).collect();
    let caption = format!(
        "The errors of two estimates with a correlation near 1 or −1 compensate each other. Shown are {} of {} estimates of \
         “{stage}”, those with {CORRELATED} or more; blue: positive, amber: negative.",
        shown.len(),
        known.len()
    );
    report.figure(&matrix("Correlation of the parameters", &names, &names, &cells), &caption);
}

/// The name of a parameter without the group of the links.
fn short(name: &str) -> String {
    name.strip_prefix("rigid_bodies.").unwrap_or(name).into()
}

/// Width and height of a drawing, in pixels.
const SIZE: (f64, f64) = (150.0, 22.0);

/// The prior value as a tick and the estimates as intervals of two standard errors, as an SVG element.
fn intervals(prior: Option<f64>, stages: &[(Role, Option<Estimate>)]) -> String {
    let (width, height) = SIZE;
    // The standard error at a bound is none of the value there.
    let reach = |e: &Estimate| if e.bound().is_some() { 0.0 } else { 2.0 * e.std };
    let ends = stages.iter().filter_map(|(_, e)| e.as_ref()).flat_map(|e| [e.value - reach(e), e.value + reach(e)]);
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
    for (s, (role, estimate)) in stages.iter().enumerate() {
        let Some(e) = estimate else { continue };
        let y = height * (s as f64 + 1.0) / (n as f64 + 1.0);
        let class = role.class();
        let (a, b, x) = (at(e.value - reach(e)), at(e.value + reach(e)), at(e.value));
        let _ = write!(
            svg,
            "<g class=\"{class}\"><line x1=\"{a:.1}\" x2=\"{b:.1}\" y1=\"{y:.1}\" y2=\"{y:.1}\"/><circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"2.6\"/></g>"
        );
    }
    svg + "</svg>"
}

#[cfg(test)]
mod tests {
    use super::*;
    use deltatwin::effects::Param;
    use deltatwin::machine::Unit;

    fn estimates(values: &[(f64, f64)]) -> Vec<Estimate> {
        let one = |(item, &(value, std)): (usize, &(f64, f64))| Estimate {
            param: Param { effect: "drive_friction", block: 0, item },
            name: format!("drive_friction.coulomb_{}", item + 1),
            unit: Unit::NM,
            value,
            std,
            range: (0.0, 100.0),
        };
        values.iter().enumerate().map(one).collect()
    }

    fn page(values: &[(f64, f64)], covariance: &DMatrix<f64>) -> String {
        let mut report = Report::new("t", "");
        let own = estimates(values);
        add(
            &mut report,
            &Parameters {
                prior: &ParamTable::default(),
                stages: &[(Role::Identified, "identified", &own)],
                covariance,
            },
        );
        report.render()
    }

    #[test]
    fn a_value_at_a_bound_says_so_and_correlations_are_drawn_with_their_sign() {
        // Standard errors 0.1, 0.2, 0.39 and ∞; correlation of the first two −0.9, else 0.3.
        let std = [0.1, 0.2, 0.39, 50.0];
        let r = |i: usize, j: usize| {
            if i == j {
                1.0
            } else if i + j == 1 {
                -0.9
            } else {
                0.3
            }
        };
        let covariance = DMatrix::from_fn(4, 4, |i, j| r(i, j) * std[i] * std[j]);
        let text = page(&[(4.0, 0.1), (5.0, 0.2), (2.6e-14, 0.39), (1.0, f64::INFINITY)], &covariance);
        for part in ["4.00 ± 0.10", "at its bound 0", "-0.90", "2 of 3 estimates", "1 more parameters"] {
            assert!(text.contains(part), "{part}\n{text}");
        }
        assert!(!text.contains("2.6e-14") && !text.contains("0.30"));
        let none = page(&[(4.0, 0.1), (5.0, 0.2)], &DMatrix::identity(2, 2));
        assert!(none.contains("No two of these estimates") && !none.contains("Correlation of the parameters"));
    }
}
