//! Sparse regression by matching pursuit: laws are added one at a time while they explain validation data.
//!
//! The model's own parameters are nuisance parameters: they are projected out of the residual and of every law, on
//! the training data and on the validation data (Frisch–Waugh–Lovell).

use std::ops::Range;

use nalgebra::{DMatrix, DVector};

use super::Sight;
use super::library::{Atom, Number};
use crate::effects::formula::{Expression, Variable};
use crate::evidence::{Stop, dot};
use crate::identification::dataset::stride_for;
use crate::numerics::parallel;

/// Number of instants for the screening of the library.
const SCREENED: usize = 2500;
/// Number of laws tried per step, best on the training data first.
const LAWS_PER_STEP: usize = 4;
/// Largest number of laws of one formula.
pub const MAX_LAWS: usize = 6;
/// Number of golden-section steps for an inner number.
const REFINEMENTS: usize = 14;
/// Number of blocks of time for the test of a gain.
const BLOCKS: usize = 40;
/// Student's t of the gain over the blocks that is required of a law.
const SIGNIFICANT: f64 = 3.0;
/// Gain required of a further law, as a share of the gain so far.
const WORTH: f64 = 0.02;
/// Energy per instant, in units of the noise of an instant's channel, that a law must explain: a tenth of the noise
/// of a raw sample.
const RELEVANT: f64 = 0.03;
/// Share of the gain below which a term is removed.
const NEGLIGIBLE: f64 = 0.004;
/// Ratio to the best gain on the training data from which a simpler law is preferred.
const AS_GOOD: f64 = 0.985;
/// Norm relative to its column below which a direction of the base is collinear.
const COLLINEAR: f64 = 1e-5;

/// A term of a formula.
#[derive(Clone, Debug)]
pub struct Found {
    /// Place: index into the sight's places.
    pub place: usize,
    /// Its law.
    pub law: Expression,
    /// Coefficient.
    pub coefficient: f64,
}

/// A formula with its residual on the validation data.
#[derive(Clone, Debug, Default)]
pub struct Formulation {
    /// Terms in the order found.
    pub terms: Vec<Found>,
    /// Energy of the residual per block before the formula, in units of the noise.
    pub before: Vec<f64>,
    /// Energy of the residual per block with the formula, in units of the noise.
    pub after: Vec<f64>,
}

impl Formulation {
    /// Energy that the formula explains, in units of the noise.
    pub fn gain(&self) -> f64 {
        self.before.iter().sum::<f64>() - self.after.iter().sum::<f64>()
    }
}

/// One set of data with the model's parameters projected out.
pub struct Ground<'a> {
    /// What is seen.
    pub sight: &'a Sight,
    /// The instants, ascending.
    pub instants: Vec<usize>,
    /// Orthonormal columns, channel by channel over `instants`.
    basis: Vec<Vec<f64>>,
    /// Residual outside the basis.
    pub residual: Vec<f64>,
    /// Channels affected by a force at each place.
    acting: Vec<Vec<usize>>,
}

/// One law's column: its values on the channels affected by its place.
type Column = Vec<f64>;

impl<'a> Ground<'a> {
    /// Residual of `sight` at the instants outside the columns of its parameters.
    pub fn new(sight: &'a Sight, instants: Vec<usize>) -> Self {
        let channels = sight.residual.len();
        let gather = |all: &[Vec<f64>]| -> Vec<f64> {
            (0..channels).flat_map(|c| instants.iter().map(move |&k| all[c][k])).collect()
        };
        let acting = sight
            .responses
            .iter()
            .map(|response| (0..channels).filter(|&c| response[c].iter().any(|x| x.abs() > 1e-12)).collect())
            .collect();
        let basis = orthonormal(parallel::map(sight.base.len(), |i| gather(&sight.base[i])));
        let mut residual = gather(&sight.residual);
        for q in &basis {
            let share = dot(q, &residual);
            add(&mut residual, -share, q);
        }
        Self { sight, instants, basis, residual, acting }
    }

    fn blocks(&self) -> Vec<Range<usize>> {
        let n = self.instants.len();
        let count = BLOCKS.min(n / 10).max(1);
        (0..count).map(|b| b * n / count..(b + 1) * n / count).collect()
    }

    /// Values of a law at the instants.
    fn values(&self, law: &Expression) -> Vec<f64> {
        let variables = &self.sight.variables;
        self.instants.iter().map(|&k| law.value(|v: Variable| variables[v.index()][k])).collect()
    }

