//! Models that come with the program, known by their names in any folder.

use std::path::Path;

/// The model of the IRB 360-6/1600.
pub const IRB_360_6_1600: &str = include_str!("../../../../models/irb360-6-1600.toml");
/// The model of a delta robot without a telescope.
pub const CLAVEL_DELTA: &str = include_str!("../../../../models/clavel-delta.toml");

/// The models with their names.
pub const SHIPPED: [(&str, &str); 13] = [
    ("irb360-6-1600", IRB_360_6_1600),
    ("irb360-1-1130", include_str!("../../../../models/irb360-1-1130.toml")),
    ("irb360-3-1130", include_str!("../../../../models/irb360-3-1130.toml")),
    ("irb360-8-1130", include_str!("../../../../models/irb360-8-1130.toml")),
    ("irb360-1-1600", include_str!("../../../../models/irb360-1-1600.toml")),
    ("irb360-6-1600-disassembled", include_str!("../../../../models/irb360-6-1600-disassembled.toml")),
    ("clavel-delta", CLAVEL_DELTA),
    ("linear-delta", include_str!("../../../../models/linear-delta.toml")),
    ("par4", include_str!("../../../../models/par4.toml")),
    ("h4", include_str!("../../../../models/h4.toml")),
    ("i4", include_str!("../../../../models/i4.toml")),
    ("par2", include_str!("../../../../models/par2.toml")),
    ("servo-axis", include_str!("../../../../models/servo-axis.toml")),
];

/// The text of the model that `path` names; `None` if there is a file or a folder of that name, or no such model.
pub fn named(path: &Path) -> Option<&'static str> {
    let name = path.file_name()?.to_str()?;
    SHIPPED.iter().find(|(own, _)| *own == name).filter(|_| !path.exists()).map(|(_, text)| *text)
}

/// Whether `name` alone is a shipped model that no file in `folder` goes before.
pub(crate) fn is_named(folder: &Path, name: &str) -> bool {
    Path::new(name).components().count() == 1 && named(&folder.join(name)).is_some()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model;

    #[test]
    fn every_shipped_model_is_known_by_name_and_a_file_goes_before() {
        for (name, text) in SHIPPED {
            assert_eq!(model::read(Path::new(name)).unwrap().source.as_deref(), Some(text), "{name}");
        }
        let folder = tempfile::tempdir().unwrap();
        let own = folder.path().join("servo-axis");
        std::fs::write(&own, "no model").unwrap();
        assert!(model::read(&own).is_err());
        let e = format!("{:?}", model::read(Path::new("irb360-6-1601")).err().expect("no such model"));
        assert!(e.contains("irb360-6-1600"), "{e}");
    }
}
