//! [`Laps`]: stretches of recordings in which the machine repeats one motion.
//!
//! The joint angles alone determine them: a window of the motion is searched in all recordings, its shift in time is
//! refined by least squares to a fraction of a sample, and the angles must then agree over the whole lap. Pauses between
//! laps may differ; laps at another speed are not repeats.

use super::Dataset;
use crate::machine::{PerAxis, every_axis};

/// Step of the search, s, and length of the window that is searched.
const STEP: f64 = 5e-3;
const WINDOW: f64 = 0.25;
/// RMS difference of the angles in the window, relative to the travel, up to which a shift is refined.
const SIMILAR: f64 = 0.05;
/// Largest difference of an angle within a lap, relative to its travel.
const ALIKE: f64 = 0.01;
/// Rate, in travels per second, below which an axis rests.
const REST: f64 = 0.02;
/// Least duration of a lap, s, and least share of the time in motion that laps cover.
const SHORTEST: f64 = 0.2;
const COVERED: f64 = 0.5;
/// Number of instants by which the shift of a lap is determined.
const INSTANTS: f64 = 200.0;
/// Travel in resolutions of the encoder, from which an axis counts.
const MOVED: f64 = 50.0;
/// Least share of a lap that is recorded of each, and of all together.
const WHOLE: f64 = 0.9;
const PRESENT: f64 = 0.5;

/// Repeats of one motion.
#[derive(Clone, Debug)]
pub struct Laps {
    /// Samples of every lap at equal phases: `[lap][phase]` = (recording, sample).
    pub samples: Vec<Vec<(usize, usize)>>,
    /// Time of the start of every lap in its recording, s.
    pub starts: Vec<f64>,
    /// Duration of the motion, s.
    pub duration: f64,
    /// RMS difference of the joint rates between laps relative to their RMS, of the axis with the largest.
    pub mismatch: f64,
}

impl Laps {
    /// Laps in `datasets`; `None` if less than half of the time in motion repeats.
    pub fn find(datasets: &[Dataset]) -> Option<Self> {
        let course = Course::new(datasets)?;
        let best = course.anchors().into_iter().filter_map(|a| course.laps(course.template(a)?)).max_by(|a, b| {
            let covered = |laps: &(Template, Vec<Place>)| laps.0.duration * laps.1.len() as f64;
            // Of equal ones the first.
            covered(a).total_cmp(&(covered(b) * (1.0 + 1e-3)))
        })?;
        course.aligned(best)
    }

    /// Number of laps.
    pub fn count(&self) -> usize {
        self.samples.len()
    }

    /// Number of recordings that they come from.
    pub fn recordings(&self) -> usize {
        let mut all: Vec<usize> = self.samples.iter().filter_map(|lap| Some(lap.first()?.0)).collect();
        all.dedup();
        all.len()
    }

    /// Median time from one lap to the next of the same recording, s; the duration where no recording has two.
    pub fn period(&self) -> f64 {
        let of = |w: &[usize]| {
            (self.samples[w[0]][0].0 == self.samples[w[1]][0].0).then(|| self.starts[w[1]] - self.starts[w[0]])
        };
        let mut all: Vec<f64> = (0..self.count()).collect::<Vec<_>>().windows(2).filter_map(of).collect();
        all.sort_by(f64::total_cmp);
        all.get(all.len() / 2).copied().unwrap_or(self.duration)
    }

    /// Values of a series per recording at equal phases of every lap.
    pub fn rows(&self, series: &[&[f64]]) -> Vec<Vec<f64>> {
        self.samples.iter().map(|lap| lap.iter().map(|&(d, k)| series[d][k]).collect()).collect()
    }
}

/// An instant of a recording: its number and time, s.
#[derive(Clone, Copy, Debug)]
struct Place {
    of: usize,
    t: f64,
}

impl Place {
    fn later(self, by: f64) -> Self {
        Self { t: self.t + by, ..self }
    }
}

/// The motion that is searched.
struct Template {
    start: Place,
    duration: f64,
}

