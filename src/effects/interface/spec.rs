//! Properties of an effect that do not depend on the motion.

use std::borrow::Cow;

use super::{MachineView, Parameter};
use crate::machine::Part;

/// Properties of an effect that do not depend on the motion: name, parameters, dependencies, and initial values of a
/// search.
#[derive(Clone, Debug)]
pub struct Spec {
    /// Name in model files and reports.
    pub name: &'static str,
    /// Part of a machine on which it acts; a machine without that part cannot have the effect.
    pub acts_on: Part,
    /// Law, observable consequences and sources.
    pub about: About,
    /// Parameters in the order of the values.
    pub parameters: Cow<'static, [Parameter]>,
    /// What the effect changes; determines how its regressor columns are computed.
    pub kind: Kind,
    /// Quantities on which its wrenches depend besides positions and velocities.
    pub reads: Reads,
    /// Whether inverse dynamics along a measured motion depends on the effect. If not, only the twin implements it: its
    /// parameters are not estimated, and the diagnosis lists it as unobservable.
    pub identifiable: bool,
    /// Whether it is friction of the drives: all of these together take power from each drive.
    pub is_drive_friction: bool,
    /// Initial values of a search for the effect.
    pub search: Search,
    /// Value of a constant of the law derived from a model, for an effect that is not in the model; `None` keeps the
    /// default.
    constants: fn(&str, &MachineView) -> Option<f64>,
}

/// Quantities on which the wrenches of an effect depend besides positions and velocities.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reads {
    /// Strut reactions.
    pub reactions: bool,
    /// Accelerations of joints or platform.
    pub accelerations: bool,
    /// Drive torques, also along a given motion.
    pub torque: bool,
    /// The stated payload, without which they vanish.
    pub payload: bool,
    /// Inertia of the bodies.
    pub inertia: bool,
}

impl Reads {
    /// Positions and velocities only.
    pub const MOTION: Self =
        Self { reactions: false, accelerations: false, torque: false, payload: false, inertia: false };
}

/// Initial values of a search for an absent effect.
#[derive(Clone, Copy, Debug)]
pub struct Search {
    /// Factors on the default values of the shape parameters: one grid for each of the leading ones, searched one at a
    /// time. The others start at their defaults.
    pub grids: &'static [&'static [f64]],
    /// Complete starting points where single grids do not suffice; they replace the grids.
    pub starts: &'static [Start],
    /// Constants with values 0 or 1, for both of which a search is made.
    pub switches: &'static [&'static str],
    /// Whether an item of a linear parameter acts with the same item of the shape parameters alone, as each direction of a
    /// frame does: its column serves all starting points that have these values.
    pub is_by_item: bool,
}

/// Starting point of a search: values of up to three parameter blocks, by block index; lengths are those on the reference
/// machine.
#[derive(Debug)]
pub struct Start(pub [Option<(usize, &'static [f64])>; 3]);

/// What an effect changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Inertia of bodies; linear in the parameters.
    Inertia,
    /// Wrenches on bodies.
    Force,
    /// Dimensions; acts through the kinematics.
    Geometry,
    /// Reported signals.
    Sensor,
    /// Relation between encoder reading and joint angle; shifts the motion that a recording represents.
    Encoder,
}

impl Kind {
    /// Whether the effect has no terms of its own but changes all others, so that its columns are differences of
    /// complete predictions.
    pub fn acts_on_the_whole(self) -> bool {
        matches!(self, Self::Geometry | Self::Sensor | Self::Encoder)
    }
}

/// Description of an effect for users.
#[derive(Clone, Copy, Debug)]
pub struct About {
    /// Summary in one line.
    pub summary: &'static str,
    /// The law with its symbols.
    pub law: &'static str,
    /// Observable consequences in measurements.
    pub shows: &'static str,
    /// Source of the law and of its typical magnitude.
    pub source: &'static str,
}

fn unknown(_parameter: &str, _model: &MachineView) -> Option<f64> {
    None
}

impl Spec {
    /// A force law that depends on positions and velocities only and is observable by inverse dynamics.
    pub const fn new(name: &'static str, acts_on: Part, about: About, parameters: &'static [Parameter]) -> Self {
        let search = Search { grids: &[&[0.3, 0.6, 1.0, 2.0, 4.0]], starts: &[], switches: &[], is_by_item: false };
        Self {
            name,
            acts_on,
            about,
            parameters: Cow::Borrowed(parameters),
            kind: Kind::Force,
            reads: Reads::MOTION,
            identifiable: true,
            is_drive_friction: false,
            search,
            constants: unknown,
        }
    }

    /// The properties with another kind.
    pub const fn kind(mut self, kind: Kind) -> Self {
        self.kind = kind;
        self
    }

    /// The properties with further dependencies of the wrenches.
    pub const fn reads(mut self, reads: Reads) -> Self {
        self.reads = reads;
        self
    }

    /// The properties of an effect that inverse dynamics along a measured motion does not depend on.
    pub const fn twin_only(mut self) -> Self {
        self.identifiable = false;
        self
    }

    /// The properties of friction of the drives.
    pub const fn drive_friction(mut self) -> Self {
        self.is_drive_friction = true;
        self
    }

    /// The properties with other grids for the leading shape parameters, see [`Search::grids`].
    pub const fn grids(mut self, grids: &'static [&'static [f64]]) -> Self {
        self.search.grids = grids;
        self
    }

    /// The properties with starting points, see [`Search::starts`].
    pub const fn starts(mut self, starts: &'static [Start]) -> Self {
        self.search.starts = starts;
        self
    }

    /// The properties of an effect whose items act each by itself, see [`Search::is_by_item`].
    pub const fn by_item(mut self) -> Self {
        self.search.is_by_item = true;
        self
    }

    /// The properties with constants of 0 or 1 that are both tried.
    pub const fn switches(mut self, switches: &'static [&'static str]) -> Self {
        self.search.switches = switches;
        self
    }

    /// The properties of an effect whose constants follow from the model by `constants(parameter, model)`.
    pub const fn constants(mut self, constants: fn(&str, &MachineView) -> Option<f64>) -> Self {
        self.constants = constants;
        self
    }

    /// Value of constant `parameter` of the law derived from `model`; `None` if its default applies.
    pub fn constant(&self, parameter: &str, model: &MachineView) -> Option<f64> {
        (self.constants)(parameter, model)
    }
}
