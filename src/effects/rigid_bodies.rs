//! Inertia and weight of the links, always present; its parameters are the numbers of `[bodies]`.
//!
//! The parameters follow the paper's assumptions (section 2.3): limbs alike, struts and telescope parts symmetric about
//! their axis, no deviation moments, platform in pure translation. What does not enter the motion equations under these
//! assumptions (e.g. the platform's inertia tensor) is not a parameter.

use nalgebra::{Matrix3, Vector3};

use super::{About, Count, Effect, Kind, Parameter, Role, Values};
use crate::model::bodies::{ARM, Bodies, Inertia, PLATFORM, ROTOR, STRUT, TELESCOPE_LOWER, TELESCOPE_UPPER};
use crate::recording::Payload;

/// Name of the effect.
pub const NAME: &str = "rigid_bodies";

/// Newton–Euler terms of every body per unit of its inertia parameters (eq. 2–4).
pub struct RigidBodies;

const fn parameter(name: &'static str, unit: &'static str, default: f64) -> Parameter {
    Parameter { name, unit, count: Count::One, role: Role::Linear, default, range: (-100.0, 100.0) }
}

/// The parameters of the links, in order.
pub const PARAMETERS: &[Parameter] = &[
    parameter("arm_first_moment_x", "kg·m", 0.176),
    parameter("arm_first_moment_z", "kg·m", 0.006),
    parameter("arm_inertia_yy", "kg·m²", 0.258),
    parameter("strut_mass", "kg", 0.179),
    parameter("strut_first_moment_x", "kg·m", 0.076),
    parameter("strut_inertia_xx", "kg·m²", 1.5e-5),
    parameter("strut_inertia_yy", "kg·m²", 0.075),
    parameter("platform_mass", "kg", 1.2),
    parameter("telescope_upper_first_moment_z", "kg·m", -0.219),
    parameter("telescope_upper_inertia_xx", "kg·m²", 0.084),
    parameter("telescope_upper_inertia_zz", "kg·m²", 1.9e-5),
    parameter("telescope_lower_mass", "kg", 0.557),
    parameter("telescope_lower_first_moment_z", "kg·m", 0.146),
    parameter("telescope_lower_inertia_xx", "kg·m²", 0.077),
    parameter("telescope_lower_inertia_zz", "kg·m²", 3.0e-5),
    parameter("rotor_inertia_zz", "kg·m²", 0.003),
];

impl Effect for RigidBodies {
    fn name(&self) -> &'static str {
        NAME
    }

    fn about(&self) -> About {
        About {
            summary: "inertia and weight of the links",
            law: "Newton–Euler equations of every body, linear in mass, first moments and inertia about the joint frame",
            shows: "everywhere; torque in phase with acceleration, and the static torque",
            source: "Gnad et al. eq. 2–4, section 2.3, Table 3",
        }
    }

    fn parameters(&self) -> &'static [Parameter] {
        PARAMETERS
    }

    fn inertia(&self, _values: &Values, _payload: &Payload, out: &mut dyn FnMut(usize, usize, Inertia)) {
        for (k, body, unit) in
            UNITS.iter().enumerate().flat_map(|(k, (bodies, unit))| bodies.clone().map(move |b| (k, b, unit)))
        {
            out(k, body, unit.inertia());
        }
    }

    fn kind(&self) -> Kind {
        Kind::Inertia
    }
}

/// Unit inertia of one parameter.
enum Unit {
    Mass,
    Moment(usize),
    Tensor(&'static [usize]),
}

impl Unit {
    fn inertia(&self) -> Inertia {
        let mut i = Inertia::ZERO;
        match self {
            Unit::Mass => i.mass = 1.0,
            Unit::Moment(axis) => i.first_moment = Vector3::ith(*axis, 1.0),
            Unit::Tensor(axes) => {
                let mut d = Matrix3::zeros();
                for &a in *axes {
                    d[(a, a)] = 1.0;
                }
                i.tensor = d;
            }
        }
        i
    }

    fn value(&self, i: &Inertia) -> f64 {
        match self {
            Unit::Mass => i.mass,
            Unit::Moment(axis) => i.first_moment[*axis],
            Unit::Tensor(axes) => i.tensor[(axes[0], axes[0])],
        }
    }

    fn set(&self, i: &mut Inertia, value: f64) {
        match self {
            Unit::Mass => i.mass = value,
            Unit::Moment(axis) => i.first_moment[*axis] = value,
            Unit::Tensor(axes) => axes.iter().for_each(|&a| i.tensor[(a, a)] = value),
        }
    }
}

const ARMS: std::ops::Range<usize> = ARM..STRUT;
const STRUTS: std::ops::Range<usize> = STRUT..PLATFORM;
const fn one(b: usize) -> std::ops::Range<usize> {
    b..b + 1
}

/// Bodies and unit inertia of each parameter, in the order of `PARAMETERS`.
const UNITS: [(std::ops::Range<usize>, Unit); PARAMETERS.len()] = [
    (ARMS, Unit::Moment(0)),
    (ARMS, Unit::Moment(2)),
    (ARMS, Unit::Tensor(&[1])),
    (STRUTS, Unit::Mass),
    (STRUTS, Unit::Moment(0)),
    (STRUTS, Unit::Tensor(&[0])),
    (STRUTS, Unit::Tensor(&[1, 2])),
    (one(PLATFORM), Unit::Mass),
    (one(TELESCOPE_UPPER), Unit::Moment(2)),
    (one(TELESCOPE_UPPER), Unit::Tensor(&[0, 1])),
    (one(TELESCOPE_UPPER), Unit::Tensor(&[2])),
    (one(TELESCOPE_LOWER), Unit::Mass),
    (one(TELESCOPE_LOWER), Unit::Moment(2)),
    (one(TELESCOPE_LOWER), Unit::Tensor(&[0, 1])),
    (one(TELESCOPE_LOWER), Unit::Tensor(&[2])),
    (one(ROTOR), Unit::Tensor(&[2])),
];

/// Parameter values of the bodies.
pub fn values(bodies: &Bodies) -> Vec<f64> {
    UNITS.iter().map(|(b, unit)| unit.value(&bodies[b.start])).collect()
}

/// Writes parameter values into the bodies.
pub fn set_values(bodies: &mut Bodies, values: &[f64]) {
    for ((range, unit), &value) in UNITS.iter().zip(values) {
        for b in range.clone() {
            unit.set(&mut bodies[b], value);
        }
    }
}
