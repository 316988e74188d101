//! Stopping condition of a long computation.

/// Stopping condition, evaluated between the steps of a long computation; true ends it with the results so far.
pub type Stop<'a> = &'a (dyn Fn() -> bool + Sync);

/// Stopping condition that is never true.
pub const NEVER: Stop<'static> = &|| false;
