//! Parameters of the links of an assembled robot, with and without the symmetry assumptions of [Gnad 2024]: equal limbs,
//! symmetric bodies.
//!
//! Aligned bodies have seven parameters each, without deviation moments, complete ones ten: for arm, strut, platform
//! and both parts of the telescope, together with the rotor's moment, these are the 51 of [Gnad 2024], section 6.3.3.
//! Carriages do not turn: their mass is all of them that enters.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::{Arc, LazyLock};

use super::{ARMS, CARRIAGE, PARAMETERS, RigidBodies, STRUTS, UNITS, UnitInertia, body, one};
use crate::effects::{Count, Parameter, Unit};
use crate::machine::bodies::{ARM, PLATFORM, STRUT, TELESCOPE_LOWER, TELESCOPE_UPPER};
use crate::machine::{ARMS as LIMBS, BodyParameters, LinkParameters};

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
    bodies: Range<usize>,
    unit: UnitInertia,
}

fn build(robot: Robot, links: LinkParameters) -> RigidBodies {
    let entries = match links.bodies {
        BodyParameters::Symmetric => symmetric(),
        BodyParameters::Aligned => general(7),
        BodyParameters::Complete => general(10),
    };
    let known = |e: &Entry| match robot {
        Robot::Carriages => STRUTS.contains(&e.bodies.start) || e.bodies == body(PLATFORM),
        Robot::Arms => e.bodies.end <= PLATFORM + 1,
        Robot::ArmsAndTelescope => true,
    };
    let carriage = Entry { parameter: CARRIAGE, bodies: ARMS, unit: UnitInertia::Mass };
    let carriage = matches!(robot, Robot::Carriages).then_some(carriage);
    let (mut parameters, mut units) = (Vec::new(), Vec::new());
    for entry in carriage.into_iter().chain(entries.into_iter().filter(known)) {
        let limb = entry.bodies == ARMS || entry.bodies == STRUTS;
        if links.each_limb && limb {
            parameters.push(entry.parameter.counted(Count::PerArm));
            let per_limb = entry.bodies.len() / LIMBS;
            let first = |i: usize| entry.bodies.start + i * per_limb;
            units.extend((0..LIMBS).map(|i| (first(i)..first(i) + per_limb, entry.unit)));
        } else {
            parameters.push(entry.parameter);
            units.push((entry.bodies, entry.unit));
        }
    }
    RigidBodies::new(Cow::Owned(parameters), Cow::Owned(units))
}

/// Parameters of [Gnad 2024].
fn symmetric() -> Vec<Entry> {
    let entry = |(p, (bodies, unit)): (&Parameter, &(Range<usize>, UnitInertia))| Entry {
        parameter: p.clone(),
        bodies: bodies.clone(),
        unit: *unit,
    };
    PARAMETERS.iter().zip(UNITS).map(entry).collect()
}

/// The first `count` of the ten parameters of every kind of body, and the rotor's moment.
fn general(count: usize) -> Vec<Entry> {
    /// Name, unit, default magnitude where [Gnad 2024] has none, position.
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
    let kinds = [
        ("arm", ARM..STRUT),
        ("strut", STRUT..PLATFORM),
        ("platform", body(PLATFORM)),
        ("telescope_upper", body(TELESCOPE_UPPER)),
        ("telescope_lower", body(TELESCOPE_LOWER)),
    ];
    let ten = |(kind, bodies): (&'static str, Range<usize>)| {
        TEN.into_iter().take(count).map(move |(suffix, unit, usual, place)| {
            let name = format!("{kind}_{suffix}");
            let paper = PARAMETERS.iter().find(|p| p.name == name).map_or(usual, |p| p.default);
            let parameter = Parameter { name: Cow::Owned(name), ..one("", unit, paper) };
            Entry { parameter, bodies: bodies.clone(), unit: place }
        })
    };
    let rotor = symmetric().pop();
    kinds.into_iter().flat_map(ten).chain(rotor).collect()
}
