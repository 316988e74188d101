//! Samples in order of their times, each once.

use std::collections::BTreeMap;

use deltatwin::monitoring::Sample;
use deltatwin::recording::sample_time;

/// Number of samples from which the sampling period is found.
const FIRST: usize = 64;
/// Step in time, in sampling periods, above which samples are missing.
const GAP: f64 = 1.5;
/// Time by which a sample may differ from the previous ones, s; more is another clock.
const LEAP: f64 = 60.0;
/// Number of successive samples of another clock after which it is taken over.
const PERSISTENT: usize = 200;
/// Largest number of samples that wait for missing ones.
const WAITING: usize = 200_000;

/// Numbers of samples by what became of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Passed on.
    pub taken: u64,
    /// Dropped because a sample of the same time was there already, or they came too late.
    pub doubled: u64,
    /// Missing between samples that were passed on.
    pub missing: u64,
    /// Dropped because their time is far from that of the others.
    pub astray: u64,
    /// Times that the clock of the machine was set anew.
    pub restarts: u64,
}

/// Puts samples in order. Where samples are missing it waits until the samples after them span [`Inbox::patience`]
/// seconds, then goes on without.
#[derive(Clone, Debug)]
pub struct Inbox {
    patience: f64,
    waiting: BTreeMap<i64, Sample>,
    /// Time of the last sample passed on, s.
    last: Option<f64>,
    dt: Option<f64>,
    /// Samples astray in a row.
    astray: Vec<Sample>,
    /// Added to the machine's times after its clock was set back, s.
    shift: f64,
    counts: Counts,
}

/// Time in ns: the same for a sample that came twice.
fn key(t: f64) -> i64 {
    (t * 1e9).round() as i64
}

impl Inbox {
    /// An empty inbox that waits for missing samples while later ones span less than `patience` seconds.
    pub fn new(patience: f64) -> Self {
        Self {
            patience,
            waiting: BTreeMap::new(),
            last: None,
            dt: None,
            astray: Vec::new(),
            shift: 0.0,
            counts: Counts::default(),
        }
    }

    /// Time of later samples for which it waits for missing ones, s.
    pub fn patience(&self) -> f64 {
        self.patience
    }

    /// What became of the samples so far.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Puts a sample in; it is passed on by [`Self::take`].
    pub fn put(&mut self, sample: Sample) {
        let sample = Sample { t: sample.t + self.shift, ..sample };
        let newest = self.waiting.last_key_value().map(|(_, s)| s.t).or(self.last);
        if newest.is_some_and(|newest| (sample.t - newest).abs() > LEAP) {
            self.lead_astray(sample);
            return;
        }
        self.counts.astray += self.astray.len() as u64;
        self.astray.clear();
        if self.last.is_some_and(|last| sample.t <= last) || self.waiting.insert(key(sample.t), sample).is_some() {
            self.counts.doubled += 1;
        }
    }

    /// Keeps a sample far from the others; enough of them in a row are a new clock.
    fn lead_astray(&mut self, sample: Sample) {
        if self.astray.last().is_some_and(|previous| (sample.t - previous.t).abs() > LEAP) {
            self.counts.astray += self.astray.len() as u64;
            self.astray.clear();
        }
        self.astray.push(sample);
        if self.astray.len() < PERSISTENT {
            return;
        }
        let held = std::mem::take(&mut self.astray);
        // Whatever waited belongs to the time before.
        let newest = self.waiting.last_key_value().map(|(_, s)| s.t).or(self.last).unwrap_or(0.0);
        self.last = None;
        let first = held.iter().map(|s| s.t).fold(f64::INFINITY, f64::min);
        // Times of the monitor increase: a clock that was set back goes on after what was there.
        let onward = if first < newest { newest + 1.0 - first } else { 0.0 };
        self.shift += onward;
        self.counts.restarts += 1;
        self.counts.missing += self.waiting.len() as u64;
        self.waiting.clear();
        self.waiting.extend(held.into_iter().map(|s| (key(s.t + onward), Sample { t: s.t + onward, ..s })));
    }

