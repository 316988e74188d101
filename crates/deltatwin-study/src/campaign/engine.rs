//! The runs of a campaign on all cores, chunk by chunk, and the table made of the chunks.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc;

use ::parquet::errors::ParquetError;
use miette::Diagnostic;
use thiserror::Error;

use super::chunk::Chunk;
use super::digest::Digest;
use super::journal::{Fault, Journal};
use super::parquet::{Reader, Writer};
use super::table::{Heading, Value};

/// Name of the merged table in a campaign's folder.
pub const TABLE: &str = "runs.parquet";
/// Folder of the parts in a campaign's folder.
const PARTS: &str = "parts";
/// Keys of the metadata of parts and tables.
const DIGEST: &str = "digest";
const FIRST: &str = "first_run";

/// Row of one run, or an error that ends the campaign.
pub type Row = Result<Vec<Value>, Box<dyn std::error::Error + Send + Sync>>;

/// A campaign: runs 0 to `runs`, one row each, in a folder.
pub struct Campaign {
    /// Folder of the parts and the table.
    pub folder: PathBuf,
    /// Digest of all that determines the rows.
    pub digest: Digest,
    /// Headings of the rows.
    pub headings: Vec<Heading>,
    /// Further metadata of the table.
    pub metadata: Vec<(String, String)>,
}

/// Who looks on while runs are made; called from one thread.
pub trait Watch: Sync {
    /// A row is there; `anew` tells whether it was made now, or by an earlier process.
    fn row(&self, row: &[Value], anew: bool);

    /// Whether to stop.
    fn stop(&self) -> bool;
}

/// What a folder holds of a campaign.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Held {
    /// Nothing, or parts.
    Open,
    /// The whole table.
    Table,
}

/// Why a campaign cannot go on.
#[derive(Debug, Error, Diagnostic)]
pub enum CampaignError {
    /// The file system failed.
    #[error("{}: {reason}", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// Error of the operating system.
        reason: io::Error,
    },
    /// A file is no table, or not a whole one.
    #[error("{}: cannot be read as a table: {reason}; expected a Parquet file of a study", file.display())]
    Content {
        /// The file.
        file: PathBuf,
        /// Error of the reader.
        reason: ParquetError,
    },
    /// Rows of another campaign are in the way.
    #[error(
        "{}: belongs to another study: it has the digest {found}, this one {expected}; expected an empty folder or one \
         of the same study",
        file.display()
    )]
    Foreign {
        /// The file.
        file: PathBuf,
        /// Digest of what is there.
        found: String,
        /// Digest of the campaign.
        expected: String,
    },
    /// Another process makes the same chunk.
    #[error("{}: another process is making this chunk", file.display())]
    Taken {
        /// Its journal.
        file: PathBuf,
    },
    /// Parts are missing.
    #[error("{}: {} of {of} runs are missing, the first is run {first}", folder.display(), .missing)]
    Incomplete {
        /// The folder.
        folder: PathBuf,
        /// Number of runs without a row.
        missing: u64,
        /// Number of runs.
        of: u64,
        /// First run without a row.
        first: u64,
        /// Chunks to be made, of the number of chunks of which most are there.
        chunks: Vec<Chunk>,
    },
    /// A run cannot be made at all.
    #[error("run {run}: {reason}")]
    Run {
        /// The run.
        run: u64,
        /// Why.
        reason: Box<dyn std::error::Error + Send + Sync>,
    },
    /// The watch asked to stop; what was done is kept.
    #[error("interrupted")]
    Interrupted,
}

impl CampaignError {
    fn io(file: &Path) -> impl FnOnce(io::Error) -> Self + '_ {
        move |reason| Self::Io { file: file.into(), reason }
    }

    fn content(file: &Path) -> impl FnOnce(ParquetError) -> Self + '_ {
        move |reason| match reason {
            // The reader wraps errors of the operating system.
            ParquetError::External(error) if error.is::<io::Error>() => {
                Self::Io { file: file.into(), reason: io::Error::other(error) }
            }
            reason => Self::Content { file: file.into(), reason },
        }
    }
}

