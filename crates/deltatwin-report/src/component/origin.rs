//! Where a page comes from: command, program, inputs.

use crate::Report;

/// Adds the command that makes the page again, program and date, and the inputs as rows of role, file, SHA-256 and size.
pub fn add(report: &mut Report, command: &str, program: &str, inputs: &[[String; 4]]) {
    report.anchored("origin", "Where this comes from");
    report.commands(command);
    report.paragraph(program);
    if !inputs.is_empty() {
        report.cards(&["input", "file", "SHA-256", "bytes"], inputs);
    }
}
