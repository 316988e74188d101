//! Test whether a law outside the library of effects lies in the span of the laws of the search for unknown laws.
//!
//! A formula of that search is a sum of at most [`MAX_LAWS`] of its laws, each with an inner number between neighbours of
//! a grid. A law is fitted by such sums with least squares over the instants of a motion, after projection of the
//! model's own parameters: laws are added one at a time, the best given the previous ones (orthogonal least squares),
//! and after each the inner numbers are refined in turn. The residual share of the law's energy decides. All columns
//! of the search at once would represent any smooth law, because there are thousands of them.
//!
//! The pursuit is greedy, and its first law need not be part of an exact sum, so it is restarted from a few laws
//! without an inner number. A law that another choice would represent is still classified as outside; the share
//! indicates how far.

use nalgebra::{DMatrix, DVector};

use deltatwin::diagnosis::unknown::library::{Atom, Cover, harmonic_disturbances, library};
use deltatwin::diagnosis::unknown::{MAX_LAWS, Sight};
use deltatwin::effects::formula::{Expression, Place, Variable};
use deltatwin::identification::dataset::stride_for;
use deltatwin::identification::fit::FitError;
use deltatwin::identification::{Dataset, Residuals};
use deltatwin::model::Model;
use deltatwin::numerics::parallel;

/// Largest residual share of the energy of a law in the span.
pub const WITHIN: f64 = 1e-6;
/// Number of instants of the fit.
const INSTANTS: usize = 1000;
/// Number of laws of the search refined per step, best first.
const LAWS_PER_STEP: usize = 8;
/// Number of golden-section steps for an inner number.
const SECTIONS: usize = 40;
/// Number of laws without an inner number from which the pursuit is restarted, best first, and number of laws in a
/// restart.
const RESTARTS: usize = 6;
const LAWS_PER_RESTART: usize = 3;
/// Number of passes over the inner numbers after each law.
const PASSES: usize = 2;
/// Share of its norm below which the part of a column outside the others counts as zero.
const COLLINEAR: f64 = 1e-9;

/// Share of the energy of `law` at `at` along `dataset` that no sum of the search's laws represents, after projection
/// of the own parameters of `model`; zero if these represent all of it, `None` if the law has no effect along the
/// motion.
///
/// # Errors
/// If the machine cannot follow the motion.
pub fn unspanned(model: &Model, dataset: &Dataset, at: Place, law: &Expression) -> Result<Option<f64>, FitError> {
    let datasets = std::slice::from_ref(dataset);
    let sight = Sight::new(model, datasets, &Residuals::new(model, datasets)?, &[])?;
    let Some(place) = sight.places.iter().position(|p| *p == at) else { return Ok(None) };
    let ground = Ground::new(&sight);
    let mut atoms = library(&sight.places, &Cover::new(&sight.variables));
    if let Some(time) = Variable::named("t") {
        atoms.extend(harmonic_disturbances(
            &sight.places,
            &effect_of(&sight, place, law),
            &sight.variables[time.index()],
        ));
    }
    Ok(ground.left_of(&atoms, place, law))
}

/// Contribution of a law to every channel.
fn effect_of(sight: &Sight, place: usize, law: &Expression) -> Vec<Vec<f64>> {
    let force = |k: usize| law.value(|v: Variable| sight.variables[v.index()][k]);
    let forces: Vec<f64> = (0..sight.len()).map(force).collect();
    sight.responses[place].iter().map(|response| response.iter().zip(&forces).map(|(r, f)| r * f).collect()).collect()
}

/// Laws of an atom with `number` as the inner number, in full precision.
fn laws(atom: &Atom, number: Option<f64>) -> Vec<Expression> {
    let digits = number.map_or(String::new(), |x| format!("({x})"));
    atom.laws.iter().filter_map(|law| Expression::parse(&law.replace('#', &digits)).ok()).collect()
}

/// The motion at the instants of the fit, with the model's own parameters.
struct Ground<'a> {
    sight: &'a Sight,
    instants: Vec<usize>,
    /// Orthonormal columns of the model's parameters, channel by channel.
    own: Vec<DVector<f64>>,
    /// Inner products of the own columns with a unit force at each instant, `[place]`: instants × columns.
    own_at: Vec<DMatrix<f64>>,
}

