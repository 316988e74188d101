//! Factors and the points at which they are set.
//!
//! Point i of a plan is a function of the study's digest, its seed and i. A search is a function of the same and of the
//! margins that it has been told.

mod distribution;
pub(crate) mod evolution;
mod mix;
pub(crate) mod root;
mod sobol;

pub use distribution::{normal_share, quantile};
pub use root::Crossing;
pub use sobol::{DIMENSIONS, point as sobol_point, scrambled as scrambled_sobol};

use deltatwin_io::study::{Design, Draws as Seeds, Factor, Range, Setting, Study};
use nalgebra::DVector;

use crate::campaign::Draws;
use crate::statistics::{normal_quantile, sobol_points};

/// Settings of all factors in a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// One setting per factor.
    pub settings: Vec<Setting>,
    /// Seed of the scenario; `None` keeps its own.
    pub seed: Option<u64>,
}

/// Quantiles at which a distributed factor is low and high.
pub const LOW_AND_HIGH: [f64; 2] = [0.05, 0.95];

/// Points of a study.
#[derive(Clone)]
pub struct Plan {
    design: Design,
    factors: Vec<Factor>,
    seeds: Seeds,
    draws: Draws,
    keys: Vec<u64>,
}

impl Plan {
    /// The points of `study`, whose random numbers are `draws`.
    pub fn new(study: &Study, draws: Draws) -> Self {
        let keys = (0..2 * study.factors.len()).map(|d| draws.key(d)).collect();
        Self { design: study.design.clone(), factors: study.factors.clone(), seeds: study.draws, draws, keys }
    }

    /// Number of rows; of a search the largest.
    pub fn runs(&self) -> u64 {
        let d = self.factors.len() as u64;
        match &self.design {
            Design::Grid { repeats } => self.combinations(&[]).saturating_mul(*repeats),
            Design::LatinHypercube { runs }
            | Design::Sobol { runs }
            | Design::MonteCarlo { runs }
            | Design::WorstCase { runs } => *runs,
            Design::Sensitivity { samples } => 1 + 2 * d + samples.saturating_mul(d + 2),
            Design::Boundary { along, rays, repeats, .. } => {
                self.combinations(along).saturating_mul(*repeats).saturating_mul(*rays)
            }
            Design::Subset { samples, levels, .. } => samples.saturating_mul(*levels),
        }
    }

    /// Whether each run depends on those before.
    pub fn is_search(&self) -> bool {
        matches!(self.design, Design::WorstCase { .. } | Design::Subset { .. })
    }

    /// Number of combinations of the factors that have levels, without those `along` a ray.
    fn combinations(&self, along: &[usize]) -> u64 {
        let counts = self.factors.iter().enumerate().filter(|(k, _)| !along.contains(k)).map(|(_, f)| levels(f));
        counts.fold(1u64, |all, count| all.saturating_mul(count))
    }

    /// Point of a run; of a boundary search the start of its ray, of a search the middle of all factors.
    pub fn point(&self, run: u64) -> Point {
        let middle = || self.factors.iter().map(nominal).collect();
        let d = self.factors.len();
        let of = |u: &dyn Fn(usize) -> f64| -> Vec<Setting> { (0..d).map(|k| at(&self.factors[k], u(k))).collect() };
        let settings = match &self.design {
            Design::Grid { repeats } => self.combination(run / repeats, &[], (run, run % repeats)),
            Design::LatinHypercube { runs } => {
                of(&|k| (mix::permuted(run, *runs, self.keys[k]) as f64 + self.draws.uniform(run, k)) / *runs as f64)
            }
            Design::Sobol { .. } => of(&|k| sobol::scrambled(run, k, self.keys[k])),
            Design::MonteCarlo { .. } => of(&|k| self.draws.uniform(run, k)),
            Design::Sensitivity { .. } => self.sensitivity(run),
            Design::Boundary { .. } => self.on_ray(run, 0.0),
            Design::WorstCase { .. } | Design::Subset { .. } => middle(),
        };
        Point { settings, seed: self.seed(run) }
    }

    /// Seed of the scenario of a run; all runs of a ray have the same.
    pub fn seed(&self, run: u64) -> Option<u64> {
        let own = match &self.design {
            Design::Boundary { rays, .. } => run / rays,
            _ => run,
        };
        (self.seeds == Seeds::Each).then(|| self.draws.seed(own))
    }

    /// Levels of a combination; factors that are distributed are at their medians if `repeat` is zero, and else drawn for
    /// `run`.
    fn combination(&self, number: u64, along: &[usize], (run, repeat): (u64, u64)) -> Vec<Setting> {
        let mut rest = number;
        let mut settings: Vec<Setting> = self.factors.iter().map(nominal).collect();
        for (k, factor) in self.factors.iter().enumerate().rev() {
            if along.contains(&k) {
                continue;
            }
            match &factor.range {
                Range::Levels(all) => {
                    let count = all.len() as u64;
                    settings[k] = Setting::Level((rest % count) as usize);
                    rest /= count;
                }
                _ if repeat > 0 => settings[k] = at(factor, self.draws.uniform(run, k)),
                _ => {}
            }
        }
        settings
    }

