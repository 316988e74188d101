//! Samples in order of their times, each once.

use std::collections::{BTreeMap, VecDeque};
use std::hash::{DefaultHasher, Hash, Hasher};

use deltatwin::monitoring::Sample;
use deltatwin::recording::sample_time;

use crate::stamped::{SECOND, Stamped};

/// Number of samples from which the sampling period is found.
const FIRST: usize = 64;
/// Step in time, in sampling periods, above which samples are missing.
const GAP: f64 = 1.5;
/// Time by which a sample may differ from the previous ones, ns; more is another clock.
const LEAP: i64 = 60 * SECOND;
/// Number of successive samples of another clock after which it is taken over.
const PERSISTENT: usize = 200;
/// Largest number of samples that wait for missing ones.
const WAITING: usize = 200_000;
/// Time on the machine's clock, ns, from which times count from the first second (three years): recordings hold times
/// below this one.
const DISTANT: i64 = 100_000_000 * SECOND;
/// Largest time since the first second to which a clock may leap forward, ns; one that leaps farther goes on after what
/// was there.
const FARTHEST: i64 = DISTANT / 2;

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
///
/// A clock that starts anew begins a new stretch behind the samples before it, a second later if it was set back. Its
/// samples are known from those that come again: these have been passed on, time and values.
#[derive(Clone, Debug)]
pub struct Inbox {
    patience: f64,
    waiting: BTreeMap<i64, Stamped>,
    /// Samples before a clock was set anew, in order, to be passed on.
    before: Vec<Sample>,
    /// Time of the last sample passed on, ns.
    last: Option<i64>,
    /// Times (ns) and digests of the samples of this clock that were passed on in the last [`LEAP`].
    passed: VecDeque<(i64, u64)>,
    /// Sampling period, s.
    dt: Option<f64>,
    /// Samples of another clock in a row.
    astray: Vec<Stamped>,
    /// Time on the machine's clock from which times count, ns; known from the first sample on.
    origin: Option<i64>,
    /// Added to the machine's times, ns.
    shift: i64,
    /// Whether the next sample is the first one of a new clock.
    is_new_clock: bool,
    counts: Counts,
}

/// What a sample is to the ones before.
enum Relation {
    /// The next, or one that was missing.
    New,
    /// The same one again, or one that comes too late.
    Doubled,
    /// It has the time of another sample: the clock is another one.
    Contrary,
}

fn digest(sample: &Stamped) -> u64 {
    let mut hasher = DefaultHasher::new();
    sample.q.iter().chain(&sample.tau).for_each(|x| x.to_bits().hash(&mut hasher));
    hasher.finish()
}

fn seconds(time: i64) -> f64 {
    time as f64 / SECOND as f64
}

