//! Load at the flange that the setup does not state.
//!
//! A load of mass m with the first moment h = m·c and the moment Θ about the vertical axis of the flange (end-effector
//! frame) changes the torques by Δτ = m·z_m + h_x·z_x + h_y·z_y + Θ·z_Θ, linear in the inertia (Newton–Euler, Gnad et
//! al. eq. 4). The platform does not tilt, so the other components change no torque, and Θ changes the torque of axis 4 alone.
//! Mass and first moment follow from the arms, Θ from axis 4; constant and friction of every axis are estimated along.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use super::instants::{Predicted, beyond, carrying};
use super::mild::Context;
use super::{Evidence, Finding, Problem, Remedy, rounded};
use crate::identification::Dataset;
use crate::identification::least_squares::{LeastSquares, least_squares};
use crate::identification::residuals::rms;
use crate::machine::{Inertia, Payload};

/// Smallest payload that is reported, kg.
const PAYLOAD: f64 = 0.25;
/// Share of the residual's variance above the noise that a payload must explain, and largest relative spread of its estimates by arm.
const PAYLOAD_SHARE: (f64, f64) = (0.6, 0.25);
/// Largest ratio of the residual above the noise with to that without the payload.
const CARRIED: f64 = 0.7;
/// Ratio of an estimate to its standard error from which it is stated.
const CERTAIN: f64 = 5.0;
/// Distance of the centre of mass from the axis from which it is stated, m.
const OFF_AXIS: f64 = 5e-3;
/// Ratio of the residual with the load off the axis to that on it below which it is off.
const FALL: f64 = 0.95;
/// Least radius of gyration of a load whose moment about the vertical is stated, m.
const GYRATION: f64 = 0.02;
/// Distance of a load from the axis, m, at which it must change the torques by this share of the load's mass.
const FAR: (f64, f64) = (0.3, 0.02);
/// Blocks of time over which residuals count as independent.
const BLOCKS: usize = 30;

/// Load at the flange in addition to the stated payload.
pub struct Load {
    /// Its inertia in the end-effector frame; components without influence on the torques are zero.
    pub inertia: Inertia,
    /// Standard error of its mass, kg: from blocks of time, whose samples depend on each other, and from the difference
    /// between the arms, which errors of the model cause.
    pub std: f64,
    /// Whether its centre of mass differs from the stated payload's, or its moment about the vertical is determined.
    is_shaped: bool,
    /// Its torques by channel, N·m.
    pub torques: Vec<Vec<f64>>,
    /// RMS residual of the arms without the load, N·m.
    pub before: f64,
    /// RMS residual of the arms with the load, N·m.
    pub after: f64,
    /// RMS torque of the arms, N·m.
    pub measured: f64,
}

/// Series of the arms without what constant and friction explain, by arm.
type Beyond = Vec<Vec<f64>>;

/// Finding about a load in addition to the stated payload; `None` if they are less than nothing.
pub fn carries(dataset: &Dataset, stated: &Payload, load: &Load) -> Option<Finding> {
    let total = stated.mass + load.inertia.mass;
    if total <= -PAYLOAD {
        return None;
    }
    let total = total.max(0.0);
    let said = if stated.mass == 0.0 { "states none".into() } else { format!("states {} kg", stated.mass) };
    let payload = load.added_to(stated).filter(|_| load.is_shaped);
    let aside = payload.map_or(0.0, |p| p.com.xy().norm());
    let place = if aside > OFF_AXIS { format!(", {:.0} mm off its axis", 1e3 * aside) } else { String::new() };
    let (mass, std) = (rounded(total, 3), rounded(load.std, 1));
    Some(Finding {
        recording: dataset.name.clone(),
        axis: None,
        problem: Problem::Payload,
        severe: false,
        evidence: Evidence {
            value: Some((total, load.std)),
            rms_before: Some(load.before),
            rms_after: Some(load.after),
            ..Evidence::default()
        },
        sentence: format!("the arms carry about {mass} ± {std} kg at the flange{place}, the setup {said}"),
        remedy: payload.map_or(Remedy::PayloadMass(total), Remedy::Payload),
    })
}

impl Load {
    /// The stated payload with the load, each component with the digits that a setup has; `None` without mass.
    fn added_to(&self, stated: &Payload) -> Option<Payload> {
        let mut all = stated.inertia();
        all += self.inertia;
        if all.mass <= 0.0 {
            return None;
        }
        let com = all.first_moment / all.mass;
        let zz = all.tensor[(2, 2)] - all.mass * com.xy().norm_squared();
        let millimetres = com.map(|x| (1e3 * x).round() / 1e3);
        Some(Payload::new(rounded(all.mass, 3), millimetres, rounded(zz.max(0.0), 2)))
    }
}

