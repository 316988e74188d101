//! Design of persistently exciting motions: the periodic motion with the most information about the parameters
//! (section 3.2 of the paper).
//!
//! The end effector's x, y, z and ψ are Fourier series ([`series`]). Every instant of one period gives rows of the
//! base regressor and the use of every limit ([`machine`], [`limits`]); the objective is −log det of the information
//! of all rows or its condition number ([`mod@information`]). Sequential quadratic programming ([`search`]) improves
//! several random motions in parallel. The best one is checked on a grid ten times finer with the exact friction
//! laws, and its amplitude is reduced until it respects every limit there.
//!
//! The motion is periodic and does not start at rest: the machine has to be brought into it.

pub mod discriminate;
pub mod experiments;
pub mod information;
pub mod limits;
pub mod machine;
pub mod prospect;
pub mod search;
pub mod series;

pub use information::{Merit, Objective};
pub use limits::{Hemisphere, Limits};

use std::sync::atomic::{AtomicBool, Ordering};

use nalgebra::DMatrix;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use thiserror::Error;

use crate::dynamics::PlantParameter;
use crate::identification::base_parameters;
use crate::model::Model;
use crate::numerics::parallel;
use crate::scenario::{FourierMotion, MotionLimits};
use limits::{KINDS, LIMITS};
use machine::{Machine, Sample, information, worst};
use search::{End, Search};
use series::{Basis, scaled};

/// Options of the design.
#[derive(Clone, Debug)]
pub struct Options {
    /// Objective to be minimised.
    pub objective: Objective,
    /// Base frequency, Hz.
    pub frequency: f64,
    /// Number of harmonics.
    pub harmonics: usize,
    /// Number of periods of the run; only the standard errors depend on it.
    pub periods: usize,
    /// Usable share of speed, acceleration, torque and hold of the sockets.
    pub share: f64,
    /// Additional restriction of the workspace.
    pub hemisphere: Option<Hemisphere>,
    /// Seed of the random motions.
    pub seed: u64,
    /// Number of random motions for comparison, from which the starts of the searches are taken.
    pub randoms: usize,
    /// Number of searches.
    pub starts: usize,
    /// Largest number of steps of each search.
    pub iterations: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            objective: Objective::Logdet,
            frequency: 0.1,
            harmonics: 5,
            periods: 2,
            share: 0.8,
            hemisphere: None,
            seed: 1,
            randoms: 20,
            starts: 4,
            iterations: 80,
        }
    }
}

/// Reason why there is no design.
#[derive(Debug, Error)]
pub enum ExcitationError {
    /// No random motion is possible within the limits.
    #[error(
        "no motion fits into the limits; does the hemisphere lie in the workspace, and are the limits large enough?"
    )]
    NoMotion,
    /// No parameter enters linearly, or none is identifiable.
    #[error("no parameter of the model shows in a motion within the limits")]
    NothingToTell,
}

