//! Prediction of a plant for a dataset, and its derivatives with respect to the parameters.
//!
//! A dataset contains encoder readings. Effects between encoder and joint ([`Kind::Encoder`]) are removed first:
//! offsets and periodic errors, then the deflection of elastic gears (`gears`). With θ the encoder angle without these
//! errors, q that of the joint, J the rotor's inertia and ID the inverse dynamics with the rotor attached to the arm, τ = ID(q,
//! q̇, q̈) + J·(θ̈ − q̈).
//!
//! Internal states of force laws are integrated along the measured motion.

mod columns;
mod gears;
mod kept;
mod sensors;
mod states;

use std::borrow::Cow;
use std::ops::Range;
use std::sync::OnceLock;

use self::states::InternalStates;
use super::Dataset;
use crate::dynamics::{LoadCourse, Output, Plant, reads_loads};
use crate::effects::{ActiveEffect, GearSpring, Kind};
use crate::kinematics::{JointState, KinematicsError, Motion};
use crate::machine::PerAxis;
use crate::numerics::parallel;

pub use columns::{CandidateColumns, columns, columns_with, own_columns, prediction_and_columns};
pub use kept::{KeptColumns, Laws};
pub use sensors::reported;
use sensors::{observe, observe_apart};

/// One series per channel, in the order of the dataset's channels.
pub type Channels = Vec<Vec<f64>>;

/// Joint motion of the mechanism at every sample. The motion of all bodies takes kilobytes per sample and is computed
/// on demand.
struct Joints<'a> {
    plant: &'a Plant,
    states: Cow<'a, [JointState]>,
    /// Encoder readings without offsets and periodic errors; different from `states` behind an elastic gear.
    encoders: Cow<'a, [JointState]>,
    /// Columns of the plant's laws that are known along the motion.
    known: Laws,
    /// Loads along the motion, from the first request on.
    loads: OnceLock<Loads>,
    /// Whether the loads that laws read follow the parameters in the columns of all effects, which are then derivatives. Without
    /// it the column of a law times its value is what the law contributes, at the loads of the plant.
    follow: bool,
}

impl<'a> Joints<'a> {
    fn new(plant: &'a Plant, states: Cow<'a, [JointState]>, encoders: Cow<'a, [JointState]>) -> Self {
        Self { plant, states, encoders, known: Laws::default(), loads: OnceLock::new(), follow: false }
    }

    /// The joints of a plant whose effects do not change the motion.
    fn of(plant: &'a Plant, dataset: &'a Dataset) -> Self {
        let states = || Cow::Borrowed(dataset.joints.as_slice());
        Self::new(plant, states(), states())
    }

    /// With known columns.
    fn knowing(self, known: Laws) -> Self {
        Self { known, ..self }
    }

    /// With columns that are derivatives; those known at given loads are not if a law reads loads.
    fn following(self) -> Self {
        let known = if self.plant.effects.iter().any(reads_loads) { Laws::default() } else { self.known };
        Self { known, follow: true, ..self }
    }

    /// Sets `motion` to the motion of all bodies at sample `k`; before, it was [`Motion::REST`] or one of the same plant.
    fn set_motion(&self, k: usize, motion: &mut Motion) -> Result<(), KinematicsError> {
        self.plant.set_motion(&self.states[k], motion)
    }

    /// The same motion of another plant.
    fn on<'b>(&'b self, plant: &'b Plant) -> Joints<'b> {
        let (states, encoders) = (Cow::Borrowed(self.states.as_ref()), Cow::Borrowed(self.encoders.as_ref()));
        Joints { follow: self.follow, ..Joints::new(plant, states, encoders) }
    }

    /// The motion with the encoders at the joints.
    fn of_encoders(&self) -> Joints<'_> {
        let encoders = || Cow::Borrowed(self.encoders.as_ref());
        Joints { follow: self.follow, ..Joints::new(self.plant, encoders(), encoders()) }
    }

    /// Loads of the plant, for laws that depend on them.
    fn loads(&self, dataset: &Dataset) -> Result<&Loads, KinematicsError> {
        if let Some(known) = self.loads.get() {
            return Ok(known);
        }
        let effects: Vec<&ActiveEffect> = self.plant.effects.iter().collect();
        let states = InternalStates::along(self.plant, &effects, dataset, self)?;
        let of_samples = outputs(self.plant, &states, dataset, self, true)?;
        Ok(self.loads.get_or_init(|| Loads { of_samples, states }))
    }
}

