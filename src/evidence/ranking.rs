//! Result of one step of the procedure.

use super::Settings;
use super::problem::Chosen;
use super::whiten::ArFilter;

/// Ratio of explained shares from which a candidate explains plainly more of the error than another.
const PLAINLY_MORE: f64 = 2.0;

/// Too few rows for tests: blocks of time would be too few or too short for independent scores.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooFew {
    /// Rows of each channel, without the start of the whitening filter in each segment.
    pub rows: usize,
    /// Least number for tests.
    pub needed: usize,
}

impl std::fmt::Display for TooFew {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "too few rows to test for missing effects: {} of at least {}", self.rows, self.needed)
    }
}

/// A parameter with its standard error.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// Parameter.
    pub name: String,
    /// Generalised-least-squares estimate.
    pub value: f64,
    /// Standard error from block scores, valid under autocorrelation and heteroscedasticity.
    pub standard_error: f64,
}

/// A base parameter that imitates a candidate.
#[derive(Clone, Debug, PartialEq)]
pub struct Absorption {
    /// Base parameter, including those of effects already added.
    pub parameter: String,
    /// Its change when the candidate has the smallest coefficients of practical interest (unit ones if unknown).
    pub change: f64,
    /// The change in percent of the parameter's value, where that is known.
    pub percent: Option<f64>,
}

/// Whether the data can reveal a candidate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Visibility {
    /// An effect of the smallest size of practical interest would be found with 95 % power, or that size is unknown.
    Visible,
    /// An effect of that size would be found with less than 95 % power.
    TooWeak,
    /// There are too few rows for any test.
    TooFewRows,
    /// The base parameters imitate the candidate entirely.
    InBaseSpan,
    /// The candidate's columns are zero.
    Empty,
}

/// One candidate in one step. Values refer to its best variant unless said otherwise.
#[derive(Clone, Debug)]
pub struct Assessment {
    /// Index into the problem's candidates.
    pub candidate: usize,
    /// Its name.
    pub name: String,
    /// Variant that fits best.
    pub variant: usize,
    /// That variant's label.
    pub label: String,
    /// Whether the data can reveal it.
    pub visibility: Visibility,
    /// Mean share of the columns' whitened energy outside the span of the base: κ = 1 / VIF.
    pub tolerance: f64,
    /// Non-centrality of the smallest effect of practical interest, where that is known.
    pub noncentrality: Option<f64>,
    /// Base parameters that imitate it, most affected first; at most five.
    pub absorbed_by: Vec<Absorption>,
    /// Directions outside the base.
    pub rank: usize,
    /// F statistic of the whitened fit; infinite for an exact one.
    pub f_statistic: f64,
    /// Natural logarithm of the χ² tail of rank × F, with one degree of freedom added for a searched shape parameter.
    /// Candidates with different numbers of columns are ordered by it.
    pub ln_p: f64,
    /// Score statistic T of the variant with the smallest p.
    pub score: f64,
    /// Smallest marginal p over the variants.
    pub p_marginal: f64,
    /// Family-wise p over all candidates and variants.
    pub p_adjusted: f64,
    /// RMS of the part of the fit outside the span of the base, per channel in units of the channel's noise.
    pub relevance: Vec<f64>,
    /// Share of the explainable error that the candidate explains; see [`Ranking::floor_known`].
    pub explained_share: Option<f64>,
    /// Coefficients in the order of the variant's columns.
    pub coefficients: Vec<Estimate>,
    /// Change of the base parameters when the candidate is added, in the order of [`Ranking::base`].
    pub base_change: Vec<f64>,
    /// Residual sum of squares per channel with the candidate added.
    pub sum_of_squares: Vec<f64>,
    /// t statistic of the block losses against the best candidate; positive: this one fits worse.
    pub t_against_best: f64,
    /// Share of the best candidate's projected effect that this candidate's columns can imitate.
    pub overlap: f64,
    /// Whether the data cannot distinguish it from the best candidate (true for that one too).
    pub indistinguishable: bool,
}

impl Assessment {
    /// The candidate with its best variant.
    pub fn chosen(&self) -> Chosen {
        Chosen { candidate: self.candidate, variant: self.variant }
    }

    /// Largest relevance over the channels.
    pub fn max_relevance(&self) -> f64 {
        self.relevance.iter().fold(0.0, |a, &b| a.max(b))
    }

