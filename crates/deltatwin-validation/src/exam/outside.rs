//! Laws outside the library of effects, hidden as formulas.

pub mod published;

use deltatwin::effects::formula::{Expression, Formula, Place, Term};
use deltatwin::machine::Mechanism;
use published::{PUBLISHED, Published};

/// A law outside the library.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outside {
    /// Name in files.
    pub name: &'static str,
    /// Where it acts, as in a model file.
    pub at: &'static str,
    /// Force there per unit of coefficient, N·m or N.
    pub law: &'static str,
}

const fn law(name: &'static str, at: &'static str, law: &'static str) -> Outside {
    Outside { name, at, law }
}

/// Laws outside the library written for this exam; most are of kinds that the search tries.
pub const WRITTEN: [Outside; 27] = [
    law("cogging", "drive2", "cos(51*q2 + 0.4)"),
    law("cable_spring", "drive3", "0.3 - q3"),
    law("worn_sector", "drive1", "-tanh(60*qd1) * exp(-((q1 - 0.15)/0.12)^2)"),
    law("churning", "drive2", "-qd2^3"),
    law("magnet", "platform_z", "-1/(z + 1.6)^2"),
    law("rail", "platform_y", "-sin(9*y)"),
    law("crosstalk", "drive3", "-0.2*qd1*abs(qd2)"),
    law("hum", "drive1", "sin(2*pi*11.7*t)"),
    law("creep", "drive2", "sqrt(t) - 3"),
    law("windage", "drive3", "-qd3*abs(qd3)"),
    law("tilting_bearing", "drive4", "-tanh(20*qd4) * (1 + 3*x)"),
    law("bellows", "telescope", "-(s - 1.1)^3"),
    law("fine_cogging", "drive1", "sin(47*q1 + 0.7)"),
    law("arm_spring", "drive2", "0.3 - q2"),
    law("growing_friction", "drive3", "-tanh(50*qd3) * max(0, q3 - 0.3)"),
    law("cubic_friction", "drive1", "-qd1^3"),
    law("near_magnet", "platform_z", "-1/(z + 1.5)^2"),
    law("lateral_field", "platform_x", "sin(15*x)"),
    law("sticking_pose", "drive2", "-tanh(30*qd2) * exp(-((q2 - 0.4)/0.1)^2)"),
    law("linear_drift", "drive1", "t"),
    law("speed_product", "drive3", "-abs(qd1*qd2)"),
    law("height_friction", "drive4", "-tanh(20*qd4) * (z + 1.2)"),
    law("slow_hum", "drive2", "sin(2*pi*7.3*t)"),
    law("eccentric_gear", "drive1", "qd1 * cos(5*q1)"),
    law("worn_bush", "telescope", "-tanh(20*sd) * (s - 1.0)"),
    law("drag_along_x", "platform_x", "-vx*abs(vx)"),
    law("root_of_force", "drive2", "-tanh(50*qd2) * sqrt(abs(strut3_upper))"),
];

impl Outside {
    /// All laws, those published by others first.
    pub fn all() -> Vec<Self> {
        PUBLISHED.iter().map(|published| published.law).chain(WRITTEN).collect()
    }

    /// The law called `name`; `None` if there is none.
    pub fn named(name: &str) -> Option<Self> {
        Self::all().into_iter().find(|law| law.name == name)
    }

    /// Effect that has the law called `name` as a case: it joined the library after the law was chosen. `None` for a law
    /// that no effect has.
    pub fn case_of(name: &str) -> Option<&'static str> {
        // Powers of the speed of one drive, with the exponents 3, 2, 0.59 and 1/3.
        let powers = ["churning", "cubic_friction", "windage", "gear_churning", "cube_root_friction"];
        // Waves of one drive's angle; 396 per rad is the order 12 of the motor.
        let waves = ["cogging", "fine_cogging", "dead_time_ripple"];
        match name {
            _ if powers.contains(&name) => Some("viscous_curve"),
            _ if waves.contains(&name) => Some("cogging"),
            _ => None,
        }
    }

    /// Source of the law; `None` if it was written for this exam.
    pub fn source(self) -> Option<&'static Published> {
        PUBLISHED.iter().find(|published| published.law.name == self.name)
    }

    /// Formula effect with this law on `machine`.
    ///
    /// # Panics
    /// If the place or the law cannot be parsed, which does not occur for the laws of [`Outside::all`].
    pub fn effect(self, machine: Mechanism) -> Formula {
        let at = Place::named(self.at).expect("a place of a formula");
        let law = Expression::parse(self.law).expect("an expression");
        Formula::new(vec![(Term { name: self.name.into(), at, law }, 1.0)], false, machine)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_law_is_a_formula_and_found_by_its_name() {
        for law in Outside::all() {
            assert_eq!(Outside::named(law.name), Some(law));
            assert_eq!(law.effect(Mechanism::default()).terms.len(), 1);
            assert!(Place::named(law.at).is_some());
        }
        assert_eq!(Outside::named("gremlins"), None);
        let cases = Outside::all().into_iter().filter_map(|law| Outside::case_of(law.name));
        assert_eq!(cases.filter(|name| deltatwin::effects::find(name).is_some()).count(), 8);
    }

    #[test]
    fn every_published_law_states_its_source() {
        for law in PUBLISHED {
            let name = law.law.name;
            assert_eq!(law.law.source(), Some(&law), "{name}");
            let year = |word: &str| word.parse::<u32>().is_ok_and(|year| (1900..2100).contains(&year));
            assert!(law.work.split(|c: char| !c.is_ascii_digit()).any(year), "{name}: {}", law.work);
            for text in [law.place, law.equation, law.values, law.scaled] {
                assert!(text.len() > 10, "{name}: {text}");
            }
        }
        assert!(WRITTEN.iter().all(|law| law.source().is_none()));
    }
}
