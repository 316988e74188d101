//! Conversion of columns to signals, and checks of signals that are written.

use std::ops::Range;

use deltatwin::recording::{Channel, FAMILIES, Signals};

use super::Table;

impl Table {
    /// The signals in the columns.
    pub(super) fn into_signals(self, segments: Vec<Range<usize>>, warnings: &mut Vec<String>) -> Signals {
        let mut signals = Signals::new(self.machine, self.t);
        signals.segments = segments;
        for column in self.columns {
            if let Some(channel) = Channel::named(&column.name) {
                signals.set(channel, column.values);
            }
        }
        for family in FAMILIES.iter().filter(|family| family.whole) {
            let (known, missing): (Vec<_>, Vec<_>) =
                family.channels(signals.mechanism).partition(|channel| signals.get(*channel).is_some());
            if let (Some(rest), Some(missing)) = (known.first(), missing.first()) {
                warnings.push(format!("`{rest}` ignored: it needs `{missing}` next to it"));
                signals = signals.only(|channel| !known.contains(&channel));
            }
        }
        signals
    }
}

/// Checks `signals` that are to be written; `before` is the number of samples before them, for the errors.
///
/// # Errors
/// A description of the first channel whose length differs from that of `t`, or of the first value that is not finite.
pub(in crate::recording) fn check(signals: &Signals, before: usize) -> Result<(), String> {
    for (name, _, values) in signals.columns() {
        if values.len() != signals.len() {
            return Err(format!("`{name}` has {} samples, time has {}", values.len(), signals.len()));
        }
        if let Some(i) = values.iter().position(|v| !v.is_finite()) {
            return Err(format!("sample {} of `{name}` is {}", before + i + 1, values[i]));
        }
    }
    Ok(())
}
