//! Chain of telescope and end effector between rotor and platform.

use nalgebra::{Matrix3, Vector3};

use super::super::wrench::{STILL, Twist};
use super::Mechanism;
use super::blocks::cross_columns;
use super::equations::Loads;
use crate::dynamics::{Plant, accelerated_wrench};
use crate::kinematics::{BodyMotion, HookeJoint, Motion, Telescope};
use crate::machine::Geometry;
use crate::machine::bodies::{END_EFFECTOR, PLATFORM, ROTOR, SLOTS, TELESCOPE_LOWER, TELESCOPE_UPPER};

/// Linear maps from (v_h, Ω, ω), the velocity of the lower Hooke joint, the rotor rate and the platform's angular
/// velocity.
///
/// Telescope: ω_T = A v_h + b Ω. End effector relative to the platform: κ = c_v·v_h + c_Ω Ω + c_ω·ω about z_P.
pub(super) struct Chain {
    pub hooke: Vector3<f64>,
    pub a: Matrix3<f64>,
    pub b: Vector3<f64>,
    pub pivot: Vector3<f64>,
    pub c_v: Vector3<f64>,
    pub c_rotor: f64,
    pub c_omega: Vector3<f64>,
}

/// Accelerations at ν̇ = 0 of the telescope's lower end, the telescope and the end effector.
pub(super) struct ChainBias {
    pub hooke: Vector3<f64>,
    pub telescope: Vector3<f64>,
    pub end_effector: Twist,
}

impl Chain {
    pub fn zero() -> Self {
        let z = Vector3::zeros();
        Self { hooke: z, a: Matrix3::zeros(), b: z, pivot: z, c_v: z, c_rotor: 0.0, c_omega: z }
    }

    /// κ per unit of the platform's v and ω, and of the rotor rate.
    pub fn relative(&self) -> (Vector3<f64>, Vector3<f64>, f64) {
        // v_h = v + ω × r_h
        (self.c_v, self.c_omega + self.hooke.cross(&self.c_v), self.c_rotor)
    }

    /// Mass of both telescope parts in (v_h, Ω), from ½ m v_h² + ω_T·(h × v_h) + ½ ω_T·Θ ω_T.
    ///
    /// `tensor` is that of both parts, in the frame of the telescope.
    pub fn telescope_mass(
        &self,
        plant: &Plant,
        tensor: &Matrix3<f64>,
        motion: &Motion,
    ) -> (Matrix3<f64>, Vector3<f64>, f64) {
        let lower = &plant.bodies[TELESCOPE_LOWER];
        let rotation = &motion.bodies[TELESCOPE_UPPER].rotation;
        let theta = super::blocks::turned(tensor, rotation);
        let h = rotation * lower.first_moment;
        let turned = theta * self.a;
        // (Aᵀ h×)ᵀ = −h× A
        let cross = cross_columns(&h, &self.a);
        let mut vv = self.a.tr_mul(&turned) - cross - cross.transpose();
        for k in 0..3 {
            vv[(k, k)] += lower.mass;
        }
        (vv, self.b.cross(&h) + turned.tr_mul(&self.b), self.b.dot(&(theta * self.b)))
    }

    pub fn bias(&self, motion: &Motion, geometry: &Geometry) -> ChainBias {
        let platform = &motion.bodies[PLATFORM];
        let omega = platform.angular_velocity;
        let hooke = omega.cross(&omega.cross(&self.hooke));
        let telescope = &motion.telescope;
        let omega_t = motion.bodies[TELESCOPE_UPPER].angular_velocity;
        let w = telescope.axis;
        let w_rate = omega_t.cross(&w);
        let spin = omega_t.dot(&w);
        let swing = telescope.swing(&(hooke + w_rate * (2.0 * telescope.rate)));
        // (α_T − α_R)·n + (ω_T − ω_R)·ṅ = 0
        let [upper, lower] = motion.hooke_joints();
        let rotor = &motion.bodies[ROTOR];
        let n = upper.normal;
        let n_rate = upper.normal_rate(&rotor.angular_velocity, &omega_t);
        let open = swing + w_rate * spin;
        let spin_rate = (-open.dot(&n) - (omega_t - rotor.angular_velocity).dot(&n_rate)) / w.dot(&n);
        let alpha = open + w * spin_rate;
        // α_E = κ̇ z_P + κ ω_P × z_P with (α_E − α_T)·n₂ + (ω_E − ω_T)·ṅ₂ = 0
        let ee = &motion.bodies[END_EFFECTOR];
        let kappa = (ee.angular_velocity - omega).dot(&self.pivot);
        let precession = omega.cross(&self.pivot) * kappa;
        let n = lower.normal;
        let n_rate = lower.normal_rate(&ee.angular_velocity, &omega_t);
        let kappa_rate =
            ((alpha - precession).dot(&n) - (ee.angular_velocity - omega_t).dot(&n_rate)) / self.pivot.dot(&n);
        let flange = self.pivot * geometry.flange_height;
        ChainBias {
            hooke,
            telescope: alpha,
            end_effector: (omega.cross(&omega.cross(&flange)), precession + self.pivot * kappa_rate),
        }
    }

