//! Times since 1970, in seconds down to nanoseconds, without loss of digits.

/// Larger times count from somewhere far away, in whatever unit.
const FAR: i64 = 100_000_000;

/// Times of a column as they are read.
#[derive(Default)]
pub(super) struct Clock {
    /// Whole units of the first time, where it is far from zero.
    start: Option<Option<i64>>,
}

impl Clock {
    /// The time in a cell counted from the whole units of the first one, exactly; none where the first one is not far
    /// from zero, or the cell is no plain decimal.
    pub fn since_start(&mut self, cell: &str) -> Option<f64> {
        let (whole, fraction) = cell.split_once('.').unwrap_or((cell, ""));
        let whole: Option<i64> = whole.parse().ok();
        let start = *self.start.get_or_insert(whole.filter(|w| *w >= FAR));
        let fraction: f64 = if fraction.is_empty() { 0.0 } else { format!("0.{fraction}").parse().ok()? };
        // Hundred million seconds are three years: whoever goes back that far is not counted from the start.
        let since = whole?.checked_sub(start?)?;
        Some(since as f64 + fraction)
    }

    /// Seconds from what was read, and what was noticed; `stated` are the seconds per unit of the header.
    ///
    /// Where the header states no unit, the distance from 1970 tells it.
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