impl Campaign {
    /// The merged table.
    pub fn table(&self) -> PathBuf {
        self.folder.join(TABLE)
    }

    /// The part of a chunk.
    pub fn part(&self, chunk: Chunk) -> PathBuf {
        self.folder.join(PARTS).join(format!("{}.parquet", chunk.stem()))
    }

    fn journal(&self, chunk: Chunk) -> PathBuf {
        self.folder.join(PARTS).join(format!(".{}.journal", chunk.stem()))
    }

    /// What the folder holds of this campaign.
    ///
    /// # Errors
    /// If its table is of another campaign or cannot be read.
    pub fn held(&self) -> Result<Held, CampaignError> {
        let table = self.table();
        if !table.is_file() {
            return Ok(Held::Open);
        }
        self.own(&table)?;
        Ok(Held::Table)
    }

    /// A table of this campaign.
    fn own(&self, file: &Path) -> Result<Reader, CampaignError> {
        let reader = Reader::open(file).map_err(CampaignError::content(file))?;
        let found = reader.metadata().iter().find(|(key, _)| key == DIGEST).map_or("", |(_, value)| value);
        let expected = self.digest.hex();
        if found != expected || reader.headings() != self.headings {
            return Err(CampaignError::Foreign { file: file.into(), found: found.into(), expected });
        }
        Ok(reader)
    }

    /// Removes table, parts and journals, of whatever campaign.
    ///
    /// # Errors
    /// If they cannot be removed.
    pub fn clear(&self) -> Result<(), CampaignError> {
        let parts = self.folder.join(PARTS);
        for (path, there) in [(self.table(), self.table().is_file()), (parts.clone(), parts.is_dir())] {
            if there {
                let gone = if path.is_dir() { std::fs::remove_dir_all(&path) } else { std::fs::remove_file(&path) };
                gone.map_err(CampaignError::io(&path))?;
            }
        }
        Ok(())
    }

    /// Removes the parts, which the table holds.
    ///
    /// # Errors
    /// If they cannot be removed.
    pub fn remove_parts(&self) -> Result<(), CampaignError> {
        let parts = self.folder.join(PARTS);
        if parts.is_dir() && self.table().is_file() {
            std::fs::remove_dir_all(&parts).map_err(CampaignError::io(&parts))?;
        }
        Ok(())
    }

    /// Makes the runs of `chunk` out of `runs` that are not there yet, on all threads of the current pool, and writes
    /// its part. `work` makes the row of a run. The caller collects the rows: it must not be the only thread of its pool.
    ///
    /// # Errors
    /// If a file cannot be used, `work` fails, or the watch asks to stop.
    pub fn chunk(
        &self,
        chunk: Chunk,
        runs: u64,
        work: &(dyn Fn(u64) -> Row + Sync),
        watch: &dyn Watch,
    ) -> Result<(), CampaignError> {
        let range = chunk.range(runs);
        if self.has_part(chunk)? {
            return Ok(());
        }
        let mut steps = self.open(chunk, range.start, watch)?;
        steps.fill(range.clone(), work)?;
        steps.close(range)
    }

    /// Whether the part of a chunk is there.
    fn has_part(&self, chunk: Chunk) -> Result<bool, CampaignError> {
        let part = self.part(chunk);
        if !part.is_file() {
            return Ok(false);
        }
        self.own(&part)?;
        // Left by a kill between the part and the end of its journal.
        let _ = std::fs::remove_file(self.journal(chunk));
        Ok(true)
    }

    /// Makes runs of which each batch depends on the rows of those before: `search` is given an evaluator and asks it
    /// for rows. Runs that an earlier process has made are taken from its journal.
    ///
    /// # Errors
    /// As for [`Self::chunk`], and those of `search`.
    pub fn sequence<E: From<CampaignError>>(
        &self,
        watch: &dyn Watch,
        search: impl FnOnce(&mut Steps) -> Result<(), E>,
    ) -> Result<(), E> {
        if self.has_part(Chunk::WHOLE)? {
            return Ok(());
        }
        let mut steps = self.open(Chunk::WHOLE, 0, watch)?;
        search(&mut steps)?;
        let end = steps.next;
        Ok(steps.close(0..end)?)
    }

