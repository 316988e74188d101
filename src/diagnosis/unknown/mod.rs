//! What the diagnosis says when no known effect explains the data: where something acts, what it looks like, and a
//! formula for it, found by sparse regression and judged on data that were not used to find it.

mod library;
mod pursuit;
mod shape;
mod sight;

pub use shape::Shape;
pub use sight::Sight;

use std::sync::Arc;

use super::judge::{is_relevant, relative_energy, wanders_in};
use super::left::Rest;
use super::{EXPERIMENT, Fitting};
use crate::effects::ActiveEffect;
use crate::effects::formula::{Formula, NAME, Place, Term, Variable};
use crate::evidence::Stop;
use crate::identification::fit::{Estimate, FitError, channel_rms, residuals};
use crate::identification::prediction::Channels;
use crate::identification::trace::noise_floor;
use crate::identification::{Fit, Trace};
use crate::model::{Model, Unit};
use library::{Atom, Cover, hums, library};
use pursuit::{Formulation, Found, MOST, Pursuit, gain};

/// Share of the explainable error that named effects may leave to a formula at one place that does without them before
/// they are doubted: their shape may differ a little from ours.
const LEFT_AT_ONE_PLACE: f64 = 0.06;
/// The same for a formula that needs several places.
const LEFT_AT_SEVERAL: f64 = 0.2;
/// The same where the named effects stay: a formula then only touches up what their approximations leave.
const LEFT_BESIDE: f64 = 0.25;
/// Student's t, over blocks of time, of a formula's advantage over named effects.
const BETTER: f64 = 4.0;
/// Share of the explainable error that named effects must add to a formula to stay beside it.
const WORTH_NAMING: f64 = 0.05;
/// Share of the error above the noise that a formula must take, held out.
const WORTH_SHOWING: f64 = 0.1;
/// Terms of the formulas that tell the places apart.
const AT_ONE_PLACE: usize = 3;

/// What no known effect explains.
#[derive(Clone)]
pub struct Unexplained {
    /// Where it acts, in words.
    pub location: String,
    /// Share of what the formula takes that a formula at each place alone takes, held out; best first.
    pub shares: Vec<(String, f64)>,
    /// Share of the explainable error that the named effects leave.
    pub left: f64,
    /// What acts at the strongest place.
    pub shape: Shape,
    /// Unit of that.
    pub unit: Unit,
    /// Terms: place, law and estimated coefficient.
    pub terms: Vec<(Place, String, Estimate)>,
    /// Whether the named effects stay beside the formula.
    pub beside_named: bool,
    /// Whether the formula is worth more than the names: it goes into the model. If not it is a proposal for what is left
    /// beside them.
    pub replaces: bool,
    /// The model with the formula, fitted.
    pub fit: Fit,
    /// RMS residual with it; on held-out data where given.
    pub rms: Vec<f64>,
}

