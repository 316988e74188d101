//! Parameters of the links without the symmetry assumptions of [Gnad 2024]: unequal limbs, asymmetric bodies.
//!
//! Aligned bodies have seven parameters each, without deviation moments, complete ones ten: for arm, strut, platform
//! and both parts of the telescope, together with the rotor's moment, these are the 51 of [Gnad 2024], section 6.3.3.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::{Arc, LazyLock};

use super::{ARMS, PARAMETERS, RigidBodies, STRUTS, UNITS, UnitInertia, body, one};
use crate::effects::{Count, Parameter, Unit};
use crate::machine::bodies::{ARM, PLATFORM, STRUT, TELESCOPE_LOWER, TELESCOPE_UPPER};
use crate::machine::{ARMS as LIMBS, BodyParameters, LinkParameters};

const KINDS: [BodyParameters; 3] = [BodyParameters::Symmetric, BodyParameters::Aligned, BodyParameters::Complete];

/// Tables by telescope (without, with), limbs (equal, each its own) and kind of body parameters.
static TABLES: LazyLock<[[[Arc<RigidBodies>; 3]; 2]; 2]> = LazyLock::new(|| {
    [false, true].map(|telescope| {
        [false, true]
            .map(|each_limb| KINDS.map(|bodies| Arc::new(build(telescope, LinkParameters { each_limb, bodies }))))
    })
});

/// Parameters of the links of an assembled robot.
pub(super) fn table(telescope: bool, links: LinkParameters) -> Arc<RigidBodies> {
    Arc::clone(&TABLES[usize::from(telescope)][usize::from(links.each_limb)][links.bodies as usize])
}

/// One parameter of one kind of body.
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
