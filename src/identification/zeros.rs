//! Zeros of several recordings of a lone axis: an incremental encoder counts from where the axis stood.
//!
//! Where the torque depends on the position, as weight, cogging and uneven gears do, a recording tells its zero:
//!
//! τ_r = X_r·β_r + Σ_j a_j·sin(n_j·(q_r + z_r)) + b_j·cos(n_j·(q_r + z_r)),
//!
//! X_r inertia, friction and a constant with coefficients of each recording, the amplitudes common to all, z_r the zero
//! looked for, rad or m. β is eliminated by projection. A zero only turns the waves of a recording among themselves, so
//! the squares that any zero leaves follow from one Gram matrix per recording.
//!
//! Friction of a gear grows with what it carries: beside a weight there are waves times the direction of motion,
//! |a·sin q + b·cos q|·sgn q̇ in its first two orders. Without them the weight's zero is that of the mean of driving and
//! being driven, some hundredths of a radian beside, and the joint zero a tooth of the ripple away.

use nalgebra::{DMatrix, DVector};

use super::Dataset;
use super::dataset::stride_for;
use super::lines::{MOST_ORDERS, OverAngle};
use crate::effects::smooth_sign;
use crate::evidence::noise::correlation_time;
use crate::machine::{Joint, Mechanism, Unit};
use crate::text::significant;

/// Largest number of samples of one recording.
const SAMPLES: usize = 20_000;
/// Steepness of friction's change of sign, relative to the reciprocal of the RMS speed.
const STEEPNESS: [f64; 2] = [5.0, 50.0];
/// The same of the friction that a weight causes.
const DIRECTION: f64 = 20.0;
/// Number of zeros tried within the shortest period, and largest number of all.
const TRIED: (f64, usize) = (8.0, 100_000);
/// Twice the logarithm of the likelihood ratio from which a zero is another one; over 10⁵ zeros noise reaches 23.
const CLEAR: f64 = 30.0;
/// Ratio of the squares left with the zero to those left without it, fitted to and predicted, from which it matters.
const MATTERS: f64 = 0.95;
/// Twice the logarithm of the likelihood ratio below which two zeros cannot be told apart.
const ALIKE: f64 = 9.0;
/// The same below which they are equal, as those that differ by a period of all orders are.
const EQUAL: f64 = 0.1;
/// Ridge of the normal equations, relative to their diagonal.
const RIDGE: f64 = 1e-9;

/// The zero of a recording beside that of the first.
#[derive(Clone, Debug, PartialEq)]
pub struct Zero {
    /// Index of the recording.
    pub recording: usize,
    /// What is added to its positions, rad or m.
    pub offset: f64,
    /// Standard error, rad or m.
    pub std: f64,
    /// Orders of the joint's turn that tell it, periods per 2π rad or per 2π m.
    pub orders: Vec<f64>,
    /// Number of further zeros that the data do not tell from it.
    pub others: usize,
}

/// Number of orders that are named.
const NAMED: usize = 4;

/// A sine and a cosine over the position.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Wave {
    /// Periods per 2π rad or 2π m.
    order: f64,
    /// Whether it changes its sign with the direction of motion.
    reverses: bool,
}

/// Waves of a weight, and of the friction that it causes in the gear.
const WEIGHT: [Wave; 3] =
    [Wave { order: 1.0, reverses: false }, Wave { order: 1.0, reverses: true }, Wave { order: 2.0, reverses: true }];

impl Zero {
    /// What was done to a recording, by the names of it and of the first, positions in `unit`.
    pub fn sentence(&self, [recording, first]: [&str; 2], unit: Unit) -> String {
        let digits = (1.0 - self.std.max(1e-12).log10().floor()).clamp(0.0, 9.0) as usize;
        let orders: Vec<String> = self.orders.iter().take(NAMED).map(|n| significant(*n, 4)).collect();
        let others = match self.others {
            0 => String::new(),
            n => format!("; {n} other zeros would do as well"),
        };
        format!(
            "{recording}: {:+.digits$} ± {} {unit} added to its positions, which count from elsewhere than in {first} \
             (seen at order {} of the joint{others})",
            self.offset,
            significant(self.std, 2),
            orders.join(", ")
        )
    }
}

