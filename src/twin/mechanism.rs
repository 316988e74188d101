//! The assembled mechanism in closed form: from ten open velocities and six strut spins to every body and joint.
//!
//! All joints but the lengths of the struts hold by construction: the state has three arm angles, the rotor's angle, the
//! platform's pose and the roll of each strut. Struts are rods between two moving points a (elbow) and b (platform): with
//! velocities linear between them their mass matrix ½(m_aa v_a² + 2 m_ab v_a·v_b + m_bb v_b²) is constant, so they
//! leave the equations in closed form and bring no velocity products. What remains couples each drive with the
//! platform only:
//!
//! M̂ ν̇ + Bᵀ T = f̂, B ν̇ = c, ν = (φ̇ of three arms, ψ̇ of the rotor, platform v and ω), T the struts' tensions.
//!
//! B is square in the platform's twist. Rigid struts make the platform follow the arms (null space of B), elastic
//! struts turn T into a force law.

use nalgebra::{Matrix3, Matrix4, Quaternion, SMatrix, SVector, UnitQuaternion, Vector3, Vector4};

use super::SingularPose;
use super::context::Answer;
use super::rod::{self, Rod, platform_ball};
use super::wrench::{STILL, Twist};
use crate::dynamics::{Plant, inertial_wrench};
use crate::effects::StrutSpring;
use crate::kinematics::motion::{SOCKETS, telescope_rotation};
use crate::kinematics::{BodyMotion, Motion, Reactions, Telescope};
use crate::model::bodies::{
    ARM, BODIES, END_EFFECTOR, Inertia, PLATFORM, ROTOR, STRUT, TELESCOPE_LOWER, TELESCOPE_UPPER,
};
use crate::model::{ARMS, AXES, Geometry, STRUTS};

/// Open velocities ν.
pub(super) const OPEN: usize = 10;
/// Where the platform's velocity stands in ν; its angular velocity follows.
pub(super) const PLATFORM_V: usize = 4;

pub(super) type OpenVector = SVector<f64, OPEN>;
type Vector6 = SVector<f64, 6>;
type Matrix6 = SMatrix<f64, 6, 6>;

/// Configuration of the opened mechanism.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pose {
    /// Arm angles, rad.
    pub phi: [f64; ARMS],
    /// Rotor angle with all its turns, rad.
    pub psi: f64,
    /// Platform origin, m.
    pub position: Vector3<f64>,
    /// Platform orientation, body to world; of unit length to rounding.
    pub orientation: Quaternion<f64>,
    /// Roll of each strut about its axis from where its y faces along its pair, rad.
    pub roll: [f64; STRUTS],
}

/// What does not change during a run.
pub(super) struct Mechanism {
    geometry: Geometry,
    rods: [Rod; STRUTS],
    /// Platform with the rods' masses at its balls, platform frame.
    laden_platform: Inertia,
    /// Whether the end effector weighs anything.
    loaded: bool,
    /// Elastic struts; rigid without.
    pub springs: Option<[StrutSpring; STRUTS]>,
}

/// Linear maps and accelerations of one configuration that the mass matrix and the forces share.
struct Levers {
    /// Velocity of the elbow per unit arm rate.
    elbow: [Vector3<f64>; ARMS],
    /// Acceleration of the elbow at zero φ̈.
    elbow_bias: [Vector3<f64>; ARMS],
    /// Lower ball relative to the platform's origin.
    ball: [Vector3<f64>; STRUTS],
    /// Velocity of the lower relative to the upper ball.
    stretch: [Vector3<f64>; STRUTS],
    chain: Chain,
    bias: ChainBias,
}

/// The telescope and the end effector move with (v_h, Ω, ω): velocity of the lower Hooke joint, rotor rate and platform
/// angular velocity. ω_T = A v_h + b Ω; end effector relative to the platform: κ = c_v·v_h + c_Ω Ω + c_ω·ω about z_P.
struct Chain {
    hooke: Vector3<f64>,
    a: Matrix3<f64>,
    b: Vector3<f64>,
    pivot: Vector3<f64>,
    c_v: Vector3<f64>,
    c_rotor: f64,
    c_omega: Vector3<f64>,
}

/// Everything the equations need at one configuration and velocity.
pub(super) struct Frame {
    /// Motion of all bodies; accelerations not set.
    pub motion: Motion,
    /// Rate of the roll angles, rad/s.
    pub roll_rate: [f64; STRUTS],
    /// Rate of each strut's length, m/s.
    pub length_rate: [f64; STRUTS],
    levers: Levers,
}

/// Implicit terms of a Rosenbrock step, added to the equations.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Implicit {
    /// h·γ·damping of arms and rotor, kg·m².
    pub drives: [f64; AXES],
    /// Torques on arms and rotor, N·m.
    pub drive_torque: [f64; AXES],
    /// h·γ·damping + h²γ²·stiffness of the spins, kg·m².
    pub spins: [f64; STRUTS],
    /// Moments about the struts' axes, N·m.
    pub spin_moment: [f64; STRUTS],
    /// h·γ·damping + h²γ²·stiffness of elastic struts, kg.
    pub tension: [f64; STRUTS],
    /// Tensions, N.
    pub tension_force: [f64; STRUTS],
}

