//! Parameters of effects and where their values stand.

use std::borrow::Cow;

use crate::machine::{Mechanism, Unit};

/// Identity of one number among the parameters of a machine: value `item` of parameter `block` of an effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Param {
    /// Name of the effect; a machine has each once.
    pub effect: &'static str,
    /// Which of the effect's parameters.
    pub block: usize,
    /// Which of its values.
    pub item: usize,
}

/// How a parameter enters the law.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Proportionally; zero switches the term off.
    Linear,
    /// Nonlinearly, estimated by an outer iteration.
    Shape,
    /// A constant of the law, taken from the model file.
    Fixed,
}

/// How many values a parameter has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Count {
    /// A single number.
    One,
    /// One per arm (array of 3).
    PerArm,
    /// One per drive (array of 3 or 4; three mean the arms).
    PerDrive,
    /// One per axis, the telescope's included.
    PerAxis,
    /// The same for what grows with a drive; an array of three means the arms, without the telescope's.
    AllDrives,
    /// A fixed number of named values (array).
    Named(&'static [&'static str]),
}

impl Count {
    /// Number of values on a machine; of one that may have more, the least.
    pub fn on(self, machine: Mechanism) -> usize {
        match self {
            Self::One => 1,
            Self::PerArm | Self::PerDrive => machine.arms(),
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
    /// Unit on a machine whose drives turn.
    pub unit: Unit,
    /// How many values.
    pub count: Count,
    /// How it enters the law.
    pub role: Role,
    /// Usual magnitude; the starting value of shape parameters and the default of optional ones. Of [`Count::AllDrives`]
    /// that of an arm's drive.
    pub default: f64,
    /// Allowed values.
    pub range: (f64, f64),
}

impl Parameter {
    /// A parameter of one value, with its usual magnitude and what is allowed.
    pub const fn new(name: &'static str, unit: Unit, role: Role, default: f64, range: (f64, f64)) -> Self {
        Self { name: Cow::Borrowed(name), unit, count: Count::One, role, default, range }
    }

    /// The same with another number of values.
    pub const fn counted(mut self, count: Count) -> Self {
        self.count = count;
        self
    }

    /// The same within another range.
    pub const fn within(mut self, range: (f64, f64)) -> Self {
        self.range = range;
        self
    }

    /// The same constant as a shape to be searched within a range.
    pub const fn searched(mut self, range: (f64, f64)) -> Self {
        self.role = Role::Shape;
        self.within(range)
    }

    /// The same in another unit.
    pub const fn with_unit(mut self, unit: Unit) -> Self {
        self.unit = unit;
        self
    }
}

/// Where each parameter's values stand in the flat list.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    pub(super) starts: Vec<usize>,
}

impl Layout {
    /// Layout for parameter blocks of the given lengths.
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

/// Values of an effect's parameters, addressed by parameter block.
#[derive(Clone, Copy)]
pub struct Values<'a> {
    values: &'a [f64],
    layout: &'a Layout,
}

impl<'a> Values<'a> {
    /// Flat `values` with their `layout`.
    pub fn new(values: &'a [f64], layout: &'a Layout) -> Self {
        Self { values, layout }
    }

    /// All values of parameter `block`.
    pub fn block(&self, block: usize) -> &'a [f64] {
        &self.values[self.layout.starts[block]..self.layout.starts[block + 1]]
    }

    /// The value of the scalar parameter `block`.
    pub fn one(&self, block: usize) -> f64 {
        self.values[self.layout.starts[block]]
    }

    /// Number of values of parameter `block`.
    pub fn len(&self, block: usize) -> usize {
        self.block(block).len()
    }

    /// Flat index of value `i` of parameter `block`, as `wrenches` and `inertia` report it.
    pub fn index(&self, block: usize, i: usize) -> usize {
        self.layout.starts[block] + i
    }
}
