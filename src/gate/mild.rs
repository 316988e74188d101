//! Findings that do not prevent a fit: lag, a load that the setup does not state, constant torques.

use super::instants::{Instants, Predicted, friction};
use super::load::{Load, carries};
use super::low_pass::low_pass;
use super::{Evidence, Finding, Problem, Remedy, rounded};
use crate::dynamics::Plant;
use crate::identification::least_squares::{LeastSquares, least_squares};
use crate::identification::residuals::{difference, rms};
use crate::kinematics::JointState;
use crate::model::Model;

/// Decrease of ln(unexplained) required for a lag, of the mean over the axes or of one axis with a lag of its own.
const LAG_GAIN: f64 = 0.4;
/// Share of the mean square of one axis' torque that a lag of its own may leave unexplained.
const LAG_LEFT: f64 = 0.25;
/// Ratio to the noise that a constant must exceed, and share of the residual's mean square that it must explain.
const OFFSET: (f64, f64) = (2.0, 0.5);

/// Findings about lag, payload and constants on a recording without severe findings.
pub fn find(model: &Model, plant: &Plant, instants: &Instants) -> Vec<Finding> {
    let Some(mut context) = Context::new(model, plant, instants) else { return Vec::new() };
    let lag = context.lag();
    if lag.is_some() {
        // The residual of a lag would bias payload and constants.
        return lag.into_iter().collect();
    }
    let load = context.load();
    if let Some(load) = &load {
        for (series, z) in context.predicted.series.iter_mut().zip(&load.torques) {
            series.iter_mut().zip(z).for_each(|(p, z)| *p += z);
        }
    }
    let drives = context.friction.len();
    let constants: Vec<Finding> = (0..drives).filter_map(|i| context.offset(i)).collect();
    if let Some(other) = load.as_ref().and_then(|load| context.another_machine(load, &constants)) {
        return vec![other];
    }
    let payload = load.and_then(|load| carries(instants.dataset, &plant.payload, &load));
    payload.into_iter().chain(constants).collect()
}

/// Load that a recording shows and its setup does not state; `None` if there is no clear one.
pub fn load(model: &Model, plant: &Plant, instants: &Instants) -> Option<Load> {
    Context::new(model, plant, instants)?.load()
}

/// A recording without severe findings, and what its tests use.
pub(super) struct Context<'a> {
    pub(super) plant: &'a Plant,
    pub(super) instants: &'a Instants<'a>,
    predicted: Predicted,
    /// Rate and its smooth sign, by axis.
    pub(super) friction: Vec<[Vec<f64>; 2]>,
    pub(super) joints: Vec<JointState>,
    /// Standard deviation of the noise by channel.
    pub(super) noise: Vec<f64>,
    pub(super) ones: Vec<f64>,
}

impl<'a> Context<'a> {
    /// Context of the tests; `None` where a pose is unreachable.
    fn new(model: &Model, plant: &'a Plant, instants: &'a Instants<'a>) -> Option<Self> {
        let dataset = instants.dataset;
        let joints = instants.joints(|j| *j);
        let predicted = Predicted::new(plant, &dataset.channels, dataset.t.first().copied().unwrap_or(0.0), &joints);
        let drives = plant.mechanism.axes().min(predicted.series.len());
        let friction = (0..drives).map(|i| friction(&joints, i)).collect();
        let possible = predicted.possible.iter().all(|p| *p);
        let ones = vec![1.0; joints.len()];
        possible.then(|| Self { plant, instants, predicted, friction, joints, noise: dataset.noise(model), ones })
    }

    /// Measured torque of an axis, `lag` samples later, minus the predicted one, N·m.
    pub(super) fn residual(&self, axis: usize, lag: isize) -> Vec<f64> {
        difference(&self.instants.measured(axis, lag), &self.predicted.series[axis])
    }

