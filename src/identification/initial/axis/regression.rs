//! Linear regression of a single axis's torque, and the steepness of its friction.

use rayon::prelude::*;

use super::super::PERIOD;
use crate::effects::smooth_sign;
use crate::evidence::noise::correlation_time;
use crate::identification::Dataset;
use crate::identification::least_squares::{LeastSquares, least_squares};
use crate::machine::{Joint, Mechanism};
use crate::model::history::rounded_to;
use crate::numerics::deviation;

/// Smallest and largest speed over which friction changes its sign, relative to the largest speed, and number of values
/// tried between them.
const TRANSITION: [f64; 2] = [5e-4, 0.2];
const GRID: usize = 16;
/// Twice the logarithm of the likelihood ratio from which a steepness is better than the usual one.
const CLEARER: f64 = 10.0;
/// Standard deviation of a load, relative to its largest value, from which it varies.
const VARIES: f64 = 0.02;

/// Series of one regression over several recordings.
pub(super) struct Series {
    pub rate: Vec<f64>,
    /// Smooth sign of the rate, whose mean is not that of the mean rate.
    pub sign: Vec<f64>,
    pub acceleration: Vec<f64>,
    pub angle: Vec<f64>,
    /// Torque, without what accelerates a load that the setup states.
    pub torque: Vec<f64>,
    /// Known load against positive motion; empty without one.
    pub load: Vec<f64>,
    /// Index of the recording of each sample.
    pub recording: Vec<usize>,
    /// Lengths of the segments.
    pub segments: Vec<usize>,
}

impl Series {
    /// Means of all series over about [`PERIOD`], with friction's change of sign of this `steepness`.
    pub fn of(datasets: &[Dataset], steepness: f64) -> Self {
        let mut out = Self {
            rate: Vec::new(),
            sign: Vec::new(),
            acceleration: Vec::new(),
            angle: Vec::new(),
            torque: Vec::new(),
            load: Vec::new(),
            recording: Vec::new(),
            segments: Vec::new(),
        };
        for (r, d) in datasets.iter().enumerate() {
            let block = d.stride(PERIOD);
            let means = |of: &dyn Fn(usize) -> f64| d.means(&(0..d.len()).map(of).collect::<Vec<_>>(), block);
            out.angle.extend(means(&|k| d.joints[k].q[0]));
            out.rate.extend(means(&|k| d.joints[k].qd[0]));
            out.sign.extend(means(&|k| smooth_sign(d.joints[k].qd[0], steepness)));
            out.acceleration.extend(means(&|k| d.joints[k].qdd[0]));
            let (stated, measured) = (d.setup.load, d.loads.as_ref());
            let inertia = if measured.is_some() { 0.0 } else { stated.inertia() };
            out.torque.extend(means(&|k| d.measured[0][k] - inertia * d.joints[k].qdd[0]));
            let load = |k: usize| measured.and_then(|m| m.of_axis(d.t[k])).unwrap_or(stated.at_rest());
            out.load.extend(means(&load));
            out.recording.resize(out.angle.len(), r);
            out.segments.extend(d.segments.iter().map(|s| s.len() / block).filter(|n| *n > 0));
        }
        if out.load.iter().all(|load| *load == 0.0) {
            out.load.clear();
        }
        out
    }

    /// Whether the load varies, so that the torque shows its share of it.
    pub fn shows_scale(&self) -> bool {
        let size = self.load.iter().fold(0.0f64, |most, x| most.max(x.abs()));
        !self.load.is_empty() && deviation(&self.load) > VARIES * size
    }

    /// The series with the load taken away from the torque.
    pub fn unloaded(mut self) -> Self {
        self.torque.iter_mut().zip(&self.load).for_each(|(torque, load)| *torque -= load);
        self.load.clear();
        self
    }
}

