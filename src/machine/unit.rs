//! SI units of parameters, and their conversion to prismatic axes and to axes whose current is recorded.

use std::fmt;

use super::Joint;

/// Unit of a parameter or of a limit.
///
/// Laws and default values are stated for revolute drives; [`Unit::on_slide`], [`Unit::per_torque_constant`] and
/// [`Unit::scale`] convert them to other machines.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[rustfmt::skip]
pub enum Unit {
    /// 1, a pure number.
    One,
    /// bit.
    Bit,
    /// Motor angle per joint coordinate: a pure number on a revolute axis, rad/m on a prismatic one.
    GearRatio,
    /// The same for the gear ratio of a drive, printed as rad/rad.
    RadPerRad,
    /// rad/m.
    RadPerM,
    /// s.
    S,
    /// Hz, of a vibration; not of a drive.
    Hz,
    /// m.
    M,
    /// m/s.
    MPerS,
    /// m/s².
    MPerS2,
    /// m/s³.
    MPerS3,
    /// s/m.
    SPerM,
    /// rad.
    Rad,
    /// rad/s.
    RadPerS,
    /// rad/s².
    RadPerS2,
    /// rad/s³.
    RadPerS3,
    /// s/rad.
    SPerRad,
    /// kg.
    Kg,
    /// 1/kg.
    PerKg,
    /// kg·m.
    KgM,
    /// kg·m².
    KgM2,
    /// N.
    N,
    /// N/s.
    NPerS,
    /// N/m.
    NPerM,
    /// N·s/m.
    NSPerM,
    /// N·s²/m².
    NS2PerM2,
    /// m/N.
    MPerN,
    /// N·m.
    NM,
    /// N·m/s.
    NMPerS,
    /// N·m/rad.
    NMPerRad,
    /// N·m·s/rad.
    NMSPerRad,
    /// rad/(N·m).
    RadPerNM,
    /// 1/(N·m)².
    PerNM2,
    /// 1/N².
    PerN2,
    /// 1/A².
    PerA2,
    /// A.
    A,
    /// A/s.
    APerS,
    /// A/rad.
    APerRad,
    /// A·s/rad.
    ASPerRad,
    /// A·s²/rad.
    AS2PerRad,
    /// rad/A.
    RadPerA,
    /// A/m.
    APerM,
    /// A·s/m.
    ASPerM,
    /// A·s²/m.
    AS2PerM,
    /// m/A.
    MPerA,
    /// Unit of the coefficient or of the argument of a user-defined formula, stated for its machine.
    Derived(Powers),
    /// N per unit of a law whose unit cannot be derived.
    NPerLaw,
    /// N·m per unit of a law whose unit cannot be derived.
    NMPerLaw,
    /// A per unit of a law whose unit cannot be derived.
    APerLaw,
}

impl Unit {
    /// `value` followed by the unit; `value` alone if the unit is dimensionless.
    pub fn quantity(self, value: impl fmt::Display) -> String {
        match self {
            Self::One | Self::GearRatio => value.to_string(),
            _ => format!("{value} {self}"),
        }
    }

    /// Whether quantities of this unit depend on the size of a machine, by forces, distances or angles of the joints.
    pub fn has_dimension(self) -> bool {
        self.scale(2.0, 3.0) != 1.0
    }

    /// The unit on a prismatic axis: metres replace radians, newtons replace newton metres. Units that do not involve
    /// the coordinate of a drive are unchanged.
    pub fn on_slide(self) -> Self {
        match self {
            Self::Rad => Self::M,
            Self::RadPerS => Self::MPerS,
            Self::RadPerS2 => Self::MPerS2,
            Self::RadPerS3 => Self::MPerS3,
            Self::SPerRad => Self::SPerM,
            Self::NM => Self::N,
            Self::NMPerS => Self::NPerS,
            Self::NMPerRad => Self::NPerM,
            Self::NMSPerRad => Self::NSPerM,
            Self::RadPerNM => Self::MPerN,
            Self::PerNM2 => Self::PerN2,
            Self::KgM2 => Self::Kg,
            Self::GearRatio | Self::RadPerRad => Self::RadPerM,
            Self::NMPerLaw => Self::NPerLaw,
            Self::One
            | Self::Bit
            | Self::RadPerM
            | Self::S
            | Self::Hz
            | Self::M
            | Self::MPerS
            | Self::MPerS2
            | Self::MPerS3
            | Self::SPerM
            | Self::Kg
            | Self::PerKg
            | Self::KgM
            | Self::N
            | Self::NPerS
            | Self::NPerM
            | Self::NSPerM
            | Self::NS2PerM2
            | Self::MPerN
            | Self::PerN2
            | Self::PerA2
            | Self::NPerLaw
            | Self::A
            | Self::APerS
            | Self::APerRad
            | Self::ASPerRad
            | Self::AS2PerRad
            | Self::RadPerA
            | Self::APerM
            | Self::ASPerM
            | Self::AS2PerM
            | Self::MPerA
            | Self::APerLaw
            | Self::Derived(_) => self,
        }
    }

