//! Findings that do not prevent a fit: lag, an unstated load, constant torques.

use super::instants::{Instants, Predicted, heavier};
use super::low_pass::low_pass;
use super::{Evidence, Finding, Problem, Remedy, rounded};
use crate::dynamics::Plant;
use crate::identification::Dataset;
use crate::identification::least_squares::{LeastSquares, least_squares};
use crate::identification::residuals::{difference, rms};
use crate::kinematics::JointState;
use crate::model::Model;

/// Steepness of the friction feature, s/rad (eq. 48).
pub(super) const STEEPNESS: f64 = 100.0;
/// Mean decrease of ln(unexplained) per axis required for a lag.
const LAG_GAIN: f64 = 0.4;
/// Smallest payload that is reported, kg.
const PAYLOAD: f64 = 0.25;
/// Share of the residual's variance that a payload must explain, and largest relative spread of its estimates by arm.
const PAYLOAD_SHARE: (f64, f64) = (0.6, 0.25);
/// Largest ratio of the residual with to that without the payload.
const CARRIED: f64 = 0.7;
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
            series.iter_mut().zip(z).for_each(|(p, z)| *p += load.mass * z);
        }
    }
    let drives = context.friction.len();
    let constants: Vec<Finding> = (0..drives).filter_map(|i| context.offset(i)).collect();
    if let Some(other) = load.as_ref().and_then(|load| context.another_machine(load, &constants)) {
        return vec![other];
    }
    load.and_then(|load| context.payload(&load)).into_iter().chain(constants).collect()
}

/// Finding about a load in addition to the stated payload, kg; `None` if they are less than nothing.
pub fn carries(dataset: &Dataset, stated: f64, load: f64) -> Option<Finding> {
    let total = stated + load;
    let said = if stated == 0.0 { "states none".into() } else { format!("states {stated} kg") };
    (total > 0.0).then(|| Finding {
        recording: dataset.name.clone(),
        axis: None,
        problem: Problem::Payload,
        severe: false,
        evidence: Evidence { value: Some((total, 0.0)), ..Evidence::default() },
        sentence: format!("the arms carry about {} kg at the flange, the setup {said}", rounded(total, 2)),
        remedy: Remedy::PayloadMass(total),
    })
}

/// Load that a recording shows and its setup does not state; `None` if there is no clear one.
pub fn load(model: &Model, plant: &Plant, instants: &Instants) -> Option<Load> {
    Context::new(model, plant, instants)?.load()
}

/// Mass at the flange in addition to the stated payload.
pub struct Load {
    /// Mass, kg.
    pub mass: f64,
    /// Its standard error for independent residuals, kg.
    pub std: f64,
    /// Torques of one kilogram by channel, N·m.
    torques: Vec<Vec<f64>>,
    /// RMS residual of the arms without the load, N·m.
    pub before: f64,
    /// RMS residual of the arms with the load, N·m.
    pub after: f64,
    /// RMS torque of the arms, N·m.
    pub measured: f64,
}

struct Context<'a> {
    plant: &'a Plant,
    instants: &'a Instants<'a>,
    predicted: Predicted,
    /// Rate and its smooth sign, by axis.
    friction: Vec<[Vec<f64>; 2]>,
    joints: Vec<JointState>,
    noise: Vec<f64>,
    ones: Vec<f64>,
}

impl<'a> Context<'a> {
    /// Context of the tests; `None` where a pose is unreachable.
    fn new(model: &Model, plant: &'a Plant, instants: &'a Instants<'a>) -> Option<Self> {
        let dataset = instants.dataset;
        let joints = instants.joints(|j| *j);
        let predicted = Predicted::new(plant, &dataset.channels, dataset.t.first().copied().unwrap_or(0.0), &joints);
        let drives = plant.mechanism.axes().min(predicted.series.len());
        let friction = |i: usize| {
            let rates: Vec<f64> = joints.iter().map(|j| j.qd[i]).collect();
            let signs = rates.iter().map(|r| (STEEPNESS * r).tanh()).collect();
            [rates, signs]
        };
        let friction = (0..drives).map(friction).collect();
        let possible = predicted.possible.iter().all(|p| *p);
        let ones = vec![1.0; joints.len()];
        possible.then(|| Self { plant, instants, predicted, friction, joints, noise: dataset.noise(model), ones })
    }

