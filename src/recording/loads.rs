//! [`Loads`]: what was measured of the loads from outside.

use std::ops::Range;

use nalgebra::Vector3;

use super::{Channel, Signals};

/// Loads that were measured along a recording.
#[derive(Clone, Debug, Default)]
pub struct Loads {
    /// Times, s, increasing.
    t: Vec<f64>,
    /// Load of a single axis, N·m or N, then the force on the flange, N; empty where not measured.
    values: [Vec<f64>; 4],
}

/// Channels of [`Loads`], in order.
const CHANNELS: [Channel; 4] =
    [Channel::Load(0), Channel::FlangeForce(0), Channel::FlangeForce(1), Channel::FlangeForce(2)];

impl Loads {
    /// The loads in `signals`, at the times `t`, s, of its samples; `None` if there are none.
    pub fn of(signals: &Signals, t: &[f64]) -> Option<Self> {
        let values = CHANNELS.map(|channel| signals[channel].to_vec());
        values.iter().any(|series| !series.is_empty()).then(|| Self { t: t.to_vec(), values })
    }

    /// The loads averaged over ranges of samples of `t`, a value at the middle sample of each, as torques are averaged.
    pub fn averaged(&self, t: &[f64], blocks: &[Range<usize>]) -> Self {
        let middle = |block: &Range<usize>| t[block.start + block.len() / 2];
        let mean = |series: &Vec<f64>, block: &Range<usize>| {
            let sum: f64 = t[block.clone()].iter().map(|t| self.interpolated(series, *t)).sum();
            sum / block.len() as f64
        };
        let values = self.values.each_ref().map(|series| match series.is_empty() {
            true => Vec::new(),
            false => blocks.iter().map(|block| mean(series, block)).collect(),
        });
        Self { t: blocks.iter().map(middle).collect(), values }
    }

    /// Linear between samples, constant beyond the ends.
    fn interpolated(&self, series: &[f64], t: f64) -> f64 {
        let after = self.t.partition_point(|own| *own < t).min(self.t.len() - 1);
        let before = after.saturating_sub(1);
        let (from, to) = (self.t[before], self.t[after]);
        let share = if to > from { ((t - from) / (to - from)).clamp(0.0, 1.0) } else { 1.0 };
        series[before] + share * (series[after] - series[before])
    }

    /// Load of a single axis at time `t`, against positive motion, N·m or N; `None` where not measured.
    pub fn of_axis(&self, t: f64) -> Option<f64> {
        let series = &self.values[0];
        (!series.is_empty()).then(|| self.interpolated(series, t))
    }

    /// Force on the flange at time `t`, inertial axes, N; zero where not measured.
    pub fn on_flange(&self, t: f64) -> Vector3<f64> {
        let of = |k: usize| match &self.values[1 + k] {
            series if series.is_empty() => 0.0,
            series => self.interpolated(series, t),
        };
        Vector3::new(of(0), of(1), of(2))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::{Joint, Mechanism};

    #[test]
    fn loads_are_linear_between_samples_and_averaged_over_blocks() {
        let mut signals = Signals::new(Mechanism::axis(Joint::Revolute), vec![0.0, 1.0, 2.0, 4.0]);
        assert!(Loads::of(&signals, &signals.t).is_none());
        signals.set(Channel::Load(0), vec![1.0, 3.0, 2.0, 8.0]);
        let loads = Loads::of(&signals, &signals.t).unwrap();
        assert_eq!([-1.0, 0.5, 2.0, 3.0, 9.0].map(|t| loads.of_axis(t).unwrap()), [1.0, 2.0, 2.0, 5.0, 8.0]);
        assert_eq!(loads.on_flange(1.0), Vector3::zeros());
        let means = loads.averaged(&signals.t, &[0..2, 2..4]);
        assert_eq!([1.0, 4.0].map(|t| means.of_axis(t).unwrap()), [2.0, 5.0]);
    }
}
