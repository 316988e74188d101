//! Rivals of a single named effect, each fitted like it.
//!
//! In the problem linearised with the named effect, the columns of a rival are those of the model as stated: a rival that
//! enters nonlinearly may seem worse there than it is. And one that explains another, faster part of the error may seem as
//! good to the whitened evidence. A fit of its own decides by the losses on the validation data.

use super::Search;
use super::standing::Standing;
use crate::diagnosis::DiagnosisError;
use crate::diagnosis::progress::Progress;
use crate::evidence::{self, Assessment, Chosen};

/// Number of rivals that are fitted: of those that the problem as stated cannot exclude, and of those that explain less.
const FITTED: usize = 2;
const LESSER: usize = 5;

impl Search<'_> {
    /// The named effect of `standing`, or the rival that fits better; those that fit as well are marked as such.
    pub(super) fn or_rival(
        &self,
        mut standing: Standing,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<Standing, DiagnosisError> {
        let judge = self.judge;
        let (mut fit, mut as_good): (Vec<usize>, Vec<usize>) = Default::default();
        for rival in self.unfitted(&standing) {
            if judge.fitting.is_late() {
                break;
            }
            progress(Progress::Step(&format!("refit with {} instead", self.shape(&rival).effect.name())));
            // A rival with which no machine can be fitted, or that is not confirmed, is none.
            let Ok(fitted) = self.refit(&[rival], self.all.as_ref()) else { continue };
            fit.push(rival.candidate);
            if self.stand(&[rival], &fitted)?.is_err() {
                continue;
            }
            let (t, critical) = judge.compare(&standing.end, &fitted);
            if t.is_nan() || t >= critical {
                continue;
            }
            if t > -critical {
                as_good.push(rival.candidate);
                continue;
            }
            let refitted = self.relinearised(&fitted.fit, &self.problem, &[rival])?;
            let outcome = evidence::single(refitted, rival, &self.settings)?;
            judge.fitting.count_rankings(outcome.rankings);
            as_good.clear();
            standing = Standing { outcome, end: fitted, ..standing };
        }
        for finding in &mut standing.outcome.findings {
            let own = finding.chosen.candidate;
            let rivals = finding.ranking.candidates.iter_mut();
            let rivals = rivals.filter(|a| a.candidate != own && fit.contains(&a.candidate));
            rivals.for_each(|a| a.indistinguishable = as_good.contains(&a.candidate));
        }
        Ok(standing)
    }

    /// Rivals of the only effect of `standing` in the problem as stated that the problem linearised with it excludes, and those
    /// in the linearised problem that explain plainly less than it.
    fn unfitted(&self, standing: &Standing) -> Vec<Chosen> {
        let [finding] = &standing.outcome.findings[..] else { return Vec::new() };
        let Some(all) = self.all.as_ref().filter(|_| standing.not_tried.is_empty()) else { return Vec::new() };
        let is = |a: &&Assessment, c: &Chosen| a.candidate == c.candidate;
        let linearised = finding.ranking.confidence_set();
        let chosen = |a: &&Assessment| Chosen { candidate: a.candidate, variant: a.variant };
        let open = all.confidence_set().into_iter().filter(|a| !self.is_in_model(&a.name)).map(|a| chosen(&a));
        let open = open.filter(|c| *c != finding.chosen && !linearised.iter().any(|a| is(a, c))).take(FITTED);
        let lesser = finding.ranking.lesser();
        open.chain(lesser.iter().filter(|a| a.candidate != finding.chosen.candidate).map(chosen).take(LESSER)).collect()
    }
}
