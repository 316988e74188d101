//! Forward selection of effects with backward elimination.

use std::sync::Arc;

use super::Error;
use super::evaluate::{evaluate, evaluate_for, evaluate_in_the_rest};
use super::problem::{Chosen, Problem, Settings};
use super::ranking::{Assessment, Ranking};
use super::stop::{NEVER, Stop};

/// One effect added.
#[derive(Clone, Debug)]
pub struct Step {
    /// The added effect.
    pub added: Chosen,
    /// Assessment of all candidates before the addition.
    pub ranking: Ranking,
}

/// A retained effect, assessed with the other found effects in the base.
#[derive(Clone, Debug)]
pub struct Finding {
    /// The effect.
    pub chosen: Chosen,
    /// Assessment of it and of all others; its confidence set contains the effects that it cannot be distinguished
    /// from.
    pub ranking: Ranking,
    /// The problem in which it was assessed, if that is not the last refitted one.
    pub problem: Option<Arc<Problem>>,
}

impl Finding {
    /// Whether the effect is significant and relevant.
    fn passes(&self, settings: &Settings) -> bool {
        self.ranking.of(self.chosen.candidate).is_some_and(|a| a.passes(settings))
    }
}

/// The problem linearised at the fit with some effects where consistency constraints restrict the parameters, or else `None`.
pub type Held<'a> = &'a dyn Fn(&[Chosen]) -> Result<Option<Problem>, String>;

/// Nothing restricts the parameters.
pub const FREE: Held = &|_| Ok(None);

/// Answer of the caller after an effect was added.
pub enum Refit {
    /// The problem stays as it is.
    Same,
    /// The problem is linearised at better parameters.
    New(Box<Problem>),
    /// The effect is withdrawn, and there is no time to look for another.
    Withdraw,
    /// The effect is withdrawn because it explains too little; the selection ends without it.
    Negligible,
}

/// Result of the selection.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Effects in the order they were added.
    pub steps: Vec<Step>,
    /// Retained effects, in the order they were added.
    pub findings: Vec<Finding>,
    /// Effects removed because others explain the same part of the error.
    pub removed: Vec<Chosen>,
    /// Assessment with all found effects in the base.
    pub remaining: Ranking,
    /// The problem as last refitted; `None` without a refit.
    pub refitted: Option<Problem>,
    /// Whether the selection was stopped while a candidate still passed.
    pub cut_short: bool,
    /// Times all candidates were assessed.
    pub rankings: usize,
}

impl Outcome {
    /// The retained effects, in the order they were added.
    pub fn chosen(&self) -> Vec<Chosen> {
        self.findings.iter().map(|f| f.chosen).collect()
    }

    /// Indices of the found candidates.
    pub fn found(&self) -> Vec<usize> {
        self.findings.iter().map(|f| f.chosen.candidate).collect()
    }
}

/// Selection on a problem that is not refitted.
///
/// # Errors
/// As [`evaluate()`].
pub fn select(problem: &Problem, settings: &Settings) -> Result<Outcome, Error> {
    select_with(problem, settings, NEVER, |_, _| Ok(Refit::Same), FREE, &[])
}

/// Outcome with the `chosen` effects, significant or not, in the problem `refitted` with them and the noise that they leave; an
/// effect that fails there in the problem that is `held` without it.
///
/// # Errors
/// As [`evaluate()`]; also if `held` fails.
pub fn given(refitted: Problem, chosen: &[Chosen], settings: &Settings, held: Held) -> Result<Outcome, Error> {
    let finding = |own: &Chosen| {
        let others = others(chosen, *own);
        let ranking = evaluate_in_the_rest(&refitted, *own, &others, settings)?;
        let finding = Finding { chosen: *own, ranking, problem: None };
        or_held(finding, &others, settings, held)
    };
    let findings = chosen.iter().map(finding).collect::<Result<Vec<Finding>, Error>>()?;
    let remaining = evaluate(&refitted, chosen, settings)?;
    let rankings = 1 + findings.iter().map(assessments).sum::<usize>();
    let refitted = Some(refitted);
    Ok(Outcome { steps: Vec::new(), findings, removed: Vec::new(), remaining, refitted, cut_short: false, rankings })
}

/// Times all candidates were assessed for a finding.
fn assessments(finding: &Finding) -> usize {
    1 + usize::from(finding.problem.is_some())
}

/// A finding, or if its effect fails, the one in the problem that is `held` with the `others`: active constraints restrict the
/// parameters there, which would otherwise explain the contribution of the effect.
fn or_held(finding: Finding, others: &[Chosen], settings: &Settings, held: Held) -> Result<Finding, Error> {
    if finding.passes(settings) {
        return Ok(finding);
    }
    let Some(problem) = held(others).map_err(Error::Refit)? else { return Ok(finding) };
    let ranking = evaluate(&problem, others, settings)?;
    Ok(Finding { ranking, problem: Some(Arc::new(problem)), ..finding })
}

/// The chosen effects without `own`.
pub(crate) fn others(chosen: &[Chosen], own: Chosen) -> Vec<Chosen> {
    chosen.iter().copied().filter(|c| *c != own).collect()
}

