//! Unknown effects: their location, the shape of their force, and an empirical formula by sparse regression,
//! validated on data not used for it.

pub mod library;
mod matching_pursuit;
mod relation;
mod shape;
mod sight;

pub use matching_pursuit::MAX_LAWS;
pub use shape::Shape;
pub use sight::Sight;

use std::sync::Arc;

use super::fitting::{Fitting, Stage};
use super::judge::{Judge, Judged, relative_energy, wanders_in};
use super::left::Rest;
use super::orders;
use super::progress::Progress;
use super::search::Found as Outcome;
use crate::effects::formula::{Formula, NAME, Place, Term, Variable};
use crate::effects::{ActiveEffect, Param};
use crate::identification::fit::{Estimate, FitError};
use crate::identification::{Dataset, Fit, Residuals};
use crate::machine::Unit;
use crate::model::Model;
use library::{Atom, Cover, harmonic_disturbances, library};
use matching_pursuit::{Formulation, Found, Ground, Pursuit, gain};

/// Share of the explainable error left by named effects, relative to a formula at one place without them, above which
/// they are replaced; the shapes of their laws may differ slightly from the library's.
const LEFT_AT_ONE_PLACE: f64 = 0.12;
/// The share for a formula at several places.
const LEFT_AT_SEVERAL: f64 = 0.2;
/// The share for a formula in addition to the named effects, which may only correct their approximations.
const LEFT_BESIDE: f64 = 0.25;
/// Student's t over blocks of time required of a formula's advantage over the named effects.
const BETTER: f64 = 4.0;
/// Share of the explainable error that named effects must add to a formula to be kept.
const WORTH_NAMING: f64 = 0.05;
/// Share of the error above the noise that a formula must explain on validation data.
const WORTH_SHOWING: f64 = 0.1;
/// Number of terms of the formulas that compare the places.
const AT_ONE_PLACE: usize = 3;

/// Error that no known effect explains.
#[derive(Clone)]
pub struct Unexplained {
    /// Location, as text.
    pub location: String,
    /// Shares of the formula's gain that a formula at each place alone reaches on validation data; best first.
    pub shares: Vec<(String, f64)>,
    /// Share of the explainable error left by the named effects.
    pub left: f64,
    /// Force at the place with the strongest terms.
    pub shape: Shape,
    /// Unit of the force.
    pub unit: Unit,
    /// Terms: place, law and estimated coefficient.
    pub terms: Vec<(Place, String, Estimate)>,
    /// Whether the named effects are kept in addition to the formula.
    pub beside_named: bool,
    /// Whether the formula explains more than the named effects and becomes part of the model; otherwise it is a
    /// proposal for the rest.
    pub replaces: bool,
    /// Fit of the model with the formula.
    pub fit: Fit,
    /// Residuals with the formula, on the held-out data where given.
    pub residuals: Arc<Residuals>,
}

impl Unexplained {
    /// The formula next to effects that were found after it, with the fit of both.
    pub(super) fn join_names(&mut self, both: &Judged) {
        self.beside_named = true;
        self.terms = estimates(&both.fit);
        (self.fit, self.residuals) = (both.fit.clone(), Arc::clone(&both.residuals));
    }

    /// The formula as a table of a model file.
    pub fn toml(&self) -> String {
        let mut text = String::from("[effects.formula] # an empirical fit, no physical finding\nempirical = true\n");
        for (place, law, coefficient) in &self.terms {
            text += &format!(
                "[[effects.formula.terms]]\nname = \"{}\"\nat = \"{}\"\nlaw = \"{law}\"\ncoefficient = {} # {}\n",
                coefficient.name,
                place.name(),
                six_digits(coefficient.value),
                coefficient.unit
            );
        }
        text
    }
}