/// Solution of the equations of motion.
#[derive(Clone, Copy)]
pub(super) struct Solution {
    /// ν̇.
    pub nu_rate: OpenVector,
    /// Angular acceleration of each strut about its axis, rad/s².
    pub spin_rate: [f64; STRUTS],
    /// Axial forces at the balls.
    pub reactions: Reactions,
    /// Force on each strut at its sockets (six upper, six lower), N, world.
    pub socket_force: [Vector3<f64>; SOCKETS],
}

impl Solution {
    /// What laws may read of it.
    pub fn answer(&self) -> Answer {
        let rate = self.nu_rate.as_slice();
        let drives = std::array::from_fn(|axis| rate[axis]);
        Answer { reactions: self.reactions, drives, platform: Vector3::new(rate[4], rate[5], rate[6]) }
    }
}

impl Mechanism {
    pub fn new(plant: &Plant) -> Self {
        let geometry = plant.geometry;
        let rods = Rod::all(plant);
        let mut laden_platform = plant.bodies[PLATFORM];
        for (s, rod) in rods.iter().enumerate() {
            laden_platform += Inertia::point(rod.bb, platform_ball(&geometry, s));
        }
        let end_effector = &plant.bodies[END_EFFECTOR];
        let springs = plant.effects.iter().find_map(|a| a.strut_spring());
        Self { geometry, rods, laden_platform, loaded: *end_effector != Inertia::ZERO, springs }
    }

