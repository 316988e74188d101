//! Meshes of the user in place of the generated shapes.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use rerun::{RecordingStream, Rgba32, archetypes as a};

use super::Outcome;
use super::content::Scene;
use deltatwin::model::{MeshPart, Model};
use deltatwin_io::model::meshes;
use deltatwin_io::outside::Access;
use miette::{IntoDiagnostic, WrapErr};

/// Meshes of a model, read from their files.
#[derive(Clone, Debug, Default)]
pub struct Assets(BTreeMap<MeshPart, Asset>);

/// A mesh and the length of its unit, m.
#[derive(Clone, Debug)]
pub struct Asset {
    mesh: a::Asset3D,
    scale: f64,
    /// Whether it has no colours of its own.
    is_bare: bool,
}

/// Size of the largest file, bytes.
const LARGEST: u64 = 64 << 20;

impl Assets {
    /// The meshes that `model` names, as far as `access` admits.
    ///
    /// # Errors
    /// The key of the mesh and its file, if that is outside of the model's project or cannot be read.
    pub fn of(model: &Model, access: Access) -> miette::Result<Self> {
        let read = |(part, file): (MeshPart, PathBuf)| {
            let asset = Asset::read(&file, model.meshes.scale);
            let place = || format!("{}: [meshes] {} = {}", model.name, part.key(), file.display());
            asset.into_diagnostic().wrap_err_with(place).map(|asset| (part, asset))
        };
        meshes::files(model, access)?.into_iter().map(read).collect::<miette::Result<_>>().map(Self)
    }
}

/// The user's mesh of a part.
pub(super) fn of<'s>(scene: &'s Scene, part: MeshPart) -> Option<&'s Asset> {
    scene.assets.and_then(|assets| assets.0.get(&part))
}

/// Entity of the mesh of `body`, whose scale does not change what is below `body`.
pub(super) fn entity(body: &str) -> String {
    format!("{body}/mesh")
}

impl Asset {
    fn read(file: &Path, scale: f64) -> io::Result<Self> {
        let about = std::fs::metadata(file)?;
        if !about.is_file() || about.len() > LARGEST {
            return Err(io::Error::other(format!("expected a file of at most {} MB", LARGEST >> 20)));
        }
        let is_bare = file.extension().is_some_and(|e| e.eq_ignore_ascii_case("stl"));
        Ok(Self { mesh: a::Asset3D::from_file_path(file)?, scale, is_bare })
    }

    /// Logs the mesh of `body`, without colours of its own in the colour `usual`, unless others follow.
    pub fn log(&self, rec: &RecordingStream, body: &str, usual: Option<[u8; 3]>) -> Outcome {
        let mesh = match usual.filter(|_| self.is_bare) {
            Some([r, g, b]) => self.mesh.clone().with_albedo_factor(Rgba32::from_rgb(r, g, b)),
            None => self.mesh.clone(),
        };
        rec.log_static(entity(body), &mesh)?;
        rec.log_static(entity(body), &a::Transform3D::update_fields().with_scale([self.scale as f32; 3]))?;
        Ok(())
    }
}
