//! Lines of a series' spectrum over an angle.
//!
//! What is periodic in an angle has lines in the sums S(n) = Σ_k r_k·exp(−i·n·θ_k) over the samples, at its orders n.
//! Friction, inertia and gravity give broad spectra: an order counts only if its power exceeds the median of its
//! neighbourhood by more than noise does at any of the orders searched. Orders are searched one after the other, each in
//! what the previous ones leave [Mallat 1993].

use nalgebra::{DMatrix, DVector};

use super::dataset::stride_for;
use crate::numerics::{fourier, median};

/// Least number of periods within the travel.
pub const LEAST_PERIODS: f64 = 3.0;
/// Largest number of orders.
pub const MOST_ORDERS: usize = 8;
/// Largest frequency of a line at the RMS speed, relative to the sampling rate.
const HIGHEST: f64 = 0.4;
/// Probability that noise alone gives a line at any of the orders searched.
const FALSE_LINE: f64 = 1e-3;
/// Least share of the variance left by the lines found before that a line must explain.
const LEAST_SHARE: f64 = 0.01;
/// Half width of the neighbourhood of a line, in widths of a line.
const NEIGHBOURHOOD: usize = 40;
/// Number of bins of the angle per shortest period: rounding to a bin costs at most 1 % of the amplitude.
const BINS: f64 = 8.0;
/// Largest number of bins.
const MOST_BINS: usize = 1 << 20;
/// Largest number of samples with which an order is refined.
const REFINED: usize = 10_000;
/// Distance from an integer, in widths of a line, below which an order is that integer.
const WHOLE: f64 = 0.25;

/// A series over an angle.
pub struct OverAngle {
    /// Angle, rad, from its smallest value.
    angle: Vec<f64>,
    residual: Vec<f64>,
    /// Travel of the angle, rad.
    travel: f64,
    /// Largest order whose line is below [`HIGHEST`] of the sampling rate.
    highest: f64,
}

