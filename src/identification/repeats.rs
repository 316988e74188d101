//! [`Repeats`]: how much of a residual repeats from lap to lap, and how much is noise.

use super::fit::FitError;
use super::laps::Laps;
use super::{Dataset, NoiseLevel, Residuals};
use crate::evidence::repeats::{Parts, parts};
use crate::identification::least_squares::least_squares;
use crate::machine::Mechanism;
use crate::model::Model;
use crate::recording::Channel;
use crate::text::significant;

/// Least number of laps whose noise replaces that of neighbouring samples: two laps do not show whether their difference is
/// a trend.
const ENOUGH: usize = 3;
/// Difference from the noise of neighbours, as ln σ, and in standard errors, from which the laps' noise replaces it.
const SHARPER: (f64, f64) = (0.05, 4.0);
/// Standard error of ln σ from differences of n samples, times √n: white noise, order 4.
const OF_DIFFERENCES: f64 = 1.9;
/// Largest share of the noise that the model error may contribute because the motion of the laps differs.
const OF_MOTION: f64 = 0.2;
/// Steepness of the sign of friction, s/rad (eq. 48).
const STEEPNESS: f64 = 100.0;

/// Residual of recordings that repeat one motion, divided into what repeats and what does not.
#[derive(Clone, Debug)]
pub struct Repeats {
    /// Number of laps.
    pub laps: usize,
    /// Number of recordings that the laps come from.
    pub recordings: usize,
    /// Time from lap to lap, s.
    pub period: f64,
    /// Shares of every channel.
    pub channels: Vec<Share>,
}

/// Parts of the residual of one channel, N·m or N.
#[derive(Clone, Debug)]
pub struct Share {
    /// Channel.
    pub channel: Channel,
    /// Kind of machine.
    pub mechanism: Mechanism,
    /// Parts.
    pub parts: Parts,
    /// Largest part of the trend over the laps.
    pub drift: Option<Drift>,
    /// Noise floor by the laps, where it is sharper than that of neighbouring samples.
    pub floor: Option<f64>,
    /// Noise by neighbouring samples.
    pub neighbours: f64,
}

/// Change of a residual from the first lap to the last.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Drift {
    /// Of the force along the motion, N·m or N: friction.
    Friction(f64),
    /// Of the mean, N·m or N.
    Mean(f64),
    /// RMS of any other change, N·m or N.
    Other(f64),
}

impl Repeats {
    /// Shares of `residuals` in the `laps` of `datasets` with the noise of neighbouring samples `noise`.
    ///
    /// # Panics
    /// If the residuals are of other recordings.
    pub fn of(laps: &Laps, datasets: &[Dataset], residuals: &Residuals, noise: &NoiseLevel) -> Option<Self> {
        let channels = &datasets[0].channels;
        let share = |(c, &channel): (usize, &Channel)| {
            let parts = parts(&rows(laps, residuals, c))?;
            let is_stated = channel
                .drive()
                .is_some_and(|i| datasets.iter().any(|t| t.setup.torque_noise.is_some_and(|stated| stated[i] > 0.0)));
            let floor = (!is_stated && is_sharper(&parts, noise.pooled[c], laps)).then_some(parts.noise.0);
            let drift = drift(&parts, laps, datasets, channel);
            Some(Share { channel, mechanism: datasets[0].mechanism, parts, drift, floor, neighbours: noise.pooled[c] })
        };
        let channels = channels.iter().enumerate().map(share).collect::<Option<_>>()?;
        Some(Self { laps: laps.count(), recordings: laps.recordings(), period: laps.period(), channels })
    }