/// Loads of a plant along a motion.
struct Loads {
    /// Drive torques and strut forces at every sample.
    of_samples: Vec<Output>,
    /// Internal states of the plant's effects.
    states: InternalStates,
}

/// Whether a prediction at one sample depends only on nearby samples (see `reach`); internal states and elastic gears
/// depend on all previous ones.
pub fn is_local(plant: &Plant) -> bool {
    let at_rest = |a: &ActiveEffect| a.states() == 0 || a.effect.kind() == Kind::Encoder;
    plant.effects.iter().all(at_rest) && gear_springs(plant).is_none()
}

/// Number of samples on either side that a local prediction needs; the shift of sensors is smaller.
fn reach(plant: &Plant, dataset: &Dataset) -> usize {
    if !plant.observes() {
        return 0;
    }
    let memory: f64 = plant.effects.iter().map(ActiveEffect::sensor_memory).sum();
    let samples = if dataset.dt > 0.0 { (memory / dataset.dt).ceil() as usize } else { 0 };
    samples.max(256)
}

/// Number of samples predicted together, and factor on it if sensors need their neighbours, too.
const CHUNK: (usize, usize) = (1024, 4);

/// Number of samples of a plant that are predicted together.
pub fn chunk(plant: &Plant) -> usize {
    if plant.observes() { CHUNK.0 * CHUNK.1 } else { CHUNK.0 }
}

/// Predicted channels of a plant along a dataset.
///
/// # Errors
/// [`KinematicsError`] if a pose is impossible for the plant's geometry or a law gives no finite value.
pub fn predict(plant: &Plant, dataset: &Dataset) -> Result<Channels, KinematicsError> {
    predict_knowing(plant, dataset, &Laws::default())
}

/// [`predict`] with `known` columns of the plant's laws.
///
/// # Errors
/// As [`predict`].
pub fn predict_knowing(plant: &Plant, dataset: &Dataset, known: &Laws) -> Result<Channels, KinematicsError> {
    let chunk = chunk(plant);
    if !is_local(plant) || dataset.len() <= chunk {
        let joints = joints(plant, dataset)?;
        let known = known.clone().completed(dataset, &joints)?;
        return predict_along(plant, dataset, &joints.knowing(known));
    }
    let starts: Vec<usize> = (0..dataset.len()).step_by(chunk).collect();
    let piece = |i: usize| {
        let range = starts[i]..(starts[i] + chunk).min(dataset.len());
        let (around, shift) = surroundings(plant, dataset, &range);
        let first = range.start - shift;
        let piece = joints(plant, &around).and_then(|joints| {
            let known = known.from(first).completed(&around, &joints)?;
            predict_along(plant, &around, &joints.knowing(known))
        });
        let mut piece = piece.map_err(|e| e.later(first))?;
        piece.iter_mut().for_each(|series| *series = series[shift..shift + range.len()].to_vec());
        Ok(piece)
    };
    let pieces: Vec<Channels> =
        parallel::map(starts.len(), piece).into_iter().collect::<Result<_, KinematicsError>>()?;
    let whole = |c: usize| pieces.iter().flat_map(|p| &p[c]).copied().collect();
    Ok((0..dataset.channels.len()).map(whole).collect())
}

/// The samples that a local prediction in `range` needs, and the start of `range` in them.
pub fn surroundings(plant: &Plant, dataset: &Dataset, range: &Range<usize>) -> (Dataset, usize) {
    let reach = reach(plant, dataset);
    if gear_springs(plant).is_some() {
        // Computed once for all windows.
        dataset.ringing();
    }
    let outer = range.start.saturating_sub(reach)..(range.end + reach).min(dataset.len());
    let shift = range.start - outer.start;
    (dataset.window(outer), shift)
}

/// Motion of the joints: that of the encoders without offsets, periodic errors and deflections.
fn joints<'a>(plant: &'a Plant, dataset: &'a Dataset) -> Result<Joints<'a>, KinematicsError> {
    joints_within(plant, dataset, gears::CONVERGED)
}

/// Motion of the joints, deflections of gears up to the last change `converged`, rad.
fn joints_within<'a>(plant: &'a Plant, dataset: &'a Dataset, converged: f64) -> Result<Joints<'a>, KinematicsError> {
    let states = match plant.effects.iter().any(|a| a.effect.kind() == Kind::Encoder) {
        true => Cow::Owned(dataset.joints.iter().map(|j| plant.behind_encoders(j)).collect()),
        false => Cow::Borrowed(dataset.joints.as_slice()),
    };
    let rigid = Joints::new(plant, states.clone(), states);
    match gear_springs(plant).filter(|_| !dataset.is_empty()) {
        Some(gears) => gears::deflected(dataset, &rigid, &gears, converged),
        None => Ok(rigid),
    }
}