    /// Response to a force with these values at a place, on the channels that it affects.
    fn column(&self, place: usize, values: &[f64]) -> Column {
        let response = &self.sight.responses[place];
        let on = |&c: &usize| self.instants.iter().zip(values).map(move |(&k, v)| v * response[c][k]);
        self.acting[place].iter().flat_map(on).collect()
    }

    /// Inner product of a column with a vector over all channels.
    fn product(&self, place: usize, column: &[f64], whole: &[f64]) -> f64 {
        let n = self.instants.len();
        self.acting[place]
            .iter()
            .zip(column.chunks_exact(n))
            .map(|(&c, part)| dot(part, &whole[c * n..(c + 1) * n]))
            .sum()
    }

    /// A column over all channels, projected outside the basis.
    fn outside(&self, place: usize, column: &[f64]) -> Vec<f64> {
        let n = self.instants.len();
        let mut whole = vec![0.0; self.residual.len()];
        for (&c, part) in self.acting[place].iter().zip(column.chunks_exact(n)) {
            whole[c * n..(c + 1) * n].copy_from_slice(part);
        }
        let shares = parallel::map(self.basis.len(), |i| self.product(place, column, &self.basis[i]));
        for (q, share) in self.basis.iter().zip(shares) {
            add(&mut whole, -share, q);
        }
        whole
    }
}

/// Orthonormalised columns without those collinear to others.
fn orthonormal(columns: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    let mut basis: Vec<Vec<f64>> = Vec::new();
    for mut column in columns {
        let size = dot(&column, &column).sqrt();
        if !size.is_finite() || size <= 0.0 {
            continue;
        }
        let mut left = size;
        for _ in 0..2 {
            let before = left;
            for q in &basis {
                let share = dot(q, &column);
                add(&mut column, -share, q);
            }
            left = dot(&column, &column).sqrt();
            // If little was subtracted, the rounding error is small as well.
            if left > 0.1 * before {
                break;
            }
        }
        if left > COLLINEAR * size {
            column.iter_mut().for_each(|x| *x /= left);
            basis.push(column);
        }
    }
    basis
}

fn add(to: &mut [f64], factor: f64, x: &[f64]) {
    to.iter_mut().zip(x).for_each(|(t, x)| *t += factor * x);
}

/// A group of columns with its Gram matrix during the search.
struct Screened<'a> {
    atom: &'a Atom,
    columns: Vec<Column>,
    /// Gram matrix outside the basis.
    gram: DMatrix<f64>,
}

/// Search over a library with training data and validation data.
pub struct Pursuit<'a> {
    screen: Ground<'a>,
    find: Ground<'a>,
    judge: Ground<'a>,
    screened: Vec<Screened<'a>>,
}

impl<'a> Pursuit<'a> {
    /// Prepares a search: `find` gives a sight and its instants for training, `judge` those for validation.
    pub fn new(atoms: &'a [Atom], find: (&'a Sight, Vec<usize>), judge: (&'a Sight, Vec<usize>)) -> Self {
        let few: Vec<usize> = find.1.iter().copied().step_by(stride_for(find.1.len(), SCREENED)).collect();
        let screen = Ground::new(find.0, few);
        let screened = parallel::map(atoms.len(), |i| screened(&screen, &atoms[i])).into_iter().flatten().collect();
        Self { screen, find: Ground::new(find.0, find.1), judge: Ground::new(judge.0, judge.1), screened }
    }

    /// Best formula of at most `most` laws at the places that `allowed` accepts; no law is added once `stop` returns
    /// true.
    pub fn formula(&self, most: usize, allowed: impl Fn(usize) -> bool + Sync, stop: Stop) -> Formulation {
        let mut state = State::new(self);
        for _ in 0..most {
            if stop() || !state.step(self, &allowed) {
                break;
            }
        }
        state.done(self)
    }
}

fn screened<'a>(ground: &Ground, atom: &'a Atom) -> Option<Screened<'a>> {
    let laws = atom.parsed(atom.number.map(|n| n.value))?;
    let columns: Vec<Column> = laws.iter().map(|law| ground.column(atom.place, &ground.values(law))).collect();
    if columns.iter().flatten().any(|x| !x.is_finite()) {
        return None;
    }
    let m = columns.len();
    let shares =
        DMatrix::from_fn(ground.basis.len(), m, |i, j| ground.product(atom.place, &columns[j], &ground.basis[i]));
    let own = DMatrix::from_fn(m, m, |i, j| dot(&columns[i], &columns[j]));
    let gram = &own - shares.tr_mul(&shares);
    let visible = (0..m).all(|i| gram[(i, i)] > 1e-4 * own[(i, i)] && own[(i, i)] > 0.0);
    visible.then_some(Screened { atom, columns, gram })
}

