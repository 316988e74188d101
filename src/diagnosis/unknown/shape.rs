//! Shape of a force: as a function of the variable it depends on most, with measures for friction, waves and drift.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use super::Sight;
use super::matching_pursuit::{Found, force};
use crate::effects::formula::{Place, Variable};
use crate::machine::{Mechanism, Unit};

/// Force as a function of one variable, with simultaneous 95 % bands.
#[derive(Clone, Debug, Default)]
pub struct Shape {
    /// Variable as in formulas, e.g. `qd1`; for a wave, within its period.
    pub variable: &'static str,
    /// Unit of the variable; `None` without data.
    variable_unit: Option<Unit>,
    /// Whether the force along the motion is shown, with its sign multiplied by that of the speed.
    pub along: bool,
    /// Centre of each bin.
    pub x: Vec<f64>,
    /// Mean force, N·m or N.
    pub mean: Vec<f64>,
    /// Lower limit of the band, N·m or N.
    pub low: Vec<f64>,
    /// Upper limit of the band, N·m or N.
    pub high: Vec<f64>,
    /// Share of the force's energy as a function of the variable's speed that is odd in it: 1 odd (friction), 0 even.
    pub odd: f64,
    /// Period of a wave in its variable, if the law is one: value and variable.
    pub period: Option<(f64, &'static str)>,
    /// Mean force in the last fifth of the time minus that in the first, N·m or N.
    pub drift: f64,
    /// Force at small positive speed minus that at small negative speed, N·m or N.
    pub jump: f64,
    /// Mean power on the machine, W; negative power is dissipation.
    pub power: f64,
}

const BINS: usize = 24;
/// Share of the energy above which a force is odd; below one minus this share it is even.
const ODD: f64 = 0.8;
/// Least number of instants of a bin.
const FULL: usize = 20;
const BLOCKS: usize = 40;
const DRAWS: usize = 399;

impl Shape {
    /// Shape of the force at `place`.
    pub fn new(sight: &Sight, terms: &[Found], place: usize, machine: Mechanism) -> Self {
        let force = force(sight, terms, place);
        let series = |name: &str| Variable::named(name).map(|v| sight.variables[v.index()].as_slice());
        let speed = series(rate(sight.places[place])).unwrap_or(&[]);
        let own = terms.iter().filter(|t| t.place == place).flat_map(|t| t.law.variables().collect::<Vec<_>>());
        let mut candidates: Vec<Variable> = own.collect();
        candidates.extend(
            [coordinate(sight.places[place]), rate(sight.places[place]), "t"].iter().filter_map(|n| Variable::named(n)),
        );
        let fastest = speed.iter().fold(0.0f64, |a, v| a.max(v.abs()));
        let odd = odd_share(speed, &force, fastest);
        // Friction as a function of a variable other than the speed requires removing the sign of the motion.
        let along: Vec<f64> = force.iter().zip(speed).map(|(f, v)| if *v < 0.0 { -f } else { *f }).collect();
        let own_rate = rate(sight.places[place]);
        let is_along = |v: &Variable| odd > ODD && v.name() != own_rate;
        let bins = |v: &Variable| Bins::new(&sight.variables[v.index()], if is_along(v) { &along } else { &force });
        let spread = |v: &Variable| bins(v).between();
        let best = candidates.iter().max_by(|a, b| spread(a).total_cmp(&spread(b))).copied();
        let Some(best) = best else { return Self::default() };
        let period = terms.iter().filter(|t| t.place == place).find_map(|t| wave(t.law.text()));
        // A wave is shown over its period.
        let waved = period.and_then(|(length, name)| Some((length, Variable::named(name)?)));
        let (best, is_along, bins, x) = match waved {
            Some((length, v)) => {
                let x: Vec<f64> = sight.variables[v.index()].iter().map(|x| x.rem_euclid(length)).collect();
                (v, false, Bins::new(&x, &force), x)
            }
            None => (best, is_along(&best), bins(&best), sight.variables[best.index()].clone()),
        };
        let band = bins.band(&x, if is_along { &along } else { &force });
        let mean_where = |keep: &dyn Fn(f64) -> bool| {
            let kept: Vec<f64> = speed.iter().zip(&force).filter(|(v, _)| keep(**v)).map(|(_, f)| *f).collect();
            kept.iter().sum::<f64>() / kept.len().max(1) as f64
        };
        let slow = |v: f64| v > 0.005 * fastest && v < 0.06 * fastest;
        let fifth = (force.len() / 5).max(1);
        let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len().max(1) as f64;
        Self {
            variable: best.name(),
            variable_unit: Some(best.unit(machine)),
            low: bins.mean.iter().zip(&band).map(|(m, b)| m - b).collect(),
            high: bins.mean.iter().zip(&band).map(|(m, b)| m + b).collect(),
            odd,
            along: is_along,
            period,
            drift: mean(&force[force.len().saturating_sub(fifth)..]) - mean(&force[..fifth.min(force.len())]),
            jump: mean_where(&slow) - mean_where(&|v| slow(-v)),
            power: speed.iter().zip(&force).map(|(v, f)| v * f).sum::<f64>() / force.len().max(1) as f64,
            x: bins.x,
            mean: bins.mean,
        }
    }

    /// Text of the variable's unit; empty without data.
    pub fn variable_unit(&self) -> String {
        self.variable_unit.map_or_else(String::new, |unit| unit.to_string())
    }