    /// The unit of a drive's quantity divided by the drive's torque constant (N·m/A), or force constant (N/A) on a
    /// prismatic axis: amperes replace newton metres, or newtons. Units without force or mass are unchanged.
    ///
    /// The unit must be that on an axis with this `joint`, see [`Self::on_slide`].
    pub fn per_torque_constant(self) -> Self {
        match self {
            Self::NM | Self::N => Self::A,
            Self::NMPerS | Self::NPerS => Self::APerS,
            Self::NMPerRad => Self::APerRad,
            Self::NMSPerRad => Self::ASPerRad,
            // kg·m² = N·m·s²/rad, kg = N·s²/m
            Self::KgM2 => Self::AS2PerRad,
            Self::Kg => Self::AS2PerM,
            Self::RadPerNM => Self::RadPerA,
            Self::NPerM => Self::APerM,
            Self::NSPerM => Self::ASPerM,
            Self::MPerN => Self::MPerA,
            Self::PerNM2 | Self::PerN2 => Self::PerA2,
            Self::NMPerLaw | Self::NPerLaw => Self::APerLaw,
            other => other,
        }
    }

    /// Factor on a parameter of this unit for drives with `torque` times the torque (or force) and `speed` times the
    /// speed.
    ///
    /// The unit must be that on the target machine, see [`Self::on_slide`]. Forces scale with `torque`, displacements
    /// and their derivatives with `speed`; the motor's own speed is unchanged. The coefficient of a formula scales with
    /// `torque` alone, because its law is written for the machine.
    pub fn scale(self, torque: f64, speed: f64) -> f64 {
        match self {
            Self::NM | Self::N | Self::NMPerS | Self::NPerS | Self::A | Self::APerS => torque,
            Self::Derived(_) | Self::NMPerLaw | Self::NPerLaw | Self::APerLaw => torque,
            Self::Rad | Self::RadPerS | Self::RadPerS2 | Self::RadPerS3 => speed,
            Self::M | Self::MPerS | Self::MPerS2 | Self::MPerS3 => speed,
            Self::SPerRad | Self::SPerM | Self::RadPerM => 1.0 / speed,
            Self::NMPerRad | Self::NMSPerRad | Self::KgM2 => torque / speed,
            Self::NPerM | Self::NSPerM | Self::Kg => torque / speed,
            Self::APerRad | Self::ASPerRad | Self::AS2PerRad => torque / speed,
            Self::APerM | Self::ASPerM | Self::AS2PerM => torque / speed,
            Self::RadPerNM | Self::MPerN | Self::RadPerA | Self::MPerA => speed / torque,
            Self::NS2PerM2 => torque / (speed * speed),
            Self::PerNM2 | Self::PerN2 | Self::PerA2 => 1.0 / (torque * torque),
            Self::One | Self::Bit | Self::GearRatio | Self::RadPerRad | Self::S | Self::KgM => 1.0,
            Self::Hz | Self::PerKg => 1.0,
        }
    }
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::One | Self::GearRatio => "1",
            Self::Bit => "bit",
            Self::RadPerRad => "rad/rad",
            Self::RadPerM => "rad/m",
            Self::S => "s",
            Self::Hz => "Hz",
            Self::M => "m",
            Self::MPerS => "m/s",
            Self::MPerS2 => "m/s²",
            Self::MPerS3 => "m/s³",
            Self::SPerM => "s/m",
            Self::Rad => "rad",
            Self::RadPerS => "rad/s",
            Self::RadPerS2 => "rad/s²",
            Self::RadPerS3 => "rad/s³",
            Self::SPerRad => "s/rad",
            Self::Kg => "kg",
            Self::PerKg => "1/kg",
            Self::KgM => "kg·m",
            Self::KgM2 => "kg·m²",
            Self::N => "N",
            Self::NPerS => "N/s",
            Self::NPerM => "N/m",
            Self::NSPerM => "N·s/m",
            Self::NS2PerM2 => "N·s²/m²",
            Self::MPerN => "m/N",
            Self::NM => "N·m",
            Self::NMPerS => "N·m/s",
            Self::NMPerRad => "N·m/rad",
            Self::NMSPerRad => "N·m·s/rad",
            Self::RadPerNM => "rad/(N·m)",
            Self::PerNM2 => "1/(N·m)²",
            Self::PerN2 => "1/N²",
            Self::PerA2 => "1/A²",
            Self::A => "A",
            Self::APerS => "A/s",
            Self::APerRad => "A/rad",
            Self::ASPerRad => "A·s/rad",
            Self::AS2PerRad => "A·s²/rad",
            Self::RadPerA => "rad/A",
            Self::APerM => "A/m",
            Self::ASPerM => "A·s/m",
            Self::AS2PerM => "A·s²/m",
            Self::MPerA => "m/A",
            Self::NPerLaw => "N per unit of the law",
            Self::NMPerLaw => "N·m per unit of the law",
            Self::APerLaw => "A per unit of the law",
            Self::Derived(powers) => return f.pad(&powers.to_string()),
        })
    }
}

