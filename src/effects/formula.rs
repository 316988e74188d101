//! User-defined law from the model file.

use std::borrow::Cow;

use nalgebra::Vector3;

use super::{About, Count, Effect, Instant, Parameter, Part, Reads, Role, Spec, Unit, Values, Wrenches};
use crate::machine::bodies::PLATFORM;
use crate::machine::unit::Powers;
use crate::machine::{Mechanism, TELESCOPE_AXIS};

mod dimension;
mod expression;
mod variables;

pub use expression::{Expression, ExpressionError};
pub use variables::Variable;

/// Name of the effect.
pub const NAME: &str = "formula";

/// Sum of coefficient times law over the terms, as a generalised force *acting on* the machine: friction has the sign
/// opposite to the rate.
///
/// `drive1 … drive4` in N·m (N on a prismatic axis) along the joint coordinate; `platform_x, platform_y, platform_z` in
/// N at the centre of the platform's ball plane, inertial axes; `telescope` in N along the bar, pushing its two parts
/// apart. On a disassembled machine, a formula that depends on a dismounted part is inactive as a whole.
pub struct Formula {
    /// Terms in the order of the parameters.
    pub terms: Vec<Term>,
    /// Whether it is an empirical fit without physical interpretation, as proposed by the diagnosis.
    pub empirical: bool,
    spec: Spec,
}

/// One term of a formula.
#[derive(Clone, Debug)]
pub struct Term {
    /// Name of its coefficient.
    pub name: String,
    /// Place of action.
    pub at: Place,
    /// Force or torque per unit of the coefficient.
    pub law: Expression,
}

impl Term {
    /// Unit of the coefficient on `machine`: that of the place divided by that of the law.
    pub fn unit(&self, machine: Mechanism) -> Unit {
        let (force, per_law) = match self.at {
            Place::Drive(_) => (machine.drive_powers(Powers::NM), machine.unit(Unit::NMPerLaw)),
            Place::Platform(_) | Place::Telescope => (Powers::N, Unit::NPerLaw),
        };
        self.law.powers(machine).and_then(|law| force.over(law)).map_or(per_law, Unit::Derived)
    }
}

/// Place of action of a term.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Torque on a drive, by its index from 0.
    Drive(usize),
    /// Force on the platform along inertial axis 0..3.
    Platform(usize),
    /// Force between the two parts of the telescope, along the bar.
    Telescope,
}

const PLACES: [(&str, Place); 8] = [
    ("drive1", Place::Drive(0)),
    ("drive2", Place::Drive(1)),
    ("drive3", Place::Drive(2)),
    ("drive4", Place::Drive(3)),
    ("platform_x", Place::Platform(0)),
    ("platform_y", Place::Platform(1)),
    ("platform_z", Place::Platform(2)),
    ("telescope", Place::Telescope),
];

impl Place {
    /// The place called `name`.
    pub fn named(name: &str) -> Option<Self> {
        PLACES.iter().find(|(known, _)| *known == name).map(|(_, place)| *place)
    }

    /// Its name in model files.
    pub fn name(self) -> &'static str {
        PLACES.iter().find(|(_, place)| *place == self).map_or("", |(name, _)| name)
    }

    /// Name of the machine part in words; the three directions on the platform share one name.
    pub fn region(self) -> String {
        match self {
            Self::Drive(i) => format!("drive {}", i + 1),
            Self::Platform(_) => "platform".into(),
            Self::Telescope => "telescope".into(),
        }
    }

    /// Places that exist on the assembled machine.
    pub fn on(machine: Mechanism) -> impl Iterator<Item = Self> {
        PLACES.into_iter().map(|(_, place)| place).filter(move |place| match place {
            Self::Drive(i) => *i < machine.axes(),
            _ => machine.has(place.part(), true),
        })
    }

    /// Unit of the force or torque at the place on `machine`.
    pub fn unit(self, machine: Mechanism) -> Unit {
        match self {
            Self::Drive(_) => machine.unit(Unit::NM),
            Self::Platform(_) | Self::Telescope => Unit::N,
        }
    }

    fn part(self) -> Part {
        match self {
            Self::Drive(TELESCOPE_AXIS) => Part::FourthDrive,
            Self::Drive(_) => Part::Drives,
            Self::Platform(_) => Part::Linkage,
            Self::Telescope => Part::Telescope,
        }
    }
}

/// Largest absolute value of a coefficient.
pub const LIMIT: f64 = 1e9;

const ABOUT: About = About {
    summary: "a law written in the model file",
    law: "Σ coefficient · law on the machine, `at` drive1 … drive4, platform_x, platform_y, platform_z or telescope; \
          the law of q1 …, qd1 …, qdd1 …, x, y, z, vx …, ax …, s and sd of the telescope, strut1_upper …, tau1 …, t with \
          sin cos tan tanh exp abs sign sqrt min max pi + − * / ^",
    shows: "where its terms act",
    source: "the user, in [[effects.formula.terms]]: name, at, law, coefficient; or the diagnosis, then marked empirical",
};

