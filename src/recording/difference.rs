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

/// A channel of a recording, as a function of the sample.
struct Channel<'a> {
    family: &'static str,
    name: String,
    unit: Unit,
    value: Box<dyn Fn(usize) -> f64 + 'a>,
}

impl Signals {
    /// The columns of all channels: name as in recordings, unit, values; missing channels are left out.
    pub fn columns(&self) -> Vec<(String, Unit, Vec<f64>)> {
        let of = |c: Channel| (c.name, c.unit, (0..self.len()).map(c.value).collect());
        channels(self).into_iter().map(of).collect()
    }
}

impl Recording {
    /// Largest absolute difference per family of channels, over the channels and samples that both recordings have.
    pub fn differences(&self, other: &Self) -> Vec<Difference> {
        let samples = self.signals.len().min(other.signals.len());
        let theirs = channels(&other.signals);
        let mut out: Vec<Difference> = Vec::new();
        for mine in channels(&self.signals) {
            let Some(theirs) = theirs.iter().find(|c| c.name == mine.name) else { continue };
            if out.last().is_none_or(|d| d.channel != mine.family) {
                out.push(Difference { channel: mine.family.into(), sample: 0, size: 0.0, unit: mine.unit });
            }
            let Some(worst) = out.last_mut() else { continue };
            for i in 0..samples {
                let size = ((mine.value)(i) - (theirs.value)(i)).abs();
                if size > worst.size {
                    (worst.sample, worst.size) = (i, size);
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
        let (mine, theirs) = (channels(&self.signals), channels(&other.signals));
        if let Some(c) = mine.iter().chain(&theirs).find(|c| {
            let has = |all: &[Channel]| all.iter().any(|d| d.name == c.name);
            !(has(&mine) && has(&theirs))
        }) {
            return Some(Difference { channel: c.name.clone(), sample: 0, size: f64::INFINITY, unit: c.unit });
        }
        let samples = self.signals.len().min(other.signals.len());
        for i in 0..samples {
            for (a, b) in mine.iter().zip(&theirs) {
                let (x, y) = ((a.value)(i), (b.value)(i));
                let same_time = a.family == "t" && (1e9 * x).round() == (1e9 * y).round();
                if x.to_bits() != y.to_bits() && !same_time {
                    return Some(Difference { channel: a.name.clone(), sample: i, size: (x - y).abs(), unit: a.unit });
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

fn channels(signals: &Signals) -> Vec<Channel<'_>> {
    fn add<'a>(
        out: &mut Vec<Channel<'a>>,
        family: &'static str,
        name: String,
        unit: Unit,
        value: impl Fn(usize) -> f64 + 'a,
    ) {
        out.push(Channel { family, name, unit, value: Box::new(value) });
    }
    let mut out = Vec::new();
    add(&mut out, "t", "t".into(), Unit::S, |i| signals.t[i]);
    let axes = [
        ("q", Unit::Rad, Some(&signals.q)),
        ("tau", Unit::NM, Some(&signals.tau)),
        ("qd", Unit::RadPerS, signals.qd.as_ref()),
        ("qdd", Unit::RadPerS2, signals.qdd.as_ref()),
        ("link_q", Unit::Rad, signals.link_q.as_ref()),
        ("link_qd", Unit::RadPerS, signals.link_qd.as_ref()),
    ];
    for (family, unit, values) in axes {
        for k in 0..signals.mechanism.axes() {
            if let Some(values) = values {
                add(&mut out, family, format!("{family}{}", k + 1), signals.mechanism.unit(unit), move |i| {
                    values[i][k]
                });
            }
        }
    }
    for (end, struts) in [("upper", &signals.strut_upper), ("lower", &signals.strut_lower)] {
        for (s, values) in struts.iter().enumerate() {
            if let Some(values) = values {
                add(&mut out, "strut force", format!("strut{}_{end}", s + 1), Unit::N, move |i| values[i]);
            }
        }
    }
    if let Some(ee) = &signals.ee {
        for (k, name) in ["ee_x", "ee_y", "ee_z"].into_iter().enumerate() {
            add(&mut out, "ee", name.into(), Unit::M, move |i| ee[i][k]);
        }
    }
    if let Some(margins) = &signals.socket_margin {
        for s in 0..12 {
            let end = if s < 6 { "upper" } else { "lower" };
            add(&mut out, "socket margin", format!("margin{}_{end}", s % 6 + 1), Unit::N, move |i| margins[i][s]);
        }
    }
    if let Some(multipliers) = &signals.multipliers {
        for (forces, family, unit) in [(true, "multiplier (force)", Unit::N), (false, "multiplier (moment)", Unit::NM)]
        {
            for (row, name) in super::multiplier_names().into_iter().enumerate() {
                if super::channels::is_force(row) == forces {
                    add(&mut out, family, name, unit, move |i| multipliers[i][row]);
                }
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::{Joint, Mechanism};

    #[test]
    fn columns_are_those_of_the_axes_that_there_are() {
        let signals = Signals {
            mechanism: Mechanism::axis(Joint::Prismatic),
            t: vec![0.0, 0.1],
            q: vec![[1.0, 9.0, 9.0, 9.0], [2.0, 9.0, 9.0, 9.0]],
            tau: vec![[3.0, 9.0, 9.0, 9.0], [4.0, 9.0, 9.0, 9.0]],
            ..Signals::default()
        };
        let expected = [
            ("t".to_string(), Unit::S, vec![0.0, 0.1]),
            ("q1".to_string(), Unit::M, vec![1.0, 2.0]),
            ("tau1".to_string(), Unit::N, vec![3.0, 4.0]),
        ];
        assert_eq!(signals.columns(), expected);
    }
}
