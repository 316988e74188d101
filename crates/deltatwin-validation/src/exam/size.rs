//! Size of a hidden effect, defined by its residual after a refit of the model.
//!
//! Along the desired motion, with B the columns of the model's own parameters and z the effect's contribution, both
//! in units of the channels' noise σ, a refit leaves r = z − B·(BᵀB + γ)⁻¹Bᵀz. An effect of medium size increases the
//! RMS residual √(σ² + r²) of the most affected channel by 20–60 %. This determines the channel and a first scale;
//! the refit itself, with its constraints on bodies and friction, corrects the scale.

use nalgebra::{DMatrix, DVector};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;

use super::motion::Motion;
use super::outside::Outside;
use super::span;
use deltatwin::dynamics::Plant;
use deltatwin::effects::{ActiveEffect, Role};
use deltatwin::identification::filtering::MIN_HALF_WIDTH;
use deltatwin::identification::fit::{FitError, Options, fit_with, kinematics, nominal_size};
use deltatwin::identification::{Dataset, columns, predict};
use deltatwin::machine::{Setup, each};
use deltatwin::model::Model;
use deltatwin::numerics::bisect;
use deltatwin::recording::Channel;

/// Size of a hidden effect.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord, clap::ValueEnum)]
pub enum Size {
    /// 0.4 of the medium parameter.
    Small,
    /// Raises the refitted RMS residual by 20–60 %.
    #[default]
    Medium,
    /// 2.5 of the medium parameter.
    Large,
}

impl Size {
    /// All sizes.
    pub const ALL: [Self; 3] = [Self::Small, Self::Medium, Self::Large];

    /// Name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Small => "small",
            Self::Medium => "medium",
            Self::Large => "large",
        }
    }

    /// Ratio of the parameter to that of medium size.
    pub fn factor(self) -> f64 {
        match self {
            Self::Small => 0.4,
            Self::Medium => 1.0,
            Self::Large => 2.5,
        }
    }
}

impl std::fmt::Display for Size {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.name())
    }
}

/// Residual of an effect after a refit.
#[derive(Clone, Debug, PartialEq)]
pub struct Rise {
    /// The channel that determined the size.
    pub channel: Channel,
    /// Expected ratio of RMS residual to noise, by channel.
    pub ratios: Vec<(Channel, f64)>,
    /// Whether its range or physical consistency keeps the effect below the requested size.
    pub limited: bool,
}

impl Rise {
    /// Whether a refit leaves as much of the effect as of one of medium size, on the channel that determined its
    /// size.
    pub fn is_visible(&self) -> bool {
        self.ratios.iter().any(|(channel, ratio)| *channel == self.channel && *ratio >= VISIBLE_RISE)
    }
}

/// An effect with its values and its residual after a refit.
#[derive(Clone)]
pub struct Hidden {
    /// The effect with its values.
    pub active: ActiveEffect,
    /// Residual after a refit of the model.
    pub rise: Rise,
}

/// Range of the ratio of RMS residual to noise for an effect of medium size.
pub const MEDIUM: (f64, f64) = (1.2, 1.6);
/// Lower end of that range, minus a tolerance for the last correction of the size.
const VISIBLE_RISE: f64 = 0.98 * MEDIUM.0;
/// Multiple of its usual magnitude up to which an effect of medium size in the torques counts as visible there.
const VISIBLE: f64 = 100.0;
/// RMS in units of the noise below which an effect is invisible.
const SILENT: f64 = 0.05;
/// Number of corrections of the medium size by the refit itself.
const CORRECTIONS: usize = 2;
/// Spacing of the instants, s.
const SPACING: f64 = 2e-3;
/// Prior information of a fit per own size squared, to be scaled for the smaller number of samples.
const PRIOR: f64 = 1e-2;

/// Ratio of the residual shares of a single item of an effect and of all items together, above which the items
/// together are within the span of the model's own parameters and only one item is used. Along a slow Fourier series
/// the ratio is below 1.5 or above 2.4.
const APART: f64 = 2.0;
/// Share of the largest residual that an item must have to be used alone.
const SHOWN: f64 = 0.25;

/// Sizing of effects along one motion.
pub struct Sizer<'a> {
    robot: &'a Model,
    setup: &'a Setup,
    dataset: Dataset,
    noise: Vec<f64>,
    /// Columns of the robot's own parameters in units of noise and own size.
    base: DMatrix<f64>,
    inverse: DMatrix<f64>,
    /// Prior information of a refit.
    prior: f64,
}

