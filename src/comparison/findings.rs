//! Search for patterns in the residual of one channel: the mean first, then one cause at a time, each tested on the
//! residual of the previous ones.

use std::ops::Range;

use super::Finding;
use super::bursts::bursts;
use super::hysteresis::hysteresis;
use super::place::{Partition, reversal};
use super::spectrum::spectrum;
use crate::identification::Dataset;
use crate::machine::Unit;
use crate::recording::Channel;
use crate::text::significant;

/// Share of the mean square from which a pattern is reported.
const MIN_SHARE: f64 = 0.05;
/// Mean from which it is reported, in standard deviations of the noise.
const MIN_MEAN: f64 = 0.1;
/// Ratio by which the place in the workspace must explain more than any single quantity.
const WORKSPACE: f64 = 1.5;
/// Coloured share of the mean square from which it is reported if nothing else is.
const COLOURED: f64 = 0.2;
/// Ratio of the RMS near reversals to that elsewhere from which it is reported.
const LARGER: f64 = 1.3;
/// Number of terms of a drift in time.
const TREND: usize = 2;

/// Quantity on which a residual may depend.
struct Quantity {
    name: &'static str,
    symbol: &'static str,
    unit: &'static str,
    of: fn(&Dataset, usize, usize) -> f64,
}

const JOINT: [Quantity; 3] = [
    Quantity { name: "joint speed", symbol: "q̇", unit: "rad/s", of: |t, k, i| t.joints[k].qd[i] },
    Quantity { name: "joint angle", symbol: "q", unit: "rad", of: |t, k, i| t.joints[k].q[i] },
    Quantity { name: "joint acceleration", symbol: "q̈", unit: "rad/s²", of: |t, k, i| t.joints[k].qdd[i] },
];

/// Candidate cause with the residual after its removal.
struct Cause {
    finding: Finding,
    rest: Vec<f64>,
}

/// Findings about one channel; `platform` holds one position (m) per sample or is empty.
pub fn of_channel(
    channel: Channel,
    datasets: &[Dataset],
    platform: &[[f64; 3]],
    residual: Vec<f64>,
    noise: f64,
) -> Vec<Finding> {
    let whole = square(&residual);
    let mut search = Search { channel, datasets, platform, rest: residual, whole };
    let mut found = Vec::new();
    found.extend(search.mean(noise));
    while let Some(cause) = search.strongest() {
        // A quantity whose means are removed explains nothing more, so the search ends.
        search.rest = cause.rest;
        found.push(cause.finding);
    }
    let reversal = search.reversal();
    // What is loud at every reversal comes in bursts, too.
    if reversal.is_none() {
        found.extend(search.bursts());
    }
    found.extend(reversal);
    found.extend(search.tone());
    if found.is_empty() {
        found.extend(search.coloured());
    }
    found
}

fn square(x: &[f64]) -> f64 {
    x.iter().map(|v| v * v).sum()
}

struct Search<'a> {
    channel: Channel,
    datasets: &'a [Dataset],
    platform: &'a [[f64; 3]],
    /// Residual after the findings so far.
    rest: Vec<f64>,
    /// Sum of squares before any finding.
    whole: f64,
}

