//! Meshes that show the machine in place of generated shapes.

use std::collections::BTreeMap;
use std::path::PathBuf;

/// Meshes of a machine's parts.
///
/// A mesh is in the frame of its body: those of [`Bodies`](crate::machine::Bodies), the inertial frame for the base, the
/// coordinate's axis (x of a prismatic, y of a revolute one) for the part of a single axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Meshes {
    /// Length of a unit of all files, m.
    pub scale: f64,
    /// File of each part as the model file names it, relative to its folder.
    pub files: BTreeMap<MeshPart, PathBuf>,
}

impl Default for Meshes {
    fn default() -> Self {
        Self { scale: 1.0, files: BTreeMap::new() }
    }
}

/// A part of a machine that may have a mesh; arms are alike, and struts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum MeshPart {
    /// What does not move.
    Base,
    /// Arms or carriages.
    Arm,
    /// Struts.
    Strut,
    /// Moving platform.
    Platform,
    /// End effector.
    EndEffector,
    /// Upper part of the telescope.
    TelescopeUpper,
    /// Lower part of the telescope.
    TelescopeLower,
    /// Moving part of a single axis.
    Axis,
}

impl MeshPart {
    /// Every part.
    pub const ALL: [Self; 8] = [
        Self::Base,
        Self::Arm,
        Self::Strut,
        Self::Platform,
        Self::EndEffector,
        Self::TelescopeUpper,
        Self::TelescopeLower,
        Self::Axis,
    ];

    /// Key of the part in the model file.
    pub fn key(self) -> &'static str {
        match self {
            Self::Base => "base",
            Self::Arm => "arm",
            Self::Strut => "strut",
            Self::Platform => "platform",
            Self::EndEffector => "end_effector",
            Self::TelescopeUpper => "telescope_upper",
            Self::TelescopeLower => "telescope_lower",
            Self::Axis => "axis",
        }
    }
}
