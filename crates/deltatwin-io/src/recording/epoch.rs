//! Times since 1970, in units from seconds to nanoseconds, without loss of digits.

/// Value from which a time counts as measured from a distant origin, in any unit (three years in seconds).
const DISTANT_ORIGIN: i64 = 100_000_000;

/// State for parsing the times of one column.
#[derive(Default)]
pub(super) struct Clock {
    /// Whole units of the first time, if it is far from zero.
    start: Option<Option<i64>>,
}

impl Clock {
    /// The time in a cell relative to the whole units of the first one, exactly.
    ///
    /// `None` if the first time is not far from zero, or the cell is not a plain decimal.
    pub fn since_start(&mut self, cell: &str) -> Option<f64> {
        let (whole, fraction) = cell.split_once('.').unwrap_or((cell, ""));
        let whole: Option<i64> = whole.parse().ok();
        let start = *self.start.get_or_insert(whole.filter(|w| *w >= DISTANT_ORIGIN));
        let fraction: f64 = if fraction.is_empty() { 0.0 } else { format!("0.{fraction}").parse().ok()? };
        let since = whole?.checked_sub(start?)?;
        Some(since as f64 + fraction)
    }

    /// The times `read` in seconds, and a note; `stated` is the header's unit in s.
    ///
    /// If the header states no unit, it is inferred from the distance to 1970.
    pub fn seconds(&self, read: &[f64], stated: f64) -> (Vec<f64>, Option<String>) {
        let scaled = |factor: f64| match factor {
            1.0 => read.to_vec(),
            f => read.iter().map(|t| f * t).collect(),
        };
        let Some(Some(start)) = self.start else { return (scaled(stated), None) };
        let (unit, factor) = match (stated, start) {
            (1.0, ..100_000_000_000) => ("s", 1.0),
            (1.0, ..100_000_000_000_000) => ("ms", 1e-3),
            (1.0, ..100_000_000_000_000_000) => ("us", 1e-6),
            (1.0, _) => ("ns", 1e-9),
            (f, _) => return (scaled(f), Some(format!("starts at {start}: counted from there"))),
        };
        (scaled(factor), Some(format!("starts at {start}, taken for {unit} since 1970: counted from there")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn epochs_keep_their_digits() {
        for (cells, stated, unit) in [
            (["1700000000.1234", "1700000000.1238"], 1.0, "s since"),
            (["1700000000123.4", "1700000000123.8"], 1.0, "ms since"),
            (["1700000000123400000", "1700000000123800000"], 1.0, "ns since"),
            (["1700000000123400000", "1700000000123800000"], 1e-9, "counted"),
        ] {
            let mut clock = Clock::default();
            let read: Vec<f64> = cells.iter().filter_map(|c| clock.since_start(c)).collect();
            let (t, noticed) = clock.seconds(&read, stated);
            assert!((t[1] - t[0] - 4e-4).abs() < 1e-15, "{cells:?}: {t:?}");
            assert!(noticed.is_some_and(|n| n.contains(unit)), "{cells:?}");
        }
        let mut clock = Clock::default();
        assert_eq!(clock.since_start("0.5"), None);
        assert_eq!(clock.seconds(&[0.5, 0.6], 1.0), (vec![0.5, 0.6], None));
        assert_eq!(Clock::default().since_start("soon"), None);
    }
}
