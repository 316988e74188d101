//! Shipped scenarios and models of the experiments, embedded in the program.

use std::path::{Path, PathBuf};

use deltatwin_io::file::replace_text;

macro_rules! shipped {
    ($($path:literal),* $(,)?) => { &[$(($path, include_str!(concat!("../../../../", $path)))),*] };
}

/// Path relative to the project's folder, and content.
const FILES: &[(&str, &str)] = shipped![
    "models/irb360-6-1600.toml",
    "models/irb360-6-1600-truth.toml",
    "models/irb360-6-1600-disassembled.toml",
    "scenarios/reproduce/arms-excitation.toml",
    "scenarios/reproduce/arms-static.toml",
    "scenarios/reproduce/arms-verification.toml",
    "scenarios/reproduce/excitation.toml",
    "scenarios/reproduce/friction-curve.toml",
    "scenarios/reproduce/strut-force.toml",
    "scenarios/reproduce/verification.toml",
];

/// Writes the shipped files below `folder` and returns the folder of the scenarios.
///
/// # Errors
/// If a file cannot be written.
pub fn unpack(folder: &Path) -> std::io::Result<PathBuf> {
    for (path, text) in FILES {
        let file = folder.join(path);
        if let Some(parent) = file.parent() {
            std::fs::create_dir_all(parent)?;
        }
        replace_text(&file, text).map_err(std::io::Error::other)?;
    }
    Ok(folder.join("scenarios/reproduce"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use deltatwin_io::{model, scenario};

    #[test]
    fn all_shipped_scenarios_are_read_from_any_folder() {
        let folder = tempfile::tempdir().unwrap();
        let scenarios = unpack(folder.path()).unwrap();
        let carried: Vec<_> = std::fs::read_dir(&scenarios).unwrap().map(|e| e.unwrap().path()).collect();
        let shipped = std::fs::read_dir("../../scenarios/reproduce").unwrap();
        assert_eq!(carried.len(), shipped.filter(|e| e.as_ref().unwrap().path().extension().is_some()).count());
        for file in carried {
            let scenario = scenario::read(&file).unwrap();
            model::read(&scenario.model).unwrap();
            assert!(scenario.model.starts_with(folder.path()));
        }
    }
}
