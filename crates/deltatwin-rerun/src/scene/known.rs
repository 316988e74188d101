//! What a viewer knows already, so that only changes are sent.

use std::collections::{BTreeMap, VecDeque};

/// The bits that were last sent of values that rarely change, and the end of the trail.
#[derive(Default)]
pub(super) struct Known {
    last: BTreeMap<String, u32>,
    /// Times, s, places, m, and colours of the trail of a stream.
    pub trail: VecDeque<(f64, [f32; 3], [u8; 3])>,
}

impl Known {
    /// The `values` of `entity` at `times` that differ from those before, with their times.
    pub fn changes(&mut self, entity: &str, times: &[f64], values: impl Iterator<Item = u32>) -> (Vec<f64>, Vec<u32>) {
        let mut last = self.last.get(entity).copied();
        let mut news = (Vec::new(), Vec::new());
        for (&t, value) in times.iter().zip(values) {
            if last != Some(value) {
                news.0.push(t);
                news.1.push(value);
                last = Some(value);
            }
        }
        if let Some(last) = last {
            self.last.insert(entity.to_string(), last);
        }
        news
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_stays_is_sent_once() {
        let mut known = Known::default();
        let mut sent = |entity: &str, values: [u32; 3]| known.changes(entity, &[0.0, 1.0, 2.0], values.into_iter());
        assert_eq!(sent("a", [5, 5, 6]), (vec![0.0, 2.0], vec![5, 6]));
        assert_eq!(sent("a", [6; 3]), (vec![], vec![]));
        assert_eq!(sent("b", [6; 3]), (vec![0.0], vec![6]));
    }
}
