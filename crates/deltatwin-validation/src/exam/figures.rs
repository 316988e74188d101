//! Figures of an exam.

use super::score::{EXPLAINED, IN_A_SET, Judged, Rate, Score};
use super::size::Size;
use super::{Grade, judge::Question};
use deltatwin_report::{Cell, Color, Curve, Figure, Style, matrix, rates, time_series};

/// All figures with their file names.
pub fn all(score: &Score, judged: &[Judged]) -> Vec<(&'static str, Figure)> {
    vec![
        ("confusion", confusion(score)),
        ("effects", effects(score)),
        ("power", power(judged)),
        ("reliability", reliability(score)),
        ("held-out", held_out(score)),
        ("z", z(score)),
    ]
}

fn confusion(score: &Score) -> Figure {
    let good = |row: &str, column: &str| {
        row == column
            || column == IN_A_SET
            || (row == "nothing" && column == "none")
            || (row.starts_with("outside") && column == "unknown")
    };
    let cells: Vec<Vec<Cell>> = score
        .rows
        .iter()
        .zip(&score.counts)
        .map(|(row, counts)| {
            let total = counts.iter().sum::<usize>().max(1);
            let cell = |(column, n): (&String, &usize)| Cell {
                share: *n as f64 / total as f64,
                text: if *n > 0 { n.to_string() } else { String::new() },
                color: color(good(row, column)),
            };
            score.columns.iter().zip(counts).map(cell).collect()
        })
        .collect();
    matrix("Hidden (rows) and named first (columns), campaigns", &score.rows, &score.columns, &cells)
}

/// Colour of a correct or a wrong answer.
fn color(good: bool) -> Color {
    if good { Color::GOOD } else { Color::BAD }
}

/// Correct answers by effect and size.
fn effects(score: &Score) -> Figure {
    let mut sizes: Vec<String> = Size::ALL.iter().map(|s| s.name().to_string()).collect();
    sizes.extend(["limited".to_string(), "unknown size".to_string()]);
    sizes.retain(|s| score.by_effect.values().any(|m| m.contains_key(s)));
    let rows: Vec<String> = score.by_effect.keys().cloned().collect();
    let cell = |rate: Option<&Rate>| {
        let share = rate.and_then(|r| r.share());
        let text = rate.map_or_else(String::new, |r| format!("{}/{}", r.count, r.of));
        Cell { share: share.map_or(0.0, |s| s.max(1.0 - s)), text, color: color(share.is_some_and(|s| s >= 0.5)) }
    };
    let cells: Vec<Vec<Cell>> =
        score.by_effect.values().map(|m| sizes.iter().map(|s| cell(m.get(s))).collect()).collect();
    matrix("Right answers by effect and size", &rows, &sizes, &cells)
}

/// Correct answers over the residual of the effect after a refit.
fn power(judged: &[Judged]) -> Figure {
    let mut known: Vec<(f64, bool)> = judged
        .iter()
        .filter(|j| j.question == Question::One)
        .filter_map(|j| Some((j.truth.rise?, j.grade == Grade::Right)))
        .map(|(rise, right)| ((rise * rise - 1.0).max(0.0).sqrt(), right))
        .collect();
    known.sort_by(|a, b| a.0.total_cmp(&b.0));
    const GROUPS: usize = 8;
    const MIN_OF_GROUP: usize = 10;
    let points: Vec<deltatwin_report::Rate> = known
        .chunks(known.len().div_ceil(GROUPS).max(MIN_OF_GROUP))
        .map(|group| {
            let x = group.iter().map(|(x, _)| x.max(1e-3).ln()).sum::<f64>() / group.len() as f64;
            point(x.exp(), Rate::of(group, |(_, right)| *right))
        })
        .collect();
    rates(
        "Right answers over the size of the effect",
        "RMS of what a refit leaves of the effect, over the noise (geometric mean of the group)",
        "share right",
        &points,
        false,
    )
}

fn point(x: f64, rate: Rate) -> deltatwin_report::Rate {
    let [low, high] = rate.interval();
    deltatwin_report::Rate { x, share: rate.share().unwrap_or(0.0), low, high, of: rate.of }
}

fn reliability(score: &Score) -> Figure {
    let points: Vec<deltatwin_report::Rate> = score.reliability.iter().map(|r| point(r.claimed, r.right)).collect();
    rates(
        "Reliability of the effect named first",
        "claimed probability",
        "share right, 95 % interval, number of campaigns",
        &points,
        true,
    )
}

/// Cumulative distribution of the values.
fn cumulative(label: &str, mut x: Vec<f64>) -> Curve {
    x.sort_by(f64::total_cmp);
    let n = x.len().max(1) as f64;
    let (mut xs, mut ys) = (Vec::new(), Vec::new());
    for (k, v) in x.into_iter().enumerate() {
        xs.extend([v, v]);
        ys.extend([k as f64 / n, (k + 1) as f64 / n]);
    }
    Curve::new(label, xs, ys).color(Color::BLUE)
}

fn held_out(score: &Score) -> Figure {
    // Relative to the best attainable, so that one bound applies to all.
    let ratios = score.held_out.iter().map(|(_, r, bound)| r * EXPLAINED / bound).collect();
    let bound =
        Curve::new("bound", vec![EXPLAINED, EXPLAINED], vec![0.0, 1.0]).color(Color::MUTED).style(Style::Dashed);
    time_series(
        "Residual on the other motion once the right effect is added",
        "largest held-out RMS residual over the noise, or over what the robot's own model leaves",
        "share of campaigns",
        &[cumulative("right answers", ratios), bound],
    )
}

fn z(score: &Score) -> Figure {
    use statrs::distribution::{ContinuousCDF, Normal};
    const SHOWN: f64 = 6.0;
    let normal = Normal::standard();
    let x: Vec<f64> = (0..=120).map(|k| SHOWN * f64::from(k) / 120.0).collect();
    let y = x.iter().map(|x| 2.0 * normal.cdf(*x) - 1.0).collect();
    let expected = Curve::new("normal", x, y).color(Color::MUTED).style(Style::Dashed);
    let errors = score.z.iter().map(|z| z.abs().min(SHOWN)).collect();
    time_series(
        "Error of the hidden parameters in standard errors",
        "|estimate − truth| over standard error (6 and more at 6)",
        "share of parameters",
        &[cumulative("parameters of effects named rightly", errors), expected],
    )
}