impl<'a> Sizer<'a> {
    /// Sizing for a robot that measures `channels` with `noise` along `motion`.
    ///
    /// # Errors
    /// If the robot cannot follow the motion.
    pub fn new(
        robot: &'a Model,
        setup: &'a Setup,
        motion: &Motion,
        duration: f64,
        channels: &[Channel],
        noise: &[f64],
    ) -> Result<Self, FitError> {
        let plant = Plant::new(robot, setup);
        let n = (duration / SPACING).ceil() as usize;
        let t: Vec<f64> = (0..n).map(|k| k as f64 * SPACING).collect();
        let joints = t.iter().map(|&t| motion.at(t).joints(&plant.geometry)).collect::<Result<_, _>>();
        let joints = joints.map_err(|reason| FitError::Kinematics { recording: "desired".into(), reason })?;
        let exact = Dataset::exact(robot.mechanism, *setup, channels.to_vec(), SPACING, joints);
        // As for angles with noise: nothing is trimmed.
        let dataset = Dataset { half_width: each(MIN_HALF_WIDTH + 1), ..exact };
        let all = columns(&plant, &dataset, None).map_err(kinematics(&dataset))?;
        let own: Vec<DVector<f64>> = plant
            .parameters()
            .iter()
            .zip(&all)
            .filter(|(p, _)| p.role != Role::Fixed)
            .map(|(p, column)| nominal_size(p) * stacked(column, noise))
            .collect();
        let base = DMatrix::from_columns(&own);
        let m = base.ncols();
        // The prior of a fit, scaled to this spacing of the samples.
        let prior = PRIOR * robot.sample_time / SPACING;
        let normal = base.tr_mul(&base) + DMatrix::identity(m, m) * prior;
        let inverse = normal.cholesky().map_or_else(|| DMatrix::zeros(m, m), |c| c.inverse());
        Ok(Self { robot, setup, dataset, noise: noise.to_vec(), base, inverse, prior })
    }

    /// Effect with drawn values, `size` times as large as one of medium size ([`Size::factor`]).
    ///
    /// # Errors
    /// If the effect cannot be computed along the motion or the model cannot be refitted.
    ///
    /// # Panics
    /// If the machine has no drives.
    pub fn draw(
        &self,
        effect: Arc<dyn deltatwin::effects::Effect>,
        size: f64,
        rng: &mut ChaCha8Rng,
    ) -> Result<Hidden, FitError> {
        let active = self.shaped(&effect, rng);
        let columns = self.columns(&active)?;
        // The terms of a formula are one law.
        let mut direction = match active.effect.formula() {
            Some(_) => direction(&active, rng),
            None => self.departing(&columns, direction(&active, rng), rng),
        };
        let wanted = rng.random_range(MEDIUM.0..MEDIUM.1);
        if active.has_gears() {
            // Medium size is the usual compliance: gears sized by the residual would be ten times as stiff as any
            // real ones.
            return self.hidden(active, &direction, size, None);
        }
        let left = self.left(&columns, &direction);
        let mut most = self.most(&active, &direction);
        // Scale of the direction at which a channel's residual increases as intended.
        let needed = |c: usize| (wanted * wanted - 1.0f64).sqrt() / left[c].max(f64::MIN_POSITIVE);
        let best = |torque: bool| {
            let own = (0..left.len()).filter(|&c| self.dataset.channels[c].drive().is_some() == torque);
            own.min_by(|&a, &b| needed(a).total_cmp(&needed(b)))
        };
        let torque = best(true).expect("a machine has drives");
        let channel = match best(false) {
            Some(strut) if needed(torque) > VISIBLE.min(most) && needed(strut) < needed(torque).min(most) => strut,
            _ => torque,
        };
        if needed(channel) > most {
            // The opposite direction may have a larger range.
            let other: Vec<f64> = direction.iter().map(|d| -d).collect();
            let room = self.most(&active, &other);
            if room > most {
                (direction, most) = (other, room);
            }
        }
        let mut medium = needed(channel);
        // The law may be nonlinear, and the refit is constrained to consistent bodies and friction.
        for _ in 0..CORRECTIONS {
            if medium < most {
                let exact = self.left_exactly(&active, &direction, medium)?[channel].max(f64::MIN_POSITIVE);
                medium *= ((wanted * wanted - 1.0f64).sqrt() / exact).clamp(0.2, 5.0);
            }
        }
        let asked = size * medium;
        // An effect that is invisible at any size keeps its usual one.
        let scale = if medium > most && left[channel] * most < SILENT { most.min(1.0) } else { asked.min(most) };
        self.hidden(active, &direction, scale, Some((channel, scale < asked)))
    }