fn gear_springs(plant: &Plant) -> Option<PerAxis<GearSpring>> {
    plant.effects.iter().find_map(|a| a.gear_springs())
}

fn predict_along(plant: &Plant, dataset: &Dataset, joints: &Joints) -> Result<Channels, KinematicsError> {
    let mut series = ideal(plant, dataset, joints)?;
    observe(plant, dataset, &mut series);
    Ok(series)
}

/// Predicted channels before the effects of sensors.
fn ideal(plant: &Plant, dataset: &Dataset, joints: &Joints) -> Result<Channels, KinematicsError> {
    if let Some(sum) = joints.known.sum(plant, dataset.len()) {
        return Ok(sum);
    }
    let with_struts = dataset.channels.iter().any(|c| c.drive().is_none());
    let springs = gear_springs(plant);
    if springs.is_none() && plant.effects.iter().any(reads_loads) {
        // The columns of laws that depend on loads use them again.
        return Ok(channels(dataset, &joints.loads(dataset)?.of_samples));
    }
    let gears = springs.unwrap_or_default();
    let behind = gears::behind(plant, &gears);
    let effects: Vec<&ActiveEffect> = behind.effects.iter().collect();
    let own = InternalStates::along(&behind, &effects, dataset, joints)?;
    let mut outputs = outputs(&behind, &own, dataset, joints, with_struts)?;
    for (k, out) in outputs.iter_mut().enumerate() {
        for (i, gear) in gears.iter().enumerate() {
            // The rotor moves with the encoder, not with the arm.
            out.tau[i] += gear.rotor_inertia * (joints.encoders[k].qdd[i] - joints.states[k].qdd[i]);
        }
    }
    let mut series = channels(dataset, &outputs);
    if gears.iter().any(|g| g.friction_at_motor) {
        add_motors(plant, &gears, dataset, joints, &mut series)?;
    }
    Ok(series)
}

/// The values of the dataset's channels.
fn channels(dataset: &Dataset, outputs: &[Output]) -> Channels {
    dataset.channels.iter().map(|channel| outputs.iter().map(|o| o.of(*channel)).collect()).collect()
}

/// Number of samples whose loads follow from each other.
const COURSE: usize = 64;

/// Inverse dynamics of a plant with the internal states `own` along the motion of the joints.
fn outputs(
    plant: &Plant,
    own: &InternalStates,
    dataset: &Dataset,
    joints: &Joints,
    with_struts: bool,
) -> Result<Vec<Output>, KinematicsError> {
    let along = |course: Range<usize>| {
        let (mut motion, mut loads) = (Motion::REST, LoadCourse::default());
        let at = |k: usize| {
            joints.set_motion(k, &mut motion)?;
            let out = loads.inverse_dynamics(plant, dataset.t[k], &motion, &own.at(k), with_struts);
            out.map_err(|e| e.at_sample(k))
        };
        course.map(at).collect()
    };
    in_courses(dataset.len(), along)
}

/// What `along` gives for the samples 0 to n in courses of [`COURSE`] samples; the error of the first failing course.
fn in_courses<T: Send + Sync>(
    n: usize,
    along: impl Fn(Range<usize>) -> Result<Vec<T>, KinematicsError> + Sync,
) -> Result<Vec<T>, KinematicsError> {
    let courses = parallel::map(n.div_ceil(COURSE), |i| along(i * COURSE..((i + 1) * COURSE).min(n)));
    let mut all = Vec::with_capacity(n);
    for course in courses {
        all.extend(course?);
    }
    Ok(all)
}

/// Adds to the channels the laws on the motor side, at the encoders' motion.
fn add_motors(
    plant: &Plant,
    gears: &PerAxis<GearSpring>,
    dataset: &Dataset,
    joints: &Joints,
    series: &mut Channels,
) -> Result<(), KinematicsError> {
    let effects: Vec<&ActiveEffect> = plant.effects.iter().filter(|a| gears::acts_on_motors(a, gears)).collect();
    let encoders = Joints { follow: false, ..joints.of_encoders() };
    for (active, columns) in effects.iter().zip(columns::terms(&effects, dataset, &encoders, 1)?) {
        columns::add_weighted(series, &columns, &active.values);
    }
    Ok(())
}

#[cfg(test)]
mod tests;