/// Zeros of the recordings of a machine that differ from that of the first; none on a delta robot, whose encoders are
/// absolute.
pub fn zeros(mechanism: Mechanism, datasets: &[Dataset]) -> Vec<Zero> {
    if !matches!(mechanism, Mechanism::Axis(_)) || datasets.len() < 2 || datasets.iter().any(Dataset::is_empty) {
        return Vec::new();
    }
    let revolute = mechanism.joint() == Joint::Revolute;
    let all: Vec<Thinned> = datasets.iter().map(Thinned::new).collect();
    let waves = waves(&all, revolute);
    if waves.is_empty() {
        return Vec::new();
    }
    let mut joined = all[0].waves(&waves).whole();
    let mut found = Vec::new();
    for (recording, series) in all.iter().enumerate().skip(1) {
        let search = Search { waves: &waves, reference: &joined, own: series.waves(&waves), revolute, series };
        let zero = search.zero();
        let turned = search.own.whole().turned(&waves, zero.as_ref().map_or(0.0, |z| z.offset));
        found.extend(zero.map(|zero| Zero { recording, ..zero }));
        joined = joined.plus(&turned);
    }
    found
}

/// Waves over the joint's turn in any of the recordings: weight on a turning axis, and the lines of what inertia, friction
/// and weight leave.
fn waves(all: &[Thinned], revolute: bool) -> Vec<Wave> {
    let weight = if revolute && all.iter().any(Thinned::shows_weight) { WEIGHT.to_vec() } else { Vec::new() };
    let mut lines: Vec<(f64, f64)> = Vec::new();
    for series in all {
        let Some(residual) = series.waves(&weight).residual(&weight) else { continue };
        let over = OverAngle::new(series.position.clone(), residual, series.speed, series.dt);
        for (order, share) in over.orders(revolute) {
            match lines.iter_mut().find(|(known, _)| (known - order).abs() < over.width()) {
                Some(known) if known.1 < share => *known = (order, share),
                Some(_) => {}
                None => lines.push((order, share)),
            }
        }
    }
    lines.sort_by(|a, b| b.1.total_cmp(&a.1));
    lines.truncate(MOST_ORDERS);
    weight.into_iter().chain(lines.into_iter().map(|(order, _)| Wave { order, reverses: false })).collect()
}

/// Samples of a recording with inertia, friction and a constant taken out.
struct Thinned {
    position: Vec<f64>,
    /// Smoothed sign of the rate.
    direction: Vec<f64>,
    torque: DVector<f64>,
    /// Orthonormal columns of inertia, friction and constant.
    own: DMatrix<f64>,
    /// RMS speed, rad/s or m/s.
    speed: f64,
    /// Time between samples, s.
    dt: f64,
}

impl Thinned {
    fn new(dataset: &Dataset) -> Self {
        let stride = stride_for(dataset.len(), SAMPLES);
        let joints: Vec<_> = dataset.joints.iter().step_by(stride).collect();
        let n = joints.len();
        let speed = (joints.iter().map(|j| j.qd[0].powi(2)).sum::<f64>() / n as f64).sqrt();
        let sign = |steepness: f64, k: usize| smooth_sign(joints[k].qd[0], steepness / speed.max(f64::MIN_POSITIVE));
        let column = |c: usize, k: usize| match c {
            0 => 1.0,
            1 => joints[k].qdd[0],
            2 => joints[k].qd[0],
            _ => sign(STEEPNESS[c - 3], k),
        };
        let own = orthonormal(DMatrix::from_fn(n, 3 + STEEPNESS.len(), |k, c| column(c, k)));
        let mut torque = DVector::from_iterator(n, dataset.borne(0).iter().step_by(stride).copied());
        torque -= &own * own.tr_mul(&torque);
        let position = joints.iter().map(|j| j.q[0]).collect();
        let direction = (0..n).map(|k| sign(DIRECTION, k)).collect();
        Self { position, direction, torque, own, speed, dt: stride as f64 * dataset.dt }
    }