/// The laws of the search along the motion.
struct Searched<'a> {
    atoms: &'a [Atom],
    /// Their values at the instants, with the inner numbers of the grid.
    forces: Vec<Vec<DVector<f64>>>,
    /// Gram matrices of their columns after projection of the own parameters.
    grams: Vec<DMatrix<f64>>,
}

/// A selected law.
struct Taken<'a> {
    atom: &'a Atom,
    columns: Vec<DVector<f64>>,
}

impl<'a> Ground<'a> {
    fn new(sight: &'a Sight) -> Self {
        let instants: Vec<usize> = (0..sight.len()).step_by(stride_for(sight.len(), INSTANTS)).collect();
        let gathered = |channels: &Vec<Vec<f64>>| {
            DVector::from_iterator(
                channels.len() * instants.len(),
                channels.iter().flat_map(|channel| instants.iter().map(move |&k| channel[k])),
            )
        };
        let mut own = Vec::new();
        for column in &sight.base {
            own.extend(beyond(&own, gathered(column)));
        }
        let responses: Vec<DVector<f64>> = sight.responses.iter().map(gathered).collect();
        let n = instants.len();
        let own_at = responses
            .iter()
            .map(|response| {
                DMatrix::from_fn(n, own.len(), |k, j| {
                    (0..response.len() / n).map(|c| response[c * n + k] * own[j][c * n + k]).sum()
                })
            })
            .collect();
        Self { sight, instants, own, own_at }
    }

    /// Values of a law at the instants.
    fn values(&self, law: &Expression) -> DVector<f64> {
        let variables = &self.sight.variables;
        DVector::from_iterator(
            self.instants.len(),
            self.instants.iter().map(|&k| law.value(|v: Variable| variables[v.index()][k])),
        )
    }

    /// Response of all channels to forces at a place, before projection of the own parameters.
    fn column(&self, place: usize, force: &DVector<f64>) -> DVector<f64> {
        let channels = &self.sight.responses[place];
        let at = |channel: &'a Vec<f64>| self.instants.iter().zip(force).map(|(&k, f)| channel[k] * f);
        DVector::from_iterator(channels.len() * self.instants.len(), channels.iter().flat_map(at))
    }

    /// Columns of an atom with `number` as the inner number, after projection of the own parameters.
    fn columns(&self, atom: &Atom, number: Option<f64>) -> Vec<DVector<f64>> {
        let beyond = |law: &Expression| {
            let mut column = self.column(atom.place, &self.values(law));
            for own in &self.own {
                column.axpy(-own.dot(&column), own, 1.0);
            }
            column
        };
        laws(atom, number).iter().map(beyond).collect()
    }

    /// Residual share of a law's energy after the pursuit.
    fn left_of(&self, atoms: &[Atom], place: usize, law: &Expression) -> Option<f64> {
        let whole = self.column(place, &self.values(law));
        if whole.iter().all(|x| *x == 0.0) {
            return None;
        }
        let Some(target) = beyond(&self.own, whole) else { return Some(0.0) };
        let forces: Vec<Vec<DVector<f64>>> = atoms
            .iter()
            .map(|atom| laws(atom, atom.number.map(|n| n.value)).iter().map(|law| self.values(law)).collect())
            .collect();
        let grams: Vec<DMatrix<f64>> = atoms.iter().zip(&forces).map(|(a, f)| self.gram(a.place, f)).collect();
        let searched = Searched { atoms, forces, grams };
        let best = self.pursue(&searched, &target, None, MAX_LAWS);
        if best < WITHIN {
            return Some(best);
        }
        let mut first = self.ranked(&searched, &[], &target);
        first.retain(|i| atoms[*i].number.is_none());
        first.truncate(RESTARTS);
        let again = |k: usize| self.pursue(&searched, &target, Some(first[k]), LAWS_PER_RESTART);
        Some(parallel::map(first.len(), again).into_iter().fold(best, f64::min).min(1.0))
    }

