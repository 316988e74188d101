//! Keys of a model file: unit, meaning, allowed values, and the field of the model that each key fills.
//!
//! `read.rs` and `write.rs` both iterate over these lists, so that a key added here is read, checked and written.

use std::fmt::Display;

use deltatwin::effects::{Count, Parameter};
use deltatwin::machine::{
    Actuator, Axis, Drive, Geometry, Inertia, Joint, Limb, Mechanism, Noise, Sockets, Stops, TELESCOPE_AXIS, Unit,
    each, every_axis, three_arms,
};
use nalgebra::{Matrix3, Vector3};

/// A key with one number or an array of numbers, stored in a `T`.
pub(super) struct Field<T: ?Sized + 'static> {
    pub key: &'static str,
    pub unit: Option<Unit>,
    pub about: &'static str,
    pub shape: Shape,
    pub bounds: Bounds,
    /// Whether a disassembled robot needs the key; an assembled one needs every key without `default`.
    pub always: bool,
    /// Numbers assumed for a missing key; `None` if the key is required.
    pub default: Option<f64>,
    pub get: fn(&T) -> Vec<f64>,
    pub set: fn(&mut T, &[f64]),
}

/// Number of numbers of a key.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Shape {
    One,
    Array(usize),
    /// An array, or one number for all.
    OneOrArray(usize),
    /// An array of either length.
    Arrays(usize, usize),
    /// An array of at least one number, or of the given number for each value of another array.
    List(usize),
}

impl Shape {
    /// Shape of an effect parameter on a machine; on a single axis a number may replace an array of one.
    pub fn of(parameter: &Parameter, machine: Mechanism) -> Self {
        let n = parameter.count.on(machine);
        match parameter.count {
            Count::One => Shape::One,
            Count::List | Count::PerArmOf(_) => Shape::List(n),
            Count::PerDrive | Count::AllDrives if machine.has_telescope() => {
                Shape::Arrays(machine.arms(), machine.axes())
            }
            Count::PerArm | Count::PerLimb | Count::PerDrive | Count::PerAxis | Count::AllDrives if n == 1 => {
                Shape::OneOrArray(1)
            }
            _ => Shape::Array(n),
        }
    }

    /// Whether a single number is allowed.
    pub fn takes_number(self) -> bool {
        matches!(self, Shape::One | Shape::OneOrArray(_))
    }

    /// Whether an array of `n` numbers is allowed.
    pub fn takes_array(self, n: usize) -> bool {
        match self {
            Shape::One => false,
            Shape::Array(a) | Shape::OneOrArray(a) => n == a,
            Shape::Arrays(a, b) => n == a || n == b,
            Shape::List(each) => n > 0 && n.is_multiple_of(each),
        }
    }

    fn describe(self, each: &str) -> String {
        match self {
            Shape::One => each.to_string(),
            Shape::Array(n) => format!("an array of {n}, each {each}"),
            Shape::OneOrArray(n) => format!("{each}, or an array of {n} of them"),
            Shape::Arrays(a, b) => format!("an array of {a} or {b}, each {each}"),
            Shape::List(1) => format!("an array, each {each}"),
            Shape::List(n) => format!("an array of a multiple of {n}, each {each}"),
        }
    }
}

/// Allowed values of a number.
#[derive(Clone, Copy)]
pub(super) struct Bounds {
    pub low: f64,
    pub high: f64,
    /// Whether `low` itself is excluded.
    pub above: bool,
    pub integer: bool,
}

impl Bounds {
    pub const fn between(low: f64, high: f64) -> Self {
        Self { low, high, above: false, integer: false }
    }

    const fn positive(high: f64) -> Self {
        Self { low: 0.0, high, above: true, integer: false }
    }

    pub fn allow(&self, v: f64) -> bool {
        v.is_finite()
            && v >= self.low
            && v <= self.high
            && !(self.above && v == self.low)
            && !(self.integer && v.fract() != 0.0)
    }

    fn describe(&self, unit: Option<impl Display>) -> String {
        let what = if self.integer { "a whole number" } else { "a number" };
        let unit = unit.map_or(String::new(), |unit| format!(" in {unit}"));
        if self.above {
            format!("{what}{unit} above {} and at most {}", self.low, self.high)
        } else {
            format!("{what}{unit} from {} to {}", self.low, self.high)
        }
    }
}

/// Description of the expected value of a key.
pub(super) fn expectation(shape: Shape, bounds: &Bounds, unit: Option<impl Display>) -> String {
    shape.describe(&bounds.describe(unit))
}

/// The three top-level numbers.
pub(super) struct Top {
    pub gravity: f64,
    pub sample_time: f64,
}