impl OverAngle {
    /// The series about its mean, at angles (rad) that change at the given RMS speed (rad/s), sampled every `dt` seconds.
    pub fn new(mut angle: Vec<f64>, mut residual: Vec<f64>, speed: f64, dt: f64) -> Self {
        let (low, high) = angle.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(*x), b.max(*x)));
        angle.iter_mut().for_each(|x| *x -= low);
        let mean = residual.iter().sum::<f64>() / residual.len().max(1) as f64;
        residual.iter_mut().for_each(|r| *r -= mean);
        let highest = HIGHEST * std::f64::consts::TAU / (dt * speed).max(f64::MIN_POSITIVE);
        Self { angle, residual, travel: high - low, highest }
    }

    /// Width of a line: difference of two orders by one period within the travel.
    pub fn width(&self) -> f64 {
        std::f64::consts::TAU / self.travel
    }

    /// Orders of the lines with their share of the residual's variance; on an angle that `turns`, one that does not differ
    /// from an integer is that integer.
    pub fn orders(&self, turns: bool) -> Vec<(f64, f64)> {
        let mut found: Vec<(f64, f64)> = Vec::new();
        if !(self.travel > 0.0 && self.width() * LEAST_PERIODS < self.highest) {
            return found;
        }
        let energy = |series: &[f64]| series.iter().map(|r| r * r).sum::<f64>();
        let whole = energy(&self.residual);
        let mut left = self.residual.clone();
        while found.len() < MOST_ORDERS {
            let Some(order) = self.line(&left) else { break };
            let refined = self.refined(order, &found);
            let order = if turns { self.whole(refined) } else { refined };
            if found.iter().any(|(known, _)| (known - order).abs() < self.width()) {
                break;
            }
            let mut orders: Vec<f64> = found.iter().map(|(order, _)| *order).collect();
            orders.push(order);
            let Some(next) = self.without(&orders) else { break };
            let gain = energy(&left) - energy(&next);
            if gain < LEAST_SHARE * energy(&left) {
                break;
            }
            found.push((order, gain / whole));
            left = next;
        }
        found
    }

    /// The order near `order` whose wave, with those found, leaves the least residual.
    fn refined(&self, order: f64, found: &[(f64, f64)]) -> f64 {
        let thin = self.thinned(stride_for(self.angle.len(), REFINED));
        let left = |order: f64| {
            let all: Vec<f64> = found.iter().map(|(known, _)| *known).chain([order]).collect();
            thin.without(&all).map_or(f64::INFINITY, |left| left.iter().map(|r| r * r).sum())
        };
        // Three rounds of nine orders each, over one width, a quarter and a sixteenth of it.
        (0..3).fold(order, |centre, round| {
            let step = self.width() / f64::from(8 << (2 * round));
            let near = (-4..=4).map(|k| centre + f64::from(k) * step);
            near.min_by(|a, b| left(*a).total_cmp(&left(*b))).unwrap_or(centre)
        })
    }

    /// Every `stride`-th sample.
    fn thinned(&self, stride: usize) -> Self {
        let every = |series: &[f64]| series.iter().copied().step_by(stride).collect();
        Self { angle: every(&self.angle), residual: every(&self.residual), ..*self }
    }

    /// The nearest integer, if the order does not differ from it.
    fn whole(&self, order: f64) -> f64 {
        let nearest = order.round();
        if (order - nearest).abs() < WHOLE * self.width() { nearest } else { order }
    }

    /// The strongest line of a series relative to its neighbourhood; `None` if noise explains all of them.
    fn line(&self, series: &[f64]) -> Option<f64> {
        let bins = ((self.travel * self.highest * BINS / std::f64::consts::TAU) as usize).clamp(16, MOST_BINS);
        // Twice the travel: four values per line.
        let length = 4 * bins;
        let mut input = vec![0.0; length];
        let scale = (bins - 1) as f64 / self.travel;
        for (angle, r) in self.angle.iter().zip(series) {
            input[(angle * scale).round() as usize] += r;
        }
        let power = fourier::power(input);
        // Order of value k of the spectrum.
        let step = std::f64::consts::TAU * scale / length as f64;
        let first = (LEAST_PERIODS * self.width() / step).ceil() as usize;
        let last = ((self.highest / step) as usize).min(power.len().saturating_sub(2));
        let around = 4 * NEIGHBOURHOOD;
        let threshold = (((last.checked_sub(first)?) as f64 / 4.0 + 1.0) / FALSE_LINE).ln();
        let ratio = |k: usize| {
            let near = &power[k.saturating_sub(around).max(first.min(k))..(k + around).min(last) + 1];
            // The median of exponentially distributed values is ln 2 of their mean.
            power[k] * std::f64::consts::LN_2 / median(near.iter().copied()).max(f64::MIN_POSITIVE)
        };
        let peaks = (first.max(1)..=last).filter(|&k| power[k] > power[k - 1] && power[k] >= power[k + 1]);
        let mut peaks: Vec<usize> = peaks.collect();
        peaks.sort_by(|&a, &b| power[b].total_cmp(&power[a]));
        // The strongest line that stands out; weaker ones follow when it is removed.
        let k = peaks.into_iter().take(4 * MOST_ORDERS).find(|&k| ratio(k) > threshold)?;
        let (before, at, after) = (power[k - 1], power[k], power[k + 1]);
        let shift = 0.5 * (before - after) / (before - 2.0 * at + after);
        Some((k as f64 + if shift.is_finite() { shift } else { 0.0 }) * step)
    }

    /// The residual without the least-squares waves at the orders; `None` if they are not independent.
    fn without(&self, orders: &[f64]) -> Option<Vec<f64>> {
        let columns = 2 * orders.len();
        let row = |angle: f64| -> DVector<f64> {
            let waves = orders.iter().flat_map(|order| {
                let (s, c) = (order * angle).sin_cos();
                [s, c]
            });
            DVector::from_iterator(columns, waves)
        };
        let (mut normal, mut right) = (DMatrix::zeros(columns, columns), DVector::zeros(columns));
        for (angle, r) in self.angle.iter().zip(&self.residual) {
            let waves = row(*angle);
            normal.ger(1.0, &waves, &waves, 1.0);
            right.axpy(*r, &waves, 1.0);
        }
        let amplitudes = normal.cholesky()?.solve(&right);
        Some(self.angle.iter().zip(&self.residual).map(|(angle, r)| r - row(*angle).dot(&amplitudes)).collect())
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// Angles of a motor that turns to and fro over three turns with three incommensurable frequencies.
    fn swept(residual: impl Fn(f64, f64) -> f64) -> OverAngle {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let angle = |k: usize| {
            let t = k as f64 * 1e-3;
            10.0 + 5.0 * (1.3 * t).sin() + 3.0 * (2.9 * t + 1.0).sin() + 1.5 * (4.7 * t).sin()
        };
        let angle: Vec<f64> = (0..20_000).map(angle).collect();
        let rate = |k: usize| (angle[(k + 1).min(19_999)] - angle[k.saturating_sub(1)]) / 2e-3;
        // Noise with the memory of one sample.
        let mut noise = 0.0;
        let mut coloured = || {
            noise = 0.5 * noise + rng.random_range(-1.0..1.0);
            noise
        };
        let residual = (0..20_000).map(|k| residual(angle[k], rate(k)) + coloured()).collect();
        let (low, high) = (angle.iter().copied().fold(99.0, f64::min), angle.iter().copied().fold(0.0, f64::max));
        OverAngle { angle: angle.iter().map(|x| x - low).collect(), residual, travel: high - low, highest: 100.0 }
    }

    #[test]
    fn orders_are_found_in_coloured_noise_beside_friction() {
        // Amplitudes of a fifth to a half of the noise (0.67), beside friction of the same size.
        let series = swept(|q, rate| {
            0.3 * (3.0 * rate).tanh() + 0.3 * (72.0 * q).sin() + 0.2 * (18.0 * q + 1.0).cos() + 0.15 * (41.37 * q).sin()
        });
        let orders = series.orders(true);
        let mut found: Vec<f64> = orders.iter().map(|(order, _)| *order).collect();
        found.sort_by(f64::total_cmp);
        assert_eq!(found.len(), 3, "{orders:?}");
        assert_eq!([found[0], found[2]], [18.0, 72.0]);
        approx::assert_relative_eq!(found[1], 41.37, epsilon = 0.02);
    }

    #[test]
    fn noise_friction_and_gravity_have_no_orders() {
        for law in [|_: f64, _: f64| 0.0, |_, rate: f64| 2.0 * (100.0 * rate).tanh(), |q: f64, _| 3.0 * q.sin()] {
            let orders = swept(law).orders(true);
            assert!(orders.is_empty(), "{orders:?}");
        }
    }
}