    /// All bodies at a pose with velocities ν and spins.
    pub fn frame(&self, pose: &Pose, nu: &OpenVector, spin: &[f64; STRUTS], out: &mut Frame) {
        let g = &self.geometry;
        let Frame { motion, roll_rate, length_rate, levers } = out;
        let Motion { q, qd, bodies, strut_axis, strut_length, telescope, .. } = motion;
        *q = [pose.phi[0], pose.phi[1], pose.phi[2], pose.psi];
        *qd = [nu[0], nu[1], nu[2], nu[3]];
        let mut elbows = [Vector3::zeros(); ARMS];
        for i in 0..ARMS {
            let (s, c) = pose.phi[i].sin_cos();
            let (u, v) = (Geometry::radial(i), Geometry::tangential(i));
            let x = Vector3::new(c * u.x, c * u.y, -s);
            let z = Vector3::new(s * u.x, s * u.y, c);
            let shaft = u * g.base_radius;
            let arm = &mut bodies[ARM + i];
            arm.rotation = Matrix3::from_columns(&[x, v, z]);
            arm.position = shaft;
            arm.angular_velocity = v * nu[i];
            elbows[i] = shaft + x * g.arm_length;
            levers.elbow[i] = z * -g.arm_length;
            levers.elbow_bias[i] = x * (-g.arm_length * nu[i] * nu[i]);
        }
        let velocity = Vector3::new(nu[4], nu[5], nu[6]);
        let omega = Vector3::new(nu[7], nu[8], nu[9]);
        let rotation = UnitQuaternion::new_unchecked(pose.orientation).to_rotation_matrix().into_inner();
        bodies[PLATFORM] =
            BodyMotion { rotation, position: pose.position, velocity, angular_velocity: omega, ..BodyMotion::REST };
        for s in 0..STRUTS {
            let i = s / 2;
            let v = Geometry::tangential(i);
            let upper = elbows[i] + v * g.pair_offset(s);
            let ball = rotation * platform_ball(g, s);
            let span = pose.position + ball - upper;
            let length = span.norm();
            let axis = span / length;
            let upper_velocity = levers.elbow[i] * nu[i];
            let stretch = velocity + omega.cross(&ball) - upper_velocity;
            let along = axis.dot(&stretch);
            let swing = axis.cross(&stretch) / length;
            // Facing frame: y as near to the pair direction v as possible.
            let share = axis.dot(&v);
            let lateral = (1.0 - share * share).sqrt();
            let y = (v - axis * share) / lateral;
            let z = axis.cross(&y);
            let facing_rate = -share / lateral * (stretch - axis * along).dot(&z) / length;
            let (sin, cos) = pose.roll[s].sin_cos();
            let roll = Matrix3::from_columns(&[axis, y * cos + z * sin, z * cos - y * sin]);
            bodies[STRUT + s].place(roll, upper, upper_velocity, swing + axis * spin[s]);
            (strut_axis[s], strut_length[s]) = (axis, length);
            (levers.ball[s], levers.stretch[s]) = (ball, stretch);
            (roll_rate[s], length_rate[s]) = (spin[s] - facing_rate, along);
        }
        let (sin, cos) = pose.psi.sin_cos();
        let turned = Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0);
        bodies[ROTOR].place(turned, g.upper_hooke(), Vector3::zeros(), Vector3::new(0.0, 0.0, nu[3]));
        *telescope = self.place_chain(bodies, &mut levers.chain, nu[3]);
        levers.bias = levers.chain.bias(motion, g);
    }

    /// Telescope and end effector between the rotor and the platform.
    fn place_chain(&self, bodies: &mut [BodyMotion; BODIES], chain: &mut Chain, rotor_rate: f64) -> Telescope {
        let g = &self.geometry;
        let platform = bodies[PLATFORM];
        let pivot = platform.rotation.column(2).into_owned();
        let omega = platform.angular_velocity;
        let hooke = pivot * g.lower_hooke_height;
        let lower = platform.position + hooke;
        let lower_velocity = platform.velocity + omega.cross(&hooke);
        let bar = g.upper_hooke() - lower;
        let length = bar.norm();
        let axis = bar / length;
        let yoke = bodies[ROTOR].rotation.column(0).into_owned();
        let rotation = telescope_rotation(&axis, &yoke);
        let cross = rotation.column(1).into_owned();
        // The Hooke joint passes rotation about the normal n of its cross: (ω_T − Ω z)·n = 0.
        let n = yoke.cross(&cross);
        let passed = 1.0 / axis.dot(&n);
        chain.hooke = hooke;
        chain.a = (axis * (n.cross(&axis) * passed).transpose() - axis.cross_matrix()) / length;
        chain.b = axis * (n.z * passed);
        let omega_t = chain.a * lower_velocity + chain.b * rotor_rate;
        // End effector: x normal to the telescope's cross axis and the pivot.
        let x = cross.cross(&pivot).normalize();
        let n = x.cross(&cross);
        let passed = 1.0 / pivot.dot(&n);
        chain.pivot = pivot;
        chain.c_v = chain.a.tr_mul(&n) * passed;
        chain.c_rotor = chain.b.dot(&n) * passed;
        chain.c_omega = -n * passed;
        let relative = (omega_t - omega).dot(&n) * passed;
        let flange = pivot * g.flange_height;
        bodies[END_EFFECTOR].place(
            Matrix3::from_columns(&[x, pivot.cross(&x), pivot]),
            platform.position + flange,
            platform.velocity + omega.cross(&flange),
            omega + pivot * relative,
        );
        bodies[TELESCOPE_UPPER].place(rotation, g.upper_hooke(), Vector3::zeros(), omega_t);
        bodies[TELESCOPE_LOWER].place(rotation, lower, lower_velocity, omega_t);
        Telescope { axis, length, rate: -axis.dot(&lower_velocity) }
    }

    /// Solves the equations of motion under wrenches on all bodies (about their origins, world axes) and drive torques.
    pub fn solve(
        &self,
        plant: &Plant,
        frame: &Frame,
        wrenches: &[Twist; BODIES],
        tau: &[f64; AXES],
        implicit: &Implicit,
    ) -> Result<Solution, SingularPose> {
        let Frame { motion, levers, .. } = frame;
        let gravity = plant.gravity_vector();
        // Mass of the platform's side, (v, ω) blocks, and of the rotor with its coupling.
        let platform = &motion.bodies[PLATFORM];
        let mut vv = Matrix3::from_diagonal_element(self.laden_platform.mass);
        let first = platform.rotation * self.laden_platform.first_moment;
        let mut vw = -first.cross_matrix();
        let tensor = platform.rotation * self.laden_platform.tensor * platform.rotation.transpose();
        let mut ww = tensor;
        let chain = &levers.chain;
        let (hvv, hvr, hrr) = chain.telescope_mass(plant, motion);
        let r = chain.hooke.cross_matrix();
        vv += hvv;
        let hr = hvv * r;
        vw -= hr;
        ww -= r * hr;
        let mut rotor = plant.bodies[ROTOR].tensor[(2, 2)] + hrr + implicit.drives[3];
        let mut rotor_v = hvr;
        let mut rotor_w = chain.hooke.cross(&hvr);
        if self.loaded {
            let ee = &motion.bodies[END_EFFECTOR];
            let inertia = &plant.bodies[END_EFFECTOR];
            let h = ee.rotation * inertia.first_moment;
            let theta = ee.rotation * inertia.tensor * ee.rotation.transpose();
            let r = chain.pivot * self.geometry.flange_height;
            let moment = r * inertia.mass + h;
            vv += Matrix3::from_diagonal_element(inertia.mass);
            vw -= moment.cross_matrix();
            let (rx, hx) = (r.cross_matrix(), h.cross_matrix());
            ww += theta - hx * rx - rx * hx - rx * rx * inertia.mass;
            // κ: momentum about the pivot per unit of (v, ω), and its own inertia.
            let (cv, cw, cr) = chain.relative();
            let gv = chain.pivot.cross(&h);
            let tz = theta * chain.pivot;
            let gw = tz + r.cross(&gv);
            let own = chain.pivot.dot(&tz);
            vv += cv * gv.transpose() + gv * cv.transpose() + cv * cv.transpose() * own;
            vw += cv * gw.transpose() + gv * cw.transpose() + cv * cw.transpose() * own;
            ww += cw * gw.transpose() + gw * cw.transpose() + cw * cw.transpose() * own;
            rotor += own * cr * cr;
            rotor_v += (gv + cv * own) * cr;
            rotor_w += (gw + cw * own) * cr;
        }
        let mut mass = Matrix6::zeros();
        mass.fixed_view_mut::<3, 3>(0, 0).copy_from(&vv);
        mass.fixed_view_mut::<3, 3>(0, 3).copy_from(&vw);
        mass.fixed_view_mut::<3, 3>(3, 0).copy_from(&vw.transpose());
        mass.fixed_view_mut::<3, 3>(3, 3).copy_from(&ww);

        // Forces: applied minus what the velocities and the weight demand.
        let mut force = wrenches[PLATFORM].0;
        let mut moment = wrenches[PLATFORM].1;
        let omega = platform.angular_velocity;
        force -= omega.cross(&omega.cross(&first));
        moment -= omega.cross(&(tensor * omega));
        let weight = &plant.bodies[PLATFORM];
        force += gravity * weight.mass;
        moment += (platform.rotation * weight.first_moment).cross(&gravity);
        let (chain_v, chain_w, chain_rotor) =
            chain.demand(plant, motion, &levers.bias, wrenches, &gravity, self.loaded);
        force += chain_v;
        moment += chain_w;
        let rotor_force = chain_rotor + wrenches[ROTOR].1.z + tau[3] + implicit.drive_torque[3];

        let mut drive = [0.0; ARMS];
        let mut drive_force = [0.0; ARMS];
        let mut coupling = [Vector6::zeros(); ARMS];
        for i in 0..ARMS {
            let (arm, v) = (&motion.bodies[ARM + i], Geometry::tangential(i));
            let inertia = &plant.bodies[ARM + i];
            drive[i] = inertia.tensor[(1, 1)] + implicit.drives[i];
            let h = arm.rotation * inertia.first_moment;
            drive_force[i] =
                wrenches[ARM + i].1.dot(&v) + h.cross(&gravity).dot(&v) + tau[i] + implicit.drive_torque[i];
        }
        let mut rows = [Vector6::zeros(); STRUTS];
        let mut row_drive = [0.0; STRUTS];
        let mut target = Vector6::zeros();
        let mut ends = [(Vector3::zeros(), Vector3::zeros()); STRUTS];
        for s in 0..STRUTS {
            let (i, rod) = (s / 2, &self.rods[s]);
            let (u, e, r) = (motion.strut_axis[s], levers.elbow[i], levers.ball[s]);
            let (fa, fb) = self.strut_forces(s, frame, &wrenches[STRUT + s], &gravity);
            ends[s] = (fa, fb);
            let (bias_a, bias_b) = (levers.elbow_bias[i], omega.cross(&omega.cross(&r)));
            drive[i] += rod.aa * e.norm_squared();
            drive_force[i] += e.dot(&(fa - bias_a * rod.aa - bias_b * rod.ab));
            let c = &mut coupling[i];
            add(c, &(e * rod.ab), &(r.cross(&e) * rod.ab));
            // The rods' m_bb is part of the laden platform.
            let fb = fb - bias_a * rod.ab;
            force += fb;
            moment += r.cross(&fb);
            rows[s] = join(&u, &r.cross(&u));
            row_drive[s] = -u.dot(&e);
            let stretch = &levers.stretch[s];
            let along = frame.length_rate[s];
            target[s] = -u.dot(&(bias_b - bias_a)) - (stretch.norm_squared() - along * along) / motion.strut_length[s];
        }
        let mut platform_force = join(&force, &moment);
        let rotor_coupling = join(&rotor_v, &rotor_w);
        let mut tension = Vector6::zeros();
        let nu_rate;
        if let Some(springs) = &self.springs {
            for s in 0..STRUTS {
                let i = s / 2;
                let stretch = motion.strut_length[s] - self.rods[s].length;
                let law = springs[s].stiffness * stretch + springs[s].damping * frame.length_rate[s];
                let k = implicit.tension[s];
                tension[s] = law + implicit.tension_force[s];
                drive[i] += k * row_drive[s] * row_drive[s];
                coupling[i] += rows[s] * (k * row_drive[s]);
                mass += rows[s] * rows[s].transpose() * k;
                drive_force[i] -= row_drive[s] * tension[s];
                platform_force -= rows[s] * tension[s];
            }
            let mut f = platform_force - rotor_coupling * (rotor_force / rotor);
            mass -= rotor_coupling * rotor_coupling.transpose() / rotor;
            for i in 0..ARMS {
                mass -= coupling[i] * coupling[i].transpose() / drive[i];
                f -= coupling[i] * (drive_force[i] / drive[i]);
            }
            let x = mass.cholesky().ok_or(SingularPose)?.solve(&f);
            let arms: [f64; ARMS] = std::array::from_fn(|i| (drive_force[i] - coupling[i].dot(&x)) / drive[i]);
            let psi = (rotor_force - rotor_coupling.dot(&x)) / rotor;
            nu_rate =
                OpenVector::from_column_slice(&[arms[0], arms[1], arms[2], psi, x[0], x[1], x[2], x[3], x[4], x[5]]);
            for s in 0..STRUTS {
                tension[s] += implicit.tension[s] * (rows[s].dot(&x) + row_drive[s] * arms[s / 2]);
            }
        } else {
            let pairs = Pairs::new(&rows)?;
            // Platform = offset + Σ arms · φ̈: the null space of the length rows.
            let offset = pairs.solve(&target);
            let mut follow = [Vector6::zeros(); ARMS];
            for i in 0..ARMS {
                let mut column = Vector6::zeros();
                (column[2 * i], column[2 * i + 1]) = (-row_drive[2 * i], -row_drive[2 * i + 1]);
                follow[i] = pairs.solve(&column);
            }
            let free = platform_force - mass * offset;
            let carried: [Vector6; ARMS] = std::array::from_fn(|i| mass * follow[i] + coupling[i]);
            let mut reduced = Matrix4::zeros();
            let mut f = Vector4::zeros();
            for i in 0..ARMS {
                for j in 0..=i {
                    let x = follow[i].dot(&carried[j]) + coupling[i].dot(&follow[j]);
                    reduced[(i, j)] = x;
                    reduced[(j, i)] = x;
                }
                reduced[(i, i)] += drive[i];
                let x = rotor_coupling.dot(&follow[i]);
                reduced[(i, 3)] = x;
                reduced[(3, i)] = x;
                f[i] = drive_force[i] - coupling[i].dot(&offset) + follow[i].dot(&free);
            }
            reduced[(3, 3)] = rotor;
            f[3] = rotor_force - rotor_coupling.dot(&offset);
            let x = reduced.cholesky().ok_or(SingularPose)?.solve(&f);
            let twist = offset + follow[0] * x[0] + follow[1] * x[1] + follow[2] * x[2];
            let left = free - carried[0] * x[0] - carried[1] * x[1] - carried[2] * x[2] - rotor_coupling * x[3];
            tension = pairs.solve_transposed(&left);
            nu_rate = OpenVector::from_column_slice(&[
                x[0], x[1], x[2], x[3], twist[0], twist[1], twist[2], twist[3], twist[4], twist[5],
            ]);
        }
        let (linear, angular) = platform_twist(&nu_rate);
        let mut solution = Solution {
            nu_rate,
            spin_rate: [0.0; STRUTS],
            reactions: Reactions::default(),
            socket_force: [Vector3::zeros(); SOCKETS],
        };
        for s in 0..STRUTS {
            let (i, rod) = (s / 2, &self.rods[s]);
            let (u, r) = (motion.strut_axis[s], levers.ball[s]);
            let a = levers.elbow[i] * nu_rate[i] + levers.elbow_bias[i];
            let b = linear + angular.cross(&r) + omega.cross(&omega.cross(&r));
            let upper = a * rod.aa + b * rod.ab - ends[s].0 - u * tension[s];
            let lower = a * rod.ab + b * rod.bb - ends[s].1 + u * tension[s];
            solution.socket_force[s] = upper;
            solution.socket_force[STRUTS + s] = lower;
            solution.reactions.upper[s] = -u.dot(&upper);
            solution.reactions.lower[s] = u.dot(&lower);
            let inertia = rod.axial + implicit.spins[s];
            solution.spin_rate[s] = (wrenches[STRUT + s].1.dot(&u) + implicit.spin_moment[s]) / inertia;
        }
        if !solution.nu_rate.iter().all(|x| x.is_finite()) {
            return Err(SingularPose);
        }
        Ok(solution)
    }

    /// Applied forces on a strut as forces at its upper and lower ball.
    fn strut_forces(
        &self,
        s: usize,
        frame: &Frame,
        wrench: &Twist,
        gravity: &Vector3<f64>,
    ) -> (Vector3<f64>, Vector3<f64>) {
        let rod = &self.rods[s];
        let u = frame.motion.strut_axis[s];
        let length = frame.motion.strut_length[s];
        let spin = frame.motion.bodies[STRUT + s].angular_velocity.dot(&u);
        // The spin's angular momentum turns with the axis: moment Θ_xx·σ·u̇ is taken from the applied moment.
        let axis_rate = (frame.levers.stretch[s] - u * frame.length_rate[s]) / length;
        let moment = wrench.1 - axis_rate * (rod.axial * spin);
        let couple = moment.cross(&u) / length;
        (wrench.0 - couple + gravity * rod.weight[0], couple + gravity * rod.weight[1])
    }

    /// Accelerations of all bodies for a solution, world axes.
    pub fn accelerations(&self, frame: &Frame, solution: &Solution) -> [Twist; BODIES] {
        let Frame { motion, levers, .. } = frame;
        let mut out = [STILL; BODIES];
        let nu = &solution.nu_rate;
        for i in 0..ARMS {
            out[ARM + i].1 = Geometry::tangential(i) * nu[i];
        }
        out[ROTOR].1.z = nu[3];
        let (linear, angular) = platform_twist(nu);
        out[PLATFORM] = (linear, angular);
        let omega = motion.bodies[PLATFORM].angular_velocity;
        for s in 0..STRUTS {
            let i = s / 2;
            let (u, length) = (motion.strut_axis[s], motion.strut_length[s]);
            let a = levers.elbow[i] * nu[i] + levers.elbow_bias[i];
            let b = linear + angular.cross(&levers.ball[s]) + omega.cross(&omega.cross(&levers.ball[s]));
            let along = frame.length_rate[s];
            let axis_rate = (levers.stretch[s] - u * along) / length;
            let spin = motion.bodies[STRUT + s].angular_velocity.dot(&u);
            // ω = u × Δv / ℓ + σ u; the change of ℓ only matters for elastic struts.
            let swing = (u.cross(&(b - a)) + axis_rate.cross(&levers.stretch[s])
                - u.cross(&levers.stretch[s]) * (along / length))
                / length;
            out[STRUT + s] = (a, swing + u * solution.spin_rate[s] + axis_rate * spin);
        }
        let chain = &levers.chain;
        let bias = &levers.bias;
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

    /// Restores the struts' lengths by moving the platform, and their rates likewise. Drives and spins stay.
    pub fn close(&self, pose: &mut Pose, nu: &mut OpenVector) -> Result<(), SingularPose> {
        if self.springs.is_some() {
            pose.orientation /= pose.orientation.norm();
            return Ok(());
        }
        let g = &self.geometry;
        let mut orientation = UnitQuaternion::new_normalize(pose.orientation);
        let mut rows = [Vector6::zeros(); STRUTS];
        let mut elbows = [Vector3::zeros(); ARMS];
        let mut levers = [Vector3::zeros(); ARMS];
        for i in 0..ARMS {
            let (s, c) = pose.phi[i].sin_cos();
            let u = Geometry::radial(i);
            elbows[i] = u * (g.base_radius + g.arm_length * c) - Vector3::z() * (g.arm_length * s);
            levers[i] = Vector3::new(s * u.x, s * u.y, c) * -g.arm_length;
        }
        let mut closed = false;
        for _ in 0..MAX_CLOSURE_ITERATIONS {
            let rotation = orientation.to_rotation_matrix().into_inner();
            let mut gaps = Vector6::zeros();
            for s in 0..STRUTS {
                let ball = rotation * platform_ball(g, s);
                let span = pose.position + ball - elbows[s / 2] - Geometry::tangential(s / 2) * g.pair_offset(s);
                let length = span.norm();
                let u = span / length;
                gaps[s] = length - self.rods[s].length;
                rows[s] = join(&u, &ball.cross(&u));
            }
            closed = gaps.amax() < CLOSURE_TOLERANCE;
            if closed {
                break;
            }
            let correction = Pairs::new(&rows)?.solve(&-gaps);
            pose.position += correction.fixed_rows::<3>(0);
            orientation = UnitQuaternion::from_scaled_axis(correction.fixed_rows::<3>(3).into_owned()) * orientation;
        }
        if !closed {
            return Err(SingularPose);
        }
        pose.orientation = *orientation;
        let rates = Vector6::from_fn(|s, _| {
            let u = rows[s].fixed_rows::<3>(0);
            u.dot(&levers[s / 2]) * nu[s / 2]
        });
        let twist = Pairs::new(&rows)?.solve(&rates);
        nu.fixed_rows_mut::<6>(PLATFORM_V).copy_from(&twist);
        Ok(())
    }

    /// The pose of a motion, which must close its loops to within a few millimetres.
    pub fn pose(&self, motion: &Motion) -> (Pose, OpenVector, [f64; STRUTS]) {
        let platform = &motion.bodies[PLATFORM];
        let orientation =
            *UnitQuaternion::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(platform.rotation));
        let mut roll = [0.0; STRUTS];
        let mut spin = [0.0; STRUTS];
        for s in 0..STRUTS {
            let (u, v) = (motion.strut_axis[s], Geometry::tangential(s / 2));
            let y = (v - u * u.dot(&v)).normalize();
            let strut = &motion.bodies[STRUT + s];
            let own = strut.rotation.column(1);
            roll[s] = own.dot(&u.cross(&y)).atan2(own.dot(&y));
            spin[s] = strut.angular_velocity.dot(&u);
        }
        let q = motion.q;
        let (v, w) = (platform.velocity, platform.angular_velocity);
        let d = motion.qd;
        (
            Pose { phi: [q[0], q[1], q[2]], psi: q[3], position: platform.position, orientation, roll },
            OpenVector::from_column_slice(&[d[0], d[1], d[2], d[3], v.x, v.y, v.z, w.x, w.y, w.z]),
            spin,
        )
    }
}

