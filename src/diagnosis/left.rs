//! What is left after everything that was found, in units of the noise.

use super::answer::Verdict;
use super::conclusion::Conclusion;
use super::judge::Judge;
use super::judge::UNEXPLAINED;
use super::unknown::{self, Shape};
use crate::dynamics::Channel;
use crate::identification::fit::FitError;
use crate::machine::Unit;

/// Error that is left, in units of the noise.
#[derive(Clone, Debug)]
pub struct Left {
    /// Held-out RMS residual of each channel over its noise floor, with everything that was found.
    pub ratios: Vec<f64>,
    /// Whether something unknown acts beside the effects that are named.
    pub beside: bool,
    /// What it looks like, where there is more than noise and no formula was found for it.
    pub sight: Option<Rest>,
}

/// What a rest looks like that no formula explains.
#[derive(Clone, Debug)]
pub struct Rest {
    /// Where it was looked at.
    pub location: String,
    /// What acts there.
    pub shape: Shape,
    /// Unit of that.
    pub unit: Unit,
}

impl Left {
    /// What a conclusion leaves, with a look at it where no formula was found for it.
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

    /// Largest ratio; 1 is noise alone.
    pub fn largest(&self) -> f64 {
        self.ratios.iter().copied().fold(0.0, f64::max)
    }

    /// Whether some channel has clearly more than its noise.
    pub fn is_more_than_noise(&self) -> bool {
        self.largest() > UNEXPLAINED
    }

    /// Channels with clearly more than their noise, the worst first, with the ratio.
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
