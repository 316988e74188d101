//! [`Series`]: the values of a channel, without a copy of them in each window.

use std::ops::{Deref, DerefMut, Range};
use std::sync::Arc;

/// Values at successive samples; copies and windows share them until they are changed.
#[derive(Clone, Default)]
pub struct Series {
    all: Arc<Vec<f64>>,
    within: Range<usize>,
}

impl Series {
    /// The values at the samples of `range`.
    ///
    /// # Panics
    /// If `range` exceeds the series.
    pub fn window(&self, range: &Range<usize>) -> Self {
        assert!(range.start <= range.end && range.end <= self.len(), "{range:?} of {} values", self.len());
        let first = self.within.start;
        Self { all: self.all.clone(), within: first + range.start..first + range.end }
    }

    /// The values in a vector of their own, without what lies outside the window.
    fn own(&mut self) -> &mut Vec<f64> {
        if self.within.len() < self.all.len() {
            *self = self.to_vec().into();
        }
        Arc::make_mut(&mut self.all)
    }

    /// Appends a value.
    pub fn push(&mut self, value: f64) {
        self.extend([value]);
    }

    /// The values at the samples of all `ranges`, one after another; none of an empty series.
    ///
    /// # Panics
    /// If a range exceeds the series.
    pub fn pieces(&self, ranges: &[Range<usize>]) -> Self {
        match ranges {
            _ if self.is_empty() => Self::default(),
            [range] => self.window(range),
            _ => ranges.iter().flat_map(|range| &self[range.clone()]).copied().collect(),
        }
    }
}

impl Deref for Series {
    type Target = [f64];

    fn deref(&self) -> &[f64] {
        &self.all[self.within.clone()]
    }
}

impl DerefMut for Series {
    fn deref_mut(&mut self) -> &mut [f64] {
        self.own()
    }
}

impl From<Vec<f64>> for Series {
    fn from(values: Vec<f64>) -> Self {
        Self { within: 0..values.len(), all: Arc::new(values) }
    }
}

impl FromIterator<f64> for Series {
    fn from_iter<I: IntoIterator<Item = f64>>(values: I) -> Self {
        values.into_iter().collect::<Vec<_>>().into()
    }
}

impl Extend<f64> for Series {
    fn extend<I: IntoIterator<Item = f64>>(&mut self, values: I) {
        self.own().extend(values);
        self.within.end = self.all.len();
    }
}

impl<'a> IntoIterator for &'a Series {
    type Item = &'a f64;
    type IntoIter = std::slice::Iter<'a, f64>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}

impl PartialEq for Series {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl std::fmt::Debug for Series {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        (**self).fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_shares_its_values_until_one_of_both_changes() {
        let whole = Series::from(vec![1.0, 2.0, 3.0, 4.0]);
        let mut window = whole.window(&(1..4)).window(&(1..3));
        assert_eq!((&*window, window.as_ptr()), (&[3.0, 4.0][..], whole[2..].as_ptr()));
        window[0] = 5.0;
        window.extend([6.0]);
        assert_eq!((&*whole, &*window), (&[1.0, 2.0, 3.0, 4.0][..], &[5.0, 4.0, 6.0][..]));
        assert_eq!(&*whole.pieces(&[0..1, 3..4]), [1.0, 4.0]);
    }
}