    /// Whether the torque depends on the angle as a weight does.
    fn shows_weight(&self) -> bool {
        let weight = &WEIGHT[..1];
        let Some(left) = self.waves(weight).residual(weight) else { return false };
        let squares = left.iter().map(|x| x * x).sum::<f64>();
        let independent = left.len() as f64 / correlation_time(&[left]);
        independent * (self.torque.norm_squared() / squares).ln() > CLEAR
    }

    /// The given waves, with inertia, friction and constant taken out.
    fn waves(&self, waves: &[Wave]) -> Waves<'_> {
        let mut columns = DMatrix::from_fn(self.position.len(), 2 * waves.len(), |k, c| {
            let Wave { order, reverses } = waves[c / 2];
            let (sin, cos) = (order * self.position[k]).sin_cos();
            (if c % 2 == 0 { sin } else { cos }) * if reverses { self.direction[k] } else { 1.0 }
        });
        columns -= &self.own * self.own.tr_mul(&columns);
        Waves { series: self, columns }
    }
}

/// Orthonormal columns with the span of `columns`; dependent ones are left out.
fn orthonormal(mut columns: DMatrix<f64>) -> DMatrix<f64> {
    let mut kept: Vec<DVector<f64>> = Vec::new();
    for mut column in columns.column_iter_mut() {
        let before = column.norm();
        for other in kept.iter().chain(&kept) {
            column.axpy(-other.dot(&column), other, 1.0);
        }
        let left = column.norm();
        if left > 1e-6 * before {
            kept.push(column.clone_owned() / left);
        }
    }
    if kept.is_empty() { DMatrix::zeros(columns.nrows(), 0) } else { DMatrix::from_columns(&kept) }
}

/// Waves of a recording.
struct Waves<'a> {
    series: &'a Thinned,
    columns: DMatrix<f64>,
}

impl Waves<'_> {
    fn whole(&self) -> Gram {
        self.part(0, self.columns.nrows())
    }

    /// First and second half of the recording.
    fn halves(&self) -> [Gram; 2] {
        let (n, half) = (self.columns.nrows(), self.columns.nrows() / 2);
        [self.part(0, half), self.part(half, n - half)]
    }

    fn part(&self, first: usize, count: usize) -> Gram {
        let (columns, torque) = (self.columns.rows(first, count), self.series.torque.rows(first, count));
        Gram { normal: columns.tr_mul(&columns), right: columns.tr_mul(&torque), squares: torque.norm_squared(), count }
    }

    /// What the waves of the recording alone leave.
    fn residual(&self, waves: &[Wave]) -> Option<Vec<f64>> {
        if waves.is_empty() {
            return Some(self.series.torque.iter().copied().collect());
        }
        Some(self.beyond(&self.whole().amplitudes()?, waves, 0.0))
    }

    /// What waves of given amplitudes leave, with the zero `by`.
    fn beyond(&self, amplitudes: &DVector<f64>, waves: &[Wave], by: f64) -> Vec<f64> {
        let left = &self.series.torque - &self.columns * (turn(waves, by) * amplitudes);
        left.iter().copied().collect()
    }
}

/// Normal equations of the waves of one or several recordings.
#[derive(Clone)]
struct Gram {
    normal: DMatrix<f64>,
    right: DVector<f64>,
    squares: f64,
    count: usize,
}

impl Gram {
    /// The same with positions that are larger by `by`.
    fn turned(&self, waves: &[Wave], by: f64) -> Self {
        let turn = turn(waves, by);
        Self {
            normal: turn.tr_mul(&(&self.normal * &turn)),
            right: turn.tr_mul(&self.right),
            squares: self.squares,
            count: self.count,
        }
    }

    fn plus(&self, other: &Self) -> Self {
        Self {
            normal: &self.normal + &other.normal,
            right: &self.right + &other.right,
            squares: self.squares + other.squares,
            count: self.count + other.count,
        }
    }