const LENGTH: Bounds = Bounds::positive(10.0);
const HEIGHT: Bounds = Bounds::between(-10.0, 10.0);
const ANGLE: Bounds = Bounds::between(-std::f64::consts::PI, std::f64::consts::PI);

macro_rules! number {
    ($key:ident, $unit:expr, $about:expr, $bounds:expr, $always:expr) => {
        number!($key, $unit, $about, $bounds, $always, None)
    };
    ($key:ident, $unit:expr, $about:expr, $bounds:expr, $always:expr, $default:expr) => {
        Field {
            key: stringify!($key),
            unit: Some($unit),
            about: $about,
            shape: Shape::One,
            bounds: $bounds,
            always: $always,
            default: $default,
            get: |t| vec![t.$key],
            set: |t, v| t.$key = v[0],
        }
    };
}

macro_rules! array {
    ($key:ident, $n:expr, $unit:expr, $about:expr, $bounds:expr, $always:expr) => {
        Field {
            key: stringify!($key),
            unit: Some($unit),
            about: $about,
            shape: Shape::Array($n),
            bounds: $bounds,
            always: $always,
            default: None,
            get: |t| t.$key.to_vec(),
            set: |t, v| t.$key.copy_from_slice(v),
        }
    };
}

const TOP: &[Field<Top>] = &[
    number!(sample_time, Unit::S, "sampling and control period", Bounds::between(1e-5, 1.0), true),
    number!(gravity, Unit::MPerS2, "gravitational acceleration along −z", Bounds::between(0.0, 100.0), true),
];

/// Top-level numbers; a single axis has no gravity.
pub(super) fn top(machine: Mechanism) -> &'static [Field<Top>] {
    match machine {
        Mechanism::Delta { .. } => TOP,
        Mechanism::Axis(_) => TOP.split_at(1).0,
    }
}

/// A length that all limbs of a delta robot share.
macro_rules! of_limbs {
    ($key:ident, $about:expr, $always:expr) => {
        Field {
            key: stringify!($key),
            unit: Some(Unit::M),
            about: $about,
            shape: Shape::One,
            bounds: LENGTH,
            always: $always,
            default: None,
            get: |g| vec![g.limbs[0].$key],
            set: |g, v| g.limbs.iter_mut().for_each(|limb| limb.$key = v[0]),
        }
    };
}

const STRUT_LENGTH: Field<Geometry> = Field {
    key: "strut_length",
    unit: Some(Unit::M),
    about: "ball to ball, one for all or one per limb",
    shape: Shape::OneOrArray(three_arms().end),
    bounds: LENGTH,
    always: false,
    default: None,
    get: |g| g.limbs.iter().map(|limb| limb.strut_length).collect(),
    set: |g, v| g.limbs.iter_mut().zip(v).for_each(|(limb, length)| limb.strut_length = *length),
};
const PLATFORM_RADIUS: Field<Geometry> = Field {
    key: "platform_radius",
    unit: Some(Unit::M),
    about: "platform centre to the middle of a ball pair",
    shape: Shape::One,
    bounds: Bounds::between(0.0, 10.0),
    always: false,
    default: None,
    get: |g| vec![g.limbs[0].point.dot(&g.limbs[0].radial())],
    set: |g, v| g.limbs.iter_mut().for_each(|limb| limb.point = limb.radial() * v[0]),
};
const PAIR_DISTANCE: Field<Geometry> = of_limbs!(pair_distance, "distance of the two balls of a pair", false);

/// Limits of all arms of a delta robot, or of a single axis.
const fn arm_limits(key: &'static str, unit: Unit, about: &'static str, bounds: Bounds) -> Field<Geometry> {
    Field {
        key,
        unit: Some(unit),
        about,
        shape: Shape::Array(2),
        bounds,
        always: true,
        default: None,
        get: |g| g.arm_limits().to_vec(),
        set: |g, v| g.set_arm_limits([v[0], v[1]]),
    }
}
const MOUNTING_HEIGHT: Field<Geometry> =
    number!(mounting_height, Unit::M, "mounting plane above the shaft plane", HEIGHT, false);
const FLANGE_HEIGHT: Field<Geometry> =
    number!(flange_height, Unit::M, "flange above the platform's ball plane, negative: below", HEIGHT, false);

