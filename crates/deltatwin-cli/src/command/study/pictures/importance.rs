//! What matters: one factor at a time, beside Sobol' indices.

use deltatwin_io::study::Design;
use deltatwin_report::figure::study::{Estimate, Importance, importance};
use deltatwin_study::statistics::{Index, SobolError, SobolIndices, sobol_indices};

use super::{Picture, Shown};
use deltatwin::text::significant;

/// Resamples for the intervals of the indices.
const RESAMPLES: usize = 1000;

/// Sobol' indices of the least margin of a sensitivity study; `None` of another one.
pub fn indices(shown: &Shown) -> Option<Result<SobolIndices, SobolError>> {
    let study = &shown.conduct.study;
    let d = study.factors.len();
    let margins = shown.numbers(&shown.margin);
    let samples = margins.get(1 + 2 * d..).filter(|_| matches!(study.design, Design::Sensitivity { .. }))?;
    Some(sobol_indices(samples, d, RESAMPLES, study.seed))
}

/// Swings of the least margin and its Sobol' indices, of a sensitivity study.
pub fn figures(shown: &Shown) -> Vec<Picture> {
    let conduct = shown.conduct;
    let study = &conduct.study;
    let Some(indices) = indices(shown) else { return Vec::new() };
    let d = study.factors.len();
    let single = shown.numbers(&shown.margin);
    let estimate = |index: &Index| Estimate { value: index.value, low: index.interval[0], high: index.interval[1] };
    let row = |k: usize| {
        let factor = &study.factors[k];
        let end = |run: u64| conduct.columns.text(factor, conduct.plan.point(run).settings[k]);
        let short = |text: String| text.parse::<f64>().map_or(text, |x| significant(x, 3));
        let [low, high] = [end(1 + 2 * k as u64), end(2 + 2 * k as u64)].map(short);
        let unit = if matches!(factor.unit.as_str(), "" | "1") { "" } else { factor.unit.as_str() };
        Importance {
            name: factor.name.replace('_', " "),
            span: format!("{low} to {high} {unit}").trim_end().into(),
            swing: Some([single[1 + 2 * k], single[2 + 2 * k]]).filter(|s| s.iter().all(|x| x.is_finite())),
            first: indices.as_ref().ok().map(|i| estimate(&i.first[k])),
            total: indices.as_ref().ok().map(|i| estimate(&i.total[k])),
        }
    };
    let rows: Vec<Importance> = (0..d).map(row).collect();
    let why = indices.as_ref().err().map_or(String::new(), |e| format!(" No indices: {e}."));
    let caption = format!(
        "Left: the least margin with one factor at its low and at its high value (5 % and 95 % of a distribution), all others \
         nominal. Right: shares of the margin's variance, alone (first order) and with all interactions (total), with 95 % \
         bootstrap intervals.{why}"
    );
    let what = match shown.margin.split_once('_') {
        Some((_, cause)) => format!("least margin against {cause}"),
        None => "least margin".into(),
    };
    let figure = importance("What the margin depends on", &what, Some(single[0]), &rows);
    vec![Picture { name: "importance".into(), figure, caption }]
}