    fn amplitudes(&self) -> Option<DVector<f64>> {
        let mut normal = self.normal.clone();
        for k in 0..normal.nrows() {
            normal[(k, k)] *= 1.0 + RIDGE;
        }
        Some(normal.cholesky()?.solve(&self.right))
    }

    /// Squares that waves of given amplitudes leave.
    fn left(&self, amplitudes: &DVector<f64>) -> f64 {
        self.squares - 2.0 * self.right.dot(amplitudes) + amplitudes.dot(&(&self.normal * amplitudes))
    }

    /// Least squares that waves leave.
    fn least(&self) -> f64 {
        self.amplitudes().map_or(self.squares, |a| self.left(&a))
    }
}

/// Waves over positions larger by `by` as combinations of those without.
fn turn(waves: &[Wave], by: f64) -> DMatrix<f64> {
    let mut turn = DMatrix::zeros(2 * waves.len(), 2 * waves.len());
    for (k, wave) in waves.iter().enumerate() {
        let (s, c) = (wave.order * by).sin_cos();
        turn.fixed_view_mut::<2, 2>(2 * k, 2 * k).copy_from_slice(&[c, s, -s, c]);
    }
    turn
}

/// Search of one recording's zero.
struct Search<'a> {
    waves: &'a [Wave],
    /// The recordings joined so far.
    reference: &'a Gram,
    own: Waves<'a>,
    revolute: bool,
    series: &'a Thinned,
}

