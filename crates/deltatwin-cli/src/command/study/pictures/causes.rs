//! Maps of the limiting cause over two factors of a grid.

use deltatwin_io::study::{Design, Factor, Range};
use deltatwin_report::figure::study::{CauseMap, CausePoint, cause_map};
use deltatwin_report::figure::{Curve, Style};

use super::{Picture, Shown, label};

/// Largest number of maps, one per combination of the other factors.
const MOST: usize = 6;

/// One map per combination of the other factors' levels, of the runs with all other factors at their medians.
pub fn maps(shown: &Shown) -> Vec<Picture> {
    let study = &shown.conduct.study;
    let repeats = match study.design {
        Design::Grid { repeats } => repeats as usize,
        Design::LatinHypercube { .. } | Design::Sobol { .. } | Design::MonteCarlo { .. }
            if study.factors.len() == 2 =>
        {
            1
        }
        _ => return Vec::new(),
    };
    let mut axes = shown.numeric();
    axes.sort_by_key(|factor| std::cmp::Reverse(count(factor)));
    let [x, y, ..] = axes[..] else { return Vec::new() };
    // The first in the file is the horizontal one.
    let place = |factor: &Factor| study.factors.iter().position(|f| f.name == factor.name);
    let (x, y) = if place(x) < place(y) { (x, y) } else { (y, x) };
    let others: Vec<&Factor> = study
        .factors
        .iter()
        .filter(|f| f.name != x.name && f.name != y.name && matches!(f.range, Range::Levels(_)) && count(f) > 1)
        .collect();
    let keys = combinations(shown, &others);
    let mut distinct: Vec<&String> = Vec::new();
    for key in keys.iter().step_by(repeats) {
        if !distinct.contains(&key) {
            distinct.push(key);
        }
    }
    let map = |(k, key): (usize, &&String)| {
        let rows: Vec<usize> = (0..keys.len()).step_by(repeats).filter(|row| keys[*row] == **key).collect();
        let name = if distinct.len() == 1 { "causes".into() } else { format!("causes-{}", k + 1) };
        let title = if key.is_empty() { "Limiting cause and margin".into() } else { (**key).clone() };
        picture(shown, (x, y), &rows, (name, title))
    };
    distinct.iter().enumerate().take(MOST).filter_map(map).collect()
}

fn count(factor: &Factor) -> usize {
    match &factor.range {
        Range::Levels(all) => all.len(),
        Range::Interval { .. } => usize::MAX,
        Range::Distributed(_) => 1,
    }
}

/// Values of `others` in every row, as text.
fn combinations(shown: &Shown, others: &[&Factor]) -> Vec<String> {
    let mut keys = vec![String::new(); shown.table.rows.len()];
    for factor in others {
        let (numbers, texts) = (shown.numbers(&factor.name), shown.texts(&factor.name));
        for (row, key) in keys.iter_mut().enumerate() {
            let value = if numbers[row].is_nan() { texts[row].to_string() } else { numbers[row].to_string() };
            let gap = if key.is_empty() { "" } else { ", " };
            let unit = if matches!(factor.unit.as_str(), "" | "1") { "" } else { factor.unit.as_str() };
            *key += format!("{gap}{} = {value} {unit}", factor.name.replace('_', " ")).trim_end();
        }
    }
    keys
}

fn picture(
    shown: &Shown,
    (x, y): (&Factor, &Factor),
    rows: &[usize],
    (name, title): (String, String),
) -> Option<Picture> {
    let (xs, ys, margins) = (shown.numbers(&x.name), shown.numbers(&y.name), shown.numbers("margin"));
    let all = shown.texts("cause");
    let mut causes: Vec<String> = Vec::new();
    let mut points = Vec::new();
    for &row in rows.iter().filter(|row| margins[**row].is_finite()) {
        let cause = causes.iter().position(|c| c == all[row]).unwrap_or_else(|| {
            causes.push(all[row].into());
            causes.len() - 1
        });
        points.push(CausePoint { x: xs[row], y: ys[row], margin: margins[row], cause });
    }
    if points.len() < 4 {
        return None;
    }
    let hand = hand_limit(shown, (&xs, &ys), rows);
    let curves = if hand.0.len() > 1 {
        vec![Curve { style: Style::Dashed, ..Curve::new("limit by hand", hand.0, hand.1) }]
    } else {
        Vec::new()
    };
    let map = CauseMap { title, x_label: label(x), y_label: label(y), points, causes, curves };
    let caption =
        "What fails, or comes closest to failing, with lines of equal margin: 1 unloaded, 0 at the limit. Dashed: \
                   where the estimate by hand has no margin left."
            .into();
    Some(Picture { name, figure: cause_map(&map), caption })
}

/// Where the margin of the estimate by hand is zero: along the columns of the grid or along its rows, whichever are
/// crossed more often.
fn hand_limit(shown: &Shown, (xs, ys): (&[f64], &[f64]), rows: &[usize]) -> (Vec<f64>, Vec<f64>) {
    let margins = shown.numbers("hand_margin");
    let known: Vec<usize> = rows.iter().copied().filter(|row| margins[*row].is_finite()).collect();
    let crossings = |fixed: &[f64], along: &[f64]| {
        let mut sorted = known.clone();
        sorted.sort_by(|a, b| fixed[*a].total_cmp(&fixed[*b]).then(along[*a].total_cmp(&along[*b])));
        let (mut at, mut limit) = (Vec::new(), Vec::new());
        for pair in sorted.windows(2) {
            let (a, b) = (pair[0], pair[1]);
            if fixed[a] == fixed[b] && (margins[a] >= 0.0) != (margins[b] >= 0.0) {
                at.push(fixed[a]);
                limit.push(along[a] + (along[b] - along[a]) * margins[a] / (margins[a] - margins[b]));
            }
        }
        (at, limit)
    };
    let (columns, across) = (crossings(xs, ys), crossings(ys, xs));
    if columns.0.len() >= across.0.len() { columns } else { (across.1, across.0) }
}
