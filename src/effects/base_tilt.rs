//! Tilt of the base against the horizontal.

use nalgebra::Vector3;

use super::{About, Count, Effect, Instant, Parameter, Part, Reads, Role, Spec, Unit, Values, Wrenches};

/// Gravity in the axes of a base rotated by the small angles θ (rad): g' = g − θ × g, first order in θ.
pub struct BaseTilt;

const PARAMETERS: &[Parameter] =
    &[Parameter::new("tilt", Unit::Rad, Role::Linear, 0.002, (-0.3, 0.3)).counted(Count::Named(&["x", "y"]))];

static SPEC: Spec = Spec::new(
    "base_tilt",
    Part::Weight,
    About {
        summary: "the base is tilted about x and y",
        law: "g' = g − θ×g = (g·θ_y, −g·θ_x, −g), first order in the tilt",
        shows: "static torque of the arms that changes with the pose; close to a constant torque per arm",
        source: "0.1° typical, 0.5° at worst (estimate)",
    },
    PARAMETERS,
)
.reads(Reads { inertia: true, ..Reads::MOTION });

impl Effect for BaseTilt {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        let extra = [Vector3::new(0.0, -at.gravity, 0.0), Vector3::new(at.gravity, 0.0, 0.0)];
        for (body, inertia) in at.bodies.0.iter().enumerate() {
            let h = at.motion.bodies[body].rotation * inertia.first_moment;
            for (i, g) in extra.iter().enumerate() {
                out.wrench(values.index(0, i), body, g * inertia.mass, h.cross(g));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing;
    use crate::kinematics::Reactions;
    use crate::machine::bodies::PLATFORM;

    #[test]
    fn tilting_about_y_pulls_along_x() {
        // The base's x axis points down by θ, so that gravity has the component +9.81·θ along it: 2 kg → 19.62 N per
        // rad.
        let mut bodies = testing::no_bodies();
        bodies[PLATFORM].mass = 2.0;
        let w = testing::wrenches_with(&BaseTilt, &testing::still(), &Reactions::default(), &bodies);
        let about_y: Vector3<f64> = w.iter().filter(|(k, b, ..)| *k == 1 && *b == PLATFORM).map(|x| x.2).sum();
        approx::assert_relative_eq!(about_y, Vector3::new(19.62, 0.0, 0.0));
    }
}
