//! Linear regression of a single axis's torque, and the steepness of its friction.

use std::ops::Range;

use super::super::PERIOD;
use crate::effects::smooth_sign;
use crate::evidence::noise::correlation_time;
use crate::evidence::whiten::ArFilter;
use crate::identification::Dataset;
use crate::identification::least_squares::{LeastSquares, least_squares};
use crate::machine::{Joint, Mechanism};
use crate::model::history::rounded_to;
use crate::numerics::{deviation, parallel};

/// Smallest and largest speed over which friction changes its sign, relative to the largest speed, and number of values
/// tried between them.
const TRANSITION: [f64; 2] = [5e-4, 0.2];
const GRID: usize = 16;
/// Largest order of the autoregression that whitens what a regression leaves.
const MEMORY: usize = 12;
/// Number of times that friction by load is computed anew from the torque that contains it: each leaves the square of its
/// share, a few percent.
const ANEW: usize = 2;
/// Standard deviation of a load, relative to its largest value, from which it varies.
const VARIES: f64 = 0.02;

/// Series of one regression over several recordings.
#[derive(Clone)]
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
    /// Size of the torque that a gear transmits, times the smooth sign; empty without friction by load.
    by_load: Vec<f64>,
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
            by_load: Vec::new(),
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

    /// The series with friction in proportion to the transmitted torque, that of the regression or the known load, and the
    /// regression with it; `None` if it is negative.
    fn with_friction_by_load(&self, first: &Fit, fit: impl Fn(&Self) -> Option<Fit>) -> Option<(Self, Fit)> {
        let mut series = self.clone();
        let mut torque = if self.load.is_empty() { first.fitted() } else { self.load.clone() };
        for _ in 0..ANEW {
            series.by_load = torque.iter().zip(&self.sign).map(|(torque, sign)| torque.abs() * sign).collect();
            let found = fit(&series)?;
            found.friction[2]?;
            if !self.load.is_empty() {
                return Some((series, found));
            }
            torque = found.fitted();
        }
        let found = fit(&series)?;
        Some((series, found))
    }

    /// The series with the load taken away from the torque.
    pub fn unloaded(mut self) -> Self {
        self.torque.iter_mut().zip(&self.load).for_each(|(torque, load)| *torque -= load);
        self.load.clear();
        self
    }
}

/// Steepness of the friction's change of sign, s/rad; `None` if the recordings do not tell it from the `usual` one.
///
/// It is estimated with and without friction by load, whose reversals are those of Coulomb friction, and both decide
/// together. Criterion is Bayes' information of the whitened regression, N·ln σ² + k·ln N with k coefficients: where the residual has
/// a memory, N samples of it are independent only after whitening. The filter is that of the largest regression that fits
/// best, one for all. The steepness is between the reciprocals of [`TRANSITION`] of the largest speed.
pub(super) fn steepness(datasets: &[Dataset], mechanism: Mechanism, usual: f64, max_speed: f64) -> Option<f64> {
    let revolute = mechanism.joint() == Joint::Revolute;
    // Where the travel does not tell gravity from a constant, the fit without it is as good.
    let of = |series: &Series| Fit::of(series, revolute).or_else(|| Fit::of(series, false));
    let fits = |steepness: f64| {
        let alone = Series::of(datasets, steepness);
        let first = of(&alone)?;
        let by_load = alone.with_friction_by_load(&first, of);
        Some([(alone, first)].into_iter().chain(by_load).collect::<Vec<_>>())
    };
    let least =
        |fits: &[(Series, Fit)]| fits.iter().map(|(_, fit)| fit.least.mean_square).fold(f64::INFINITY, f64::min);
    let [most, fewest] = TRANSITION.map(|share| (1.0 / (share * max_speed)).log10().clamp(0.0, 4.0));
    let grid = |low: f64, high: f64| (0..=GRID).map(move |k| 10f64.powf(low + (high - low) * k as f64 / GRID as f64));
    let among = |low: f64, high: f64| {
        let steepnesses: Vec<f64> = grid(low, high).collect();
        let found = parallel::map(steepnesses.len(), |k| Some((steepnesses[k], fits(steepnesses[k])?)));
        found.into_iter().flatten().collect::<Vec<_>>()
    };
    let coarse = among(fewest, most);
    let best = coarse.iter().min_by(|a, b| least(&a.1).total_cmp(&least(&b.1)))?;
    let (series, fit) = best.1.last()?;
    let filters = Whitener::of(series, fit);
    let cost = |fits: &[(Series, Fit)]| {
        let costs =
            fits.iter().filter_map(|(series, fit)| Some((filters.cost(series, fit)?, fit.friction[0].is_some())));
        costs.min_by(|a, b| a.0.total_cmp(&b.0))
    };
    let cheapest = |all: &[(f64, Vec<(Series, Fit)>)]| {
        let costs = all.iter().filter_map(|(s, fits)| Some((*s, cost(fits)?)));
        costs.min_by(|a, b| a.1.0.total_cmp(&b.1.0))
    };
    let (near, _) = cheapest(&coarse)?;
    let step = (most - fewest) / GRID as f64;
    let fine = among((near.log10() - step).max(fewest), (near.log10() + step).min(most));
    let (found, (own, has_friction)) = cheapest(&fine)?;
    let (of_usual, _) = cost(&fits(usual)?)?;
    // The steepness is one more number.
    let price = (filters.samples as f64).ln();
    (has_friction && own + price < of_usual).then(|| rounded_to(found, 3))
}

