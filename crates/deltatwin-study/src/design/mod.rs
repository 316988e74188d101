//! Factors of a study and the points at which they are set.
