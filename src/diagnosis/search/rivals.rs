//! Rivals of the named effects, each fitted in place of the effect.
//!
//! In the problem linearised with the named effects, the columns of a rival are those of the model as stated: a rival that
//! enters nonlinearly may seem worse there than it is. And one that explains another, faster part of the error may seem as
//! good to the whitened evidence. A fit of its own decides by the losses on the validation data.

use super::lag::TIMES;
use super::pairs::CLEARLY_LESS;
use super::standing::Standing;
use super::{Search, with_effects, without_effects};
use crate::diagnosis::DiagnosisError;
use crate::diagnosis::judge::{Judged, relative_energy};
use crate::diagnosis::progress::Progress;
use crate::evidence::{Assessment, Chosen, Finding};
use crate::identification::fit::FitError;

/// Number of rivals of a single effect that are fitted: of those that the problem as stated cannot exclude, and of those that
/// explain less; and of each of several effects.
const FITTED: usize = 2;
const LESSER: usize = 5;
const OF_SEVERAL: usize = 3;

/// Share of the error that is most of it, and share of the promise of such an effect below which a rival is not fitted.
const MOST: f64 = 0.5;
const HOPELESS: f64 = 0.25;

/// A rival, fitted in place of a named effect.
enum Fitted {
    /// Not confirmed, or with larger losses than the named effect.
    Worse,
    AsGood,
    /// With smaller losses than the named effect, or as good as one of several and with fewer parameters.
    Better(Box<Judged>),
}

