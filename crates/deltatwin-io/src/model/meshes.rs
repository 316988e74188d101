//! The table `[meshes]`: files that show the machine's parts. They are named here and read where they are shown.

use std::path::{Path, PathBuf};

use deltatwin::machine::Mechanism;
use deltatwin::model::{MeshPart, Meshes, Model};
use miette::{Result, miette};
use toml_edit::{Item, Table as Document, Value};

use super::schema::{Bounds, Shape};
use super::table::Table;
use crate::file::way;
use crate::outside::Access;
use crate::source::Checked;

/// Key of the length of a file's unit.
const SCALE: &str = "scale";
/// What a file may be.
const ENDINGS: [&str; 5] = ["stl", "glb", "gltf", "obj", "dae"];

/// Parts that a machine has.
fn parts(mechanism: Mechanism) -> impl Iterator<Item = MeshPart> {
    let known = move |part: &MeshPart| match part {
        MeshPart::Base => true,
        MeshPart::Axis => matches!(mechanism, Mechanism::Axis(_)),
        MeshPart::TelescopeUpper | MeshPart::TelescopeLower => mechanism.has_telescope(),
        _ => matches!(mechanism, Mechanism::Delta { .. }),
    };
    MeshPart::ALL.into_iter().filter(known)
}

/// Reads the table, which may be missing.
pub(super) fn read(top: &Table, mechanism: Mechanism) -> Checked<Meshes> {
    let mut meshes = Meshes::default();
    let Some(table) = top.optional_table("meshes")? else { return Ok(meshes) };
    let known: Vec<MeshPart> = parts(mechanism).collect();
    let keys: Vec<&str> = known.iter().map(|part| part.key()).chain([SCALE]).collect();
    table.only(&keys)?;
    if table.entry(SCALE).is_some() {
        let bounds = Bounds::between(1e-6, 1e3);
        meshes.scale = table.numbers(SCALE, Shape::One, &bounds, Some("m, the length of the files' unit"))?[0];
    }
    for part in known.into_iter().filter(|part| table.entry(part.key()).is_some()) {
        let expected = format!("the name of a file (.{})", ENDINGS.join(", ."));
        let name = table.string(part.key(), &expected)?;
        let ending = Path::new(name).extension().and_then(|e| e.to_str()).unwrap_or_default();
        if !ENDINGS.iter().any(|known| known.eq_ignore_ascii_case(ending)) {
            return Err(table.refuse(part.key(), &format!("expected {expected}")));
        }
        meshes.files.insert(part, PathBuf::from(name));
    }
    Ok(meshes)
}

/// Writes the table where it differs.
pub(super) fn edit(root: &mut Document, meshes: &Meshes) {
    if meshes.files.is_empty() {
        return;
    }
    let table = root.entry("meshes").or_insert_with(|| Item::Table(Document::new()));
    let Some(table) = table.as_table_like_mut() else { return };
    let mut set = |key: &str, value: Value, is_same: &dyn Fn(&Item) -> bool| {
        if !table.get(key).is_some_and(is_same) {
            table.insert(key, Item::Value(value));
        }
    };
    if meshes.scale != 1.0 {
        set(SCALE, meshes.scale.into(), &|item| {
            item.as_float().or(item.as_integer().map(|n| n as f64)) == Some(meshes.scale)
        });
    }
    for (part, file) in &meshes.files {
        let name = file.to_string_lossy().replace('\\', "/");
        set(part.key(), name.as_str().into(), &|item| item.as_str() == Some(&name));
    }
}

/// The files of the model's meshes, with its folder.
///
/// # Errors
/// If a file is outside of the model's project, and `access` does not admit it.
pub fn files(model: &Model, access: Access) -> Result<Vec<(MeshPart, PathBuf)>> {
    let by = model.path.as_deref().unwrap_or(Path::new("model.toml"));
    let one = |(part, file): (&MeshPart, &PathBuf)| {
        let place = by.with_file_name("").join(file);
        let refused = |what| miette!("{}: [meshes] {} = {:?} {what}", by.display(), part.key(), file);
        access.check(by, &place).map_err(refused).map(|()| (*part, place))
    };
    model.meshes.files.iter().map(one).collect()
}

/// The meshes of `model` as a file at `path` names them: their files stay where they are.
pub(super) fn seen_from(model: &Model, path: &Path) -> Meshes {
    let folder = |file: &Path| {
        let folder = file.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
        folder.canonicalize().ok()
    };
    let mut meshes = model.meshes.clone();
    let (Some(from), Some(to)) = (model.path.as_deref().and_then(folder), folder(path)) else { return meshes };
    if from != to {
        meshes.files.values_mut().for_each(|file| *file = way(&from.join(&file), &to));
    }
    meshes
}