impl Unexplained {
    /// The formula as a table of the model file.
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

/// What speaks for something unknown before it is looked for.
#[derive(Clone, Copy)]
pub(super) struct Doubt {
    /// Number of effects that are named.
    pub named: usize,
    /// Whether they leave clearly more than noise on the data judged by.
    pub is_more_than_noise: bool,
}

/// Looks for a law that explains clearly more than the effects in `end`, the fit `start` with the named effects added, or
/// that explains what they leave above the noise.
///
/// Without `held_out` a part of the traces is kept back to judge by.
pub(super) fn explain(
    [start, end]: [&Fit; 2],
    Doubt { named, is_more_than_noise }: Doubt,
    fitting: &Fitting,
    held_out: &[Trace],
    progress: &mut dyn FnMut(&str),
) -> Result<Option<Unexplained>, FitError> {
    progress("is it explained?");
    let after = Search::new(&end.model, fitting, held_out)?;
    let stop = || (fitting.clock)() >= EXPERIMENT;
    let with_named = after.formula(&stop);
    if with_named.terms.is_empty() {
        return Ok(None);
    }
    let (before, alone) = if named == 0 {
        (None, with_named.clone())
    } else {
        progress("is there a better explanation?");
        let before = Search::new(&start.model, fitting, held_out)?;
        let alone = before.formula(&stop);
        (Some(before), alone)
    };
    let sum = |x: &[f64]| x.iter().sum::<f64>();
    let explainable = sum(&alone.before) - sum(&alone.after).min(sum(&with_named.after));
    let beside_named = sum(&alone.after) > sum(&with_named.after) + WORTH_NAMING * explainable;
    let (search, base, best) = if beside_named {
        (&after, &end.model, with_named.clone())
    } else {
        (before.as_ref().unwrap_or(&after), &start.model, alone)
    };
    let left = (sum(&with_named.before) - sum(&best.after)) / explainable.max(f64::MIN_POSITIVE);
    let at_one_place =
        best.terms.iter().all(|t| same_part(search.find.places[t.place], search.find.places[best.terms[0].place]));
    let threshold = match (beside_named, at_one_place) {
        (true, _) => LEFT_BESIDE,
        (false, true) => LEFT_AT_ONE_PLACE,
        (false, false) => LEFT_AT_SEVERAL,
    };
    let replaces = named == 0 || (left >= threshold && gain(&with_named.before, &best.after).1 >= BETTER);
    if !replaces && !is_more_than_noise {
        return Ok(None);
    }
    // What the names leave is relative to what they explain; the noise is not.
    let (search, base, best, beside_named) =
        if replaces { (search, base, best, beside_named) } else { (&after, &end.model, with_named.clone(), true) };
    progress("where it acts");
    let fit = fitting.fit(&with_formula(base, &search.find, &best.terms))?;
    let judge = if held_out.is_empty() { fitting.traces } else { held_out };
    let (without, with) = (residuals(&end.model, judge)?, residuals(&fit.model, judge)?);
    let rms = channel_rms(&with);
    let floor = noise_floor(&end.model, judge);
    let energy = |residuals: &[Channels]| relative_energy(&channel_rms(residuals), &floor);
    if energy(&without) - energy(&with) < WORTH_SHOWING * (energy(&without) - floor.len() as f64) {
        return Ok(None);
    }
    // As of names: a trifle is what smoothing blurs, and noise may drift.
    if !is_relevant(&channel_rms(&without), &rms) || wanders_in(judge, &without, &with) || fitting.wanders(end, &fit)? {
        return Ok(None);
    }
    let shares = search.shares(best.gain(), &stop);
    let place = strongest(&search.find, &best.terms);
    Ok(Some(Unexplained {
        location: location(&search.find, &best.terms),
        shares,
        left: left.clamp(0.0, 1.0),
        shape: Shape::new(&search.find, &best.terms, place, base.mechanism),
        unit: base.mechanism.unit(search.find.places[place].unit()),
        terms: estimates(&fit),
        beside_named: beside_named && named > 0,
        replaces,
        fit,
        rms,
    }))
}

/// What is left of a fit on a drive, along `traces`, where no formula explains it; none without data there.
pub(super) fn look(fit: &Fit, fitting: &Fitting, traces: &[Trace], drive: usize) -> Result<Option<Rest>, FitError> {
    let sight = Sight::new(&fit.model, traces, &fitting.noise, &|parameter| fitting.holds(parameter))?;
    let Some(place) = sight.places.iter().position(|p| *p == Place::Drive(drive)) else { return Ok(None) };
    let machine = fit.model.mechanism;
    Ok(Some(Rest {
        location: sight.places[place].region(),
        shape: Shape::new(&sight, &[], place, machine),
        unit: machine.unit(sight.places[place].unit()),
    }))
}

/// A number as it is read by a person.
fn six_digits(x: f64) -> String {
    format!("{:?}", format!("{x:.5e}").parse().unwrap_or(x))
}

/// Data to find with and to judge by, and the library for them.
struct Search {
    find: Sight,
    /// Instants to find with.
    found: Vec<usize>,
    /// Held-out data; without, the rest of `find`.
    judge: Option<Sight>,
    judged: Vec<usize>,
    atoms: Vec<Atom>,
}

impl Search {
    fn new(model: &Model, fitting: &Fitting, held_out: &[Trace]) -> Result<Self, FitError> {
        let sight = |traces| Sight::new(model, traces, &fitting.noise, &|parameter| fitting.holds(parameter));
        let find = sight(fitting.traces)?;
        let judge = if held_out.is_empty() { None } else { Some(sight(held_out)?) };
        let (found, judged) = match &judge {
            Some(judge) => ((0..find.len()).collect(), (0..judge.len()).collect()),
            None => find.halves(),
        };
        let mut atoms = library(&find.places, &Cover::new(&find.variables));
        let time = Variable::named("t").map_or(&[][..], |t| &find.variables[t.index()]);
        if fitting.traces.len() == 1 {
            atoms.extend(hums(&find.places, &find.residual, time));
        }
        Ok(Self { find, found, judge, judged, atoms })
    }

    fn pursuit(&self) -> Pursuit<'_> {
        let judge = self.judge.as_ref().unwrap_or(&self.find);
        Pursuit::new(&self.atoms, (&self.find, self.found.clone()), (judge, self.judged.clone()))
    }

    fn formula(&self, stop: Stop) -> Formulation {
        self.pursuit().formula(MOST, |_| true, stop)
    }

    /// What a formula at each part of the machine alone takes, relative to `all`; best first.
    fn shares(&self, all: f64, stop: Stop) -> Vec<(String, f64)> {
        let pursuit = self.pursuit();
        let mut parts: Vec<Place> = Vec::new();
        for &place in &self.find.places {
            if !parts.iter().any(|p| same_part(*p, place)) {
                parts.push(place);
            }
        }
        let share = |part: &Place| {
            let there = pursuit.formula(AT_ONE_PLACE, |p| same_part(self.find.places[p], *part), stop);
            (part.region(), (there.gain() / all.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0))
        };
        let mut shares: Vec<(String, f64)> = parts.iter().take_while(|_| !stop()).map(share).collect();
        shares.sort_by(|a, b| b.1.total_cmp(&a.1));
        shares
    }
}

fn same_part(a: Place, b: Place) -> bool {
    a == b || matches!((a, b), (Place::Platform(_), Place::Platform(_)))
}

/// The parts where a formula acts.
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

/// Place of the terms that do most.
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

/// The model with the terms added to what formula it has.
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
    model
        .effects
        .push(ActiveEffect { host: model.host(), ..ActiveEffect::new(Arc::new(Formula::new(all, true)), &blocks) });
    model
}

/// Terms of the fitted formula.
fn estimates(fit: &Fit) -> Vec<(Place, String, Estimate)> {
    let Some(formula) = fit.model.effects.iter().find_map(|a| a.effect.formula()) else { return Vec::new() };
    let estimate = |term: &Term| {
        let name = format!("{}.{}", NAME, term.name);
        let found = fit.parameters.iter().find(|p| p.name == name)?;
        Some((term.at, term.law.text().to_string(), Estimate { name: term.name.clone(), ..found.clone() }))
    };
    formula.terms.iter().filter_map(estimate).collect()
}
