//! Parameters of effects, and the layout of their values.

use std::borrow::Cow;

use crate::machine::{Inertia, Mechanism, Unit};

/// Identity of one number among the parameters of a machine: value `item` of parameter `block` of an effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Param {
    /// Name of the effect, unique on a machine.
    pub effect: &'static str,
    /// Index of the parameter within the effect.
    pub block: usize,
    /// Index of the value within the parameter.
    pub item: usize,
}

/// How a parameter enters the law.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Proportional factor; zero removes the term.
    Linear,
    /// Nonlinear, estimated in an outer iteration.
    Shape,
    /// Constant of the law, taken from the model file.
    Fixed,
}

/// Number of values of a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Count {
    /// A single number.
    One,
    /// One per driven arm (array of 3).
    PerArm,
    /// One per limb, driven or passive (array of 3 on three limbs).
    PerLimb,
    /// One per strut (array of 6 on three limbs).
    PerStrut,
    /// One per drive (array of 3 or 4; three values mean the arms).
    PerDrive,
    /// One per axis, including that of the telescope.
    PerAxis,
    /// One per axis, with a magnitude that scales with the drive; three values mean the arms.
    AllDrives,
    /// A fixed number of named values (array).
    Named(&'static [&'static str]),
    /// Any number of values (array); one by default.
    List,
    /// One per arm for each value of the [`Self::List`] that is the given parameter block (array, all arms of the first
    /// value first).
    PerArmOf(usize),
}

impl Count {
    /// Number of values on a machine; the smallest one if several are allowed, and that of lists of one value.
    pub fn on(self, machine: Mechanism) -> usize {
        match self {
            Self::One | Self::List => 1,
            Self::PerArm | Self::PerDrive | Self::PerArmOf(_) => machine.arms(),
            Self::PerLimb => machine.limbs(),
            Self::PerStrut => machine.struts(),
            Self::PerAxis | Self::AllDrives => machine.axes(),
            Self::Named(names) => names.len(),
        }
    }
}

/// A parameter of an effect.
#[derive(Clone, Debug)]
pub struct Parameter {
    /// Key in the effect's table.
    pub name: Cow<'static, str>,
    /// Unit on a machine with revolute drives.
    pub unit: Unit,
    /// Number of values.
    pub count: Count,
    /// How it enters the law.
    pub role: Role,
    /// Typical magnitude: the initial value of shape parameters and the default of optional ones. For
    /// [`Count::AllDrives`] that of an arm drive.
    pub default: f64,
    /// Lower and upper bound.
    pub range: (f64, f64),
    /// Whether zero is allowed although it is below the range: the law without what a shape parameter describes. At zero it
    /// is a constant and not estimated.
    pub or_zero: bool,
}

impl Parameter {
    /// A parameter of one value, with its nominal magnitude and its allowed range.
    pub const fn new(name: &'static str, unit: Unit, role: Role, default: f64, range: (f64, f64)) -> Self {
        Self { name: Cow::Borrowed(name), unit, count: Count::One, role, default, range, or_zero: false }
    }

    /// The parameter with another number of values.
    pub const fn counted(mut self, count: Count) -> Self {
        self.count = count;
        self
    }

    /// The parameter with another range.
    pub const fn within(mut self, range: (f64, f64)) -> Self {
        self.range = range;
        self
    }

    /// The parameter with zero allowed, see [`Self::or_zero`].
    pub const fn or_zero(mut self) -> Self {
        self.or_zero = true;
        self
    }

    /// Least value that the law admits.
    pub fn least(&self) -> f64 {
        if self.or_zero { self.range.0.min(0.0) } else { self.range.0 }
    }

    /// The constant turned into a shape parameter, to be estimated within `range`.
    pub const fn searched(mut self, range: (f64, f64)) -> Self {
        self.role = Role::Shape;
        self.within(range)
    }

    /// The parameter with another unit.
    pub const fn with_unit(mut self, unit: Unit) -> Self {
        self.unit = unit;
        self
    }
}

/// Position of each parameter's values in the flat list.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    pub(super) starts: Vec<usize>,
}

impl Layout {
    /// Layout of parameter blocks with the given lengths.
    pub fn new(lengths: impl IntoIterator<Item = usize>) -> Self {
        let mut starts = vec![0];
        for n in lengths {
            starts.push(starts[starts.len() - 1] + n);
        }
        Self { starts }
    }

    /// Total number of values.
    pub fn len(&self) -> usize {
        self.starts[self.starts.len() - 1]
    }

    /// Whether there are no values.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Parameter values of an effect, addressed by parameter block.
#[derive(Clone, Copy)]
pub struct Values<'a> {
    values: &'a [f64],
    layout: &'a Layout,
    carriages: bool,
}

impl<'a> Values<'a> {
    /// View of flat `values` with their `layout`, on the reference machine.
    pub fn new(values: &'a [f64], layout: &'a Layout) -> Self {
        Self { values, layout, carriages: false }
    }

    /// The values on another machine.
    pub fn on(self, mechanism: Mechanism) -> Self {
        Self { carriages: mechanism.has_carriages(), ..self }
    }

    /// Inertia of 1 kg·m² about an arm's shaft, or of 1 kg along a carriage's guide, in the frame of the arm, as of a motor that
    /// moves with it. Its mass must not weigh: a law that adds it also adds the force m·g upwards.
    pub fn of_motor(&self) -> Inertia {
        match self.carriages {
            true => Inertia::diagonal(1.0, [0.0; 3], [0.0; 3]),
            // Only the moment about y enters; with as much about z, an arm from which it is taken is still a possible body.
            false => Inertia::diagonal(0.0, [0.0; 3], [0.0, 1.0, 1.0]),
        }
    }

    /// All values of parameter `block`.
    ///
    /// # Panics
    /// If there is no parameter `block`.
    pub fn block(&self, block: usize) -> &'a [f64] {
        &self.values[self.layout.starts[block]..self.layout.starts[block + 1]]
    }

    /// The value of the scalar parameter `block`.
    ///
    /// # Panics
    /// If there is no parameter `block`.
    pub fn one(&self, block: usize) -> f64 {
        self.values[self.layout.starts[block]]
    }

    /// Number of values of parameter `block`.
    ///
    /// # Panics
    /// If there is no parameter `block`.
    pub fn len(&self, block: usize) -> usize {
        self.block(block).len()
    }

    /// Flat index of value `i` of parameter `block`, as passed to the sinks of `wrenches` and `inertia`.
    ///
    /// # Panics
    /// If there is no parameter `block`.
    pub fn index(&self, block: usize, i: usize) -> usize {
        self.layout.starts[block] + i
    }
}