    fn sensitivity(&self, run: u64) -> Vec<Setting> {
        let d = self.factors.len();
        let single = 1 + 2 * d as u64;
        if run < single {
            let mut settings: Vec<Setting> = self.factors.iter().map(nominal).collect();
            if let Some(k) = run.checked_sub(1) {
                let (factor, end) = ((k / 2) as usize, (k % 2) as usize);
                settings[factor] = ends(&self.factors[factor])[end];
            }
            return settings;
        }
        let (sample, row) = ((run - single) / (d as u64 + 2), (run - single) % (d as u64 + 2));
        let base: Vec<f64> = (0..2 * d).map(|k| sobol::scrambled(sample, k, self.keys[k])).collect();
        let u = &sobol_points(&base)[row as usize];
        (0..d).map(|k| at(&self.factors[k], u[k])).collect()
    }

    /// Settings at a share of the ray of a run, from 0 to 1, in a boundary search.
    pub fn on_ray(&self, run: u64, share: f64) -> Vec<Setting> {
        let Design::Boundary { along, rays, repeats, .. } = &self.design else { return self.point(run).settings };
        let (ray, outer) = (run % rays, run / rays);
        // All rays of one draw have the same factors beside them.
        let mut settings = self.combination(outer / repeats, along, (outer, outer % repeats));
        let direction = self.direction(ray, *rays, along.len());
        for (k, part) in along.iter().zip(direction.iter()) {
            if let Range::Interval { from, to } = self.factors[*k].range {
                settings[*k] = Setting::Number(from + (to - from) * share * part);
            }
        }
        settings
    }

    /// Direction of a ray in the unit cube, so long that it ends on a face: evenly from one axis to the other of two,
    /// and at random on the sphere of more, by points of Sobol'.
    fn direction(&self, ray: u64, rays: u64, dimensions: usize) -> DVector<f64> {
        let direction = match dimensions {
            1 => DVector::from_element(1, 1.0),
            2 => {
                let share = if rays == 1 { 0.5 } else { ray as f64 / (rays - 1) as f64 };
                let angle = share * std::f64::consts::FRAC_PI_2;
                DVector::from_vec(if ray + 1 == rays && rays > 1 {
                    vec![0.0, 1.0]
                } else {
                    vec![angle.cos(), angle.sin()]
                })
            }
            // The absolute values of independent normal numbers point everywhere alike.
            n => DVector::from_fn(n, |k, _| normal_quantile(0.5 + 0.5 * sobol::scrambled(ray, k, self.keys[k])).abs()),
        };
        let longest = direction.amax().max(f64::MIN_POSITIVE);
        direction / longest
    }

    /// Settings of all factors at a point of the unit cube.
    pub fn in_cube(&self, u: &[f64]) -> Vec<Setting> {
        self.factors.iter().zip(u).map(|(factor, u)| at(factor, *u)).collect()
    }

    /// The factors at both ends of their ranges, one after the other, all others as the scenario has them.
    pub fn extremes(&self) -> impl Iterator<Item = (usize, Vec<Setting>)> + '_ {
        let count = self.factors.len();
        self.factors.iter().enumerate().flat_map(move |(k, factor)| {
            let ends = match &factor.range {
                Range::Levels(all) => (0..all.len()).map(Setting::Level).collect(),
                _ => ends(factor).to_vec(),
            };
            ends.into_iter().map(move |end| {
                let mut settings = vec![Setting::Unset; count];
                settings[k] = end;
                (k, settings)
            })
        })
    }
}

/// Number of levels; 1 for a factor without.
fn levels(factor: &Factor) -> u64 {
    match &factor.range {
        Range::Levels(all) => all.len() as u64,
        _ => 1,
    }
}

/// Setting of a factor at `u` from 0 to 1: the level, the share of the interval, or the quantile.
pub fn at(factor: &Factor, u: f64) -> Setting {
    match &factor.range {
        Range::Levels(all) => Setting::Level(((u * all.len() as f64) as usize).min(all.len() - 1)),
        Range::Interval { from, to } => Setting::Number(from + (to - from) * u),
        Range::Distributed(distribution) => Setting::Number(quantile(distribution, u)),
    }
}

/// Setting of a factor that nothing else sets: its nominal value, or the level nearest to it, or else its middle.
pub fn nominal(factor: &Factor) -> Setting {
    match (&factor.range, factor.nominal) {
        (Range::Levels(all), Some(value)) => {
            let distance = |k: &usize| all[*k].number.map_or(f64::INFINITY, |x| (x - value).abs());
            let nearest = (0..all.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)));
            Setting::Level(nearest.unwrap_or(0))
        }
        (_, Some(value)) => Setting::Number(value),
        (Range::Levels(all), None) => Setting::Level((all.len() - 1) / 2),
        _ => at(factor, 0.5),
    }
}

/// A factor at its low and high value: the ends, or the quantiles [`LOW_AND_HIGH`].
fn ends(factor: &Factor) -> [Setting; 2] {
    match factor.range {
        Range::Distributed(_) => LOW_AND_HIGH.map(|u| at(factor, u)),
        _ => [0.0, 1.0].map(|u| at(factor, u)),
    }
}

#[cfg(test)]
mod tests;
