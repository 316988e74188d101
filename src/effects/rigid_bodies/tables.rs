//! Parameters of the links of an assembled robot, with and without the symmetry assumptions of [Gnad 2024]: equal limbs,
//! symmetric bodies.
//!
//! Aligned bodies have seven parameters each, without deviation moments, complete ones ten: for arm, strut, platform
//! and both parts of the telescope, together with the rotor's moment, these are the 51 of [Gnad 2024], section 6.3.3.
//! Carriages do not turn: their mass is all of them that enters.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

use super::{ARM_BODIES, CARRIAGE, PARAMETERS, RigidBodies, STRUT_BODIES, UNITS, UnitInertia, body, one};
use crate::effects::{Count, Parameter, Unit};
use crate::machine::bodies::{ARM, PLATFORM, SLOTS, STRUT, TELESCOPE_LOWER, TELESCOPE_UPPER, arm, body_name, strut};
use crate::machine::{BodyParameters, Joint, LinkParameters, Mechanism, three_arms};

const KINDS: [BodyParameters; 3] = [BodyParameters::Symmetric, BodyParameters::Aligned, BodyParameters::Complete];

/// Robots by what is mounted besides struts and platform.
#[derive(Clone, Copy)]
pub(super) enum Robot {
    Carriages,
    Arms,
    ArmsAndTelescope,
}

/// Tables by robot, limbs (equal, each its own) and kind of body parameters.
static TABLES: LazyLock<[[[Arc<RigidBodies>; 3]; 2]; 3]> = LazyLock::new(|| {
    [Robot::Carriages, Robot::Arms, Robot::ArmsAndTelescope].map(|robot| {
        [false, true].map(|each_limb| KINDS.map(|bodies| Arc::new(build(robot, LinkParameters { each_limb, bodies }))))
    })
});

/// Parameters of the links of an assembled robot.
pub(super) fn table(robot: Robot, links: LinkParameters) -> Arc<RigidBodies> {
    Arc::clone(&TABLES[robot as usize][usize::from(links.each_limb)][links.bodies as usize])
}

/// One parameter of one kind of body.
struct Entry {
    parameter: Parameter,
    bodies: Vec<usize>,
    unit: UnitInertia,
}

fn build(robot: Robot, links: LinkParameters) -> RigidBodies {
    let entries = match links.bodies {
        BodyParameters::Symmetric => symmetric(),
        BodyParameters::Aligned => general(7),
        BodyParameters::Complete => general(10),
    };
    let known = |e: &Entry| match robot {
        Robot::Carriages => STRUT_BODIES.contains(&e.bodies[0]) || e.bodies == [PLATFORM],
        Robot::Arms => e.bodies.iter().all(|&b| b <= PLATFORM),
        Robot::ArmsAndTelescope => true,
    };
    let carriage = Entry { parameter: CARRIAGE, bodies: ARM_BODIES.collect(), unit: UnitInertia::Mass };
    let carriage = matches!(robot, Robot::Carriages).then_some(carriage);
    let own = carriage.into_iter().chain(entries.into_iter().filter(known));
    listed(own, |e| if links.each_limb && e.bodies[0] < PLATFORM { three_arms().len() } else { 1 })
}

/// The parameters in order; bodies that `shares` of them have, as many each, get their own values by arm.
fn listed(entries: impl Iterator<Item = Entry>, shares: impl Fn(&Entry) -> usize) -> RigidBodies {
    let (mut parameters, mut units) = (Vec::new(), Vec::new());
    for entry in entries {
        let shares = shares(&entry);
        let each = entry.bodies.len() / shares;
        units.extend(entry.bodies.chunks(each).map(|own| (own.to_vec(), entry.unit)));
        parameters.push(if shares > 1 { entry.parameter.counted(Count::PerArm) } else { entry.parameter });
    }
    RigidBodies::new(Cow::Owned(parameters), units)
}

/// Parameters of the links of a relative of the delta robot, made once per machine.
pub(super) fn relative(machine: Mechanism, assembled: bool, links: LinkParameters) -> Arc<RigidBodies> {
    type Known = Vec<((Mechanism, bool, LinkParameters), Arc<RigidBodies>)>;
    static KNOWN: Mutex<Known> = Mutex::new(Vec::new());
    let key = (machine, assembled, links);
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, made)) = known.iter().find(|(of, _)| *of == key) {
        return Arc::clone(made);
    }
    let made = Arc::new(build_relative(machine, assembled, links));
    known.push((key, Arc::clone(&made)));
    made
}

/// Links of one kind: arms and struts of driven and of passive limbs, and the parts of the plate.
fn kinds_of(machine: Mechanism) -> Vec<(String, Vec<usize>)> {
    let (driven, all) = (machine.arms(), machine.limbs());
    let arms = |limbs: Range<usize>| limbs.map(arm).collect::<Vec<_>>();
    let struts = |limbs: Range<usize>| (2 * limbs.start..2 * limbs.end).map(strut).collect::<Vec<_>>();
    let mut kinds = vec![("arm".to_string(), arms(0..driven)), ("strut".into(), struts(0..driven))];
    if driven < all {
        kinds.extend([("passive_arm".into(), arms(driven..all)), ("passive_strut".into(), struts(driven..all))]);
    }
    kinds.extend((0..SLOTS).filter(|&b| machine.is_part_of_plate(b)).map(|b| (body_name(b), vec![b])));
    kinds
}

