//! A share of the runs of a study.

use std::fmt;
use std::ops::Range;
use std::str::FromStr;

/// Chunk `number` of `of` chunks, both from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Chunk {
    number: u64,
    of: u64,
}

/// Largest number of chunks.
const MOST: u64 = 99_999;

impl Chunk {
    /// All runs.
    pub const WHOLE: Self = Self { number: 1, of: 1 };

    /// Chunk `number` of `of`; `None` unless 1 ≤ `number` ≤ `of` ≤ 99 999.
    pub fn new(number: u64, of: u64) -> Option<Self> {
        ((1..=of).contains(&number) && of <= MOST).then_some(Self { number, of })
    }

    /// Number of chunks.
    pub fn of(self) -> u64 {
        self.of
    }

    /// The runs of this chunk out of `runs`: contiguous, and all chunks together are all runs, each once.
    pub fn range(self, runs: u64) -> Range<u64> {
        let bound = |k: u64| (u128::from(k) * u128::from(runs) / u128::from(self.of)) as u64;
        bound(self.number - 1)..bound(self.number)
    }

    /// Name of the chunk's files, `00002-of-00007`.
    pub fn stem(self) -> String {
        format!("{:05}-of-{:05}", self.number, self.of)
    }
}

impl fmt::Display for Chunk {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.of)
    }
}

impl FromStr for Chunk {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split_once('/').and_then(|(k, n)| Some((k.parse().ok()?, n.parse().ok()?)));
        numbers
            .and_then(|(number, of)| Self::new(number, of))
            .ok_or_else(|| format!("expected K/N with 1 ≤ K ≤ N ≤ {MOST}, such as 2/7"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_are_all_runs_once() {
        for (runs, of) in [(0, 1), (1, 7), (7, 7), (100, 7), (10_000, 3), (u64::MAX, 99_999)] {
            let ranges: Vec<_> = (1..=of).map(|k| Chunk::new(k, of).unwrap().range(runs)).collect();
            assert_eq!((ranges[0].start, ranges[of as usize - 1].end), (0, runs));
            assert!(ranges.windows(2).all(|w| w[0].end == w[1].start));
            let sizes = ranges.iter().map(|r| r.end - r.start);
            assert!(sizes.clone().max().unwrap() - sizes.min().unwrap() <= 1);
        }
    }

    #[test]
    fn chunks_are_written_as_fractions() {
        let chunk: Chunk = "2/7".parse().unwrap();
        assert_eq!((chunk.to_string().as_str(), chunk.stem().as_str()), ("2/7", "00002-of-00007"));
        for wrong in ["", "2", "0/7", "8/7", "1/0", "a/b", "1/100000", "-1/2"] {
            assert!(wrong.parse::<Chunk>().is_err(), "{wrong}");
        }
    }
}
