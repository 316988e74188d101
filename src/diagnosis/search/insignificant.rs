//! The effect that explains most alone, where something is missing and no effect is significant, or one leaves it open.
//!
//! Few blocks of time, or parameters of the model that imitate an effect, leave its p value large and its usual size
//! invisible. That something is missing is clear nevertheless where the error exceeds the noise in both the fitted and the
//! validation data, and an effect that explains most of it there is a better answer than none. So is cogging where both have
//! the same line over the angle of a motor, which is noise with a memory to the whitened ranking. And where the first of
//! several effects that promise as much leaves more than noise, another one may leave none. So may one that promises more
//! alone than the named one does, which parameters of the model imitate better. Next to effects that are named, one more that
//! explains most of what they leave is named by the same measure.

use super::standing::Standing;
use super::{Search, with_effects};
use crate::diagnosis::DiagnosisError;
use crate::diagnosis::judge::Judged;
use crate::diagnosis::orders;
use crate::diagnosis::progress::Progress;
use crate::effects::cogging;
use crate::evidence::{Assessment, Chosen, Ranking};
use crate::identification::fit::FitError;

/// Number of effects that are fitted.
const FITTED: usize = 3;

/// Least share of the error above the noise that an effect must promise on the fitted data, and explain on the validation
/// data; and that lines must explain there on the drives that have them, fainter where a controller is too slow for them.
const PROMISED: f64 = 0.3;
const EXPLAINED: f64 = 0.7;
const BY_LINES: f64 = 0.3;

/// Largest ratio of what a rival leaves above the noise to what the named effect leaves: promised on the fitted data, and
/// found on the validation data. There the difference must be a share of the noise as well, whose energy varies.
const OUTPROMISED: f64 = 0.75;
const OUTDONE: f64 = 0.7;
const BEYOND_CHANCE: f64 = 0.02;

