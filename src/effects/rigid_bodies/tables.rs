//! Parameters of the links without the paper's assumptions: limbs that differ, bodies without symmetry.
//!
//! Aligned bodies have seven parameters each, without deviation moments, complete ones ten: arm, strut, platform and both parts of the telescope with the rotor's moment are the
//! paper's 51 (section 6.3.3).

use std::borrow::Cow;
use std::ops::Range;
use std::sync::{Arc, LazyLock};

use super::{ARMS, PARAMETERS, RigidBodies, STRUTS, UNITS, UnitInertia, body, one};
use crate::effects::{Count, Parameter, Unit};
use crate::machine::bodies::{ARM, PLATFORM, STRUT, TELESCOPE_LOWER, TELESCOPE_UPPER};
use crate::machine::{ARMS as LIMBS, BodyParameters, LinkParameters};

const KINDS: [BodyParameters; 3] = [BodyParameters::Symmetric, BodyParameters::Aligned, BodyParameters::Complete];

/// Without and with telescope; alike limbs and each its own; kinds of bodies.
static TABLES: LazyLock<[[[Arc<RigidBodies>; 3]; 2]; 2]> = LazyLock::new(|| {
    [false, true].map(|telescope| {
        [false, true]
            .map(|each_limb| KINDS.map(|bodies| Arc::new(build(telescope, LinkParameters { each_limb, bodies }))))
    })
});

/// The parameters of the links of an assembled robot.
pub(super) fn table(telescope: bool, links: LinkParameters) -> Arc<RigidBodies> {
    Arc::clone(&TABLES[usize::from(telescope)][usize::from(links.each_limb)][links.bodies as usize])
}

/// One number of one kind of body.
struct Entry {
    parameter: Parameter,
    bodies: Range<usize>,
    unit: UnitInertia,
}

fn build(telescope: bool, links: LinkParameters) -> RigidBodies {
    let entries = match links.bodies {
        BodyParameters::Symmetric => symmetric(),
        BodyParameters::Aligned => general(7),
        BodyParameters::Complete => general(10),
    };
    let known = |e: &Entry| telescope || e.bodies.end <= PLATFORM + 1;
    let (mut parameters, mut units) = (Vec::new(), Vec::new());
    for entry in entries.into_iter().filter(known) {
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

/// The paper's parameters.
fn symmetric() -> Vec<Entry> {
    let entry = |(p, (bodies, unit)): (&Parameter, &(Range<usize>, UnitInertia))| Entry {
        parameter: p.clone(),
        bodies: bodies.clone(),
        unit: *unit,
    };
    PARAMETERS.iter().zip(UNITS).map(entry).collect()
}

/// The first `count` of ten of every kind of body, and the rotor's moment.
fn general(count: usize) -> Vec<Entry> {
    /// Name, unit, usual magnitude where the paper has none, place.
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
