//! Progress of a study on the screen: runs, failures so far, time left.

use std::sync::atomic::{AtomicU64, Ordering};

use deltatwin_study::campaign::{Value, Watch};
use deltatwin_study::conduct::{Columns, Conduct};
use indicatif::{ProgressBar, ProgressStyle};

use crate::terminal::interrupted;

/// A bar on stderr; invisible if stderr is no terminal.
pub struct Progress {
    bar: ProgressBar,
    columns: Columns,
    failed: AtomicU64,
}

impl Progress {
    /// A bar for `runs` rows of a study.
    pub fn new(conduct: &Conduct, runs: u64) -> Self {
        let bar = ProgressBar::new(runs);
        let style = "{prefix:>10} [{bar:30}] {pos} of {len}, {msg} failed, {eta} left";
        bar.set_style(ProgressStyle::with_template(style).expect("a valid template").progress_chars("##-"));
        bar.set_prefix("study");
        bar.set_message("0");
        Self { bar, columns: conduct.columns.clone(), failed: AtomicU64::new(0) }
    }

    /// Removes the bar.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl Watch for Progress {
    fn row(&self, row: &[Value], anew: bool) {
        if row[self.columns.survived] == Value::Flag(false) {
            let failed = self.failed.fetch_add(1, Ordering::Relaxed) + 1;
            self.bar.set_message(failed.to_string());
        }
        self.bar.inc(1);
        if !anew {
            // What an earlier process did says nothing about the time of this one.
            self.bar.reset_eta();
        }
    }

    fn stop(&self) -> bool {
        interrupted()
    }
}
