//! The effect that explains most alone, where something is missing and no effect is significant, or one leaves it open.
//!
//! Few blocks of time, or parameters of the model that imitate an effect, leave its p value large and its usual size
//! invisible. That something is missing is clear nevertheless where the error exceeds the noise in both the fitted and the
//! validation data, and an effect that explains most of it there is a better answer than none. So is cogging where both have
//! the same line over the angle of a motor, which is noise with a memory to the whitened ranking. And where the first of
//! several effects that promise as much leaves more than noise, another one may leave none.

use super::Search;
use super::standing::Standing;
use crate::diagnosis::DiagnosisError;
use crate::diagnosis::judge::{Judged, relative_energy};
use crate::diagnosis::orders;
use crate::diagnosis::progress::Progress;
use crate::effects::cogging;
use crate::evidence::{self, Assessment, Chosen};

/// Number of effects that are fitted.
const FITTED: usize = 3;

/// Least share of the error above the noise that an effect must promise on the fitted data, and explain on the validation
/// data; and that lines must explain there, which are fainter where a controller is too slow for them.
const PROMISED: f64 = 0.3;
const EXPLAINED: f64 = 0.7;
const BY_LINES: f64 = 0.3;

impl Search<'_> {
    /// The effect that explains most alone, if `standing` names one at most and leaves more than noise.
    pub(super) fn or_alone(
        &self,
        standing: Standing,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<Standing, DiagnosisError> {
        let judge = self.judge;
        let named: Vec<usize> = standing.outcome.findings.iter().map(|f| f.chosen.candidate).collect();
        // An effect that does not follow the validation data alone may stand for another one.
        let is_open = match named[..] {
            [] => judge.leaves_more(&standing.end),
            [_] => judge.is_more_than_noise(standing.end.rms()),
            _ => false,
        };
        if !is_open || !standing.not_tried.is_empty() || self.settings.max_steps == 0 || judge.fitting.is_late() {
            return Ok(standing);
        }
        let above = |judged: &Judged| self.above(relative_energy(judged.rms(), &judge.floor));
        let before = above(&standing.end);
        let lines = if named.is_empty() { self.lines(&standing.end) } else { None }.map(|chosen| (chosen, BY_LINES));
        let mut best: Option<(f64, Chosen, Judged)> = None;
        let promising = self.most_promising().into_iter().map(|chosen| (chosen, EXPLAINED));
        for (chosen, least) in lines.into_iter().chain(promising).filter(|(c, _)| !named.contains(&c.candidate)) {
            progress(Progress::Step(&format!("refit with {} alone", self.shape(&chosen).effect.name())));
            // An effect with which no machine can be fitted is left out.
            let Ok(fitted) = self.refit(&[chosen], self.all.as_ref()) else { continue };
            let left = above(&fitted);
            if left <= (1.0 - least) * before && best.as_ref().is_none_or(|(least, ..)| left < *least) {
                best = Some((left, chosen, fitted));
            }
        }
        let Some((_, chosen, end)) = best else { return Ok(standing) };
        let refitted = self.relinearised(&end.fit, &self.problem, &[chosen])?;
        let outcome = evidence::single(refitted, chosen, &self.settings)?;
        judge.fitting.count_rankings(outcome.rankings);
        let found = self.confirm_some(outcome, end)?;
        Ok(if found.outcome.findings.is_empty() { standing } else { found })
    }

    /// Cogging, if the residuals of a drive have a line over the angle of its motor.
    fn lines(&self, end: &Judged) -> Option<Chosen> {
        let has_line = || (0..self.judge.floor.len()).any(|c| orders::have_line(end, self.judge, c));
        let cogging = self.candidates.iter().position(|shapes| shapes[0].effect.name() == cogging::NAME);
        cogging.filter(|_| has_line()).map(|candidate| Chosen { candidate, variant: 0 })
    }

    /// Effects that promise most alone, significant or not, best first.
    fn most_promising(&self) -> Vec<Chosen> {
        let Some(all) = &self.all else { return Vec::new() };
        let whole = self.above(all.energy(&all.sum_of_squares));
        let left = |a: &Assessment| self.above(all.energy(&a.sum_of_squares));
        let is_possible = |a: &&Assessment| a.rank > 0 && !self.is_in_model(&a.name);
        let mut promising: Vec<&Assessment> = all.candidates.iter().filter(is_possible).collect();
        promising.retain(|a| left(a) <= (1.0 - PROMISED) * whole);
        promising.sort_by(|a, b| left(a).total_cmp(&left(b)));
        let chosen = |a: &&Assessment| Chosen { candidate: a.candidate, variant: a.variant };
        promising.iter().take(FITTED).map(chosen).collect()
    }
}
