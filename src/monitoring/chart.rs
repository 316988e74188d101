//! Cumulative sums [Page 1954], and their average run length by a Markov chain [Brook 1972].
//!
//! With scores x of independent windows, S ← max(0, S + x − k) stays near zero while the scores are below the
//! reference k on average, and grows by E\[x\] − k per window once they are above. An alarm is S > h. The average run
//! length (ARL) is the mean number of windows until an alarm of a healthy machine; several charts together raise at
//! most the sum of their rates 1/ARL, whether or not they are correlated.

use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ContinuousCDF, Gamma, Normal};

use crate::numerics::bisect;

/// Number of states of the Markov chain: the run length changes by less than 1 % with twice as many.
const STATES: usize = 120;
/// Share of the threshold that one window adds at most, so that no single window, as of a knock, raises an alarm.
const CLIP: f64 = 1.0 / 3.0;
/// Largest sum, in thresholds: a chart recovers from any alarm in finite time.
const CEILING: f64 = 10.0;
/// Largest threshold that is tried.
const HIGHEST: f64 = 1e4;
const HALVINGS: usize = 30;

/// Distribution of the scores of a healthy machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Law {
    /// Standard normal.
    Normal,
    /// Gamma of mean 1 with this shape, as a mean of squares has: 2·shape degrees of freedom.
    Energy(f64),
}

impl Law {
    /// Probability that a score is at most `x`.
    pub fn cdf(self, x: f64) -> f64 {
        match self {
            Self::Normal => Normal::standard().cdf(x),
            Self::Energy(_) if x <= 0.0 => 0.0,
            Self::Energy(shape) => Gamma::new(shape, shape).map_or(1.0, |law| law.cdf(x)),
        }
    }
}

/// Average run length, in windows, of a chart with reference `reference` and threshold `threshold` that starts at zero,
/// if one window adds at most `most`.
///
/// The range of S is divided into states of equal width, the first of half a width around zero, and the mean times to
/// absorption solve (I − P)·L = 1.
pub fn run_length(law: Law, reference: f64, threshold: f64, most: f64) -> f64 {
    let width = threshold / (STATES as f64 - 0.5);
    // Probability that S moves from the middle of state i to at most the upper end of state j, by j − i.
    let cdf = |step: f64| if step >= most { 1.0 } else { law.cdf(reference + step) };
    let probabilities: Vec<f64> =
        (0..2 * STATES).map(|shift| cdf((shift as f64 + 0.5 - STATES as f64) * width)).collect();
    let below = |i: usize, j: usize| probabilities[STATES + j - i];
    let moves = DMatrix::from_fn(STATES, STATES, |i, j| {
        let probability = if j == 0 { below(i, 0) } else { below(i, j) - below(i, j - 1) };
        f64::from(u8::from(i == j)) - probability
    });
    let ones = DVector::from_element(STATES, 1.0);
    match moves.lu().solve(&ones) {
        // Beyond the precision of the arithmetic the chart practically never alarms.
        Some(lengths) if lengths[0] > 0.0 => lengths[0],
        _ => f64::INFINITY,
    }
}

/// Smallest threshold with an average run length of at least `length` windows, each of which adds at most a third of it.
pub fn threshold(law: Law, reference: f64, length: f64) -> f64 {
    let is_short = |threshold: f64| run_length(law, reference, threshold, CLIP * threshold) < length;
    let mut high = 1.0;
    while high < HIGHEST && is_short(high) {
        high *= 2.0;
    }
    let [_, high] = bisect([0.0, high], HALVINGS, is_short);
    high
}

/// One cumulative sum.
#[derive(Clone, Debug)]
pub struct Chart {
    reference: f64,
    threshold: f64,
    sum: f64,
    onset: Option<f64>,
}

impl Chart {
    /// A chart at zero whose average run length is `length` windows.
    pub fn new(law: Law, reference: f64, length: f64) -> Self {
        Self { reference, threshold: threshold(law, reference, length), sum: 0.0, onset: None }
    }

    /// Adds the score of the window that starts at `t`, s; returns whether the sum exceeds the threshold.
    pub fn add(&mut self, t: f64, score: f64) -> bool {
        let step = (score - self.reference).min(CLIP * self.threshold);
        self.sum = (self.sum + step).clamp(0.0, CEILING * self.threshold);
        if self.sum == 0.0 {
            self.onset = None;
        } else {
            self.onset.get_or_insert(t);
        }
        self.sum > self.threshold
    }

    /// The sum relative to the threshold; an alarm is above 1.
    pub fn level(&self) -> f64 {
        self.sum / self.threshold
    }

    /// Start of the first window since which the sum has not been zero, s: the estimated onset of a change.
    pub fn onset(&self) -> Option<f64> {
        self.onset
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, Gamma as GammaDistribution, StandardNormal};

    /// Tables of two-sided charts with k = 1/2 [Montgomery 2013, table 9.3]: 168 at h = 4, 465 at h = 5; one side alone
    /// has twice that. Siegmund's approximation 2·(exp(b) − b − 1), b = h + 1.166, of one side gives 338 and 938.
    #[test]
    fn run_lengths_are_those_of_the_tables() {
        for (h, two_sided) in [(4.0, 168.0), (5.0, 465.0)] {
            let found = run_length(Law::Normal, 0.5, h, f64::INFINITY);
            assert!((found / (2.0 * two_sided) - 1.0).abs() < 0.01, "{h}: {found}");
        }
        let h = threshold(Law::Energy(20.0), 1.2, 1e7);
        assert!((run_length(Law::Energy(20.0), 1.2, h, h / 3.0) / 1e7 - 1.0).abs() < 1e-3, "{h}");
        assert!(threshold(Law::Normal, 0.5, 930.0) < 5.0, "what is clipped reaches less far");
    }

    /// Alarms of 400 000 windows at an average run length of 2000: 200 ± 14, three standard deviations each way.
    #[test]
    fn as_many_false_alarms_as_stated() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let energies = GammaDistribution::new(12.0, 1.0 / 12.0).unwrap();
        let count = |law: Law, reference: f64, rng: &mut ChaCha8Rng| {
            let (mut chart, mut alarms) = (Chart::new(law, reference, 2000.0), 0);
            for _ in 0..400_000 {
                let score: f64 = match law {
                    Law::Normal => StandardNormal.sample(rng),
                    Law::Energy(_) => energies.sample(rng),
                };
                if chart.add(0.0, score) {
                    alarms += 1;
                    chart.sum = 0.0;
                }
            }
            alarms
        };
        for (law, reference) in [(Law::Normal, 0.5), (Law::Energy(12.0), 1.2)] {
            let alarms = count(law, reference, &mut rng);
            println!("{law:?}: 400000 windows tried, {alarms} false alarms, 200 expected");
            assert!((158..=242).contains(&alarms), "{law:?}: {alarms}");
        }
    }

    #[test]
    fn one_window_is_not_enough_and_the_onset_is_remembered() {
        let mut chart = Chart::new(Law::Normal, 0.5, 1e6);
        assert!(!chart.add(0.0, -3.0) && chart.onset().is_none());
        assert!(!chart.add(1.0, 1e9) && !chart.add(2.0, f64::INFINITY));
        assert!(!chart.add(3.0, 1e9) && chart.add(4.0, 1e9));
        assert_eq!(chart.onset(), Some(1.0));
        (0..100_000).for_each(|_| assert!(chart.add(5.0, f64::INFINITY)));
        assert!(chart.level() <= CEILING);
    }
}