/// Steepness of the friction's change of sign by least squares, s/rad; `None` if the recordings do not tell it from
/// the `usual` one.
///
/// It is between the reciprocals of [`TRANSITION`] of the largest speed.
pub(super) fn steepness(datasets: &[Dataset], mechanism: Mechanism, usual: f64, max_speed: f64) -> Option<f64> {
    let revolute = mechanism.joint() == Joint::Revolute;
    // Where the travel does not tell gravity from a constant, the fit without it is as good.
    let of = |series: &Series| Fit::of(series, revolute).or_else(|| Fit::of(series, false));
    let fit = |steepness: f64| of(&Series::of(datasets, steepness));
    let series = Series::of(datasets, usual);
    let start = of(&series)?;
    let independent = series.torque.len() as f64 / start.inflation.powi(2).max(1.0);
    let cost = |exponent: f64| fit(10f64.powf(exponent)).map_or(f64::INFINITY, |fit| fit.least.mean_square.ln());
    let [most, least] = TRANSITION.map(|share| (1.0 / (share * max_speed)).log10().clamp(0.0, 4.0));
    let among = |low: f64, high: f64| {
        let grid: Vec<f64> = (0..=GRID).map(|k| low + (high - low) * k as f64 / GRID as f64).collect();
        let costs: Vec<f64> = grid.par_iter().map(|e| cost(*e)).collect();
        let best = (0..grid.len()).min_by(|&a, &b| costs[a].total_cmp(&costs[b])).unwrap_or(0);
        (grid[best.saturating_sub(1)], grid[best], grid[(best + 1).min(GRID)])
    };
    let (before, _, after) = among(least, most);
    let (_, best, _) = among(before, after);
    let found = fit(10f64.powf(best))?;
    let gained = independent * (start.least.mean_square / found.least.mean_square).ln();
    (found.friction[0].is_some() && gained > CLEARER).then(|| rounded_to(10f64.powf(best), 3))
}

/// The regression over all recordings.
pub(super) struct Fit {
    pub least: LeastSquares,
    /// Indices of the coefficients of Coulomb and viscous friction; `None` without the term.
    pub friction: [Option<usize>; 2],
    /// Index of the coefficient of the known load; `None` if it does not vary.
    pub load: Option<usize>,
    /// Index of the constant of each recording, the same for all where a varying load is known; `None` where the axis does
    /// not reverse, which is then Coulomb friction.
    pub constants: Vec<Option<usize>>,
    /// Index of the first coefficient of sin q; that of cos q follows, per recording.
    pub sines: Option<usize>,
    /// Factor on standard errors due to the autocorrelation of the residual.
    pub inflation: f64,
}

impl Fit {
    /// The regression with friction that is not negative: a term with a negative coefficient is left out.
    pub fn of(series: &Series, gravity: bool) -> Option<Self> {
        Self::positive(series, gravity, true)
    }

    /// The regression with gravity, whose cosine a constant resembles on a short travel, and without constants.
    pub fn without_constants(series: &Series) -> Option<Self> {
        Self::positive(series, true, false)
    }

    fn positive(series: &Series, gravity: bool, constant: bool) -> Option<Self> {
        let mut with = [true, true];
        loop {
            let fit = Self::with(series, gravity, constant, with)?;
            let is_negative = |place: &Option<usize>| place.is_some_and(|k| fit.least.beta[k] < 0.0);
            // Viscous friction first: in one direction at one speed it is told from Coulomb friction worst.
            match fit.friction.iter().rposition(is_negative) {
                Some(term) => with[term] = false,
                None => return Some(fit),
            }
        }
    }