impl Search<'_> {
    fn unit(&self) -> Unit {
        self.channel.unit(self.datasets[0].mechanism)
    }

    /// Unit of the joint coordinate.
    fn joint_unit(&self) -> Unit {
        Channel::Angle(0).unit(self.datasets[0].mechanism)
    }

    fn finding(&self, place: &str, share: f64, what: String) -> Finding {
        let title = self.channel.title(self.datasets[0].mechanism);
        let sentence = format!("{title}: {:.0} % of the residual {what}", 100.0 * share);
        Finding { channel: self.channel, place: place.into(), share, sentence }
    }

    /// Conversion of a share of the present residual into a share of the original one.
    fn of_whole(&self, share: f64) -> f64 {
        share * square(&self.rest) / self.whole.max(f64::MIN_POSITIVE)
    }

    fn values(&self, of: &dyn Fn(&Dataset, usize) -> f64) -> Vec<f64> {
        self.datasets.iter().flat_map(|t| (0..t.len()).map(move |k| of(t, k))).collect()
    }

    /// Finding about a constant, which is removed.
    fn mean(&mut self, noise: f64) -> Option<Finding> {
        let n = self.rest.len().max(1) as f64;
        let mean = self.rest.iter().sum::<f64>() / n;
        let share = n * mean * mean / self.whole.max(f64::MIN_POSITIVE);
        if share < MIN_SHARE || mean.abs() < MIN_MEAN * noise {
            return None;
        }
        self.rest.iter_mut().for_each(|r| *r -= mean);
        let what = format!("is its mean: {mean:+.3} {} throughout", self.unit());
        Some(self.finding("mean", share, what))
    }

    /// Cause that explains most of the present residual; `None` below the smallest share.
    fn strongest(&self) -> Option<Cause> {
        let joints = JOINT.iter().map(|q| self.along(q));
        let simple = joints
            .chain([self.drift()])
            .chain(self.hysteresis())
            .max_by(|a, b| a.finding.share.total_cmp(&b.finding.share))?;
        let place = self.workspace().filter(|w| w.finding.share > WORKSPACE * simple.finding.share);
        Some(place.unwrap_or(simple)).filter(|cause| cause.finding.share >= MIN_SHARE)
    }

    fn without(&self, partition: &Partition, means: &[f64]) -> Vec<f64> {
        self.rest.iter().zip(&partition.bin).map(|(r, b)| r - means[*b]).collect()
    }

    /// Means along a quantity of the channel's own axis.
    fn along(&self, quantity: &Quantity) -> Cause {
        let axis = self.channel.limb();
        let x = self.values(&|t, k| (quantity.of)(t, k, axis));
        let partition = Partition::along(&x);
        let explained = partition.explain(&self.rest);
        let members = || partition.members(explained.bin).map(|i| x[i]);
        let (low, high) = members().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        let unit = quantity.unit.replace("rad", &self.joint_unit().to_string());
        let what = format!(
            "follows the {}: {:+.3} {} at {} {low:.2} to {high:.2} {unit}",
            quantity.name,
            explained.mean,
            self.unit(),
            quantity.symbol
        );
        let finding = self.finding(quantity.name, self.of_whole(explained.share), what);
        Cause { rest: self.without(&partition, &explained.means), finding }
    }

    /// Ranges of samples without gaps, over all recordings.
    fn segments(&self) -> Vec<Range<usize>> {
        let mut start = 0;
        let mut all = Vec::new();
        for dataset in self.datasets {
            all.extend(dataset.segments.iter().map(|s| start + s.start..start + s.end));
            start += dataset.len();
        }
        all
    }

    /// A force along the motion that builds up over the distance since the axis' last reversal.
    fn hysteresis(&self) -> Option<Cause> {
        let axis = self.channel.limb();
        let [position, rate] = [self.values(&|t, k| t.joints[k].q[axis]), self.values(&|t, k| t.joints[k].qd[axis])];
        let found = hysteresis(&position, &rate, &self.rest, &self.segments())?;
        let [first, far] = found.along;
        let what = format!(
            "is hysteresis: after a reversal it goes from {first:+.3} to {far:+.3} {} along the motion, half of it within {} {}",
            self.unit(),
            significant(found.distance, 2),
            self.joint_unit()
        );
        let finding = self.finding("hysteresis", self.of_whole(found.share), what);
        Some(Cause { rest: found.rest, finding })
    }

    /// Finding about short times in which the residual is much larger.
    fn bursts(&self) -> Option<Finding> {
        let dt = self.datasets.iter().map(|t| t.dt).fold(0.0, f64::max);
        let found = bursts(&self.rest, &self.segments(), dt)?;
        let (samples, rms) = &found.strongest;
        let mut start = samples.start;
        let dataset = self.datasets.iter().find(|t| {
            let inside = start < t.len();
            start -= if inside { 0 } else { t.len() };
            inside
        })?;
        let what = format!(
            "is in {}: the strongest of {rms:.3} {} RMS for {} s at {:.2} s of {}, {:.3} elsewhere",
            if found.count == 1 { "one burst".into() } else { format!("{} bursts", found.count) },
            self.unit(),
            significant(samples.len() as f64 * dt, 2),
            dataset.t[start],
            dataset.name,
            found.usual
        );
        let share = self.of_whole(found.share);
        (share >= MIN_SHARE).then(|| self.finding("bursts", share, what))
    }

    /// Drift over the recordings: a parabola in time.
    fn drift(&self) -> Cause {
        let t = self.values(&|dataset, k| dataset.t[k] - dataset.t[0]);
        let end = t.iter().copied().fold(0.0, f64::max).max(f64::MIN_POSITIVE);
        let legendre = |x: f64| [x, 0.5 * (3.0 * x * x - 1.0)];
        let features: Vec<[f64; TREND]> = t.iter().map(|t| legendre(2.0 * t / end - 1.0)).collect();
        let project = |p: usize| {
            let (a, b) =
                self.rest.iter().zip(&features).fold((0.0, 0.0), |(a, b), (r, f)| (a + r * f[p], b + f[p] * f[p]));
            a / b.max(f64::MIN_POSITIVE)
        };
        let beta = [project(0), project(1)];
        let at = |f: &[f64; TREND]| beta[0] * f[0] + beta[1] * f[1];
        let rest: Vec<f64> = self.rest.iter().zip(&features).map(|(r, f)| r - at(f)).collect();
        let share = (1.0 - square(&rest) / square(&self.rest).max(f64::MIN_POSITIVE)).max(0.0);
        let change = at(&legendre(1.0)) - at(&legendre(-1.0));
        let what = format!("drifts with time: by {change:+.3} {} in {end:.1} s", self.unit());
        Cause { finding: self.finding("time", self.of_whole(share), what), rest }
    }

    /// Means per cell of the workspace.
    fn workspace(&self) -> Option<Cause> {
        if self.platform.len() != self.rest.len() {
            return None;
        }
        let partition = Partition::cells(self.platform);
        let explained = partition.explain(&self.rest);
        let bounds = |k: usize| {
            let members = partition.members(explained.bin).map(|i| self.platform[i][k]);
            members.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)))
        };
        let range = |k: usize| {
            let (low, high) = bounds(k);
            format!("{low:.2}…{high:.2}")
        };
        let what = format!(
            "follows the place in the workspace: {:+.3} {} at x {}, y {}, z {} m",
            explained.mean,
            self.unit(),
            range(0),
            range(1),
            range(2)
        );
        let finding = self.finding("workspace", self.of_whole(explained.share), what);
        Some(Cause { rest: self.without(&partition, &explained.means), finding })
    }

    /// Finding about a larger residual near the axis' reversals than elsewhere.
    fn reversal(&self) -> Option<Finding> {
        let axis = self.channel.limb();
        let rate = self.values(&|t, k| t.joints[k].qd[axis]);
        let found = reversal(&rate, &self.rest)?;
        let share = self.of_whole(found.share);
        let what = format!(
            "is extra near reversals: RMS {:.3} {} below {:.2} {}/s, {:.3} elsewhere",
            found.rms[0],
            self.unit(),
            found.near,
            self.joint_unit(),
            found.rms[1]
        );
        let larger = found.rms[0] > LARGER * found.rms[1];
        (share >= MIN_SHARE && larger).then(|| self.finding("reversal", share, what))
    }

    /// Finding about a single frequency in the present residual.
    fn tone(&self) -> Option<Finding> {
        let (frequency, share) = self.spectrum()?.peak;
        let share = self.of_whole(share);
        (share >= MIN_SHARE).then(|| self.finding("frequency", share, format!("lies at {frequency:.1} Hz")))
    }

    /// Finding about a coloured residual, if there is no other.
    fn coloured(&self) -> Option<Finding> {
        let (frequency, share) = self.spectrum()?.coloured;
        (share >= COLOURED)
            .then(|| self.finding("frequency", share, format!("is no noise and lies below {frequency:.1} Hz")))
    }

    /// Spectrum of the present residual of the longest dataset.
    fn spectrum(&self) -> Option<super::spectrum::Spectrum> {
        let mut start = 0;
        let mut longest: Option<(&Dataset, usize)> = None;
        for dataset in self.datasets {
            if longest.is_none_or(|(other, _)| dataset.len() > other.len()) {
                longest = Some((dataset, start));
            }
            start += dataset.len();
        }
        let (dataset, start) = longest?;
        let longest = dataset.segments.iter().max_by_key(|s| s.len())?;
        spectrum(self.rest.get(start..start + dataset.len())?, &dataset.segments, dataset.period(longest))
    }
}
