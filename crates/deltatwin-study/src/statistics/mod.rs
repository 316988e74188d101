//! Sensitivity indices, probabilities of rare failures, and confidence intervals.
