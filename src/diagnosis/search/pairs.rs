//! Selections that begin with two effects at once, for errors that forward selection explains with a third one.

use std::cell::OnceCell;

use super::standing::Standing;
use super::{Refitted, Search, Selection, begun_with};
use crate::diagnosis::DiagnosisError;
use crate::diagnosis::judge::{Judged, relative_energy};
use crate::diagnosis::progress::Progress;
use crate::evidence::{self, Chosen, Outcome, Pair, Ranking, Settings};
use crate::identification::fit::FitError;

/// Number of pairs that are fitted, of those by plain least squares and of the others.
const FITTED: usize = 2;

/// Error above the noise, in units of the noise, up to which the linear problem may promise that nothing else is left.
const HARDLY_MORE: f64 = 2.0;

/// Share of the error above the noise of the validation data that is hardly more than none.
const LITTLE: f64 = 0.05;

/// Share of the error above the noise by which one explanation must leave less than another to be preferred.
pub(super) const CLEARLY_LESS: f64 = 0.1;

/// Two effects to be fitted together.
pub(super) struct Proposed {
    pair: Pair,
    /// Whether plain least squares propose them. These neglect that noise has a memory: only a pair that leaves hardly more than
    /// noise is worth having then.
    is_plain: bool,
}

impl Search<'_> {
    /// Pairs of effects of the linear problem, best first; none if the statistics fail. The fit with an effect and the ranking
    /// `beside` it add the best pair of that effect. Pairs by plain least squares are among them that leave clearly less, and hardly
    /// more than noise.
    fn pairs(&self, alone: &Ranking, beside: Option<(Chosen, &Ranking)>) -> &[Proposed] {
        self.pairs.get_or_init(|| {
            let of = |alone: &Ranking, settings: &Settings| {
                let late = || self.judge.fitting.is_late();
                let pairs = evidence::pairs(&self.problem, alone, settings, &late).unwrap_or_default();
                self.judge.fitting.count_rankings(pairs.len());
                pairs
            };
            let in_model = |c: &Chosen| self.is_in_model(&self.problem.candidates[c.candidate].name);
            let fitted = beside.and_then(|(first, ranking)| {
                let (left, second) = *ranking.by_energy(&self.settings).first()?;
                Some(Pair { chosen: [first, second], left })
            });
            let mut pairs = of(alone, &self.settings);
            pairs.retain(|p| beside.is_none_or(|(first, _)| p.chosen[0] != first));
            let own = fitted.as_ref().map(|own| own.chosen);
            pairs.extend(fitted);
            let least = pairs.iter().map(|p| p.left).fold(f64::INFINITY, f64::min);
            let slow =
                if self.above(least) > self.hardly_more() { self.slow_pairs(own, least, &of) } else { Vec::new() };
            let proposed = |is_plain: bool| move |pair: Pair| Proposed { pair, is_plain };
            let slow = slow.into_iter().map(proposed(true));
            let mut pairs: Vec<Proposed> = pairs.into_iter().map(proposed(false)).chain(slow).collect();
            pairs.retain(|p| !p.pair.chosen.iter().any(in_model));
            pairs.sort_by(|a, b| a.pair.left.total_cmp(&b.pair.left));
            pairs
        })
    }

    /// Pairs by plain least squares, in white noise, that promise hardly more than noise, and clearly less than `least` and than
    /// they do of the `own` pair. Two large effects that are slow are noise to the filter that whitens what the model leaves, and
    /// no effect alone passes it.
    fn slow_pairs(
        &self,
        own: Option<[Chosen; 2]>,
        least: f64,
        of: &dyn Fn(&Ranking, &Settings) -> Vec<Pair>,
    ) -> Vec<Pair> {
        let plain = Settings { max_order: 0, ..self.settings.clone() };
        let ranked = |chosen: &[Chosen]| evidence::evaluate(&self.problem, chosen, &plain).ok();
        let own_left = own.and_then(|[first, second]| {
            let ranking = ranked(&[first])?;
            Some(ranking.energy(&ranking.of(second.candidate)?.sum_of_squares))
        });
        self.judge.fitting.count_rankings(1 + usize::from(own.is_some()));
        let least = own_left.map_or(least, |own| own.min(least));
        let most = f64::min((1.0 - CLEARLY_LESS) * self.above(least), self.hardly_more());
        let mut slow = ranked(&[]).map_or_else(Vec::new, |alone| of(&alone, &plain));
        slow.retain(|p| self.above(p.left) < most);
        slow
    }

    /// Energy above the noise that is hardly more than none.
    fn hardly_more(&self) -> f64 {
        HARDLY_MORE * self.judge.floor.len() as f64
    }

    /// Whether another pair than the first two `chosen` effects promises to leave clearly less of the error above the
    /// noise than they do in `ranking`, before they are fitted, and than the fit with the first one leaves, if that is made.
    pub(super) fn has_better_pairs(
        &self,
        chosen: &[Chosen],
        alone: &Ranking,
        ranking: &Ranking,
        fitted: Option<&Refitted>,
    ) -> bool {
        let [first, second] = chosen else { return false };
        let Some(own) = ranking.of(second.candidate).filter(|_| !self.has_paired) else { return false };
        let by_fit = |(_, first): &Refitted| {
            let series = self.judge.fitting.residual_series(&first.fit.residuals);
            ranking.energy(&self.problem.sum_of_squares(&series))
        };
        let left = fitted.map_or(f64::INFINITY, by_fit).min(ranking.energy(&own.sum_of_squares));
        let better = |Proposed { pair, .. }: &Proposed| {
            let is_other = pair.chosen.iter().any(|c| ![first, second].map(|c| c.candidate).contains(&c.candidate));
            is_other && self.above(pair.left) < (1.0 - CLEARLY_LESS) * self.above(left)
        };
        self.pairs(alone, Some((*first, ranking))).iter().any(better)
    }

    /// Fits the best pairs of effects together and continues the selection from the one that leaves least, once per
    /// starting model. Of what is selected, what is confirmed is kept.
    pub(super) fn try_pairs(&mut self, progress: &mut dyn FnMut(Progress)) -> Result<(), DiagnosisError> {
        let fitting = self.judge.fitting;
        if self.has_paired || self.settings.max_steps < 2 || fitting.is_late() {
            return Ok(());
        }
        self.has_paired = true;
        let Some(alone) = &self.all else { return Ok(()) };
        progress(Progress::Step("pairs of effects"));
        let mut best: Option<(f64, [Chosen; 2], bool)> = None;
        let pairs = self.pairs(alone, None);
        let of = |plain: bool| pairs.iter().filter(move |p| p.is_plain == plain).take(FITTED);
        for Proposed { pair, is_plain } in of(true).chain(of(false)) {
            progress(Progress::Step(&format!("refit with {}", self.names(&pair.chosen).join(" and "))));
            // A pair with which no machine can be fitted is left out.
            let Ok(fitted) = self.fitted_together(&pair.chosen) else { continue };
            let left = relative_energy(&fitted.fit.residuals.rms, &fitting.noise.pooled);
            let is_noise = !self.judge.is_more_than_noise(fitted.rms());
            let is_all = is_noise || self.left(&fitted) < LITTLE * self.left(&self.start);
            if (is_all || !is_plain) && best.is_none_or(|(least, ..)| left < least) {
                best = Some((left, pair.chosen, is_noise || *is_plain));
            }
            if is_noise {
                break;
            }
        }
        let Some((_, pair, is_enough)) = best else { return Ok(()) };
        let keeps_both = |outcome: &Outcome| pair.iter().all(|c| outcome.found().contains(&c.candidate));
        let (outcome, end) = match self.select(&pair, progress)? {
            // What the linear problem exchanges for another effect, the validation data may confirm.
            Selection::Complete(complete) if is_enough && !keeps_both(&complete.0) => {
                let end = self.fitted_together(&pair)?;
                (self.given(&pair, &end.fit)?, end)
            }
            Selection::Complete(complete) => *complete,
            _ => return Ok(()),
        };
        // One effect alone is found with its rivals without the other.
        self.paired = Some(self.confirm_some(outcome, end)?).filter(|standing| standing.without.len() > 1);
        Ok(())
    }

    /// The fit with a pair of effects. It begins at the model as stated: without them the parameters imitate both, and may
    /// lie at edges of the possible.
    fn fitted_together(&self, pair: &[Chosen]) -> Result<Judged, FitError> {
        let model = self.stated_model();
        let make = || self.fit(&begun_with(self.judge.fitting, [&model; 2], self.candidates, pair, None)?, pair);
        self.fits.of(pair, make)
    }

    /// Nothing is known of pairs with another starting model.
    pub(super) fn forget_pairs(&mut self) {
        (self.pairs, self.has_paired, self.paired) = (OnceCell::new(), false, None);
    }

    /// The selection that began with a pair if it explains everything above the noise.
    pub(super) fn clear_pairs(&mut self) -> Option<Standing> {
        self.paired.take_if(|paired| !self.judge.is_more_than_noise(paired.end.rms()))
    }

    /// The selection that began with a pair if it leaves clearly less of the error above the noise than `standing`.
    pub(super) fn better_of(&mut self, standing: Standing) -> Standing {
        let most = (1.0 - CLEARLY_LESS) * self.left(&standing.end);
        let is_better = self.paired.as_ref().is_some_and(|p| self.left(&p.end) < most);
        self.paired.take().filter(|_| is_better).unwrap_or(standing)
    }
}
