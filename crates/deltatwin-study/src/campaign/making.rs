//! The runs of a chunk on all cores, with a journal of the rows that are there.

use std::io;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc;

use super::chunk::Chunk;
use super::error::CampaignError;
use super::folder::{Campaign, FIRST};
use super::journal::{Fault, Journal};
use super::table::Value;

/// Row of one run, or an error that ends the campaign.
pub type Row = Result<Vec<Value>, Box<dyn std::error::Error + Send + Sync>>;

/// Who looks on while runs are made; called from one thread.
pub trait Watch: Sync {
    /// A row is there; `anew` tells whether it was made now, or by an earlier process.
    fn row(&self, row: &[Value], anew: bool);

    /// Whether to stop.
    fn stop(&self) -> bool;
}

impl Campaign {
    /// Makes the runs of `chunk` out of `runs` that are not there yet, on all threads of the current pool, and writes
    /// its part. `work` makes the row of a run.
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
        self.claim()?;
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
        self.claim()?;
        if self.has_part(Chunk::WHOLE)? {
            return Ok(());
        }
        let mut steps = self.open(Chunk::WHOLE, 0, watch)?;
        search(&mut steps)?;
        let end = steps.next;
        Ok(steps.close(0..end)?)
    }

    fn open<'c>(&'c self, chunk: Chunk, first: u64, watch: &'c dyn Watch) -> Result<Steps<'c>, CampaignError> {
        let path = self.journal(chunk);
        let title = format!("deltatwin study {} build {} chunk {chunk}", self.digest.hex(), self.build);
        let journal = Journal::open(&path, &title, first).map_err(|fault| match fault {
            Fault::Io(reason) => CampaignError::Io { file: path.clone(), reason },
            Fault::Taken => CampaignError::Taken { file: path.clone() },
            Fault::Foreign => CampaignError::Foreign {
                file: path.clone(),
                found: "or of another build of deltatwin".into(),
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
    ///
    /// The rows are collected by a thread of its own, so that the caller may be any thread of the pool, or its only one.
    fn fill(&mut self, range: Range<u64>, work: &(dyn Fn(u64) -> Row + Sync)) -> Result<(), CampaignError> {
        let path = self.campaign.journal(self.chunk);
        let there: Vec<bool> = range.clone().map(|run| self.journal.has(run)).collect();
        let (next, ended) = (AtomicU64::new(range.start), AtomicBool::new(false));
        let (send, receive) = mpsc::sync_channel::<(u64, Row)>(4 * rayon::current_num_threads());
        let watch = self.watch;
        let take = || loop {
            let run = next.fetch_add(1, Ordering::Relaxed);
            if run >= range.end || ended.load(Ordering::Relaxed) || watch.stop() {
                return None;
            }
            if !there[(run - range.start) as usize] {
                return Some(run);
            }
        };
        let (take, journal, file, ended) = (&take, &mut self.journal, &path, &ended);
        let collect = move || {
            let mut outcome = Ok(());
            for (run, row) in receive {
                let kept = match row {
                    Ok(row) => keep(journal, watch, run, &row).map_err(CampaignError::io(file)),
                    Err(reason) => Err(CampaignError::Run { run, reason }),
                };
                if outcome.is_ok() && kept.is_err() {
                    ended.store(true, Ordering::Relaxed);
                    outcome = kept;
                }
            }
            outcome
        };
        std::thread::scope(|threads| {
            let collector = threads.spawn(collect);
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
            });
            collector.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        })?;
        self.journal.sync().map_err(CampaignError::io(&path))?;
        if range.clone().all(|run| self.journal.has(run)) { Ok(()) } else { Err(CampaignError::Interrupted) }
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

/// Shows a new row to the watch and writes it to the journal.
fn keep(journal: &mut Journal, watch: &dyn Watch, run: u64, row: &[Value]) -> io::Result<()> {
    watch.row(row, true);
    journal.write(run, row)
}
