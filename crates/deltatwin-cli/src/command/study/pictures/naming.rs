//! What the diagnosis says of the runs.

use deltatwin::text::significant;
use deltatwin_study::campaign::Value;

use super::Shown;

/// Rows of the table at most: the values of the factor at which runs are counted.
const MOST: usize = 24;

/// Header and rows: at each value of the factor `over`, the runs, those that failed, the least margin, and what was named.
pub fn table(shown: &Shown) -> Option<(Vec<String>, Vec<Vec<String>>)> {
    let over = shown.conduct.study.over.filter(|_| shown.conduct.study.diagnose)?;
    let factor = &shown.conduct.study.factors[over];
    let (at, margins, failed) = (shown.numbers(&factor.name), shown.numbers(&shown.margin), shown.failed());
    let named = shown.table.column("named")?;
    let mut values: Vec<f64> = at.iter().copied().filter(|x| x.is_finite()).collect();
    values.sort_by(f64::total_cmp);
    values.dedup();
    if values.is_empty() || values.len() > MOST {
        return None;
    }
    let row = |value: f64| {
        let own: Vec<usize> = (0..at.len()).filter(|&k| at[k] == value).collect();
        let mut names: Vec<&str> = own
            .iter()
            .filter_map(|&k| match &shown.table.rows[k][named] {
                Value::Text(name) => Some(name.as_str()),
                _ => None,
            })
            .collect();
        let count = names.len();
        names.sort_unstable();
        names.dedup();
        vec![
            significant(value, 4),
            own.len().to_string(),
            own.iter().filter(|&&k| failed[k] == Some(true)).count().to_string(),
            significant(own.iter().map(|&k| margins[k]).fold(f64::INFINITY, f64::min), 2),
            count.to_string(),
            names.join(", "),
        ]
    };
    let unit = if factor.unit == "1" { String::new() } else { format!(" / {}", factor.unit) };
    let header = [
        format!("{}{unit}", factor.name),
        "runs".into(),
        "failed".into(),
        "least margin".into(),
        "named in".into(),
        "named".into(),
    ];
    Some((header.to_vec(), values.into_iter().map(row).collect()))
}