fn build_relative(machine: Mechanism, assembled: bool, links: LinkParameters) -> RigidBodies {
    let carriage = machine.joint() == Joint::Prismatic;
    let count = match links.bodies {
        BodyParameters::Symmetric => None,
        BodyParameters::Aligned => Some(7),
        BodyParameters::Complete => Some(10),
    };
    let is_arm = |name: &str| name.ends_with("arm");
    let kept = |kind: &str, suffix: &str| match (kind, count) {
        (arm, _) if is_arm(arm) && carriage => suffix == "mass",
        (_, Some(count)) => TEN.iter().take(count).any(|t| t.0 == suffix),
        (arm, None) if is_arm(arm) => ["first_moment_x", "first_moment_z", "inertia_yy"].contains(&suffix),
        (strut, None) if strut.ends_with("strut") => {
            ["mass", "first_moment_x", "inertia_xx", "inertia_yy"].contains(&suffix)
        }
        // A part that turns about the vertical, and parts that only translate.
        (_, None) if matches!(kind, "end_effector" | "link") => {
            ["mass", "first_moment_x", "first_moment_y", "first_moment_z", "inertia_zz"].contains(&suffix)
        }
        _ => ["mass", "first_moment_z"].contains(&suffix),
    };
    let entries =
        kinds_of(machine).into_iter().filter(|(kind, _)| assembled || kind == "arm").flat_map(|(kind, bodies)| {
            TEN.into_iter()
                .filter(|t| kept(&kind, t.0))
                .map(|(suffix, unit, usual, place)| {
                    // A strut is symmetric about its axis.
                    let place = match place {
                        UnitInertia::Tensor(&[1]) if count.is_none() && kind.ends_with("strut") => {
                            UnitInertia::Tensor(&[1, 2])
                        }
                        place => place,
                    };
                    Entry { parameter: named(&kind, suffix, unit, usual), bodies: bodies.clone(), unit: place }
                })
                .collect::<Vec<_>>()
        });
    let driven = machine.arms();
    let apart = links.each_limb || !assembled;
    listed(entries, |e| match e.parameter.name.as_ref() {
        name if apart && (name.starts_with("arm_") || name.starts_with("strut_")) => driven,
        _ => 1,
    })
}

fn named(kind: &str, suffix: &str, unit: Unit, usual: f64) -> Parameter {
    let name = format!("{kind}_{suffix}");
    let paper = PARAMETERS.iter().find(|p| p.name == name).map_or(usual, |p| p.default);
    Parameter { name: Cow::Owned(name), ..one("", unit, paper) }
}

/// Parameters of [Gnad 2024].
fn symmetric() -> Vec<Entry> {
    let entry = |(p, (bodies, unit)): (&Parameter, &(Range<usize>, UnitInertia))| Entry {
        parameter: p.clone(),
        bodies: bodies.clone().collect(),
        unit: *unit,
    };
    PARAMETERS.iter().zip(UNITS).map(entry).collect()
}

/// Name, unit, default magnitude where [Gnad 2024] has none, and position of the ten parameters of a body.
const TEN: [(&str, Unit, f64, UnitInertia); 10] = [
    ("mass", Unit::Kg, 1.0, UnitInertia::Mass),
    ("first_moment_x", Unit::KgM, 0.01, UnitInertia::Moment(0)),
    ("first_moment_y", Unit::KgM, 0.01, UnitInertia::Moment(1)),
    ("first_moment_z", Unit::KgM, 0.01, UnitInertia::Moment(2)),
    ("inertia_xx", Unit::KgM2, 0.05, UnitInertia::Tensor(&[0])),
    ("inertia_yy", Unit::KgM2, 0.05, UnitInertia::Tensor(&[1])),
    ("inertia_zz", Unit::KgM2, 0.05, UnitInertia::Tensor(&[2])),
    ("inertia_xy", Unit::KgM2, 0.005, UnitInertia::Product(0, 1)),
    ("inertia_xz", Unit::KgM2, 0.005, UnitInertia::Product(0, 2)),
    ("inertia_yz", Unit::KgM2, 0.005, UnitInertia::Product(1, 2)),
];

/// The first `count` of the ten parameters of every kind of body, and the rotor's moment.
fn general(count: usize) -> Vec<Entry> {
    let kinds = [
        ("arm", ARM..STRUT),
        ("strut", STRUT..PLATFORM),
        ("platform", body(PLATFORM)),
        ("telescope_upper", body(TELESCOPE_UPPER)),
        ("telescope_lower", body(TELESCOPE_LOWER)),
    ];
    let ten = |(kind, bodies): (&'static str, Range<usize>)| {
        TEN.into_iter().take(count).map(move |(suffix, unit, usual, place)| {
            let parameter = named(kind, suffix, unit, usual);
            Entry { parameter, bodies: bodies.clone().collect(), unit: place }
        })
    };
    let rotor = symmetric().pop();
    kinds.into_iter().flat_map(ten).chain(rotor).collect()
}