impl Context<'_> {
    /// Load on which all arms agree; `None` if there is no clear one.
    pub fn load(&self) -> Option<Load> {
        if !self.plant.assembled {
            return None;
        }
        let com = self.plant.payload.com;
        let first = |axis: usize| {
            let first_moment = Vector3::from_fn(|k, _| if k == axis { 0.05 } else { 0.0 });
            (Inertia { first_moment, ..Inertia::ZERO }, 20.0)
        };
        let [kilogram, x, y] = [(Inertia::point(1.0, com), 1.0), first(0), first(1)].map(|unit| self.torques(unit));
        let (kilogram, x, y) = (kilogram?, x?, y?);
        let arms = self.plant.mechanism.arms();
        let size = |all: &[Vec<f64>]| all.iter().take(arms).map(|z| rms(z)).sum::<f64>();
        let is_off_seen = [&x, &y].iter().all(|z| FAR.0 * size(z) > FAR.1 * size(&kilogram));
        let residuals: Vec<Vec<f64>> = (0..arms).map(|i| self.residual(i, 0)).collect();
        let r = self.beyond(&residuals)?;
        let units = [kilogram, x, y];
        let [z, x, y] = [0, 1, 2].map(|k| self.beyond(&units[k]));
        let columns = [z?, x?, y?];
        let mut found = Solution::new(&columns[..1], &r)?;
        let mut load = self.loaded(&found, &units, &residuals);
        let off = if is_off_seen { Solution::new(&columns, &r).filter(Solution::is_off_axis) } else { None };
        if let Some(off) = off {
            let aside = self.loaded(&off, &units, &residuals);
            if aside.after < FALL * load.after {
                (found, load) = (off, aside);
            }
        }
        // Noise is in every residual and explained by nothing.
        let noise = rms(&self.noise[..arms]).powi(2);
        let excess = |square: f64| (square - noise).max(0.0);
        let [whole, left] = [found.whole, found.fit.mean_square].map(excess);
        let is_clear = found.mass().abs() > PAYLOAD.max(CERTAIN * found.std)
            && left < (1.0 - PAYLOAD_SHARE.0) * whole
            && found.each.iter().all(|m| (m - found.mass()).abs() < PAYLOAD_SHARE.1 * found.mass().abs())
            && excess(load.after.powi(2)) < CARRIED * CARRIED * excess(load.before.powi(2));
        if is_clear {
            self.add_moment(&mut load);
        }
        is_clear.then_some(load)
    }

    /// Torques of an inertia at the flange times a factor, by channel; `None` where a pose is unreachable.
    fn torques(&self, (inertia, factor): (Inertia, f64)) -> Option<Vec<Vec<f64>>> {
        let channels = &self.instants.dataset.channels;
        let heavy = Predicted::new(&carrying(self.plant, inertia), channels, 0.0, &self.joints);
        let plain = Predicted::new(self.plant, channels, 0.0, &self.joints);
        let possible = [&heavy, &plain].iter().all(|p| p.possible.iter().all(|p| *p));
        let difference = |(h, p): (&Vec<f64>, &Vec<f64>)| h.iter().zip(p).map(|(h, p)| factor * (h - p)).collect();
        possible.then(|| heavy.series.iter().zip(&plain.series).map(difference).collect())
    }

    /// Series of the arms after regression on constant and friction of each.
    fn beyond(&self, series: &[Vec<f64>]) -> Option<Beyond> {
        let one = |(axis, y): (usize, &Vec<f64>)| beyond(y, &self.friction[axis]);
        series.iter().enumerate().take(self.plant.mechanism.arms()).map(one).collect()
    }

    /// The load of a solution with its torques, and the residuals of the arms.
    fn loaded(&self, found: &Solution, units: &[Vec<Vec<f64>>; 3], residuals: &[Vec<f64>]) -> Load {
        let beta = &found.fit.beta;
        let channel = |c: usize| -> Vec<f64> {
            let at = |k: usize| beta.iter().zip(units).map(|(b, unit)| b * unit[c][k]).sum();
            (0..self.ones.len()).map(at).collect()
        };
        let torques: Vec<Vec<f64>> = (0..units[0].len()).map(channel).collect();
        let mut inertia = Inertia::point(found.mass(), self.plant.payload.com);
        if let [_, x, y] = beta[..] {
            inertia.first_moment += Vector3::new(x, y, 0.0);
        }
        let left = |(r, z): (&Vec<f64>, &Vec<f64>)| r.iter().zip(z).map(|(r, z)| r - z).collect::<Vec<f64>>();
        let after: Vec<f64> = residuals.iter().zip(&torques).flat_map(left).collect();
        let measured: Vec<f64> = (0..residuals.len()).flat_map(|i| self.instants.measured(i, 0)).collect();
        Load {
            inertia,
            std: found.std,
            is_shaped: beta.len() > 1,
            torques,
            before: rms(&residuals.concat()),
            after: rms(&after),
            measured: rms(&measured),
        }
    }

    /// Adds the moment about the vertical that axis 4 shows, if it does.
    fn add_moment(&self, load: &mut Load) {
        let axis = self.plant.mechanism.arms();
        if !self.plant.mechanism.has_telescope() || self.friction.len() <= axis {
            return;
        }
        let mut tensor = Matrix3::zeros();
        tensor[(2, 2)] = 0.01;
        let Some(unit) = self.torques((Inertia { tensor, ..Inertia::ZERO }, 100.0)) else { return };
        let [rate, sign] = &self.friction[axis];
        let features = [&unit[axis][..], &self.ones, rate, sign];
        let rest: Vec<f64> = self.residual(axis, 0).iter().zip(&load.torques[axis]).map(|(r, z)| r - z).collect();
        let Some(LeastSquares { beta, std, .. }) = least_squares(&features, &rest) else { return };
        // Samples depend on each other, so the error is larger than for independent ones.
        let is_large = beta[0] > load.inertia.mass.abs() * GYRATION * GYRATION;
        if is_large && beta[0] > CERTAIN * CERTAIN * std[0] && std[0] > 0.0 {
            load.inertia.tensor[(2, 2)] += beta[0];
            load.is_shaped = true;
            load.torques[axis].iter_mut().zip(&unit[axis]).for_each(|(t, z)| *t += beta[0] * z);
        }
    }
}

