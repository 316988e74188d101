//! [`Arrangement`]: assignment of the columns of a recording to the axes of the model: order, sense of rotation, zero.
//!
//! Each arrangement is assessed by how well multiples of the torques that the model predicts for it explain the
//! measured ones. A wrong factor or sign of a torque therefore costs little and is determined afterwards.

use std::f64::consts::FRAC_PI_2;

use super::instants::{Instants, Predicted, beyond, friction, heavier, shifted};
use super::line::Line;
use crate::dynamics::Plant;
use crate::identification::Dataset;
use crate::identification::dataset::stride_for;
use crate::identification::residuals::{difference, rms};
use crate::kinematics::JointState;
use crate::machine::{Mechanism, PerAxis, each, every_axis};
use crate::recording::Channel;

/// Column of each axis and the conversion of its angle: q = sign · column + zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arrangement {
    /// Column of each axis' angle.
    pub angle: PerAxis<usize>,
    /// Column of each axis' torque.
    pub torque: PerAxis<usize>,
    /// +1, or −1 for an angle with the opposite sense.
    pub sign: PerAxis<f64>,
    /// Zero of each angle, rad.
    pub zero: PerAxis<f64>,
}

/// Spacing of the zeros on the grid, rad.
const ZERO_STEP: f64 = FRAC_PI_2 / 6.0;
/// Share of poses that must be reachable.
const POSSIBLE: f64 = 0.98;
/// Lower bound of the unexplained share, below which noise would decide.
const FLOOR: f64 = 1e-3;
/// Stride of the instants by which arrangements are selected.
const THINNED: usize = 4;
/// Number of instants at which feasibility of the poses is tested.
const POSE_INSTANTS: usize = 20;
/// Distance from a quarter turn within which a zero is set to it: effects missing in the model shift the best zero by
/// up to 7°, and the remainder is diagnosed as a joint zero offset.
const NEAR_QUARTER: f64 = 0.5 * ZERO_STEP;
/// Cost of a torque of the wrong sign, or of the wrong size by a factor e.
const WRONG: f64 = 0.3;
/// Cost of each deviation from the file's own arrangement.
const CHANGE: f64 = 0.02;

impl Arrangement {
    /// The file's own arrangement.
    pub const PLAIN: Self = Self { angle: [0, 1, 2, 3], torque: [0, 1, 2, 3], sign: each(1.0), zero: each(0.0) };

    /// Motion of the axes, from the motion in the columns.
    pub fn joints(&self, j: &JointState) -> JointState {
        let of = |v: &PerAxis<f64>, i: usize| self.sign[i] * v[self.angle[i]];
        JointState {
            q: std::array::from_fn(|i| of(&j.q, i) + self.zero[i]),
            qd: std::array::from_fn(|i| of(&j.qd, i)),
            qdd: std::array::from_fn(|i| of(&j.qdd, i)),
        }
    }

    /// All arrangements tried on a machine.
    pub fn candidates(machine: Mechanism) -> Vec<Self> {
        let (axes, arms) = (machine.axes(), machine.arms());
        let mut all = Vec::new();
        for order in orders(axes) {
            all.push(Self { angle: order, torque: order, ..Self::PLAIN });
            all.push(Self { torque: order, ..Self::PLAIN });
            all.push(Self { angle: order, ..Self::PLAIN });
        }
        for flipped in 1..1usize << arms {
            let sign = std::array::from_fn(|i| if i < arms && flipped >> i & 1 == 1 { -1.0 } else { 1.0 });
            all.push(Self { sign, ..Self::PLAIN });
        }
        for (sign, step) in [1.0, -1.0].into_iter().flat_map(|s| (-12..12).map(move |k| (s, k))) {
            let zero = f64::from(step) * ZERO_STEP;
            let of = |on: &dyn Fn(usize) -> bool| Self {
                sign: std::array::from_fn(|i| if on(i) { sign } else { 1.0 }),
                zero: std::array::from_fn(|i| if on(i) { zero } else { 0.0 }),
                ..Self::PLAIN
            };
            if step == 0 {
                continue;
            }
            all.push(of(&|i| i < arms));
            all.extend((0..arms).filter(|_| step % 6 == 0).map(|arm| of(&|i| i == arm)));
        }
        all.retain(|a| *a != Self::PLAIN);
        all
    }