/// Energy that a group explains of a residual with the inner products `score`.
fn taken(gram: &DMatrix<f64>, score: &DVector<f64>) -> f64 {
    gram.clone().cholesky().map_or(0.0, |root| score.dot(&root.solve(score)))
}

/// The chosen laws on the three sets of data.
struct State {
    chosen: Vec<(usize, Expression)>,
    /// Columns outside the basis, for training and for validation.
    find: Vec<Vec<f64>>,
    judge: Vec<Vec<f64>>,
    /// Orthonormal directions of the chosen columns on the screening data.
    screen: Vec<Vec<f64>>,
    screen_residual: Vec<f64>,
    coefficients: DVector<f64>,
    /// Residuals with the chosen laws.
    find_left: Vec<f64>,
    judge_left: Vec<f64>,
    gains: Vec<f64>,
}

impl State {
    fn new(pursuit: &Pursuit) -> Self {
        Self {
            chosen: Vec::new(),
            find: Vec::new(),
            judge: Vec::new(),
            screen: Vec::new(),
            screen_residual: pursuit.screen.residual.clone(),
            coefficients: DVector::zeros(0),
            find_left: pursuit.find.residual.clone(),
            judge_left: pursuit.judge.residual.clone(),
            gains: Vec::new(),
        }
    }

    /// Adds the best law that the validation data confirm; false if there is none.
    fn step(&mut self, pursuit: &Pursuit, allowed: &(impl Fn(usize) -> bool + Sync)) -> bool {
        let ground = &pursuit.screen;
        let gain = |i: usize| {
            let screened = &pursuit.screened[i];
            allowed(screened.atom.place).then(|| (self.screened_gain(ground, screened), i))
        };
        let mut order: Vec<(f64, usize)> = parallel::map(pursuit.screened.len(), gain).into_iter().flatten().collect();
        order.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut tried: Vec<&Atom> = Vec::new();
        for (_, i) in order.into_iter().take_while(|(gain, _)| *gain > 0.0) {
            let atom = pursuit.screened[i].atom;
            if tried.len() == 2 * LAWS_PER_STEP {
                break;
            }
            if tried.iter().all(|t| t.laws != atom.laws) {
                tried.push(atom);
            }
        }
        let refine = |i: usize| self.candidate(pursuit, tried[i], self.refined(ground, tried[i]));
        let mut refined: Vec<Candidate> = parallel::map(tried.len(), refine).into_iter().flatten().collect();
        refined.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        // Among laws of nearly equal gain, the simplest first.
        if let Some(best) = refined.first().map(|r| r.gain) {
            let near = refined.iter().take_while(|r| r.gain >= AS_GOOD * best).count();
            refined[..near].sort_by_key(|r| (r.freedom, r.length));
        }
        refined.truncate(LAWS_PER_STEP);
        refined.into_iter().any(|candidate| self.accept(pursuit, candidate))
    }

    fn screened_gain(&self, ground: &Ground, s: &Screened) -> f64 {
        let m = s.columns.len();
        let product = |i: usize, whole: &[f64]| ground.product(s.atom.place, &s.columns[i], whole);
        let shares = DMatrix::from_fn(self.screen.len(), m, |i, j| product(j, &self.screen[i]));
        let gram = &s.gram - shares.tr_mul(&shares);
        if (0..m).any(|i| gram[(i, i)] < 1e-3 * s.gram[(i, i)]) {
            return 0.0;
        }
        taken(&gram, &DVector::from_fn(m, |i, _| product(i, &self.screen_residual)))
    }