    /// Whether the candidate explains more than half of the error and more than twice as much as another.
    pub fn explains_plainly_more(&self, other: &Self) -> bool {
        let share = |a: &Self| a.explained_share.unwrap_or(0.0);
        share(self) > 0.5 && share(self) > PLAINLY_MORE * share(other)
    }

    /// Whether the candidate is both significant and large enough to be reported.
    pub fn passes(&self, settings: &Settings) -> bool {
        self.p_adjusted < settings.alpha && self.max_relevance() >= settings.min_relevance
    }

    /// Whether the data could reveal the candidate at its usual size, or do at the size that they suggest.
    pub fn is_revealed(&self, settings: &Settings) -> bool {
        self.visibility == Visibility::Visible || self.passes(settings)
    }
}

/// Result of one step.
#[derive(Clone, Debug)]
pub struct Ranking {
    /// Effects that were part of the base.
    pub chosen: Vec<Chosen>,
    /// Candidates in the order of the problem, without the chosen ones.
    pub candidates: Vec<Assessment>,
    /// Positions in `candidates`, best evidence first.
    pub order: Vec<usize>,
    /// Best candidate that is significant and relevant: position in `candidates`.
    pub best: Option<usize>,
    /// Base parameters, then those of the chosen effects.
    pub base: Vec<Estimate>,
    /// Number of identifiable base parameters.
    pub base_rank: usize,
    /// Whitening filter of each channel.
    pub filters: Vec<ArFilter>,
    /// Noise per channel that relevance refers to: the given one, else the residual's RMS.
    pub noise: Vec<f64>,
    /// Whether the noise of every channel was given. `explained_share` then refers to the residual variance above it,
    /// summed over channels in units of the noise; otherwise to the whitened residual energy.
    pub floor_known: bool,
    /// Residual `y − Yθ` of the base fit, stacked like the problem.
    pub residual: Vec<f64>,
    /// Sum of squares of the residual per channel.
    pub sum_of_squares: Vec<f64>,
    /// Whitened rows over all channels.
    pub rows: usize,
    /// Samples of each channel that sums of squares cover.
    pub samples: usize,
    /// Blocks of time.
    pub blocks: usize,
    /// Integrated autocorrelation time of the whitened residual, samples.
    pub correlation_time: f64,
    /// Whether the record is too short for blocks of five correlation times; p values are then too small.
    pub blocks_too_short: bool,
    /// Set if nothing was tested.
    pub too_few: Option<TooFew>,
}

impl Ranking {
    /// The assessment of a candidate.
    pub fn of(&self, candidate: usize) -> Option<&Assessment> {
        self.candidates.iter().find(|a| a.candidate == candidate)
    }

    /// The best candidate that is significant and relevant.
    pub fn winner(&self) -> Option<&Assessment> {
        self.best.map(|i| &self.candidates[i])
    }

    /// Significant and relevant candidates with the energy that each leaves of the residual, summed over the channels in
    /// units of the noise; the one that leaves least first.
    pub fn by_energy(&self, settings: &Settings) -> Vec<(f64, Chosen)> {
        let left = |a: &Assessment| self.energy(&a.sum_of_squares);
        let one = |a: &Assessment| (left(a), a.chosen());
        let mut all: Vec<_> = self.candidates.iter().filter(|a| a.passes(settings)).map(one).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        all
    }

    /// Mean square over the samples summed over the channels, in units of the noise; one per channel is the noise.
    pub fn energy(&self, sum_of_squares: &[f64]) -> f64 {
        let channels = sum_of_squares.iter().zip(&self.noise).filter(|(_, n)| **n > 0.0);
        channels.map(|(s, n)| s / (self.samples.max(1) as f64 * n * n)).sum()
    }

    /// Members of the confidence set that explain plainly less of the error than the best candidate. Whitening weights
    /// frequencies by their inverse noise: their evidence is another, faster part of the error.
    pub fn lesser(&self) -> Vec<&Assessment> {
        let Some(best) = self.winner() else { return Vec::new() };
        self.confidence_set().into_iter().filter(|a| best.explains_plainly_more(a)).collect()
    }

    /// Candidates that cannot be distinguished from the best one, best first; empty without a best one.
    pub fn confidence_set(&self) -> Vec<&Assessment> {
        let all = self.order.iter().map(|&i| &self.candidates[i]);
        all.filter(|a| self.best.is_some() && a.indistinguishable).collect()
    }
}
