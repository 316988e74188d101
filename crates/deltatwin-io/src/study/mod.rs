//! Study files: a scenario, factors that change it, and the design by which they are set.

mod factor;
mod read;
mod template;
mod tree;

pub use factor::{Change, Distribution, Factor, Level, Range, Setting};
pub use read::{StudyError, parse, read};
pub use template::Files;

use std::path::PathBuf;
use std::sync::Arc;

use crate::source::{Problem, Source};
use template::Template;

/// A study, as described by its file.
#[derive(Clone)]
pub struct Study {
    /// Name for reports, the file stem.
    pub name: String,
    /// File it was read from.
    pub path: PathBuf,
    /// Text of that file.
    pub text: Arc<str>,
    /// Title, if stated.
    pub title: Option<String>,
    /// Seed of everything drawn.
    pub seed: u64,
    /// Runs whose recordings are kept.
    pub keep: Keep,
    /// Whether the recording of every run is diagnosed with the controller's model.
    pub diagnose: bool,
    /// Seeds of the scenarios.
    pub draws: Draws,
    /// How the factors are set.
    pub design: Design,
    /// Cause whose margin searches and pictures are about, an index of [`CAUSES`]; `None`: the least over all causes.
    pub margin: Option<usize>,
    /// Factor over which the pictures show the probability of failure, if stated.
    pub over: Option<usize>,
    /// Time for which a broken robot is followed on once its load has landed, s, if stated.
    pub after_landing: Option<f64>,
    /// What is changed, in the order of the file.
    pub factors: Vec<Factor>,
    /// Model in which an experiment hides effects; `None` for runs of a scenario.
    pub experiment: Option<PathBuf>,
    template: Template,
}

/// Words for the causes with a margin of their own.
pub const CAUSES: [&str; 8] = ["socket", "torque", "speed", "telescope", "workspace", "contact", "trip", "following"];

/// Runs whose recordings are kept.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Keep {
    /// None.
    #[default]
    None,
    /// Those that failed.
    Failed,
    /// Those of these numbers.
    Runs(Vec<u64>),
}

/// Seeds of the scenarios, for sensor noise and drawn hold forces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Draws {
    /// Every run has a seed of its own.
    Each,
    /// Every run has the scenario's.
    Same,
}

/// How the factors are set.
#[derive(Clone, Debug, PartialEq)]
pub enum Design {
    /// Every combination of levels, the last factor fastest.
    Grid {
        /// Number of draws of the factors that are distributed, at every combination; the first is at their medians.
        repeats: u64,
    },
    /// Latin hypercube.
    LatinHypercube {
        /// Number of runs.
        runs: u64,
    },
    /// Scrambled Sobol' sequence.
    Sobol {
        /// Number of runs.
        runs: u64,
    },
    /// Independent draws.
    MonteCarlo {
        /// Number of runs.
        runs: u64,
    },
    /// One factor after the other at its low and high value, and samples for Sobol' indices [Saltelli 2010]: per base sample
    /// A, A with each factor of B, and B.
    Sensitivity {
        /// Number of base samples.
        samples: u64,
    },
    /// The point on each ray at which the margin is zero.
    Boundary {
        /// Factors along the rays, indices into the study's; all start at `from` and end at `to`.
        along: Vec<usize>,
        /// Number of rays.
        rays: u64,
        /// Length of the interval, as a share of the ray, to which the point is located.
        tolerance: f64,
        /// Number of draws of the factors that are distributed, at every combination of levels; the first is at their
        /// medians.
        repeats: u64,
    },
    /// Search for the least margin.
    WorstCase {
        /// Number of runs.
        runs: u64,
    },
    /// Subset simulation of the probability of a negative margin.
    Subset {
        /// Number of samples per level.
        samples: u64,
        /// Conditional probability of each level.
        share: f64,
        /// Largest number of levels.
        levels: u64,
    },
}

impl Design {
    /// Name in study files.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Grid { .. } => "grid",
            Self::LatinHypercube { .. } => "latin_hypercube",
            Self::Sobol { .. } => "sobol",
            Self::MonteCarlo { .. } => "monte_carlo",
            Self::Sensitivity { .. } => "sensitivity",
            Self::Boundary { .. } => "boundary",
            Self::WorstCase { .. } => "worst_case",
            Self::Subset { .. } => "subset",
        }
    }
}

impl Study {
    /// Scenario and models with the factors set to `settings`, and the scenario's seed to `seed` if stated.
    ///
    /// # Errors
    /// What the scenario or a model does not admit, as one sentence.
    pub fn files(&self, settings: &[Setting], seed: Option<u64>) -> Result<Files, String> {
        self.template.files(&self.factors, settings, seed)
    }

    /// The scenario file without changes; of a study of several scenarios the first.
    pub fn scenario(&self) -> &std::path::Path {
        self.template.scenario()
    }

    /// Named contents that determine the rows of the study: its factors and design, and every file that they need.
    /// Comments, formatting and names of folders have no influence.
    pub fn contents(&self) -> &[(String, Vec<u8>)] {
        self.template.contents()
    }

    /// An error about a factor, with its place in the file.
    pub fn refuse(&self, factor: usize, message: String) -> Problem {
        let source = Source::new(self.path.display(), &self.text);
        source.problem(self.factors[factor].place.clone(), message)
    }
}