/// Search for a law that explains clearly more than the found effects, or the part of the residual above the noise.
///
/// Without held-out data, part of the recordings is reserved for validation.
///
/// # Errors
/// If the model with the law cannot be fitted.
pub(super) fn explain(
    found: &Outcome,
    judge: &Judge,
    progress: &mut dyn FnMut(Progress),
) -> Result<Option<Unexplained>, FitError> {
    if judge.is_noise(found.end.rms()) {
        return Ok(None);
    }
    progress(Progress::Step("is it explained?"));
    let after = Search::new(&found.end, judge)?;
    let with_named = after.formula();
    if with_named.terms.is_empty() {
        return Ok(None);
    }
    let named = found.outcome.findings.len();
    let before = match named {
        0 => None,
        _ => {
            progress(Progress::Step("is there a better explanation?"));
            Some(Search::new(&found.start, judge)?)
        }
    };
    let alone = before.as_ref().map_or_else(|| with_named.clone(), Search::formula);
    let is_more_than_noise = judge.is_more_than_noise(found.end.rms());
    let Some(choice) = Choice::between(alone, with_named, &after.find.places, named, is_more_than_noise) else {
        return Ok(None);
    };
    let (search, base) = match before.as_ref().filter(|_| !choice.keeps_named) {
        Some(before) => (before, &found.start.fit.model),
        None => (&after, &found.end.fit.model),
    };
    progress(Progress::Step("where it acts"));
    let terms = &choice.formula.terms;
    let with = judge.fit(&with_formula(base, &search.find, terms))?;
    if !is_confirmed(&found.end, &with, judge)? {
        return Ok(None);
    }
    let Judged { fit, residuals } = with;
    let place = strongest(&search.find, terms);
    Ok(Some(Unexplained {
        location: location(&search.find, terms),
        shares: search.shares(choice.formula.gain()),
        left: choice.left.clamp(0.0, 1.0),
        shape: Shape::new(&search.find, terms, place, base.mechanism),
        unit: search.find.places[place].unit(base.mechanism),
        terms: estimates(&fit),
        beside_named: choice.keeps_named && named > 0,
        replaces: choice.replaces,
        fit,
        residuals,
    }))
}

/// The best formula and its consequence for the named effects.
struct Choice {
    formula: Formulation,
    /// Whether the named effects are kept in addition to it.
    keeps_named: bool,
    /// Whether it explains more than the named effects and becomes part of the model.
    replaces: bool,
    /// Share of the explainable error left by the named effects.
    left: f64,
}

impl Choice {
    /// Chooses between a formula `alone` and one in addition to `named` effects; `None` if neither explains more than
    /// the named effects and these leave no more than noise.
    fn between(
        alone: Formulation,
        with_named: Formulation,
        places: &[Place],
        named: usize,
        is_more_than_noise: bool,
    ) -> Option<Self> {
        let sum = |x: &[f64]| x.iter().sum::<f64>();
        let (before, after) = (sum(&with_named.before), sum(&with_named.after));
        let explainable = sum(&alone.before) - sum(&alone.after).min(after);
        let keeps_named = sum(&alone.after) > after + WORTH_NAMING * explainable;
        let best = if keeps_named { &with_named } else { &alone };
        let left = (before - sum(&best.after)) / explainable.max(f64::MIN_POSITIVE);
        let is_at_one_place = best.terms.iter().all(|t| same_part(places[t.place], places[best.terms[0].place]));
        let threshold = match (keeps_named, is_at_one_place) {
            (true, _) => LEFT_BESIDE,
            (false, true) => LEFT_AT_ONE_PLACE,
            (false, false) => LEFT_AT_SEVERAL,
        };
        let replaces = named == 0 || (left >= threshold && gain(&with_named.before, &best.after).1 >= BETTER);
        match (replaces, keeps_named) {
            (true, true) => Some(Self { formula: with_named, keeps_named, replaces, left }),
            (true, false) => Some(Self { formula: alone, keeps_named, replaces, left }),
            // The share left by the named effects is relative to what they explain, so the residual is compared with
            // the noise instead.
            (false, _) if is_more_than_noise => Some(Self { formula: with_named, keeps_named: true, replaces, left }),
            (false, _) => None,
        }
    }
}

