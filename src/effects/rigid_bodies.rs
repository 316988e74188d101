//! Inertia and weight of the links, always active; its parameters are the numbers of `[bodies]`.
//!
//! The set of parameters depends on the machine and its configuration ([`RigidBodies::of`]) and on the symmetry
//! assumptions ([`RigidBodies::with`]). For the assembled robot it follows [Gnad 2024], section 2.3: equal limbs,
//! struts and telescope parts symmetric about their axis, no deviation moments, platform in pure translation. On the
//! disassembled robot every arm has its own parameters (eq. 46–47). Numbers that do not enter the equations of motion
//! (e.g. the platform's inertia tensor) are not parameters.

mod tables;

use std::borrow::Cow;

use std::ops::Range;
use std::sync::{Arc, LazyLock};

use self::tables::{Robot, relative, table};
use super::{About, Count, Effect, Kind, Parameter, Part, Role, Spec, Unit, Values};
use crate::machine::Payload;
use crate::machine::bodies::{self, ARM, Bodies, Inertia, PLATFORM, ROTOR, STRUT, TELESCOPE_LOWER, TELESCOPE_UPPER};
use crate::machine::{Axis, Joint, LinkParameters, Mechanism};

/// Name of the effect.
pub const NAME: &str = "rigid_bodies";

/// Newton–Euler terms of every body per unit of its inertial parameters ([Gnad 2024], eq. 2–4).
pub struct RigidBodies {
    spec: Spec,
    /// Bodies and unit inertia of each parameter value.
    units: Vec<(Vec<usize>, UnitInertia)>,
}

const fn one(name: &'static str, unit: Unit, default: f64) -> Parameter {
    Parameter::new(name, unit, Role::Linear, default, (-100.0, 100.0))
}

const fn per_arm(name: &'static str, unit: Unit, default: f64) -> Parameter {
    one(name, unit, default).counted(Count::PerArm)
}

const fn lone(name: &'static str) -> Parameter {
    one(name, Unit::KgM2, 0.258).within((0.0, 1e6))
}

const ROTOR_INERTIA: Parameter = one("rotor_inertia_zz", Unit::KgM2, 0.003);

/// Parameters of the assembled robot in order; without a telescope, those of arms, struts and platform.
pub const PARAMETERS: &[Parameter] = &[
    one("arm_first_moment_x", Unit::KgM, 0.176),
    one("arm_first_moment_z", Unit::KgM, 0.006),
    one("arm_inertia_yy", Unit::KgM2, 0.258),
    one("strut_mass", Unit::Kg, 0.179),
    one("strut_first_moment_x", Unit::KgM, 0.076),
    one("strut_inertia_xx", Unit::KgM2, 1.5e-5),
    one("strut_inertia_yy", Unit::KgM2, 0.075),
    one("platform_mass", Unit::Kg, 1.2),
    // Tilts the platform and affects the strut forces alone.
    one("platform_first_moment_z", Unit::KgM, -0.024),
    one("telescope_upper_first_moment_z", Unit::KgM, -0.219),
    one("telescope_upper_inertia_xx", Unit::KgM2, 0.084),
    one("telescope_upper_inertia_zz", Unit::KgM2, 1.9e-5),
    one("telescope_lower_mass", Unit::Kg, 0.557),
    one("telescope_lower_first_moment_z", Unit::KgM, 0.146),
    one("telescope_lower_inertia_xx", Unit::KgM2, 0.077),
    one("telescope_lower_inertia_zz", Unit::KgM2, 3.0e-5),
    ROTOR_INERTIA,
];

/// Parameters of independent arms and, with a telescope, of the rotor of motor 4.
const PER_ARM: &[Parameter] = &[
    per_arm("arm_first_moment_x", Unit::KgM, 0.176),
    per_arm("arm_first_moment_z", Unit::KgM, 0.006),
    per_arm("arm_inertia_yy", Unit::KgM2, 0.258),
    ROTOR_INERTIA,
];

const ARM_BODIES: Range<usize> = ARM..STRUT;
const STRUT_BODIES: Range<usize> = STRUT..PLATFORM;
const fn body(b: usize) -> Range<usize> {
    b..b + 1
}