/// Whitening filter of a regression's residual, and number of samples it leaves.
struct Whitener {
    filter: ArFilter,
    segments: Vec<Range<usize>>,
    samples: usize,
}

impl Whitener {
    fn of(series: &Series, fit: &Fit) -> Self {
        let mut end = 0;
        let segments: Vec<Range<usize>> = series
            .segments
            .iter()
            .map(|n| {
                end += n;
                end - n..end
            })
            .collect();
        let filter = ArFilter::fit(&fit.residual(series), &segments, MEMORY);
        let samples = segments.iter().map(|s| s.len().saturating_sub(filter.order())).sum();
        Self { filter, segments, samples }
    }

    fn white(&self, series: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; self.samples];
        let mut rest = &mut out[..];
        for s in self.segments.iter().filter(|s| s.len() > self.filter.order()) {
            let (own, others) = rest.split_at_mut(s.len() - self.filter.order());
            self.filter.apply(series, s.start + self.filter.order()..s.end, own);
            rest = others;
        }
        out
    }

    /// Bayes' information of a regression after whitening; `None` if too few samples are left, or nothing varies.
    fn cost(&self, series: &Series, fit: &Fit) -> Option<f64> {
        let features: Vec<Vec<f64>> = fit.features.iter().map(|f| self.white(f)).collect();
        let columns: Vec<&[f64]> = features.iter().map(Vec::as_slice).collect();
        let least = least_squares(&columns, &self.white(&series.torque))?;
        let n = self.samples as f64;
        Some(n * least.mean_square.max(f64::MIN_POSITIVE).ln() + columns.len() as f64 * n.ln())
    }
}