/// Whether a formula explains more of the residual of the fit `without` it than smoothing errors and drift do, on the
/// validation data.
fn is_confirmed(without: &Judged, with: &Judged, judge: &Judge) -> Result<bool, FitError> {
    let [before, after] = [judge.resolved_rms(without), judge.resolved_rms(with)];
    let energy = |rms: &[f64]| relative_energy(rms, &judge.floor);
    let unexplained = energy(&before) - judge.floor.len() as f64;
    Ok(energy(&before) - energy(&after) >= WORTH_SHOWING * unexplained
        && judge.is_relevant(&before, &after)
        && !wanders_in(judge.data(), without, with)
        && !judge.fitting.wanders(&without.fit, &with.fit)?)
}

/// Whether what a fit leaves above the noise of some channel is related to the motion, or to the angle of its motor, on the
/// fitted data and on the validation data.
pub(super) fn is_related(judged: &Judged, judge: &Judge) -> Result<bool, FitError> {
    let search = Search::new(judged, judge)?;
    let found = Ground::new(&search.find, search.found.clone());
    let held_out = Ground::new(search.judge.as_ref().unwrap_or(&search.find), search.judged.clone());
    let least = judge.unexplained();
    let mut above = (0..judge.floor.len()).filter(|&c| judged.rms()[c] > least * judge.floor[c]);
    Ok(above.any(|c| relation::is_related(&found, &held_out, c, least) || orders::have_line(judged, judge, c)))
}

/// What is left of a fit on a drive in the data to judge by, where no formula explains it; none without data there.
pub(super) fn look(judged: &Judged, judge: &Judge, drive: usize) -> Result<Option<Rest>, FitError> {
    let model = &judged.fit.model;
    let sight = judge.fitting.sight(model, judge.data(), &judged.residuals)?;
    let Some(place) = sight.places.iter().position(|p| *p == Place::Drive(drive)) else { return Ok(None) };
    Ok(Some(Rest {
        location: sight.places[place].region(),
        shape: Shape::new(&sight, &[], place, model.mechanism),
        unit: sight.places[place].unit(model.mechanism),
    }))
}

impl Fitting<'_> {
    /// What a model leaves of datasets, with everything that may explain it.
    fn sight(&self, model: &Model, datasets: &[Dataset], residuals: &Residuals) -> Result<Sight, FitError> {
        Sight::new(model, datasets, residuals, self.fixed)
    }
}

/// A number with six significant digits as text.
fn six_digits(x: f64) -> String {
    format!("{:?}", format!("{x:.5e}").parse().unwrap_or(x))
}

/// Training and validation data with their library.
struct Search<'a> {
    find: Sight,
    /// Training instants.
    found: Vec<usize>,
    /// Held-out data; without, the rest of `find` is used.
    judge: Option<Sight>,
    judged: Vec<usize>,
    atoms: Vec<Atom>,
    fitting: &'a Fitting<'a>,
}

impl<'a> Search<'a> {
    fn new(judged: &Judged, judge: &Judge<'a>) -> Result<Self, FitError> {
        let (fitting, fit) = (judge.fitting, &judged.fit);
        let find = fitting.sight(&fit.model, fitting.datasets, &fit.residuals)?;
        let judge = match judge.held_out {
            [] => None,
            held_out => Some(fitting.sight(&fit.model, held_out, &judged.residuals)?),
        };
        let (found, judged) = match &judge {
            Some(judge) => ((0..find.len()).collect(), (0..judge.len()).collect()),
            None => find.halves(),
        };
        let mut atoms = library(&find.places, &Cover::new(&find.variables));
        let time = Variable::named("t").map_or(&[][..], |t| &find.variables[t.index()]);
        if fitting.datasets.len() == 1 {
            atoms.extend(harmonic_disturbances(&find.places, &find.residual, time));
        }
        Ok(Self { find, found, judge, judged, atoms, fitting })
    }

    /// Whether the time is up.
    fn is_late(&self) -> bool {
        !self.fitting.has_time_for(Stage::NextExperiment)
    }