    /// The effect at `scale` times `direction`; `sized` is the channel that determined its size (by default the most
    /// affected one) and whether it is limited.
    fn hidden(
        &self,
        mut active: ActiveEffect,
        direction: &[f64],
        scale: f64,
        sized: Option<(usize, bool)>,
    ) -> Result<Hidden, FitError> {
        let left = self.left_exactly(&active, direction, scale)?;
        for (value, d) in active.values.iter_mut().zip(direction).filter(|(_, d)| **d != 0.0) {
            *value = scale * d;
        }
        let most = (0..left.len()).max_by(|&a, &b| left[a].total_cmp(&left[b])).unwrap_or(0);
        let (channel, limited) = sized.unwrap_or((most, false));
        let ratios = self.dataset.channels.iter().zip(&left).map(|(&c, l)| (c, l.hypot(1.0))).collect();
        Ok(Hidden { active, rise: Rise { channel: self.dataset.channels[channel], ratios, limited } })
    }

    /// The effect with zero action, the robot's constants and drawn shape parameters.
    fn shaped(&self, effect: &Arc<dyn deltatwin::effects::Effect>, rng: &mut ChaCha8Rng) -> ActiveEffect {
        let mut active = ActiveEffect::absent_on(Arc::clone(effect), self.robot.host());
        let entries = active.entries();
        let grids = effect.spec().search.grids;
        // Of several searched shape parameters only one differs from its usual value.
        let chosen = if grids.len() > 1 { rng.random_range(0..grids.len()) } else { 0 };
        let mut shape = 0;
        for (value, entry) in active.values.iter_mut().zip(&entries) {
            let p = &entry.parameter;
            match p.role {
                Role::Fixed => *value = effect.spec().constant(&p.name, &self.robot.view()).unwrap_or(*value),
                Role::Shape => {
                    let usual = effect.spec().constant(&p.name, &self.robot.view()).unwrap_or(p.default);
                    *value = usual;
                    if grids.len() == 1 || shape == chosen {
                        // Between the inner starting points of the search for it.
                        let grid = grids[chosen];
                        let inner = |i: usize| grid.get(i).copied().unwrap_or(1.0);
                        let (a, b) = (inner(1), inner(grid.len().saturating_sub(2)));
                        let factor = a * (b / a).powf(rng.random_range(0.0..1.0));
                        *value = (factor * usual).clamp(p.range.0, p.range.1);
                    }
                    shape += 1;
                }
                Role::Linear => {}
            }
        }
        active
    }

    /// Columns of an effect's parameters in units of the noise.
    fn columns(&self, active: &ActiveEffect) -> Result<Vec<DVector<f64>>, FitError> {
        let all = columns(&Plant::new(self.robot, self.setup), &self.dataset, Some(active));
        let all = all.map_err(kinematics(&self.dataset))?;
        Ok(all.iter().map(|column| stacked(column, &self.noise)).collect())
    }

    /// Contribution of the linear parameters at `direction`, and its residual after a refit, channel by channel in
    /// units of the noise.
    fn done_and_left(&self, columns: &[DVector<f64>], direction: &[f64]) -> [DVector<f64>; 2] {
        let mut z = DVector::zeros(self.dataset.len() * self.noise.len());
        for (column, d) in columns.iter().zip(direction).filter(|(_, d)| **d != 0.0) {
            z.axpy(*d, column, 1.0);
        }
        let imitated = &self.base * (&self.inverse * self.base.tr_mul(&z));
        let left = &z - imitated;
        [z, left]
    }

    /// RMS per channel of the residual after a refit, with the linear parameters at `direction`, in units of the
    /// noise.
    fn left(&self, columns: &[DVector<f64>], direction: &[f64]) -> Vec<f64> {
        let n = self.dataset.len();
        let [_, r] = self.done_and_left(columns, direction);
        (0..self.noise.len()).map(|c| (r.rows(c * n, n).norm_squared() / n as f64).sqrt()).collect()
    }

