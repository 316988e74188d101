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
    /// Rows of a boundary search whose ray has a crossing, and those along which the margin does not fall.
    pub boundary: Option<(u64, u64)>,
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
        if row[columns.survived] != Value::Flag(false) {
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
        self.leads.sort_by(f64::total_cmp);
        let count = self.leads.len();
        self.summary.noticed = self.leads.get(count / 2).map(|median| (count as u64, *median));
        self.summary
    }
}
