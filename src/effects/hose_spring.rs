//! Force of a hose or cable on the platform.

use nalgebra::Vector3;

use super::{About, Count, Effect, Instant, MachineView, Parameter, Part, Role, Spec, Start, Unit, Values, Wrenches};
use crate::machine::bodies::PLATFORM;

/// Spring force F = f − k·e·d/|d| on the platform's centre p, with d = p − a and the elongation e = |d| − l₀.
///
/// a is the fixed end in m, inertial axes; l₀ the free length in m; k in N/m, never negative; f a constant force in N,
/// inertial axes, e.g. the weight of the hose. A spring wound with a preload F₀ pulls at any length: l₀ is less by F₀/k, and below
/// zero for a spring that would be short. With `pulls_only` = 1 the spring is slack in compression: e = max(0, |d|
/// − l₀). With l₀ = 0 the law is linear, F = f + k·a − k·p, and f is equivalent to a fixed end at a + f/k. Potential
/// energy k·e²/2 − f·p.
pub struct HoseSpring;

const STIFFNESS: usize = 0;
const PRELOAD: usize = 1;
const ANCHOR: usize = 2;
const FREE_LENGTH: usize = 3;
const PULLS_ONLY: usize = 4;

/// Starting values on the reference machine: fixed ends 0.8 m from the middle of the workspace, overhead and inclined by
/// 45° to four sides, each with a spring of about that length and with a slack one. A spring without length starts overhead:
/// its law is the same from every end, but its length is searched next.
const STARTS: [Start; 11] = {
    const fn at(anchor: &'static [f64], length: &'static [f64], pulls_only: &'static [f64]) -> Start {
        Start([Some((ANCHOR, anchor)), Some((FREE_LENGTH, length)), Some((PULLS_ONLY, pulls_only))])
    }
    const ENDS: [&[f64]; 5] =
        [&[0.0, 0.0, -0.2], &[0.57, 0.0, -0.43], &[-0.57, 0.0, -0.43], &[0.0, 0.57, -0.43], &[0.0, -0.57, -0.43]];
    [
        at(ENDS[0], &[0.0], &[0.0]),
        at(ENDS[0], &[0.7], &[0.0]),
        at(ENDS[1], &[0.7], &[0.0]),
        at(ENDS[2], &[0.7], &[0.0]),
        at(ENDS[3], &[0.7], &[0.0]),
        at(ENDS[4], &[0.7], &[0.0]),
        at(ENDS[0], &[0.8], &[1.0]),
        at(ENDS[1], &[0.8], &[1.0]),
        at(ENDS[2], &[0.8], &[1.0]),
        at(ENDS[3], &[0.8], &[1.0]),
        at(ENDS[4], &[0.8], &[1.0]),
    ]
};

const PARAMETERS: &[Parameter] = &[
    Parameter::new("stiffness", Unit::NPerM, Role::Linear, 10.0, (0.0, 1e4)),
    Parameter::new("preload", Unit::N, Role::Linear, 3.0, (-200.0, 200.0)).counted(Count::Named(&["x", "y", "z"])),
    Parameter::new("anchor", Unit::M, Role::Shape, 0.5, (-5.0, 5.0)).counted(Count::Named(&["x", "y", "z"])),
    Parameter::new("free_length", Unit::M, Role::Shape, 0.8, (-5.0, 5.0)),
    // 0 or 1.
    Parameter::new("pulls_only", Unit::One, Role::Fixed, 0.0, (0.0, 1.0)),
];

static SPEC: Spec = Spec::new(
    "hose_spring",
    Part::Linkage,
    About {
        summary: "pull of a hose or cable at the platform",
        law: "F = f − k·(|d| − l₀)·d/|d|, d = p − a: a spring of free length l₀ to the fixed point a",
        shows: "static torque of the arms that grows with the platform's distance from a point",
        source: "Hooke's law; vacuum hose or cable, 5–50 N/m and some newtons (estimate)",
    },
    PARAMETERS,
)
// Factors for randomly drawn hoses in the validation; the diagnosis uses the starts.
.grids(&[&[0.5, 0.7, 1.3, 2.0]])
.starts(&STARTS)
.constants(constant);

/// Fixed end and free length in proportion to the mechanism.
fn constant(parameter: &str, model: &MachineView) -> Option<f64> {
    let usual = PARAMETERS.iter().find(|p| p.name == parameter && p.unit == Unit::M)?.default;
    Some(usual * model.size())
}

impl Effect for HoseSpring {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        let end = Vector3::from_column_slice(values.block(ANCHOR));
        let d = at.motion.bodies[PLATFORM].position - end;
        let (distance, free) = (d.norm(), values.one(FREE_LENGTH));
        // The direction is undefined at the fixed end.
        let share = if distance > f64::EPSILON * free { 1.0 - free / distance } else { 0.0 };
        let share = if values.one(PULLS_ONLY) > 0.5 { share.max(0.0) } else { share };
        out.wrench(values.index(STIFFNESS, 0), PLATFORM, d * -share, Vector3::zeros());
        for axis in 0..values.len(PRELOAD) {
            out.wrench(values.index(PRELOAD, axis), PLATFORM, Vector3::ith(axis, 1.0), Vector3::zeros());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing;

    fn pull(blocks: &[&[f64]], position: Vector3<f64>) -> Vector3<f64> {
        let mut motion = testing::still();
        motion.bodies[PLATFORM].position = position;
        testing::totals(&HoseSpring, blocks, &motion)[PLATFORM].0
    }

    #[test]
    fn without_free_length_it_pulls_towards_the_fixed_point() {
        // 20 N/m and 10 N along x: fixed point at (0.5, 0, −0.9). From (0.5, 0.2, −1.1) it pulls by 20·(0, −0.2, 0.2).
        let blocks: [&[f64]; 5] = [&[20.0], &[10.0, 0.0, 0.0], &[0.0, 0.0, -0.9], &[0.0], &[0.0]];
        let total = pull(&blocks, Vector3::new(0.5, 0.2, -1.1));
        approx::assert_relative_eq!(total, Vector3::new(0.0, -4.0, 4.0), epsilon = 1e-12);
    }

    #[test]
    fn a_spring_pulls_when_longer_and_pushes_or_hangs_when_shorter_than_free() {
        // From (0.3, 0, −0.4) to the origin 0.5 m: 0.2 m longer than free, 20·0.2 = 4 N along (−0.6, 0, 0.8).
        let p = Vector3::new(0.3, 0.0, -0.4);
        let with = |free: f64, slack: f64| pull(&[&[20.0], &[0.0; 3], &[0.0; 3], &[free], &[slack]], p);
        approx::assert_relative_eq!(with(0.3, 0.0), Vector3::new(-2.4, 0.0, 3.2), epsilon = 1e-12);
        approx::assert_relative_eq!(with(0.3, 1.0), Vector3::new(-2.4, 0.0, 3.2), epsilon = 1e-12);
        approx::assert_relative_eq!(with(0.6, 0.0), Vector3::new(1.2, 0.0, -1.6), epsilon = 1e-12);
        assert_eq!(with(0.6, 1.0), Vector3::zeros());
        // A preload of 4 N: 20·0.5 + 4 = 14 N.
        approx::assert_relative_eq!(with(-0.2, 1.0), Vector3::new(-8.4, 0.0, 11.2), epsilon = 1e-12);
        assert!(pull(&[&[20.0], &[0.0; 3], &[0.0; 3], &[0.6], &[0.0]], Vector3::zeros()).norm() < 1e-300);
    }
}