impl Search<'_> {
    /// The named effects of `standing`, or the rivals that fit better; those that fit as well are marked as such.
    pub(super) fn or_rival(
        &self,
        mut standing: Standing,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<Standing, DiagnosisError> {
        let mut known: Vec<(usize, Vec<(usize, bool)>)> = Vec::new();
        for i in 0..standing.outcome.findings.len() {
            // Rivals judged, and whether they are as good.
            let mut fitted: Vec<_> = self.hopeless(&standing).into_iter().map(|rival| (rival, false)).collect();
            for rival in self.rivals(&standing, i) {
                if self.judge.fitting.is_late() {
                    break;
                }
                progress(Progress::Step(&format!("refit with {} instead", self.shape(&rival).effect.name())));
                let mut chosen = standing.outcome.chosen();
                let own = std::mem::replace(&mut chosen[i], rival);
                // A rival with which no machine can be fitted is none.
                match self.instead(&standing, i, &chosen) {
                    Err(_) => {}
                    Ok(Fitted::Worse) => fitted.push((rival.candidate, false)),
                    Ok(Fitted::AsGood) => fitted.push((rival.candidate, true)),
                    Ok(Fitted::Better(better)) => {
                        let outcome = self.given(&chosen, &better.fit)?;
                        let (t, critical) = self.judge.compare(&better, &standing.end);
                        let is_worse = t.is_nan() || t >= critical;
                        fitted.iter_mut().for_each(|(_, is_as_good)| *is_as_good &= !is_worse);
                        fitted.push((own.candidate, !is_worse));
                        standing = Standing { outcome, end: *better, ..standing };
                    }
                }
            }
            known.push((i, fitted));
        }
        for (i, fitted) in known {
            let finding = &mut standing.outcome.findings[i];
            for a in &mut finding.ranking.candidates {
                let of = fitted.iter().find(|(candidate, _)| *candidate == a.candidate);
                if let Some((_, is_as_good)) = of.filter(|_| a.candidate != finding.chosen.candidate) {
                    a.indistinguishable = *is_as_good;
                }
            }
        }
        Ok(standing)
    }

    /// The fit of the `chosen` effects, those of `standing` with a rival `at` one place.
    fn instead(&self, standing: &Standing, at: usize, chosen: &[Chosen]) -> Result<Fitted, FitError> {
        let finding = &standing.outcome.findings[at];
        let (own, rival) = (self.shape(&finding.chosen), self.shape(&chosen[at]));
        let fitted = match chosen {
            [_] => self.refit(chosen, self.all.as_ref())?,
            _ => {
                let others = without_effects(&standing.end.fit.model, &[own.effect.name()]);
                let begun = with_effects(&others, self.candidates, &chosen[at..=at], Some(&finding.ranking));
                self.fits.of(chosen, || self.fit(&begun, chosen))?
            }
        };
        if self.stand(chosen, &fitted)?.is_err() {
            return Ok(Fitted::Worse);
        }
        let (t, critical) = self.judge.compare(&standing.end, &fitted);
        let is_simpler = chosen.len() > 1 && rival.entries().len() < own.entries().len();
        Ok(match t {
            _ if t.is_nan() || t >= critical => match self.explains_as_much(standing, at, &fitted) {
                true => Fitted::AsGood,
                false => Fitted::Worse,
            },
            _ if t > -critical && !is_simpler => Fitted::AsGood,
            _ => Fitted::Better(Box::new(fitted)),
        })
    }

    /// Whether the fit of a rival explains nearly as much as the effect `at` of several in `standing`, where more than noise is
    /// left. There the losses over blocks depend on the unknown error as well, and do not decide.
    fn explains_as_much(&self, standing: &Standing, at: usize, rival: &Judged) -> bool {
        let left = |rms: &[f64]| relative_energy(rms, &self.judge.floor);
        let (end, without) = (left(standing.end.rms()), left(&standing.without[at]));
        standing.without.len() > 1
            && self.judge.is_more_than_noise(standing.end.rms())
            && left(rival.rms()) - end < CLEARLY_LESS * (without - end)
    }

    /// Rivals that are fitted in place of the effect `at` of `standing`.
    fn rivals(&self, standing: &Standing, at: usize) -> Vec<Chosen> {
        let finding = &standing.outcome.findings[at];
        let mut rivals: Vec<Chosen> = match standing.outcome.findings.len() {
            _ if !standing.not_tried.is_empty() => return Vec::new(),
            1 => self.unfitted(standing),
            _ => others(finding.ranking.confidence_set(), finding).take(OF_SEVERAL).collect(),
        };
        let later = self.later_too(finding).filter(|c| rivals.iter().all(|r| r.candidate != c.candidate));
        rivals.extend(later);
        rivals
    }

    /// The other effect on the time of the torques, if the finding is one: they differ where the torque jumps, at reversals, where
    /// the motion is smoothed.
    fn later_too(&self, finding: &Finding) -> Option<Chosen> {
        let is_time = |name: &&str| TIMES.contains(name);
        let own = self.shape(&finding.chosen).effect.name();
        let mut all = finding.ranking.candidates.iter().filter(|a| a.rank > 0 && !self.is_in_model(&a.name));
        is_time(&own).then(|| all.find(|a| a.name != own && is_time(&a.name.as_str())))?.map(Assessment::chosen)
    }

    /// Rivals of the only effect of `standing` in the problem as stated that the problem linearised with it excludes, and those
    /// in the linearised problem that explain plainly less than it.
    fn unfitted(&self, standing: &Standing) -> Vec<Chosen> {
        let [finding] = &standing.outcome.findings[..] else { return Vec::new() };
        let Some(all) = self.all.as_ref() else { return Vec::new() };
        let linearised = finding.ranking.confidence_set();
        let open = all.confidence_set().into_iter().filter(|a| !self.is_in_model(&a.name)).map(Assessment::chosen);
        let is = |a: &Assessment, c: &Chosen| a.candidate == c.candidate;
        let open = open.filter(|c| *c != finding.chosen && !linearised.iter().any(|a| is(a, c))).take(FITTED);
        let lesser = finding.ranking.lesser();
        let hopeless = self.hopeless(standing);
        let lesser = others(lesser, finding).filter(|c| !hopeless.contains(&c.candidate));
        open.chain(lesser.take(LESSER)).collect()
    }

    /// Rivals of the only effect of `standing` that promise hardly anything in the problem as stated, next to one that promises
    /// and explains most of the error: none is as good.
    fn hopeless(&self, standing: &Standing) -> Vec<usize> {
        let ([finding], Some(all)) = (&standing.outcome.findings[..], self.all.as_ref()) else { return Vec::new() };
        let promised = |candidate: usize| all.of(candidate).and_then(|a| a.explained_share).unwrap_or(1.0);
        let own = promised(finding.chosen.candidate);
        if own < MOST || self.left(&standing.end) > (1.0 - MOST) * self.left(&self.start) {
            return Vec::new();
        }
        let rivals = others(finding.ranking.confidence_set(), finding).map(|c| c.candidate);
        rivals.filter(|rival| promised(*rival) < HOPELESS * own).collect()
    }
}

/// Candidates of a ranking without that of the finding.
fn others<'a>(all: Vec<&'a Assessment>, finding: &'a Finding) -> impl Iterator<Item = Chosen> + use<'a> {
    all.into_iter().map(Assessment::chosen).filter(|c| c.candidate != finding.chosen.candidate)
}