    fn pursuit(&self) -> Pursuit<'_> {
        let judge = self.judge.as_ref().unwrap_or(&self.find);
        Pursuit::new(&self.atoms, (&self.find, self.found.clone()), (judge, self.judged.clone()))
    }

    fn formula(&self) -> Formulation {
        self.pursuit().formula(MAX_LAWS, |_| true, &|| self.is_late())
    }

    /// Share of the gain `all` that a formula at each part of the machine alone reaches; best first.
    fn shares(&self, all: f64) -> Vec<(String, f64)> {
        let pursuit = self.pursuit();
        let mut parts: Vec<Place> = Vec::new();
        for &place in &self.find.places {
            if !parts.iter().any(|p| same_part(*p, place)) {
                parts.push(place);
            }
        }
        let share = |part: &Place| {
            let there = pursuit.formula(AT_ONE_PLACE, |p| same_part(self.find.places[p], *part), &|| self.is_late());
            (part.region(), (there.gain() / all.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0))
        };
        let mut shares: Vec<(String, f64)> = parts.iter().take_while(|_| !self.is_late()).map(share).collect();
        shares.sort_by(|a, b| b.1.total_cmp(&a.1));
        shares
    }
}

fn same_part(a: Place, b: Place) -> bool {
    a == b || matches!((a, b), (Place::Platform(_), Place::Platform(_)))
}

/// The parts at which a formula acts, as text.
fn location(sight: &Sight, terms: &[Found]) -> String {
    let mut parts: Vec<String> = Vec::new();
    for term in terms {
        let part = sight.places[term.place].region();
        if !parts.contains(&part) {
            parts.push(part);
        }
    }
    parts.join(", ")
}

/// Place of the terms with the largest response.
fn strongest(sight: &Sight, terms: &[Found]) -> usize {
    let energy = |place: usize| -> f64 {
        let force = |k: usize| -> f64 {
            let there = terms.iter().filter(|t| t.place == place);
            there.map(|t| t.coefficient * t.law.value(|v| sight.variables[v.index()][k])).sum()
        };
        let response = |k: usize| -> f64 { sight.responses[place].iter().map(|c| c[k] * c[k]).sum() };
        (0..sight.len()).step_by(10).map(|k| force(k).powi(2) * response(k)).sum()
    };
    let best = terms.iter().map(|t| (energy(t.place), t.place)).max_by(|a, b| a.0.total_cmp(&b.0));
    best.map_or(0, |(_, place)| place)
}

/// The model with the terms added to its formula, if it has one.
fn with_formula(base: &Model, sight: &Sight, terms: &[Found]) -> Model {
    let mut model = base.clone();
    let mut all: Vec<(Term, f64)> = Vec::new();
    if let Some(own) = model.effects.iter().position(|a| a.effect.formula().is_some()) {
        let own = model.effects.remove(own);
        let terms = own.effect.formula().map_or(&[][..], |f| &f.terms);
        all.extend(terms.iter().cloned().zip(own.values.iter().copied()));
    }
    for term in terms {
        let at = sight.places[term.place];
        let free = |n: &usize| all.iter().all(|(t, _)| t.name != format!("{}_{n}", at.name()));
        let name = format!("{}_{}", at.name(), (1..).find(free).unwrap_or(0));
        all.push((Term { name, at, law: term.law.clone() }, term.coefficient));
    }
    let values: Vec<[f64; 1]> = all.iter().map(|(_, c)| [*c]).collect();
    let blocks: Vec<&[f64]> = values.iter().map(|v| &v[..]).collect();
    let formula = Arc::new(Formula::new(all, true, model.mechanism));
    model.effects.push(ActiveEffect { host: model.host(), ..ActiveEffect::new(formula, &blocks) });
    model
}

/// Estimates of the terms of the fitted formula.
fn estimates(fit: &Fit) -> Vec<(Place, String, Estimate)> {
    let Some(formula) = fit.model.effects.iter().find_map(|a| a.effect.formula()) else { return Vec::new() };
    // Each term has one number, its coefficient.
    let estimate = |(block, term): (usize, &Term)| {
        let coefficient = Param { effect: NAME, block, item: 0 };
        let found = fit.parameters.iter().find(|p| p.param == coefficient)?;
        Some((term.at, term.law.text().to_string(), Estimate { name: term.name.clone(), ..found.clone() }))
    };
    formula.terms.iter().enumerate().filter_map(estimate).collect()
}
