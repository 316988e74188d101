//! Equations of motion of the open mechanism, and their solution with rigid and with elastic struts.

use nalgebra::{Matrix3, Matrix4, Vector3, Vector4, Vector6};

use super::super::SingularPose;
use super::super::wrench::Twist;
use super::blocks::{Paired, Symmetric, cross_columns, outer, symmetric_outer, turned};
use super::pairs::Pairs;
use super::{Frame, Mechanism, OpenVector};
use crate::dynamics::Plant;
use crate::effects::StrutSpring;
use crate::machine::bodies::{self, END_EFFECTOR, PLATFORM, ROTOR, SLOTS};
use crate::machine::{Joint, PerAxis, PerStrut, SixStruts, ThreeArms, each, six_struts, three_arms};

/// Implicit terms of a Rosenbrock step, added to the equations.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::twin) struct Implicit {
    /// h·γ·damping of arms and rotor, kg·m².
    pub drives: PerAxis<f64>,
    /// Torques on arms and rotor, N·m.
    pub drive_torque: PerAxis<f64>,
    /// h·γ·damping + h²γ²·stiffness of the spins, kg·m².
    pub spins: SixStruts<f64>,
    /// Moments about the struts' axes, N·m.
    pub spin_moment: SixStruts<f64>,
    /// h·γ·damping + h²γ²·stiffness of elastic struts, kg.
    pub tension: SixStruts<f64>,
    /// Tensions, N.
    pub tension_force: SixStruts<f64>,
}

/// Loads at one configuration and velocity.
pub(in crate::twin) struct Loads<'a> {
    pub plant: &'a Plant,
    pub frame: &'a Frame,
    /// Wrenches on all bodies about their origins, inertial axes.
    pub wrenches: &'a [Twist; SLOTS],
    /// Drive torques, N·m.
    pub tau: &'a PerAxis<f64>,
    pub implicit: &'a Implicit,
    pub gravity: Vector3<f64>,
}

/// Applied forces on a strut, reduced to its balls, N, inertial axes.
#[derive(Clone, Copy, Default)]
pub(super) struct Ends {
    pub upper: Vector3<f64>,
    pub lower: Vector3<f64>,
}

/// Blocks of M̂ ν̇ + Bᵀ T = f̂ and B ν̇ = c; each drive is coupled with the platform only.
pub(super) struct Equations {
    mass: PlatformMass,
    platform_force: Paired,
    rotor_force: f64,
    /// Inertia of the arm drives, kg·m².
    drive: ThreeArms<f64>,
    drive_coupling: ThreeArms<Paired>,
    drive_force: ThreeArms<f64>,
    /// Rows of B for the platform twist; the entry of the strut's arm follows.
    rows: SixStruts<Paired>,
    row_drive: SixStruts<f64>,
    /// c: negative rates of change of the struts' length rates at ν̇ = 0.
    target: SixStruts<f64>,
    pub ends: SixStruts<Ends>,
}

/// Mass matrix of the platform side: the platform twist, the rotor and its coupling with it.
struct PlatformMass {
    twist: Symmetric,
    rotor: f64,
    rotor_coupling: Paired,
}

impl PlatformMass {
    /// Contribution of the platform with the rods' masses at its balls, the telescope and the rotor; `first` and
    /// `tensor` are those of the laden platform in inertial axes.
    fn new(mechanism: &Mechanism, loads: &Loads, first: &Vector3<f64>, tensor: &Matrix3<f64>) -> Self {
        let chain = &loads.frame.jacobians.chain;
        let (hvv, hvr, hrr) = chain.telescope_mass(loads.plant, &mechanism.telescope, &loads.frame.motion);
        let r = &chain.hooke;
        // hvv is symmetric: (hvv r×)ᵀ = −r× hvv.
        let hr = cross_columns(r, &hvv).transpose();
        let mut vv = hvv;
        for k in 0..3 {
            vv[(k, k)] += mechanism.laden_platform.mass;
        }
        let twist = Symmetric { vv, vw: hr - first.cross_matrix(), ww: tensor + cross_columns(r, &hr) };
        let rotor = loads.plant.bodies[ROTOR].tensor[(2, 2)] + hrr + loads.implicit.drives[3];
        Self { twist, rotor, rotor_coupling: Paired::new(hvr, r.cross(&hvr)) }
    }

