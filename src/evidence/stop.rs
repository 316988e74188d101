//! When a long computation is to end with what it has.

/// Asked between the steps of a long computation: whether it is to end with what it has found.
pub type Stop<'a> = &'a (dyn Fn() -> bool + Sync);

/// A computation that takes the time it needs.
pub const NEVER: Stop<'static> = &|| false;
