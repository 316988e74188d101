//! [`Signals`]: the channels of a recording over time.

use std::ops::{Index, Range};

use super::{Channel, Series};
use crate::machine::{Joint, Mechanism, PerAxis, every_axis};

/// Sampled signals; all channels have the length of `t`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Signals {
    /// Kind of machine.
    pub mechanism: Mechanism,
    /// Instant of t = 0, ns since 1970-01-01 UTC; `None` if unknown.
    pub start: Option<i64>,
    /// Time, s.
    pub t: Vec<f64>,
    /// Index ranges without a gap in time that nothing bridges; filters process each range separately. Steps of time within
    /// one may differ.
    ///
    /// Empty means a single range; use [`Signals::stretches`].
    pub segments: Vec<Range<usize>>,
    /// The channels in their order; copies share the values until they are changed.
    series: Vec<(Channel, Series)>,
}

/// `N` channels of one quantity next to each other; those that are not recorded are empty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rows<'a, const N: usize>(pub [&'a [f64]; N]);

/// One series per axis.
pub type AxisRows<'a> = Rows<'a, { every_axis().end }>;

impl<'a, const N: usize> Rows<'a, N> {
    /// Values at sample `k`; zero where not recorded.
    pub fn at(&self, k: usize) -> [f64; N] {
        self.0.map(|series| series.get(k).copied().unwrap_or(0.0))
    }

    /// Values at all samples; none if nothing is recorded.
    pub fn iter(self) -> impl Iterator<Item = [f64; N]> + Clone + 'a {
        let samples = self.0.iter().map(|series| series.len()).max().unwrap_or(0);
        (0..samples).map(move |k| self.at(k))
    }

    /// Values of channel `k`; none if it is not recorded.
    pub fn series(&self, k: usize) -> &'a [f64] {
        self.0[k]
    }

    /// Whether none is recorded.
    pub fn is_empty(&self) -> bool {
        self.0.iter().all(|series| series.is_empty())
    }
}

impl Index<Channel> for Signals {
    type Output = [f64];

    /// The values of a channel; none if it is not recorded.
    fn index(&self, channel: Channel) -> &[f64] {
        self.get(channel).unwrap_or_default()
    }
}

impl Signals {
    /// Signals without channels at the times `t`, s.
    pub fn new(mechanism: Mechanism, t: Vec<f64>) -> Self {
        Self { mechanism, t, ..Self::default() }
    }

    /// Signals of the drives at the times `t`, s, with a row of angles (rad) and one of torques (N·m) per time.
    pub fn of_drives(mechanism: Mechanism, t: Vec<f64>, q: &[PerAxis<f64>], tau: &[PerAxis<f64>]) -> Self {
        let mut signals = Self::new(mechanism, t);
        signals.set_rows(Channel::Angle, q);
        signals.set_rows(Channel::Torque, tau);
        signals
    }

    /// Signals of a single axis whose rows are time (s), angle (rad or m) and torque (N·m or N).
    pub fn of_axis(joint: Joint, rows: &[[f64; 3]]) -> Self {
        let mut signals = Self::new(Mechanism::axis(joint), rows.iter().map(|row| row[0]).collect());
        signals.set(Channel::Angle(0), rows.iter().map(|row| row[1]).collect());
        signals.set(Channel::Torque(0), rows.iter().map(|row| row[2]).collect());
        signals
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.t.len()
    }

    /// Whether there are no samples.
    pub fn is_empty(&self) -> bool {
        self.t.is_empty()
    }

    fn place(&self, channel: Channel) -> Result<usize, usize> {
        self.series.binary_search_by_key(&channel, |(own, _)| *own)
    }

    /// The values of a channel; `None` if it is not recorded.
    pub fn get(&self, channel: Channel) -> Option<&[f64]> {
        self.place(channel).ok().map(|place| &*self.series[place].1)
    }

    /// The values of a channel without a copy of them; none if it is not recorded.
    pub fn share(&self, channel: Channel) -> Series {
        self.place(channel).map_or_else(|_| Series::default(), |place| self.series[place].1.clone())
    }

    /// The values of a channel, to be changed; `None` if it is not recorded.
    pub fn get_mut(&mut self, channel: Channel) -> Option<&mut [f64]> {
        self.place(channel).ok().map(|place| &mut *self.series[place].1)
    }

    /// Sets the values of a channel.
    pub fn set(&mut self, channel: Channel, values: Vec<f64>) {
        match self.place(channel) {
            Ok(place) => self.series[place].1 = values.into(),
            Err(place) => self.series.insert(place, (channel, values.into())),
        }
    }