    /// Regression of the measured torque on predicted torque, constant and friction.
    fn fit(&self, axis: usize, lag: isize) -> Option<LeastSquares> {
        let [rate, sign] = &self.friction[axis];
        let features = [&self.ones[..], &self.predicted.series[axis], rate, sign];
        least_squares(&features, &self.instants.measured(axis, lag))
    }

    /// Lag, common to all torques, at which they follow the angles best, and the low-pass that causes it, if any.
    fn lag(&self) -> Option<Finding> {
        let (dt, reach) = (self.instants.dataset.dt, self.instants.reach as isize);
        let drives = self.friction.len();
        let cost =
            |axis: usize, lag: isize| self.fit(axis, lag).map_or(0.0, |f| f.mean_square.max(f64::MIN_POSITIVE).ln());
        let of_each: Vec<Vec<f64>> =
            (0..drives).map(|axis| (-reach..=reach).map(|lag| cost(axis, lag)).collect()).collect();
        let costs: Vec<f64> = (0..of_each.first()?.len()).map(|k| of_each.iter().map(|c| c[k]).sum()).collect();
        let best = least(&costs)? as isize - reach;
        let gain = (costs[reach as usize] - costs[(best + reach) as usize]) / drives as f64;
        if best == 0 || best.abs() == reach || gain < LAG_GAIN {
            return self.lag_of_one(&of_each);
        }
        let lag = best as f64 * dt;
        let arms = 0..self.plant.mechanism.arms();
        let total = |lag: isize| rms(&arms.clone().flat_map(|i| self.residual(i, lag)).collect::<Vec<_>>());
        let milliseconds = rounded(1e3 * lag, 4);
        let late = if lag > 0.0 { "late" } else { "early" };
        let filter = if best > 0 { low_pass(self.plant, self.instants.dataset, best) } else { None };
        // f = 1/(2πT).
        let cut_off = |t: f64| 1.0 / (std::f64::consts::TAU * t);
        let (problem, value, sentence) = match filter {
            Some(f) => (
                Problem::LowPass,
                (cut_off(f.time_constant), cut_off(f.time_constant) * f.std / f.time_constant),
                format!(
                    "the torques went through a low-pass of about {} Hz, the angles did not; a shift by {milliseconds} ms takes \
                     its lag away, only torques recorded before it are not blurred",
                    rounded(cut_off(f.time_constant), 2)
                ),
            ),
            None => (
                Problem::Lag,
                (lag, dt / 2.0),
                format!("the torques come {} ms {late} against the angles", milliseconds.abs()),
            ),
        };
        Some(Finding {
            recording: self.instants.dataset.name.clone(),
            axis: None,
            problem,
            severe: false,
            evidence: Evidence {
                value: Some(value),
                rms_before: Some(total(0)),
                rms_after: Some(total(best)),
                ..Evidence::default()
            },
            sentence,
            remedy: Remedy::Map((1..=drives).map(|k| format!("tau{k}=tau{k}@{milliseconds}ms")).collect()),
        })
    }