    fn with(series: &Series, gravity: bool, constant: bool, friction: [bool; 2]) -> Option<Self> {
        let count = series.recording.last().map_or(0, |r| r + 1);
        let mut features = vec![series.acceleration.clone()];
        let friction = [(friction[0], &series.sign), (friction[1], &series.rate)].map(|(is_used, feature)| {
            is_used.then(|| {
                features.push(feature.clone());
                features.len() - 1
            })
        });
        let on = |r: usize, of: &dyn Fn(usize) -> f64| {
            (0..series.recording.len())
                .map(|k| if series.recording[k] == r { of(k) } else { 0.0 })
                .collect::<Vec<f64>>()
        };
        let reverses = |r: usize| {
            let own = || series.recording.iter().zip(&series.rate).filter(move |(of, _)| **of == r);
            own().any(|(_, rate)| *rate > 0.0) && own().any(|(_, rate)| *rate < 0.0)
        };
        let load = series.shows_scale().then(|| {
            features.push(series.load.clone());
            features.len() - 1
        });
        let mut common = None;
        let constants: Vec<Option<usize>> = (0..count)
            .map(|r| {
                (constant && (reverses(r) || friction[0].is_none())).then(|| {
                    if load.is_some() {
                        return *common.get_or_insert_with(|| {
                            features.push(vec![1.0; series.recording.len()]);
                            features.len() - 1
                        });
                    }
                    features.push(on(r, &|_| 1.0));
                    features.len() - 1
                })
            })
            .collect();
        let sines = gravity.then_some(features.len());
        for r in (0..count).filter(|_| gravity) {
            features.push(on(r, &|k| series.angle[k].sin()));
            features.push(on(r, &|k| series.angle[k].cos()));
        }
        let columns: Vec<&[f64]> = features.iter().map(Vec::as_slice).collect();
        let least = least_squares(&columns, &series.torque)?;
        let fitted = |k: usize| least.beta.iter().zip(&columns).map(|(b, f)| b * f[k]).sum::<f64>();
        let mut start = 0;
        let rests: Vec<Vec<f64>> = series
            .segments
            .iter()
            .map(|n| {
                start += n;
                (start - n..start).map(|k| series.torque[k] - fitted(k)).collect()
            })
            .collect();
        let inflation = correlation_time(&rests).sqrt();
        let moves = deviation(&series.rate) > 0.0 && deviation(&series.acceleration) > 0.0;
        (moves && least.beta.iter().all(|b| b.is_finite())).then_some(Self {
            least,
            friction,
            load,
            constants,
            sines,
            inflation,
        })
    }

    /// Standard error of coefficient `k`.
    fn std(&self, k: usize) -> f64 {
        self.inflation * self.least.std[k]
    }

    /// A coefficient with its standard error; zero without the term.
    pub fn coefficient(&self, place: Option<usize>) -> (f64, f64) {
        place.map_or((0.0, 0.0), |k| (self.least.beta[k], self.std(k)))
    }

    /// What another regression leaves more than this one, in units of the variance of independent samples.
    pub fn gain_over(&self, other: &Self, samples: usize) -> f64 {
        let independent = samples as f64 / self.inflation.powi(2).max(1.0);
        independent * (other.least.mean_square / self.least.mean_square - 1.0)
    }

    /// Coefficients of sin q and cos q of recording `r` with their standard errors; zero without gravity.
    pub fn gravity(&self, r: usize) -> [(f64, f64); 2] {
        let Some(first) = self.sines else { return [(0.0, 1.0); 2] };
        [0, 1].map(|k| (self.least.beta[first + 2 * r + k], self.std(first + 2 * r + k).max(f64::MIN_POSITIVE)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::{Recording, Signals};

    /// Friction that reverses over 1/`steepness` along two sines, with steps of 1e-4 N·m as its only noise.
    fn bench(steepness: f64) -> Dataset {
        let mut samples = Vec::new();
        for k in 0..20_000 {
            let t = f64::from(k) * 5e-4;
            let sum = |f: &dyn Fn(f64, f64) -> f64| f(0.8, 2.1) + f(0.2, 7.7);
            let rate = sum(&|a, w| a * w * (w * t).cos());
            let torque = 0.02 * sum(&|a, w| -a * w * w * (w * t).sin()) + 0.3 * (steepness * rate).tanh() + 0.05 * rate;
            samples.push([t, sum(&|a, w| a * (w * t).sin()), (torque * 1e4).round() / 1e4]);
        }
        let signals = Signals::of_axis(Joint::Revolute, &samples);
        Dataset::new(&Recording { signals, ..Recording::default() })
    }

    #[test]
    fn the_speed_over_which_friction_reverses_is_found() {
        // The finer grid has steps of 5 %.
        for truth in [5.0, 20.0, 80.0] {
            let found = steepness(&[bench(truth)], Mechanism::axis(Joint::Revolute), 300.0, 3.3).expect("a steepness");
            assert!((found / truth - 1.0).abs() < 0.03, "{found} for {truth}");
        }
        let usual = steepness(&[bench(20.0)], Mechanism::axis(Joint::Revolute), 20.0, 3.3);
        assert_eq!(usual, None, "the usual one is as good");
    }
}
