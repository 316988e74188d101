//! Clamp springs, which press the cups on the balls and prevent the struts from spinning.

use nalgebra::Vector3;

use super::{About, Effect, Instant, MachineView, Parameter, Part, Role, Spec, Unit, Values, Wrenches};
use crate::kinematics::Motion;
use crate::machine::bodies::{arm, strut};

/// One clamp unit at each end of a pair: two tension springs between the struts, F = ½·(P + k·(d − d₀)) each.
///
/// F in N along the line between a spring's anchors, pulling the struts together; preload P in N and stiffness k in N/m
/// of the unit; d the distance of the anchors in m, d₀ (`gap`) its value on the assembled robot. In the strut frame the
/// anchors are at x = `position` from the unit's ball, at y = `offset` towards the other strut and at z = ±`spread`.
///
/// With anchors on the strut axes (`offset` 0), the springs of a parallel pair keep length and direction and do no
/// work; with an offset they resist shear of the pair. A spin of the struts by θ produces, per unit, a moment about the
/// strut axis of −(k·spread²·2 + P·offset)·θ for opposite spins and −P·offset·(1 + 2·offset/d₀)·θ for equal spins. For
/// zero offset, equal spins are resisted by friction in the sockets alone.
///
/// The springs prestress the sockets. A force f at x along a strut of length L is balanced by −f·(1 − x/L) at the upper
/// and −f·x/L at the lower ball, and each ball transmits its part to the other strut's ball through arm or platform.
/// These parts do no work while the cups are seated; they are applied to the bodies together with the spring force, so
/// that the joint reactions contain the load alone. The reactions are thus *net* of the clamps, as is the dislocation
/// force of the model file. (The springs' own part of the force on a ball is P along the pair direction v; in a sheared
/// pair its component along the strut u is P·(u·v).) A unit is inactive once one of its two sockets has dislocated.
pub struct ClampSprings;

const PRELOAD: usize = 0;
const RATE: usize = 1;
const POSITION: usize = 2;
const OFFSET: usize = 3;
const SPREAD: usize = 4;
const GAP: usize = 5;

const fn length(name: &'static str, default: f64) -> Parameter {
    Parameter::new(name, Unit::M, Role::Fixed, default, (0.0, 1.0))
}

const PARAMETERS: &[Parameter] = &[
    Parameter::new("preload", Unit::N, Role::Linear, 200.0, (0.0, 1e4)),
    Parameter::new("rate", Unit::NPerM, Role::Linear, 9200.0, (0.0, 1e6)),
    length("position", 0.03),
    length("offset", 0.0),
    length("spread", 0.012),
    length("gap", 0.1),
];

static SPEC: Spec = Spec::new(
    "clamp_springs",
    Part::Linkage,
    About {
        summary: "springs between the struts of a pair, which clamp the sockets and restrain the struts' spin",
        law: "F = ½·(P + k·(d − d₀)) along each of two springs per end of a pair",
        shows: "nowhere in a recording: the springs of a parallel pair do no work",
        source: "CAD: two springs per unit 30 mm from the ball, 4.3–5.0 N/mm each; anchors' offsets and P estimates",
    },
    PARAMETERS,
)
.twin_only()
.constants(constant);

fn constant(parameter: &str, model: &MachineView) -> Option<f64> {
    (parameter == "preload" && model.sockets.preload > 0.0).then_some(model.sockets.preload)
}

impl Effect for ClampSprings {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        let (position, offset) = (values.one(POSITION), values.one(OFFSET));
        let (spread, gap) = (values.one(SPREAD), values.one(GAP));
        for limb in 0..at.motion.limbs {
            for end in 0..2 {
                let pair = [2 * limb, 2 * limb + 1];
                if pair.iter().any(|s| !at.closed.contains(end * at.motion.struts() + s)) {
                    continue;
                }
                for side in [spread, -spread] {
                    // The first strut of a pair is at +v, so that the other one is at −y.
                    let anchors: [Vector3<f64>; 2] = std::array::from_fn(|k| {
                        let along = if end == 0 { position } else { at.motion.strut_length[pair[k]] - position };
                        let towards = if k == 0 { -offset } else { offset };
                        at.motion.bodies[strut(pair[k])].rotation * Vector3::new(along, towards, side)
                    });
                    let points: [Vector3<f64>; 2] =
                        std::array::from_fn(|k| at.motion.bodies[strut(pair[k])].position + anchors[k]);
                    let line = points[1] - points[0];
                    let distance = line.norm();
                    let pull = line / distance;
                    for (parameter, size) in [(PRELOAD, 0.5), (RATE, 0.5 * (distance - gap))] {
                        let parameter = values.index(parameter, 0);
                        prestress(parameter, pair[0], &anchors[0], &(pull * size), at.motion, out);
                        prestress(parameter, pair[1], &anchors[1], &(pull * -size), at.motion, out);
                    }
                }
            }
        }
    }
}

