//! The estimate by hand beside the twin.

use super::super::axis::{Axis, range};
use super::super::color::{Color, TEXT};
use super::super::curve::Style;
use super::super::framed::framed;
use super::super::legend::{Entry, Swatch};
use super::super::{Figure, MAX_DOTS};
use super::usable;

/// One run, estimated by hand and simulated.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// Estimate by hand.
    pub hand: f64,
    /// Result of the twin, in the same unit.
    pub twin: f64,
    /// Main reason of the difference, a few words; empty within 10 %.
    pub reason: String,
}

/// Difference, relative to the estimate, within which both are said to agree.
const AGREES: f64 = 0.1;
/// Largest number of reasons with a colour of their own.
const REASONS: usize = 6;

/// The twin over the estimate by hand; runs that differ by more than 10 % are coloured by the reason.
///
/// `quantity` names both axes, such as `largest strut force / N`.
pub fn hand_formula(title: &str, quantity: &str, runs: &[Comparison]) -> Figure {
    let runs: Vec<&Comparison> = runs.iter().filter(|r| usable(r.hand) && usable(r.twin)).collect();
    let agrees = |r: &Comparison| (r.twin - r.hand).abs() <= AGREES * r.hand.abs();
    let (inside, outside): (Vec<&Comparison>, Vec<&Comparison>) = runs.iter().partition(|r| agrees(r));
    let reasons = reasons(&outside);
    let mut entries: Vec<Entry> = Vec::new();
    if !runs.is_empty() {
        entries.push(("equal ± 10 %".into(), Color::MUTED, Swatch::Band));
        let text = format!("within 10 %: {} of {}", inside.len(), runs.len());
        entries.push((text, Color::MUTED, Swatch::Curve(Style::Points)));
    }
    for (k, (reason, count)) in reasons.iter().enumerate() {
        let reason = if reason.is_empty() { "no reason given" } else { reason };
        entries.push((format!("{reason}: {count}"), color(k), Swatch::Curve(Style::Points)));
    }
    let pad = |(lo, hi): (f64, f64)| Axis::linear((lo.min(0.0), 1.05 * hi.max(0.0)), 0.0, 8);
    let x = range(runs.iter().map(|r| r.hand)).map(pad);
    let y = range(runs.iter().map(|r| r.twin)).map(pad);
    let labels = (format!("by hand: {quantity}"), format!("twin: {quantity}"));
    framed(title, &entries, 0.0, (x, &labels.0), (y, &labels.1), |c, r, x, y| {
        let at = |vx: f64, vy: f64| Some((r.x(x, vx)?, r.y(y, vy)?));
        let wedge: Vec<(f64, f64)> = band(x, y).into_iter().filter_map(|p| at(p.0, p.1)).collect();
        c.polygon(&wedge, Color::MUTED, 0.25);
        let end = x.hi.min(y.hi);
        if let (Some(a), Some(b)) = (at(x.lo.max(y.lo), x.lo.max(y.lo)), at(end, end)) {
            c.dashed(&[a, b], TEXT, 1.0);
        }
        let every = runs.len().div_ceil(MAX_DOTS).max(1);
        let size = if runs.len() <= 100 { 3.5 } else { 2.2 };
        for run in inside.iter().step_by(every) {
            at(run.hand, run.twin).into_iter().for_each(|p| c.dot(p, size, Color::MUTED, 0.9));
        }
        for run in outside.iter().step_by(every) {
            let k = reasons.iter().position(|(reason, _)| *reason == run.reason).unwrap_or(reasons.len() - 1);
            at(run.hand, run.twin).into_iter().for_each(|p| c.dot(p, size, color(k), 0.9));
        }
    })
}

fn color(k: usize) -> Color {
    Color::CYCLE[(k + 1) % Color::CYCLE.len()]
}

/// Reasons with their numbers of runs, the most frequent first; those beyond the palette are the last, `other`.
fn reasons(outside: &[&Comparison]) -> Vec<(String, usize)> {
    let mut all: Vec<&str> = outside.iter().map(|r| r.reason.as_str()).collect();
    all.sort_unstable();
    let mut counted: Vec<(String, usize)> =
        all.chunk_by(|a, b| a == b).map(|same| (same[0].to_owned(), same.len())).collect();
    counted.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    if counted.len() > REASONS {
        let rest = counted.split_off(REASONS - 1).iter().map(|(_, n)| n).sum();
        counted.push(("other reasons".into(), rest));
    }
    counted
}

/// Outline of the wedge within 10 % of the diagonal, inside the axes.
fn band(x: &Axis, y: &Axis) -> Vec<(f64, f64)> {
    let start = x.lo.max(0.0).max(y.lo.max(0.0));
    let upper = (y.hi / (1.0 + AGREES)).min(x.hi);
    let lower = (y.hi / (1.0 - AGREES)).min(x.hi);
    let low = |v: f64| (v, (1.0 - AGREES) * v);
    let mut outline = vec![(start, (1.0 + AGREES) * start), (upper, (1.0 + AGREES) * upper)];
    if upper < x.hi {
        // The corner above the upper line, or the end of the plot.
        outline.push((lower, if lower < x.hi { y.hi } else { y.hi.min((1.0 + AGREES) * x.hi) }));
    }
    outline.extend([low(lower), low(start)]);
    outline
}
