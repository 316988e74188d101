//! Whether recordings can be used together.

use super::{Dataset, FitError};

/// Checks that all recordings, fitted or held out, are of the machine in the same configuration and measure the same
/// channels: parameters, places and residuals of one have no counterpart in another one otherwise.
///
/// # Errors
/// [`FitError::Configurations`] or [`FitError::Channels`] with the names of the first recording and of the one that differs.
pub fn check_together<'a>(recordings: impl IntoIterator<Item = &'a Dataset>) -> Result<(), FitError> {
    let mut all = recordings.into_iter();
    let Some(first) = all.next() else { return Ok(()) };
    for other in all {
        let names = || (first.name.clone(), other.name.clone());
        if other.setup.configuration != first.setup.configuration {
            let (first, second) = names();
            return Err(FitError::Configurations { first, second });
        }
        if other.channels != first.channels {
            let (first_name, second) = names();
            let lacks = |own: &Dataset, other: &Dataset| -> Vec<String> {
                let lacking = own.channels.iter().filter(|c| !other.channels.contains(c));
                lacking.map(|c| format!("{c} only in {}", own.name)).collect()
            };
            let mut differ = [lacks(first, other), lacks(other, first)].concat();
            if differ.is_empty() {
                differ.push("in another order".into());
            }
            return Err(FitError::Channels { first: first_name, second, differ: differ.join(", ") });
        }
    }
    Ok(())
}
