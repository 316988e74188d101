//! Recovery of socket forces and of the accelerations of all bodies from a solution of the open equations.

use super::super::wrench::{STILL, Twist};
use super::equations::{Ends, Loads};
use super::{Frame, Mechanism, OpenVector, Solution, platform_twist};
use crate::machine::bodies::{self, END_EFFECTOR, PLATFORM, ROTOR, SLOTS, TELESCOPE_LOWER, TELESCOPE_UPPER};
use crate::machine::{SixStruts, lower_socket, six_struts, three_arms};

impl Mechanism {
    /// Writes the complete solution, with socket forces and strut spins, from open accelerations and tensions.
    pub(super) fn recover(
        &self,
        loads: &Loads,
        ends: &SixStruts<Ends>,
        (nu_rate, tension): (OpenVector, &SixStruts<f64>),
        solution: &mut Solution,
    ) {
        let Frame { motion, jacobians, .. } = loads.frame;
        let (linear, angular) = platform_twist(&nu_rate);
        solution.nu_rate = nu_rate;
        for s in six_struts() {
            let (i, rod) = (s / 2, &self.rods[s]);
            let (u, r) = (motion.strut_axis[s], jacobians.ball[s]);
            let a = jacobians.elbow[i] * nu_rate[i] + jacobians.elbow_bias[i];
            let b = linear + angular.cross(&r) + jacobians.ball_bias[s];
            let upper = a * rod.aa + b * rod.ab - ends[s].upper - u * tension[s];
            let lower = a * rod.ab + b * rod.bb - ends[s].lower + u * tension[s];
            solution.socket_force[s] = upper;
            solution.socket_force[lower_socket(s)] = lower;
            solution.reactions.upper[s] = -u.dot(&upper);
            solution.reactions.lower[s] = u.dot(&lower);
            let inertia = rod.axial + loads.implicit.spins[s];
            solution.spin_rate[s] =
                (loads.wrenches[bodies::strut(s)].1.dot(&u) + loads.implicit.spin_moment[s]) / inertia;
        }
    }

    /// Accelerations of all bodies for a solution, inertial axes.
    pub fn accelerations(&self, frame: &Frame, solution: &Solution) -> [Twist; SLOTS] {
        let Frame { motion, jacobians, .. } = frame;
        let mut out = [STILL; SLOTS];
        let nu = &solution.nu_rate;
        for i in three_arms() {
            let (body, screw) = motion.drive(i);
            screw.push(&mut out[body], nu[i]);
        }
        out[ROTOR].1.z = nu[3];
        let (linear, angular) = platform_twist(nu);
        out[PLATFORM] = (linear, angular);
        for s in six_struts() {
            let i = s / 2;
            let (u, length) = (motion.strut_axis[s], motion.strut_length[s]);
            let a = jacobians.elbow[i] * nu[i] + jacobians.elbow_bias[i];
            let b = linear + angular.cross(&jacobians.ball[s]) + jacobians.ball_bias[s];
            let along = frame.length_rate[s];
            let axis_rate = (jacobians.stretch[s] - u * along) / length;
            let spin = motion.bodies[bodies::strut(s)].angular_velocity.dot(&u);
            // ω = u × Δv / ℓ + σ u; the change of ℓ matters for elastic struts only.
            let swing = (u.cross(&(b - a)) + axis_rate.cross(&jacobians.stretch[s])
                - u.cross(&jacobians.stretch[s]) * (along / length))
                / length;
            out[bodies::strut(s)] = (a, swing + u * solution.spin_rate[s] + axis_rate * spin);
        }
        let chain = &jacobians.chain;
        let bias = &jacobians.bias;
        let hooke = linear + angular.cross(&chain.hooke);
        let turned = chain.a * hooke + chain.b * nu[3];
        let (cv, cw, cr) = (chain.c_v, chain.c_omega, chain.c_rotor);
        let relative = cv.dot(&hooke) + cw.dot(&angular) + cr * nu[3];
        let flange = chain.pivot * self.geometry.flange_height;
        out[END_EFFECTOR] = (
            linear + angular.cross(&flange) + bias.end_effector.0,
            angular + chain.pivot * relative + bias.end_effector.1,
        );
        out[TELESCOPE_UPPER].1 = turned + bias.telescope;
        out[TELESCOPE_LOWER] = (hooke + bias.hooke, turned + bias.telescope);
        out
    }
}