/// Change of strut length at which the loops count as closed, m.
const CLOSURE_TOLERANCE: f64 = 1e-14;
const MAX_CLOSURE_ITERATIONS: usize = 12;

fn join(a: &Vector3<f64>, b: &Vector3<f64>) -> Vector6 {
    Vector6::new(a.x, a.y, a.z, b.x, b.y, b.z)
}

fn add(x: &mut Vector6, a: &Vector3<f64>, b: &Vector3<f64>) {
    *x += join(a, b);
}

fn platform_twist(nu: &OpenVector) -> Twist {
    (Vector3::new(nu[4], nu[5], nu[6]), Vector3::new(nu[7], nu[8], nu[9]))
}

/// The length rows' platform part B_P, factored by sums and differences of each pair's rows.
///
/// The struts of a pair are all but parallel, so the sums (S_v S_w) see the platform's velocity, the differences (D_v D_w)
/// its rotation alone, and two 3 × 3 inverses do.
struct Pairs {
    s_v_inverse: Matrix3<f64>,
    s_w: Matrix3<f64>,
    d_v: Matrix3<f64>,
    /// (D_w − D_v S_v⁻¹ S_w)⁻¹
    schur_inverse: Matrix3<f64>,
}

impl Pairs {
    fn new(rows: &[Vector6; STRUTS]) -> Result<Self, SingularPose> {
        let block =
            |sign: f64, at: usize| Matrix3::from_fn(|i, k| rows[2 * i][at + k] + sign * rows[2 * i + 1][at + k]);
        let (s_w, d_v, d_w) = (block(1.0, 3), block(-1.0, 0), block(-1.0, 3));
        let s_v_inverse = block(1.0, 0).try_inverse().ok_or(SingularPose)?;
        let schur_inverse = (d_w - d_v * s_v_inverse * s_w).try_inverse().ok_or(SingularPose)?;
        Ok(Self { s_v_inverse, s_w, d_v, schur_inverse })
    }

