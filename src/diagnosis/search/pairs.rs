//! Selections that begin with effects that forward selection does not begin with: two at once, where a third one imitates both,
//! or a slow one, which is noise to the filter that whitens what the model leaves.

use std::cell::OnceCell;

use super::standing::Standing;
use super::{Refitted, Search, Selection, begun_with};
use crate::diagnosis::DiagnosisError;
use crate::diagnosis::judge::{Judged, relative_energy};
use crate::diagnosis::progress::Progress;
use crate::evidence::{self, Chosen, Outcome, Pair, Ranking, Settings};
use crate::identification::fit::FitError;

/// Number of proposals that are fitted, of those by plain least squares and of the others.
const FITTED: usize = 2;

/// Error above the noise, in units of the noise, up to which the linear problem may promise that nothing else is left.
const HARDLY_MORE: f64 = 2.0;

/// Share of the error above the noise of the validation data that is hardly more than none.
const LITTLE: f64 = 0.05;

/// Share of the error above the noise by which one explanation must leave less than another to be preferred.
pub(super) const CLEARLY_LESS: f64 = 0.1;

/// Effects to be fitted together, two or one, and the energy that they promise to leave.
pub(super) struct Proposed {
    chosen: Vec<Chosen>,
    left: f64,
    /// Whether plain least squares propose them. These neglect that noise has a memory: only effects that leave hardly more than
    /// noise are worth having then.
    is_plain: bool,
}

impl Proposed {
    fn pair(is_plain: bool) -> impl Fn(Pair) -> Self {
        move |pair| Self { chosen: pair.chosen.to_vec(), left: pair.left, is_plain }
    }
}