/// Selection with a refit. After every addition `refit` receives the effects in the base and the last ranking, and
/// may return the problem linearised at better parameters, with the same candidates in the same order. Once `stop`
/// returns true, no effect is added or exchanged, and every effect is assessed given those added before it.
///
/// An effect that fails in the refitted problem is assessed in the one that is `held` with the others. There, parameters are
/// restricted by active constraints; without these constraints, the parameters would explain the contribution of the effect.
///
/// The effects of `begun` are added first, without being asked for, and refitted together.
///
/// # Errors
/// As [`evaluate()`]; also if the refit fails or returns other candidates.
pub fn select_with<F>(
    problem: &Problem,
    settings: &Settings,
    stop: Stop,
    mut refit: F,
    held: Held,
    begun: &[Chosen],
) -> Result<Outcome, Error>
where
    F: FnMut(&[Chosen], &Ranking) -> Result<Refit, String>,
{
    let mut refitted: Option<Problem> = None;
    let mut chosen: Vec<Chosen> = Vec::new();
    let mut steps = Vec::new();
    let (mut cut_short, mut rankings) = (false, 0);
    let mut remaining = loop {
        rankings += 1;
        let ranking = evaluate(refitted.as_ref().unwrap_or(problem), &chosen, settings)?;
        let best = ranking.winner().filter(|_| steps.len() < settings.max_steps);
        let best = best.map(Assessment::chosen);
        let Some(added) = begun.get(steps.len()).copied().or(best) else { break ranking };
        if stop() {
            cut_short = true;
            break ranking;
        }
        chosen.push(added);
        let answer = if chosen.len() < begun.len() { Ok(Refit::Same) } else { refit(&chosen, &ranking) };
        match answer.map_err(Error::Refit)? {
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
            Refit::Negligible => {
                chosen.pop();
                break ranking;
            }
        }
        steps.push(Step { added, ranking });
    };
    let last = refitted.as_ref().unwrap_or(problem);
    let first = steps.first().filter(|_| refitted.is_none());
    let (findings, removed) = match stop() {
        true => (as_added(&steps, held)?, Vec::new()),
        false => {
            let held: Held = if refitted.is_some() { held } else { FREE };
            prune((last, held), &mut chosen, first, (settings, stop), &mut rankings)?
        }
    };
    if steps.iter().map(|s| s.added).ne(chosen.iter().copied()) {
        rankings += 1;
        remaining = evaluate(last, &chosen, settings)?;
    }
    Ok(Outcome { steps, findings, removed, remaining, refitted, cut_short, rankings })
}

/// Findings of the steps, each with only the effects added before it in the base; the first one in the problem as stated if that
/// is `held`.
fn as_added(steps: &[Step], held: Held) -> Result<Vec<Finding>, Error> {
    let mut findings: Vec<Finding> =
        steps.iter().map(|step| Finding { chosen: step.added, ranking: step.ranking.clone(), problem: None }).collect();
    if let Some(first) = findings.first_mut() {
        first.problem = held(&[]).map_err(Error::Refit)?.map(Arc::new);
    }
    Ok(findings)
}

/// Finding of an effect with the `others` in the base.
fn judged(
    chosen: Chosen,
    others: &[Chosen],
    (problem, held): (&Problem, Held),
    (settings, stop): (&Settings, Stop),
) -> Result<Finding, Error> {
    // Where it will not be exchanged for a better one, its rivals are compared with it.
    let own = stop().then_some(chosen.candidate);
    let ranking = evaluate_for(problem, others, own, settings)?;
    or_held(Finding { chosen, ranking, problem: None }, others, settings, held)
}

/// Assesses every chosen effect given the others: removes those that explain nothing more, and exchanges those for
/// which another candidate has more evidence.
/// Counts the assessments of all candidates in `rankings`.
fn prune(
    (problem, held): (&Problem, Held),
    chosen: &mut Vec<Chosen>,
    first: Option<&Step>,
    (settings, stop): (&Settings, Stop),
    rankings: &mut usize,
) -> Result<(Vec<Finding>, Vec<Chosen>), Error> {
    let mut removed = Vec::new();
    if let ([one], Some(step)) = (chosen.as_slice(), first) {
        return Ok((vec![Finding { chosen: *one, ranking: step.ranking.clone(), problem: None }], removed));
    }
    for round in 0.. {
        let (mut findings, mut failed) = (Vec::new(), None);
        for (i, &c) in chosen.iter().enumerate() {
            let finding = judged(c, &others(chosen, c), (problem, held), (settings, stop))?;
            *rankings += assessments(&finding);
            if !finding.passes(settings) {
                failed = Some(i);
                break;
            }
            findings.push(finding);
        }
        // Without it the others are assessed anew.
        if let Some(i) = failed {
            removed.push(chosen.remove(i));
            continue;
        }
        let better = findings.iter().enumerate().find_map(|(i, f)| {
            let winner = f.ranking.winner()?;
            let best = winner.chosen();
            (best.candidate != f.chosen.candidate).then_some((i, best))
        });
        match better.filter(|_| round < settings.max_steps && !stop()) {
            Some((i, best)) => removed.push(std::mem::replace(&mut chosen[i], best)),
            None => return Ok((findings, removed)),
        }
    }
    Ok((Vec::new(), removed))
}
