//! Columns that all models of a recording share, computed once.
//!
//! A law without past whose parameters all enter linearly, and which depends on neither loads nor inertia, has columns that
//! depend on the motion alone. They are kept from one model to the next, and the channels before the sensors are
//! Σ columns · values, without inverse dynamics.

use std::sync::{Arc, Mutex, PoisonError};

use super::columns::terms;
use super::{Channels, Joints, ideal};
use crate::dynamics::Plant;
use crate::effects::rigid_bodies::{self, RigidBodies};
use crate::effects::{ActiveEffect, Kind, Role};
use crate::identification::Dataset;
use crate::kinematics::KinematicsError;
use crate::machine::Bodies;

/// Most values that are kept of a recording, 256 MB; what exceeds them is computed at every request.
const MOST_VALUES: usize = 32_000_000;

/// Difference of inertia, in SI units, that is rounding.
const ROUNDING: f64 = 1e-12;

/// Columns at every sample of an effect, `[parameter][channel][sample]`.
type Columns = Arc<Vec<Channels>>;

/// A recording with the columns that its models share.
pub struct KeptColumns<'a> {
    /// The recording.
    pub dataset: &'a Dataset,
    kept: Mutex<Option<Kept>>,
}

/// Columns on a machine.
struct Kept {
    /// The machine without parameters.
    bare: Plant,
    /// Channels without any law, from payload, known loads and what the parameters of links do not describe; for the last
    /// links.
    constants: Vec<(Bodies, Arc<Channels>)>,
    laws: Vec<(ActiveEffect, Columns)>,
}

/// Links whose channels without any law are kept.
const LINKS: usize = 6;

/// Columns of a plant's laws that are known in a window of a recording.
#[derive(Clone, Default)]
pub struct Laws {
    /// Of the rigid bodies and of every effect of the plant, each with the window's first sample.
    columns: Vec<Option<(Columns, usize)>>,
    /// Channels without any law, and the window's first sample.
    constant: Option<(Arc<Channels>, usize)>,
}

impl<'a> KeptColumns<'a> {
    /// Without columns yet.
    pub fn new(dataset: &'a Dataset) -> Self {
        Self { dataset, kept: Mutex::new(None) }
    }

    /// Of several recordings.
    pub fn of(datasets: &'a [Dataset]) -> Vec<Self> {
        datasets.iter().map(Self::new).collect()
    }

    /// Columns of the plant's laws that models share; those not met before are computed. None where effects change the motion
    /// that the recording stands for.
    ///
    /// # Errors
    /// [`KinematicsError`] if a pose is impossible for the plant's geometry or a law gives no finite value.
    pub fn laws(&self, plant: &Plant) -> Result<Laws, KinematicsError> {
        let moves = |a: &ActiveEffect| matches!(a.effect.kind(), Kind::Encoder | Kind::Geometry);
        if plant.effects.iter().any(moves) || self.dataset.is_empty() {
            return Ok(Laws::default());
        }
        let rigid = plant.rigid_bodies();
        let own: Vec<&ActiveEffect> = std::iter::once(&rigid).chain(&plant.effects).collect();
        let mut guard = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let bare = bare(plant);
        let mut kept = match guard.take() {
            Some(kept) if is_same(&kept.bare, &bare) => kept,
            _ => Kept { constants: Vec::new(), laws: Vec::new(), bare: bare.clone() },
        };
        let constant = match kept.constants.iter().find(|(links, _)| are_same(links, &bare.links)) {
            Some((_, constant)) => Arc::clone(constant),
            None => {
                let constant = Arc::new(self.constant(&bare)?);
                if kept.constants.len() == LINKS {
                    kept.constants.remove(0);
                }
                kept.constants.push((bare.links, Arc::clone(&constant)));
                constant
            }
        };
        let missing: Vec<&ActiveEffect> =
            own.iter().copied().filter(|a| is_shared(a) && kept.of(a).is_none()).collect();
        let values = |columns: usize| columns * self.dataset.channels.len() * self.dataset.len();
        let total: usize =
            kept.laws.iter().map(|(a, _)| a.values.len()).chain(missing.iter().map(|a| a.values.len())).sum();
        if values(total) <= MOST_VALUES && !missing.is_empty() {
            let computed = terms(&missing, self.dataset, &Joints::of(&kept.bare, self.dataset), 1)?;
            let found = missing.into_iter().cloned().zip(computed.into_iter().map(Arc::new));
            kept.laws.extend(found);
        }
        let columns = own.iter().map(|a| kept.of(a).map(|columns| (Arc::clone(columns), 0))).collect();
        let laws = Laws { columns, constant: Some((constant, 0)) };
        *guard = Some(kept);
        Ok(laws)
    }

