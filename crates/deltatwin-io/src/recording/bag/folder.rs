//! Bag folders: `metadata.yaml` and the files it lists.

use std::path::{Component, Path, PathBuf};

use yaml_rust2::{Yaml, YamlLoader};

use super::content::Content;
use super::{EXPECTED, kind_of, read_file};
use crate::file;
use crate::recording::ReadError;

const METADATA: &str = "metadata.yaml";

/// Appends the content of all files of a bag in order to `found`.
pub(super) fn read(path: &Path, found: &mut Content, warnings: &mut Vec<String>) -> Result<(), ReadError> {
    for file in files(path)? {
        match read_file(&file, found, warnings) {
            Ok(()) => {}
            // The last file of a bag that was not closed may be missing or empty.
            Err(e) if !found.streams.is_empty() => {
                warnings.push(format!("a later part of the bag is left out: {e}"));
                found.cut = true;
                break;
            }
            Err(e) => return Err(e),
        }
    }
    Ok(())
}

/// The files listed in `metadata.yaml`; without it, all bag files in the order of their numbers.
fn files(folder: &Path) -> Result<Vec<PathBuf>, ReadError> {
    let metadata = folder.join(METADATA);
    if metadata.is_file() {
        return listed(folder, &metadata);
    }
    let entries = std::fs::read_dir(folder).map_err(|e| ReadError::io(folder, e))?;
    let mut files: Vec<PathBuf> =
        entries.filter_map(|e| Some(e.ok()?.path())).filter(|p| p.is_file() && kind_of(p).is_some()).collect();
    if files.is_empty() {
        return Err(ReadError::content(folder, "is a folder without metadata.yaml, .mcap or .db3", EXPECTED));
    }
    files.sort_by_key(|p| {
        let stem = p.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let number = stem.rsplit('_').next().and_then(|n| n.parse::<u64>().ok());
        (number, stem)
    });
    Ok(files)
}

fn listed(folder: &Path, metadata: &Path) -> Result<Vec<PathBuf>, ReadError> {
    let text = file::text(metadata).map_err(|e| ReadError::io(metadata, e))?;
    let expected = "rosbag2_bagfile_information with relative_file_paths";
    let documents = YamlLoader::load_from_str(&text)
        .map_err(|e| ReadError::content(metadata, format!("is no YAML: {e}"), expected))?;
    let information = documents.first().map_or(&Yaml::BadValue, |d| &d["rosbag2_bagfile_information"]);
    if let Some(mode) = information["compression_mode"].as_str().filter(|m| !m.is_empty() && *m != "NONE") {
        let problem = format!("says compression_mode {mode}");
        return Err(ReadError::content(metadata, problem, "an uncompressed bag, as `ros2 bag convert` makes one"));
    }
    let Some(paths) = information["relative_file_paths"].as_vec() else {
        return Err(ReadError::content(metadata, "lists no files", expected));
    };
    // Older bags state paths relative to the parent folder; no bag has files elsewhere.
    let place = |relative: &str| {
        let relative = Path::new(relative);
        let stays = relative.components().all(|part| matches!(part, Component::Normal(_)));
        let inside = folder.join(relative);
        match relative.file_name() {
            Some(name) if !(stays && inside.is_file()) => folder.join(name),
            _ => inside,
        }
    };
    let files: Vec<PathBuf> = paths.iter().filter_map(Yaml::as_str).map(place).collect();
    match files.is_empty() {
        true => Err(ReadError::content(metadata, "lists no files", expected)),
        false => Ok(files),
    }
}