    /// Lag of a single torque, where the others follow the angles best without any; `costs` by axis and lag.
    fn lag_of_one(&self, costs: &[Vec<f64>]) -> Option<Finding> {
        let (dt, reach) = (self.instants.dataset.dt, self.instants.reach);
        let best = |(axis, costs): (usize, &Vec<f64>)| {
            let least = least(costs)?;
            Some((axis, least as isize - reach as isize, costs[reach] - costs[least]))
        };
        // A torque that hardly follows the model at any lag has none.
        let follows = |axis: usize, lag: isize| {
            let power = rms(&self.instants.measured(axis, lag)).powi(2);
            self.fit(axis, lag).is_some_and(|fit| fit.mean_square < LAG_LEFT * power)
        };
        let clear = |(axis, lag, gain): &(usize, isize, f64)| {
            lag.unsigned_abs() % reach.max(1) != 0 && *gain > LAG_GAIN && follows(*axis, *lag)
        };
        let mut late = costs.iter().enumerate().filter_map(best).filter(clear);
        let (Some((axis, lag, _)), None) = (late.next(), late.next()) else { return None };
        let (k, milliseconds) = (axis + 1, rounded(1e3 * lag as f64 * dt, 4));
        Some(Finding {
            recording: self.instants.dataset.name.clone(),
            axis: Some(axis),
            problem: Problem::Lag,
            severe: false,
            evidence: Evidence {
                value: Some((lag as f64 * dt, dt / 2.0)),
                rms_before: Some(rms(&self.residual(axis, 0))),
                rms_after: Some(rms(&self.residual(axis, lag))),
                ..Evidence::default()
            },
            sentence: format!(
                "the torque of axis {k} comes {} ms {} against the angles and the other torques",
                milliseconds.abs(),
                if lag > 0 { "late" } else { "early" }
            ),
            remedy: Remedy::Map(vec![format!("tau{k}=tau{k}@{milliseconds}ms")]),
        })
    }

    /// A load and constants of one sign on all arms: arms of another weight, as neither a load nor a sensor causes
    /// them.
    fn another_machine(&self, load: &Load, constants: &[Finding]) -> Option<Finding> {
        let arms = self.plant.mechanism.arms();
        let values = |f: &Finding| f.axis.filter(|i| *i < arms).and(f.evidence.value).map(|v| v.0);
        let values: Vec<f64> = constants.iter().filter_map(values).collect();
        let one_sign = values.iter().all(|v| *v > 0.0) || values.iter().all(|v| *v < 0.0);
        if values.len() < arms || !one_sign {
            return None;
        }
        let text: Vec<String> = values.iter().map(|v| format!("{:+}", rounded(*v, 2))).collect();
        Some(Finding {
            recording: self.instants.dataset.name.clone(),
            axis: None,
            problem: Problem::AnotherMachine,
            severe: true,
            evidence: Evidence {
                value: Some((load.inertia.mass, load.std)),
                rms_before: Some(load.before),
                rms_after: Some(load.after),
                ..Evidence::default()
            },
            sentence: format!(
                "the arms carry {} kg more at the flange and constants of {} N·m: another machine",
                rounded(load.inertia.mass, 2),
                text.join(", ")
            ),
            remedy: Remedy::Words("the model of the machine that was measured"),
        })
    }

    /// A constant torque of one axis.
    fn offset(&self, axis: usize) -> Option<Finding> {
        let fit = self.fit(axis, 0)?;
        let residual = self.residual(axis, 0);
        let constant = fit.beta[0];
        let rest: Vec<f64> = residual.iter().map(|r| r - constant).collect();
        let (before, after) = (rms(&residual), rms(&rest));
        let clear = constant.abs() > OFFSET.0 * self.noise[axis] && constant.abs() > 5.0 * fit.std[0];
        if !clear || after.powi(2) > (1.0 - OFFSET.1) * before.powi(2) {
            return None;
        }
        let unit = self.instants.dataset.channels[axis].unit(self.instants.dataset.mechanism);
        let (k, value) = (axis + 1, rounded(constant, 3));
        Some(Finding {
            recording: self.instants.dataset.name.clone(),
            axis: Some(axis),
            problem: Problem::Offset,
            severe: false,
            evidence: Evidence {
                value: Some((constant, fit.std[0])),
                rms_before: Some(before),
                rms_after: Some(after),
                ..Evidence::default()
            },
            sentence: format!("axis {k} reads a constant {value:+} {} too much", unit),
            remedy: Remedy::Map(vec![format!("tau{k}=tau{k}{:+}", -value)]),
        })
    }
}

/// Place of the least of `costs`.
fn least(costs: &[f64]) -> Option<usize> {
    (0..costs.len()).min_by(|a, b| costs[*a].total_cmp(&costs[*b]))
}
