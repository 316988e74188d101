//! Friction of the drives that is not proportional to speed.

use super::{About, Count, Effect, Instant, Parameter, Part, Role, Spec, Unit, Values, Wrenches};

/// Friction torque τ = −A·(q̇/w)·((q̇² + v²)/(w² + v²))^((β−1)/2) at each arm drive.
///
/// A in N·m, never negative, the friction at the speed w (rad/s, a constant of the law); v in rad/s, β dimensionless.
/// Below v it is proportional to speed, above v to |q̇|^β: with a small v the power law c·|q̇|^β·sgn q̇, smooth at zero;
/// with β = 0 the saturating curve q̇/√(q̇² + v²); in between shear thinning [Carreau 1972], where drive friction has the
/// viscosity at high speeds. β = 1 is viscous friction of the drives. Dissipates |τ·q̇|.
pub struct ViscousCurve;

const TORQUE: usize = 0;
const EXPONENT: usize = 1;
const KNEE: usize = 2;
const SPEED: usize = 3;

const PARAMETERS: &[Parameter] = &[
    Parameter::new("torque", Unit::NM, Role::Linear, 2.0, (0.0, 500.0)).counted(Count::PerArm),
    Parameter::new("exponent", Unit::One, Role::Shape, 0.5, (0.0, 3.0)),
    Parameter::new("knee_speed", Unit::RadPerS, Role::Shape, 0.1, (0.01, 20.0)),
    Parameter::new("speed", Unit::RadPerS, Role::Fixed, 10.0, (0.1, 100.0)),
];

static SPEC: Spec = Spec::new(
    "viscous_curve",
    Part::Drives,
    About {
        summary: "friction of the arm drives that grows slower or faster than speed",
        law: "τ_i = −A_i·(q̇_i/w)·((q̇_i² + v²)/(w² + v²))^((β−1)/2): ∝ |q̇|^β above v, friction A at the speed w",
        shows: "odd, curved torque over speed of each arm; none where the curve is straight (β = 1)",
        source: "Carreau 1972 (shear thinning); exponents of drives and bearings 1/3 (Grotjahn 2001), 0.6–2/3 \
                 (Harris 2001), up to 2 (churning)",
    },
    PARAMETERS,
)
// β of 0.3 to 2 above a small knee, and saturation at two speeds.
.grids(&[&[0.6, 1.0, 1.4, 3.0, 4.0], &[10.0, 40.0]]);

impl Effect for ViscousCurve {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        let (knee, speed) = (values.one(KNEE), values.one(SPEED));
        let power = 0.5 * (values.one(EXPONENT) - 1.0);
        for axis in 0..values.len(TORQUE) {
            let rate = at.motion.qd[axis];
            let thinning = ((rate * rate + knee * knee) / (speed * speed + knee * knee)).powf(power);
            out.drive_torque(values.index(TORQUE, axis), axis, -rate / speed * thinning);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing;
    use crate::kinematics::Motion;

    /// Torque on the first arm at `rate` with 3 N·m at 10 rad/s.
    fn torque(exponent: f64, knee: f64, rate: f64) -> f64 {
        let mut motion = testing::still();
        motion.qd[0] = rate;
        let (body, direction) = Motion::drive(0);
        let blocks: [&[f64]; 4] = [&[3.0; 3], &[exponent], &[knee], &[10.0]];
        testing::totals(&ViscousCurve, &blocks, &motion)[body].1.dot(&direction)
    }

    #[test]
    fn powers_of_the_speed() {
        // At the stated speed 3 N·m with every shape; at a quarter of it 4^−β of that.
        for (exponent, quarter) in [(0.5, 1.5), (1.0, 0.75), (2.0, 0.1875)] {
            approx::assert_relative_eq!(torque(exponent, 0.01, 10.0), -3.0, epsilon = 1e-12);
            approx::assert_relative_eq!(torque(exponent, 0.01, -2.5), quarter, max_relative = 1e-5);
        }
        assert_eq!(torque(0.5, 0.01, 0.0), 0.0);
    }

    #[test]
    fn a_saturating_curve() {
        // q̇/√(q̇² + v²) with v = 10/√3 · 1: √3/2 of the limit at 10 rad/s, 1/2 at v/√3 = 10/3 rad/s.
        let knee = 10.0 / 3f64.sqrt();
        let limit = 3.0 * 2.0 / 3f64.sqrt();
        approx::assert_relative_eq!(torque(0.0, knee, 10.0), -3.0, epsilon = 1e-12);
        approx::assert_relative_eq!(torque(0.0, knee, 10.0 / 3.0), -0.5 * limit, epsilon = 1e-12);
        approx::assert_relative_eq!(torque(0.0, knee, 1e6), -limit, epsilon = 1e-6);
    }
}