impl Search<'_> {
    /// The effect that explains most alone, if `standing` names one at most and leaves more than noise.
    pub(super) fn or_alone(
        &self,
        standing: Standing,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<Standing, DiagnosisError> {
        let before = self.left(&standing.end);
        let alternatives = match self.is_open(&standing) {
            true => self.alternatives(&standing, before),
            false => Vec::new(),
        };
        let alternatives = alternatives.into_iter().map(|(chosen, least)| (vec![chosen], least)).collect();
        let fit = |chosen: &[Chosen]| self.refit(chosen, self.all.as_ref());
        let found = self.best_of(alternatives, &fit, before, progress)?;
        Ok(found.filter(|found| !found.outcome.findings.is_empty()).unwrap_or(standing))
    }

    /// What `standing` names, with the effect that explains most of what is left next to it, significant or not.
    pub(super) fn and_more(
        &self,
        standing: Standing,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<Standing, DiagnosisError> {
        let named: Vec<Chosen> = standing.outcome.chosen();
        // Too short a recording does not determine the model: a second effect only stands for its parameters.
        let is_short = standing.outcome.remaining.too_few.is_some();
        if named.is_empty()
            || is_short
            || !self.is_open(&standing)
            || !self.judge.is_more_than_noise(standing.end.rms())
        {
            return Ok(standing);
        }
        let before = self.left(&standing.end);
        let mut more: Vec<(Chosen, f64)> = self.lines(&standing.end).into_iter().collect();
        let promising = self.most_promising(&standing.outcome.remaining);
        more.extend(promising.into_iter().map(|c| (c, EXPLAINED * before)));
        more.retain(|(c, _)| named.iter().all(|n| n.candidate != c.candidate));
        let more = more.into_iter().map(|(c, least)| ([&named[..], &[c]].concat(), least)).collect();
        let fit = |chosen: &[Chosen]| {
            let newest = &chosen[named.len()..];
            let ranking = Some(&standing.outcome.remaining);
            let begun = with_effects(&standing.end.fit.model, self.candidates, newest, ranking);
            self.fits.of(chosen, || self.fit(&begun, chosen))
        };
        let found = self.best_of(more, &fit, before, progress)?;
        Ok(found.filter(|found| found.outcome.findings.len() > named.len()).unwrap_or(standing))
    }

    /// Whether more may be found than what is `standing`.
    fn is_open(&self, standing: &Standing) -> bool {
        standing.not_tried.is_empty() && self.settings.max_steps > 0 && !self.judge.fitting.is_late()
    }

    /// What is confirmed of those effects whose fit leaves least of the validation data, if they gain their least share of what
    /// was left `before`.
    fn best_of(
        &self,
        effects: Vec<(Vec<Chosen>, f64)>,
        fit: &dyn Fn(&[Chosen]) -> Result<Judged, FitError>,
        before: f64,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<Option<Standing>, DiagnosisError> {
        let mut best: Option<(f64, Vec<Chosen>, Judged)> = None;
        for (chosen, least) in effects {
            let alone = if chosen.len() == 1 { " alone" } else { "" };
            progress(Progress::Step(&format!("refit with {}{alone}", self.names(&chosen).join(", "))));
            // Effects with which no machine can be fitted are left out.
            let Ok(fitted) = fit(&chosen) else { continue };
            let left = self.left(&fitted);
            if before - left >= least && best.as_ref().is_none_or(|(least, ..)| left < *least) {
                best = Some((left, chosen, fitted));
            }
        }
        let Some((_, chosen, end)) = best else { return Ok(None) };
        let outcome = self.given(&chosen, &end.fit)?;
        Ok(Some(self.confirm_some(outcome, end)?))
    }

    /// Effects that may stand in place of what is named, each with its least gain on the validation data, where `before` is
    /// left above the noise.
    fn alternatives(&self, standing: &Standing, before: f64) -> Vec<(Chosen, f64)> {
        let judge = self.judge;
        let named: Vec<usize> = standing.outcome.findings.iter().map(|f| f.chosen.candidate).collect();
        // An effect that does not follow the validation data alone may stand for another one.
        let (is_open, mut all) = match named[..] {
            [] if judge.leaves_more(&standing.end) => (true, self.lines(&standing.end).into_iter().collect()),
            [one] => {
                let least = f64::max((1.0 - OUTDONE) * before, BEYOND_CHANCE * judge.floor.len() as f64);
                let rivals = if before > least { self.outpromising(one) } else { Vec::new() };
                let rivals = rivals.into_iter().map(|c| (c, least)).collect();
                (judge.is_more_than_noise(standing.end.rms()), rivals)
            }
            _ => (false, Vec::new()),
        };
        let known: Vec<usize> = named.into_iter().chain(all.iter().map(|(c, _)| c.candidate)).collect();
        let promising = match self.all.as_ref().filter(|_| is_open) {
            Some(all) => self.most_promising(all),
            None => Vec::new(),
        };
        all.extend(promising.into_iter().filter(|c| !known.contains(&c.candidate)).map(|c| (c, EXPLAINED * before)));
        all
    }

    /// Cogging, if the residuals of drives have a line over the angles of their motors, with its least gain: a share of what
    /// these drives have above the noise.
    fn lines(&self, end: &Judged) -> Option<(Chosen, f64)> {
        let cogging = self.candidates.iter().position(|shapes| shapes[0].effect.name() == cogging::NAME)?;
        let floor = &self.judge.floor;
        let with_line = (0..floor.len()).filter(|&c| orders::have_line(end, self.judge, c));
        let above: f64 = with_line.map(|c| (end.rms()[c] / floor[c]).powi(2) - 1.0).sum();
        (above > 0.0).then_some((Chosen { candidate: cogging, variant: 0 }, BY_LINES * above))
    }

    /// Effects that promise most in a ranking, significant or not, best first.
    fn most_promising(&self, ranking: &Ranking) -> Vec<Chosen> {
        let whole = self.above(ranking.energy(&ranking.sum_of_squares));
        self.promising(ranking, (1.0 - PROMISED) * whole)
    }

    /// Effects that promise clearly more alone than the candidate `named`, best first.
    fn outpromising(&self, named: usize) -> Vec<Chosen> {
        let Some(all) = &self.all else { return Vec::new() };
        let own = all.of(named);
        own.map_or_else(Vec::new, |a| self.promising(all, OUTPROMISED * self.above(all.energy(&a.sum_of_squares))))
    }

    /// Effects that promise to leave at most so much above the noise of the fitted data, best first.
    fn promising(&self, ranking: &Ranking, most: f64) -> Vec<Chosen> {
        let left = |a: &Assessment| self.above(ranking.energy(&a.sum_of_squares));
        let is_possible = |a: &&Assessment| a.rank > 0 && !self.is_in_model(&a.name);
        let mut promising: Vec<&Assessment> = ranking.candidates.iter().filter(is_possible).collect();
        promising.retain(|a| left(a) <= most);
        promising.sort_by(|a, b| left(a).total_cmp(&left(b)));
        promising.into_iter().take(FITTED).map(Assessment::chosen).collect()
    }
}
