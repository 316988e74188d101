//! What a table says in numbers.

use std::collections::BTreeMap;

use crate::campaign::parquet::Reader;
use crate::campaign::{CampaignError, Table, Value};

use super::Conduct;

/// Counts of a table.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary {
    /// Rows.
    pub runs: u64,
    /// Runs without a verdict.
    pub errors: u64,
    /// The first of them, and why.
    pub first_error: Option<(u64, String)>,
    /// Runs that failed.
    pub failed: u64,
    /// Failed runs by cause, most frequent first.
    pub causes: Vec<(String, u64)>,
    /// Failed runs by the first socket to leave, most frequent first.
    pub sockets: Vec<(String, u64)>,
    /// Run of the least margin, and that margin.
    pub worst: Option<(u64, f64)>,
    /// Failed runs that some supervision would have noticed before, and the median of the lead, s.
    pub noticed: Option<(u64, f64)>,
    /// What the diagnosis says of the recordings, if the study asks for it.
    pub diagnosed: Option<Diagnosed>,
    /// Rows of a boundary search whose ray has a crossing, and those along which the margin does not fall.
    pub boundary: Option<(u64, u64)>,
}

/// Diagnoses of the recordings of a study.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Diagnosed {
    /// Runs with a diagnosis; others failed before there was enough to diagnose.
    pub runs: u64,
    /// Runs by what was named, most frequent first.
    pub named: Vec<(String, u64)>,
    /// Runs in which nothing was named although something is missing.
    pub unknown: u64,
    /// Value of the factor `over` from which on every diagnosed run names something, with the least margin at that value.
    pub named_from: Option<(f64, f64)>,
    /// Least value of the factor `over` at which a run failed.
    pub failed_from: Option<f64>,
}

/// One run over the factor `over`.
struct Along {
    at: f64,
    margin: f64,
    survived: bool,
    /// Whether an effect was named; `None` without a diagnosis.
    named: Option<bool>,
}

/// Value of the factor from which on all of `runs` that were diagnosed name something, with the least margin there.
fn named_from(runs: &mut [Along]) -> Option<(f64, f64)> {
    runs.sort_by(|a, b| b.at.total_cmp(&a.at));
    let mut from = None;
    for same in runs.chunk_by(|a, b| a.at == b.at) {
        if same.iter().any(|run| run.named == Some(false)) {
            break;
        }
        if same.iter().any(|run| run.named == Some(true)) {
            from = Some((same[0].at, same.iter().map(|run| run.margin).fold(f64::INFINITY, f64::min)));
        }
    }
    from
}

impl Summary {
    /// Shares of failures between which the runs without a verdict leave the true one: all of them survived, all failed.
    pub fn bounds(&self) -> [f64; 2] {
        [self.failed, self.failed + self.errors].map(|n| n as f64 / self.runs.max(1) as f64)
    }
}

impl Conduct {
    /// The numbers of the merged table; it is read row group by row group.
    ///
    /// # Errors
    /// If the table cannot be read.
    pub fn summary(&self) -> Result<Summary, CampaignError> {
        let file = self.campaign.table();
        let content = |reason| CampaignError::Content { file: file.clone(), reason };
        let reader = Reader::open(&file).map_err(content)?;
        let mut counts = Counts::default();
        for group in 0..reader.groups() {
            for row in reader.group(group).map_err(content)? {
                counts.add(self, &row);
            }
        }
        Ok(counts.finish())
    }
}

impl Conduct {
    /// The columns of the merged table with these names, as far as there are such columns.
    ///
    /// # Errors
    /// If the table cannot be read.
    pub fn picked(&self, names: &[&str]) -> Result<Table, CampaignError> {
        let file = self.campaign.table();
        let content = |reason| CampaignError::Content { file: file.clone(), reason };
        let reader = Reader::open(&file).map_err(content)?;
        let place = |name: &&str| reader.headings().iter().position(|h| h.name == *name);
        let places: Vec<usize> = names.iter().filter_map(place).collect();
        let mut table = Table {
            headings: places.iter().map(|c| reader.headings()[*c].clone()).collect(),
            rows: Vec::with_capacity(reader.len() as usize),
        };
        for group in 0..reader.groups() {
            for row in reader.group(group).map_err(content)? {
                table.rows.push(places.iter().map(|c| row[*c].clone()).collect());
            }
        }
        Ok(table)
    }
}

