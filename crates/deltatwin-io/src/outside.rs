//! What a file that names other files may reach.

use std::path::{Path, PathBuf};

use deltatwin::cell::{MeshReader, no_meshes};

/// Number of folders above a file in which `models/` is looked for.
const HEIGHT: usize = 4;

/// Which files a scenario, study or path may name, and who reads the solids among them.
#[derive(Clone, Copy, Debug)]
pub struct Access {
    /// Reader of the solids.
    pub meshes: MeshReader,
    /// Whether files anywhere may be named. A program that runs files of others does not allow it: then what a file names
    /// must be in its own project, which is the nearest of its folders with `models/` in it, else its own folder, or in
    /// the folder in which the program runs.
    pub anywhere: bool,
}

impl Access {
    /// Files anywhere, without solids.
    pub const PLAIN: Self = Self { meshes: no_meshes, anywhere: true };

    /// Files of the own project, without solids.
    pub const PROJECT: Self = Self { meshes: no_meshes, anywhere: false };

    /// Files anywhere, with `meshes` as reader of the solids.
    pub fn with(meshes: MeshReader) -> Self {
        Self { meshes, anywhere: true }
    }

    /// Checks that the file `by` may name the file `named`.
    ///
    /// # Errors
    /// Where it is, and where it was expected.
    pub(crate) fn check(&self, by: &Path, named: &Path) -> Result<(), String> {
        // What does not exist is an error of its own.
        let Ok(place) = named.canonicalize() else { return Ok(()) };
        if self.anywhere || homes(by).iter().any(|home| place.starts_with(home)) {
            return Ok(());
        }
        let project = homes(by).first().map_or(String::new(), |home| home.display().to_string());
        Err(format!("is outside of {project}; expected a file there, or --allow-outside"))
    }
}

/// The folders in which files named by `by` may be, its project first.
fn homes(by: &Path) -> Vec<PathBuf> {
    let folder = by.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let own = folder.canonicalize().ok();
    let project = own.as_ref().and_then(|own| own.ancestors().take(HEIGHT).find(|f| f.join("models").is_dir()));
    let project = project.map(Path::to_path_buf).or(own);
    // The whole file system is nobody's project.
    let here = std::env::current_dir().ok().filter(|here| here.parent().is_some());
    project.into_iter().chain(here).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_project_is_the_folder_with_the_models() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().canonicalize().unwrap();
        for place in ["project/models", "project/scenarios/failures", "other"] {
            std::fs::create_dir_all(root.join(place)).unwrap();
        }
        assert_eq!(homes(&root.join("project/scenarios/failures/run.toml"))[0], root.join("project"));
        assert_eq!(homes(&root.join("other/run.toml"))[0], root.join("other"));
        let named = root.join("other/model.toml");
        std::fs::write(&named, "").unwrap();
        let inside = Access::PROJECT;
        let by = |name: &str| root.join(name);
        assert_eq!(inside.check(&by("other/run.toml"), &named), Ok(()));
        let refused = inside.check(&by("project/scenarios/run.toml"), &named).unwrap_err();
        assert!(refused.contains("project; expected a file there, or --allow-outside"), "{refused}");
        assert_eq!(Access::PLAIN.check(&by("project/scenarios/run.toml"), &named), Ok(()));
    }
}