/// Mass and, with three columns, first moment of a load.
struct Solution {
    fit: LeastSquares,
    /// Standard error of the mass, kg.
    std: f64,
    /// Standard errors of the first moments, kg·m.
    moments: Vec<f64>,
    /// Mean square of the residual without the load.
    whole: f64,
    /// Mass by arm, kg.
    each: Vec<f64>,
}

impl Solution {
    /// Least squares of the arms' residuals `r` by `columns`, each by arm.
    fn new(columns: &[Beyond], r: &Beyond) -> Option<Self> {
        let stacked: Vec<Vec<f64>> = columns.iter().map(|c| c.concat()).collect();
        let features: Vec<&[f64]> = stacked.iter().map(Vec::as_slice).collect();
        let y = r.concat();
        let fit = least_squares(&features, &y)?;
        let without_mass = |arm: usize, k: usize| -> f64 {
            r[arm][k] - (1..columns.len()).map(|c| fit.beta[c] * columns[c][arm][k]).sum::<f64>()
        };
        let of_arm = |arm: usize| {
            let z = &columns[0][arm];
            let product: f64 = z.iter().enumerate().map(|(k, z)| z * without_mass(arm, k)).sum();
            product / z.iter().map(|z| z * z).sum::<f64>().max(f64::MIN_POSITIVE)
        };
        let each: Vec<f64> = (0..r.len()).map(of_arm).collect();
        let variances = block_variances(columns, r, &fit.beta)?;
        let (n, mean) = (each.len() as f64, each.iter().sum::<f64>() / each.len() as f64);
        let between = each.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (n * (n - 1.0).max(1.0));
        let std = (variances[0] + between).sqrt();
        let moments = variances[1..].iter().map(|v| v.sqrt()).collect();
        Some(Self { fit, std, moments, whole: rms(&y).powi(2), each })
    }

    fn mass(&self) -> f64 {
        self.fit.beta[0]
    }

    /// Whether the centre of mass is clearly off the axis.
    fn is_off_axis(&self) -> bool {
        let first = &self.fit.beta[1..];
        let certain = first.iter().zip(&self.moments).any(|(h, std)| h.abs() > CERTAIN * std);
        certain && first.iter().map(|h| h * h).sum::<f64>().sqrt() > OFF_AXIS * self.mass().abs()
    }
}

/// Variances of least-squares estimates from residuals that are independent between [`BLOCKS`] blocks of time only:
/// N⁻¹·(Σ s_b·s_bᵀ)·N⁻¹ with N = XᵀX and s_b = X_bᵀ·e_b of block b, over all arms.
fn block_variances(columns: &[Beyond], r: &Beyond, beta: &[f64]) -> Option<Vec<f64>> {
    let (p, samples) = (columns.len(), r.first()?.len());
    let mut normal = DMatrix::zeros(p, p);
    let mut scores = vec![DVector::zeros(p); BLOCKS];
    for arm in 0..r.len() {
        for k in 0..samples {
            let x = DVector::from_fn(p, |c, _| columns[c][arm][k]);
            let e = r[arm][k] - (0..p).map(|c| beta[c] * x[c]).sum::<f64>();
            normal += &x * x.transpose();
            scores[k * BLOCKS / samples] += x * e;
        }
    }
    let inverse = normal.try_inverse()?;
    let spread = scores.iter().fold(DMatrix::zeros(p, p), |sum, s| sum + s * s.transpose());
    let freedom = BLOCKS as f64 / (BLOCKS - p) as f64;
    Some((freedom * &inverse * spread * &inverse).diagonal().iter().map(|v| v.max(0.0)).collect())
}
