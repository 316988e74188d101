//! Experiments that discriminate between two effects: T-optimal, with the model's parameters profiled out.
//!
//! In addition to the catalogue of [`super::experiments`] a Fourier series is designed with the search of the
//! excitation, with δ² in place of the volume of the confidence ellipsoid. Where an effect depends on more than the
//! current instant (delay, elastic gears, internal states), the best of several random series is used instead.

use nalgebra::{DMatrix, DVector};
use thiserror::Error;

use super::experiments::{Bench, Experiment, Kind};
use super::machine::{Machine, worst};
use super::prospect::{Information, Noise, Prospect, prospect, ranked, which};
use super::search::{Found, Search};
use super::series::Basis;
use super::{FEWEST_INSTANTS, FINER, Limits, Options, PER_HARMONIC, SHRINK, TRIM, draw, scale, shrunk};
use crate::effects::{self, ActiveEffect, Role};
use crate::evidence::separation::what_is_left;
use crate::kinematics::KinematicsError;
use crate::machine::Setup;
use crate::model::Model;
use crate::numerics::parallel;
use crate::recording::Channel;
use crate::scenario::Course;

/// Reason why no experiment for two effects is planned.
#[derive(Debug, Error)]
pub enum DiscriminationError {
    /// There is no such effect.
    #[error("unknown effect `{0}`; `deltatwin effects` lists them")]
    Unknown(String),
    /// The same effect is given twice.
    #[error("`{0}` is given twice; expected two effects")]
    Same(String),
    /// The machine lacks the part that the effect acts on.
    #[error("`{effect}` acts on {part}, which this machine does not have")]
    Missing {
        /// Name of the effect.
        effect: String,
        /// Part that it acts on.
        part: &'static str,
    },
    /// The effect exists in the twin only, or in every model.
    #[error("`{0}` cannot be told from another effect: no parameter of it shows along a measured motion")]
    TwinOnly(String),
    /// The machine can perform none of the planned motions.
    #[error("the machine can make none of the planned motions within its limits")]
    NoMotion,
    /// A column cannot be computed.
    #[error(transparent)]
    Kinematics(#[from] KinematicsError),
}

/// Planned experiments that discriminate between two effects.
pub struct Discrimination {
    /// The two effects with their assumed sizes.
    pub effects: [ActiveEffect; 2],
    /// All plans, best first.
    pub plans: Vec<(Experiment, Prospect)>,
    /// Whether a Fourier series was optimised; otherwise random ones were drawn.
    pub searched: bool,
}

/// Sampling period of the plans, s, for dynamics below 80 Hz.
const PERIOD: f64 = 2e-3;
/// Number of blocks of the planned test, as in the diagnosis.
const BLOCKS: usize = 50;
/// Exponent of the smooth minimum of the two δ².
const POWER: f64 = 4.0;
/// Number of random series that are candidates themselves.
const DRAWN: u64 = 6;

/// Experiments that discriminate between the effects `names` on `model`, best first; their sizes are those in the
/// model, else the usual ones. `go_on` is evaluated before every step of a search.
///
/// # Errors
/// [`DiscriminationError`], if an effect is unknown, the same as the other, has no part to act on or no identifiable
/// parameter, if no planned motion is possible, or a column cannot be computed.
pub fn discriminate(
    model: &Model,
    names: [&str; 2],
    options: &Options,
    go_on: &(dyn Fn() -> bool + Sync),
) -> Result<Discrimination, DiscriminationError> {
    let pair = [assumed(model, names[0])?, assumed(model, names[1])?];
    if names[0] == names[1] {
        return Err(DiscriminationError::Same(names[0].into()));
    }
    let mut base = model.clone();
    base.effects.retain(|a| !names.contains(&a.effect.name()));
    let drives = Channel::of_drives(model.mechanism);
    let noise = Noise::of(&base, &drives, PERIOD.max(model.sample_time));
    let setup = Setup::default();
    let bench = Bench { model: &base, setup, channels: drives, noise: &noise, datasets: &[], seed: options.seed };
    let mut plans = bench.catalogue();
    let searched = searched(&base, &pair, options, go_on);
    let series: Vec<Course> = match &searched {
        Some(course) => vec![course.clone()],
        None => (1..=DRAWN).map(|k| random(options, k)).collect(),
    };
    let what =
        if searched.is_some() { "a periodic motion designed for it" } else { "the best of several random motions" };
    let designed = series.iter().filter_map(|course| bench.plan(Kind::Designed, what.into(), course));
    let length = options.periods as f64 / options.frequency;
    plans.extend(designed.map(|e| Experiment { weight: e.weight * length / e.length, length, ..e }));
    let promise = |i: usize| {
        let own = Information::along(&base, &[], &pair, &plans[i].dataset, &noise)?;
        Ok(prospect(&which(2), &pair, None, (&own, &plans[i]), BLOCKS))
    };
    let promises: Vec<Prospect> =
        parallel::map(plans.len(), promise).into_iter().collect::<Result<_, KinematicsError>>()?;
    let mut plans = ranked(plans.into_iter().zip(promises));
    // Only the best plan of each kind and description.
    let mut seen: Vec<(Kind, String)> = Vec::new();
    plans.retain(|(e, _)| {
        let new = !seen.contains(&(e.kind, e.what.clone()));
        seen.push((e.kind, e.what.clone()));
        new
    });
    match plans.is_empty() {
        true => Err(DiscriminationError::NoMotion),
        false => Ok(Discrimination { effects: pair, plans, searched: searched.is_some() }),
    }
}

fn random(options: &Options, k: u64) -> Course {
    let Options { frequency, harmonics, .. } = *options;
    let share = 0.6 * options.share;
    Course::RandomFourier { seed: options.seed.wrapping_mul(1000).wrapping_add(k), frequency, harmonics, share }
}

/// The effect with its size in the model, or else its usual one.
fn assumed(model: &Model, name: &str) -> Result<ActiveEffect, DiscriminationError> {
    let effect = effects::find(name).ok_or_else(|| DiscriminationError::Unknown(name.into()))?;
    if name == effects::rigid_bodies::NAME || !effect.spec().identifiable {
        return Err(DiscriminationError::TwinOnly(name.into()));
    }
    if !model.mechanism.has(effect.acts_on(), model.assembled) {
        return Err(DiscriminationError::Missing { effect: name.into(), part: effect.acts_on().describe() });
    }
    if let Some(own) = model.effects.iter().find(|a| a.effect.name() == name) {
        return Ok(own.clone());
    }
    let mut active = ActiveEffect::absent_on(effect.clone(), model.host());
    let entries = active.entries();
    for (value, p) in active.values.iter_mut().zip(entries.iter().map(|e| &e.parameter)) {
        let constant = if p.role == Role::Fixed { effect.spec().constant(&p.name, &model.view()) } else { None };
        *value = constant.unwrap_or(p.default);
    }
    Ok(active)
}

/// Fourier series of largest δ²; `None` if the effects' columns depend on more than the instant, or nothing is found.
fn searched(
    base: &Model,
    pair: &[ActiveEffect; 2],
    options: &Options,
    go_on: &(dyn Fn() -> bool + Sync),
) -> Option<Course> {
    if pair.iter().any(|a| a.states() > 0 || a.gear_springs().is_some()) {
        return None;
    }
    let limits = Limits::of(base, options.share, options.hemisphere);
    let [exact, soft] = [false, true].map(|soft| Machine::new(base, limits, soft).with_candidates(pair));
    let merit = Difference::of(&soft);
    let objective = |information: &DMatrix<f64>| merit.value(information);
    let instants = (PER_HARMONIC * options.harmonics).max(FEWEST_INSTANTS);
    let basis = Basis::new(options.frequency, options.harmonics, instants);
    let fine = Basis::new(options.frequency, options.harmonics, FINER * instants);
    let scale = scale(base, options);
    let search = Search { machine: &soft, basis: &basis, objective: &objective, scale: &scale };
    let one = |k: usize| {
        let start = shrunk(&exact, &basis, &draw(base, &exact, &limits, options, k as u64), SHRINK)?.0;
        Some(search.run(&basis.vector(&start), options.iterations, go_on))
    };
    let found: Vec<Found> = parallel::map(options.starts.max(1), one).into_iter().flatten().collect();
    let best = found.iter().min_by(|a, b| a.value.total_cmp(&b.value))?;
    let (motion, samples, _) = shrunk(&exact, &fine, &basis.motion(best.x.as_deref()?), TRIM)?;
    worst(&samples).iter().all(|w| *w <= 1.0).then_some(Course::Fourier(motion))
}

/// Objective: −log of the smooth minimum of the δ² of two effects, (1/p)·log(δ₁⁻²ᵖ + δ₂⁻²ᵖ).
struct Difference {
    /// Columns of each effect and their sizes in units of the columns.
    own: [(Vec<usize>, DVector<f64>); 2],
    base: Vec<usize>,
}

impl Difference {
    fn of(machine: &Machine) -> Self {
        let mut own = machine.candidates().into_iter().map(|candidate| {
            let (columns, sizes): (Vec<usize>, Vec<f64>) = candidate.into_iter().unzip();
            (columns, DVector::from_vec(sizes))
        });
        let mut next = || own.next().unwrap_or((Vec::new(), DVector::zeros(0)));
        Self { own: [next(), next()], base: (0..machine.sizes().len()).collect() }
    }