    /// Residual energy of `target` after at most `most` laws, of which the first may be given.
    fn pursue(&self, searched: &Searched, target: &DVector<f64>, first: Option<usize>, most: usize) -> f64 {
        let mut taken: Vec<Taken> = Vec::new();
        let mut left = target.clone();
        while taken.len() < most && left.norm_squared() > WITHIN {
            let others: Vec<DVector<f64>> = basis(&taken, None);
            let tried = match first.filter(|_| taken.is_empty()) {
                Some(first) => vec![first],
                None => self.ranked(searched, &others, &left).into_iter().take(LAWS_PER_STEP).collect(),
            };
            let one = |k: usize| self.refined(&searched.atoms[tried[k]], &others, &left);
            let refined = parallel::map(tried.len(), one).into_iter();
            let Some((_, best)) = refined.max_by(|a, b| a.0.total_cmp(&b.0)) else { break };
            taken.push(best);
            let count = taken.len();
            for i in (0..PASSES).flat_map(|_| 0..count) {
                let others = basis(&taken, Some(i));
                taken[i] = self.refined(taken[i].atom, &others, &outside(&others, target)).1;
            }
            left = outside(&basis(&taken, None), target);
        }
        left.norm_squared()
    }

    /// Inner products of `column` with a unit force at each instant, by place.
    fn products(&self, column: &DVector<f64>) -> Vec<DVector<f64>> {
        let n = self.instants.len();
        let at_place = |response: &Vec<Vec<f64>>| {
            let sum =
                |k: usize| response.iter().enumerate().map(|(c, r)| r[self.instants[k]] * column[c * n + k]).sum();
            DVector::from_iterator(n, (0..n).map(sum))
        };
        self.sight.responses.iter().map(at_place).collect()
    }

    /// Gram matrix of a law's columns after projection of the own parameters.
    fn gram(&self, place: usize, forces: &[DVector<f64>]) -> DMatrix<f64> {
        let response = &self.sight.responses[place];
        let weight = |k: usize| -> f64 { response.iter().map(|channel| channel[k] * channel[k]).sum() };
        let weights: Vec<f64> = self.instants.iter().map(|&k| weight(k)).collect();
        let own: Vec<DVector<f64>> = forces.iter().map(|force| self.own_at[place].tr_mul(force)).collect();
        DMatrix::from_fn(forces.len(), forces.len(), |i, j| {
            let whole: f64 = weights.iter().zip(&forces[i]).zip(&forces[j]).map(|((w, a), b)| w * a * b).sum();
            whole - own[i].dot(&own[j])
        })
    }

    /// Indices of the laws by the energy of `left` that they explain in addition to the orthonormal columns `others`,
    /// largest first. `left` is orthogonal to these and to the own parameters.
    fn ranked(&self, searched: &Searched, others: &[DVector<f64>], left: &DVector<f64>) -> Vec<usize> {
        let products = self.products(left);
        let with_others: Vec<Vec<DVector<f64>>> = others.iter().map(|other| self.products(other)).collect();
        let gain = |i: usize| {
            let (forces, place) = (&searched.forces[i], searched.atoms[i].place);
            let along = |products: &[DVector<f64>]| {
                DVector::from_iterator(forces.len(), forces.iter().map(|f| f.dot(&products[place])))
            };
            let b = along(&products);
            let whole = &searched.grams[i];
            let gram = with_others.iter().map(|o| along(o)).fold(whole.clone(), |gram, c| gram - &c * c.transpose());
            if (0..gram.nrows()).any(|k| gram[(k, k)] <= COLLINEAR * whole[(k, k)]) {
                return 0.0;
            }
            gram.cholesky().map_or(0.0, |c| b.dot(&c.solve(&b))).max(0.0)
        };
        let all = (0..searched.atoms.len()).map(|i| (gain(i), i));
        let mut order: Vec<(f64, usize)> = all.filter(|(gain, _)| gain.is_finite()).collect();
        order.sort_by(|a, b| b.0.total_cmp(&a.0));
        order.into_iter().map(|(_, i)| i).collect()
    }

