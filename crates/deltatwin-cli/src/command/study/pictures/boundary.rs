//! What can be carried: the boundary found along rays.

use deltatwin_io::study::{Design, Factor, Range};
use deltatwin_report::figure::study::{PayloadDiagram, PayloadPanel, payload_diagram};
use deltatwin_study::statistics::quantile;

use super::{Picture, Shown, label};

/// Share of the machines that keep the middle contour.
const LIKELY: f64 = 0.95;
/// Largest number of panels.
const MOST: usize = 9;

/// The boundary over picks per minute, over the factor with most levels, or between two factors.
pub fn diagrams(shown: &Shown) -> (Vec<Picture>, String) {
    let study = &shown.conduct.study;
    let Design::Boundary { along, rays, repeats, .. } = &study.design else { return (Vec::new(), String::new()) };
    let beside: Vec<&Factor> = study
        .factors
        .iter()
        .enumerate()
        .filter(|(k, f)| !along.contains(k) && matches!(&f.range, Range::Levels(all) if all.len() > 1))
        .map(|(_, f)| f)
        .collect();
    match along[..] {
        [up] if !beside.is_empty() => over_levels(shown, &study.factors[up], &beside, *repeats as usize),
        [right, up] => between(shown, [&study.factors[right], &study.factors[up]], (*rays as usize, *repeats as usize)),
        _ => (Vec::new(), String::new()),
    }
}

/// Value of a factor along a ray where the margin is zero: the row has the failing run next to it.
fn limit(factor: &Factor, (value, reach, high): (f64, f64, f64)) -> f64 {
    let Range::Interval { from, .. } = factor.range else { return f64::NAN };
    if high > 0.0 { from + (value - from) * reach / high } else { value }
}

/// Values of a factor at the boundary, one per row.
fn limits(shown: &Shown, factor: &Factor) -> Vec<f64> {
    let (values, reach, high) = (shown.numbers(&factor.name), shown.numbers("reach"), shown.numbers("reach_high"));
    (0..values.len()).map(|row| limit(factor, (values[row], reach[row], high[row]))).collect()
}

fn over_levels(shown: &Shown, up: &Factor, beside: &[&Factor], repeats: usize) -> (Vec<Picture>, String) {
    let levels = |f: &&Factor| match &f.range {
        Range::Levels(all) => all.len(),
        _ => 0,
    };
    let numeric = beside.iter().filter(|f| shown.numeric().iter().any(|n| n.name == f.name));
    let Some(across) = numeric.max_by_key(|f| levels(f)) else { return (Vec::new(), String::new()) };
    let rates = shown.numbers("picks_per_minute");
    let own = shown.numbers(&across.name);
    // Speed is better known by what it gives.
    let is_speed = across.keys.iter().any(|key| key.contains("speed")) && rates.iter().all(|r| r.is_finite());
    let (xs, x_label) = if is_speed { (rates, "picks per minute".to_string()) } else { (own, label(across)) };
    let ys = limits(shown, up);
    let others: Vec<&&Factor> = beside.iter().filter(|f| f.name != across.name).collect();
    let name = |row: usize| -> String {
        let text = |f: &&&Factor| {
            let (number, text) = (shown.numbers(&f.name)[row], shown.texts(&f.name));
            let value = if number.is_nan() { text[row].to_string() } else { number.to_string() };
            format!("{} = {value}", f.name.replace('_', " "))
        };
        others.iter().map(text).collect::<Vec<_>>().join(", ")
    };
    let mut panels: Vec<(String, Vec<usize>)> = Vec::new();
    for row in (0..ys.len()).step_by(repeats) {
        let key = name(row);
        match panels.iter_mut().find(|(panel, _)| *panel == key) {
            Some((_, rows)) => rows.push(row),
            None => panels.push((key, vec![row])),
        }
    }
    let panel = |(name, rows): &(String, Vec<usize>)| {
        let mut rows = rows.clone();
        rows.sort_by(|a, b| xs[*a].total_cmp(&xs[*b]));
        let contour = |of: &dyn Fn(&[f64]) -> Option<f64>| -> Vec<(f64, f64)> {
            let at = |row: &usize| {
                let drawn: Vec<f64> = ys[*row..*row + repeats].iter().copied().filter(|y| y.is_finite()).collect();
                of(&drawn).map(|y| (xs[*row], y))
            };
            rows.iter().filter_map(at).collect()
        };
        let spread = repeats > 1;
        PayloadPanel {
            name: name.clone(),
            nominal: rows.iter().map(|row| (xs[*row], ys[*row])).filter(|p| p.1.is_finite()).collect(),
            likely: if spread { contour(&|all| quantile(all, 1.0 - LIKELY)) } else { Vec::new() },
            worst: if spread { contour(&|all| all.iter().copied().reduce(f64::min)) } else { Vec::new() },
        }
    };
    let diagram = PayloadDiagram {
        title: format!("Largest {}", label(up)),
        x_label,
        y_label: format!("largest {}", label(up)),
        panels: panels.iter().take(MOST).map(panel).collect(),
        reference: None,
    };
    let caption = match repeats {
        1 => "Largest value at which nothing fails, on the nominal machine.".to_string(),
        n => format!(
            "Largest value at which nothing fails: on the nominal machine, on 95 % of {n} drawn machines, and on the worst \
             of them."
        ),
    };
    let picture = Picture { name: "payload".into(), figure: payload_diagram(&diagram), caption };
    (vec![picture], String::new())
}

