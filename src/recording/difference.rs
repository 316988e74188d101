//! Differences between two recordings of the same run.

use super::{Recording, Signals};
use crate::machine::Unit;

/// A difference in one channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    /// Channel, e.g. `tau2`, or a family such as `tau`.
    pub channel: String,
    /// Sample, from 0.
    pub sample: usize,
    /// Absolute difference, in `unit`; infinite if the channel or the sample is missing in one recording.
    pub size: f64,
    /// Unit.
    pub unit: Unit,
}

impl Signals {
    /// The columns of all channels, after the time: name as in recordings, unit, values.
    pub fn columns(&self) -> Vec<(String, Unit, &[f64])> {
        let time = ("t".to_string(), Unit::S, self.t.as_slice());
        let others = self.series().map(|(channel, values)| (channel.to_string(), channel.unit(self.mechanism), values));
        std::iter::once(time).chain(others).collect()
    }
}

impl Recording {
    /// Largest absolute difference per quantity, over the channels and samples that both recordings have.
    pub fn differences(&self, other: &Self) -> Vec<Difference> {
        let mut out: Vec<Difference> = Vec::new();
        let time = [("t", Unit::S, self.signals.t.as_slice(), other.signals.t.as_slice())];
        let others = self.signals.series().filter_map(|(channel, mine)| {
            let unit = channel.unit(self.signals.mechanism);
            Some((channel.quantity(), unit, mine, other.signals.get(channel)?))
        });
        for (quantity, unit, mine, theirs) in time.into_iter().chain(others) {
            let known = out.iter().position(|d| d.channel == quantity).unwrap_or_else(|| {
                out.push(Difference { channel: quantity.into(), sample: 0, size: 0.0, unit });
                out.len() - 1
            });
            for (i, (a, b)) in mine.iter().zip(theirs).enumerate() {
                let size = (a - b).abs();
                if size > out[known].size {
                    (out[known].sample, out[known].size) = (i, size);
                }
            }
        }
        out
    }

    /// The first sample at which the recordings differ, bit for bit; a missing channel or sample counts as a
    /// difference.
    ///
    /// Times are compared after rounding to the nanosecond, the resolution of MCAP.
    pub fn first_difference(&self, other: &Self) -> Option<Difference> {
        let (mine, theirs) = (self.signals.columns(), other.signals.columns());
        let lone = |all: &[(String, Unit, &[f64])], name: &str| all.iter().all(|(own, ..)| own != name);
        if let Some((name, unit, _)) =
            mine.iter().chain(&theirs).find(|(name, ..)| lone(&mine, name) || lone(&theirs, name))
        {
            return Some(Difference { channel: name.clone(), sample: 0, size: f64::INFINITY, unit: *unit });
        }
        let samples = self.signals.len().min(other.signals.len());
        for i in 0..samples {
            for ((name, unit, a), (_, _, b)) in mine.iter().zip(&theirs) {
                let (x, y) = (a[i], b[i]);
                let same_time = name == "t" && (1e9 * x).round() == (1e9 * y).round();
                if x.to_bits() != y.to_bits() && !same_time {
                    return Some(Difference { channel: name.clone(), sample: i, size: (x - y).abs(), unit: *unit });
                }
            }
        }
        (self.signals.len() != other.signals.len()).then(|| Difference {
            channel: "t".into(),
            sample: samples,
            size: f64::INFINITY,
            unit: Unit::S,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::{Joint, Mechanism};
    use crate::recording::Channel;

    #[test]
    fn columns_are_those_of_the_axes_that_there_are() {
        let mut signals = Signals::new(Mechanism::axis(Joint::Prismatic), vec![0.0, 0.1]);
        signals.set_rows(Channel::Angle, &[[1.0, 9.0, 9.0, 9.0], [2.0, 9.0, 9.0, 9.0]]);
        signals.set_rows(Channel::Torque, &[[3.0, 9.0, 9.0, 9.0], [4.0, 9.0, 9.0, 9.0]]);
        let expected = [
            ("t".to_string(), Unit::S, &[0.0, 0.1][..]),
            ("q1".to_string(), Unit::M, &[1.0, 2.0][..]),
            ("tau1".to_string(), Unit::N, &[3.0, 4.0][..]),
        ];
        assert_eq!(signals.columns(), expected);
    }
}
