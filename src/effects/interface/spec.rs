//! What is known of an effect without a motion.

use std::borrow::Cow;

use super::{MachineView, Parameter};
use crate::machine::Part;

/// What is known of an effect without a motion: its name, its parameters, what it reads and changes, and how a search for it
/// begins.
#[derive(Clone, Debug)]
pub struct Spec {
    /// Name in model files and reports.
    pub name: &'static str,
    /// What part of a machine it acts on; a machine without that part cannot have the effect.
    pub acts_on: Part,
    /// Law, where it shows and where the numbers come from.
    pub about: About,
    /// Parameters in the order of the values.
    pub parameters: Cow<'static, [Parameter]>,
    /// What the effect changes; decides how its columns are computed.
    pub kind: Kind,
    /// What its wrenches read besides positions and velocities.
    pub reads: Reads,
    /// Whether inverse dynamics along a measured motion shows the effect. If not, only the twin has it: identification
    /// leaves its parameters alone, and the diagnosis lists it as unseen.
    pub identifiable: bool,
    /// How a search for the effect begins.
    pub search: Search,
    /// What a model says of a constant of the law, for an effect that is not in the model yet; none leaves the default.
    constants: fn(&str, &MachineView) -> Option<f64>,
}

/// What the wrenches of an effect read besides positions and velocities.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reads {
    /// Reactions in the struts.
    pub reactions: bool,
    /// Accelerations of joints or platform.
    pub accelerations: bool,
    /// Torques of the drives, along a given motion too.
    pub torque: bool,
}

impl Reads {
    /// Positions and velocities only.
    pub const MOTION: Self = Self { reactions: false, accelerations: false, torque: false };
}

/// Where a search for an absent effect begins.
#[derive(Clone, Copy, Debug)]
pub struct Search {
    /// Factors of the usual values of the shape parameters: one grid for each of the leading ones, searched one at a time.
    /// The others begin at their usual values.
    pub grids: &'static [&'static [f64]],
    /// Shapes at which a search begins where no single grid finds them; the grids are left aside then.
    pub starts: &'static [Start],
    /// Constants of 0 or 1 that a search tries both ways.
    pub switches: &'static [&'static str],
}

/// Values at which a search begins: up to three parameter blocks, by number, with what stands in them.
#[derive(Debug)]
pub struct Start(pub [Option<(usize, &'static [f64])>; 3]);

/// What an effect changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Inertia of bodies; linear.
    Inertia,
    /// Wrenches on bodies.
    Force,
    /// Lengths; acts through the kinematics.
    Geometry,
    /// Reported signals.
    Sensor,
    /// What lies between encoder and joint; shifts the motion that a recording stands for.
    Encoder,
}

impl Kind {
    /// Whether the effect acts through everything else rather than by terms of its own, so that its columns are
    /// differences of whole predictions.
    pub fn acts_on_the_whole(self) -> bool {
        matches!(self, Self::Geometry | Self::Sensor | Self::Encoder)
    }
}

/// What a person wants to know about an effect.
#[derive(Clone, Copy, Debug)]
pub struct About {
    /// One line: what it is.
    pub summary: &'static str,
    /// The law with its symbols.
    pub law: &'static str,
    /// Where it shows in measurements.
    pub shows: &'static str,
    /// Source of the law and its usual magnitude.
    pub source: &'static str,
}

fn unknown(_parameter: &str, _model: &MachineView) -> Option<f64> {
    None
}

impl Spec {
    /// A force law that reads the motion only and that inverse dynamics shows.
    pub const fn new(name: &'static str, acts_on: Part, about: About, parameters: &'static [Parameter]) -> Self {
        let search = Search { grids: &[&[0.3, 0.6, 1.0, 2.0, 4.0]], starts: &[], switches: &[] };
        Self {
            name,
            acts_on,
            about,
            parameters: Cow::Borrowed(parameters),
            kind: Kind::Force,
            reads: Reads::MOTION,
            identifiable: true,
            search,
            constants: unknown,
        }
    }

    /// The same of an effect that changes something else than forces.
    pub const fn kind(mut self, kind: Kind) -> Self {
        self.kind = kind;
        self
    }

    /// The same of wrenches that read more than positions and velocities.
    pub const fn reads(mut self, reads: Reads) -> Self {
        self.reads = reads;
        self
    }

    /// The same of an effect that inverse dynamics along a measured motion does not show.
    pub const fn twin_only(mut self) -> Self {
        self.identifiable = false;
        self
    }

    /// The same with other grids for the leading shape parameters, see [`Search::grids`].
    pub const fn grids(mut self, grids: &'static [&'static [f64]]) -> Self {
        self.search.grids = grids;
        self
    }

    /// The same with shapes to begin at, see [`Search::starts`].
    pub const fn starts(mut self, starts: &'static [Start]) -> Self {
        self.search.starts = starts;
        self
    }

    /// The same with constants of 0 or 1 that are tried both ways.
    pub const fn switches(mut self, switches: &'static [&'static str]) -> Self {
        self.search.switches = switches;
        self
    }

    /// The same of an effect whose constants stand in the model: `constants(parameter, model)`.
    pub const fn constants(mut self, constants: fn(&str, &MachineView) -> Option<f64>) -> Self {
        self.constants = constants;
        self
    }

    /// What `model` says of constant `parameter` of the law; none where its default stands.
    pub fn constant(&self, parameter: &str, model: &MachineView) -> Option<f64> {
        (self.constants)(parameter, model)
    }
}