    /// Channels of a machine without parameters.
    fn constant(&self, bare: &Plant) -> Result<Channels, KinematicsError> {
        let is_idle = bare.bodies.0.iter().all(|inertia| inertia.mass == 0.0) && bare.measured.is_none();
        if is_idle && bare.known_load(0.0).is_none() {
            return Ok(vec![vec![0.0; self.dataset.len()]; self.dataset.channels.len()]);
        }
        ideal(bare, self.dataset, &Joints::of(bare, self.dataset))
    }
}

impl Kept {
    /// Columns of an effect, if it was met before.
    fn of(&self, active: &ActiveEffect) -> Option<&Columns> {
        let is_rigid = active.effect.name() == rigid_bodies::NAME;
        let same = |known: &ActiveEffect| match is_rigid {
            true => known.effect.name() == rigid_bodies::NAME,
            false => Arc::ptr_eq(&known.effect, &active.effect) && fixed(known).eq(fixed(active)),
        };
        self.laws.iter().find(|(known, _)| same(known)).map(|(_, columns)| columns)
    }
}

impl Laws {
    /// What is known in a window that begins at sample `start` of this one.
    #[must_use]
    pub fn from(&self, start: usize) -> Self {
        let later = |(columns, first): &(Columns, usize)| (Arc::clone(columns), first + start);
        Self {
            columns: self.columns.iter().map(|own| own.as_ref().map(later)).collect(),
            constant: self.constant.as_ref().map(|(constant, first)| (Arc::clone(constant), first + start)),
        }
    }

    /// Columns of an effect of `plant`, or of its rigid bodies, in a window of `len` samples.
    pub(super) fn of(&self, plant: &Plant, active: &ActiveEffect, len: usize) -> Option<Vec<Channels>> {
        let place = match active.effect.name() == rigid_bodies::NAME {
            true => 0,
            false => 1 + plant.effects.iter().position(|own| std::ptr::eq(own, active))?,
        };
        let (columns, first) = self.columns.get(place)?.as_ref()?;
        let window = |channels: &Channels| channels.iter().map(|series| series[*first..first + len].to_vec()).collect();
        Some(columns.iter().map(window).collect())
    }

    /// With the columns of the other laws of the plant, where every law adds its own terms and nothing else.
    pub(super) fn completed(mut self, dataset: &Dataset, joints: &Joints) -> Result<Self, KinematicsError> {
        let plant = joints.plant;
        let is_complete = self.constant.is_some() && plant.effects.iter().all(adds);
        if !is_complete {
            return Ok(self);
        }
        let is_open = |i: &usize| self.columns[1 + i].is_none() && plant.effects[*i].effect.kind() != Kind::Sensor;
        let open: Vec<usize> = (0..plant.effects.len()).filter(is_open).collect();
        let effects: Vec<&ActiveEffect> = open.iter().map(|&i| &plant.effects[i]).collect();
        for (i, columns) in open.iter().zip(terms(&effects, dataset, joints, 1)?) {
            self.columns[1 + i] = Some((Arc::new(columns), 0));
        }
        if self.columns[0].is_none() {
            let rigid = terms(&[&plant.rigid_bodies()], dataset, joints, 1)?;
            self.columns[0] = rigid.into_iter().next().map(|columns| (Arc::new(columns), 0));
        }
        Ok(self)
    }