    /// Whether it only gives arms other names or zeros: column and angle in the same order, of unchanged sense.
    pub fn keeps_senses(&self, arms: usize) -> bool {
        self.angle == self.torque
            && (arms..every_axis().end).all(|i| self.angle[i] == i)
            && self.sign == Self::PLAIN.sign
    }

    /// Number of deviations from the file's own arrangement.
    fn changes(&self) -> usize {
        let count = |differs: &dyn Fn(usize) -> bool| every_axis().filter(|&i| differs(i)).count();
        count(&|i| self.angle[i] != i)
            + count(&|i| self.torque[i] != i)
            + count(&|i| self.sign[i] < 0.0)
            + count(&|i| self.zero[i] != 0.0)
    }
}

/// Orders of `axes` axes except the natural one.
fn orders(axes: usize) -> Vec<PerAxis<usize>> {
    let mut all = vec![Vec::new()];
    for _ in 0..axes {
        let longer = |order: Vec<usize>| {
            let rest: Vec<usize> = (0..axes).filter(|i| !order.contains(i)).collect();
            rest.into_iter().map(move |i| order.iter().copied().chain([i]).collect::<Vec<usize>>())
        };
        all = all.into_iter().flat_map(longer).collect();
    }
    let whole = |order: Vec<usize>| std::array::from_fn(|i| order.get(i).copied().unwrap_or(i));
    all.into_iter().map(whole).filter(|order: &PerAxis<usize>| *order != Arrangement::PLAIN.torque).collect()
}

/// Agreement of the recording with an arrangement.
pub struct Judgement {
    /// The arrangement.
    pub arrangement: Arrangement,
    /// Line of each channel's measured values over the predicted ones; `None` where either does not vary.
    pub lines: Vec<Option<Line>>,
    /// Sum over the channels of ln(unexplained share) plus penalties; smaller is better.
    pub cost: f64,
}

/// Number of loads tried, and the largest one relative to what the machine itself weighs on its drives.
const LOADS: (usize, f64) = (16, 4.0);

/// A machine of which arrangements are tried, perhaps with a load at its flange that nobody stated.
pub struct Trial<'a> {
    plant: &'a Plant,
    /// The machine with a kilogram more, if loads are tried.
    heavier: Option<Plant>,
    /// The machine with shifted payloads, if only the part of the torques beyond a constant, the friction of each axis and
    /// such a shift counts.
    shifted: Option<[Plant; 2]>,
}

impl<'a> Trial<'a> {
    /// The machine as its setup states it.
    pub fn new(plant: &'a Plant) -> Self {
        Self { plant, heavier: None, shifted: None }
    }

    /// The machine with any offset and friction of the axes, and any centre of mass of its payload, which a fit determines.
    pub fn beyond_friction(plant: &'a Plant) -> Self {
        Self { shifted: Some(shifted(plant)), ..Self::new(plant) }
    }

    /// The machine with any load, wherever its centre of mass.
    pub fn loaded(plant: &'a Plant) -> Self {
        Self { heavier: Some(heavier(plant)), ..Self::beyond_friction(plant) }
    }

    /// Assessment of an arrangement with the load that suits it best; `None` if the machine cannot reach the poses.
    pub fn judge(&self, instants: &Instants, arrangement: Arrangement) -> Option<Judgement> {
        Some(self.posed(instants, arrangement)?.judge(instants, arrangement))
    }

    /// Predictions for the motion of an arrangement; `None` if the machine cannot reach the poses.
    fn posed(&self, instants: &Instants, arrangement: Arrangement) -> Option<Posed> {
        let dataset = instants.dataset;
        let joints = instants.joints(|j| arrangement.joints(j));
        let t = dataset.t.first().copied().unwrap_or(0.0);
        let predicted = Predicted::new(self.plant, &dataset.channels, t, &joints);
        if predicted.share() < POSSIBLE {
            return None;
        }
        let freed = self.freed(dataset, &joints, &predicted);
        let heavy = self.heavier.as_ref().map(|heavier| Predicted::new(heavier, &dataset.channels, t, &joints));
        let heavy = heavy.filter(|heavy| heavy.possible == predicted.possible);
        let load = heavy.map(|heavy| {
            let kilogram: Vec<Vec<f64>> =
                heavy.series.iter().zip(&predicted.series).map(|(h, p)| difference(h, p)).collect();
            let arms = self.plant.mechanism.arms();
            let size = |series: &[Vec<f64>]| series.iter().take(arms).map(|s| rms(s)).sum::<f64>();
            let most = LOADS.1 * size(&predicted.series) / size(&kilogram).max(f64::MIN_POSITIVE);
            (left(&kilogram, &freed), most)
        });
        Some(Posed { unloaded: left(&predicted.series, &freed), load, freed, predicted })
    }