    /// Parity in the speed: `odd`, `even` or `mixed`.
    pub fn parity(&self) -> &'static str {
        match self.odd {
            x if x > ODD => "odd",
            x if x < 1.0 - ODD => "even",
            _ => "mixed",
        }
    }
}

fn coordinate(place: Place) -> &'static str {
    match place {
        Place::Drive(i) => ["q1", "q2", "q3", "q4"][i],
        Place::Platform(axis) => ["x", "y", "z"][axis],
        Place::Telescope => "s",
    }
}

fn rate(place: Place) -> &'static str {
    match place {
        Place::Drive(i) => ["qd1", "qd2", "qd3", "qd4"][i],
        Place::Platform(axis) => ["vx", "vy", "vz"][axis],
        Place::Telescope => "sd",
    }
}

/// Period and variable of `sin(k*variable)` or `cos(k*variable)` in a law.
fn wave(law: &str) -> Option<(f64, &'static str)> {
    let inner = law.split("sin(").nth(1).or_else(|| law.split("cos(").nth(1))?;
    let (number, rest) = inner.split_once('*')?;
    let variable = Variable::named(rest.split(')').next()?)?;
    let number: f64 = number.trim_matches(['(', ')']).parse().ok()?;
    Some((std::f64::consts::TAU / number.abs(), variable.name()))
}

/// Share of the energy of a force as a function of the speed that is odd in it.
fn odd_share(speed: &[f64], force: &[f64], fastest: f64) -> f64 {
    let side = |sign: f64| {
        let mut sums = vec![(0.0, 0usize); BINS / 2];
        for (v, f) in speed.iter().zip(force).filter(|(v, _)| **v * sign > 0.0) {
            let bin = ((v.abs() / fastest * (BINS / 2) as f64) as usize).min(BINS / 2 - 1);
            sums[bin] = (sums[bin].0 + f, sums[bin].1 + 1);
        }
        sums
    };
    let (mut odd, mut even) = (0.0, 0.0);
    for (a, b) in side(1.0).into_iter().zip(side(-1.0)).filter(|(a, b)| a.1 >= FULL && b.1 >= FULL) {
        let (plus, minus) = (a.0 / a.1 as f64, b.0 / b.1 as f64);
        let weight = (a.1 + b.1) as f64;
        odd += weight * (0.5 * (plus - minus)).powi(2);
        even += weight * (0.5 * (plus + minus)).powi(2);
    }
    if odd + even > 0.0 { odd / (odd + even) } else { 0.0 }
}

/// Means over bins of equal width with enough instants.
struct Bins {
    x: Vec<f64>,
    mean: Vec<f64>,
    count: Vec<usize>,
    /// Bin of each instant.
    of: Vec<Option<usize>>,
}

impl Bins {
    fn new(x: &[f64], y: &[f64]) -> Self {
        let (low, high) = x.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
        let width = (high - low) / BINS as f64;
        let raw = |v: f64| if width > 0.0 { (((v - low) / width) as usize).min(BINS - 1) } else { 0 };
        let mut sums = vec![(0.0, 0usize); BINS];
        for (v, f) in x.iter().zip(y) {
            let s = &mut sums[raw(*v)];
            *s = (s.0 + f, s.1 + 1);
        }
        let kept: Vec<usize> = (0..BINS).filter(|&b| sums[b].1 >= FULL).collect();
        let place = |v: &f64| kept.iter().position(|&b| b == raw(*v));
        Self {
            x: kept.iter().map(|&b| low + width * (b as f64 + 0.5)).collect(),
            mean: kept.iter().map(|&b| sums[b].0 / sums[b].1 as f64).collect(),
            count: kept.iter().map(|&b| sums[b].1).collect(),
            of: x.iter().map(place).collect(),
        }
    }

    /// Energy of the means about the common mean.
    fn between(&self) -> f64 {
        let n: usize = self.count.iter().sum();
        let weighted =
            |f: &dyn Fn(f64) -> f64| self.mean.iter().zip(&self.count).map(|(m, c)| f(*m) * *c as f64).sum::<f64>();
        let mean = weighted(&|m| m) / n.max(1) as f64;
        weighted(&|m| (m - mean).powi(2))
    }

    /// Half width of the simultaneous 95 % band, by random sign flips of the block sums of the deviations.
    fn band(&self, x: &[f64], y: &[f64]) -> Vec<f64> {
        let n = x.len();
        let bins = self.mean.len();
        let mut sums = vec![vec![0.0; bins]; BLOCKS];
        for k in 0..n {
            if let Some(bin) = self.of[k] {
                sums[k * BLOCKS / n][bin] += y[k] - self.mean[bin];
            }
        }
        let error: Vec<f64> =
            (0..bins).map(|b| sums.iter().map(|s| s[b] * s[b]).sum::<f64>().sqrt() / self.count[b] as f64).collect();
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut worst: Vec<f64> = (0..DRAWS)
            .map(|_| {
                let signs: Vec<f64> = (0..BLOCKS).map(|_| if rng.random_bool(0.5) { 1.0 } else { -1.0 }).collect();
                let off = |b: usize| {
                    let sum: f64 = sums.iter().zip(&signs).map(|(s, w)| s[b] * w).sum();
                    if error[b] > 0.0 { (sum / self.count[b] as f64 / error[b]).abs() } else { 0.0 }
                };
                (0..bins).map(off).fold(0.0, f64::max)
            })
            .collect();
        worst.sort_by(f64::total_cmp);
        let factor = worst[(0.95 * DRAWS as f64) as usize];
        error.iter().map(|e| factor * e).collect()
    }
}