    /// Adds the end effector, which rotates by κ about the platform's normal.
    fn add_end_effector(&mut self, loads: &Loads, flange_height: f64) {
        let chain = &loads.frame.jacobians.chain;
        let ee = &loads.frame.motion.bodies[END_EFFECTOR];
        let inertia = &loads.plant.bodies[END_EFFECTOR];
        let h = ee.rotation * inertia.first_moment;
        let theta = turned(&inertia.tensor, &ee.rotation);
        let r = chain.pivot * flange_height;
        // −h× r× − r× h× − m r× r× = 2 (r·s) − r sᵀ − s rᵀ with s = h + ½ m r.
        let s = h + r * (0.5 * inertia.mass);
        let twice = 2.0 * r.dot(&s);
        // κ: momentum about the pivot per unit of (v, ω), and its own inertia.
        let (cv, cw, cr) = chain.relative();
        let gv = chain.pivot.cross(&h);
        let tz = theta * chain.pivot;
        let gw = tz + r.cross(&gv);
        let own = chain.pivot.dot(&tz);
        let (half_v, half_w) = (gv + cv * (0.5 * own), gw + cw * (0.5 * own));
        let Symmetric { vv, vw, ww } = &mut self.twist;
        *vv += symmetric_outer(&cv, &half_v);
        *vw += outer(&cv, &(gw + cw * own)) + outer(&gv, &cw) - (r * inertia.mass + h).cross_matrix();
        *ww += theta + symmetric_outer(&cw, &half_w) - symmetric_outer(&r, &s);
        for k in 0..3 {
            vv[(k, k)] += inertia.mass;
            ww[(k, k)] += twice;
        }
        self.rotor += own * cr * cr;
        self.rotor_coupling += Paired::new(gv + cv * own, gw + cw * own) * cr;
    }
}

impl Equations {
    /// Equations of the platform with telescope, rotor and end effector: mass, and applied minus bias forces.
    pub fn of_platform(mechanism: &Mechanism, loads: &Loads) -> Self {
        let Loads { plant, frame, wrenches, gravity, .. } = loads;
        let (motion, jacobians) = (&frame.motion, &frame.jacobians);
        let platform = &motion.bodies[PLATFORM];
        let laden = &mechanism.laden_platform;
        let first = platform.rotation * laden.first_moment;
        let tensor = turned(&laden.tensor, &platform.rotation);
        let mut mass = PlatformMass::new(mechanism, loads, &first, &tensor);
        if mechanism.loaded {
            mass.add_end_effector(loads, mechanism.geometry.flange_height);
        }
        let (mut force, mut moment) = wrenches[PLATFORM];
        let omega = platform.angular_velocity;
        force -= omega.cross(&omega.cross(&first));
        moment -= omega.cross(&(tensor * omega));
        let weight = &plant.bodies[PLATFORM];
        force += gravity * weight.mass;
        moment += (platform.rotation * weight.first_moment).cross(gravity);
        let chain = jacobians.chain.bias_force(loads, &jacobians.bias, mechanism.loaded);
        let rotor_force = chain.rotor + wrenches[ROTOR].1.z + loads.tau[3] + loads.implicit.drive_torque[3];
        Self {
            mass,
            platform_force: Paired::new(force + chain.force, moment + chain.moment),
            rotor_force,
            drive: each(0.0),
            drive_coupling: each(Paired::ZERO),
            drive_force: each(0.0),
            rows: each(Paired::ZERO),
            row_drive: each(0.0),
            target: each(0.0),
            ends: each(Ends::default()),
        }
    }

