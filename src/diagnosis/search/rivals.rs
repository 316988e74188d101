//! Rivals of the named effects, each fitted in place of the effect.
//!
//! In the problem linearised with the named effects, the columns of a rival are those of the model as stated: a rival that
//! enters nonlinearly may seem worse there than it is. And one that explains another, faster part of the error may seem as
//! good to the whitened evidence. A fit of its own decides by the losses on the validation data.

use super::standing::Standing;
use super::{Search, with_effects, without_effects};
use crate::diagnosis::DiagnosisError;
use crate::diagnosis::judge::Judged;
use crate::diagnosis::progress::Progress;
use crate::evidence::{self, Assessment, Chosen, Finding};
use crate::identification::fit::FitError;

/// Number of rivals of a single effect that are fitted: of those that the problem as stated cannot exclude, and of those that
/// explain less; and of each of several effects.
const FITTED: usize = 2;
const LESSER: usize = 5;
const OF_SEVERAL: usize = 3;

/// A rival, fitted in place of a named effect.
enum Fitted {
    /// Not confirmed, or with larger losses than the named effect.
    Worse,
    AsGood,
    /// Its fit has smaller losses.
    Better(Box<Judged>),
}

impl Search<'_> {
    /// The named effects of `standing`, or the rival of a single one that fits better; those that fit as well are marked as such.
    pub(super) fn or_rival(
        &self,
        mut standing: Standing,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<Standing, DiagnosisError> {
        let judge = self.judge;
        let is_single = standing.outcome.findings.len() == 1;
        for i in 0..standing.outcome.findings.len() {
            let (mut fit, mut as_good): (Vec<usize>, Vec<usize>) = Default::default();
            let rivals = if is_single { self.unfitted(&standing) } else { self.of_several(&standing, i) };
            for rival in rivals {
                if judge.fitting.is_late() {
                    break;
                }
                progress(Progress::Step(&format!("refit with {} instead", self.shape(&rival).effect.name())));
                // A rival with which no machine can be fitted is none.
                let Ok(fitted) = self.instead(&standing, i, rival) else { continue };
                fit.push(rival.candidate);
                match fitted {
                    Fitted::Worse => {}
                    Fitted::Better(fitted) if is_single => {
                        let refitted = self.relinearised(&fitted.fit, &self.problem, &[rival])?;
                        let outcome = evidence::given(refitted, &[rival], &self.settings)?;
                        judge.fitting.count_rankings(outcome.rankings);
                        as_good.clear();
                        standing = Standing { outcome, end: *fitted, ..standing };
                    }
                    Fitted::AsGood | Fitted::Better(_) => as_good.push(rival.candidate),
                }
            }
            let finding = &mut standing.outcome.findings[i];
            let own = finding.chosen.candidate;
            let rivals = finding.ranking.candidates.iter_mut();
            let rivals = rivals.filter(|a| a.candidate != own && fit.contains(&a.candidate));
            rivals.for_each(|a| a.indistinguishable = as_good.contains(&a.candidate));
        }
        Ok(standing)
    }

    /// The `rival` in place of the named effect `at` of `standing`, next to the others.
    fn instead(&self, standing: &Standing, at: usize, rival: Chosen) -> Result<Fitted, FitError> {
        let mut chosen: Vec<Chosen> = standing.outcome.findings.iter().map(|f| f.chosen).collect();
        let own = std::mem::replace(&mut chosen[at], rival);
        let fitted = match &chosen[..] {
            [_] => self.refit(&chosen, self.all.as_ref())?,
            _ => {
                let others = without_effects(&standing.end.fit.model, &[self.shape(&own).effect.name()]);
                let ranking = Some(&standing.outcome.findings[at].ranking);
                let begun = with_effects(&others, self.candidates, &[rival], ranking);
                self.fits.of(&chosen, || self.fit(&begun, &chosen))?
            }
        };
        if self.stand(&chosen, &fitted)?.is_err() {
            return Ok(Fitted::Worse);
        }
        let (t, critical) = self.judge.compare(&standing.end, &fitted);
        Ok(match t {
            _ if t.is_nan() || t >= critical => Fitted::Worse,
            _ if t > -critical => Fitted::AsGood,
            _ => Fitted::Better(Box::new(fitted)),
        })
    }

    /// Rivals of the only effect of `standing` in the problem as stated that the problem linearised with it excludes, and those
    /// in the linearised problem that explain plainly less than it.
    fn unfitted(&self, standing: &Standing) -> Vec<Chosen> {
        let [finding] = &standing.outcome.findings[..] else { return Vec::new() };
        let Some(all) = self.all.as_ref().filter(|_| standing.not_tried.is_empty()) else { return Vec::new() };
        let linearised = finding.ranking.confidence_set();
        let open = all.confidence_set().into_iter().filter(|a| !self.is_in_model(&a.name)).map(chosen);
        let is = |a: &Assessment, c: &Chosen| a.candidate == c.candidate;
        let open = open.filter(|c| *c != finding.chosen && !linearised.iter().any(|a| is(a, c))).take(FITTED);
        let lesser = finding.ranking.lesser();
        open.chain(others(lesser, finding).take(LESSER)).collect()
    }

    /// Rivals of one of several effects of `standing`, given the others.
    fn of_several(&self, standing: &Standing, at: usize) -> Vec<Chosen> {
        let finding = &standing.outcome.findings[at];
        match standing.not_tried.is_empty() {
            true => others(finding.ranking.confidence_set(), finding).take(OF_SEVERAL).collect(),
            false => Vec::new(),
        }
    }
}

fn chosen(assessed: &Assessment) -> Chosen {
    Chosen { candidate: assessed.candidate, variant: assessed.variant }
}

/// Candidates of a ranking without that of the finding.
fn others<'a>(all: Vec<&'a Assessment>, finding: &'a Finding) -> impl Iterator<Item = Chosen> + use<'a> {
    all.into_iter().map(chosen).filter(|c| c.candidate != finding.chosen.candidate)
}