    fn value(&self, information: &DMatrix<f64>) -> Option<(f64, DMatrix<f64>)> {
        if information.iter().any(|x| !x.is_finite()) {
            return None;
        }
        let n = information.nrows();
        let mut sum = 0.0;
        let mut slope = DMatrix::zeros(n, n);
        for k in 0..2 {
            let ((own, sizes), (rival, _)) = (&self.own[k], &self.own[1 - k]);
            let imitators: Vec<usize> = self.base.iter().chain(rival).copied().collect();
            let (left, w) = what_is_left(information, own, sizes, &imitators);
            let weight = left.powf(-POWER);
            sum += weight;
            slope.ger(-weight / left, &w, &w, 1.0);
        }
        let value = sum.ln() / POWER;
        value.is_finite().then(|| (value, slope / sum))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::excitation::machine::information;
    use crate::model::testing::irb360;

    /// The derivative of −log δ² with respect to the information equals that of finite differences.
    #[test]
    fn difference_has_the_slope_of_its_value() {
        let model = irb360();
        let pair = ["ball_socket_coulomb", "ball_socket_viscous"].map(|n| assumed(&model, n).unwrap());
        let options = Options { harmonics: 3, ..Options::default() };
        let limits = Limits::of(&model, options.share, None);
        let machine = Machine::new(&model, limits, true).with_candidates(&pair);
        let merit = Difference::of(&machine);
        let basis = Basis::new(options.frequency, options.harmonics, 120);
        let at = |k: u64| {
            let motion = draw(&model, &machine, &limits, &options, k);
            information(&machine.samples(&basis, &basis.vector(&motion)).unwrap())
        };
        let (here, there) = (at(0), at(1));
        let (_, slope) = merit.value(&here).unwrap();
        let h = 1e-4;
        let value = |h: f64| merit.value(&(&here * (1.0 - h) + &there * h)).unwrap().0;
        let difference = (value(h) - value(-h)) / (2.0 * h);
        let expected = slope.dot(&(&there - &here));
        assert!((difference - expected).abs() < 1e-3 * expected.abs(), "{difference} {expected}");
    }
}