    /// Adds inertia, weight and torques of the arms.
    pub fn add_arms(&mut self, loads: &Loads) {
        let Loads { plant, frame, wrenches, tau, implicit, gravity } = loads;
        for i in three_arms() {
            let (body, screw) = frame.motion.drive(i);
            let (rotation, inertia) = (&frame.motion.bodies[body].rotation, &plant.bodies[body]);
            let own = match frame.motion.arms {
                Joint::Revolute => inertia.tensor[(1, 1)],
                Joint::Prismatic => inertia.mass,
            };
            self.drive[i] = own + implicit.drives[i];
            let weight = (gravity * inertia.mass, (rotation * inertia.first_moment).cross(gravity));
            self.drive_force[i] =
                screw.effort(&wrenches[body]) + screw.effort(&weight) + tau[i] + implicit.drive_torque[i];
        }
    }

    /// Adds masses and end forces of the struts, and their length rows.
    pub fn add_struts(&mut self, mechanism: &Mechanism, loads: &Loads) {
        let Frame { motion, jacobians, length_rate, inverse_length, .. } = loads.frame;
        for s in six_struts() {
            let (i, rod) = (s / 2, &mechanism.rods[s]);
            let (u, e, r) = (&motion.strut_axis[s], &jacobians.elbow[i], &jacobians.ball[s]);
            let ends = mechanism.strut_forces(s, loads);
            let (bias_a, bias_b) = (&jacobians.elbow_bias[i], &jacobians.ball_bias[s]);
            self.drive[i] += rod.aa * e.norm_squared();
            self.drive_force[i] += e.dot(&(ends.upper - bias_a * rod.aa - bias_b * rod.ab));
            self.drive_coupling[i] += Paired::new(*e, r.cross(e)) * rod.ab;
            // m_bb of the rods is contained in the laden platform.
            let lower = ends.lower - bias_a * rod.ab;
            self.platform_force += Paired::new(lower, r.cross(&lower));
            self.ends[s] = ends;
            self.rows[s] = Paired::new(*u, r.cross(u));
            self.row_drive[s] = -u.dot(e);
            let stretch = &jacobians.stretch[s];
            let along = length_rate[s];
            self.target[s] = -u.dot(&(bias_b - bias_a)) - (stretch.norm_squared() - along * along) * inverse_length[s];
        }
    }

    /// ν̇ and tensions with elastic struts, whose tensions follow from a force law; the drives are eliminated.
    pub fn solve_elastic(
        &self,
        mechanism: &Mechanism,
        springs: &PerStrut<StrutSpring>,
        loads: &Loads,
    ) -> Result<(OpenVector, SixStruts<f64>), SingularPose> {
        let Loads { frame, implicit, .. } = loads;
        let (mut mass, mut platform_force) = (self.mass.twist.to_matrix(), self.platform_force.to_vector());
        let (mut drive, mut drive_force) = (self.drive, self.drive_force);
        let mut coupling = self.drive_coupling.map(Paired::to_vector);
        let mut tension: SixStruts<f64> = each(0.0);
        for s in six_struts() {
            let (i, row, row_drive) = (s / 2, self.rows[s].to_vector(), self.row_drive[s]);
            let stretch = frame.motion.strut_length[s] - mechanism.rods[s].length;
            let law = springs[s].stiffness * stretch + springs[s].damping * frame.length_rate[s];
            let k = implicit.tension[s];
            tension[s] = law + implicit.tension_force[s];
            drive[i] += k * row_drive * row_drive;
            coupling[i] += row * (k * row_drive);
            mass += row * row.transpose() * k;
            drive_force[i] -= row_drive * tension[s];
            platform_force -= row * tension[s];
        }
        let (rotor, rotor_coupling) = (self.mass.rotor, self.mass.rotor_coupling.to_vector());
        let mut f = platform_force - rotor_coupling * (self.rotor_force / rotor);
        mass -= rotor_coupling * rotor_coupling.transpose() / rotor;
        for i in three_arms() {
            mass -= coupling[i] * coupling[i].transpose() / drive[i];
            f -= coupling[i] * (drive_force[i] / drive[i]);
        }
        let x: Vector6<f64> = mass.cholesky().ok_or(SingularPose)?.solve(&f);
        let arms: ThreeArms<f64> = std::array::from_fn(|i| (drive_force[i] - coupling[i].dot(&x)) / drive[i]);
        let rotor = (self.rotor_force - rotor_coupling.dot(&x)) / rotor;
        let twist = Paired::new(x.fixed_rows::<3>(0).into_owned(), x.fixed_rows::<3>(3).into_owned());
        for s in six_struts() {
            tension[s] += implicit.tension[s] * (self.rows[s].dot(&twist) + self.row_drive[s] * arms[s / 2]);
        }
        Ok((open_vector(&arms, rotor, &twist), tension))
    }