    /// x with B_P x = g.
    fn solve(&self, g: &Vector6) -> Vector6 {
        let sum = Vector3::from_fn(|i, _| g[2 * i] + g[2 * i + 1]);
        let difference = Vector3::from_fn(|i, _| g[2 * i] - g[2 * i + 1]);
        let free = self.s_v_inverse * sum;
        let w = self.schur_inverse * (difference - self.d_v * free);
        let v = free - self.s_v_inverse * (self.s_w * w);
        join(&v, &w)
    }

    /// T with B_Pᵀ T = f.
    fn solve_transposed(&self, f: &Vector6) -> Vector6 {
        let (f_v, f_w) = (f.fixed_rows::<3>(0).into_owned(), f.fixed_rows::<3>(3).into_owned());
        let free = self.s_v_inverse.tr_mul(&f_v);
        let difference = self.schur_inverse.tr_mul(&(f_w - self.s_w.tr_mul(&free)));
        let sum = free - self.s_v_inverse.tr_mul(&self.d_v.tr_mul(&difference));
        Vector6::from_fn(
            |s, _| if s % 2 == 0 { sum[s / 2] + difference[s / 2] } else { sum[s / 2] - difference[s / 2] },
        )
    }
}

/// Accelerations at zero ν̇ of the telescope's end and of end effector and telescope.
struct ChainBias {
    hooke: Vector3<f64>,
    telescope: Vector3<f64>,
    end_effector: Twist,
}