    /// The law of an atom with the inner number that explains most of `left` in addition to `others`, and the energy
    /// explained.
    fn refined<'b>(&self, atom: &'b Atom, others: &[DVector<f64>], left: &DVector<f64>) -> (f64, Taken<'b>) {
        let take = |number: Option<f64>| {
            let columns = self.columns(atom, number);
            let mut all = others.to_vec();
            for column in &columns {
                let more = beyond(&all, column.clone());
                all.extend(more);
            }
            let gain: f64 = all[others.len()..].iter().map(|q| q.dot(left).powi(2)).sum();
            (if gain.is_finite() { gain } else { 0.0 }, Taken { atom, columns })
        };
        let Some(number) = atom.number else { return take(None) };
        let golden = 0.5 * (5f64.sqrt() - 1.0);
        let (mut a, mut b) = number.range;
        let (mut c, mut d) = (b - golden * (b - a), a + golden * (b - a));
        let gain = |x: f64| take(Some(x)).0;
        let (mut at_c, mut at_d) = (gain(c), gain(d));
        for _ in 0..SECTIONS {
            if at_c > at_d {
                (b, d, at_d) = (d, c, at_c);
                c = b - golden * (b - a);
                at_c = gain(c);
            } else {
                (a, c, at_c) = (c, d, at_d);
                d = a + golden * (b - a);
                at_d = gain(d);
            }
        }
        // Golden section may converge to a smaller local maximum than its start.
        let (section, start) = (take(Some(0.5 * (a + b))), take(Some(number.value)));
        if section.0 >= start.0 { section } else { start }
    }
}

/// Orthonormal columns of the selected laws, except one of them.
fn basis(taken: &[Taken], without: Option<usize>) -> Vec<DVector<f64>> {
    let mut all = Vec::new();
    for (_, one) in taken.iter().enumerate().filter(|(i, _)| Some(*i) != without) {
        for column in &one.columns {
            let more = beyond(&all, column.clone());
            all.extend(more);
        }
    }
    all
}

/// The part of a column orthogonal to orthonormal ones.
fn outside(orthonormal: &[DVector<f64>], column: &DVector<f64>) -> DVector<f64> {
    let mut left = column.clone();
    for q in orthonormal.iter().chain(orthonormal) {
        left.axpy(-q.dot(&left), q, 1.0);
    }
    left
}

/// The normalised part of a column orthogonal to orthonormal ones; `None` if it is zero up to rounding.
fn beyond(orthonormal: &[DVector<f64>], column: DVector<f64>) -> Option<DVector<f64>> {
    let size = column.norm();
    let left = outside(orthonormal, &column);
    let norm = left.norm();
    (size.is_finite() && norm > COLLINEAR * size && norm > 0.0).then(|| left / norm)
}

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::sync::Arc;

    use super::super::campaign::prepare;
    use super::super::outside::Outside;
    use super::super::{Case, MotionKind};
    use super::*;
    use deltatwin_io::model::shipped::IRB_360_6_1600;

    fn share(at: &'static str, law: &'static str) -> f64 {
        share_of(at, law).unwrap()
    }

    fn share_of(at: &'static str, law: &'static str) -> Option<f64> {
        let model = deltatwin_io::model::parse(IRB_360_6_1600, Path::new("models/irb360-6-1600.toml")).unwrap();
        let outside = Outside { name: "law", at, law };
        let case = Case { outside: Some(outside), motion: MotionKind::Fourier, duration: 6.0, ..Case::default() };
        assert!(prepare(&model, &Case { outside: None, ..case.clone() }, &[]).unwrap().unspanned.is_none());
        prepare(&model, &case, &[Arc::new(outside.effect(model.mechanism))]).unwrap().unspanned
    }

    #[test]
    #[ignore = "campaign"]
    fn sums_of_the_searchs_laws_are_in_its_span() {
        for (at, law) in [
            ("drive1", "sin(47*q1 + 0.7)"),
            ("drive3", "-qd3*abs(qd3) + 0.05*qd3^3"),
            ("drive2", "sin(2*pi*7.3*t)"),
            ("platform_y", "-sin(9*y)"),
            // The model's own parameters represent all of it.
            ("drive2", "-qd2 - tanh(100*qd2)"),
        ] {
            let share = share(at, law);
            println!("{law}: {share:e}");
            assert!(share < WITHIN, "{law}: {share:e}");
        }
    }

    #[test]
    fn nothing_is_said_of_a_law_that_does_nothing() {
        assert_eq!(share_of("platform_z", "max(0, -z - 3)"), None);
    }

    #[test]
    #[ignore = "campaign"]
    fn laws_of_other_shapes_are_not() {
        for (at, law, least) in [
            ("drive1", "cos(132*q1)*qdd1", 0.5),
            ("drive2", "-tanh(50*(qd2 + qd3))", 0.01),
            // A smaller slope at reversals than that of the search.
            ("drive3", "-tanh(12*qd3)*(q3 - 0.3)", WITHIN),
        ] {
            let share = share(at, law);
            assert!((least..=1.0).contains(&share), "{law}: {share:e}");
        }
    }
}