/// Of a robot whose arms are carriages.
const GUIDES: &[Field<Geometry>] = &[
    of_limbs!(base_radius, "centre line to the ball line of a carriage at q = 0", true),
    Field {
        key: "inclination",
        unit: Some(Unit::Rad),
        about: "guide below the horizontal, outwards; 1.5708: vertical, q downwards",
        shape: Shape::One,
        bounds: ANGLE,
        always: true,
        default: None,
        get: |g| match g.actuator() {
            Actuator::Revolute => vec![0.0],
            Actuator::Prismatic { inclination } => vec![inclination],
        },
        set: |g, v| {
            let guide = Actuator::Prismatic { inclination: v[0] };
            g.limbs.iter_mut().for_each(|limb| limb.actuator = guide);
        },
    },
    STRUT_LENGTH,
    PLATFORM_RADIUS,
    PAIR_DISTANCE,
    MOUNTING_HEIGHT,
    FLANGE_HEIGHT,
    arm_limits("arm_limits", Unit::M, "smallest and largest position of a carriage along its guide", HEIGHT),
];

const GEOMETRY: &[Field<Geometry>] = &[
    of_limbs!(base_radius, "centre line to motor shaft", true),
    of_limbs!(arm_length, "shaft to elbow (ball line)", true),
    STRUT_LENGTH,
    PLATFORM_RADIUS,
    PAIR_DISTANCE,
    MOUNTING_HEIGHT,
    FLANGE_HEIGHT,
    arm_limits("arm_limits", Unit::Rad, "smallest and largest arm angle, 0 = horizontal, positive down", ANGLE),
    number!(upper_hooke_height, Unit::M, "upper Hooke joint above the shaft plane", HEIGHT, false),
    number!(lower_hooke_height, Unit::M, "lower Hooke joint above the platform's ball plane", HEIGHT, false),
    array!(
        telescope_limits,
        2,
        Unit::M,
        "smallest and largest distance of the telescope's Hooke joints",
        LENGTH,
        false
    ),
];
/// Number of keys at the end that belong to the telescope.
const OF_TELESCOPE: usize = 3;

const AXIS_LIMITS: &[Field<Geometry>] =
    &[arm_limits("limits", Unit::Rad, "smallest and largest position", Bounds::between(-1e4, 1e4))];

/// The machine in whose units geometry, bodies and sockets are stated: those of a robot do not depend on its joints.
pub(super) fn of_links(machine: Mechanism) -> Mechanism {
    if matches!(machine, Mechanism::Delta { .. }) { Mechanism::default() } else { machine }
}

/// Keys of a table of `[[limbs]]`.
pub(super) const LIMB: &[Field<Limb>] = &[
    Field {
        key: "azimuth",
        unit: Some(Unit::Rad),
        about: "of the limb, anticlockwise from x seen from above",
        shape: Shape::One,
        bounds: Bounds::between(-TURN, TURN),
        always: true,
        default: None,
        get: |limb| vec![limb.azimuth()],
        set: |limb, v| limb.turn_to(v[0]),
    },
    number!(base_radius, Unit::M, "centre line to the shaft, or to a carriage at q = 0", HEIGHT, true),
    number!(base_offset, Unit::M, "shaft's middle along the shaft", HEIGHT, true, Some(0.0)),
    number!(base_height, Unit::M, "shaft above the origin", HEIGHT, true, Some(0.0)),
    number!(arm_length, Unit::M, "shaft to elbow; 0 of a carriage", Bounds::between(0.0, 10.0), true),
    number!(strut_length, Unit::M, "ball to ball", LENGTH, true),
    number!(pair_distance, Unit::M, "distance of the two balls of a pair", LENGTH, true),
    Field {
        key: "point",
        unit: Some(Unit::M),
        about: "middle of the lower ball pair in its part of the plate, x y z",
        shape: Shape::Array(3),
        bounds: HEIGHT,
        always: true,
        default: None,
        get: |limb| limb.point.as_slice().to_vec(),
        set: |limb, v| limb.point = Vector3::from_column_slice(v),
    },
    array!(limits, 2, Unit::Rad, "smallest and largest arm angle, 0 = horizontal, positive down", HEIGHT, true),
];
const TURN: f64 = std::f64::consts::TAU;

/// Keys of `[geometry]` of a robot whose limbs are described one by one.
const OF_PLATE: &[Field<Geometry>] = &[MOUNTING_HEIGHT, FLANGE_HEIGHT];

/// Keys of `[geometry]`; `regular` limbs are described there, others in `[[limbs]]`.
pub(super) fn geometry(machine: Mechanism, regular: bool) -> &'static [Field<Geometry>] {
    match machine {
        Mechanism::Delta { .. } if !regular => OF_PLATE,
        Mechanism::Delta { arms: Joint::Prismatic, .. } => GUIDES,
        Mechanism::Delta { telescope: true, .. } => GEOMETRY,
        Mechanism::Delta { telescope: false, .. } => GEOMETRY.split_at(GEOMETRY.len() - OF_TELESCOPE).0,
        Mechanism::Axis(_) => AXIS_LIMITS,
    }
}

