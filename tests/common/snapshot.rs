//! Text that tests compare with a committed file.

use std::path::Path;

/// Variable whose presence writes the file anew, to be read in the difference of the commit.
const ACCEPT: &str = "ACCEPT_SNAPSHOTS";

/// Whether the files are to be written instead of compared.
pub fn accepts() -> bool {
    std::env::var_os(ACCEPT).is_some()
}

/// How a change that is meant becomes the committed text.
pub fn how_to_accept(file: &Path) -> String {
    format!("if the change is meant, run this test again with {ACCEPT}=1 and commit {}", file.display())
}