impl Frame {
    /// Room for a frame.
    pub fn empty() -> Self {
        let none = Vector3::zeros();
        Self {
            motion: Motion {
                q: [0.0; AXES],
                qd: [0.0; AXES],
                qdd: [0.0; AXES],
                bodies: [BodyMotion::REST; BODIES],
                strut_axis: [none; STRUTS],
                strut_length: [0.0; STRUTS],
                telescope: Telescope { axis: none, length: 0.0, rate: 0.0 },
            },
            roll_rate: [0.0; STRUTS],
            length_rate: [0.0; STRUTS],
            levers: Levers {
                elbow: [none; ARMS],
                elbow_bias: [none; ARMS],
                ball: [none; STRUTS],
                stretch: [none; STRUTS],
                chain: Chain::zero(),
                bias: ChainBias { hooke: none, telescope: none, end_effector: STILL },
            },
        }
    }
}

impl Chain {
    fn zero() -> Self {
        let z = Vector3::zeros();
        Self { hooke: z, a: Matrix3::zeros(), b: z, pivot: z, c_v: z, c_rotor: 0.0, c_omega: z }
    }

    /// κ per unit of the platform's v and ω and of the rotor rate.
    fn relative(&self) -> (Vector3<f64>, Vector3<f64>, f64) {
        // v_h = v + ω × r_h
        (self.c_v, self.c_omega + self.hooke.cross(&self.c_v), self.c_rotor)
    }