    /// The inner number of an atom with the largest gain on the screening data, by golden-section search between its
    /// neighbours.
    fn refined(&self, ground: &Ground, atom: &Atom) -> Option<f64> {
        let Number { value, range: (mut low, mut high) } = atom.number?;
        let gain = |number: f64| {
            let columns = atom
                .parsed(Some(number))
                .unwrap_or_default()
                .iter()
                .map(|law| self.outside(ground, atom.place, law))
                .collect::<Vec<_>>();
            let m = columns.len();
            let gram = DMatrix::from_fn(m, m, |i, j| dot(&columns[i], &columns[j]));
            taken(&gram, &DVector::from_fn(m, |i, _| dot(&columns[i], &self.screen_residual)))
        };
        let (mut middle, mut best) = (value, gain(value));
        for _ in 0..REFINEMENTS {
            let left = middle - low > high - middle;
            let x = if left { middle - 0.382 * (middle - low) } else { middle + 0.382 * (high - middle) };
            let next = gain(x);
            match (next > best, left) {
                (true, true) => (high, middle, best) = (middle, x, next),
                (true, false) => (low, middle, best) = (middle, x, next),
                (false, true) => low = x,
                (false, false) => high = x,
            }
        }
        Some(middle)
    }

    /// A law's column on the screening data, outside the basis and the chosen laws.
    fn outside(&self, ground: &Ground, place: usize, law: &Expression) -> Vec<f64> {
        let mut column = ground.outside(place, &ground.column(place, &ground.values(law)));
        for q in &self.screen {
            let share = dot(q, &column);
            add(&mut column, -share, q);
        }
        column
    }

    /// The atom with all coefficients estimated on the training data.
    fn candidate(&self, pursuit: &Pursuit, atom: &Atom, number: Option<f64>) -> Option<Candidate> {
        let ground = &pursuit.find;
        let laws = atom.parsed(number)?;
        let mut columns = Vec::new();
        for law in &laws {
            let column = ground.column(atom.place, &ground.values(law));
            if column.iter().any(|x| !x.is_finite()) {
                return None;
            }
            columns.push(ground.outside(atom.place, &column));
        }
        let mut all: Vec<&Vec<f64>> = self.find.iter().collect();
        all.extend(&columns);
        let (coefficients, left) = least_squares(&all, &ground.residual)?;
        let gain = dot(&self.find_left, &self.find_left) - dot(&left, &left);
        let length = laws.iter().map(|l| l.text().len()).sum();
        Some(Candidate { place: atom.place, laws, columns, coefficients, left, gain, freedom: atom.freedom(), length })
    }

    /// Adds the candidate if the validation data confirm it.
    fn accept(&mut self, pursuit: &Pursuit, candidate: Candidate) -> bool {
        let ground = &pursuit.judge;
        let columns: Vec<Vec<f64>> = candidate
            .laws
            .iter()
            .map(|law| ground.outside(candidate.place, &ground.column(candidate.place, &ground.values(law))))
            .collect();
        let mut left = ground.residual.clone();
        for (column, c) in self.judge.iter().chain(&columns).zip(candidate.coefficients.iter()) {
            add(&mut left, -c, column);
        }
        if left.iter().any(|x| !x.is_finite()) {
            return false;
        }
        let (before, after) = (by_block(ground, &self.judge_left), by_block(ground, &left));
        let (gain, t) = gain(&before, &after);
        let so_far: f64 = self.gains.iter().sum();
        if t < SIGNIFICANT || gain < RELEVANT * ground.instants.len() as f64 || gain < WORTH * so_far {
            return false;
        }
        self.gains.push(gain);
        self.judge_left = left;
        self.judge.extend(columns);
        self.find_left = candidate.left;
        self.find.extend(candidate.columns);
        self.coefficients = candidate.coefficients;
        for law in candidate.laws {
            let mut column = self.outside(&pursuit.screen, candidate.place, &law);
            let size = dot(&column, &column).sqrt();
            if size > 0.0 {
                column.iter_mut().for_each(|x| *x /= size);
                let share = dot(&column, &self.screen_residual);
                add(&mut self.screen_residual, -share, &column);
                self.screen.push(column);
            }
            self.chosen.push((candidate.place, law));
        }
        true
    }

    /// Removes terms with a negligible contribution, such as the cosine of a pure sine.
    fn prune(&mut self, pursuit: &Pursuit) {
        let total = dot(&pursuit.find.residual, &pursuit.find.residual) - dot(&self.find_left, &self.find_left);
        let energy = |i: usize| self.coefficients[i].powi(2) * dot(&self.find[i], &self.find[i]);
        let keep: Vec<bool> = (0..self.chosen.len()).map(|i| energy(i) > NEGLIGIBLE * total).collect();
        if keep.iter().all(|k| *k) || !keep.contains(&true) {
            return;
        }
        let mut kept = keep.iter();
        self.chosen.retain(|_| *kept.next().unwrap_or(&true));
        let pick = |all: &mut Vec<Vec<f64>>| {
            let mut kept = keep.iter();
            all.retain(|_| *kept.next().unwrap_or(&true));
        };
        pick(&mut self.find);
        pick(&mut self.judge);
        let columns: Vec<&Vec<f64>> = self.find.iter().collect();
        if let Some((coefficients, left)) = least_squares(&columns, &pursuit.find.residual) {
            self.find_left = left;
            self.judge_left.clone_from(&pursuit.judge.residual);
            for (column, c) in self.judge.iter().zip(coefficients.iter()) {
                add(&mut self.judge_left, -c, column);
            }
            self.coefficients = coefficients;
        }
    }