    fn residual(&self, axis: usize, lag: isize) -> Vec<f64> {
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
        let cost = |lag: isize| {
            (0..drives).filter_map(|i| Some(self.fit(i, lag)?.mean_square.max(f64::MIN_POSITIVE).ln())).sum::<f64>()
        };
        let costs: Vec<f64> = (-reach..=reach).map(cost).collect();
        let best = (-reach..=reach).min_by(|a, b| {
            let of = |lag: &isize| costs[(lag + reach) as usize];
            of(a).total_cmp(&of(b))
        })?;
        let gain = (costs[reach as usize] - costs[(best + reach) as usize]) / drives as f64;
        if best == 0 || best.abs() == reach || gain < LAG_GAIN {
            return None;
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

    /// Torques of an additional kilogram at the flange, by channel; `None` where a pose is unreachable.
    fn kilogram(&self) -> Option<Vec<Vec<f64>>> {
        let channels = &self.instants.dataset.channels;
        let [heavy, plain] = [&heavier(self.plant), self.plant].map(|p| Predicted::new(p, channels, 0.0, &self.joints));
        let possible = [&heavy, &plain].iter().all(|p| p.possible.iter().all(|p| *p));
        let difference = |(h, p): (&Vec<f64>, &Vec<f64>)| h.iter().zip(p).map(|(h, p)| h - p).collect();
        possible.then(|| heavy.series.iter().zip(&plain.series).map(difference).collect())
    }

    /// Residual of a series of one axis after regression on constant and friction.
    fn beyond_friction(&self, axis: usize, y: &[f64]) -> Option<Vec<f64>> {
        let [rate, sign] = &self.friction[axis];
        let features = [&self.ones[..], rate, sign];
        let fit = least_squares(&features, y)?;
        Some((0..y.len()).map(|k| y[k] - (0..3).map(|a| fit.beta[a] * features[a][k]).sum::<f64>()).collect())
    }

    /// Additional mass at the flange on which all arms agree; `None` if there is none.
    fn load(&self) -> Option<Load> {
        if !self.plant.assembled {
            return None;
        }
        let torques = self.kilogram()?;
        let arms = self.plant.mechanism.arms();
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let (mut product, mut square, mut whole) = (0.0, 0.0, 0.0);
        let mut each = Vec::new();
        for i in 0..arms {
            let (r, z) = (self.beyond_friction(i, &self.residual(i, 0))?, self.beyond_friction(i, &torques[i])?);
            each.push(dot(&r, &z) / dot(&z, &z).max(f64::MIN_POSITIVE));
            product += dot(&r, &z);
            square += dot(&z, &z);
            whole += dot(&r, &r);
        }
        let mass = product / square.max(f64::MIN_POSITIVE);
        let share = product * mass / whole.max(f64::MIN_POSITIVE);
        let alike = each.iter().all(|m| (m - mass).abs() < PAYLOAD_SHARE.1 * mass.abs());
        let samples = (arms * self.ones.len()) as f64;
        let std = ((1.0 - share).max(0.0) * whole / samples / square.max(f64::MIN_POSITIVE)).sqrt();
        let arms = |loaded: f64| {
            let rest =
                |i: usize| self.residual(i, 0).into_iter().zip(torques[i].clone()).map(move |(r, z)| r - loaded * z);
            rms(&(0..arms).flat_map(rest).collect::<Vec<_>>())
        };
        let (before, after) = (arms(0.0), arms(mass));
        let drives = 0..self.plant.mechanism.arms();
        let measured = rms(&drives.flat_map(|i| self.instants.measured(i, 0)).collect::<Vec<_>>());
        let clear = mass.abs() > PAYLOAD && share > PAYLOAD_SHARE.0 && alike && after < CARRIED * before;
        clear.then_some(Load { mass, std, torques, before, after, measured })
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
                value: Some((load.mass, load.std)),
                rms_before: Some(load.before),
                rms_after: Some(load.after),
                ..Evidence::default()
            },
            sentence: format!(
                "the arms carry {} kg more at the flange and constants of {} N·m: another machine",
                rounded(load.mass, 2),
                text.join(", ")
            ),
            remedy: Remedy::Words("the model of the machine that was measured"),
        })
    }

    fn payload(&self, load: &Load) -> Option<Finding> {
        let found = carries(self.instants.dataset, self.plant.payload.mass, load.mass)?;
        let value = found.evidence.value.map(|(total, _)| (total, load.std));
        let (rms_before, rms_after) = (Some(load.before), Some(load.after));
        Some(Finding { evidence: Evidence { value, rms_before, rms_after, ..Evidence::default() }, ..found })
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
        let channel = self.instants.dataset.channels[axis];
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
            sentence: format!("axis {k} reads a constant {value:+} {} too much", channel.unit()),
            remedy: Remedy::Map(vec![format!("tau{k}=tau{k}{:+}", -value)]),
        })
    }
}
