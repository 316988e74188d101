//! Findings about a recording alone, without a model: torques that follow no motion, of the wrong sign, without noise,
//! copies of columns, coarse numbers, and lines near half the sampling frequency.

use super::{Evidence, Finding, Problem, Remedy};
use crate::effects::smooth_sign;
use crate::evidence::noise::{correlation_time, difference_sigma};
use crate::identification::Dataset;
use crate::identification::filtering::noise_level;
use crate::identification::initial::quantum;
use crate::identification::least_squares::least_squares;
use crate::identification::residuals::rms;
use crate::machine::{Joint, Mechanism};
use crate::model::Model;
use crate::numerics::{deviation, fourier, median};
use crate::recording::{Channel, Recording};
use crate::text::significant;

/// Largest number of instants of a regression.
const INSTANTS: usize = 5000;
/// Share of a torque's variance that the motion of all axes must explain.
const FOLLOWS: f64 = 0.2;
/// Share of a channel's noise that its difference from a copy has at most; of independent noise at least all.
const SHARED: f64 = 0.3;
/// Residual of a channel on another, relative to its variation, above which it is no copy: a correlation below 0.9995.
const UNLIKE: f64 = 0.03;
/// Standard errors beyond which inertia and friction both below zero are a wrong sign.
const NEGATIVE: f64 = 10.0;
/// Ratio of the torque's noise to its RMS below which it is no measurement.
const NOISELESS: f64 = 1e-5;
/// The same of an angle's noise to its travel.
const NOISELESS_ANGLE: f64 = 1e-10;
/// Number of steps over the travel below which angles are coarse, and over its range for torques.
const STEPS: (f64, f64) = (1000.0, 100.0);
/// Ratio of a line near half the sampling frequency to the median there, share of the variance in it, and the part of
/// the spectrum that counts as near.
const LINE: (f64, f64, f64) = (200.0, 0.02, 0.9);
/// Least travel, rad, and share of the variance that a weight must explain of a torque that carries it alone.
const WEIGHT: (f64, f64) = (0.3, 0.9);
/// Standard errors from which the inertia shows, and share of the exchanged work that friction takes at least.
const SHOWN: f64 = 4.0;
const LOST: f64 = 0.01;
/// Share of the time at rest from which it is told.
const STANDING: f64 = 0.02;
/// Speed of friction's change of sign relative to the largest.
const SLOW: f64 = 0.01;
/// Largest angle of a lone axis, rad, and distance of both ends from a multiple of 15, from which degrees are suspected.
const DEGREES: (f64, f64) = (20.0, 0.02);

/// Findings about a recording that need no model; none prevents a fit.
pub fn inspect(recording: &Recording, dataset: &Dataset) -> Vec<Finding> {
    if dataset.is_empty() {
        return Vec::new();
    }
    let alone = Alone { recording, dataset };
    let axes = recording.signals.mechanism.axes();
    let mut found: Vec<Finding> = (0..axes).flat_map(|i| alone.axis(i)).collect();
    found.extend(alone.degrees());
    found.extend(alone.repeated());
    found
}

/// Findings about motors that turn so fast that the ripple of their torque is folded: its second harmonic, twice the
/// motor's frequency, is above half the sampling frequency.
pub fn folded(model: &Model, dataset: &Dataset) -> Vec<Finding> {
    let Some(mechanism) = dataset.dt.gt(&0.0).then_some(model.mechanism) else { return Vec::new() };
    let one = |axis: usize| {
        let fastest = dataset.joints.iter().map(|j| j.qd[axis].abs()).fold(0.0, f64::max);
        let gear = model.drives[axis].gear_ratio;
        let (ripple, half) = (2.0 * gear * fastest / std::f64::consts::TAU, 0.5 / dataset.dt);
        // An unknown gear, 1, says nothing about a motor.
        (ripple > half && gear != 1.0).then(|| Finding {
            recording: dataset.name.clone(),
            axis: Some(axis),
            problem: Problem::Alias,
            severe: false,
            evidence: Evidence { value: Some((ripple, 0.0)), ..Evidence::default() },
            sentence: format!(
                "the motor of axis {} turns so fast that the second harmonic of its ripple reaches {} Hz, above half the \
                 sampling frequency ({} Hz): it shows at wrong frequencies",
                axis + 1,
                significant(ripple, 3),
                significant(half, 3)
            ),
            remedy: Remedy::Words("a faster recording, or slower motion"),
        })
    };
    (0..mechanism.axes().min(dataset.channels.len())).filter_map(one).collect()
}