#[derive(Default)]
struct Counts {
    summary: Summary,
    causes: BTreeMap<String, u64>,
    sockets: BTreeMap<String, u64>,
    leads: Vec<f64>,
    named: BTreeMap<String, u64>,
    along: Vec<Along>,
}

impl Counts {
    fn add(&mut self, conduct: &Conduct, row: &[Value]) {
        let (columns, summary) = (&conduct.columns, &mut self.summary);
        let column = |name: &str| columns.headings.iter().position(|h| h.name == name).map(|c| &row[c]);
        let text = |name: &str| match column(name) {
            Some(Value::Text(text)) => Some(text.clone()),
            _ => None,
        };
        let run = summary.runs;
        summary.runs += 1;
        if let Value::Text(reason) = &row[columns.error] {
            summary.errors += 1;
            summary.first_error.get_or_insert_with(|| (run, reason.clone()));
            return;
        }
        if let Some(margin) = row[columns.margin].number()
            && summary.worst.is_none_or(|(_, least)| margin < least)
        {
            summary.worst = Some((run, margin));
        }
        if let Some(Value::Flag(falls)) = column("margin_falls") {
            let crossed = column("reach_high").is_some_and(|v| v.number().is_some());
            let (crossings, rising) = summary.boundary.get_or_insert((0, 0));
            *crossings += u64::from(crossed);
            *rising += u64::from(!falls);
        }
        let survived = row[columns.survived] != Value::Flag(false);
        if conduct.study.diagnose {
            let answer = text("diagnosis");
            let named = text("named");
            let found = summary.diagnosed.get_or_insert_default();
            found.runs += u64::from(answer.is_some());
            found.unknown += u64::from(answer.as_deref() == Some("unknown") && named.is_none());
            if let (Some(over), Some(margin)) = (conduct.study.over, row[columns.margin].number())
                && let Some(at) = row[columns.factors + over].number()
            {
                self.along.push(Along { at, margin, survived, named: answer.map(|_| named.is_some()) });
            }
            if let Some(named) = named {
                *self.named.entry(named).or_default() += 1;
            }
        }
        if survived {
            return;
        }
        summary.failed += 1;
        *self.causes.entry(text("cause").unwrap_or_default()).or_default() += 1;
        if let Some(socket) = text("first_socket") {
            *self.sockets.entry(socket).or_default() += 1;
        }
        self.leads.extend(column("lead").and_then(Value::number).filter(|lead| *lead > 0.0));
    }

    fn finish(mut self) -> Summary {
        let ranked = |counts: BTreeMap<String, u64>| {
            let mut all: Vec<(String, u64)> = counts.into_iter().collect();
            all.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
            all
        };
        self.summary.causes = ranked(self.causes);
        self.summary.sockets = ranked(self.sockets);
        if let Some(found) = &mut self.summary.diagnosed {
            found.named = ranked(self.named);
            found.named_from = named_from(&mut self.along);
            found.failed_from = self.along.iter().filter(|run| !run.survived).map(|run| run.at).reduce(f64::min);
        }
        self.leads.sort_by(f64::total_cmp);
        let count = self.leads.len();
        self.summary.noticed = self.leads.get(count / 2).map(|median| (count as u64, *median));
        self.summary
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_without_a_verdict_leave_the_share_of_failures_open() {
        let of = |failed, errors| Summary { runs: 20, failed, errors, ..Summary::default() }.bounds();
        assert_eq!([of(4, 0), of(4, 3), of(0, 20)], [[0.2, 0.2], [0.2, 0.35], [0.0, 1.0]]);
        assert_eq!(Summary::default().bounds(), [0.0, 0.0]);
    }

    #[test]
    fn an_early_name_counts_only_if_all_later_runs_have_one() {
        let run = |at: f64, named| Along { at, margin: 1.0 - at, survived: at < 0.75, named };
        let names = [(0.2, Some(true)), (0.4, Some(false)), (0.5, Some(true)), (0.6, Some(true)), (0.8, None)];
        let mut runs: Vec<Along> = names.map(|(at, named)| run(at, named)).into();
        assert_eq!(named_from(&mut runs), Some((0.5, 0.5)));
        runs.push(run(0.6, Some(false)));
        assert_eq!(named_from(&mut runs), None);
    }
}
