//! One effect at a time: forward selection and backward removal.

use std::sync::Arc;

use super::Error;
use super::evaluate::evaluate;
use super::problem::{Chosen, Problem, Settings};
use super::ranking::Ranking;
use super::stop::{NEVER, Stop};

/// One effect added.
#[derive(Clone, Debug)]
pub struct Step {
    /// What was added.
    pub added: Chosen,
    /// Assessment of all candidates before it was.
    pub ranking: Ranking,
}

/// An effect that stays, judged with the other found effects in the base.
#[derive(Clone, Debug)]
pub struct Finding {
    /// The effect.
    pub chosen: Chosen,
    /// Assessment of it and of all others; its confidence set are the effects it cannot be told from.
    pub ranking: Ranking,
    /// The problem it was judged in, if that is not the last one.
    pub problem: Option<Arc<Problem>>,
}

/// What becomes of the problem when an effect was added.
pub enum Refit {
    /// It stays as it is.
    Same,
    /// It is linearised at better parameters.
    New(Box<Problem>),
    /// The effect does not stand, and there is no time to look for another.
    Withdraw,
}

/// The problem at the parameters that are best with the effects given, where it is another one than the last.
pub type Apart<'a> = &'a dyn Fn(&[Chosen]) -> Option<Arc<Problem>>;

/// Result of the whole procedure.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Effects in the order they were added.
    pub steps: Vec<Step>,
    /// Effects that stay, in the order they were added.
    pub findings: Vec<Finding>,
    /// Effects removed because others explain the same.
    pub removed: Vec<Chosen>,
    /// Assessment with all found effects in the base.
    pub remaining: Ranking,
    /// The problem as last refitted; `None` if it never was.
    pub refitted: Option<Problem>,
    /// Whether it was stopped while some candidate still passed.
    pub cut_short: bool,
}

impl Outcome {
    /// Indices of the found candidates.
    pub fn found(&self) -> Vec<usize> {
        self.findings.iter().map(|f| f.chosen.candidate).collect()
    }
}

/// The whole procedure on a problem that stays as it is.
pub fn select(problem: &Problem, settings: &Settings) -> Result<Outcome, Error> {
    select_with(problem, settings, NEVER, |_, _| Ok(Refit::Same), &|_| None)
}

/// The whole procedure. After every addition `refit` gets the effects in the base and the last ranking and may return the
/// problem linearised at better parameters; its candidates must be the same, in the same order. Once `stop` says so,
/// nothing more is added or exchanged, and every effect is judged given those added before it.
///
/// An effect that fails beside the others is judged once more in the problem that `apart` gives for these, if it gives one: at
/// parameters that are the best without it, where these have less freedom than with it.
pub fn select_with<F>(
    problem: &Problem,
    settings: &Settings,
    stop: Stop,
    mut refit: F,
    apart: Apart,
) -> Result<Outcome, Error>
where
    F: FnMut(&[Chosen], &Ranking) -> Result<Refit, String>,
{
    let mut refitted: Option<Problem> = None;
    let mut chosen: Vec<Chosen> = Vec::new();
    let mut steps = Vec::new();
    let mut cut_short = false;
    let mut remaining = loop {
        let ranking = evaluate(refitted.as_ref().unwrap_or(problem), &chosen, settings)?;
        let Some(best) = ranking.winner().filter(|_| steps.len() < settings.max_steps) else {
            break ranking;
        };
        if stop() {
            cut_short = true;
            break ranking;
        }
        let added = Chosen { candidate: best.candidate, variant: best.variant };
        chosen.push(added);
        match refit(&chosen, &ranking).map_err(Error::Refit)? {
            Refit::Same => (),
            Refit::New(next) => {
                let names = |p: &Problem| p.candidates.iter().map(|c| c.name.clone()).collect::<Vec<_>>();
                if names(&next) != names(problem) {
                    return Err(Error::Candidates);
                }
                refitted = Some(*next);
            }
            Refit::Withdraw => {
                chosen.pop();
                cut_short = true;
                break ranking;
            }
        }
        steps.push(Step { added, ranking });
    };
    let last = refitted.as_ref().unwrap_or(problem);
    let first = steps.first().filter(|_| refitted.is_none());
    let (findings, removed) = match stop() {
        true => (as_added(&steps, apart), Vec::new()),
        false => prune(last, &mut chosen, first, settings, &Context { stop, apart })?,
    };
    if steps.iter().map(|s| s.added).ne(chosen.iter().copied()) {
        remaining = evaluate(last, &chosen, settings)?;
    }
    Ok(Outcome { steps, findings, removed, remaining, refitted, cut_short })
}

/// The findings of the steps, each with only the effects added before it in the base.
fn as_added(steps: &[Step], apart: Apart) -> Vec<Finding> {
    let before = |i: usize| steps[..i].iter().map(|s| s.added).collect::<Vec<Chosen>>();
    let one = |(i, step): (usize, &Step)| Finding {
        chosen: step.added,
        ranking: step.ranking.clone(),
        problem: apart(&before(i)),
    };
    steps.iter().enumerate().map(one).collect()
}

/// What removal depends on beside the problem.
struct Context<'a> {
    stop: Stop<'a>,
    apart: Apart<'a>,
}

/// An effect judged with the `others` in the base; where it fails, once more in the problem that `apart` has for these.
fn judged(
    chosen: Chosen,
    others: &[Chosen],
    problem: &Problem,
    settings: &Settings,
    apart: Apart,
) -> Result<Finding, Error> {
    let ranking = evaluate(problem, others, settings)?;
    if !ranking.of(chosen.candidate).is_some_and(|a| a.passes(settings))
        && let Some(own) = apart(others)
    {
        return Ok(Finding { chosen, ranking: evaluate(&own, others, settings)?, problem: Some(own) });
    }
    Ok(Finding { chosen, ranking, problem: None })
}

/// Judge every chosen effect given the others: remove those that explain nothing more, exchange those that another
/// candidate replaces with more evidence.
fn prune(
    problem: &Problem,
    chosen: &mut Vec<Chosen>,
    first: Option<&Step>,
    settings: &Settings,
    context: &Context,
) -> Result<(Vec<Finding>, Vec<Chosen>), Error> {
    let mut removed = Vec::new();
    if let ([one], Some(step)) = (chosen.as_slice(), first) {
        return Ok((vec![Finding { chosen: *one, ranking: step.ranking.clone(), problem: None }], removed));
    }
    for round in 0.. {
        let mut findings = Vec::new();
        for (i, &c) in chosen.iter().enumerate() {
            let others: Vec<Chosen> = chosen.iter().enumerate().filter(|(k, _)| *k != i).map(|(_, c)| *c).collect();
            findings.push(judged(c, &others, problem, settings, context.apart)?);
        }
        let p = |f: &Finding| match f.ranking.of(f.chosen.candidate) {
            Some(a) if a.passes(settings) => a.p_adjusted,
            _ => f64::INFINITY,
        };
        let fails = findings.iter().position(|f| p(f).is_infinite());
        if let Some(i) = fails {
            removed.push(chosen.remove(i));
            continue;
        }
        let better = findings.iter().enumerate().find_map(|(i, f)| {
            let winner = f.ranking.winner()?;
            let best = Chosen { candidate: winner.candidate, variant: winner.variant };
            (best.candidate != f.chosen.candidate).then_some((i, best))
        });
        match better.filter(|_| round < settings.max_steps && !(context.stop)()) {
            Some((i, best)) => removed.push(std::mem::replace(&mut chosen[i], best)),
            None => return Ok((findings, removed)),
        }
    }
    Ok((Vec::new(), removed))
}