    /// Noise of means over `block` samples by the laps, for each channel; `None` where it is not sharper than that of single
    /// samples `noise`/√`block`, which is too small for noise with memory.
    pub fn of_means(
        laps: &Laps,
        datasets: &[Dataset],
        residuals: &Residuals,
        noise: &NoiseLevel,
        block: usize,
    ) -> Vec<Option<f64>> {
        let of = |c: usize| {
            let rows = rows(laps, residuals, c);
            let mean = |lap: &Vec<f64>| lap.chunks_exact(block).map(|b| b.iter().sum::<f64>() / block as f64).collect();
            let parts = parts(&rows.iter().map(mean).collect::<Vec<Vec<f64>>>())?;
            let white = noise.pooled[c] / (block as f64).sqrt();
            is_sharper(&parts, white, laps).then_some(parts.noise.0)
        };
        (0..datasets[0].channels.len()).map(of).collect()
    }

    /// One sentence per channel.
    pub fn sentences(&self) -> Vec<String> {
        self.channels.iter().map(Share::sentence).collect()
    }

    /// The laps as text.
    pub fn laps(&self) -> String {
        let of = if self.recordings > 1 { format!(" in {} recordings", self.recordings) } else { String::new() };
        format!("{} laps of {} s{of}", self.laps, (self.period * 1e3).round() / 1e3)
    }
}

impl Share {
    /// The shares as a sentence.
    pub fn sentence(&self) -> String {
        let (p, unit) = (&self.parts, self.channel.unit(self.mechanism));
        let mut text = format!(
            "{}: of the residual {} {unit}, {} repeats from lap to lap (model) and {} does not (noise)",
            self.channel,
            significant(p.rms, 3),
            with_error(p.repeats),
            with_error(p.noise)
        );
        self.notes().iter().for_each(|note| text += &format!("; {note}"));
        text
    }

    /// What else is known: the trend over the laps, and whether their noise is the noise floor.
    pub fn notes(&self) -> Vec<String> {
        let unit = self.channel.unit(self.mechanism);
        let change = |what: &str, x: f64| {
            let verb = if x < 0.0 { "falls" } else { "rises" };
            format!("{what} {verb} by {} {unit} from the first lap to the last", significant(x.abs(), 2))
        };
        let drift = self.drift.map(|drift| match drift {
            Drift::Friction(x) => change("friction", x),
            Drift::Mean(x) => change("the mean", x),
            Drift::Other(x) => format!("it changes by {} {unit} RMS from the first lap to the last", significant(x, 2)),
        });
        let floor = self.floor.map(|_| {
            let neighbours = significant(self.neighbours, 3);
            format!("the noise floor is that of the laps, as neighbouring samples show {neighbours} {unit}")
        });
        drift.into_iter().chain(floor).collect()
    }
}

/// A value with its standard error.
pub fn with_error((value, std): (f64, f64)) -> String {
    format!("{} ± {}", significant(value, 3), significant(std, 1))
}

impl NoiseLevel {
    /// Noise of `datasets`, that of their laps where it is sharper than that of neighbouring samples.
    ///
    /// # Errors
    /// [`FitError::Kinematics`] if the datasets have laps and the inverse dynamics of `model` fail at a measured pose.
    pub fn measured(model: &Model, datasets: &[Dataset]) -> Result<Self, FitError> {
        let noise = Self::of(model, datasets);
        match Laps::find(datasets) {
            Some(laps) => Ok(noise.with_laps(&laps, datasets, &Residuals::new(model, datasets)?).0),
            None => Ok(noise),
        }
    }

    /// The noise with that of the laps of `datasets` where it is sharper, and the shares of `residuals`; `None` without laps.
    pub fn with_repeats(self, datasets: &[Dataset], residuals: &Residuals) -> (Self, Option<Repeats>) {
        match Laps::find(datasets) {
            Some(laps) => self.with_laps(&laps, datasets, residuals),
            None => (self, None),
        }
    }

    /// As [`Self::with_repeats`], with known `laps`.
    pub fn with_laps(self, laps: &Laps, datasets: &[Dataset], residuals: &Residuals) -> (Self, Option<Repeats>) {
        let repeats = Repeats::of(laps, datasets, residuals, &self);
        let level = repeats.as_ref().map_or_else(|| self.clone(), |r| self.with_floors(r));
        (level, repeats)
    }