/// The registry entry: a formula without terms.
impl Default for Formula {
    fn default() -> Self {
        Self::new(Vec::new(), false, Mechanism::default())
    }
}

impl Formula {
    /// A formula of terms for `machine`, each with the typical magnitude of its coefficient (1 if given as zero).
    pub fn new(terms: Vec<(Term, f64)>, empirical: bool, machine: Mechanism) -> Self {
        let parameter = |(term, size): &(Term, f64)| Parameter {
            name: Cow::Owned(term.name.clone()),
            unit: term.unit(machine),
            count: Count::One,
            role: Role::Linear,
            default: if *size == 0.0 { 1.0 } else { size.abs() },
            range: (-LIMIT, LIMIT),
            or_zero: false,
        };
        let parameters = terms.iter().map(parameter).collect();
        let terms: Vec<Term> = terms.into_iter().map(|(term, _)| term).collect();
        let variables = || terms.iter().flat_map(|term| term.law.variables());
        let reads = Reads {
            reactions: variables().any(Variable::is_reaction),
            accelerations: variables().any(Variable::is_acceleration),
            torque: variables().any(Variable::is_torque),
            ..Reads::MOTION
        };
        let mut spec = Spec::new(NAME, part(&terms), ABOUT, &[]).reads(reads);
        spec.parameters = Cow::Owned(parameters);
        Self { terms, empirical, spec }
    }
}

/// The most demanding part among those on which the terms act and depend: a machine with this part has all of them.
fn part(terms: &[Term]) -> Part {
    let places = terms.iter().map(|term| term.at.part());
    let read = terms.iter().flat_map(|term| term.law.variables()).map(Variable::part);
    // From the part that every machine has to those that few have.
    let rank =
        |part: &Part| [Part::Drives, Part::FourthDrive, Part::Weight, Part::Linkage].iter().position(|p| p == part);
    places.chain(read).max_by_key(|part| rank(part).unwrap_or(usize::MAX)).unwrap_or(Part::Drives)
}