fn between(shown: &Shown, [right, up]: [&Factor; 2], (rays, repeats): (usize, usize)) -> (Vec<Picture>, String) {
    let (xs, ys) = (limits(shown, right), limits(shown, up));
    let count = xs.len() / rays;
    let curve = |draw: usize| -> Vec<(f64, f64)> {
        let mut points: Vec<(f64, f64)> = (draw * rays..(draw + 1) * rays).map(|row| (xs[row], ys[row])).collect();
        points.retain(|p| p.0.is_finite() && p.1.is_finite());
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points
    };
    // Along each ray, the quantile of the reach over the draws.
    let reach = shown.numbers("reach");
    let contour = |first: usize, of: &dyn Fn(&[f64]) -> Option<f64>| -> Vec<(f64, f64)> {
        let mut points: Vec<(f64, f64)> = (0..rays)
            .filter_map(|ray| {
                let nominal = first * rays + ray;
                let all: Vec<f64> =
                    (0..repeats).map(|k| reach[(first + k) * rays + ray]).filter(|r| r.is_finite()).collect();
                let share = of(&all)? / reach[nominal];
                let scaled = |factor: &Factor, value: f64| match factor.range {
                    Range::Interval { from, .. } => from + (value - from) * share,
                    _ => value,
                };
                Some((scaled(right, xs[nominal]), scaled(up, ys[nominal])))
                    .filter(|p| p.0.is_finite() && p.1.is_finite())
            })
            .collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points
    };
    let panel = |first: usize| PayloadPanel {
        name: if count == repeats { String::new() } else { format!("combination {}", first / repeats + 1) },
        nominal: curve(first),
        likely: if repeats > 1 { contour(first, &|all| quantile(all, 1.0 - LIKELY)) } else { Vec::new() },
        worst: if repeats > 1 { contour(first, &|all| all.iter().copied().reduce(f64::min)) } else { Vec::new() },
    };
    let diagram = PayloadDiagram {
        title: "What can be carried".into(),
        x_label: label(right),
        y_label: label(up),
        panels: (0..count).step_by(repeats).take(MOST).map(panel).collect(),
        reference: None,
    };
    let caption = "Below the line nothing fails; each of its points was found along a ray.".into();
    (vec![Picture { name: "payload".into(), figure: payload_diagram(&diagram), caption }], String::new())
}