    /// The noise with the floors of `repeats`; recordings keep their ratios.
    fn with_floors(&self, repeats: &Repeats) -> Self {
        let mut level = self.clone();
        for (c, floor) in repeats.channels.iter().enumerate().filter_map(|(c, s)| Some((c, s.floor?))) {
            level.of_each.iter_mut().for_each(|own| own[c] *= floor / self.pooled[c]);
            level.pooled[c] = floor;
        }
        level
    }
}

/// Residuals of channel `c` in every lap.
fn rows(laps: &Laps, residuals: &Residuals, c: usize) -> Vec<Vec<f64>> {
    laps.rows(&residuals.series.iter().map(|own| &own[c][..]).collect::<Vec<_>>())
}

/// Whether the noise of laps differs from that of neighbouring samples, and neither an event in one lap nor the model error
/// along laps that differ causes it.
fn is_sharper(p: &Parts, neighbours: f64, laps: &Laps) -> bool {
    let n = laps.samples.iter().map(Vec::len).sum::<usize>() as f64;
    let difference = (p.noise.0 / neighbours).ln().abs();
    let error = (OF_DIFFERENCES / n.sqrt()).hypot(p.noise.1 / p.noise.0);
    laps.count() >= ENOUGH
        && !p.uneven
        && laps.mismatch * p.repeats.0 < OF_MOTION * p.noise.0
        && difference.is_finite()
        && difference > SHARPER.0.max(SHARPER.1 * error)
}