struct Alone<'a> {
    recording: &'a Recording,
    dataset: &'a Dataset,
}

impl Alone<'_> {
    fn finding(&self, axis: impl Into<Option<usize>>, problem: Problem, sentence: String, remedy: Remedy) -> Finding {
        Finding {
            recording: self.dataset.name.clone(),
            axis: axis.into(),
            problem,
            severe: false,
            evidence: Evidence::default(),
            sentence,
            remedy,
        }
    }

    fn axis(&self, axis: usize) -> Vec<Finding> {
        let torque = &self.dataset.measured[axis];
        let moves = self.range(|k| self.dataset.joints[k].qd[axis]) > 0.0;
        if !moves || deviation(torque) == 0.0 {
            return Vec::new();
        }
        let noiseless = self.noiseless(axis);
        let unrelated = self.unrelated(axis);
        let first = unrelated.or_else(|| self.weight_alone(axis)).or_else(|| self.sign(axis));
        let rest =
            [noiseless, self.coarse_angle(axis), self.coarse_torque(axis), self.alias(axis), self.standstill(axis)];
        first.into_iter().chain(rest.into_iter().flatten()).collect()
    }

    fn range(&self, of: impl Fn(usize) -> f64) -> f64 {
        let (low, high) =
            (0..self.dataset.len()).map(of).fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
        high - low
    }

    /// A torque that the motion of all axes does not explain.
    fn unrelated(&self, axis: usize) -> Option<Finding> {
        let at = instants(self.dataset);
        let mechanism = self.recording.signals.mechanism;
        let mut features = vec![vec![1.0; at.len()]];
        for other in 0..mechanism.axes() {
            features.extend(motion(self.dataset, other, &at));
            let angles: Vec<f64> = at.iter().map(|&k| self.dataset.joints[k].q[other]).collect();
            features.push(angles.iter().map(|q| q.sin()).collect());
            features.push(angles.iter().map(|q| q.cos()).collect());
            features.push(angles);
        }
        let torque: Vec<f64> = at.iter().map(|&k| self.dataset.measured[axis][k]).collect();
        let columns: Vec<&[f64]> = features.iter().map(Vec::as_slice).collect();
        let fit = least_squares(&columns, &torque)?;
        let explained = 1.0 - fit.mean_square / deviation(&torque).powi(2).max(f64::MIN_POSITIVE);
        let noise = difference_sigma(&self.dataset.measured[axis], &self.dataset.segments, 4).unwrap_or(0.0);
        let k = axis + 1;
        let unit = Channel::Torque(axis).unit(self.dataset.mechanism);
        (explained < FOLLOWS).then(|| {
            let seen = format!(
                "of its variation ({} {unit} RMS) the motion explains {:.0} %",
                significant(deviation(&torque), 3),
                100.0 * explained.max(0.0)
            );
            let (why, remedy) = if noise > 0.7 * deviation(&torque) {
                (
                    "it is noise: the axis was moved by hand or from outside, or its drive was off",
                    "a run that the drives drive",
                )
            } else {
                (
                    "something from outside moves the axis, or the column is another one",
                    "a look at the columns, and a run without contact",
                )
            };
            self.finding(
                axis,
                Problem::Unrelated,
                format!("the torque of axis {k} follows no motion: {seen}; {why}"),
                Remedy::Words(remedy),
            )
        })
    }

    /// Channels that are another one times a factor. Signals of two sensors may follow one motion, but each has noise of
    /// its own: their difference then has more of it than either.
    fn repeated(&self) -> Vec<Finding> {
        let Dataset { measured, channels, segments, .. } = self.dataset;
        let noise = |series: &[f64]| difference_sigma(series, segments, 4).unwrap_or(0.0);
        let at = instants(self.dataset);
        let ones = vec![1.0; at.len()];
        let seen: Vec<Vec<f64>> = measured.iter().map(|series| at.iter().map(|&k| series[k]).collect()).collect();
        let copies = |one: usize, other: usize| {
            let fit = least_squares(&[&ones, &seen[one]], &seen[other])?;
            if fit.mean_square > (UNLIKE * deviation(&seen[other])).powi(2) {
                return None;
            }
            // Noise is seen in differences of neighbours, at all samples.
            let (x, y) = (&measured[one], &measured[other]);
            let rest: Vec<f64> = y.iter().zip(x).map(|(y, x)| y - fit.beta[1] * x).collect();
            let own = noise(y);
            let is_copy = own > NOISELESS * rms(y) && noise(&rest) < SHARED * own;
            is_copy.then(|| {
                let (first, second) = (channels[one], channels[other]);
                let factor = significant(fit.beta[1], 4);
                let sentence = format!(
                    "{second} is {first} times {factor}, noise included: the two columns are one signal, not two sensors"
                );
                let remedy = Remedy::Words("the column of the second sensor, or none: leave the copy out");
                self.finding(second.drive(), Problem::Repeated, sentence, remedy)
            })
        };
        let pairs = (0..channels.len()).flat_map(|other| (0..other).map(move |one| (one, other)));
        pairs.filter_map(|(one, other)| copies(one, other)).collect()
    }

    /// A torque of a lone revolute axis that carries its weight and nothing else.
    fn weight_alone(&self, axis: usize) -> Option<Finding> {
        carries_weight_alone(self.recording.signals.mechanism, self.dataset).then(|| {
            let sentence = format!(
                "the torque of axis {} follows its angle alone, without inertia and friction: the drive carries the \
                 weight while something else moves the axis",
                axis + 1
            );
            self.finding(axis, Problem::WeightAlone, sentence, Remedy::Words("a run that the drive moves"))
        })
    }

    /// Samples of a single axis that were left out because it stands; those of a robot are left out near reversals.
    fn standstill(&self, axis: usize) -> Option<Finding> {
        let is_single = matches!(self.recording.signals.mechanism, Mechanism::Axis(_));
        let share = self.dataset.left_out;
        (is_single && share > STANDING).then(|| {
            let sentence = format!(
                "axis {} stands for {:.0} % of the time: static friction takes any value there, so these samples are left out",
                axis + 1,
                100.0 * share
            );
            self.finding(axis, Problem::Standstill, sentence, Remedy::Words("none needed"))
        })
    }

    /// Inertia and friction of a lone axis both below zero.
    fn sign(&self, axis: usize) -> Option<Finding> {
        if !matches!(self.recording.signals.mechanism, Mechanism::Axis(_)) {
            return None;
        }
        let at = instants(self.dataset);
        let [acceleration, rate, sign] = motion(self.dataset, axis, &at);
        let angles: Vec<f64> = at.iter().map(|&k| self.dataset.joints[k].q[axis]).collect();
        let [sine, cosine] = [f64::sin, f64::cos].map(|f| angles.iter().map(|q| f(*q)).collect::<Vec<f64>>());
        let torque: Vec<f64> = at.iter().map(|&k| self.dataset.measured[axis][k]).collect();
        let fit = least_squares(&[&acceleration, &rate, &sign, &vec![1.0; at.len()], &sine, &cosine], &torque)?;
        let negative = |k: usize| fit.beta[k] < -NEGATIVE * fit.std[k];
        // Friction alone is the surest: its work is lost in every direction.
        let work: f64 = torque.iter().zip(&rate).map(|(t, v)| t * v).sum();
        let wrong = negative(0) && (negative(1) || negative(2)) && work < 0.0;
        wrong.then(|| {
            let sentence = format!(
                "the torque of axis {} has the other sign: inertia {} and friction {} come out negative",
                axis + 1,
                significant(fit.beta[0], 3),
                significant(fit.beta[if negative(2) { 2 } else { 1 }], 3),
            );
            let k = axis + 1;
            self.finding(axis, Problem::TorqueSign, sentence, Remedy::Map(vec![format!("tau{k}=-tau{k}")]))
        })
    }

    /// A torque that is smoother than any measurement, beside angles that are measured; a simulation without noise in
    /// either is nothing to warn of.
    fn noiseless(&self, axis: usize) -> Option<Finding> {
        let torque = &self.dataset.measured[axis];
        let noise = difference_sigma(torque, &self.dataset.segments, 6)?;
        let size = rms(torque);
        let angles = &self.recording.signals[Channel::Angle(axis)];
        let travel = range(angles);
        if noise_level(&[angles.to_vec()]) < NOISELESS_ANGLE * travel {
            return None;
        }
        (noise < NOISELESS * size && quantum(&[torque]).is_none()).then(|| {
            let k = axis + 1;
            let share = significant(noise / size, 1);
            let sentence = format!(
                "the torque of axis {k} has no noise ({share} of its RMS): a command, a feed-forward or a calculation, not a measurement"
            );
            self.finding(axis, Problem::Noiseless, sentence, Remedy::Words("the torque or current that the drive measures"))
        })
    }

    fn coarse_angle(&self, axis: usize) -> Option<Finding> {
        let q = &self.recording.signals[Channel::Angle(axis)];
        let travel = range(q);
        let step = quantum(&[q]).filter(|step| travel / step < STEPS.0)?;
        let unit = Channel::Angle(axis).unit(self.dataset.mechanism);
        let sentence = format!(
            "the angle of axis {} has steps of {} {unit}, {:.0} over its travel: accelerations are coarse",
            axis + 1,
            significant(step, 3),
            travel / step
        );
        let remedy = Remedy::Words("more digits or a finer encoder, or a longer travel");
        Some(self.finding(axis, Problem::Quantised, sentence, remedy))
    }

    fn coarse_torque(&self, axis: usize) -> Option<Finding> {
        let tau = &self.recording.signals[Channel::Torque(axis)];
        let step = quantum(&[tau]).filter(|step| range(tau) / step < STEPS.1)?;
        let sentence = format!(
            "the torque of axis {} has steps of {} {}, {:.0} over its range: effects below a few steps do not show",
            axis + 1,
            significant(step, 3),
            Channel::Torque(axis).unit(self.dataset.mechanism),
            range(tau) / step
        );
        Some(self.finding(axis, Problem::Quantised, sentence, Remedy::Words("more digits in the recording")))
    }

    /// A line of the torque near half the sampling frequency.
    fn alias(&self, axis: usize) -> Option<Finding> {
        let segment = self.dataset.segments.iter().max_by_key(|s| s.len())?;
        let mut x = self.dataset.measured[axis].get(segment.clone())?.to_vec();
        let n = x.len();
        if n < 1000 || self.dataset.dt <= 0.0 {
            return None;
        }
        let mean = x.iter().sum::<f64>() / n as f64;
        // A Hann window keeps the slow motion out of the top of the spectrum.
        let window = |k: usize| 0.5 - 0.5 * (std::f64::consts::TAU * k as f64 / n as f64).cos();
        x.iter_mut().enumerate().for_each(|(k, v)| *v = (*v - mean) * window(k));
        let power = fourier::power(x);
        let total: f64 = power.iter().sum();
        let first = (LINE.2 * power.len() as f64) as usize;
        let top = &power[first..];
        let highest = (0..top.len()).max_by(|&a, &b| top[a].total_cmp(&top[b]))?;
        let median = median(top.iter().copied());
        let line: f64 = top[highest.saturating_sub(2)..(highest + 3).min(top.len())].iter().sum();
        let clear = top[highest] > LINE.0 * median && line > LINE.1 * total;
        clear.then(|| {
            let period = self.dataset.period(segment);
            let frequency = (first + highest) as f64 / (n as f64 * period);
            let half = 0.5 / period;
            let sentence = format!(
                "the torque of axis {} has a line at {} Hz with {:.0} % of its variance, near half the sampling frequency ({} Hz): \
                 what is faster may be folded to it",
                axis + 1,
                significant(frequency, 4),
                100.0 * line / total,
                significant(half, 4)
            );
            self.finding(axis, Problem::Alias, sentence, Remedy::Words("a faster recording, or a filter before sampling"))
        })
    }

    /// Angles of a lone axis without a unit that look like degrees.
    fn degrees(&self) -> Option<Finding> {
        let signals = &self.recording.signals;
        if !matches!(signals.mechanism, Mechanism::Axis(_)) || signals.mechanism.joint() != Joint::Revolute {
            return None;
        }
        let (low, high) = signals[Channel::Angle(0)]
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(*x), b.max(*x)));
        let round = |x: f64| (x / 15.0 - (x / 15.0).round()).abs() < DEGREES.1;
        let large = low.abs().max(high.abs());
        ((DEGREES.0..=400.0).contains(&large) && round(low) && round(high) && high - low > 10.0).then(|| {
            let sentence = format!("the angle goes from {} to {}: degrees?", significant(low, 4), significant(high, 4));
            self.finding(0, Problem::Degrees, sentence, Remedy::Map(vec!["q1=q1[deg]".into()]))
        })
    }
}