    /// What a fit determines of each channel in any arrangement: friction of its axis and torques of a shifted payload;
    /// nothing if all of the torques counts.
    fn freed(&self, dataset: &Dataset, joints: &[JointState], predicted: &Predicted) -> Vec<Vec<Vec<f64>>> {
        let Some(shifted) = &self.shifted else { return Vec::new() };
        let t = dataset.t.first().copied().unwrap_or(0.0);
        let shifted = shifted.each_ref().map(|plant| Predicted::new(plant, &dataset.channels, t, joints));
        let alike = || shifted.iter().filter(|s| s.possible == predicted.possible);
        let moved = |c: usize| alike().map(move |s| difference(&s.series[c], &predicted.series[c]));
        let rubs = |i: usize| friction(joints, i).map(|f| predicted.of(f));
        let of = |(c, channel): (usize, &Channel)| moved(c).chain(channel.drive().into_iter().flat_map(rubs)).collect();
        dataset.channels.iter().enumerate().map(of).collect()
    }

    /// The arrangement of least cost.
    pub fn best(&self, instants: &Instants) -> Option<Judgement> {
        let some = instants.thinned(THINNED);
        let few = some.thinned(stride_for(some.at.len(), POSE_INSTANTS));
        let reached = Trial::new(self.plant);
        // Arrangements that differ in the torques alone share their motion.
        let mut known: Vec<(Arrangement, Option<Posed>)> = Vec::new();
        let mut judged = Vec::new();
        for arrangement in Arrangement::candidates(self.plant.mechanism) {
            let motion = Arrangement { torque: Arrangement::PLAIN.torque, ..arrangement };
            if known.iter().all(|(other, _)| *other != motion) {
                let is_reached = reached.posed(&few, motion).is_some();
                known.push((motion, is_reached.then(|| self.posed(&some, motion)).flatten()));
            }
            let posed = known.iter().find(|(other, _)| *other == motion).and_then(|(_, posed)| posed.as_ref());
            judged.extend(posed.map(|posed| posed.judge(&some, arrangement)));
        }
        let (shifted, plain): (Vec<_>, Vec<_>) =
            judged.into_iter().partition(|j| j.arrangement.zero.iter().any(|z| *z != 0.0));
        let (mirrored, shifted): (Vec<_>, Vec<_>) =
            shifted.into_iter().partition(|j| j.arrangement.sign.iter().any(|sign| *sign < 0.0));
        let least = |judged: Vec<Judgement>| judged.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost));
        // Between two zeros of the grid another arrangement may explain more, so zeros are refined before they are compared.
        let exact = |judged: Vec<Judgement>| least(judged).map(|j| self.refined(&some, j));
        let best = least([exact(shifted), exact(mirrored), least(plain)].into_iter().flatten().collect())?;
        self.judge(instants, best.arrangement)
    }

    /// The arrangement with its zeros refined locally; those near a quarter turn are set to it, except on a lone axis,
    /// whose incremental encoder may count from anywhere.
    fn refined(&self, instants: &Instants, best: Judgement) -> Judgement {
        let found = best.arrangement;
        let moved = |by: f64| {
            let mut a = found;
            a.zero = a.zero.map(|z| if z == 0.0 { z } else { z + by });
            a
        };
        if moved(1.0) == found {
            return best;
        }
        let cost = |by: f64| self.judge(instants, moved(by)).map_or(f64::INFINITY, |j| j.cost);
        let (mut low, mut high) = (-0.5 * ZERO_STEP, 0.5 * ZERO_STEP);
        while high - low > 1e-3 {
            let (a, b) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
            if cost(a) < cost(b) { high = b } else { low = a }
        }
        let mut found = moved(0.5 * (low + high));
        let quarter = |z: f64| (z / FRAC_PI_2).round() * FRAC_PI_2;
        let is_built = matches!(self.plant.mechanism, Mechanism::Delta { .. });
        let near = |z: f64| is_built && (z - quarter(z)).abs() < NEAR_QUARTER && quarter(z) != 0.0;
        found.zero = found.zero.map(|z| if near(z) { quarter(z) } else { (1e4 * z).round() / 1e4 });
        match self.judge(instants, found) {
            Some(judged) if judged.cost < best.cost + CHANGE => judged,
            _ => best,
        }
    }
}