/// The largest part of a significant trend.
fn drift(p: &Parts, laps: &Laps, datasets: &[Dataset], channel: Channel) -> Option<Drift> {
    if p.change.is_empty() {
        return None;
    }
    let axis = channel.limb();
    let sign = |&(of, k): &(usize, usize)| (STEEPNESS * datasets[of].joints[k].qd[axis]).tanh();
    let signs: Vec<f64> = laps.samples[0].iter().map(sign).collect();
    let ones = vec![1.0; signs.len()];
    let other = Drift::Other((p.change.iter().map(|x| x * x).sum::<f64>() / ones.len() as f64).sqrt());
    let clear = |beta: f64, std: f64| beta.abs() > 4.0 * std;
    Some(match least_squares(&[&ones, &signs], &p.change) {
        Some(f) if clear(f.beta[1], f.std[1]) && f.beta[1].abs() > f.beta[0].abs() => Drift::Friction(f.beta[1]),
        Some(f) if clear(f.beta[0], f.std[0]) => Drift::Mean(f.beta[0]),
        _ => other,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::Joint;
    use crate::recording::{Recording, Signals};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};
    use std::f64::consts::TAU;

    /// A lone axis at 1 kHz with an encoder of 1e-5 rad, and its torque.
    fn recorded(duration: f64, angle: impl Fn(f64) -> f64, mut torque: impl FnMut(f64) -> f64) -> Dataset {
        let row = |t: f64| [t, (angle(t) * 1e5).round() / 1e5, torque(t)];
        let rows: Vec<_> = (0..(1e3 * duration) as usize).map(|k| k as f64 * 1e-3).map(row).collect();
        let signals = Signals::of_axis(Joint::Revolute, &rows);
        Dataset::new(&Recording { signals, ..Recording::default() })
    }

    /// The motion of a lap of 3.2 s, and what a model lacks of its torque.
    fn course(t: f64) -> f64 {
        let w = TAU * t / 3.2;
        0.5 * w.sin() + 0.2 * (3.0 * w + 1.0).cos() + 0.1 * (7.0 * w).sin()
    }

    fn lacking(t: f64) -> f64 {
        0.4 * (TAU * t / 3.2 * 2.0).sin().signum()
    }

    /// White noise of 0.1 and AR(1) noise a = 0.9 of σ = 0.2.
    fn noise(seed: u64) -> impl FnMut() -> f64 {
        let (mut rng, mut slow) = (ChaCha8Rng::seed_from_u64(seed), 0.0);
        move || {
            let mut draw = || -> f64 { StandardNormal.sample(&mut rng) };
            slow = 0.9 * slow + 0.2 * (1.0f64 - 0.81).sqrt() * draw();
            slow + 0.1 * draw()
        }
    }

    /// Repeats of the measured torque itself: a model that predicts zero.
    fn repeats(datasets: &[Dataset]) -> Option<Repeats> {
        let measured = |t: &Dataset| t.measured.iter().map(|own| own.to_vec()).collect();
        let residuals = Residuals::from(datasets.iter().map(measured).collect::<Vec<_>>());
        NoiseLevel::of(&crate::model::testing::slide(), datasets).with_repeats(datasets, &residuals).1
    }

    /// Mean squares by hand: two-way analysis of variance of known laps, without trend; the last lacks its end.
    fn by_hand(x: &[f64], period: usize, laps: usize) -> [f64; 2] {
        let (mut between, mut within) = (0.0, 0.0);
        let phases = x.len() - (laps - 1) * period;
        for k in 0..phases {
            let all: Vec<f64> = (0..laps).map(|l| x[l * period + k]).collect();
            let mean = all.iter().sum::<f64>() / laps as f64;
            between += mean * mean;
            within += all.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
        }
        let noise = within / (phases * (laps - 1)) as f64;
        [(between / phases as f64 - noise / laps as f64).sqrt(), noise.sqrt()]
    }

    #[test]
    fn shares_are_those_of_the_truth_and_of_an_analysis_of_variance() {
        for laps in [2, 6] {
            let mut noise = noise(laps as u64);
            let dataset = recorded(3.2 * laps as f64, course, |t| lacking(t) + noise());
            let hand = by_hand(&dataset.measured[0], 3200, laps);
            let found = repeats(std::slice::from_ref(&dataset)).unwrap();
            let parts = &found.channels[0].parts;
            assert_eq!((found.laps, found.recordings), (laps, 1));
            assert!((found.period - 3.2).abs() < 1e-4, "{}", found.period);
            let truth = 0.05f64.sqrt();
            assert!((parts.noise.0 - truth).abs() < 3.0 * parts.noise.1 && parts.noise.1 < 0.02, "{parts:?}");
            assert!((parts.repeats.0 - 0.4).abs() < 3.0 * parts.repeats.1 && parts.repeats.1 < 0.02, "{parts:?}");
            // The ends of the recording are lost in the differentiation.
            assert!((parts.repeats.0 / hand[0] - 1.0).abs() < 0.01, "{parts:?} {hand:?}");
            assert!((parts.noise.0 / hand[1] - 1.0).abs() < 0.01, "{parts:?} {hand:?}");
            // Neighbouring samples show a good half of it.
            assert_eq!(found.channels[0].floor.is_some(), laps >= ENOUGH);
        }
    }

    #[test]
    fn white_noise_keeps_the_floor_of_neighbouring_samples() {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let mut white = || -> f64 { StandardNormal.sample(&mut rng) };
        let found = repeats(&[recorded(19.2, course, |t| lacking(t) + 0.3 * white())]).unwrap();
        assert!(found.channels[0].floor.is_none() && found.channels[0].drift.is_none(), "{found:?}");
    }

    #[test]
    fn friction_that_falls_is_a_drift() {
        let mut noise = noise(5);
        let rate = |t: f64| (course(t + 1e-4) - course(t - 1e-4)) / 2e-4;
        let found = repeats(&[recorded(19.2, course, |t| (1.5 - t / 19.2) * rate(t).signum() + noise())]).unwrap();
        let share = &found.channels[0];
        let Some(Drift::Friction(change)) = share.drift else { panic!("{found:?}") };
        // From the first lap to the last, five sixths of the recording.
        assert!((change + 5.0 / 6.0).abs() < 0.05, "{change}");
        assert!((share.parts.noise.0 - 0.05f64.sqrt()).abs() < 0.01, "{share:?}");
        assert!(share.sentence().contains("friction falls by 0.8"), "{}", share.sentence());
    }

    #[test]
    fn motions_that_do_not_repeat_have_no_laps() {
        let irrational =
            |t: f64| (1.9 * t).sin() + 0.5 * (1.9 * 2f64.sqrt() * t).sin() + 0.3 * (1.9 * 7f64.sqrt() * t).cos();
        assert!(repeats(&[recorded(30.0, irrational, |_| 0.0)]).is_none());
        assert!(repeats(&[recorded(20.0, |t| 0.3 * t, |_| 0.0)]).is_none());
        assert!(repeats(&[recorded(20.0, |_| 0.0, |_| 0.0)]).is_none());
        assert!(repeats(&[recorded(20.0, |t| t.powf(1.5).sin(), |_| 0.0)]).is_none());
    }

    #[test]
    fn laps_at_another_speed_are_no_repeats() {
        // Each lap faster than the one before.
        let faster = |share: f64| move |t: f64| course(t * (1.0 + share * t));
        let laps = |share: f64| repeats(&[recorded(12.8, faster(share), |_| 0.0)]).map(|r| r.laps);
        assert_eq!(laps(0.0), Some(4));
        assert_eq!(laps(2e-5), Some(4));
        assert_eq!(laps(0.01), None);
    }

    #[test]
    fn pauses_of_any_length_lie_between_laps() {
        // Cosine strokes there and back in 2 s, with pauses of 0.2, 0.13 and 0.21 s: below the rest that is left out.
        let starts = [0.0, 2.2, 4.33, 6.54];
        let stroke = |by: f64| {
            if (0.0..2.0).contains(&by) {
                0.3 * (1.0 - (TAU * by / 2.0).cos()) + 0.1 * (TAU * by).sin().powi(2) * by
            } else {
                0.0
            }
        };
        let angle = |t: f64| starts.iter().map(|s| stroke(t - s)).sum::<f64>();
        let found = repeats(&[recorded(8.7, angle, |_| 0.0)]).unwrap();
        assert_eq!(found.laps, 4);
        assert!((found.period - 2.2).abs() < 0.02, "{}", found.period);
        // Longer pauses are left out of the recording of a lone axis.
        let starts = [0.0, 3.0, 7.5];
        let angle = |t: f64| starts.iter().map(|s| stroke(t - s)).sum::<f64>();
        assert_eq!(repeats(&[recorded(10.0, angle, |_| 0.0)]).unwrap().laps, 3);
    }

    #[test]
    fn recordings_of_one_motion_repeat_it() {
        let once = |t: f64| (1.9 * t).sin() + 0.5 * (1.9 * 2f64.sqrt() * t).sin() + 0.3 * (1.9 * 7f64.sqrt() * t).cos();
        let force = |t: f64| 0.5 * (3.0 * t).sin();
        let mut all = Vec::new();
        for (seed, start) in [0.0, 0.3704].into_iter().enumerate() {
            let mut noise = noise(10 + seed as u64);
            all.push(recorded(12.0 - start, move |t| once(t + start), move |t| force(t + start) + noise()));
        }
        let found = repeats(&all).unwrap();
        assert_eq!((found.laps, found.recordings), (2, 2));
        let parts = &found.channels[0].parts;
        assert!((parts.noise.0 - 0.05f64.sqrt()).abs() < 3.0 * parts.noise.1, "{parts:?}");
        assert!((parts.repeats.0 - 0.125f64.sqrt()).abs() < 3.0 * parts.repeats.1 + 0.01, "{parts:?}");
        let mut other = all.clone();
        other[1].setup.payload.mass = 1.0;
        assert!(repeats(&other).is_none());
    }

    #[test]
    fn the_period_of_a_fourier_series_is_that_of_all_its_frequencies() {
        let angle = |t: f64| {
            let w = TAU * 0.25 * t;
            0.1 * w.sin() + 0.4 * (2.0 * w).cos() + 0.3 * (4.0 * w + 1.0).sin() + 0.1 * (8.0 * w).sin()
        };
        // An encoder whose zero creeps by a thousandth of the travel.
        let found = repeats(&[recorded(20.0, |t| angle(t) + 1e-4 * t, |_| 0.0)]).unwrap();
        assert_eq!((found.laps, (found.period * 1e3).round()), (5, 4000.0));
    }
}