    /// Mass of both telescope parts in (v_h, Ω): ½ m v_h² + ω_T·(h × v_h) + ½ ω_T·Θ ω_T.
    fn telescope_mass(&self, plant: &Plant, motion: &Motion) -> (Matrix3<f64>, Vector3<f64>, f64) {
        let (upper, lower) = (&plant.bodies[TELESCOPE_UPPER], &plant.bodies[TELESCOPE_LOWER]);
        let rotation = &motion.bodies[TELESCOPE_UPPER].rotation;
        let theta = rotation * (upper.tensor + lower.tensor) * rotation.transpose();
        let h = rotation * lower.first_moment;
        let turned = theta * self.a;
        let cross = self.a.tr_mul(&h.cross_matrix());
        let vv = Matrix3::from_diagonal_element(lower.mass) + self.a.tr_mul(&turned) + cross + cross.transpose();
        (vv, self.b.cross(&h) + turned.tr_mul(&self.b), self.b.dot(&(theta * self.b)))
    }

    fn bias(&self, motion: &Motion, geometry: &Geometry) -> ChainBias {
        let platform = &motion.bodies[PLATFORM];
        let omega = platform.angular_velocity;
        let hooke = omega.cross(&omega.cross(&self.hooke));
        let telescope = &motion.telescope;
        let omega_t = motion.bodies[TELESCOPE_UPPER].angular_velocity;
        let w = telescope.axis;
        let w_rate = omega_t.cross(&w);
        let spin = omega_t.dot(&w);
        let swing = -w.cross(&(hooke + w_rate * (2.0 * telescope.rate))) / telescope.length;
        // (α_T − α_R)·n + (ω_T − ω_R)·ṅ = 0
        let bar = motion.bodies[TELESCOPE_UPPER].rotation.column(1).into_owned();
        let bar_rate = omega_t.cross(&bar);
        let rotor = &motion.bodies[ROTOR];
        let yoke = rotor.rotation.column(0).into_owned();
        let n = yoke.cross(&bar);
        let n_rate = rotor.angular_velocity.cross(&yoke).cross(&bar) + yoke.cross(&bar_rate);
        let open = swing + w_rate * spin;
        let spin_rate = (-open.dot(&n) - (omega_t - rotor.angular_velocity).dot(&n_rate)) / w.dot(&n);
        let alpha = open + w * spin_rate;
        // α_E = κ̇ z_P + κ ω_P × z_P with (α_E − α_T)·n₂ + (ω_E − ω_T)·ṅ₂ = 0
        let ee = &motion.bodies[END_EFFECTOR];
        let kappa = (ee.angular_velocity - omega).dot(&self.pivot);
        let precession = omega.cross(&self.pivot) * kappa;
        let yoke = ee.rotation.column(0).into_owned();
        let n = yoke.cross(&bar);
        let n_rate = ee.angular_velocity.cross(&yoke).cross(&bar) + yoke.cross(&bar_rate);
        let kappa_rate =
            ((alpha - precession).dot(&n) - (ee.angular_velocity - omega_t).dot(&n_rate)) / self.pivot.dot(&n);
        let flange = self.pivot * geometry.flange_height;
        ChainBias {
            hooke,
            telescope: alpha,
            end_effector: (omega.cross(&omega.cross(&flange)), precession + self.pivot * kappa_rate),
        }
    }

