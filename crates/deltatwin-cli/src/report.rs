//! Pages that commands write with `--report`.

use std::path::Path;

use miette::IntoDiagnostic;

use crate::data::DataArgs;
use crate::terminal::{check_output, say};
use deltatwin_report::Report;

/// Checks that the page may be written: it is none of the inputs.
///
/// # Errors
/// If it is, has another ending than `.html`, or its folder does not exist.
pub fn check_report(page: Option<&Path>, model: &Path, data: &DataArgs) -> miette::Result<()> {
    let Some(page) = page else { return Ok(()) };
    let given = data.inputs();
    let mut inputs = given.files();
    inputs.push(model);
    check_output(page, &inputs, &["html"])
}

/// Writes the page that `make` gives, if one is wanted; reports it unless `quietly`.
///
/// # Errors
/// If the page cannot be made or written.
pub fn write_report(
    page: Option<&Path>,
    quietly: bool,
    make: impl FnOnce() -> miette::Result<Report>,
) -> miette::Result<()> {
    let Some(page) = page else { return Ok(()) };
    make()?.write(page).into_diagnostic()?;
    if quietly { Ok(()) } else { say(format!("  Wrote {}", page.display())) }
}
