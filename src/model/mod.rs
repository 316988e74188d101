//! Model of a machine: the content of a model file, with the effects that are switched on.
//!
//! A [`Model`] is constant after loading.

pub mod history;
mod meshes;
pub mod provenance;
mod summary;
#[cfg(test)]
pub(crate) mod testing;

pub use history::Added;
pub use meshes::{MeshPart, Meshes};
pub use provenance::Provenance;
pub use summary::summary;

use std::path::PathBuf;
use std::sync::Arc;

use crate::effects::{Effects, Host, MachineView};
use crate::machine::{Bodies, Drive, Geometry, LinkParameters, Mechanism, Noise, PerAxis, Sockets, Stops};

/// Description of one machine.
#[derive(Clone)]
pub struct Model {
    /// Name of the machine, e.g. `irb360-6-1600`.
    pub name: String,
    /// File the model was read from.
    pub path: Option<PathBuf>,
    /// Text of that file, with its comments.
    pub source: Option<Arc<str>>,
    /// Kind of machine.
    pub mechanism: Mechanism,
    /// Whether the robot is assembled; false for arms and rotor as independent axes, and for a single axis.
    pub assembled: bool,
    /// Lengths and joint limits.
    pub geometry: Geometry,
    /// Inertia of every body, without payload.
    pub bodies: Bodies,
    /// Which numbers of the bodies are parameters; not stored in the file.
    pub link_parameters: LinkParameters,
    /// Drives 1–3 (arms) and 4 (telescope).
    pub drives: PerAxis<Drive>,
    /// Ball sockets.
    pub sockets: Sockets,
    /// Hard stops.
    pub stops: Stops,
    /// Sensor noise of the machine.
    pub noise: Noise,
    /// Gravitational acceleration along −z, m/s².
    pub gravity: f64,
    /// Sampling and control period, s.
    pub sample_time: f64,
    /// Active effects in the order of the registry.
    pub effects: Effects,
    /// Effects added to the model, in order, with the error before and after.
    pub history: Vec<Added>,
    /// Meshes that show its parts.
    pub meshes: Meshes,
}

impl Model {
    /// The properties of the machine on which units, counts and default values of effect parameters depend.
    pub fn host(&self) -> Host {
        Host::new(self.mechanism, &self.drives[0])
    }

    /// The data of the machine from which effects derive their constants.
    pub fn view(&self) -> MachineView<'_> {
        MachineView {
            mechanism: self.mechanism,
            geometry: &self.geometry,
            bodies: &self.bodies,
            drives: &self.drives,
            sockets: &self.sockets,
            effects: &self.effects,
        }
    }
}
