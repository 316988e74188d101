//! Residual after everything found, in units of the noise.

use super::answer::Verdict;
use super::conclusion::Conclusion;
use super::judge::Judge;
use super::judge::UNEXPLAINED;
use super::orders;
use super::unknown::{self, Shape};
use crate::comparison::{self, Finding};
use crate::identification::fit::FitError;
use crate::machine::Unit;
use crate::recording::Channel;

/// Residual in units of the noise.
#[derive(Clone, Debug)]
pub struct Left {
    /// Ratio of each channel's RMS residual on the validation data to its noise floor, with everything found.
    pub ratios: Vec<f64>,
    /// Whether an unknown effect acts in addition to the named ones.
    pub beside: bool,
    /// Whether it is not related to the motion: noise with a memory, of which the floor contains a part.
    pub is_noise: bool,
    /// Whether the validation data depend on parameters that the fitted recordings do not determine.
    pub is_extrapolated: bool,
    /// Description of the residual where it exceeds the noise and has no formula.
    pub sight: Option<Rest>,
    /// Strongest patterns of the channels whose ratio exceeds 1.3 and that have no formula, largest share
    /// first.
    pub patterns: Vec<Finding>,
}

/// Ratio to the noise floor above which the patterns of a residual are described.
const PLAIN: f64 = 1.3;
/// Largest number of patterns described per channel.
const MOST_PATTERNS: usize = 3;

/// Description of a residual without a formula.
#[derive(Clone, Debug)]
pub struct Rest {
    /// Location, as text.
    pub location: String,
    /// Force at the location.
    pub shape: Shape,
    /// Unit of the force.
    pub unit: Unit,
}

impl Left {
    /// Residual of a conclusion, with its description where it has no formula.
    pub(super) fn of(conclusion: &Conclusion, judge: &Judge) -> Result<Self, FitError> {
        let mut left =
            Self::new(conclusion.end.rms(), &judge.floor, !conclusion.effects.is_empty(), conclusion.verdict);
        left.is_noise = conclusion.leaves_noise;
        left.is_extrapolated = judge.is_extrapolated(&conclusion.end);
        if left.is_more_than_noise() && conclusion.unexplained.is_none() && !left.is_noise {
            let worst = left.channels(&judge.data()[0].channels);
            left.sight = match worst.iter().find_map(|(channel, _)| channel.drive()) {
                Some(drive) => unknown::look(&conclusion.end, judge, drive)?,
                None => None,
            };
            left.patterns = patterns(&left.ratios, conclusion, judge)?;
        }
        Ok(left)
    }

    fn new(rms: &[f64], floor: &[f64], named: bool, verdict: Verdict) -> Self {
        let ratios: Vec<f64> = rms.iter().zip(floor).map(|(r, f)| r / f.max(f64::MIN_POSITIVE)).collect();
        let above = ratios.iter().any(|r| *r > UNEXPLAINED);
        let beside = named && (above || verdict == Verdict::Unknown);
        Self { ratios, beside, is_noise: false, is_extrapolated: false, sight: None, patterns: Vec::new() }
    }

    /// Largest ratio; 1 is pure noise.
    pub fn largest(&self) -> f64 {
        self.ratios.iter().copied().fold(0.0, f64::max)
    }

    /// Whether some channel clearly exceeds its noise.
    pub fn is_more_than_noise(&self) -> bool {
        self.largest() > UNEXPLAINED
    }

    /// Channels that clearly exceed their noise with the ratio, largest first.
    pub fn channels(&self, channels: &[Channel]) -> Vec<(Channel, f64)> {
        let all = channels.iter().copied().zip(self.ratios.iter().copied());
        let mut above: Vec<(Channel, f64)> = all.filter(|(_, ratio)| *ratio > UNEXPLAINED).collect();
        above.sort_by(|a, b| b.1.total_cmp(&a.1));
        above
    }
}

/// Patterns of the validation residuals of all channels above [`PLAIN`], with the lines of drives over their angle.
fn patterns(ratios: &[f64], conclusion: &Conclusion, judge: &Judge) -> Result<Vec<Finding>, FitError> {
    let (end, datasets) = (&conclusion.end, judge.data());
    let mut all = Vec::new();
    for c in (0..ratios.len()).filter(|&c| ratios[c] > PLAIN) {
        let channel = datasets[0].channels[c];
        let mut own = comparison::patterns(&end.fit.model, datasets, &end.residuals, c)?;
        let lines = channel.drive().filter(|i| *i < end.fit.model.mechanism.arms());
        own.extend(lines.and_then(|arm| orders::strongest(&end.fit.model, &end.residuals, datasets, arm)));
        own.sort_by(|a, b| b.share.total_cmp(&a.share));
        own.truncate(MOST_PATTERNS);
        all.extend(own);
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn something_else_is_beside_what_is_named_above_fifteen_per_cent() {
        let left = |rms: f64, named, verdict| Left::new(&[0.4, rms], &[0.4, 0.05], named, verdict);
        assert!(!left(0.0574, true, Verdict::Effect).beside);
        assert!(left(0.0576, true, Verdict::Effect).beside);
        assert!(!left(0.2, false, Verdict::None).beside, "nothing is named");
        assert!(left(0.05, true, Verdict::Unknown).beside);
        let rest = left(0.2, true, Verdict::Effect);
        assert_eq!(rest.channels(&[Channel::Torque(0), Channel::Torque(3)]), [(Channel::Torque(3), 4.0)]);
        assert_eq!(rest.largest(), 4.0);
    }
}