/// The regression over all recordings.
pub(super) struct Fit {
    pub least: LeastSquares,
    features: Vec<Vec<f64>>,
    /// Indices of the coefficients of Coulomb and viscous friction, and of friction by load; `None` without the term.
    pub friction: [Option<usize>; 3],
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
        let mut with = [true, true, !series.by_load.is_empty()];
        loop {
            let fit = Self::with(series, gravity, constant, with)?;
            let is_negative = |place: &Option<usize>| place.is_some_and(|k| fit.least.beta[k] < 0.0);
            // Friction by load first, then viscous friction: in one direction at one speed it is told from Coulomb friction worst.
            match fit.friction.iter().rposition(is_negative) {
                Some(term) => with[term] = false,
                None => return Some(fit),
            }
        }
    }

    fn with(series: &Series, gravity: bool, constant: bool, friction: [bool; 3]) -> Option<Self> {
        let count = series.recording.last().map_or(0, |r| r + 1);
        let mut features = vec![series.acceleration.clone()];
        let laws = [&series.sign, &series.rate, &series.by_load];
        let friction = [0, 1, 2].map(|k| (friction[k], laws[k])).map(|(is_used, feature)| {
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
        let moves = deviation(&series.rate) > 0.0 && deviation(&series.acceleration) > 0.0;
        if !moves || !least.beta.iter().all(|b| b.is_finite()) {
            return None;
        }
        let mut fit = Self { least, features, friction, load, constants, sines, inflation: 1.0 };
        let residual = fit.residual(series);
        let mut rest = &residual[..];
        let rests: Vec<Vec<f64>> =
            series.segments.iter().filter_map(|n| rest.split_off(..*n)).map(<[f64]>::to_vec).collect();
        fit.inflation = correlation_time(&rests).sqrt();
        Some(fit)
    }

    /// Torque of the regression.
    fn fitted(&self) -> Vec<f64> {
        let mut sum = vec![0.0; self.features.first().map_or(0, Vec::len)];
        for (b, feature) in self.least.beta.iter().zip(&self.features) {
            sum.iter_mut().zip(feature).for_each(|(sum, x)| *sum += b * x);
        }
        sum
    }

    fn residual(&self, series: &Series) -> Vec<f64> {
        series.torque.iter().zip(self.fitted()).map(|(torque, fitted)| torque - fitted).collect()
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
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;
    use crate::recording::{Recording, Signals};

    /// Friction that reverses over 1/`steepness` along two sines, with steps of 1e-4 N·m as its only noise.
    fn bench(steepness: f64) -> Dataset {
        loaded(steepness, [0.0; 2], |_| 0.0)
    }

    /// As [`bench`], with a weight of that torque, N·m, friction in that share of the transmitted torque, and `noise`.
    fn loaded(steepness: f64, [weight, share]: [f64; 2], mut noise: impl FnMut(usize) -> f64) -> Dataset {
        let mut samples = Vec::new();
        for k in 0..20_000 {
            let t = f64::from(k) * 5e-4;
            let sum = |f: &dyn Fn(f64, f64) -> f64| f(0.8, 2.1) + f(0.2, 7.7);
            let rate = sum(&|a, w| a * w * (w * t).cos());
            let (angle, sign) = (sum(&|a, w| a * (w * t).sin()), (steepness * rate).tanh());
            let acceleration = sum(&|a, w| -a * w * w * (w * t).sin());
            let own = 0.02 * acceleration + 0.3 * sign + 0.05 * rate + weight * angle.sin();
            // |τ| = own·sign τ + share·|τ|·sign, and the sign of τ is that of `own`, as the share is below 1.
            let torque = own / (1.0 - share * sign * own.signum()) + noise(k as usize);
            samples.push([t, angle, (torque * 1e4).round() / 1e4]);
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

    /// Autoregressive noise of 0.08 N·m with a memory of 20 ms, much slower than the reversals.
    fn slow_noise(seed: u64) -> impl FnMut(usize) -> f64 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (mut now, memory) = (0.0, (-5e-4f64 / 0.02).exp());
        move |_| {
            let step: f64 = StandardNormal.sample(&mut rng);
            now = memory * now + 0.08 * (1.0 - memory * memory).sqrt() * step;
            now
        }
    }

    /// Friction by load, 8 % of up to 6 N·m, is larger than Coulomb friction, and reverses as that does.
    #[test]
    fn friction_by_load_does_not_hide_how_friction_reverses() {
        let axis = Mechanism::axis(Joint::Revolute);
        for (seed, truth) in [(1, 30.0), (2, 45.0), (3, 60.0)] {
            let found = steepness(&[loaded(truth, [6.0, 0.08], slow_noise(seed))], axis, 600.0, 3.3);
            let found = found.expect("a steepness");
            assert!((found / truth - 1.0).abs() < 0.15, "{found} for {truth}");
        }
        // A sharp reversal stays sharp.
        for seed in 4..7 {
            let found = steepness(&[loaded(600.0, [6.0, 0.08], slow_noise(seed))], axis, 600.0, 3.3);
            assert!(found.is_none_or(|found| found > 300.0), "{found:?}");
        }
    }
}