impl Search<'_> {
    fn zero(&self) -> Option<Zero> {
        let whole = self.own.whole();
        let left = |by: f64| self.left(&whole, by);
        let (same, best) = (left(0.0), self.least(&whole)?);
        let at = left(best);
        let count = (self.reference.count + whole.count) as f64;
        let both = self.reference.plus(&whole.turned(self.waves, best));
        let memory = correlation_time(&[self.own.beyond(&both.amplitudes()?, self.waves, best)]);
        let independent = count / memory;
        let gained = independent * (same / at).ln();
        if !(gained > CLEAR && at < MATTERS * same && self.predicts()) {
            return None;
        }
        let alike = self.alike(&whole, at * (ALIKE / independent).exp());
        let equal = alike.iter().filter(|(_, left)| *left <= at * (EQUAL / independent).exp()).map(|(by, _)| *by);
        let nearest = equal.min_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(best);
        let step = 0.05 / self.waves.iter().map(|wave| wave.order).fold(0.0, f64::max);
        let curvature = (left(nearest + step) - 2.0 * left(nearest) + left(nearest - step)) / step.powi(2);
        let own = 2.0 * at / independent / curvature.max(f64::MIN_POSITIVE);
        // Zeros a tooth of a weak line apart are told apart by their likelihood only.
        let weights = alike.iter().map(|(by, left)| (by - nearest, independent * (left / at).ln()));
        let apart = weights.filter(|(_, worse)| *worse > EQUAL).map(|(by, worse)| (-0.5 * worse).exp() * by * by);
        let std = (own + apart.sum::<f64>()).sqrt();
        let others = alike.len().saturating_sub(1);
        Some(Zero { recording: 0, offset: nearest, std, orders: self.telling(&both), others })
    }

    /// Least squares left by the waves of `own` with the zero `by` and the recordings joined so far.
    fn left(&self, own: &Gram, by: f64) -> f64 {
        self.reference.plus(&own.turned(self.waves, by)).least()
    }

    /// Whether the zero found on either half of the recording predicts the other half better than none.
    fn predicts(&self) -> bool {
        let [first, second] = self.own.halves();
        let left = |learnt: &Gram, other: &Gram| {
            let by = self.least(learnt)?;
            let of = |by: f64| {
                let amplitudes = self.reference.plus(&learnt.turned(self.waves, by)).amplitudes()?;
                Some(other.turned(self.waves, by).left(&amplitudes))
            };
            Some([of(by)?, of(0.0)?])
        };
        let sums = left(&first, &second).zip(left(&second, &first));
        sums.is_some_and(|([a, b], [c, d])| a + c < MATTERS * (b + d))
    }

    /// Zeros tried: a turn of a turning axis, on a slide the travel and the longest period.
    fn grid(&self) -> Vec<f64> {
        let fold = |of: fn(f64, f64) -> f64, start: f64| self.waves.iter().map(|wave| wave.order).fold(start, of);
        let (fastest, slowest) = (fold(f64::max, 0.0), fold(f64::min, f64::INFINITY));
        let (low, high) =
            self.series.position.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(*x), b.max(*x)));
        let reach = if self.revolute { std::f64::consts::PI } else { (std::f64::consts::PI / slowest).max(high - low) };
        let count = (reach / std::f64::consts::PI * fastest * TRIED.0).ceil().clamp(8.0, TRIED.1 as f64) as i64;
        (-count..count).map(|k| reach * k as f64 / count as f64).collect()
    }

    /// Local minima of the squares left with `own`, refined, each with its squares.
    fn minima(&self, own: &Gram, limit: f64) -> Vec<(f64, f64)> {
        let grid = self.grid();
        let left: Vec<f64> = grid.iter().map(|by| self.left(own, *by)).collect();
        let n = grid.len();
        let step = grid[1] - grid[0];
        let is_low = |k: &usize| left[*k] <= left[(k + n - 1) % n] && left[*k] <= left[(k + 1) % n] && left[*k] < limit;
        let refined = |k: usize| {
            let (mut low, mut high) = (grid[k] - step, grid[k] + step);
            while high - low > 1e-3 * step {
                let (a, b) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
                if self.left(own, a) < self.left(own, b) { high = b } else { low = a }
            }
            let at = 0.5 * (low + high);
            (at, self.left(own, at))
        };
        (0..n).filter(is_low).map(refined).collect()
    }

    /// The zero that leaves the least squares.
    fn least(&self, own: &Gram) -> Option<f64> {
        let grid = self.grid();
        let coarse = grid.iter().map(|by| self.left(own, *by)).fold(f64::INFINITY, f64::min);
        let near = self.minima(own, coarse * (1.0 + MATTERS) + f64::MIN_POSITIVE);
        near.into_iter().min_by(|a, b| a.1.total_cmp(&b.1)).map(|(by, _)| by)
    }

    /// Zeros that leave less than `limit`, each with what it leaves.
    fn alike(&self, own: &Gram, limit: f64) -> Vec<(f64, f64)> {
        let near = self.minima(own, 2.0 * limit);
        near.into_iter().filter(|(_, left)| *left <= limit).collect()
    }

    /// Orders without which clearly more is left, in the order of what they explain.
    fn telling(&self, both: &Gram) -> Vec<f64> {
        let Some(amplitudes) = both.amplitudes() else { return Vec::new() };
        let energy =
            |k: usize| (0..2).map(|c| amplitudes[2 * k + c].powi(2) * both.normal[(2 * k + c, 2 * k + c)]).sum::<f64>();
        let mut all: Vec<usize> = (0..self.waves.len()).filter(|&k| !self.waves[k].reverses).collect();
        all.sort_by(|&a, &b| energy(b).total_cmp(&energy(a)));
        let most = all.first().map_or(0.0, |&k| energy(k));
        all.into_iter().filter(|&k| energy(k) > (1.0 - MATTERS) * most).map(|k| self.waves[k].order).collect()
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;
    use crate::recording::{Recording, Signals};

    /// A lone axis at 1 kHz for 8 s along three sines, whose encoder reads `zero` too little, with noise of 0.02 N·m and
    /// the torque of position and direction that `law` gives.
    fn bench(seed: u64, zero: f64, joint: Joint, law: impl Fn(f64, f64) -> f64) -> Dataset {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut samples = Vec::new();
        let waves = [(0.9, 1.7), (0.4, 3.1 + 0.1 * seed as f64), (0.1, 7.3)];
        for k in 0..8000 {
            let t = f64::from(k) * 1e-3;
            let sum = |of: &dyn Fn(f64, f64) -> f64| waves.iter().map(|(a, w)| of(*a, *w)).sum::<f64>();
            let q = 0.3 * seed as f64 + sum(&|a, w| a * (w * t).sin());
            let qd = sum(&|a, w| a * w * (w * t).cos());
            let qdd = sum(&|a, w| -a * w * w * (w * t).sin());
            let noise: f64 = StandardNormal.sample(&mut rng);
            let tau = 0.02 * qdd + 0.2 * (50.0 * qd).tanh() + 0.05 * qd + law(q, (50.0 * qd).tanh()) + 0.02 * noise;
            samples.push([t, q - zero, tau]);
        }
        let signals = Signals::of_axis(joint, &samples);
        Dataset::new(&Recording { name: format!("run {seed}"), signals, ..Recording::default() })
    }

    fn found(joint: Joint, zero: f64, law: impl Fn(f64) -> f64) -> Vec<Zero> {
        geared(joint, zero, |q, _| law(q))
    }

    fn geared(joint: Joint, zero: f64, law: impl Fn(f64, f64) -> f64) -> Vec<Zero> {
        let datasets = [bench(1, 0.0, joint, &law), bench(2, zero, joint, &law)];
        zeros(Mechanism::axis(joint), &datasets)
    }

    #[test]
    fn weight_tells_the_zero() {
        let found = found(Joint::Revolute, 2.0, |q| 0.8 * q.sin() + 0.3 * q.cos());
        let [zero] = &found[..] else { panic!("{found:?}") };
        assert_eq!((zero.recording, zero.others), (1, 0));
        assert!((zero.offset - 2.0).abs() < 4.0 * zero.std, "{zero:?}");
        // 4000 samples of noise 0.02 against a slope of 0.6 N·m/rad: about 0.02/(0.6·√4000) = 5e-4 rad.
        assert!((1e-4..3e-3).contains(&zero.std), "{zero:?}");
    }

    #[test]
    fn cogging_tells_it_up_to_its_period() {
        // Orders 72 and 18 repeat after 20°: 0.5 rad is 0.5 − 0.349 = 0.151 rad.
        let found = found(Joint::Revolute, 0.5, |q| 0.05 * (72.0 * q).sin() + 0.03 * (18.0 * q).cos());
        let [zero] = &found[..] else { panic!("{found:?}") };
        let nearest = 0.5 - std::f64::consts::TAU / 18.0;
        assert!((zero.offset - nearest).abs() < 4.0 * zero.std && zero.std < 1e-3, "{zero:?}");
        assert_eq!(zero.others, 17, "{zero:?}");
    }

    #[test]
    fn friction_of_the_weight_does_not_move_it_by_a_tooth() {
        // A gear with an efficiency of 80 %, whose 200 teeth are 0.031 rad apart.
        let law = |q: f64, sign: f64| {
            let weight = 0.8 * (q + 0.4).sin();
            weight + 0.2 * weight.abs() * sign + 0.06 * (200.0 * q).sin()
        };
        for zero in [0.7, 1.3] {
            let found = geared(Joint::Revolute, zero, law);
            let [found] = &found[..] else { panic!("{found:?}") };
            assert!((found.offset - zero).abs() < 1e-3, "{found:?}, {zero} hidden");
            assert_eq!((&found.orders[..], found.others), (&[1.0][..], 0), "{found:?}");
        }
    }

    #[test]
    fn magnets_of_a_slide_tell_it() {
        // A pole pair of 24 mm.
        let order = std::f64::consts::TAU / 0.024;
        let found = found(Joint::Prismatic, 0.005, |x| 0.05 * (order * x).sin());
        let [zero] = &found[..] else { panic!("{found:?}") };
        assert!((zero.offset - 0.005).abs() < 4.0 * zero.std && zero.std < 1e-4, "{zero:?}");
    }

    #[test]
    fn the_same_zero_stays() {
        for zero in [0.0, 1.0] {
            assert_eq!(found(Joint::Revolute, zero, |_| 0.0), [], "nothing depends on the position");
        }
        assert_eq!(found(Joint::Revolute, 0.0, |q| 0.8 * q.sin()), []);
        assert_eq!(found(Joint::Revolute, 0.0, |q| 0.05 * (72.0 * q).sin()), []);
    }
}
