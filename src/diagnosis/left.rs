//! Residual after everything found, in units of the noise.

use super::answer::Verdict;
use super::conclusion::Conclusion;
use super::judge::Judge;
use super::judge::UNEXPLAINED;
use super::unknown::{self, Shape};
use crate::dynamics::Channel;
use crate::identification::fit::FitError;
use crate::machine::Unit;

/// Residual in units of the noise.
#[derive(Clone, Debug)]
pub struct Left {
    /// Ratio of each channel's RMS residual on the validation data to its noise floor, with everything found.
    pub ratios: Vec<f64>,
    /// Whether an unknown effect acts in addition to the named ones.
    pub beside: bool,
    /// Description of the residual where it exceeds the noise and has no formula.
    pub sight: Option<Rest>,
}

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
        if left.is_more_than_noise() && conclusion.unexplained.is_none() {
            let worst = left.channels(&judge.data()[0].channels);
            left.sight = match worst.iter().find_map(|(channel, _)| channel.drive()) {
                Some(drive) => unknown::look(&conclusion.end, judge, drive)?,
                None => None,
            };
        }
        Ok(left)
    }

    fn new(rms: &[f64], floor: &[f64], named: bool, verdict: Verdict) -> Self {
        let ratios: Vec<f64> = rms.iter().zip(floor).map(|(r, f)| r / f.max(f64::MIN_POSITIVE)).collect();
        let above = ratios.iter().any(|r| *r > UNEXPLAINED);
        Self { ratios, beside: named && (above || verdict == Verdict::Unknown), sight: None }
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