    /// Applied minus demanded forces at zero ν̇ on the platform (v and ω) and the rotor.
    fn demand(
        &self,
        plant: &Plant,
        motion: &Motion,
        bias: &ChainBias,
        wrenches: &[Twist; BODIES],
        gravity: &Vector3<f64>,
        loaded: bool,
    ) -> (Vector3<f64>, Vector3<f64>, f64) {
        let net = |body: usize, acceleration: Twist| -> Twist {
            let mut m = motion.bodies[body];
            (m.acceleration, m.angular_acceleration) = acceleration;
            let (force, moment) = inertial_wrench(&plant.bodies[body], &m, gravity);
            (wrenches[body].0 - force, wrenches[body].1 - moment)
        };
        let upper = net(TELESCOPE_UPPER, (Vector3::zeros(), bias.telescope));
        let lower = net(TELESCOPE_LOWER, (bias.hooke, bias.telescope));
        let turning = upper.1 + lower.1;
        let hooke = lower.0 + self.a.tr_mul(&turning);
        let mut force = hooke;
        let mut moment = self.hooke.cross(&hooke);
        let mut rotor = self.b.dot(&turning);
        // Wrenches of effects and contacts act on a massless end effector too.
        if loaded || wrenches[END_EFFECTOR] != STILL {
            let (f, n) = net(END_EFFECTOR, bias.end_effector);
            let flange = motion.bodies[END_EFFECTOR].position - motion.bodies[PLATFORM].position;
            let about = self.pivot.dot(&n);
            let (cv, cw, cr) = self.relative();
            force += f + cv * about;
            moment += flange.cross(&f) + n + cw * about;
            rotor += cr * about;
        }
        (force, moment, rotor)
    }
}

impl Frame {
    /// Rate of strut `s`'s length for open velocities `x`.
    pub fn along(&self, s: usize, x: &OpenVector) -> f64 {
        let u = self.motion.strut_axis[s];
        let (v, omega) = platform_twist(x);
        u.dot(&(v + omega.cross(&self.levers.ball[s]) - self.levers.elbow[s / 2] * x[s / 2]))
    }
}

impl Mechanism {
    /// What stretched struts have beyond the energy of rigid ones, J: they move linearly between their ends.
    pub fn stretch_energy(&self, plant: &Plant, motion: &Motion) -> f64 {
        if self.springs.is_none() {
            return 0.0;
        }
        rod::stretch_energy(&self.rods, plant, motion, &rod::length_rates(plant, motion))
    }

    /// Power of the elastic struts on the bodies, W.
    pub fn spring_power(&self, frame: &Frame) -> f64 {
        let Some(springs) = &self.springs else { return 0.0 };
        (0..STRUTS)
            .map(|s| {
                let stretch = frame.motion.strut_length[s] - self.rods[s].length;
                let tension = springs[s].stiffness * stretch + springs[s].damping * frame.length_rate[s];
                -tension * frame.length_rate[s]
            })
            .sum()
    }
}