    /// Applied minus bias forces at ν̇ = 0 on platform and rotor.
    pub fn bias_force(&self, loads: &Loads, bias: &ChainBias, loaded: bool) -> ChainForce {
        let Loads { plant, frame, wrenches, gravity, .. } = loads;
        let motion = &frame.motion;
        let net = |body: usize, linear: &Vector3<f64>, angular: &Vector3<f64>| -> Twist {
            let (force, moment) =
                accelerated_wrench(&plant.bodies[body], &motion.bodies[body], (linear, angular), gravity);
            (wrenches[body].0 - force, wrenches[body].1 - moment)
        };
        let upper = net(TELESCOPE_UPPER, &Vector3::zeros(), &bias.telescope);
        let lower = net(TELESCOPE_LOWER, &bias.hooke, &bias.telescope);
        let turning = upper.1 + lower.1;
        let hooke = lower.0 + self.a.tr_mul(&turning);
        let mut out = ChainForce { force: hooke, moment: self.hooke.cross(&hooke), rotor: self.b.dot(&turning) };
        // Wrenches of effects and contacts act on a massless end effector as well.
        if loaded || wrenches[END_EFFECTOR] != STILL {
            let (f, n) = net(END_EFFECTOR, &bias.end_effector.0, &bias.end_effector.1);
            let flange = motion.bodies[END_EFFECTOR].position - motion.bodies[PLATFORM].position;
            let about = self.pivot.dot(&n);
            let (cv, cw, cr) = self.relative();
            out.force += f + cv * about;
            out.moment += flange.cross(&f) + n + cw * about;
            out.rotor += cr * about;
        }
        out
    }
}

/// Forces of the chain on its neighbours: force and moment about the platform's origin, torque on the rotor.
pub(super) struct ChainForce {
    pub force: Vector3<f64>,
    pub moment: Vector3<f64>,
    pub rotor: f64,
}

impl Mechanism {
    /// Places telescope and end effector between rotor and platform.
    pub(super) fn place_chain(
        &self,
        bodies: &mut [BodyMotion; SLOTS],
        chain: &mut Chain,
        rotor_rate: f64,
    ) -> Telescope {
        let g = &self.geometry;
        let platform = bodies[PLATFORM];
        let pivot = platform.rotation.column(2).into_owned();
        let omega = platform.angular_velocity;
        let hooke = pivot * g.lower_hooke_height;
        let lower = platform.position + hooke;
        let lower_velocity = platform.velocity + omega.cross(&hooke);
        let telescope = Telescope::between(&lower, &lower_velocity, &g.upper_hooke());
        let Telescope { axis, length, .. } = telescope;
        let yoke = bodies[ROTOR].rotation.column(0).into_owned();
        let rotation = telescope.rotation(&yoke);
        let cross = rotation.column(1).into_owned();
        // The Hooke joint transmits rotation about the normal n of its cross: (ω_T − Ω z)·n = 0.
        let n = HookeJoint::new(yoke, cross).normal;
        let passed = 1.0 / axis.dot(&n);
        chain.hooke = hooke;
        chain.a = (axis * (n.cross(&axis) * passed).transpose() - axis.cross_matrix()) * (1.0 / length);
        chain.b = axis * (n.z * passed);
        let omega_t = chain.a * lower_velocity + chain.b * rotor_rate;
        // End effector: x normal to the telescope's cross axis and the pivot.
        let x = cross.cross(&pivot).normalize();
        let n = HookeJoint::new(x, cross).normal;
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
        telescope
    }
}