impl Effect for Formula {
    fn spec(&self) -> &Spec {
        &self.spec
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        for (i, term) in self.terms.iter().enumerate() {
            let force = term.law.value(|variable| variable.read(at));
            let k = values.index(i, 0);
            match term.at {
                Place::Drive(axis) => out.drive_torque(k, axis, force),
                Place::Platform(axis) => out.wrench(k, PLATFORM, Vector3::ith(axis, force), Vector3::zeros()),
                Place::Telescope => out.telescope_force(k, at.motion, force),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::ActiveEffect;
    use crate::effects::testing;
    use crate::machine::bodies::{TELESCOPE_LOWER, TELESCOPE_UPPER};
    use crate::machine::{Axis, Effort, Joint};

    fn formula(terms: &[(&str, &str)]) -> Formula {
        let term = |(i, (at, law)): (usize, &(&str, &str))| {
            let law = Expression::parse(law).unwrap();
            (Term { name: format!("term{i}"), at: Place::named(at).unwrap(), law }, 1.0)
        };
        Formula::new(terms.iter().enumerate().map(term).collect(), false, Mechanism::default())
    }

    #[test]
    fn terms_act_where_they_say() {
        // At q₁ = 0.1, q̇₁ = 2, z = −0.5: 0.3·(−sin(3.3)·tanh(100)) N·m, 2·(1/0.25) N up, 3·(−0.5) N on the bar.
        let law = formula(&[("drive1", "-sin(33*q1) * tanh(50*qd1)"), ("platform_z", "1/z^2"), ("telescope", "sd")]);
        let mut motion = testing::still();
        (motion.q[0], motion.qd[0]) = (0.1, 2.0);
        motion.bodies[PLATFORM].position.z = -0.5;
        motion.telescope.rate = -0.5;
        let total = testing::totals(&law, &[&[0.3], &[2.0], &[3.0]], &motion);
        approx::assert_relative_eq!(total[0].1.y, 0.3 * 0.157_745_694_143_248_4, epsilon = 1e-12);
        approx::assert_relative_eq!(total[PLATFORM].0.z, 8.0, epsilon = 1e-12);
        approx::assert_relative_eq!(total[TELESCOPE_UPPER].0.z, -1.5, epsilon = 1e-12);
        approx::assert_relative_eq!(total[TELESCOPE_LOWER].0.z, 1.5, epsilon = 1e-12);
    }

    /// F = m·a + friction with friction 0.002·F²/N on a slide: at m·a = 20 N the smaller solution of F = 20 + 0.002·F² is
    /// (1 − √0.84)/0.004 = 20.871215 N.
    #[test]
    fn a_law_of_the_drives_torque_is_solved_for() {
        let mut model = crate::model::testing::slide();
        model.bodies[crate::machine::bodies::ARM] = crate::machine::Inertia::lone(2.0);
        let law = formula(&[("drive1", "-tau1^2*tanh(50*qd1)")]);
        model.effects = crate::effects::Effects::from(vec![ActiveEffect::new(Arc::new(law), &[&[0.002]])]);
        let plant = crate::dynamics::Plant::new(&model, &crate::machine::Setup::default());
        let joints = crate::kinematics::JointState { q: [0.1; 4], qd: [1.0; 4], qdd: [10.0; 4] };
        let motion = plant.motion(&joints).unwrap();
        let torque = crate::dynamics::inverse_dynamics(&plant, 0.0, &motion, &[&[]], false).unwrap().tau[0];
        approx::assert_relative_eq!(torque, (1.0 - 0.84f64.sqrt()) / 0.004, epsilon = 1e-9);
    }

    #[test]
    fn units_of_coefficients_are_those_of_the_machine() {
        let current = Mechanism::Axis(Axis { joint: Joint::Revolute, effort: Effort::Current });
        let drive = crate::model::testing::slide().drives[0];
        for (machine, at, law, unit) in [
            (Mechanism::default(), "drive1", "-qd1^3", "N·m·s³/rad³"),
            (Mechanism::default(), "platform_z", "-qd1", "N·s/rad"),
            (Mechanism::LINEAR_DELTA, "drive1", "-qd1^3", "N·s³/m³"),
            (Mechanism::LINEAR_DELTA, "drive1", "x + qd1", "N per unit of the law"),
            (Mechanism::LINEAR_DELTA, "drive2", "tau1", "1"),
            (Mechanism::LINEAR_DELTA, "platform_x", "-x", "N/m"),
            (Mechanism::LINEAR_DELTA, "platform_z", "-qd1", "N·s/m"),
            (Mechanism::LINEAR_DELTA, "platform_z", "strut1_upper", "1"),
            (Mechanism::axis(Joint::Prismatic), "drive1", "-qd1^3", "N·s³/m³"),
            (current, "drive1", "-qd1", "A·s/rad"),
            (current, "drive1", "tau1^2", "1/A"),
        ] {
            let law = Expression::parse(law).unwrap();
            let term = Term { name: "c".into(), at: Place::named(at).unwrap(), law };
            let formula = Formula::new(vec![(term, 1.0)], false, machine);
            let host = crate::effects::Host::new(machine, &drive);
            let parameter = host.parameter(formula.spec.acts_on, &formula.spec.parameters[0]);
            assert_eq!(parameter.unit.to_string(), unit, "{machine:?} {at}");
        }
    }

    #[test]
    fn needs_the_parts_that_it_names() {
        for (at, law, part) in [
            ("drive1", "qd2 + t", Part::Drives),
            ("drive1", "z", Part::Linkage),
            ("drive1", "strut3_lower", Part::Linkage),
            ("drive4", "qd4", Part::FourthDrive),
            ("drive1", "tau1", Part::Drives),
            ("drive1", "tau4", Part::FourthDrive),
            ("platform_x", "1", Part::Linkage),
            ("drive4", "s", Part::Telescope),
        ] {
            assert_eq!(formula(&[(at, law)]).spec().acts_on, part, "{at} {law}");
        }
        let law = formula(&[("drive1", "strut1_upper * qdd1")]);
        assert!(law.spec().reads.reactions && law.spec().reads.accelerations);
    }

    #[test]
    fn coefficients_carry_names_and_units_of_their_terms() {
        // Force or torque over the unit of the law, by hand.
        let laws = [
            ("drive1", "-qd2^3", "N·m·s³/rad³"),
            ("drive1", "q1", "N·m/rad"),
            ("drive2", "-tanh(50*qd2)", "N·m"),
            ("drive4", "-tanh(20*qd4)*strut5_upper", "m"),
            ("platform_x", "x", "N/m"),
            ("drive1", "-tau1^2*tanh(50*qd1)", "1/(N·m)"),
            ("platform_z", "-vz*abs(vz)", "N·s²/m²"),
            ("telescope", "-sd*(s - 0.8)", "N·s/m²"),
            ("drive1", "q1 + qd1", "N·m per unit of the law"),
            ("platform_y", "x + vx", "N per unit of the law"),
        ];
        let one: &[f64] = &[1.0];
        let active = ActiveEffect::new(Arc::new(formula(&laws.map(|(at, law, _)| (at, law)))), &[one; 10]);
        for (i, (entry, (_, law, unit))) in active.entries().into_iter().zip(laws).enumerate() {
            assert_eq!((entry.name, entry.parameter.unit.to_string()), (format!("term{i}"), unit.to_string()), "{law}");
        }
    }
}