    /// Samples that are next in order, without a gap that may still be filled.
    pub fn take(&mut self) -> Vec<Sample> {
        if self.dt.is_none() && self.waiting.len() < FIRST {
            return Vec::new();
        }
        let dt = *self.dt.get_or_insert_with(|| sample_time(&self.waiting.values().map(|s| s.t).collect::<Vec<_>>()));
        let mut out = Vec::new();
        while let Some((&first, sample)) = self.waiting.first_key_value() {
            let gap = self.last.map_or(0.0, |last| sample.t - last);
            let newest = self.waiting.last_key_value().map_or(sample.t, |(_, s)| s.t);
            if gap > GAP * dt && newest - sample.t < self.patience && self.waiting.len() < WAITING {
                break;
            }
            self.pass(first, gap, dt, &mut out);
        }
        out
    }

    /// All samples that are left, in order.
    pub fn rest(&mut self) -> Vec<Sample> {
        let dt = self.dt.unwrap_or(f64::INFINITY);
        let mut out = Vec::new();
        while let Some((&first, sample)) = self.waiting.first_key_value() {
            let gap = self.last.map_or(0.0, |last| sample.t - last);
            self.pass(first, gap, dt, &mut out);
        }
        out
    }

    fn pass(&mut self, first: i64, gap: f64, dt: f64, out: &mut Vec<Sample>) {
        let Some(sample) = self.waiting.remove(&first) else { return };
        if gap > GAP * dt {
            self.counts.missing += (gap / dt).round() as u64 - 1;
        }
        self.last = Some(sample.t);
        self.counts.taken += 1;
        out.push(sample);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const DT: f64 = 0.01;

    fn sample(k: i64) -> Sample {
        Sample { t: DT * k as f64, q: [k as f64; 4], tau: [0.0; 4] }
    }

    fn numbers(samples: &[Sample]) -> Vec<i64> {
        samples.iter().map(|s| s.q[0] as i64).collect()
    }

    #[test]
    fn out_of_order_and_doubled_samples_come_out_once_in_order() {
        let mut inbox = Inbox::new(5.0);
        let order = (0..100).chain([103, 101, 102, 102, 50, 100, 104]);
        let mut out = Vec::new();
        for k in order {
            inbox.put(sample(k));
            out.extend(inbox.take());
        }
        assert_eq!(numbers(&out), (0..105).collect::<Vec<_>>());
        assert_eq!(inbox.counts(), Counts { taken: 105, doubled: 2, ..Counts::default() });
    }

    #[test]
    fn a_gap_is_waited_for_and_then_told() {
        let mut inbox = Inbox::new(1.0);
        (0..100).chain(150..240).for_each(|k| inbox.put(sample(k)));
        assert_eq!(inbox.take().len(), 100);
        (240..260).for_each(|k| inbox.put(sample(k)));
        assert_eq!(numbers(&inbox.take()), (150..260).collect::<Vec<_>>());
        assert_eq!(inbox.counts().missing, 50);
        inbox.put(sample(120));
        assert_eq!((inbox.take().len(), inbox.counts().doubled), (0, 1));
    }

    #[test]
    fn wrong_times_disturb_nothing_and_a_new_clock_is_taken_over() {
        let mut inbox = Inbox::new(1.0);
        (0..100).for_each(|k| inbox.put(sample(k)));
        assert_eq!(inbox.take().len(), 100);
        inbox.put(sample(1_000_000_000));
        (100..200).for_each(|k| inbox.put(sample(k)));
        assert_eq!((inbox.take().len(), inbox.counts().astray), (100, 1));
        // The controller was switched on again: its clock is far in the past.
        (0..500).for_each(|k| inbox.put(sample(k - 1_000_000)));
        let out = inbox.take();
        assert_eq!((out.len(), inbox.counts().restarts), (500, 1));
        assert!(out.windows(2).all(|w| w[1].t > w[0].t) && out[0].t > 2.0, "{:?}", out[0]);
    }

    proptest! {
        #[test]
        fn whatever_comes_times_increase(order in prop::collection::vec((-300i64..300, 0i64..4), 0..600)) {
            let mut inbox = Inbox::new(0.5);
            let mut out = Vec::new();
            for (k, far) in &order {
                inbox.put(sample(k + far * far * 100_000));
                out.extend(inbox.take());
            }
            out.extend(inbox.rest());
            prop_assert!(out.windows(2).all(|w| w[1].t > w[0].t));
            prop_assert_eq!(inbox.counts().taken, out.len() as u64);
        }
    }
}
