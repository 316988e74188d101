//! Data of the search for an unknown law: the residual, the columns of the model's parameters, and the response to a
//! force at each place, at some hundred instants per second.

use std::sync::Arc;

use crate::dynamics::{Plant, steady_inverse_dynamics};
use crate::effects::formula::{Expression, Formula, Place, Term, Variable};
use crate::effects::{ActiveEffect, Instant};
use crate::identification::fit::{FitError, kinematics};
use crate::identification::prediction::Channels;
use crate::identification::{Dataset, Residuals, columns};
use crate::kinematics::KinematicsError;
use crate::machine::Mechanism;
use crate::model::Model;
use crate::numerics::parallel;

/// Interval between instants, s, which resolves torque ripple up to 250 Hz.
const STEP: f64 = 2e-3;

/// Residuals of a model along recordings, with the regressors that may explain them.
#[derive(Clone, Debug, Default)]
pub struct Sight {
    /// Standard deviation of the noise of the means that the instants stand for, `[recording][channel]`, N·m or N.
    pub noise: Vec<Vec<f64>>,
    /// Residual `[channel][instant]`, in units of the channel's noise.
    pub residual: Vec<Vec<f64>>,
    /// Columns of the model's parameters, `[parameter][channel][instant]`, in units of the channel's noise.
    pub base: Vec<Vec<Vec<f64>>>,
    /// Places of the machine.
    pub places: Vec<Place>,
    /// Response to a unit force at each place, `[place][channel][instant]`, in units of the channel's noise.
    pub responses: Vec<Vec<Vec<f64>>>,
    /// Every variable at every instant.
    pub variables: Vec<Vec<f64>>,
    /// Ranges of instants without gaps.
    pub segments: Vec<std::ops::Range<usize>>,
    /// Recording of each instant.
    pub recording: Vec<usize>,
}

impl Sight {
    /// Data of `model` along `datasets`, each scaled by its own noise.
    /// Columns of `fixed` parameters are omitted.
    ///
    /// # Errors
    /// [`FitError::Kinematics`] if a pose is impossible for the model's geometry or a law gives no finite value.
    pub fn new(model: &Model, datasets: &[Dataset], residuals: &Residuals, fixed: &[String]) -> Result<Self, FitError> {
        let mut sight = Self::default();
        for (number, (dataset, full)) in datasets.iter().zip(&residuals.series).enumerate() {
            sight.noise.push(dataset.noise_of_means(model, dataset.stride(STEP)));
            sight.add(&dataset.plant(model), (number, dataset), full, fixed)?;
        }
        Ok(sight)
    }

    /// Number of instants.
    pub fn len(&self) -> usize {
        self.recording.len()
    }

    /// Whether there are no instants.
    pub fn is_empty(&self) -> bool {
        self.recording.is_empty()
    }

    /// Training and validation instants, half each: whole recordings, or the halves of a single one.
    pub fn halves(&self) -> (Vec<usize>, Vec<usize>) {
        let last = self.recording.last().copied().unwrap_or(0);
        let half = self.len() / 2;
        (0..self.len()).partition(|&k| if last > 0 { self.recording[k] <= last / 2 } else { k < half })
    }

    fn add(
        &mut self,
        plant: &Plant,
        (number, dataset): (usize, &Dataset),
        full: &Channels,
        fixed: &[String],
    ) -> Result<(), FitError> {
        let stride = dataset.stride(STEP);
        let thin = dataset.averaged(stride);
        let failed = kinematics(dataset);
        let noise = self.noise[number].clone();
        let scaled = |mut channels: Channels| {
            for (series, sigma) in channels.iter_mut().zip(&noise) {
                series.iter_mut().for_each(|x| *x /= sigma);
                // Without a say near reversals, where the smoothed motion is not the motion.
                thin.near_reversals.iter().for_each(|near| series[near.clone()].fill(0.0));
            }
            channels
        };
        let averaged = full.iter().map(|series| dataset.means(series, stride)).collect();
        append(&mut self.residual, scaled(averaged));
        let mut base = columns(plant, &thin, None).map_err(&failed)?;
        let free = plant.parameters().free(fixed).into_iter().map(|k| std::mem::take(&mut base[k]));
        append_all(&mut self.base, free.map(scaled));
        self.places = mounted(plant.mechanism, plant.assembled);
        let unit = unit_forces(&self.places, plant);
        let responses = columns(plant, &thin, Some(&unit)).map_err(&failed)?;
        append_all(&mut self.responses, responses.into_iter().map(scaled));
        append(&mut self.variables, variables(plant, &thin).map_err(&failed)?);
        let from = self.recording.len();
        self.segments.extend(thin.segments.iter().map(|s| s.start + from..s.end + from));
        self.recording.extend(std::iter::repeat_n(number, thin.len()));
        Ok(())
    }
}

fn append(to: &mut Channels, more: Channels) {
    if to.is_empty() {
        *to = more;
    } else {
        to.iter_mut().zip(more).for_each(|(series, more)| series.extend(more));
    }
}

fn append_all(to: &mut Vec<Channels>, more: impl Iterator<Item = Channels>) {
    if to.is_empty() {
        *to = more.collect();
    } else {
        to.iter_mut().zip(more).for_each(|(one, more)| append(one, more));
    }
}

/// Places of the machine in its configuration.
fn mounted(machine: Mechanism, assembled: bool) -> Vec<Place> {
    Place::on(machine).filter(|place| assembled || matches!(place, Place::Drive(_))).collect()
}

/// A formula with a unit force at each place.
fn unit_forces(places: &[Place], plant: &Plant) -> ActiveEffect {
    let one = || Expression::parse("1").expect("a number");
    let term = |place: &Place| (Term { name: place.name().into(), at: *place, law: one() }, 1.0);
    let formula = Formula::new(places.iter().map(term).collect(), true, plant.mechanism);
    ActiveEffect::absent_on(Arc::new(formula), plant.host)
}

/// Values of every variable along a dataset; strut forces and torques are predicted by the plant: measured torques contain
/// the residual, which would explain itself.
fn variables(plant: &Plant, dataset: &Dataset) -> Result<Channels, KinematicsError> {
    let all: Vec<Variable> = Variable::names().filter_map(Variable::named).collect();
    let at = |k: usize| {
        let (t, motion) = (dataset.t[k], plant.motion(&dataset.joints[k])?);
        let loads = steady_inverse_dynamics(plant, t, &motion, true)?;
        let at = Instant { reactions: &loads.reactions, torque: loads.tau, ..plant.instant(t, &motion, &[]) };
        Ok(all.iter().map(|variable| variable.read(&at)).collect())
    };
    let rows: Vec<Vec<f64>> = parallel::map(dataset.len(), at).into_iter().collect::<Result<_, KinematicsError>>()?;
    Ok((0..all.len()).map(|i| rows.iter().map(|row| row[i]).collect()).collect())
}
