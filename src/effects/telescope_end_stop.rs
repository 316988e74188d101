//! End stops of the telescope.

use super::{About, Effect, Instant, MachineView, Parameter, Part, Role, Spec, Unit, Values, Wrenches, hunt_crossley};

/// Unilateral spring and damper beyond the shortest and the longest Hooke distance: F = k·x·max(0, 1 + χ·ẋ), with x (m)
/// the depth beyond the limit ([`hunt_crossley`]).
///
/// F in N along the bar, pushing the parts apart below `min` and pulling them together above `max`; k in N/m, χ in s/m;
/// ẋ positive while the depth increases. The force is continuous at the limit because of the factor x, and never
/// adhesive. In addition to the spring force k·x, the damping dissipates k·x·χ·ẋ² (all of the spring's power after
/// separation).
pub struct TelescopeEndStop;

const STIFFNESS: usize = 0;
const DAMPING: usize = 1;
const MIN: usize = 2;
const MAX: usize = 3;

const fn length(name: &'static str, default: f64) -> Parameter {
    Parameter::new(name, Unit::M, Role::Shape, default, (0.0, 10.0))
}

const PARAMETERS: &[Parameter] = &[
    Parameter::new("stiffness", Unit::NPerM, Role::Linear, 1e5, (0.0, 1e8)),
    Parameter::new("damping", Unit::SPerM, Role::Fixed, 1.0, (0.0, 100.0)),
    length("min", 0.812),
    length("max", 1.372),
];

static SPEC: Spec = Spec::new(
    "telescope_end_stop",
    Part::Telescope,
    About {
        summary: "the telescope runs into its shortest or longest length",
        law: "F = k·x·max(0, 1 + χ·dx/dt), x = max(0, L_min − L) apart, max(0, L − L_max) together",
        shows: "torque peaks of all arms where the Hooke distance leaves its range, nothing elsewhere",
        source: "Hunt and Crossley, 1975; limits from CAD (rod bottoms, rod end at the bush); stiffness an estimate",
    },
    PARAMETERS,
)
// Factors of the data sheet limits: an earlier stop is an obstacle in the telescope.
.grids({
    const NOTHING_SHORTER: &[f64] = &[1.0, 1.05, 1.1, 1.16, 1.22, 1.28, 1.35];
    const NOTHING_LONGER: &[f64] = &[1.0, 0.97, 0.94, 0.91, 0.88, 0.85, 0.82, 0.79, 0.76];
    &[NOTHING_SHORTER, NOTHING_LONGER]
})
.constants(constant);

fn constant(parameter: &str, model: &MachineView) -> Option<f64> {
    match parameter {
        "min" => Some(model.geometry.telescope_limits[0]),
        "max" => Some(model.geometry.telescope_limits[1]),
        _ => None,
    }
}

impl Effect for TelescopeEndStop {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        let telescope = &at.motion.telescope;
        let (short, long) = (values.one(MIN) - telescope.length, telescope.length - values.one(MAX));
        let (depth, rate, apart) = if short > 0.0 {
            (short, -telescope.rate, 1.0)
        } else if long > 0.0 {
            (long, telescope.rate, -1.0)
        } else {
            return;
        };
        let push = hunt_crossley(depth, rate, values.one(DAMPING));
        out.telescope_force(values.index(STIFFNESS, 0), at.motion, apart * push);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing;
    use crate::machine::bodies::{TELESCOPE_LOWER, TELESCOPE_UPPER};

    const BLOCKS: [&[f64]; 4] = [&[1e5], &[0.5], &[0.8], &[1.4]];

    /// Force that pushes the parts apart, N.
    fn force(length: f64, rate: f64) -> f64 {
        let mut motion = testing::still();
        (motion.telescope.length, motion.telescope.rate) = (length, rate);
        let total = testing::totals(&TelescopeEndStop, &BLOCKS, &motion);
        approx::assert_relative_eq!(total[TELESCOPE_LOWER].0.z, -total[TELESCOPE_UPPER].0.z);
        total[TELESCOPE_UPPER].0.z
    }

    #[test]
    fn a_millimetre_too_short_or_too_long() {
        // 1e5 N/m · 1 mm = 100 N; half a metre per second deeper: factor 1 + 0.5·0.5 = 1.25, outward 0.75.
        approx::assert_relative_eq!(force(0.799, 0.0), 100.0, epsilon = 1e-9);
        approx::assert_relative_eq!(force(0.799, -0.5), 125.0, epsilon = 1e-9);
        approx::assert_relative_eq!(force(0.799, 0.5), 75.0, epsilon = 1e-9);
        approx::assert_relative_eq!(force(1.401, 0.5), -125.0, epsilon = 1e-9);
        // Faster than 2 m/s outward the contact opens.
        assert_eq!(force(0.799, 3.0), 0.0);
        assert_eq!(force(1.401, -3.0), 0.0);
        for inside in [0.8, 1.1, 1.4] {
            assert_eq!(force(inside, -1.0), 0.0);
        }
    }

    #[test]
    fn a_bounce_returns_less_than_it_took() {
        // 2 kg hit the stop at 1 m/s; without damping it returns at 1 m/s.
        let (mass, h) = (2.0, 1e-6);
        let (mut length, mut rate) = (0.8 - 1e-12, -1.0);
        let (mut work, mut deepest) = (0.0, 0f64);
        while length < 0.8 {
            let push = force(length, rate);
            work += push * (rate + 0.5 * h * push / mass) * h;
            rate += h * push / mass;
            length += h * rate;
            deepest = deepest.max(0.8 - length);
        }
        // Undamped depth √(m/k)·v = 4.47 mm.
        assert!(deepest < 4.47e-3 && deepest > 3.5e-3, "{deepest}");
        assert!(work < -0.2 && rate < 0.9 && rate > 0.5, "{work} J, {rate} m/s");
        approx::assert_relative_eq!(work, 0.5 * mass * (rate * rate - 1.0), epsilon = 1e-9);
    }
}
