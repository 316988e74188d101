//! The estimate by hand beside the twin.

use deltatwin::text::significant;
use deltatwin_report::figure::study::{Comparison, hand_formula};

use super::{Picture, Shown};

/// Difference that is explained, relative to the estimate.
const EXPLAINED: f64 = 0.1;
/// Number of runs whose difference is explained in words.
const EXAMPLES: usize = 4;

type Reasons = Option<(Vec<String>, Vec<Vec<String>>)>;

/// All runs with a payload, and the reasons of the difference in some of them.
pub fn comparison(shown: &Shown) -> (Vec<Picture>, Reasons) {
    let (hand, twin) = (shown.numbers("hand_force"), shown.numbers("strut_force"));
    let mut rows: Vec<usize> = (0..hand.len()).filter(|row| hand[*row] > 0.0 && twin[*row].is_finite()).collect();
    if rows.is_empty() {
        return (Vec::new(), None);
    }
    let excess = |row: usize| twin[row] / hand[row] - 1.0;
    let reason = |row: usize| match excess(row) {
        e if e.abs() <= EXPLAINED => String::new(),
        e if e > 0.0 => "the twin has more".into(),
        _ => "the twin has less".to_string(),
    };
    let runs: Vec<Comparison> =
        rows.iter().map(|row| Comparison { hand: hand[*row], twin: twin[*row], reason: reason(*row) }).collect();
    let figure = hand_formula("Largest strut force: by hand and on the twin", "largest strut force / N", &runs);
    let caption = "Each run once. Beyond 10 % the table says why, for some of them.".into();
    let picture = Picture { name: "hand".into(), figure, caption };
    rows.sort_by(|a, b| excess(*a).total_cmp(&excess(*b)));
    rows.retain(|row| excess(*row).abs() > EXPLAINED);
    let chosen: Vec<usize> = match rows.len() {
        0 => Vec::new(),
        n if n <= EXAMPLES => rows,
        n => (0..EXAMPLES).map(|k| rows[k * (n - 1) / (EXAMPLES - 1)]).collect(),
    };
    let explained = |row: &usize| {
        let remade = shown.conduct.remake(*row as u64).ok()?;
        let why = remade.outcome.verdict.hand.map(|h| h.why).filter(|why| !why.is_empty())?;
        let force = |x: f64| format!("{} N", significant(x, 3));
        Some(vec![row.to_string(), force(hand[*row]), force(twin[*row]), format!("{:+.0} %", 1e2 * excess(*row)), why])
    };
    let reasons: Vec<Vec<String>> = chosen.iter().filter_map(explained).collect();
    let headers = ["run", "by hand", "twin", "difference", "where and why"].map(String::from).to_vec();
    (vec![picture], (!reasons.is_empty()).then_some((headers, reasons)))
}
