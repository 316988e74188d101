//! Work of a fit.

use std::ops::AddAssign;

/// Work of a fit, in counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Number of passes over the data that compute the columns of all parameters.
    pub regressions: usize,
    /// Number of passes over the data that compute residuals alone.
    pub predictions: usize,
    /// Number of iterations of the convex programme for consistent parameters; zero without such a programme.
    pub corrections: usize,
}

impl AddAssign for Work {
    fn add_assign(&mut self, other: Self) {
        self.regressions += other.regressions;
        self.predictions += other.predictions;
        self.corrections += other.corrections;
    }
}