const UNITS: &[(Range<usize>, UnitInertia); PARAMETERS.len()] = &[
    (ARM_BODIES, UnitInertia::Moment(0)),
    (ARM_BODIES, UnitInertia::Moment(2)),
    (ARM_BODIES, UnitInertia::Tensor(&[1])),
    (STRUT_BODIES, UnitInertia::Mass),
    (STRUT_BODIES, UnitInertia::Moment(0)),
    (STRUT_BODIES, UnitInertia::Tensor(&[0])),
    (STRUT_BODIES, UnitInertia::Tensor(&[1, 2])),
    (body(PLATFORM), UnitInertia::Mass),
    (body(PLATFORM), UnitInertia::Moment(2)),
    (body(TELESCOPE_UPPER), UnitInertia::Moment(2)),
    (body(TELESCOPE_UPPER), UnitInertia::Tensor(&[0, 1])),
    (body(TELESCOPE_UPPER), UnitInertia::Tensor(&[2])),
    (body(TELESCOPE_LOWER), UnitInertia::Mass),
    (body(TELESCOPE_LOWER), UnitInertia::Moment(2)),
    (body(TELESCOPE_LOWER), UnitInertia::Tensor(&[0, 1])),
    (body(TELESCOPE_LOWER), UnitInertia::Tensor(&[2])),
    (body(ROTOR), UnitInertia::Tensor(&[2])),
];

/// Mass of a carriage; it does not turn, so that nothing else of it enters.
const CARRIAGE: Parameter = one("arm_mass", Unit::Kg, 1.0);

const UNITS_PER_ARM: &[(Range<usize>, UnitInertia); 10] = &[
    (body(ARM), UnitInertia::Moment(0)),
    (body(bodies::arm(1)), UnitInertia::Moment(0)),
    (body(bodies::arm(2)), UnitInertia::Moment(0)),
    (body(ARM), UnitInertia::Moment(2)),
    (body(bodies::arm(1)), UnitInertia::Moment(2)),
    (body(bodies::arm(2)), UnitInertia::Moment(2)),
    (body(ARM), UnitInertia::Tensor(&[1])),
    (body(bodies::arm(1)), UnitInertia::Tensor(&[1])),
    (body(bodies::arm(2)), UnitInertia::Tensor(&[1])),
    (body(ROTOR), UnitInertia::Tensor(&[2])),
];

/// Parameters of machines that are no assembled robot: arms with and without rotor, carriages, single revolute and single
/// prismatic axis.
static MACHINES: LazyLock<[Arc<RigidBodies>; 5]> = LazyLock::new(|| {
    const TURNTABLE: &[Parameter] = &[lone("inertia")];
    const SLIDE: &[Parameter] = &[lone("mass")];
    const LONE: &[(Range<usize>, UnitInertia)] = &[(body(ARM), UnitInertia::Lone)];
    let carriages = RigidBodies::new(
        Cow::Owned(vec![CARRIAGE.counted(Count::PerArm)]),
        (0..3).map(|i| (vec![bodies::arm(i)], UnitInertia::Mass)).collect(),
    );
    let [arms_and_rotor, arms, turntable, slide] = [
        (PER_ARM, &UNITS_PER_ARM[..]),
        (PER_ARM.split_at(3).0, UNITS_PER_ARM.split_at(9).0),
        (TURNTABLE, LONE),
        (SLIDE, LONE),
    ]
    .map(|(parameters, units)| {
        let units = units.iter().map(|(bodies, unit)| (bodies.clone().collect(), *unit));
        RigidBodies::new(Cow::Borrowed(parameters), units.collect())
    });
    [arms_and_rotor, arms, carriages, turntable, slide].map(Arc::new)
});

const ABOUT: About = About {
    summary: "inertia and weight of the links",
    law: "Newton–Euler equations of every body, linear in mass, first moments and inertia about the joint frame",
    shows: "everywhere; torque in phase with acceleration, and the static torque",
    source: "Gnad et al. eq. 2–4, section 2.3, Table 3; of the disassembled robot eq. 46–47, Table 1",
};

impl RigidBodies {
    fn new(parameters: Cow<'static, [Parameter]>, units: Vec<(Vec<usize>, UnitInertia)>) -> Self {
        let mut spec = Spec::new(NAME, Part::Drives, ABOUT, &[]).kind(Kind::Inertia);
        spec.parameters = parameters;
        Self { spec, units }
    }

    /// Parameters of a machine, `assembled` or not, with default symmetry.
    pub fn of(machine: Mechanism, assembled: bool) -> Arc<Self> {
        Self::with(machine, assembled, LinkParameters::default())
    }