impl Inbox {
    /// An empty inbox that waits for missing samples while later ones span less than `patience` seconds.
    pub fn new(patience: f64) -> Self {
        Self {
            patience,
            waiting: BTreeMap::new(),
            before: Vec::new(),
            last: None,
            passed: VecDeque::new(),
            dt: None,
            astray: Vec::new(),
            origin: None,
            shift: 0,
            is_new_clock: false,
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

    /// Time on the machine's clock from which the times of the samples count, ns: zero, or the whole second of the first
    /// sample on a clock that is far from zero, such as one that counts from 1970.
    pub fn origin(&self) -> i64 {
        self.origin.unwrap_or(0)
    }

    /// Puts a sample in; it is passed on by [`Self::take`].
    pub fn put(&mut self, sample: Stamped) {
        if self.origin.is_none() {
            self.begin(sample.time);
        }
        let sample = Stamped { time: sample.time.saturating_add(self.shift), ..sample };
        if self.newest().is_some_and(|newest| newest.abs_diff(sample.time) > LEAP as u64) {
            return self.lead_astray(sample);
        }
        match self.relation(&sample) {
            Relation::New => {
                self.counts.astray += self.astray.len() as u64;
                self.astray.clear();
                self.waiting.insert(sample.time, sample);
            }
            Relation::Doubled => self.counts.doubled += 1,
            Relation::Contrary => self.lead_astray(sample),
        }
    }

    /// Counts times from the whole second of the first one, if it is far from zero.
    fn begin(&mut self, first: i64) {
        let origin = if first.abs() < DISTANT { 0 } else { first.div_euclid(SECOND) * SECOND };
        (self.origin, self.shift) = (Some(origin), -origin);
    }

    /// Time of the newest sample, ns.
    fn newest(&self) -> Option<i64> {
        self.waiting.last_key_value().map(|(time, _)| *time).or(self.last)
    }

    fn relation(&self, sample: &Stamped) -> Relation {
        let same = |is_same: bool| if is_same { Relation::Doubled } else { Relation::Contrary };
        if self.last.is_none_or(|last| sample.time > last) {
            return self.waiting.get(&sample.time).map_or(Relation::New, |other| same(other == sample));
        }
        match self.passed.binary_search_by_key(&sample.time, |(time, _)| *time) {
            Ok(place) => same(self.passed[place].1 == digest(sample)),
            // Among samples of another clock, one that fits into a gap does so by chance.
            Err(place) => {
                let [before, after] = [place.checked_sub(1), Some(place)].map(|k| self.passed.get(k?));
                let gap = before.zip(after).map(|(before, after)| seconds(after.0 - before.0));
                same(self.astray.is_empty() && gap.is_some_and(|gap| gap > GAP * self.dt.unwrap_or(0.0)))
            }
        }
    }

    /// Keeps a sample of another clock; enough of them in a row are a clock that was set anew.
    fn lead_astray(&mut self, sample: Stamped) {
        if self.astray.last().is_some_and(|previous| previous.time.abs_diff(sample.time) > LEAP as u64) {
            self.counts.astray += self.astray.len() as u64;
            self.astray.clear();
        }
        self.astray.push(sample);
        if self.astray.len() < PERSISTENT {
            return;
        }
        let held = std::mem::take(&mut self.astray);
        let first = held.iter().map(|s| s.time).min().unwrap_or(0);
        let shift = self.shift;
        if self.dt.is_none() {
            // Nothing was passed on yet: what waits was left from before the machine was switched on.
            self.counts.astray += self.waiting.len() as u64;
            self.waiting.clear();
            self.begin(first.saturating_sub(shift));
        } else {
            // Whatever waited belongs to the time before, which is not filled any more.
            let rest = self.rest();
            self.before.extend(rest);
            let newest = self.last.unwrap_or(0);
            if first <= newest || first > FARTHEST {
                self.shift = self.shift.saturating_add(newest.saturating_sub(first).saturating_add(SECOND));
            }
            self.passed.clear();
            self.is_new_clock = true;
            self.counts.restarts += 1;
        }
        for sample in held {
            let time = sample.time.saturating_add(self.shift - shift);
            let known = self.waiting.insert(time, Stamped { time, ..sample });
            self.counts.doubled += u64::from(known.is_some());
        }
    }

    /// Samples that are next in order, without a gap that may still be filled.
    pub fn take(&mut self) -> Vec<Sample> {
        let mut out = std::mem::take(&mut self.before);
        if self.dt.is_none() && self.waiting.len() < FIRST {
            return out;
        }
        let times = || self.waiting.keys().map(|time| seconds(*time)).collect::<Vec<_>>();
        let dt = self.dt.unwrap_or_else(|| sample_time(&times()));
        self.dt = Some(dt);
        while let Some((&first, _)) = self.waiting.first_key_value() {
            let gap = self.gap(first);
            let newest = self.waiting.last_key_value().map_or(first, |(time, _)| *time);
            if gap > GAP * dt && seconds(newest - first) < self.patience && self.waiting.len() < WAITING {
                break;
            }
            self.pass(first, gap, dt, &mut out);
        }
        out
    }

    /// All samples that are left, in order.
    pub fn rest(&mut self) -> Vec<Sample> {
        self.counts.astray += std::mem::take(&mut self.astray).len() as u64;
        let dt = self.dt.unwrap_or(f64::INFINITY);
        let mut out = std::mem::take(&mut self.before);
        while let Some((&first, _)) = self.waiting.first_key_value() {
            let gap = self.gap(first);
            self.pass(first, gap, dt, &mut out);
        }
        out
    }

    /// Time since the last sample passed on, s; zero for the first one and for that of a new clock.
    fn gap(&self, time: i64) -> f64 {
        self.last.filter(|_| !self.is_new_clock).map_or(0.0, |last| seconds(time - last))
    }

    fn pass(&mut self, first: i64, gap: f64, dt: f64, out: &mut Vec<Sample>) {
        let Some(sample) = self.waiting.remove(&first) else { return };
        if gap > GAP * dt {
            self.counts.missing += (gap / dt).round() as u64 - 1;
        }
        self.last = Some(first);
        self.passed.push_back((first, digest(&sample)));
        while self.passed.front().is_some_and(|(time, _)| first - time > LEAP) {
            self.passed.pop_front();
        }
        self.is_new_clock = false;
        self.counts.taken += 1;
        out.push(Sample { t: seconds(first), q: sample.q, tau: sample.tau });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sample(k: i64) -> Stamped {
        Stamped { time: k * SECOND / 100, q: [k as f64; 4], tau: [0.0; 4] }
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

    #[test]
    fn a_clock_that_starts_anew_behind_a_gap_costs_no_sample() {
        // It starts far from what was there, or at the same times again.
        for anew in [-1_000_000, 0, 3] {
            let mut inbox = Inbox::new(60.0);
            (0..1_000).chain(1_500..5_000).for_each(|k| inbox.put(sample(k)));
            assert_eq!(inbox.take().len(), 1_000);
            let mut out = Vec::new();
            for k in 0..1_000 {
                inbox.put(Stamped { time: (k + anew) * SECOND / 100 + 1_000, ..sample(10_000 + k) });
                out.extend(inbox.take());
            }
            out.extend(inbox.rest());
            assert_eq!(numbers(&out), (1_500..5_000).chain(10_000..11_000).collect::<Vec<_>>(), "{anew}");
            assert!(out.windows(2).all(|w| w[1].t > w[0].t));
            assert_eq!(inbox.counts(), Counts { taken: 5_500, missing: 500, restarts: 1, ..Counts::default() });
        }
    }

    #[test]
    fn samples_that_come_again_are_no_new_clock() {
        let mut inbox = Inbox::new(1.0);
        (0..500).chain(700..1_000).for_each(|k| inbox.put(sample(k)));
        assert_eq!(inbox.take().len(), 800);
        // Sent again after a reconnection, together with what was missing.
        (100..1_100).for_each(|k| inbox.put(sample(k)));
        assert_eq!(numbers(&inbox.take()), (1_000..1_100).collect::<Vec<_>>());
        assert_eq!(inbox.counts(), Counts { taken: 900, doubled: 900, missing: 200, ..Counts::default() });
    }

    #[test]
    fn times_count_from_the_first_second_of_a_unix_clock() {
        let mut inbox = Inbox::new(1.0);
        let start = 1_795_510_000 * SECOND;
        // An old sample comes first, as a broker keeps it.
        inbox.put(Stamped { time: 5 * SECOND, ..sample(0) });
        (0..300).for_each(|k| inbox.put(Stamped { time: start + 250_000_000 + 400_001 * k, ..sample(k) }));
        let out = inbox.take();
        assert_eq!((inbox.origin(), out.len(), inbox.counts().astray), (start, 300, 1));
        assert_eq!((out[0].t, out[1].t), (0.25, 0.250400001));
        // The clock is set from zero to the time of day, and back.
        let mut inbox = Inbox::new(1.0);
        let clocks = [0, start, 0, start, -start, start].into_iter().zip(0..);
        let samples = clocks.flat_map(|(zero, n)| (0..300).map(move |k| (zero, 1_000 * n + k)));
        let mut out = Vec::new();
        for (zero, k) in samples {
            inbox.put(Stamped { time: zero + (k % 1_000) * SECOND / 100, ..sample(k) });
            out.extend(inbox.take());
        }
        assert_eq!((out.len(), inbox.counts().restarts, inbox.origin()), (1_800, 5, 0));
        assert!(out.windows(2).all(|w| w[1].t > w[0].t) && out[1_799].t < 30.0);
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
            let Counts { taken, doubled, astray, .. } = inbox.counts();
            prop_assert_eq!(taken, out.len() as u64);
            prop_assert_eq!(taken + doubled + astray, order.len() as u64);
        }
    }
}
