//! Readers as functions of bytes, for a fuzzer that is guided by coverage.

use std::cell::OnceCell;
use std::path::Path;

use tempfile::TempDir;

use crate::target::TARGETS;

thread_local! {
    static FOLDER: OnceCell<TempDir> = const { OnceCell::new() };
}

/// Hands `data` to the reader `name`, as the file that it reads, beside the shipped models and scenarios.
///
/// # Panics
/// If there is no such reader, if the folder for the file cannot be made, or if the reader panics.
pub fn read(name: &str, data: &[u8]) {
    let target = TARGETS.iter().find(|target| target.name == name).expect("the name of a reader");
    FOLDER.with(|folder| {
        let folder = folder.get_or_init(prepared);
        let file = folder.path().join(target.file);
        std::fs::write(&file, data).expect("the folder for temporary files can be written");
        (target.read)(&file);
    });
}

/// A folder with copies of the shipped models and scenarios.
fn prepared() -> TempDir {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let folder = tempfile::tempdir().expect("a folder for temporary files");
    for place in ["models", "scenarios", "scenarios/studies", "scenarios/failures", "scenarios/tables"] {
        std::fs::create_dir_all(folder.path().join(place)).expect("the folder is new");
        for entry in std::fs::read_dir(root.join(place)).expect("the project's folders").flatten() {
            if entry.path().is_file() {
                std::fs::copy(entry.path(), folder.path().join(place).join(entry.file_name())).expect("a copy");
            }
        }
    }
    folder
}
