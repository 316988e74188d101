//! Parts of pages about a model and its recordings, the same on every page.

pub mod candidates;
pub mod checks;
pub mod errors;
pub mod origin;
pub mod parameters;
pub mod signals;

/// `value` with four digits.
pub(crate) fn number(value: f64) -> String {
    deltatwin::text::significant(value, 4)
}