/// Derived unit N^`n` · A^`a` · m^`m` · s^`s` · rad^`rad`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Powers {
    /// Power of N.
    pub n: i8,
    /// Power of A.
    pub a: i8,
    /// Power of m.
    pub m: i8,
    /// Power of s.
    pub s: i8,
    /// Power of rad.
    pub rad: i8,
}

impl Powers {
    /// A pure number.
    pub const ONE: Self = Self { n: 0, a: 0, m: 0, s: 0, rad: 0 };
    /// N.
    pub const N: Self = Self { n: 1, ..Self::ONE };
    /// N·m.
    pub const NM: Self = Self { n: 1, m: 1, ..Self::ONE };

    fn each(self, other: Self, of: impl Fn(i8, i8) -> Option<i8>) -> Option<Self> {
        let Self { n, a, m, s, rad } = other;
        let [force, current] = [of(self.n, n)?, of(self.a, a)?];
        Some(Self { n: force, a: current, m: of(self.m, m)?, s: of(self.s, s)?, rad: of(self.rad, rad)? })
    }

    /// Unit of a product; `None` if an exponent overflows.
    pub fn times(self, other: Self) -> Option<Self> {
        self.each(other, i8::checked_add)
    }

    /// Unit of a quotient; `None` if an exponent overflows.
    pub fn over(self, other: Self) -> Option<Self> {
        self.each(other, i8::checked_sub)
    }

    /// Unit of a power; `None` if an exponent is not an integer or overflows.
    pub fn to_the(self, exponent: f64) -> Option<Self> {
        self.each(self, |p, _| {
            let power = f64::from(p) * exponent;
            (power.fract() == 0.0 && power.abs() <= f64::from(i8::MAX)).then_some(power as i8)
        })
    }

    /// Conversion to a prismatic axis, for a drive torque times powers of the angle and of time.
    pub(super) fn on_slide(self) -> Self {
        let Self { n, a, m, s, rad } = self;
        Self { n, a, m: m.saturating_sub(n).saturating_add(rad), s, rad: 0 }
    }

    /// Division by the torque constant: for a drive torque times powers of the angle and of time, N·m becomes A; with
    /// [`Self::on_slide`] before it, N does.
    pub(super) fn per_torque_constant(self, joint: Joint) -> Self {
        let Self { n, a, m, s, rad } = self;
        // The coordinate of a revolute axis is in rad: metres belong to its torque.
        let lever = if joint == Joint::Revolute { n } else { 0 };
        Self { n: 0, a: a.saturating_add(n), m: m.saturating_sub(lever), s, rad }
    }
}

impl fmt::Display for Powers {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let factors = [("N", self.n), ("A", self.a), ("m", self.m), ("s", self.s), ("rad", self.rad)];
        let product = |sign: i8| {
            let side = factors.iter().filter(|(_, power)| power.signum() == sign);
            side.map(|(base, power)| format!("{base}{}", exponent(power.unsigned_abs()))).collect::<Vec<_>>()
        };
        let (above, below) = (product(1), product(-1));
        let above = if above.is_empty() { "1".to_string() } else { above.join("·") };
        match below.len() {
            0 => f.write_str(&above),
            1 => write!(f, "{above}/{}", below[0]),
            _ => write!(f, "{above}/({})", below.join("·")),
        }
    }
}