    /// Channels of the plant before its sensors in a window of `len` samples; `None` unless all its laws are known.
    pub(super) fn sum(&self, plant: &Plant, len: usize) -> Option<Channels> {
        let (constant, first) = self.constant.as_ref().filter(|_| plant.effects.iter().all(adds))?;
        let mut sum: Channels = constant.iter().map(|series| series[*first..first + len].to_vec()).collect();
        let rigid = plant.rigid_bodies();
        let own = std::iter::once(&rigid).chain(&plant.effects).zip(&self.columns);
        for (active, known) in own.filter(|(active, _)| active.effect.kind() != Kind::Sensor) {
            let (columns, first) = known.as_ref()?;
            for (column, value) in columns.iter().zip(&active.values).filter(|(_, value)| **value != 0.0) {
                for (total, series) in sum.iter_mut().zip(column) {
                    for (t, x) in total.iter_mut().zip(&series[*first..first + len]) {
                        *t += value * x;
                    }
                }
            }
        }
        Some(sum)
    }
}

/// The machine without parameters: no effects, and of the links what their parameters do not describe, as the differences of
/// bodies that share one.
fn bare(plant: &Plant) -> Plant {
    let mut bare = plant.clone();
    bare.effects.clear();
    let links = RigidBodies::with(plant.mechanism, plant.assembled, plant.link_parameters);
    let none = vec![0.0; links.values(&plant.links).len()];
    links.set_values(&mut bare.links, &none);
    bare.sum_inertia();
    bare
}

/// Whether laws have the same columns on two machines without parameters, whatever their links.
fn is_same(a: &Plant, b: &Plant) -> bool {
    let loads = match (&a.measured, &b.measured) {
        (Some(a), Some(b)) => Arc::ptr_eq(a, b),
        (a, b) => a.is_none() && b.is_none(),
    };
    loads
        && a.host == b.host
        && a.geometry == b.geometry
        && a.link_parameters == b.link_parameters
        && a.payload == b.payload
        && a.load == b.load
        && a.gravity == b.gravity
        && a.assembled == b.assembled
}

/// Whether links are the same up to rounding.
fn are_same(a: &Bodies, b: &Bodies) -> bool {
    a.0.iter().zip(&b.0).all(|(a, b)| {
        let apart =
            (a.mass - b.mass).abs().max((a.first_moment - b.first_moment).amax()).max((a.tensor - b.tensor).amax());
        apart < ROUNDING
    })
}

/// Whether the columns of a law depend on the motion alone.
fn is_shared(active: &ActiveEffect) -> bool {
    let (spec, entries) = (active.effect.spec(), active.entries());
    let is_linear = entries.iter().all(|entry| entry.parameter.role != Role::Shape);
    is_linear && adds(active) && active.states() == 0 && !spec.reads.inertia && spec.kind != Kind::Sensor
}

/// Whether an effect adds Σ columns · values to the channels before the sensors.
fn adds(active: &ActiveEffect) -> bool {
    let spec = active.effect.spec();
    let is_term = matches!(spec.kind, Kind::Force | Kind::Inertia | Kind::Sensor);
    is_term && !spec.reads.torque && !spec.reads.reactions && !active.states_read_reactions()
}

/// Values of the parameters that are not linear.
fn fixed(active: &ActiveEffect) -> impl Iterator<Item = f64> {
    let entries = active.entries().into_iter().zip(&active.values);
    entries
        .filter(|(entry, _)| entry.parameter.role != Role::Linear)
        .map(|(_, value)| *value)
        .collect::<Vec<_>>()
        .into_iter()
}
