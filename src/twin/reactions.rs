//! Reactions of all joints from the accelerations, body by body.

use nalgebra::Vector3;

use super::wrench::Twist;
use crate::dynamics::{Plant, inertial_wrench};
use crate::kinematics::Motion;
use crate::machine::bodies::{self, END_EFFECTOR, PLATFORM, ROTOR, TELESCOPE_LOWER, TELESCOPE_UPPER};
use crate::machine::{PerSocket, ThreeArms, lower_socket, six_struts};

/// Reactions of all joints: 74 independent numbers.
///
/// Wrenches are (force in N, moment in N·m about the joint), inertial axes, on the body named second in each comment.
/// The number of independent components is given at the end.
#[derive(Clone, Copy, Debug)]
pub struct JointReactions {
    /// Twelve ball sockets (six upper, six lower), ball on strut: 36.
    pub sockets: PerSocket<Vector3<f64>>,
    /// Bearings of the arms, frame on arm, at the shaft, without the drive torque: 3 · 5.
    pub arms: ThreeArms<Twist>,
    /// Bearing of the rotor, frame on rotor, at the upper Hooke joint, without the drive torque: 5.
    pub rotor: Twist,
    /// Upper Hooke joint, rotor on telescope: 4.
    pub upper_hooke: Twist,
    /// Sliding joint, upper on lower telescope part, at the lower Hooke joint: 5.
    pub slide: Twist,
    /// Lower Hooke joint, telescope on end effector: 4.
    pub lower_hooke: Twist,
    /// Bearing of the end effector, platform on end effector, at the flange: 5.
    pub end_effector: Twist,
}

impl JointReactions {
    /// Reactions from the accelerations in `motion`, the applied `wrenches` (effects, drives and contacts, about the
    /// bodies' origins, inertial axes) and the socket forces (N).
    pub fn new(plant: &Plant, motion: &Motion, wrenches: &[Twist], sockets: &PerSocket<Vector3<f64>>) -> Self {
        let gravity = plant.gravity_vector();
        let demand = |b: usize| -> Twist {
            let (force, moment) = inertial_wrench(&plant.bodies[b], &motion.bodies[b], &gravity);
            (force - wrenches[b].0, moment - wrenches[b].1)
        };
        let at = |b: usize| motion.bodies[b].position;
        let arms = std::array::from_fn(|i| {
            let (mut force, mut moment) = demand(bodies::arm(i));
            for s in [2 * i, 2 * i + 1] {
                let lever = motion.bodies[bodies::strut(s)].position - at(bodies::arm(i));
                force += sockets[s];
                moment += lever.cross(&sockets[s]);
            }
            (force, moment)
        });
        // The platform bears its struts and the end effector, the end effector is held by platform and telescope.
        let (mut force, mut moment) = demand(PLATFORM);
        for s in six_struts() {
            let strut = &motion.bodies[bodies::strut(s)];
            let lever = strut.position + motion.strut_axis[s] * motion.strut_length[s] - at(PLATFORM);
            force += sockets[lower_socket(s)];
            moment += lever.cross(&sockets[lower_socket(s)]);
        }
        let lever = at(END_EFFECTOR) - at(PLATFORM);
        let end_effector = (-force, -(moment - lever.cross(&force)));
        let (f, n) = demand(END_EFFECTOR);
        let lever = at(TELESCOPE_LOWER) - at(END_EFFECTOR);
        let force = f - end_effector.0;
        let lower_hooke = (force, n - end_effector.1 - lever.cross(&force));
        let (f, n) = demand(TELESCOPE_LOWER);
        let slide = (f + lower_hooke.0, n + lower_hooke.1);
        let (f, n) = demand(TELESCOPE_UPPER);
        let lever = at(TELESCOPE_LOWER) - at(TELESCOPE_UPPER);
        let upper_hooke = (f + slide.0, n + slide.1 + lever.cross(&slide.0));
        let (f, n) = demand(ROTOR);
        let rotor = (f + upper_hooke.0, n + upper_hooke.1);
        Self { sockets: *sockets, arms, rotor, upper_hooke, slide, lower_hooke, end_effector }
    }
}
