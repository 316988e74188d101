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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Scene, entities};
    use deltatwin::kinematics::{JointState, Motion};

    /// Binary STL of a tetrahedron with edges of 100 units along the axes.
    fn tetrahedron() -> Vec<u8> {
        let corners = [[0.0f32; 3], [100.0, 0.0, 0.0], [0.0, 100.0, 0.0], [0.0, 0.0, 100.0]];
        let faces: [[usize; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];
        let mut file = vec![b' '; 80];
        file.extend(4u32.to_le_bytes());
        for face in faces {
            let numbers = [0.0; 3].into_iter().chain(face.into_iter().flat_map(|k| corners[k]));
            file.extend(numbers.flat_map(f32::to_le_bytes));
            file.extend([0, 0]);
        }
        file
    }

    #[test]
    fn a_mesh_takes_the_place_of_the_shape() {
        let folder = tempfile::tempdir().unwrap();
        let text = std::fs::read_to_string("../../models/irb360-6-1600.toml").unwrap();
        let file = folder.path().join("own.toml");
        std::fs::write(&file, text + "\n[meshes]\nscale = 0.001\narm = \"arm.stl\"\n").unwrap();
        let model = deltatwin_io::model::read(&file).unwrap();
        let missing = format!("{:?}", Assets::of(&model, Access::PROJECT).unwrap_err());
        assert!(missing.contains("[meshes] arm") && missing.contains("arm.stl"), "{missing}");
        std::fs::write(folder.path().join("arm.stl"), tetrahedron()).unwrap();
        let assets = Assets::of(&model, Access::PROJECT).unwrap();

        let motion = Motion::assembled(&model.geometry, &JointState::default()).unwrap();
        let mut scene = Scene::new(model.mechanism, &model.geometry, vec![0.0], vec![motion.poses()]);
        let has = |scene: &Scene, entity: &str| entities(scene).contains(entity);
        assert!(!has(&scene, "/world/robot/arm1/mesh") && has(&scene, "/world/robot/arm1/neck"));
        scene.assets = Some(&assets);
        assert!(has(&scene, "/world/robot/arm3/mesh") && !has(&scene, "/world/robot/arm1/neck"));
        assert!(has(&scene, "/world/robot/strut1/cup_upper"), "other parts stay");
    }
}