pub(super) const MASS: usize = 0;
pub(super) const FIRST_MOMENT: usize = 1;
pub(super) const TENSOR: usize = 2;

const INERTIA: &[Field<Inertia>] = &[
    number!(mass, Unit::Kg, "of the whole body", Bounds::between(0.0, 1000.0), true),
    Field {
        key: "first_moment",
        unit: Some(Unit::KgM),
        about: "mass times centre of mass, x y z in the joint frame",
        shape: Shape::Array(3),
        bounds: Bounds::between(-1000.0, 1000.0),
        always: true,
        default: None,
        get: |i| i.first_moment.as_slice().to_vec(),
        set: |i, v| i.first_moment = Vector3::from_column_slice(v),
    },
    Field {
        key: "inertia",
        unit: Some(Unit::KgM2),
        about: "xx yy zz, or xx yy zz xy xz yz, about the joint frame",
        shape: Shape::Arrays(3, 6),
        bounds: Bounds::between(-1000.0, 1000.0),
        always: true,
        default: None,
        get: |i| {
            let t = &i.tensor;
            let mut v = vec![t[(0, 0)], t[(1, 1)], t[(2, 2)]];
            let products = [t[(0, 1)], t[(0, 2)], t[(1, 2)]];
            if products != [0.0; 3] {
                v.extend(products);
            }
            v
        },
        set: |i, v| {
            let p = if v.len() == 6 { [v[3], v[4], v[5]] } else { [0.0; 3] };
            i.tensor = Matrix3::new(v[0], p[0], p[1], p[0], v[1], p[2], p[1], p[2], v[2]);
        },
    },
];

/// The key of a single axis' inertia.
const fn lone(key: &'static str, about: &'static str) -> Field<Inertia> {
    Field {
        key,
        unit: Some(Unit::KgM2),
        about,
        shape: Shape::One,
        bounds: Bounds::positive(1e6),
        always: true,
        default: None,
        get: |i| vec![i.tensor[(1, 1)]],
        set: |i, v| *i = Inertia::lone(v[0]),
    }
}

/// Keys of a body's table.
pub(super) fn inertia(machine: Mechanism) -> &'static [Field<Inertia>] {
    const TURNTABLE: &[Field<Inertia>] = &[lone("inertia", "about the axis, with the motor's")];
    const SLIDE: &[Field<Inertia>] = &[lone("mass", "of all that moves, with the motor's inertia")];
    match machine {
        Mechanism::Delta { .. } => INERTIA,
        Mechanism::Axis(Axis { joint: Joint::Revolute, .. }) => TURNTABLE,
        Mechanism::Axis(Axis { joint: Joint::Prismatic, .. }) => SLIDE,
    }
}

macro_rules! drive {
    ($key:ident, $unit:expr, $about:expr, $bounds:expr) => {
        Field {
            key: stringify!($key),
            unit: Some($unit),
            about: $about,
            shape: Shape::OneOrArray(three_arms().end),
            bounds: $bounds,
            always: true,
            default: None,
            get: |d| d.iter().map(|d| f64::from(d.$key)).collect(),
            set: |d, v| d.iter_mut().zip(v).for_each(|(d, &v)| d.$key = v as _),
        }
    };
}

/// Keys of `[drives.arm]`; `[drives.telescope]` and `[drives.axis]` have the same keys with one number each.
pub(super) const DRIVE: &[Field<[Drive]>] = &[
    drive!(gear_ratio, Unit::RadPerRad, "motor turns per output turn", Bounds::positive(1e5)),
    drive!(
        encoder_bits,
        Unit::Bit,
        "encoder resolution per motor turn",
        Bounds { low: 1.0, high: 32.0, above: false, integer: true }
    ),
    drive!(max_torque, Unit::NM, "largest torque at the gear output", Bounds::positive(1e5)),
    drive!(max_speed, Unit::RadPerS, "largest speed at the gear output", Bounds::positive(1e4)),
    drive!(max_acceleration, Unit::RadPerS2, "largest acceleration", Bounds::positive(1e7)),
    drive!(max_jerk, Unit::RadPerS3, "largest jerk", Bounds::positive(1e10)),
];