/// A designed motion.
#[derive(Clone, Debug)]
pub struct Design {
    /// The motion.
    pub motion: FourierMotion,
    /// Its information.
    pub merit: Merit,
    /// Leading parameter of each base parameter, in the order of [`Merit::std`].
    pub parameters: Vec<PlantParameter>,
    /// Own size of each, in its unit.
    pub sizes: Vec<f64>,
    /// Parameters that depend linearly on those, or that torque noise hides even in a rich motion.
    pub dependent: Vec<String>,
    /// Information of the random motions, in the order of their draw.
    pub random: Vec<Merit>,
    /// Largest use of each kind of limit; 1 is the usable share, or the margin to a singularity.
    pub worst: Vec<(&'static str, f64)>,
    /// Number of steps of all searches.
    pub iterations: usize,
    /// Whether `go_on` ended a search.
    pub stopped: bool,
    /// Factor on the amplitude required by the check on the fine grid.
    pub reduction: f64,
}

/// Number of instants per harmonic in the search, least number of instants, and refinement factor of the final check.
const PER_HARMONIC: usize = 60;
const FEWEST_INSTANTS: usize = 180;
const FINER: usize = 10;
/// Rich random motions that determine the base parameters: number, base frequency in Hz, number of harmonics.
const RICH: (usize, f64, usize) = (3, 0.3, 10);
/// Information of the whole run (1/variance in units of the own size) below which a column is dropped.
const MIN_INFORMATION: f64 = 1e-2;
/// Reduction factors per trial of the amplitude of a random and of the designed motion, and largest number of trials.
const SHRINK: f64 = 0.95;
const TRIM: f64 = 0.998;
const MOST_TRIALS: i32 = 200;

/// Designs a motion for `model`; `go_on` is evaluated before every step of a search, from several threads.
///
/// The result depends on the options only, not on the number of threads, unless `go_on` ends a search.
///
/// # Errors
/// [`ExcitationError`], if no motion is possible within the limits or no parameter is identifiable.
pub fn design(model: &Model, options: &Options, go_on: &(dyn Fn() -> bool + Sync)) -> Result<Design, ExcitationError> {
    let limits = Limits::of(model, options.share, options.hemisphere);
    let run = options.periods as f64 / options.frequency / model.sample_time;
    let columns = base_columns(model, limits, options, run)?;
    let exact = Machine::new(model, limits, false);
    let all = exact.parameters();
    let exact = exact.with_columns(&columns);
    let soft = Machine::new(model, limits, true).with_columns(&columns);
    let instants = (PER_HARMONIC * options.harmonics).max(FEWEST_INSTANTS);
    let basis = Basis::new(options.frequency, options.harmonics, instants);
    let fine = Basis::new(options.frequency, options.harmonics, FINER * instants);
    let merit = |samples: &[Sample]| Merit::of(&information(samples), exact.sizes());

    let has_one = AtomicBool::new(false);
    let one = |k: usize| {
        // With the time over, one motion is enough.
        if has_one.load(Ordering::Relaxed) && !go_on() {
            return None;
        }
        let motion = draw(model, &exact, &limits, options, k as u64);
        // The draw respects all limits except a hemisphere.
        let own = if limits.hemisphere.is_some() { shrunk(&exact, &basis, &motion, SHRINK)?.0 } else { motion };
        let merit = merit(&exact.samples(&fine, &basis.vector(&own))?);
        let start = shrunk(&exact, &basis, &own, SHRINK)?.0;
        let value = options.objective.value(&information(&soft.samples(&basis, &basis.vector(&start))?))?.0;
        has_one.store(true, Ordering::Relaxed);
        Some(Drawn { merit, start, value })
    };
    let drawn = parallel::map(options.randoms.max(options.starts).max(1), one);
    let drawn: Vec<Drawn> = drawn.into_iter().flatten().collect();
    let mut order: Vec<usize> = (0..drawn.len()).collect();
    order.sort_by(|&a, &b| drawn[a].value.total_cmp(&drawn[b].value));
    let Some(&first) = order.first() else { return Err(ExcitationError::NoMotion) };

    let scale = scale(model, options);
    let objective = |information: &DMatrix<f64>| options.objective.value(information);
    let search = Search { machine: &soft, basis: &basis, objective: &objective, scale: &scale };
    let improved = |i: usize| search.run(&basis.vector(&drawn[order[i]].start), options.iterations, go_on);
    let found: Vec<search::Found> = parallel::map(options.starts.min(order.len()), improved);
    let best = found.iter().min_by(|a, b| a.value.total_cmp(&b.value)).and_then(|f| f.x.as_deref());
    let motion = best.map_or_else(|| drawn[first].start.clone(), |x| basis.motion(x));
    let fitted = shrunk(&exact, &fine, &motion, TRIM).or_else(|| shrunk(&exact, &fine, &drawn[first].start, TRIM));
    let (motion, samples, reduction) = fitted.ok_or(ExcitationError::NoMotion)?;
    let used = worst(&samples);
    let chosen = exact.parameters();
    Ok(Design {
        merit: merit(&samples).over(run),
        sizes: exact.sizes().to_vec(),
        dependent: (all.iter().map(|p| &p.name)).filter(|n| chosen.iter().all(|c| c.name != **n)).cloned().collect(),
        parameters: chosen,
        random: drawn.into_iter().take(options.randoms).map(|d| d.merit.over(run)).collect(),
        worst: usage(&used, &limits),
        iterations: found.iter().map(|f| f.iterations).sum(),
        stopped: found.iter().any(|f| f.end == End::Stopped),
        motion,
        reduction,
    })
}

/// A random motion.
struct Drawn {
    merit: Merit,
    start: FourierMotion,
    value: f64,
}

impl Merit {
    /// The merit with the standard errors of a run of `samples` instants.
    fn over(mut self, samples: f64) -> Self {
        self.std.iter_mut().for_each(|s| *s /= samples.sqrt());
        self
    }
}

/// Random motion number `k` of a seed.
fn draw(model: &Model, machine: &Machine, limits: &Limits, options: &Options, k: u64) -> FourierMotion {
    let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
    rng.set_stream(k + 1);
    let bounds = MotionLimits::of(model, limits.share);
    let mut motion = FourierMotion::random(machine.plant(), &bounds, options.frequency, options.harmonics, &mut rng);
    if let Some(h) = &limits.hemisphere {
        for (c, x) in motion.centre.iter_mut().zip([h.centre.x, h.centre.y, h.centre.z - 0.4 * h.radius]) {
            *c = x;
        }
    }
    motion
}

/// The motion with its amplitude reduced until it respects the limits on the grid of `basis`, its samples and the
/// factor.
fn shrunk(
    machine: &Machine,
    basis: &Basis,
    motion: &FourierMotion,
    by: f64,
) -> Option<(FourierMotion, Vec<Sample>, f64)> {
    (0..MOST_TRIALS).find_map(|k| {
        let factor = by.powi(k);
        let motion = scaled(motion, factor);
        let samples = machine.samples(basis, &basis.vector(&motion))?;
        worst(&samples).iter().all(|w| *w <= 1.0).then_some((motion, samples, factor))
    })
}

/// Base columns, selected on rich random motions.
fn base_columns(model: &Model, limits: Limits, options: &Options, run: f64) -> Result<Vec<usize>, ExcitationError> {
    let machine = Machine::new(model, limits, false);
    let (number, frequency, harmonics) = RICH;
    let basis = Basis::new(frequency, harmonics, 3 * PER_HARMONIC * harmonics);
    let part = |k: usize| {
        let rich = Options { frequency, harmonics, seed: options.seed ^ 0x5eed, ..options.clone() };
        let motion = draw(model, &machine, &limits, &rich, k as u64);
        let (.., samples, _) = shrunk(&machine, &basis, &motion, SHRINK)?;
        Some(information(&samples))
    };
    let parts: Vec<DMatrix<f64>> = parallel::map(number, part).into_iter().flatten().collect();
    let count = parts.len() as f64;
    let sum = parts.into_iter().reduce(|a, b| a + b).ok_or(ExcitationError::NoMotion)?;
    let columns = base_parameters::independent(&(sum * (run / count)), MIN_INFORMATION);
    if columns.is_empty() { Err(ExcitationError::NothingToTell) } else { Ok(columns) }
}

/// Usual size of each decision variable: 0.2 m or a quarter of the permitted speed of axis 4, less for higher
/// harmonics.
fn scale(model: &Model, options: &Options) -> Vec<f64> {
    let mut scale = Vec::new();
    for i in 0..series::COORDINATES {
        scale.push(if i < 3 { 0.1 } else { 1.0 });
        for h in 1..=options.harmonics {
            let omega = std::f64::consts::TAU * options.frequency * h as f64;
            let size = match i {
                0..3 => (0.2 / (h as f64).sqrt()).min(2.0 / omega),
                _ if model.mechanism.has_telescope() => 0.25 * options.share * model.drives[3].max_speed / omega,
                _ if model.mechanism.plate_turns() => (0.3 / (h as f64).sqrt()).min(10.0 / omega),
                // Otherwise ψ is constant.
                _ => 1.0,
            };
            scale.extend([size, size]);
        }
    }
    scale
}

/// Largest use of each kind of limit that applies.
fn usage(worst: &[f64; LIMITS], limits: &Limits) -> Vec<(&'static str, f64)> {
    let kinds = KINDS.iter().filter(|(name, _)| limits.apply(name));
    kinds.map(|(name, rows)| (*name, worst[rows.clone()].iter().copied().fold(0.0, f64::max))).collect()
}

#[cfg(test)]
mod tests;
