//! Friction of the drives that is not proportional to speed.

use super::{About, Count, Effect, Instant, Parameter, Part, Role, Spec, Start, Unit, Values, Wrenches};

/// Friction torque τ = −A·x·((x² + κ²)/(1 + κ²))^((β−1)/2), x = q̇/w, at each arm drive.
///
/// A in N·m, never negative: the friction at the speed w (rad/s, a constant of the law). β dimensionless; κ is the speed
/// below which friction is viscous, in units of w. A power of the speed, A·|x|^β·sgn x, is smoothed at zero by κ =
/// [`SMOOTH`]; a saturating curve (`saturating` = 1) has β = 0 and the parameter κ, A·x·√((1 + κ²)/(x² + κ²)). Both are
/// cases of shear thinning [Carreau 1972], where the friction of the drives has the viscosity at high speeds. Near β = 1
/// and for large κ the curve is that of viscous friction, near β = 0 and for small κ that of Coulomb friction. Dissipates
/// |τ·q̇|.
pub struct ViscousCurve;

const TORQUE: usize = 0;
const EXPONENT: usize = 1;
const KNEE: usize = 2;
const SATURATING: usize = 3;
const SPEED: usize = 4;

/// κ of a power of the speed.
const SMOOTH: f64 = 0.005;

const PARAMETERS: &[Parameter] = &[
    // Friction at slower speeds, extrapolated to w: 50 N·m at 2.7 rad/s and β = 4 are 1e4 N·m.
    Parameter::new("torque", Unit::NM, Role::Linear, 2.0, (0.0, 1e4)).counted(Count::PerArm),
    Parameter::new("exponent", Unit::One, Role::Shape, 0.5, (0.1, 4.0)),
    Parameter::new("knee", Unit::One, Role::Shape, 0.3, (0.005, 5.0)),
    // 0 or 1.
    Parameter::new("saturating", Unit::One, Role::Fixed, 0.0, (0.0, 1.0)),
    Parameter::new("speed", Unit::RadPerS, Role::Fixed, 10.0, (0.1, 100.0)),
];

static SPEC: Spec = Spec::new(
    "viscous_curve",
    Part::Drives,
    About {
        summary: "friction of the arm drives that grows slower or faster than speed",
        law: "τ_i = −A_i·|x|^β·sgn x, x = q̇_i/w, or saturating −A_i·x·√((1 + κ²)/(x² + κ²)); smooth at zero",
        shows: "odd, curved torque over speed of each arm; none where the curve is straight (β = 1)",
        source: "Grotjahn et al. 2001 (β = 1/3), Harris 2001 (2/3), churning (up to 2), Carreau 1972",
    },
    PARAMETERS,
)
.drive_friction()
// Factors for randomly drawn exponents in the validation; the diagnosis uses the starts.
.grids(&[&[0.4, 0.6, 1.4, 2.0]])
.starts({
    const fn power(exponent: &'static [f64]) -> Start {
        Start([Some((EXPONENT, exponent)), None, None])
    }
    const fn saturating(knee: &'static [f64]) -> Start {
        Start([Some((KNEE, knee)), Some((SATURATING, &[1.0])), None])
    }
    const STARTS: [Start; 8] = [
        power(&[0.3]),
        power(&[0.5]),
        power(&[0.7]),
        power(&[1.5]),
        power(&[2.0]),
        power(&[3.0]),
        saturating(&[0.1]),
        saturating(&[0.4]),
    ];
    &STARTS
});

impl Effect for ViscousCurve {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        let saturating = values.one(SATURATING) > 0.5;
        let (exponent, knee) = if saturating { (0.0, values.one(KNEE)) } else { (values.one(EXPONENT), SMOOTH) };
        for axis in 0..values.len(TORQUE) {
            let x = at.motion.qd[axis] / values.one(SPEED);
            let thinning = ((x * x + knee * knee) / (1.0 + knee * knee)).powf(0.5 * (exponent - 1.0));
            out.drive_torque(values.index(TORQUE, axis), axis, -x * thinning);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing;

    /// Torque on the first arm at `rate` with 3 N·m at 10 rad/s.
    fn torque(exponent: f64, knee: f64, saturating: f64, rate: f64) -> f64 {
        let mut motion = testing::still();
        motion.qd[0] = rate;
        let (body, screw) = motion.drive(0);
        let blocks: [&[f64]; 5] = [&[3.0; 3], &[exponent], &[knee], &[saturating], &[10.0]];
        testing::totals(&ViscousCurve, &blocks, &motion)[body].1.dot(&screw.angular)
    }

    #[test]
    fn powers_of_the_speed() {
        // At the stated speed 3 N·m with every exponent; at a quarter of it 4^−β of that, up to |β − 1|/2·(κ/x)².
        for (exponent, quarter) in [(0.5, 1.5), (1.0, 0.75), (2.0, 0.1875)] {
            approx::assert_relative_eq!(torque(exponent, 0.3, 0.0, 10.0), -3.0, epsilon = 1e-12);
            approx::assert_relative_eq!(torque(exponent, 0.3, 0.0, -2.5), quarter, max_relative = 2.1e-4);
        }
        assert_eq!(torque(0.5, 0.3, 0.0, 0.0), 0.0);
    }

    #[test]
    fn a_saturating_curve() {
        // κ = 1/√3: 3·2/√3 at the most, half of that at x = κ/√3 = 1/3.
        let knee = 1.0 / 3f64.sqrt();
        let limit = 3.0 * 2.0 / 3f64.sqrt();
        approx::assert_relative_eq!(torque(0.5, knee, 1.0, 10.0), -3.0, epsilon = 1e-12);
        approx::assert_relative_eq!(torque(0.5, knee, 1.0, 10.0 / 3.0), -0.5 * limit, epsilon = 1e-12);
        approx::assert_relative_eq!(torque(0.5, knee, 1.0, -1e6), limit, epsilon = 1e-6);
    }
}