    /// `direction`, or one item of it if the model's parameters imitate all items together but not each alone, such
    /// as a factor common to all torques.
    fn departing(&self, columns: &[DVector<f64>], direction: Vec<f64>, rng: &mut ChaCha8Rng) -> Vec<f64> {
        let share = |direction: &[f64]| {
            let [done, left] = self.done_and_left(columns, direction);
            (left.norm_squared() / done.norm_squared().max(f64::MIN_POSITIVE)).sqrt()
        };
        let only =
            |i: usize| (0..direction.len()).map(|k| if k == i { direction[k] } else { 0.0 }).collect::<Vec<f64>>();
        let items: Vec<usize> = (0..direction.len()).filter(|&i| direction[i] != 0.0).collect();
        let shares: Vec<f64> = items.iter().map(|&i| share(&only(i))).collect();
        let largest = shares.iter().copied().fold(0.0, f64::max);
        if items.len() < 2 || largest < APART * share(&direction) {
            return direction;
        }
        let shown: Vec<usize> =
            items.iter().zip(&shares).filter(|(_, share)| **share >= SHOWN * largest).map(|(i, _)| *i).collect();
        only(shown[rng.random_range(0..shown.len())])
    }

    /// Share of a law outside the library that no sum of the search's laws represents, see [`span::unspanned`].
    ///
    /// # Errors
    /// If the machine cannot follow the motion.
    pub fn unspanned(&self, law: Outside) -> Result<Option<f64>, FitError> {
        let terms = &law.effect(self.robot.mechanism).terms;
        span::unspanned(self.robot, &self.dataset, terms[0].at, &terms[0].law)
    }

    /// RMS per channel of the residual of `scale` times `direction` after an actual refit with all constraints, along
    /// the noise-free motion, in units of the noise.
    fn left_exactly(&self, active: &ActiveEffect, direction: &[f64], scale: f64) -> Result<Vec<f64>, FitError> {
        let with = self.with(active, direction, scale);
        let mut dataset = self.dataset.clone();
        dataset.set_measured(predict(&Plant::new(&with, self.setup), &dataset).map_err(kinematics(&dataset))?);
        let options = Options { prior_information: Some(self.prior), ..Options::default() };
        let refitted = fit_with(self.robot, &[dataset], std::slice::from_ref(&self.noise), &options)?;
        Ok(refitted.residuals.rms.iter().zip(&self.noise).map(|(r, s)| r / s).collect())
    }

    /// The robot with `scale` times `direction` of an effect.
    fn with(&self, active: &ActiveEffect, direction: &[f64], scale: f64) -> Model {
        let mut there = active.clone();
        for (value, d) in there.values.iter_mut().zip(direction).filter(|(_, d)| **d != 0.0) {
            *value = scale * d;
        }
        let mut robot = self.robot.clone();
        robot.effects.push(there);
        robot
    }

    /// Largest multiple of `direction` within the parameters' ranges that leaves the bodies consistent.
    fn most(&self, active: &ActiveEffect, direction: &[f64]) -> f64 {
        let reach = |(entry, d): (&deltatwin::effects::Entry, &f64)| {
            let (low, high) = entry.parameter.range;
            (if *d > 0.0 { high } else { low }) / d
        };
        let entries = active.entries();
        let high = entries.iter().zip(direction).filter(|(_, d)| **d != 0.0).map(reach).fold(f64::INFINITY, f64::min);
        let possible = |scale: f64| {
            let bodies = Plant::new(&self.with(active, direction, scale), self.setup).bodies;
            bodies.0.iter().all(|b| b.min_eigenvalue() >= -POSSIBLE * b.mass.max(b.tensor.trace()).max(1e-3))
        };
        if possible(high) { high } else { bisect([0.0, high], 40, possible)[0] }
    }
}

/// Negative eigenvalue of a pseudo-inertia, relative to the body's size, that counts as rounding.
const POSSIBLE: f64 = 1e-10;

/// Linear parameters at half to 1.5 of their usual magnitude, with random signs in proportion to their range; zero
/// elsewhere.
fn direction(active: &ActiveEffect, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let drawn = |entry: &deltatwin::effects::Entry| {
        let p = &entry.parameter;
        let size = p.default * rng.random_range(0.5..1.5);
        let (low, high) = p.range;
        let negative = rng.random_bool((-low / (high - low)).clamp(0.0, 1.0));
        // The sign of a formula is part of its law.
        let sign = if negative && active.effect.formula().is_none() { -1.0 } else { 1.0 };
        if p.role == Role::Linear { sign * size } else { 0.0 }
    };
    active.entries().iter().map(drawn).collect()
}

/// Channels in sequence, each in units of its noise.
fn stacked(column: &[Vec<f64>], noise: &[f64]) -> DVector<f64> {
    DVector::from_iterator(
        column.iter().map(Vec::len).sum(),
        column.iter().zip(noise).flat_map(|(c, s)| c.iter().map(move |x| x / s)),
    )
}