pub(super) const SOCKETS: &[Field<Sockets>] = &[
    number!(ball_radius, Unit::M, "radius of the ball", Bounds::positive(1.0), true),
    number!(preload, Unit::N, "force of the clamp spring on the ball", Bounds::positive(1e5), true),
    number!(
        dislocation_force,
        Unit::N,
        "force across the cup at which a healthy socket leaves its ball",
        Bounds::positive(1e6),
        true
    ),
    Field {
        unit: None,
        ..number!(
            clamp_share,
            Unit::One,
            "share of the clamp springs' own pull across the cup that counts against the hold, 0: net",
            Bounds::between(0.0, 1.0),
            false,
            Some(0.0)
        )
    },
    number!(
        spin_damping,
        Unit::NMSPerRad,
        "damping of a strut's spin about its own axis",
        Bounds::between(0.0, 1e6),
        true
    ),
];

const STIFFNESS: Bounds = Bounds::positive(1e9);
const DAMPING: Bounds = Bounds::between(0.0, 100.0);

const STOPS: &[Field<Stops>] = &[
    array!(arm, 2, Unit::Rad, "arm angles of the lower and the upper stop", ANGLE, true),
    number!(arm_stiffness, Unit::NMPerRad, "of the arms' stops", STIFFNESS, true),
    number!(arm_damping, Unit::SPerRad, "Hunt and Crossley's, of the arms' stops", DAMPING, true),
    number!(telescope_stiffness, Unit::NPerM, "of both ends of the telescope", STIFFNESS, true),
    number!(telescope_damping, Unit::SPerM, "Hunt and Crossley's, of both ends of the telescope", DAMPING, true),
    number!(
        hooke,
        Unit::Rad,
        "largest angle between the parts of a Hooke joint",
        Bounds::positive(std::f64::consts::PI),
        true
    ),
    number!(hooke_stiffness, Unit::NMPerRad, "of the Hooke joints' stops", STIFFNESS, true),
    number!(hooke_damping, Unit::SPerRad, "Hunt and Crossley's, of the Hooke joints' stops", DAMPING, true),
];
/// Number of keys at the beginning that belong to the arms.
const OF_ARMS: usize = 3;

/// Keys of the optional table `[stops]`.
pub(super) fn stops(machine: Mechanism) -> &'static [Field<Stops>] {
    if machine.has_telescope() { STOPS } else { STOPS.split_at(OF_ARMS).0 }
}

macro_rules! torque_noise {
    ($n:expr, $shape:expr) => {
        Field {
            key: "torque",
            unit: Some(Unit::NM),
            about: "torque at the gear output, per axis",
            shape: $shape,
            bounds: Bounds::between(0.0, 1e6),
            always: true,
            default: None,
            get: |n| n.torque[..$n].to_vec(),
            set: |n, v| n.torque[..$n].copy_from_slice(v),
        }
    };
}

const STRUT_NOISE: Field<Noise> = number!(strut_force, Unit::N, "axial strut force", Bounds::between(0.0, 1e5), true);

/// Keys of `[noise]`.
pub(super) fn noise(machine: Mechanism) -> &'static [Field<Noise>] {
    const FOUR: &[Field<Noise>] = &[torque_noise!(4, Shape::Array(4)), STRUT_NOISE];
    const THREE: &[Field<Noise>] = &[torque_noise!(3, Shape::Array(3)), STRUT_NOISE];
    const TWO: &[Field<Noise>] = &[torque_noise!(2, Shape::Array(2)), STRUT_NOISE];
    const ONE: &[Field<Noise>] = &[torque_noise!(1, Shape::OneOrArray(1))];
    match machine.axes() {
        1 => ONE,
        2 => TWO,
        3 => THREE,
        _ => FOUR,
    }
}

/// Tables of `[drives]` with the drives that each one describes.
pub(super) fn drive_groups(machine: Mechanism) -> Vec<(&'static str, std::ops::Range<usize>)> {
    match machine {
        Mechanism::Delta { .. } => {
            let arms = ("arm", 0..machine.arms());
            let telescope = machine.has_telescope().then_some(("telescope", TELESCOPE_AXIS..every_axis().end));
            std::iter::once(arms).chain(telescope).collect()
        }
        Mechanism::Axis(_) => vec![("axis", 0..1)],
    }
}

pub(super) const DRIVE_ZERO: Drive =
    Drive { gear_ratio: 0.0, encoder_bits: 0, max_torque: 0.0, max_speed: 0.0, max_acceleration: 0.0, max_jerk: 0.0 };

pub(super) const SOCKETS_ZERO: Sockets =
    Sockets { ball_radius: 0.0, preload: 0.0, dislocation_force: 0.0, clamp_share: 0.0, spin_damping: 0.0 };

pub(super) const NOISE_ZERO: Noise = Noise { torque: each(0.0), strut_force: 0.0 };