    fn open<'c>(&'c self, chunk: Chunk, first: u64, watch: &'c dyn Watch) -> Result<Steps<'c>, CampaignError> {
        let parts = self.folder.join(PARTS);
        std::fs::create_dir_all(&parts).map_err(CampaignError::io(&parts))?;
        let path = self.journal(chunk);
        let title = format!("deltatwin study {} chunk {chunk}", self.digest.hex());
        let journal = Journal::open(&path, &title, first).map_err(|fault| match fault {
            Fault::Io(reason) => CampaignError::Io { file: path.clone(), reason },
            Fault::Taken => CampaignError::Taken { file: path.clone() },
            Fault::Foreign => CampaignError::Foreign {
                file: path.clone(),
                found: "of another study".into(),
                expected: self.digest.hex(),
            },
        })?;
        let steps = Steps { campaign: self, journal, chunk, next: first, watch };
        for run in steps.journal.runs() {
            let row = steps.journal.row(run).map_err(CampaignError::io(&path))?;
            watch.row(&row, false);
        }
        Ok(steps)
    }

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
    fn parts(&self) -> Result<Vec<(Reader, Range<u64>, PathBuf)>, CampaignError> {
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

    /// Writes a table under a temporary name, forces it to the disk and gives it its name.
    fn write(
        &self,
        file: &Path,
        metadata: &[(String, String)],
        rows: impl FnOnce(&mut Writer<&mut BufWriter<File>>) -> Result<(), CampaignError>,
    ) -> Result<(), CampaignError> {
        let folder = file.parent().unwrap_or(&self.folder);
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        // One name per table, so that no kill leaves more than one file, which the next attempt takes.
        let temporary = folder.join(format!(".{name}.writing"));
        let mut out = BufWriter::new(File::create(&temporary).map_err(CampaignError::io(&temporary))?);
        let mut all = self.metadata.clone();
        all.push((DIGEST.into(), self.digest.hex()));
        all.extend(metadata.iter().cloned());
        let mut writer = Writer::new(&mut out, &self.headings, &all).map_err(CampaignError::content(&temporary))?;
        rows(&mut writer)?;
        writer.finish().map_err(CampaignError::content(&temporary))?;
        let kept = || -> io::Result<()> {
            out.flush()?;
            out.get_ref().sync_all()?;
            std::fs::rename(&temporary, file)?;
            // The name is on the disk once the folder is.
            if cfg!(unix) { File::open(folder)?.sync_all() } else { Ok(()) }
        };
        let mut kept = kept;
        kept().map_err(CampaignError::io(file))
    }
}

/// Runs of a chunk that is being made.
pub struct Steps<'c> {
    campaign: &'c Campaign,
    journal: Journal,
    chunk: Chunk,
    next: u64,
    watch: &'c dyn Watch,
}