/// Angles and rates in units of the travel; zero for axes at rest.
type State = [PerAxis<f64>; 2];

struct Course<'a> {
    datasets: &'a [Dataset],
    /// 1/travel of every axis in motion, else zero.
    scale: PerAxis<f64>,
    step: f64,
    /// All recordings at equal steps, one after the other.
    grid: Vec<(Place, Option<State>)>,
}

impl<'a> Course<'a> {
    /// The recordings; `None` if no axis moves, or their setups differ.
    fn new(datasets: &'a [Dataset]) -> Option<Self> {
        let first = datasets.first()?;
        let same =
            |t: &Dataset| t.setup.payload == first.setup.payload && t.setup.configuration == first.setup.configuration;
        let scale = std::array::from_fn(|axis| {
            let all = datasets.iter().flat_map(|t| &t.joints).map(|j| j.q[axis]);
            let (low, high) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), q| (a.min(q), b.max(q)));
            let least = datasets.iter().map(|t| MOVED * t.resolution(axis)).fold(1e-6, f64::max);
            if high - low > least { 1.0 / (high - low) } else { 0.0 }
        });
        let slowest = datasets.iter().map(|t| t.dt).fold(0.0, f64::max);
        if scale.iter().all(|s| *s == 0.0) || slowest <= 0.0 || !datasets.iter().all(same) {
            return None;
        }
        let step = STEP.max(slowest);
        let mut course = Self { datasets, scale, step, grid: Vec::new() };
        for (of, dataset) in datasets.iter().enumerate() {
            let (Some(&start), Some(&end)) = (dataset.t.first(), dataset.t.last()) else { continue };
            for k in 0..=((end - start) / step) as usize {
                let place = Place { of, t: start + k as f64 * step };
                course.grid.push((place, course.at(place)));
            }
        }
        Some(course)
    }

    /// Sample of a recording nearest to a time, not farther than `reach` samples.
    fn nearest(&self, place: Place, reach: f64) -> Option<usize> {
        let dataset = &self.datasets[place.of];
        let after = dataset.t.partition_point(|t| *t < place.t);
        let near = |k: &usize| dataset.t.get(*k).map_or(f64::INFINITY, |t| (t - place.t).abs());
        let k = [after.saturating_sub(1), after].into_iter().min_by(|a, b| near(a).total_cmp(&near(b)))?;
        (near(&k) <= reach * dataset.dt).then_some(k)
    }

    /// Motion at an instant, by the rate of the nearest sample; `None` in a gap.
    fn at(&self, place: Place) -> Option<State> {
        let k = self.nearest(place, 1.0)?;
        let (dataset, joint) = (&self.datasets[place.of], &self.datasets[place.of].joints[k]);
        let off = place.t - dataset.t[k];
        let q = |i: usize| self.scale[i] * (joint.q[i] + off * (joint.qd[i] + 0.5 * off * joint.qdd[i]));
        Some([std::array::from_fn(q), std::array::from_fn(|i| self.scale[i] * joint.qd[i])])
    }

    fn moves(state: &State) -> bool {
        state[1].iter().any(|r| r.abs() > REST)
    }

    /// Starts of templates: the first motions after a rest, and instants spread over the recordings.
    fn anchors(&self) -> Vec<usize> {
        const MOST: usize = 4;
        let moving = |k: usize| self.grid[k].1.as_ref().is_some_and(Self::moves);
        let starts = (0..self.grid.len()).filter(|&k| moving(k) && (k == 0 || !moving(k - 1)));
        let mut all: Vec<usize> = starts.take(MOST).collect();
        all.extend((1..MOST).map(|i| i * self.grid.len() / (2 * MOST)).filter(|&k| moving(k)));
        all
    }

    /// Instants at which the motion resembles that of a window from `start` on, with the refined time of each.
    fn similar(&self, start: Place) -> impl Iterator<Item = Place> {
        let count = (WINDOW / self.step).ceil() as usize;
        let window: Vec<Option<State>> = (0..count).map(|k| self.at(start.later(k as f64 * self.step))).collect();
        let present = window.iter().flatten().count();
        let distance = |first: usize| {
            let (mut sum, mut pairs) = (0.0, 0);
            for (own, (place, other)) in window.iter().zip(&self.grid[first..]) {
                if let (Some(own), Some(other)) = (own, other)
                    && place.of == self.grid[first].0.of
                {
                    sum += every_axis().map(|i| (own[0][i] - other[0][i]).powi(2)).sum::<f64>();
                    pairs += 1;
                    if sum > SIMILAR * SIMILAR * present as f64 {
                        return f64::INFINITY;
                    }
                }
            }
            if pairs > 0 && 2 * pairs >= present { (sum / pairs as f64).sqrt() } else { f64::INFINITY }
        };
        let distances: Vec<f64> = (0..self.grid.len()).map(distance).collect();
        let least = move |k: usize| {
            let near = distances[k.saturating_sub(1)..(k + 2).min(distances.len())].iter().copied();
            distances[k] < SIMILAR && near.fold(f64::INFINITY, f64::min) >= distances[k]
        };
        let found = (0..self.grid.len()).filter(move |&k| least(k)).map(|k| self.grid[k].0);
        found.map(move |place| self.refined(start, place, WINDOW))
    }

    /// The start `place` of a lap shifted to where its angles agree best with those from `start` on, by least squares.
    fn refined(&self, start: Place, mut place: Place, duration: f64) -> Place {
        let step = (duration / INSTANTS).max(self.datasets[start.of].dt);
        for _ in 0..4 {
            let (mut along, mut square) = (0.0, 0.0);
            for k in 0..(duration / step) as usize {
                let by = k as f64 * step;
                let (Some(own), Some(other)) = (self.at(start.later(by)), self.at(place.later(by))) else { continue };
                for i in every_axis() {
                    along += (own[0][i] - other[0][i]) * other[1][i];
                    square += other[1][i].powi(2);
                }
            }
            if square > 0.0 {
                place.t += (along / square).clamp(-2.0 * self.step, 2.0 * self.step);
            }
        }
        place
    }

    /// Largest difference of the angles of two instants; `None` if one of them was not recorded.
    fn difference(&self, a: Place, b: Place) -> Option<f64> {
        let (a, b) = (self.at(a)?, self.at(b)?);
        Some(every_axis().map(|i| (a[0][i] - b[0][i]).abs()).fold(0.0, f64::max))
    }

    /// Time from `a` and `b` on, or back with a negative `step`, over which the motions agree, and whether a recording ends then.
    fn agreement(&self, a: Place, b: Place, step: f64, most: f64) -> (f64, bool) {
        let outside = |p: Place| {
            let t = &self.datasets[p.of].t;
            t.first().is_none_or(|first| p.t < first - step.abs())
                || t.last().is_none_or(|last| p.t > last + step.abs())
        };
        let mut by = 0.0f64;
        while by.abs() < most {
            let (next_a, next_b) = (a.later(by + step), b.later(by + step));
            if outside(next_a) || outside(next_b) {
                return (by, true);
            }
            if self.difference(next_a, next_b).is_some_and(|d| d > ALIKE) {
                return (by, false);
            }
            by += step;
        }
        (by, false)
    }

    /// Motion from a grid point on until it begins again, without a rest at its end.
    fn template(&self, anchor: usize) -> Option<Template> {
        let start = self.grid[anchor].0;
        for other in self.similar(start) {
            let same = other.of == start.of;
            let shift = other.t - start.t;
            if other.of < start.of || (same && shift < SHORTEST) {
                continue;
            }
            let most = if same { shift } else { f64::INFINITY };
            let (after, ends) = self.agreement(start, other, self.step, most);
            let rests = |from: f64| {
                let end = start.later(from);
                let all = (0..((shift - from) / self.step).max(0.0) as usize).map(|k| end.later(k as f64 * self.step));
                all.filter_map(|p| self.difference(end, p)).all(|d| d <= ALIKE)
            };
            // The last lap of a recording may lack its end.
            let whole = match (same, ends) {
                (true, true) => after >= WHOLE * shift,
                (true, false) => after >= shift - 1e-9 || rests(after),
                (false, _) => ends,
            };
            let before = if same { 0.0 } else { self.agreement(start, other, -self.step, f64::INFINITY).0 };
            let (start, mut duration) = (start.later(before), after.min(most) - before);
            while duration > SHORTEST && self.at(start.later(duration)).is_none_or(|s| !Self::moves(&s)) {
                duration -= self.step;
            }
            if whole && duration >= SHORTEST {
                return Some(Template { start, duration });
            }
        }
        None
    }

    /// All laps of a template, itself among them; `None` if they are too few or too little of the motion.
    fn laps(&self, template: Template) -> Option<(Template, Vec<Place>)> {
        let Template { start, duration } = template;
        let dt = self.datasets[start.of].dt;
        let mut laps: Vec<Place> = Vec::new();
        for place in self.similar(start) {
            let place = self.refined(start, place, duration);
            let is_late = |last: &Place| place.of != last.of || place.t >= last.t + duration - 3.0 * dt;
            let (mut pairs, mut all) = (0usize, 0usize);
            let steps = (0..=(duration / self.step) as usize).map(|k| k as f64 * self.step);
            let agrees = steps.filter(|by| self.at(start.later(*by)).is_some()).all(|by| {
                let d = self.difference(start.later(by), place.later(by));
                all += 1;
                pairs += usize::from(d.is_some());
                d.is_none_or(|d| d <= ALIKE)
            });
            let is_whole = pairs as f64 >= WHOLE * all as f64;
            let like = (self.datasets[place.of].dt / dt - 1.0).abs() < 0.01;
            if agrees && is_whole && like && laps.last().is_none_or(is_late) {
                laps.push(place);
            }
        }
        let moving = self.grid.iter().filter(|(_, s)| s.as_ref().is_some_and(Self::moves)).count() as f64 * self.step;
        (laps.len() > 1 && laps.len() as f64 * duration > COVERED * moving).then_some((template, laps))
    }

    /// The laps with the samples of each at equal phases.
    fn aligned(&self, (template, places): (Template, Vec<Place>)) -> Option<Laps> {
        let Template { start, duration } = template;
        let own = &self.datasets[start.of];
        let first = own.t.partition_point(|t| *t < start.t - 1e-9);
        let phases: Vec<f64> = own.t[first..].iter().map(|t| t - start.t).take_while(|by| *by < duration).collect();
        // A sample in the middle of two has two neighbours: half a sample and the error of the shift.
        let row = |by: &f64| places.iter().map(|p| Some((p.of, self.nearest(p.later(*by), 0.6)?))).collect();
        let rows: Vec<Vec<(usize, usize)>> = phases.iter().filter_map(row).collect();
        if rows.is_empty() || (rows.len() as f64) < PRESENT * phases.len() as f64 {
            return None;
        }
        let samples: Vec<Vec<(usize, usize)>> =
            (0..places.len()).map(|l| rows.iter().map(|r| r[l]).collect()).collect();
        let mismatch = |axis: usize| {
            let rate = |&(of, k): &(usize, usize)| self.datasets[of].joints[k].qd[axis];
            let (mut between, mut all) = (0.0, f64::MIN_POSITIVE);
            for row in &rows {
                let mean = row.iter().map(rate).sum::<f64>() / row.len() as f64;
                between += row.iter().map(|s| (rate(s) - mean).powi(2)).sum::<f64>() / (row.len() - 1) as f64;
                all += row.iter().map(|s| rate(s).powi(2)).sum::<f64>() / row.len() as f64;
            }
            (between / all).sqrt()
        };
        let moved = every_axis().filter(|&i| self.scale[i] > 0.0);
        let mismatch = moved.map(mismatch).fold(0.0, f64::max);
        Some(Laps { samples, starts: places.iter().map(|p| p.t).collect(), duration, mismatch })
    }
}