/// Predictions for one motion of the axes, whatever the columns of the torques.
struct Posed {
    predicted: Predicted,
    /// See [`Trial::freed`].
    freed: Vec<Vec<Vec<f64>>>,
    /// Part of each predicted channel that a fit does not determine.
    unloaded: Vec<Option<Vec<f64>>>,
    /// The same of a kilogram of load, and the largest load tried, kg, if loads are tried.
    load: Option<(Vec<Option<Vec<f64>>>, f64)>,
}

impl Posed {
    /// Assessment of an arrangement with this motion, with the load that suits it best.
    fn judge(&self, instants: &Instants, arrangement: Arrangement) -> Judgement {
        let channels = &instants.dataset.channels;
        let column = |c: usize| channels[c].drive().map_or(c, |i| arrangement.torque[i]);
        let measured: Vec<Vec<f64>> =
            (0..channels.len()).map(|c| self.predicted.of(instants.measured(column(c), 0))).collect();
        let measured = left(&measured, &self.freed);
        let judged = |series: &[Option<Vec<f64>>]| {
            let line = |(p, m): (&Option<Vec<f64>>, &Option<Vec<f64>>)| Line::of(p.as_ref()?, m.as_ref()?);
            let lines: Vec<Option<Line>> = series.iter().zip(&measured).map(line).collect();
            let cost = lines.iter().flatten().map(cost).sum::<f64>() + CHANGE * arrangement.changes() as f64;
            Judgement { arrangement, lines, cost }
        };
        let own = judged(&self.unloaded);
        let Some((kilogram, most)) = &self.load else { return own };
        let with = |load: f64| {
            let sum = |p: &Vec<f64>, k: &Vec<f64>| p.iter().zip(k).map(|(p, k)| p + load * k).collect();
            let one =
                |(p, k): (&Option<Vec<f64>>, &Option<Vec<f64>>)| p.as_ref().zip(k.as_ref()).map(|(p, k)| sum(p, k));
            judged(&self.unloaded.iter().zip(kilogram).map(one).collect::<Vec<Option<Vec<f64>>>>())
        };
        // Squares of equally spaced numbers: small loads are distinguished more finely.
        let load = |k: f64| most * (k / LOADS.0 as f64).powi(2);
        let coarse = (1..=LOADS.0).map(|k| (k as f64, with(load(k as f64)).cost));
        let coarse = coarse.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(1.0, |(k, _)| k);
        let (mut low, mut high) = (load(coarse - 1.0), load(coarse + 1.0));
        while high - low > 1e-3 * high {
            let (a, b) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
            if with(a).cost < with(b).cost { high = b } else { low = a }
        }
        let loaded = with(0.5 * (low + high));
        if loaded.cost < own.cost { loaded } else { own }
    }
}

/// Part of each channel that a fit does not determine; `None` with too few samples. It is linear in the torques, so that it need
/// not be computed for every load.
fn left(series: &[Vec<f64>], freed: &[Vec<Vec<f64>>]) -> Vec<Option<Vec<f64>>> {
    let one = |(c, series): (usize, &Vec<f64>)| match freed.get(c) {
        Some(features) => beyond(series, features),
        None => Some(series.clone()),
    };
    series.iter().enumerate().map(one).collect()
}

/// Cost of a channel.
fn cost(line: &Line) -> f64 {
    let wrong = WRONG * (f64::from(line.slope < 0.0) + line.slope.abs().max(1e-9).ln().powi(2));
    (line.unexplained + FLOOR).ln() + wrong
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_order_is_tried_once() {
        assert_eq!(orders(4).len(), 23);
        assert_eq!(orders(1).len(), 0);
        let all = Arrangement::candidates(Mechanism::default());
        assert!(!all.contains(&Arrangement::PLAIN));
        for (i, a) in all.iter().enumerate() {
            assert!(!all[..i].contains(a), "{a:?}");
        }
    }
}