    /// ν̇ and tensions with rigid struts; the platform follows the arms, in the null space of B.
    pub fn solve_rigid(&self) -> Result<(OpenVector, SixStruts<f64>), SingularPose> {
        let (mass, coupling) = (&self.mass.twist, &self.drive_coupling);
        let pairs = Pairs::new(&self.rows)?;
        // Platform = offset + Σ follow · φ̈.
        let offset = pairs.solve(&self.target);
        let follows = |i: usize| pairs.solve_pair(i, [-self.row_drive[2 * i], -self.row_drive[2 * i + 1]]);
        let follow = [follows(0), follows(1), follows(2)];
        let free = self.platform_force - mass.times(&offset);
        let carries = |i: usize| mass.times(&follow[i]) + coupling[i];
        let carried = [carries(0), carries(1), carries(2)];
        let rotor_coupling = &self.mass.rotor_coupling;
        let mut reduced = Matrix4::zeros();
        let mut f = Vector4::zeros();
        // Lower triangle, which is all that the factorisation reads.
        for i in three_arms() {
            for j in 0..=i {
                reduced[(i, j)] = follow[i].dot(&carried[j]) + coupling[i].dot(&follow[j]);
            }
            reduced[(i, i)] += self.drive[i];
            reduced[(3, i)] = rotor_coupling.dot(&follow[i]);
            f[i] = self.drive_force[i] - coupling[i].dot(&offset) + follow[i].dot(&free);
        }
        reduced[(3, 3)] = self.mass.rotor;
        f[3] = self.rotor_force - rotor_coupling.dot(&offset);
        let x = reduced.cholesky().ok_or(SingularPose)?.solve(&f);
        let twist = offset + follow[0] * x[0] + follow[1] * x[1] + follow[2] * x[2];
        let left = free - carried[0] * x[0] - carried[1] * x[1] - carried[2] * x[2] - *rotor_coupling * x[3];
        Ok((open_vector(&[x[0], x[1], x[2]], x[3], &twist), pairs.solve_transposed(&left)))
    }
}

fn open_vector(arms: &ThreeArms<f64>, rotor: f64, twist: &Paired) -> OpenVector {
    let ([a, b, c], Paired { v, w }) = (*arms, twist);
    OpenVector::from_column_slice(&[a, b, c, rotor, v.x, v.y, v.z, w.x, w.y, w.z])
}

impl Mechanism {
    /// Applied forces on a strut, reduced to its upper and lower ball.
    #[inline]
    fn strut_forces(&self, s: usize, loads: &Loads) -> Ends {
        let (rod, frame, wrench) = (&self.rods[s], loads.frame, &loads.wrenches[bodies::strut(s)]);
        let u = frame.motion.strut_axis[s];
        let inverse = frame.inverse_length[s];
        let spin = frame.motion.bodies[bodies::strut(s)].angular_velocity.dot(&u);
        // Rotation of the axis changes the spin's angular momentum: the moment Θ_xx·σ·u̇ is subtracted.
        let axis_rate = (frame.jacobians.stretch[s] - u * frame.length_rate[s]) * inverse;
        let moment = wrench.1 - axis_rate * (rod.axial * spin);
        let couple = moment.cross(&u) * inverse;
        Ends { upper: wrench.0 - couple + loads.gravity * rod.weight[0], lower: couple + loads.gravity * rod.weight[1] }
    }
}