    /// Parameters of a machine with the symmetry assumptions `links`, which apply only while it is `assembled`.
    pub fn with(machine: Mechanism, assembled: bool, links: LinkParameters) -> Arc<Self> {
        let [arms_and_rotor, arms, carriages, turntable, slide] = &*MACHINES;
        Arc::clone(match (machine, assembled) {
            (Mechanism::Delta { .. }, _) if !machine.is_delta() => return relative(machine, assembled, links),
            (Mechanism::Delta { arms: Joint::Prismatic, .. }, true) => return table(Robot::Carriages, links),
            (Mechanism::Delta { telescope: true, .. }, true) => return table(Robot::ArmsAndTelescope, links),
            (Mechanism::Delta { telescope: false, .. }, true) => return table(Robot::Arms, links),
            (Mechanism::Delta { arms: Joint::Prismatic, .. }, false) => carriages,
            (Mechanism::Delta { telescope: true, .. }, false) => arms_and_rotor,
            (Mechanism::Delta { telescope: false, .. }, false) => arms,
            (Mechanism::Axis(Axis { joint: Joint::Revolute, .. }), _) => turntable,
            (Mechanism::Axis(Axis { joint: Joint::Prismatic, .. }), _) => slide,
        })
    }

    /// Key in the table of body `b`, and positions in its array, of parameter `k`.
    ///
    /// The key is `None` if the table has only one; the result is `None` if body `b` does not have the parameter.
    pub fn place(&self, k: usize, b: usize) -> Option<(Option<&'static str>, &'static [usize])> {
        let (bodies, unit) = self.units.get(k)?;
        bodies.contains(&b).then(|| unit.place())
    }

    /// Parameter values of the bodies; that of the first body where several share a parameter.
    pub fn values(&self, bodies: &Bodies) -> Vec<f64> {
        self.units.iter().map(|(b, unit)| unit.value(&bodies[b[0]])).collect()
    }

    /// Writes parameter values into the bodies; bodies that share a parameter keep their differences.
    pub fn set_values(&self, bodies: &mut Bodies, values: &[f64]) {
        for ((own, unit), &value) in self.units.iter().zip(values) {
            let first = unit.value(&bodies[own[0]]);
            for &b in own {
                let difference = unit.value(&bodies[b]) - first;
                unit.set(&mut bodies[b], value + difference);
            }
        }
    }
}

impl Effect for RigidBodies {
    fn spec(&self) -> &Spec {
        &self.spec
    }

    fn inertia(&self, _values: &Values, _payload: &Payload, out: &mut dyn FnMut(usize, usize, Inertia)) {
        for (k, (bodies, unit)) in self.units.iter().enumerate() {
            for &b in bodies {
                out(k, b, unit.inertia());
            }
        }
    }
}

/// Unit inertia of a parameter.
#[derive(Clone, Copy)]
enum UnitInertia {
    Mass,
    Moment(usize),
    Tensor(&'static [usize]),
    /// Deviation moment Θ_ij.
    Product(usize, usize),
    /// Inertia of a single axis; only the moment about the axis enters.
    Lone,
}

/// Array positions of x, y, z.
const AXIS: &[usize; 3] = &[0, 1, 2];
/// Array positions of an inertia tensor.
const INERTIA: &[usize; 6] = &[0, 1, 2, 3, 4, 5];

impl UnitInertia {
    fn inertia(&self) -> Inertia {
        let mut i = Inertia::ZERO;
        self.set(&mut i, 1.0);
        i
    }

    fn place(&self) -> (Option<&'static str>, &'static [usize]) {
        match self {
            UnitInertia::Mass => (Some("mass"), &[0]),
            UnitInertia::Moment(axis) => (Some("first_moment"), &AXIS[*axis..*axis + 1]),
            UnitInertia::Tensor(axes) => (Some("inertia"), axes),
            // xx, yy, zz, then xy, xz, yz.
            UnitInertia::Product(i, j) => (Some("inertia"), &INERTIA[i + j + 2..i + j + 3]),
            UnitInertia::Lone => (None, &[0]),
        }
    }

    fn value(&self, i: &Inertia) -> f64 {
        match self {
            UnitInertia::Mass => i.mass,
            UnitInertia::Moment(axis) => i.first_moment[*axis],
            UnitInertia::Tensor(axes) => i.tensor[(axes[0], axes[0])],
            UnitInertia::Product(a, b) => i.tensor[(*a, *b)],
            UnitInertia::Lone => i.tensor[(1, 1)],
        }
    }

    fn set(&self, i: &mut Inertia, value: f64) {
        match self {
            UnitInertia::Mass => i.mass = value,
            UnitInertia::Moment(axis) => i.first_moment[*axis] = value,
            UnitInertia::Tensor(axes) => axes.iter().for_each(|&a| i.tensor[(a, a)] = value),
            UnitInertia::Product(a, b) => (i.tensor[(*a, *b)], i.tensor[(*b, *a)]) = (value, value),
            UnitInertia::Lone => *i = Inertia::lone(value),
        }
    }
}