/// Writes a force on a strut at `anchor` (m, from the strut's origin) together with the reactions of its two balls.
///
/// The resultant is a moment on the strut, from the anchor's distance to the line of the balls, and forces on arm and
/// platform according to the lever rule.
fn prestress(k: usize, s: usize, anchor: &Vector3<f64>, force: &Vector3<f64>, motion: &Motion, out: &mut Wrenches) {
    let (axis, length) = (motion.strut_axis[s], motion.strut_length[s]);
    let along = anchor.dot(&axis);
    out.moment(k, strut(s), (anchor - axis * along).cross(force));
    let start = motion.bodies[strut(s)].position;
    for (body, ball, share) in
        [(arm(s / 2), start, 1.0 - along / length), (motion.carrier[s], start + axis * length, along / length)]
    {
        let part = force * share;
        out.wrench(k, body, part, (ball - motion.bodies[body].position).cross(&part));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing;
    use crate::machine::bodies::{ARM, PLATFORM, STRUT};
    use crate::machine::six_struts;

    /// Struts 1 and 2 hang along x from balls 100 mm apart in y; the first is rolled by `roll`.
    fn moments(roll: [f64; 2]) -> [Vector3<f64>; 2] {
        let mut motion = testing::still();
        for (k, y) in [(0, 0.05), (1, -0.05)] {
            let strut = &mut motion.bodies[strut(k)];
            strut.position = Vector3::new(0.0, y, 0.0);
            strut.rotation = *nalgebra::Rotation3::from_axis_angle(&Vector3::x_axis(), roll[k]).matrix();
            motion.strut_axis[k] = Vector3::x();
        }
        // The other pairs are far away, so that no distance is zero.
        for s in six_struts().skip(2) {
            motion.bodies[strut(s)].position = Vector3::new(0.0, if s % 2 == 0 { 1.0 } else { -1.0 }, s as f64);
        }
        let total =
            testing::totals(&ClampSprings, &[&[200.0], &[9200.0], &[0.03], &[0.01], &[0.012], &[0.08]], &motion);
        assert!((total[STRUT].0 + total[strut(1)].0).norm() < 1e-12);
        [total[STRUT].1, total[strut(1)].1]
    }

    #[test]
    fn clamps_of_a_parallel_pair_leave_the_bodies_alone() {
        for moment in moments([0.0, 0.0]) {
            approx::assert_relative_eq!(moment, Vector3::zeros(), epsilon = 1e-9);
        }
    }

    #[test]
    fn a_pull_near_one_ball_is_shared_out_by_the_lever() {
        // 200 N across a strut of 1 m, 30 mm from its upper ball and 10 mm beside its axis: 194 N at the upper ball, 6 N at
        // the lower one, and the moment of the 10 mm about the strut: 0.01·ŷ × 200·ẑ = 2 N·m about x.
        let mut motion = testing::still();
        motion.strut_axis[0] = Vector3::x();
        let mut total = [(Vector3::zeros(), Vector3::zeros()); crate::machine::bodies::SLOTS];
        let mut out = Wrenches::sum(&[1.0], &motion, &mut total);
        let (anchor, force) = (Vector3::new(0.03, 0.01, 0.0), Vector3::new(0.0, 0.0, 200.0));
        prestress(0, 0, &anchor, &force, &motion, &mut out);
        let z = Vector3::z;
        approx::assert_relative_eq!(total[ARM].0, z() * 194.0, epsilon = 1e-12);
        approx::assert_relative_eq!(total[PLATFORM].0, z() * 6.0, epsilon = 1e-12);
        assert_eq!(total[STRUT].0, Vector3::zeros());
        approx::assert_relative_eq!(total[STRUT].1, Vector3::x() * 2.0, epsilon = 1e-12);
        // Equilibrium: the sum of all is the force at its point of application.
        let moment = total[ARM].1 + total[PLATFORM].1 + total[STRUT].1;
        approx::assert_relative_eq!(moment, anchor.cross(&force), epsilon = 1e-12);
    }

    #[test]
    fn spin_is_restrained() {
        let step = 1e-4;
        // Alike, per unit: P·offset·(1 + 2·offset/d₀) = 200·0.01·1.25 = 2.5 N·m/rad, two units: 5.
        let [first, second] = moments([step, step]);
        approx::assert_relative_eq!(first.x / step, -5.0, max_relative = 1e-4);
        approx::assert_relative_eq!(second.x / step, -5.0, max_relative = 1e-4);
        // Opposite: the lines stay parallel to y, P·offset = 2, and the springs stretch by 2·spread·θ:
        // 9200·2·0.012² = 2.6496; two units: 9.2992.
        let [first, second] = moments([step, -step]);
        approx::assert_relative_eq!(first.x / step, -9.2992, max_relative = 1e-3);
        approx::assert_relative_eq!(second.x / step, 9.2992, max_relative = 1e-3);
    }
}
