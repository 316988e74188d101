//! The table made of the parts.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

use ::parquet::errors::ParquetError;

use super::chunk::Chunk;
use super::error::CampaignError;
use super::folder::{Campaign, FIRST, PARTS};
use super::parquet::Reader;

impl Campaign {
    /// Writes the table of all parts, after a check that they hold all of `runs` runs; returns its number of rows.
    /// Parts of different numbers of chunks may be mixed. Without `runs` the parts must begin with run 0 and have no gap.
    ///
    /// # Errors
    /// If a part is missing, of another campaign, or cannot be read, or the table cannot be written.
    pub fn merge(&self, runs: Option<u64>) -> Result<u64, CampaignError> {
        let mut parts = self.parts()?;
        parts.sort_by_key(|(_, range, _)| (range.start, std::cmp::Reverse(range.end)));
        let end = runs.unwrap_or_else(|| parts.iter().map(|(_, range, _)| range.end).max().unwrap_or(0));
        let mut chosen: Vec<(&Reader, u64, &Path)> = Vec::new();
        let (mut due, mut missing, mut first) = (0, 0, None);
        for (reader, range, file) in &parts {
            if range.start > due {
                missing += range.start - due;
                first = first.or(Some(due));
                due = range.start;
            }
            if range.end > due {
                chosen.push((reader, due - range.start, file));
                due = range.end;
            }
        }
        if due < end {
            missing += end - due;
            first = first.or(Some(due));
        }
        if let Some(first) = first.or((parts.is_empty()).then_some(0)) {
            let chunks = self.wanting(&parts, end);
            return Err(CampaignError::Incomplete { folder: self.folder.clone(), missing, of: end, first, chunks });
        }
        let table = self.table();
        self.write(&table, &[], |writer| {
            for (reader, skip, file) in chosen {
                let mut skip = skip as usize;
                for group in 0..reader.groups() {
                    let rows = reader.group(group).map_err(CampaignError::content(file))?;
                    let from = skip.min(rows.len());
                    skip -= from;
                    for row in rows.into_iter().skip(from) {
                        writer.row(row).map_err(CampaignError::content(&table))?;
                    }
                }
            }
            Ok(())
        })?;
        Ok(due)
    }

    /// The parts in the folder, and the runs that they hold.
    pub(super) fn parts(&self) -> Result<Vec<(Reader, Range<u64>, PathBuf)>, CampaignError> {
        let folder = self.folder.join(PARTS);
        let mut parts = Vec::new();
        if !folder.is_dir() {
            return Ok(parts);
        }
        for entry in std::fs::read_dir(&folder).map_err(CampaignError::io(&folder))? {
            let file = entry.map_err(CampaignError::io(&folder))?.path();
            if file.extension().is_some_and(|e| e == "parquet") {
                let reader = self.own(&file)?;
                let first = reader.metadata().iter().find(|(key, _)| key == FIRST).map(|(_, value)| value.parse());
                let Some(Ok(first)) = first else {
                    let reason = ParquetError::General(format!("its metadata lacks `{FIRST}`"));
                    return Err(CampaignError::Content { file, reason });
                };
                let range = first..first + reader.len();
                parts.push((reader, range, file));
            }
        }
        Ok(parts)
    }

    /// The chunks that are not there, of that number of chunks of which most runs are there.
    fn wanting(&self, parts: &[(Reader, Range<u64>, PathBuf)], runs: u64) -> Vec<Chunk> {
        let mut there: BTreeMap<u64, u64> = BTreeMap::new();
        for (_, range, file) in parts {
            let stem = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            if let Some(of) = stem.split_once("-of-").and_then(|(_, of)| of.parse().ok()) {
                *there.entry(of).or_default() += range.end - range.start;
            }
        }
        let of = there.into_iter().max_by_key(|(_, runs)| *runs).map_or(1, |(of, _)| of);
        let chunks = (1..=of).filter_map(|number| Chunk::new(number, of));
        chunks.filter(|chunk| !chunk.range(runs).is_empty() && !self.part(*chunk).is_file()).collect()
    }
}