fn instants(dataset: &Dataset) -> Vec<usize> {
    let stride = crate::identification::dataset::stride_for(dataset.len(), INSTANTS);
    (0..dataset.len()).step_by(stride).collect()
}

/// Acceleration, rate and smooth sign of the rate of an axis at the instants.
fn motion(dataset: &Dataset, axis: usize, at: &[usize]) -> [Vec<f64>; 3] {
    let joints = &dataset.joints;
    let fastest = at.iter().map(|&k| joints[k].qd[axis].abs()).fold(0.0, f64::max).max(f64::MIN_POSITIVE);
    let steepness = 1.0 / (SLOW * fastest);
    let of = |f: &dyn Fn(usize) -> f64| at.iter().map(|&k| f(k)).collect::<Vec<f64>>();
    [of(&|k| joints[k].qdd[axis]), of(&|k| joints[k].qd[axis]), of(&|k| smooth_sign(joints[k].qd[axis], steepness))]
}

/// Whether the torque of a lone revolute axis follows the angle as a weight does and shows neither inertia nor friction:
/// something else moved the axis, and the torque tells nothing of its dynamics.
pub fn carries_weight_alone(mechanism: Mechanism, dataset: &Dataset) -> bool {
    if !matches!(mechanism, Mechanism::Axis(_)) || mechanism.joint() != Joint::Revolute || dataset.is_empty() {
        return false;
    }
    let at = instants(dataset);
    let moved = motion(dataset, 0, &at);
    let angles: Vec<f64> = at.iter().map(|&k| dataset.joints[k].q[0]).collect();
    let weight = [f64::sin, f64::cos].map(|f| angles.iter().map(|q| f(*q)).collect::<Vec<f64>>());
    let torque: Vec<f64> = at.iter().map(|&k| dataset.measured[0][k]).collect();
    let constant = vec![1.0; at.len()];
    let Some(alone) = least_squares(&[&constant, &weight[0], &weight[1]], &torque) else { return false };
    if range(&angles) < WEIGHT.0 || alone.mean_square > (1.0 - WEIGHT.1) * deviation(&torque).powi(2) {
        return false;
    }
    let columns: [&[f64]; 6] = [&constant, &weight[0], &weight[1], &moved[0], &moved[1], &moved[2]];
    let Some(fit) = least_squares(&columns, &torque) else { return false };
    let left = |k: usize| torque[k] - fit.beta.iter().zip(&columns).map(|(b, column)| b * column[k]).sum::<f64>();
    let inflation = correlation_time(&[(0..at.len()).map(left).collect()]).sqrt().max(1.0);
    let is_inert = fit.beta[3] > SHOWN * inflation * fit.std[3];
    // The drive does the work against friction, at any speed and in every direction.
    let rate = &moved[1];
    let lost: f64 = (0..at.len()).map(|k| (fit.beta[4] * rate[k] + fit.beta[5] * moved[2][k]) * rate[k]).sum();
    let exchanged: f64 = (0..at.len()).map(|k| (torque[k] * rate[k]).abs()).sum();
    !is_inert && lost < LOST * exchanged
}

