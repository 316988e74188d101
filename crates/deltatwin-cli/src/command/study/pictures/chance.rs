//! Probability of failure over a factor.

use deltatwin_io::study::{Design, Factor, Range};
use deltatwin_report::figure::Rate;
use deltatwin_report::figure::study::{Banded, ProbabilityCurve, fragility};
use deltatwin_study::statistics::{Trial, equal_groups, fit_lognormal, wilson};

use super::{CONFIDENCE, Picture, Shown, label};

/// Number of groups of neighbouring values of a factor without levels.
const GROUPS: usize = 12;
/// Points of a fitted curve.
const POINTS: usize = 101;
/// Least number of outcomes of a curve.
const LEAST: usize = 20;

/// The probability of failure over the factor that the study names, or else the one that the failures follow most.
pub fn curves(shown: &Shown) -> Vec<Picture> {
    let study = &shown.conduct.study;
    let is_random = match study.design {
        Design::Grid { repeats } => repeats > 1,
        Design::LatinHypercube { .. } | Design::Sobol { .. } | Design::MonteCarlo { .. } => true,
        _ => false,
    };
    if !is_random {
        return Vec::new();
    }
    let failed = shown.failed();
    let of = |factor: &Factor| -> Vec<(f64, bool)> {
        let values = shown.numbers(&factor.name);
        let pairs = values.into_iter().zip(&failed).filter_map(|(x, failed)| Some((x, (*failed)?)));
        pairs.filter(|(x, _)| x.is_finite()).collect()
    };
    let stated = study.over.map(|k| &study.factors[k]);
    let guessed = || {
        let strength = |factor: &&Factor| followed(&of(factor)).abs();
        shown.numeric().into_iter().max_by(|a, b| strength(a).total_cmp(&strength(b)))
    };
    let Some(factor) = stated.or_else(guessed) else { return Vec::new() };
    let outcomes = of(factor);
    if outcomes.len() < LEAST || outcomes.iter().all(|(_, failed)| *failed == outcomes[0].1) {
        return Vec::new();
    }
    let why = match stated {
        Some(_) => String::new(),
        None => format!(" Failures follow {} most; `over` in the study chooses another factor.", factor.name),
    };
    let (curve, fitted) = curve(factor, &outcomes);
    let caption = format!("Shares of runs that fail, with 95 % intervals (Wilson){fitted}.{why}");
    let figure = fragility(&format!("Failures over {}", factor.name.replace('_', " ")), &label(factor), &[curve]);
    vec![Picture { name: "fragility".into(), figure, caption }]
}

fn curve(factor: &Factor, outcomes: &[(f64, bool)]) -> (ProbabilityCurve, &'static str) {
    let groups = match &factor.range {
        Range::Levels(all) => all.len(),
        _ => GROUPS,
    };
    let trials = equal_groups(outcomes, groups);
    let point = |t: &Trial| {
        let [low, high] = wilson(t.failures, t.of, CONFIDENCE);
        Rate { x: t.demand, share: t.failures as f64 / t.of as f64, low, high, of: t.of }
    };
    let single: Vec<Trial> =
        outcomes.iter().map(|(x, failed)| Trial { demand: *x, failures: usize::from(*failed), of: 1 }).collect();
    let mut curve = ProbabilityCurve { points: trials.iter().map(point).collect(), ..ProbabilityCurve::default() };
    // A demand of zero or below has no lognormal fit, and a wear at which nothing fails none either.
    let Ok(fit) = fit_lognormal(&single) else { return (curve, "; no lognormal curve fits them") };
    let (low, high) = outcomes.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), (x, _)| (a.min(*x), b.max(*x)));
    curve.fit = (0..POINTS)
        .map(|k| low + (high - low) * k as f64 / (POINTS - 1) as f64)
        .filter(|x| *x > 0.0)
        .map(|x| {
            let [value, low, high] = fit.band(x, CONFIDENCE);
            Banded { x, value, low, high }
        })
        .collect();
    curve.mark = Some(fit.demand(0.5, CONFIDENCE)).filter(|mark| (low..=high).contains(&mark[0]));
    (curve, "; line: lognormal curve of greatest likelihood, with its 95 % band")
}

/// Correlation of the ranks of a factor's values with failing.
fn followed(outcomes: &[(f64, bool)]) -> f64 {
    let n = outcomes.len() as f64;
    let mut order: Vec<usize> = (0..outcomes.len()).collect();
    order.sort_by(|a, b| outcomes[*a].0.total_cmp(&outcomes[*b].0));
    // Equal values share their mean rank.
    let mut ranks = vec![0.0; outcomes.len()];
    let mut start = 0;
    while start < order.len() {
        let same = order[start..].iter().take_while(|k| outcomes[**k].0 == outcomes[order[start]].0).count();
        for k in &order[start..start + same] {
            ranks[*k] = start as f64 + 0.5 * (same - 1) as f64;
        }
        start += same;
    }
    let share = outcomes.iter().filter(|(_, failed)| *failed).count() as f64 / n;
    let (mut product, mut square) = (0.0, 0.0);
    for (rank, (_, failed)) in ranks.iter().zip(outcomes) {
        let centred = rank - 0.5 * (n - 1.0);
        product += centred * (f64::from(u8::from(*failed)) - share);
        square += centred * centred;
    }
    let spread = (square * n * share * (1.0 - share)).sqrt();
    if spread > 0.0 { product / spread } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn failures_are_followed_by_ranks() {
        let rising: Vec<(f64, bool)> = (0..40).map(|k| (f64::from(k).exp(), k >= 20)).collect();
        // Of two halves that do not overlap the correlation is √3/2, up to 1/n².
        assert!((followed(&rising) - 0.75f64.sqrt()).abs() < 1e-3, "{}", followed(&rising));
        let falling: Vec<(f64, bool)> = rising.iter().map(|(x, failed)| (-x, *failed)).collect();
        assert!((followed(&falling) + followed(&rising)).abs() < 1e-12);
        assert_eq!(followed(&[(1.0, true), (1.0, false)]), 0.0);
        assert_eq!(followed(&[(1.0, true), (2.0, true)]), 0.0);
    }
}