impl Steps<'_> {
    /// The rows of the next `count` runs, in order; `work` makes a row from the number of its run and its place in the
    /// batch.
    ///
    /// # Errors
    /// If a file cannot be used, `work` fails, or the watch asks to stop.
    pub fn batch(
        &mut self,
        count: usize,
        work: &(dyn Fn(u64, usize) -> Row + Sync),
    ) -> Result<Vec<Vec<Value>>, CampaignError> {
        let range = self.next..self.next + count as u64;
        let first = range.start;
        self.fill(range.clone(), &|run| work(run, (run - first) as usize))?;
        self.next = range.end;
        let journal = self.campaign.journal(self.chunk);
        range.map(|run| self.journal.row(run).map_err(CampaignError::io(&journal))).collect()
    }

    /// Makes the rows of `range` that are not there.
    fn fill(&mut self, range: Range<u64>, work: &(dyn Fn(u64) -> Row + Sync)) -> Result<(), CampaignError> {
        let path = self.campaign.journal(self.chunk);
        let there: Vec<bool> = range.clone().map(|run| self.journal.has(run)).collect();
        let (next, ended) = (AtomicU64::new(range.start), AtomicBool::new(false));
        let (send, receive) = mpsc::sync_channel(4 * rayon::current_num_threads());
        let (journal, watch) = (&mut self.journal, self.watch);
        let take = || loop {
            let run = next.fetch_add(1, Ordering::Relaxed);
            if run >= range.end || ended.load(Ordering::Relaxed) || watch.stop() {
                return None;
            }
            if !there[(run - range.start) as usize] {
                return Some(run);
            }
        };
        let (take, ended) = (&take, &ended);
        let mut outcome = Ok(());
        rayon::in_place_scope(|scope| {
            for _ in 0..rayon::current_num_threads() {
                let send = send.clone();
                scope.spawn(move |_| {
                    while let Some(run) = take() {
                        if send.send((run, work(run))).is_err() {
                            return;
                        }
                    }
                });
            }
            drop(send);
            for (run, row) in receive {
                let kept = match row {
                    Ok(row) => {
                        watch.row(&row, true);
                        journal.write(run, &row).map_err(CampaignError::io(&path))
                    }
                    Err(reason) => Err(CampaignError::Run { run, reason }),
                };
                if outcome.is_ok() && kept.is_err() {
                    ended.store(true, Ordering::Relaxed);
                    outcome = kept;
                }
            }
        });
        outcome?;
        journal.sync().map_err(CampaignError::io(&path))?;
        if range.clone().all(|run| journal.has(run)) { Ok(()) } else { Err(CampaignError::Interrupted) }
    }

    /// Writes the part of the runs in `range` and removes the journal.
    fn close(self, range: Range<u64>) -> Result<(), CampaignError> {
        let (campaign, journal) = (self.campaign, &self.journal);
        let (part, path) = (campaign.part(self.chunk), campaign.journal(self.chunk));
        let metadata = [(FIRST.to_string(), range.start.to_string()), ("chunk".into(), self.chunk.to_string())];
        campaign.write(&part, &metadata, |writer| {
            for run in range {
                let row = journal.row(run).map_err(CampaignError::io(&path))?;
                writer.row(row).map_err(CampaignError::content(&part))?;
            }
            Ok(())
        })?;
        self.journal.remove().map_err(CampaignError::io(&path))
    }
}

#[cfg(test)]
mod tests {
    use super::super::table::Kind;
    use super::*;

    struct Silent(AtomicU64, u64);

    impl Watch for Silent {
        fn row(&self, _: &[Value], anew: bool) {
            self.0.fetch_add(u64::from(anew), Ordering::Relaxed);
        }

        fn stop(&self) -> bool {
            self.0.load(Ordering::Relaxed) >= self.1
        }
    }

    fn watch(most: u64) -> Silent {
        Silent(AtomicU64::new(0), most)
    }

    fn campaign(folder: &Path) -> Campaign {
        let headings = vec![Heading::new("run", "1", Kind::Integer), Heading::new("x", "m", Kind::Float)];
        let digest = Digest::of([("test", &b"1"[..])]);
        Campaign { folder: folder.into(), digest, headings, metadata: vec![("study".into(), "text".into())] }
    }

    fn work(run: u64) -> Row {
        Ok(vec![Value::Integer(run as i64), Value::Float((run as f64).sin())])
    }