fn range(x: &[f64]) -> f64 {
    let (low, high) = x.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(*x), b.max(*x)));
    high - low
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::Channel;
    use crate::recording::Signals;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    /// A lone axis along two sines at 1 kHz with the torque that `of` gives for q, q̇, q̈, a time and a normal number.
    fn recording(of: impl Fn([f64; 3], f64, f64) -> f64) -> Recording {
        let mut samples = Vec::new();
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        for k in 0..8000 {
            let t = f64::from(k) * 1e-3;
            let sum = |f: &dyn Fn(f64, f64) -> f64| f(0.8, 2.1) + f(0.2, 7.7);
            let state = [
                sum(&|a, w| a * (w * t).sin()),
                sum(&|a, w| a * w * (w * t).cos()),
                sum(&|a, w| -a * w * w * (w * t).sin()),
            ];
            let noise: f64 = StandardNormal.sample(&mut rng);
            samples.push([t, (state[0] * 2e5).round() / 2e5, of(state, t, noise)]);
        }
        let signals = Signals::of_axis(Joint::Revolute, &samples);
        Recording { name: "bench".into(), signals, ..Recording::default() }
    }

    fn problems(of: impl Fn([f64; 3], f64, f64) -> f64) -> Vec<Problem> {
        let recording = recording(of);
        let found = inspect(&recording, &Dataset::new(&recording));
        found.iter().map(|f| f.problem).collect()
    }

    fn usual([_, rate, acceleration]: [f64; 3]) -> f64 {
        0.05 * acceleration + 0.4 * (100.0 * rate).tanh() + 0.1 * rate
    }

    #[test]
    fn a_usual_bench_passes() {
        assert_eq!(problems(|state, _, noise| usual(state) + 0.02 * noise), []);
    }

    #[test]
    fn a_weight_that_is_carried_while_the_axis_is_moved_by_hand_is_told() {
        let carried = |[angle, ..]: [f64; 3], _, noise| 2.0 * f64::sin(angle) + 0.02 * noise;
        assert_eq!(problems(carried), [Problem::WeightAlone]);
        // The same weight on an axis that its drive moves.
        let driven = |state: [f64; 3], _, noise| 2.0 * f64::sin(state[0]) + usual(state) + 0.02 * noise;
        assert_eq!(problems(driven), []);
    }

    #[test]
    fn a_column_that_copies_another_is_named_and_a_similar_one_is_not() {
        let first = recording(|state, _, noise| usual(state) + 0.02 * noise);
        let with_second = |of: &dyn Fn(usize, f64) -> f64| {
            let mut dataset = Dataset::new(&first);
            dataset.channels.push(Channel::StrutUpper(0));
            dataset.measured.push(dataset.measured[0].iter().enumerate().map(|(k, x)| of(k, *x)).collect());
            inspect(&first, &dataset)
        };
        let found = with_second(&|_, torque| 3.0 - 2.5 * torque);
        assert_eq!(found.iter().map(|f| (f.problem, f.axis)).collect::<Vec<_>>(), [(Problem::Repeated, None)]);
        assert!(found[0].sentence.contains("times -2.5"), "{}", found[0].sentence);
        // Another sensor of the same load: noise of its own, a fifth of the first one's.
        let mut rng = ChaCha8Rng::seed_from_u64(8);
        let quiet: Vec<f64> = (0..first.signals.t.len()).map(|_| StandardNormal.sample(&mut rng)).collect();
        let smooth = Dataset::new(&recording(|state, _, _| usual(state))).measured[0].clone();
        let found = with_second(&|k, _| smooth[k] + 0.004 * quiet[k]);
        assert!(found.is_empty(), "{found:?}");
    }

    #[test]
    fn each_trouble_is_named_alone() {
        assert_eq!(problems(|_, _, noise| 0.02 * noise), [Problem::Unrelated]);
        assert_eq!(problems(|_, t, noise| (11.3 * t).sin() + 0.02 * noise), [Problem::Unrelated]);
        assert_eq!(problems(|state, _, noise| -usual(state) + 0.02 * noise), [Problem::TorqueSign]);
        assert_eq!(problems(|[_, rate, acceleration], _, _| 0.05 * acceleration + 0.1 * rate), [Problem::Noiseless]);
        let stepped = |state, _, noise: f64| ((usual(state) + 0.02 * noise) / 0.05).round() * 0.05;
        assert_eq!(problems(stepped), [Problem::Quantised]);
        let line =
            |state, t: f64, noise: f64| usual(state) + 0.02 * noise + 0.3 * (std::f64::consts::TAU * 480.0 * t).sin();
        assert_eq!(problems(line), [Problem::Alias]);
    }
}
