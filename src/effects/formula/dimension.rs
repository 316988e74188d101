//! Units of expressions.
//!
//! The constants of a law carry units that are not written. A constant is therefore taken as a pure number if it is a
//! factor; as having the unit of the other operand in a sum, `min` or `max`; and as making the argument of a function
//! dimensionless: `-tanh(50*qd1)` is dimensionless, `0.1 + abs(qd1)` has the unit of `qd1`.

use crate::machine::unit::Powers;

/// Unit of an intermediate result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Dimension {
    /// A constant, which takes the unit required by its context.
    Number(f64),
    /// A known unit.
    Of(Powers),
    /// Undetermined: a sum of different units, or a power with a non-integer exponent.
    Unknown,
}

/// Unit of the value of a function of one argument.
#[derive(Clone, Copy, Debug)]
pub(super) enum Yields {
    /// Dimensionless for any argument.
    Number,
    /// That of the argument.
    Same,
    /// The square root of that of the argument.
    Root,
}

impl Dimension {
    fn known(powers: Option<Powers>) -> Self {
        powers.map_or(Self::Unknown, Self::Of)
    }

    /// Exponents of the unit (zero for a constant); `None` if undetermined.
    pub fn powers(self) -> Option<Powers> {
        match self {
            Self::Number(_) => Some(Powers::ONE),
            Self::Of(powers) => Some(powers),
            Self::Unknown => None,
        }
    }

    /// Applies `of` to a constant; a unit is unchanged.
    pub fn map(self, of: impl Fn(f64) -> f64) -> Self {
        if let Self::Number(x) = self { Self::Number(of(x)) } else { self }
    }

    /// Dimension of a sum, difference, minimum or maximum; `of` evaluates it for two constants.
    pub fn with(self, other: Self, of: impl Fn(f64, f64) -> f64) -> Self {
        match (self, other) {
            (Self::Number(a), Self::Number(b)) => Self::Number(of(a, b)),
            (Self::Number(_), known) | (known, Self::Number(_)) => known,
            (a, b) if a == b => a,
            _ => Self::Unknown,
        }
    }

    /// Dimension of a product.
    pub fn times(self, other: Self) -> Self {
        match (self, other) {
            (Self::Number(a), Self::Number(b)) => Self::Number(a * b),
            (a, b) => Self::known(a.powers().zip(b.powers()).and_then(|(a, b)| a.times(b))),
        }
    }

    /// Dimension of a quotient.
    pub fn over(self, other: Self) -> Self {
        match (self, other) {
            (Self::Number(a), Self::Number(b)) => Self::Number(a / b),
            (a, b) => Self::known(a.powers().zip(b.powers()).and_then(|(a, b)| a.over(b))),
        }
    }

    /// Dimension of a power; a base with a unit requires a constant exponent.
    pub fn to_the(self, exponent: Self) -> Self {
        match (self, exponent) {
            (Self::Number(x), Self::Number(n)) => Self::Number(x.powf(n)),
            (Self::Number(_) | Self::Of(Powers::ONE), _) => Self::Of(Powers::ONE),
            (Self::Of(powers), Self::Number(n)) => Self::known(powers.to_the(n)),
            (Self::Of(_) | Self::Unknown, _) => Self::Unknown,
        }
    }

    /// Dimension of a function of one argument.
    pub fn of(self, function: fn(f64) -> f64, yields: Yields) -> Self {
        match (self, yields) {
            (Self::Number(x), _) => Self::Number(function(x)),
            (_, Yields::Number) => Self::Of(Powers::ONE),
            (_, Yields::Same) => self,
            (_, Yields::Root) => self.to_the(Self::Number(0.5)),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::effects::formula::Expression;
    use crate::machine::Mechanism;

    #[test]
    fn units_of_laws() {
        for (law, unit) in [
            ("1", "1"),
            ("-qd2^3", "rad³/s³"),
            ("-tanh(50*qd1)", "1"),
            ("2*q1*sin(t)", "rad"),
            ("-qdd2", "rad/s²"),
            ("1/z^2", "1/m²"),
            ("-x*abs(vx)", "m²/s"),
            ("abs(qd1) + 0.1", "rad/s"),
            ("-qd4*max(0, -z)", "m·rad/s"),
            ("sqrt(x^2 + y^2)", "m"),
            ("abs(vx)^0.5*abs(vx)^(1/2)", "unknown"),
            ("-tanh(20*qd3)*(strut5_upper + strut6_lower)", "N"),
            ("sqrt(abs(x))", "unknown"),
            ("x + qd1", "unknown"),
            ("exp(x + qd1)", "1"),
            ("(x^2)^(1/2)", "m"),
            ("2^q1", "1"),
            ("x^(1 + 2) + max(2, 1)", "m³"),
            ("x^q1", "unknown"),
            ("(((x^64)^64)^64)", "unknown"),
            ("vx/vy", "1"),
        ] {
            let powers = Expression::parse(law).unwrap().powers(Mechanism::default());
            assert_eq!(powers.map_or("unknown".to_string(), |p| p.to_string()), unit, "{law}");
        }
    }
}