/// `power` as a superscript; empty for 1.
fn exponent(power: u8) -> String {
    const DIGITS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    match power {
        1 => String::new(),
        _ => power.to_string().bytes().map(|b| DIGITS[usize::from(b - b'0')]).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_of_derived_units() {
        let text = |n, m, s, rad| Powers { n, m, s, rad, a: 0 }.to_string();
        assert_eq!(text(0, 0, 0, 0), "1");
        assert_eq!(text(1, 1, 0, 0), "N·m");
        assert_eq!(text(1, 1, 3, -3), "N·m·s³/rad³");
        assert_eq!(text(1, 0, 1, -1), "N·s/rad");
        assert_eq!(text(-1, -1, 0, 1), "rad/(N·m)");
        assert_eq!(text(0, 0, -12, 0), "1/s¹²");
    }

    #[test]
    fn on_a_slide_metres_stand_for_radians_and_newtons_for_torques() {
        // A cubic friction torque N·m·s³/rad³ becomes N·s³/m³, a stiffness N·m/rad becomes N/m.
        let derived = |n, m, s, rad| Powers { n, m, s, rad, a: 0 };
        assert_eq!(derived(1, 1, 3, -3).on_slide(), derived(1, -3, 3, 0));
        assert_eq!(derived(1, 1, 0, -1).on_slide().to_string(), Unit::NMPerRad.on_slide().to_string());
        assert_eq!(derived(1, 1, 0, 0).on_slide().to_string(), "N");
        assert_eq!(Unit::GearRatio.to_string(), "1");
        assert_eq!(Unit::GearRatio.quantity(33), "33");
        assert_eq!(Unit::NM.quantity("0.3 ± 0.1"), "0.3 ± 0.1 N·m");
        assert_eq!(Unit::GearRatio.on_slide().to_string(), "rad/m");
        assert_eq!(Unit::NMPerLaw.on_slide().to_string(), "N per unit of the law");
        assert_eq!(Unit::PerNM2.on_slide().to_string(), "1/N²");
        assert_eq!(Unit::KgM2.on_slide(), Unit::Kg);
        assert_eq!(Unit::N.on_slide(), Unit::N);
    }

    #[test]
    fn amperes_stand_for_torques_and_forces() {
        // τ = k·i divided by k in N·m/A (or N/A): kg·m²/(N·m/A) = A·s²/rad, N·s/m/(N/A) = A·s/m.
        let turning = |unit: Unit| unit.per_torque_constant().to_string();
        let sliding = |unit: Unit| unit.on_slide().per_torque_constant().to_string();
        for (unit, on_turntable, on_slide) in [
            (Unit::NM, "A", "A"),
            (Unit::NMSPerRad, "A·s/rad", "A·s/m"),
            (Unit::KgM2, "A·s²/rad", "A·s²/m"),
            (Unit::NMPerRad, "A/rad", "A/m"),
            (Unit::RadPerNM, "rad/A", "m/A"),
            (Unit::NMPerS, "A/s", "A/s"),
            (Unit::RadPerS, "rad/s", "m/s"),
            (Unit::One, "1", "1"),
            (Unit::NMPerLaw, "A per unit of the law", "A per unit of the law"),
        ] {
            assert_eq!((turning(unit).as_str(), sliding(unit).as_str()), (on_turntable, on_slide), "{unit}");
        }
        // The cubic friction N·m·s³/rad³, and a torque N·m of a formula.
        let derived = |n, m, s, rad| Powers { n, m, s, rad, a: 0 };
        let on_turntable = |powers: Powers| powers.per_torque_constant(Joint::Revolute).to_string();
        let on_slide = |powers: Powers| powers.on_slide().per_torque_constant(Joint::Prismatic).to_string();
        let cubic = derived(1, 1, 3, -3);
        assert_eq!((on_turntable(cubic), on_slide(cubic)), ("A·s³/rad³".into(), "A·s³/m³".into()));
        assert_eq!((on_turntable(Powers::NM), on_slide(Powers::NM)), ("A".into(), "A".into()));
    }

    #[test]
    fn sizes_follow_torque_and_speed() {
        // Twice the torque at a quarter of the speed.
        let scale = |unit: Unit| unit.scale(2.0, 0.25);
        assert_eq!([scale(Unit::NM), scale(Unit::RadPerS), scale(Unit::SPerRad)], [2.0, 0.25, 4.0]);
        assert_eq!([scale(Unit::NMSPerRad), scale(Unit::KgM2), scale(Unit::RadPerNM)], [8.0, 8.0, 0.125]);
        assert_eq!([scale(Unit::One), scale(Unit::GearRatio), scale(Unit::S)], [1.0; 3]);
        assert_eq!([scale(Unit::PerNM2), scale(Unit::PerN2)], [0.25; 2]);
        // The motor speed is unchanged, the load moves at a quarter of the speed: four times as many rad per metre.
        assert_eq!(scale(Unit::GearRatio.on_slide()), 4.0);
        for unit in [Unit::NM, Unit::Rad, Unit::RadPerS, Unit::SPerRad, Unit::NMSPerRad, Unit::KgM2, Unit::RadPerNM] {
            assert_eq!(scale(unit), scale(unit.on_slide()), "{unit}");
        }
    }

    #[test]
    fn powers_that_are_not_whole_have_no_unit() {
        let metre = Powers { m: 1, ..Powers::ONE };
        assert_eq!(metre.to_the(3.0), Some(Powers { m: 3, ..Powers::ONE }));
        assert_eq!(metre.to_the(2.0).and_then(|area| area.to_the(0.5)), Some(metre));
        assert_eq!(metre.to_the(0.5), None);
        assert_eq!(metre.to_the(1e3), None);
    }
}
