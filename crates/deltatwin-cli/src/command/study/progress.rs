//! Progress of a study on the screen: runs, failures so far, time left.

use std::sync::atomic::{AtomicU64, Ordering};

use deltatwin_study::campaign::{Value, Watch};
use indicatif::{ProgressBar, ProgressStyle};

use crate::terminal::interrupted;

/// A bar on stderr; invisible if stderr is no terminal.
pub struct Progress {
    bar: ProgressBar,
    column: Option<usize>,
    what: &'static str,
    failed: AtomicU64,
}

impl Progress {
    /// A bar for `runs` rows, of which those with false in `column` are counted as `what`.
    pub fn new(runs: u64, (column, what): (Option<usize>, &'static str)) -> Self {
        let bar = ProgressBar::new(runs);
        let style = "{prefix:>10} [{bar:30}] {pos} of {len}, {msg}, {eta} left";
        bar.set_style(ProgressStyle::with_template(style).expect("a valid template").progress_chars("##-"));
        bar.set_prefix("study");
        bar.set_message(format!("0 {what}"));
        Self { bar, column, what, failed: AtomicU64::new(0) }
    }

    /// Removes the bar.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl Watch for Progress {
    fn row(&self, row: &[Value], anew: bool) {
        if self.column.is_some_and(|column| row[column] == Value::Flag(false)) {
            let failed = self.failed.fetch_add(1, Ordering::Relaxed) + 1;
            self.bar.set_message(format!("{failed} {}", self.what));
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