impl Search<'_> {
    /// Pairs of effects of the linear problem, best first; none if the statistics fail. The fit with an effect and the ranking
    /// `beside` it add the best pair of that effect. Pairs by plain least squares are among them that leave clearly less, and hardly
    /// more than noise, and the slow effect.
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
            let pairs = pairs.into_iter().map(Proposed::pair(false));
            let mut pairs: Vec<Proposed> = pairs.chain(slow.into_iter().map(Proposed::pair(true))).collect();
            pairs.extend(self.slow_effect(alone));
            pairs.retain(|p| !p.chosen.iter().any(in_model));
            pairs.sort_by(|a, b| a.left.total_cmp(&b.left));
            pairs
        })
    }

    /// The effect that leaves least by plain least squares, if it promises hardly more than none of the error and clearly less than
    /// any does in the ranking `alone`.
    pub(super) fn slow_effect(&self, alone: &Ranking) -> Option<Proposed> {
        let possible = |ranking: &Ranking| {
            let all = ranking.candidates.iter().filter(|a| a.rank > 0 && !self.is_in_model(&a.name));
            let left = all.map(|a| (ranking.energy(&a.sum_of_squares), a.chosen()));
            left.min_by(|a, b| a.0.total_cmp(&b.0))
        };
        let start = self.above(alone.energy(&alone.sum_of_squares));
        if start < self.hardly_more() {
            return None;
        }
        let most = f64::min((1.0 - CLEARLY_LESS) * self.above(possible(alone)?.0), LITTLE * start);
        let plain = self.plainly_ranked(&[])?;
        self.judge.fitting.count_rankings(1);
        let (left, chosen) = possible(&plain)?;
        (self.above(left) < most).then_some(Proposed { chosen: vec![chosen], left, is_plain: true })
    }

    fn plain(&self) -> Settings {
        Settings { max_order: 0, ..self.settings.clone() }
    }

    /// The ranking next to `chosen` effects by plain least squares, as in white noise.
    fn plainly_ranked(&self, chosen: &[Chosen]) -> Option<Ranking> {
        evidence::evaluate(&self.problem, chosen, &self.plain()).ok()
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
        let own_left = own.and_then(|[first, second]| {
            let ranking = self.plainly_ranked(&[first])?;
            Some(ranking.energy(&ranking.of(second.candidate)?.sum_of_squares))
        });
        self.judge.fitting.count_rankings(1 + usize::from(own.is_some()));
        let least = own_left.map_or(least, |own| own.min(least));
        let most = f64::min((1.0 - CLEARLY_LESS) * self.above(least), self.hardly_more());
        let mut slow = self.plainly_ranked(&[]).map_or_else(Vec::new, |alone| of(&alone, &self.plain()));
        slow.retain(|p| self.above(p.left) < most);
        slow
    }

    /// Energy above the noise that is hardly more than none.
    fn hardly_more(&self) -> f64 {
        HARDLY_MORE * self.judge.floor.len() as f64
    }

    /// Whether another pair than the first two `chosen` effects promises to leave clearly less of the error above the
    /// noise than they do in `ranking`, before they are fitted, and than the fit with the first one leaves, if that is made and
    /// leaves anything to be explained.
    pub(super) fn has_better_pairs(
        &self,
        chosen: &[Chosen],
        alone: &Ranking,
        ranking: &Ranking,
        fitted: Option<&Refitted>,
    ) -> bool {
        if chosen.len() == 1 && !self.has_paired {
            return self.slow_effect(alone).is_some();
        }
        let [first, second] = chosen else { return false };
        if fitted.is_some_and(|(_, first)| self.judge.is_noise(first.rms())) {
            return false;
        }
        let Some(own) = ranking.of(second.candidate).filter(|_| !self.has_paired) else { return false };
        let by_fit = |(_, first): &Refitted| {
            let series = self.judge.fitting.residual_series(&first.fit.residuals);
            ranking.energy(&self.problem.sum_of_squares(&series))
        };
        let left = fitted.map_or(f64::INFINITY, by_fit).min(ranking.energy(&own.sum_of_squares));
        let better = |p: &Proposed| {
            let is_other = p.chosen.iter().any(|c| ![first, second].map(|c| c.candidate).contains(&c.candidate));
            is_other && self.above(p.left) < (1.0 - CLEARLY_LESS) * self.above(left)
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
        let mut best: Option<(f64, &[Chosen], bool)> = None;
        let pairs = self.pairs(alone, None);
        let of = |count: usize, plain: bool| {
            pairs.iter().filter(move |p| p.chosen.len() == count && p.is_plain == plain).take(FITTED)
        };
        for Proposed { chosen, is_plain, .. } in of(1, true).chain(of(2, true)).chain(of(2, false)) {
            progress(Progress::Step(&format!("refit with {}", self.names(chosen).join(" and "))));
            // Effects with which no machine can be fitted are left out.
            let Ok(fitted) = self.fitted_together(chosen) else { continue };
            let left = relative_energy(&fitted.fit.residuals.rms, &fitting.noise.pooled);
            let is_noise = !self.judge.is_more_than_noise(fitted.rms());
            let is_better = |(least, known, _): (f64, &[Chosen], bool)| {
                let share = if chosen.len() > known.len() { 1.0 - CLEARLY_LESS } else { 1.0 };
                self.above(left) < share * self.above(least)
            };
            if (self.explains_all(&fitted) || !is_plain) && best.is_none_or(is_better) {
                best = Some((left, chosen, self.explains_all(&fitted)));
            }
            if is_noise {
                break;
            }
        }
        let Some((_, begun, is_enough)) = best else { return Ok(()) };
        let begun = begun.to_vec();
        let keeps_all = |outcome: &Outcome| begun.iter().all(|c| outcome.found().contains(&c.candidate));
        // The last selection may have begun with the same effects.
        let is_same = |(outcome, _): &(Outcome, Judged)| {
            let first: Vec<Chosen> = outcome.steps.iter().take(begun.len()).map(|step| step.added).collect();
            first.len() == begun.len() && first.iter().all(|added| begun.contains(added))
        };
        let mut selected = match self.selected.take().filter(is_same) {
            Some(known) => Selection::Complete(Box::new(known)),
            None => self.select(&begun, progress)?,
        };
        // A delay that was added next to them is the recorder's; one of them may be so only with the others.
        if let Selection::Lag(late, _) = selected {
            if self.without_lag(&begun) != begun {
                return Ok(());
            }
            self.accept_lag(late)?;
            self.has_paired = true;
            selected = self.select(&begun, progress)?;
        }
        let end = self.fitted_together(&begun)?;
        let is_less = |other: &Judged| self.judge.is_clearly_less(end.rms(), other.rms(), CLEARLY_LESS);
        let (outcome, end) = match selected {
            Selection::Complete(complete) if keeps_all(&complete.0) || !(is_enough || is_less(&complete.1)) => {
                *complete
            }
            // The linear problem exchanges them for another effect, or refuses one of them: the validation data decide.
            _ => (self.given(&begun, &end.fit)?, end),
        };
        // One effect of two is found with its rivals without the other.
        self.paired = Some(self.confirm_some(outcome, end)?).filter(|standing| standing.without.len() >= begun.len());
        Ok(())
    }

    /// Whether a fit leaves no more than noise of the validation data, or hardly more than none of the error of the start.
    fn explains_all(&self, fitted: &Judged) -> bool {
        !self.judge.is_more_than_noise(fitted.rms()) || self.left(fitted) < LITTLE * self.left(&self.start)
    }

    /// The fit with effects that are begun with. It begins at the model as stated: without them the parameters imitate both, and may
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

    /// The selection that began with proposed effects if it explains everything above the noise, or hardly less.
    pub(super) fn clear_pairs(&mut self) -> Option<Standing> {
        let is_all = |paired: &Standing| self.explains_all(&paired.end);
        let is_clear = self.paired.as_ref().is_some_and(is_all);
        self.paired.take_if(|_| is_clear)
    }

    /// The selection that began with a pair if it leaves clearly less of the error above the noise than `standing`.
    pub(super) fn better_of(&mut self, standing: Standing) -> Standing {
        let is_less = |p: &Standing| self.judge.is_clearly_less(p.end.rms(), standing.end.rms(), CLEARLY_LESS);
        let is_better = self.paired.as_ref().is_some_and(is_less);
        self.paired.take().filter(|_| is_better).unwrap_or(standing)
    }
}