    fn merged(runs: u64, chunks: &[(u64, u64)]) -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let campaign = campaign(folder.path());
        for (number, of) in chunks {
            let chunk = Chunk::new(*number, *of).unwrap();
            campaign.chunk(chunk, runs, &work, &watch(u64::MAX)).unwrap();
        }
        assert_eq!(campaign.merge(Some(runs)).unwrap(), runs);
        assert_eq!(campaign.held().unwrap(), Held::Table);
        std::fs::read(campaign.table()).unwrap()
    }

    #[test]
    fn the_table_does_not_depend_on_the_chunks() {
        for runs in [0, 5, 9000] {
            let one = merged(runs, &[(1, 1)]);
            assert_eq!(one, merged(runs, &[(2, 2), (1, 2)]));
            assert_eq!(one, merged(runs, &[(7, 7), (1, 7), (2, 7), (6, 7), (3, 7), (5, 7), (4, 7)]));
            // Halves and thirds that overlap.
            assert_eq!(one, merged(runs, &[(1, 2), (2, 3), (3, 3)]));
        }
    }

    #[test]
    fn a_stopped_chunk_goes_on_where_it_was() {
        let whole = merged(500, &[(1, 1)]);
        let folder = tempfile::tempdir().unwrap();
        let campaign = campaign(folder.path());
        let mut made = 0;
        loop {
            let watch = watch(37);
            let end = campaign.chunk(Chunk::WHOLE, 500, &work, &watch);
            made += watch.0.load(Ordering::Relaxed);
            match end {
                Ok(()) => break,
                Err(CampaignError::Interrupted) => assert!(!campaign.part(Chunk::WHOLE).exists()),
                Err(e) => panic!("{e}"),
            }
        }
        assert_eq!(made, 500);
        campaign.merge(Some(500)).unwrap();
        assert_eq!(std::fs::read(campaign.table()).unwrap(), whole);
    }

    #[test]
    fn what_is_missing_or_foreign_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let campaign = campaign(folder.path());
        for number in [1, 2, 4] {
            campaign.chunk(Chunk::new(number, 4).unwrap(), 10, &work, &watch(u64::MAX)).unwrap();
        }
        match campaign.merge(Some(10)) {
            Err(CampaignError::Incomplete { missing: 2, of: 10, first: 5, chunks, .. }) => {
                assert_eq!(chunks, [Chunk::new(3, 4).unwrap()]);
            }
            other => panic!("{other:?}"),
        }
        let other = Campaign { digest: Digest::of([]), ..self::campaign(folder.path()) };
        assert!(matches!(other.merge(Some(10)), Err(CampaignError::Foreign { .. })));
        let chunk = Chunk::new(1, 4).unwrap();
        assert!(matches!(other.chunk(chunk, 10, &work, &watch(9)), Err(CampaignError::Foreign { .. })));
        std::fs::write(campaign.part(Chunk::new(3, 4).unwrap()), "PAR1").unwrap();
        assert!(matches!(campaign.merge(Some(10)), Err(CampaignError::Content { .. })));
        other.clear().unwrap();
        assert!(matches!(campaign.merge(Some(10)), Err(CampaignError::Incomplete { missing: 10, .. })));
    }

    #[test]
    fn an_error_of_a_run_ends_the_chunk_and_keeps_the_others() {
        let folder = tempfile::tempdir().unwrap();
        let campaign = campaign(folder.path());
        let broken = |run: u64| if run == 7 { Err("no disk".into()) } else { work(run) };
        let end = campaign.chunk(Chunk::WHOLE, 100, &broken, &watch(u64::MAX));
        assert!(matches!(end, Err(CampaignError::Run { run: 7, .. })), "{end:?}");
        campaign.chunk(Chunk::WHOLE, 100, &work, &watch(u64::MAX)).unwrap();
        assert_eq!(campaign.merge(Some(100)).unwrap(), 100);
    }

    #[test]
    fn a_sequence_takes_its_rows_from_the_journal() {
        // Each run depends on the one before: x ← sin(x + run).
        let folder = tempfile::tempdir().unwrap();
        let campaign = campaign(folder.path());
        let search = |steps: &mut Steps| -> Result<(), CampaignError> {
            let mut x = 0.5;
            for _ in 0..40 {
                let rows = steps.batch(3, &|run, k| {
                    Ok(vec![Value::Integer(run as i64), Value::Float(f64::sin(x + run as f64 + k as f64))])
                })?;
                x = rows[2][1].number().unwrap();
            }
            Ok(())
        };
        let mut stops = 0;
        while let Err(e) = campaign.sequence(&watch(20), search) {
            assert!(matches!(e, CampaignError::Interrupted));
            stops += 1;
        }
        assert!(stops > 3);
        assert_eq!(campaign.merge(None).unwrap(), 120);
        let folder = tempfile::tempdir().unwrap();
        let whole = self::campaign(folder.path());
        whole.sequence(&watch(u64::MAX), search).unwrap();
        whole.merge(None).unwrap();
        assert_eq!(std::fs::read(campaign.table()).unwrap(), std::fs::read(whole.table()).unwrap());
    }
}