    fn done(mut self, pursuit: &Pursuit) -> Formulation {
        self.prune(pursuit);
        let term = |((place, law), c): ((usize, Expression), &f64)| Found { place, law, coefficient: *c };
        Formulation {
            before: by_block(&pursuit.judge, &pursuit.judge.residual),
            after: by_block(&pursuit.judge, &self.judge_left),
            terms: self.chosen.into_iter().zip(self.coefficients.iter()).map(term).collect(),
        }
    }
}

/// A law that may be added.
struct Candidate {
    place: usize,
    laws: Vec<Expression>,
    columns: Vec<Vec<f64>>,
    /// Coefficients of all laws including this one.
    coefficients: DVector<f64>,
    left: Vec<f64>,
    gain: f64,
    freedom: usize,
    length: usize,
}

/// Coefficients of columns by least squares, and the residual.
fn least_squares(columns: &[&Vec<f64>], residual: &[f64]) -> Option<(DVector<f64>, Vec<f64>)> {
    let m = columns.len();
    let mut gram = DMatrix::zeros(m, m);
    for i in 0..m {
        for j in 0..=i {
            gram[(i, j)] = dot(columns[i], columns[j]);
            gram[(j, i)] = gram[(i, j)];
        }
    }
    let scale = DVector::from_fn(m, |i, _| gram[(i, i)].max(f64::MIN_POSITIVE).sqrt());
    let unit = DMatrix::from_fn(m, m, |i, j| gram[(i, j)] / (scale[i] * scale[j]) + if i == j { 1e-9 } else { 0.0 });
    let score = DVector::from_fn(m, |i, _| dot(columns[i], residual) / scale[i]);
    let coefficients = unit.cholesky()?.solve(&score).component_div(&scale);
    let mut left = residual.to_vec();
    for (column, c) in columns.iter().zip(coefficients.iter()) {
        add(&mut left, -c, column);
    }
    Some((coefficients, left))
}

/// Energy of a vector over all channels, by blocks of time.
fn by_block(ground: &Ground, x: &[f64]) -> Vec<f64> {
    let n = ground.instants.len();
    let energy = |block: Range<usize>| x.chunks_exact(n).map(|c| dot(&c[block.clone()], &c[block.clone()])).sum();
    ground.blocks().into_iter().map(energy).collect()
}

/// Decrease of the energy from `before` to `after`, and its Student's t over the blocks.
pub fn gain(before: &[f64], after: &[f64]) -> (f64, f64) {
    let n = before.len() as f64;
    let d: Vec<f64> = before.iter().zip(after).map(|(b, a)| b - a).collect();
    let total: f64 = d.iter().sum();
    let mean = total / n;
    let variance = d.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    (total, if variance > 0.0 { mean / (variance / n).sqrt() } else { 0.0 })
}

/// Force at `place` along a sight: the terms there plus the residual there by least squares over the channels.
pub fn force(sight: &Sight, terms: &[Found], place: usize) -> Vec<f64> {
    let ground = Ground::new(sight, (0..sight.len()).collect());
    let n = sight.len();
    let mut left = ground.residual.clone();
    let mut force = vec![0.0; n];
    for term in terms {
        let values = ground.values(&term.law);
        add(&mut left, -term.coefficient, &ground.outside(term.place, &ground.column(term.place, &values)));
        if term.place == place {
            add(&mut force, term.coefficient, &values);
        }
    }
    let response = &sight.responses[place];
    for (k, f) in force.iter_mut().enumerate() {
        let (mut along, mut size) = (0.0, 0.0);
        for (c, channel) in response.iter().enumerate() {
            along += channel[k] * left[c * n + k];
            size += channel[k] * channel[k];
        }
        *f += if size > 0.0 { along / size } else { 0.0 };
    }
    force
}
