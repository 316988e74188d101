//! Gravity of an unbalanced load on a single turning axis.

use super::{About, Effect, Instant, Parameter, Part, Role, Spec, Unit, Values, Wrenches};

/// Torque τ = −(a·sin q + b·cos q) on the axis; a and b in N·m, either sign, q in rad.
///
/// A mass m at the distance r from the axis, lowest at q = q₀, has a = m·g·r·cos q₀ and b = −m·g·r·sin q₀; on an axis
/// inclined by γ against the vertical both are multiplied by sin γ. Conservative, with the potential −a·cos q + b·sin q.
pub struct AxisGravity;

const SINE: usize = 0;
const COSINE: usize = 1;

const fn torque(name: &'static str) -> Parameter {
    Parameter::new(name, Unit::NM, Role::Linear, 10.0, (-132.0, 132.0))
}

const PARAMETERS: &[Parameter] = &[torque("sine"), torque("cosine")];

static SPEC: Spec = Spec::new(
    "axis_gravity",
    Part::TurningAxis,
    About {
        summary: "weight of an unbalanced load on a single turning axis",
        law: "τ = −(a·sin q + b·cos q)",
        shows: "torque periodic in a turn of the axis, at rest as in motion",
        source: "weight m·g·r of the load; some percent of the drive's torque (estimate)",
    },
    PARAMETERS,
);

impl Effect for AxisGravity {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        let (sine, cosine) = at.motion.q[0].sin_cos();
        out.drive_torque(values.index(SINE, 0), 0, -sine);
        out.drive_torque(values.index(COSINE, 0), 0, -cosine);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing;

    #[test]
    fn a_kilogram_at_a_tenth_of_a_metre() {
        // 0.981 N·m where the lever is horizontal; lowest at q = −30°: a = 0.981·cos 30°, b = 0.981·sin 30°.
        let (weight, lowest) = (0.981, -std::f64::consts::PI / 6.0);
        let blocks: [&[f64]; 2] = [&[weight * lowest.cos()], &[-weight * lowest.sin()]];
        for (beyond, torque) in [(0.0, 0.0), (90.0, -weight), (180.0, 0.0), (-90.0, weight), (30.0, -0.5 * weight)] {
            let mut motion = testing::still();
            motion.q[0] = lowest + f64::to_radians(beyond);
            let (body, screw) = motion.drive(0);
            let total = testing::totals(&AxisGravity, &blocks, &motion)[body].1.dot(&screw.angular);
            approx::assert_relative_eq!(total, torque, epsilon = 1e-12);
        }
    }
}