    /// Sets the first channels of a quantity from rows of `N` values, those of a quantity of the axes as far as the
    /// machine has axes.
    pub fn set_rows<const N: usize>(&mut self, of: fn(usize) -> Channel, rows: &[[f64; N]]) {
        let count = if of(0).family().is_of_axes() { self.mechanism.axes() } else { N };
        for k in 0..count.min(N) {
            self.set(of(k), rows.iter().map(|row| row[k]).collect());
        }
    }

    /// The signals with the channels for which `keep` is true.
    pub fn only(&self, keep: impl Fn(Channel) -> bool) -> Self {
        let series = self.series.iter().filter(|(channel, _)| keep(*channel)).cloned().collect();
        Self { series, t: self.t.clone(), segments: self.segments.clone(), ..*self }
    }

    /// The first `N` channels of a quantity.
    pub fn rows<const N: usize>(&self, of: fn(usize) -> Channel) -> Rows<'_, N> {
        Rows(std::array::from_fn(|k| &self[of(k)]))
    }

    /// Joint angles (φ1, φ2, φ3, ψ), rad.
    pub fn q(&self) -> AxisRows<'_> {
        self.rows(Channel::Angle)
    }

    /// Drive torques at the gear output, N·m.
    pub fn tau(&self) -> AxisRows<'_> {
        self.rows(Channel::Torque)
    }

    /// The recorded drive torques, N·m, to be changed.
    pub fn torques_mut(&mut self) -> impl Iterator<Item = &mut Series> {
        self.series_mut().filter_map(|(channel, values)| channel.drive().map(|_| values))
    }

    /// All channels with their values, in order.
    pub fn series(&self) -> impl Iterator<Item = (Channel, &[f64])> {
        self.series.iter().map(|(channel, values)| (*channel, &**values))
    }

    /// All channels with their values, in order, to be changed.
    pub fn series_mut(&mut self) -> impl Iterator<Item = (Channel, &mut Series)> {
        self.series.iter_mut().map(|(channel, values)| (*channel, values))
    }

    /// Index ranges of the segments, at least one unless there are no samples.
    pub fn stretches(&self) -> Vec<Range<usize>> {
        if self.segments.is_empty() && !self.is_empty() {
            std::iter::once(0..self.len()).collect()
        } else {
            self.segments.clone()
        }
    }

    /// The samples of `range`, with the same channels, as a single segment.
    ///
    /// # Panics
    /// If `range` exceeds the samples.
    pub fn part(&self, range: Range<usize>) -> Self {
        let series = self.series.iter().map(|(channel, own)| (*channel, own.window(&range))).collect();
        Self { series, start: self.start, ..Self::new(self.mechanism, self.t[range.clone()].to_vec()) }
    }

    /// Appends the samples of `later`, which has the same channels unless there are no samples yet.
    pub fn extend(&mut self, later: Self) {
        if self.is_empty() {
            *self = later;
            return;
        }
        self.t.extend(later.t);
        for ((_, own), (_, later)) in self.series.iter_mut().zip(later.series) {
            own.extend(later.iter().copied());
        }
    }

    /// Removes and returns the first `count` samples.
    ///
    /// # Panics
    /// If there are fewer.
    pub fn split_off_front(&mut self, count: usize) -> Self {
        let front = self.part(0..count);
        self.t.drain(..count);
        // No window, which would keep what is removed.
        self.series.iter_mut().for_each(|(_, own)| *own = own[count..].to_vec().into());
        front
    }

    /// Median sampling period, s; zero with fewer than two samples.
    pub fn sample_time(&self) -> f64 {
        sample_time(&self.t)
    }
}

/// Largest relative deviation of a sampling step from the period that counts as even.
const JITTER: f64 = 0.01;

/// Whether all steps of the times `t` are the sampling period `dt`, to within a hundredth of it.
pub fn is_even(t: &[f64], dt: f64) -> bool {
    t.windows(2).all(|w| (w[1] - w[0] - dt).abs() <= JITTER * dt)
}

/// Median step of the times `t`, s, of two the greater; zero with fewer than two times.
pub fn sample_time(t: &[f64]) -> f64 {
    let mut steps: Vec<f64> = t.windows(2).map(|w| w[1] - w[0]).collect();
    if steps.is_empty() {
        return 0.0;
    }
    let middle = steps.len() / 2;
    *steps.select_nth_unstable_by(middle, f64::total_cmp).1
}
