//! Inverse and forward kinematics, with rates and accelerations: closed form but for the forward kinematics of plates other
//! than the platform of three limbs, see `closure`.
//!
//! Loop closure of limb i, with p the plate's origin, b the middle of its lower ball pair relative to p and e its elbow (see
//! `Arm`): the strut vector is l = p + b − e and |l| = l₂. Bodies that carry a ball pair only translate, so both struts of a
//! pair share l.

use std::borrow::Cow;

use nalgebra::{Matrix3, Vector3};
use thiserror::Error;

use super::arm::Arm;
use super::motion::Motion;
use crate::machine::{
    Actuator, Geometry, Limb, PerAxis, TELESCOPE_AXIS, ThreeArms, bodies, each, may_have_telescope, three_arms,
};

/// Joint angles (rad), rates and accelerations.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct JointState {
    /// q = (φ1, φ2, φ3, ψ) of three limbs with a telescope, (φ1, φ2, φ3, φ4) of four limbs.
    pub q: PerAxis<f64>,
    /// Rates, rad/s.
    pub qd: PerAxis<f64>,
    /// Accelerations, rad/s².
    pub qdd: PerAxis<f64>,
}

/// Motion of the centre of the platform's ball plane (inertial frame) and of the end-effector angle ψ.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlatformState {
    /// Position, m.
    pub position: Vector3<f64>,
    /// Velocity, m/s.
    pub velocity: Vector3<f64>,
    /// Acceleration, m/s².
    pub acceleration: Vector3<f64>,
    /// ψ, its rate and its acceleration; rad, rad/s, rad/s².
    pub psi: [f64; 3],
}

/// Commanded motion of a machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// Motion of platform and axis 4.
    Platform(PlatformState),
    /// Motion of the joints.
    Joints(JointState),
}

impl From<PlatformState> for Target {
    fn from(platform: PlatformState) -> Self {
        Self::Platform(platform)
    }
}

impl From<JointState> for Target {
    fn from(joints: JointState) -> Self {
        Self::Joints(joints)
    }
}

impl Target {
    /// Motion of the joints that realises the target.
    ///
    /// # Errors
    /// Those of [`Geometry::inverse_motion`] for a platform target; none for a joint target.
    pub fn joints(&self, geometry: &Geometry) -> Result<JointState, KinematicsError> {
        match self {
            Self::Platform(platform) => geometry.inverse_motion(platform),
            Self::Joints(joints) => Ok(*joints),
        }
    }
}

/// Why a motion is not feasible.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum KinematicsError {
    /// For no arm angle does the strut reach the platform.
    #[error("limb {}: platform position ({x:.4}, {y:.4}, {z:.4}) m is out of reach", .limb + 1)]
    OutOfReach {
        /// Limb, from 0.
        limb: usize,
        /// Platform position, m.
        x: f64,
        /// Platform position, m.
        y: f64,
        /// Platform position, m.
        z: f64,
    },
    /// The struts do not reach a common plate at these arm angles.
    #[error("arm angles ({}) rad do not close the loop", listed(.q))]
    NoClosure {
        /// Arm angles, rad.
        q: Vec<f64>,
    },
    /// The constraint Jacobian is singular.
    #[error("singular pose at arm angles ({}) rad", listed(.q))]
    Singular {
        /// Arm angles, rad.
        q: Vec<f64>,
    },
    /// An arm angle is beyond its limits.
    #[error("arm {} at {angle:.4} rad is outside {min:.4}..{max:.4} rad", .arm + 1)]
    ArmLimit {
        /// Arm, from 0.
        arm: usize,
        /// Angle, rad.
        angle: f64,
        /// Lower limit, rad.
        min: f64,
        /// Upper limit, rad.
        max: f64,
    },
    /// The value of a force law is not finite.
    #[error("{0}")]
    Law(Box<LawFault>),
    /// The distance of the telescope's Hooke joints is outside its limits.
    #[error("telescope length {length:.4} m is outside {min:.4}..{max:.4} m")]
    TelescopeLimit {
        /// Length, m.
        length: f64,
        /// Lower limit, m.
        min: f64,
        /// Upper limit, m.
        max: f64,
    },
}

impl KinematicsError {
    /// The error with sample `k` (from 0) added; only [`Self::Law`] states a sample.
    pub fn at_sample(self, k: usize) -> Self {
        match self {
            Self::Law(fault) => Self::Law(Box::new(LawFault { sample: Some(k), ..*fault })),
            other => other,
        }
    }

    /// The error with its sample increased by `by`; an error without a sample is unchanged.
    pub fn later(self, by: usize) -> Self {
        match &self {
            Self::Law(fault) => match fault.sample {
                Some(k) => self.at_sample(k + by),
                None => self,
            },
            _ => self,
        }
    }
}

/// Where the value of a force law is not finite.
#[derive(Clone, Debug, PartialEq)]
pub struct LawFault {
    /// Name of the effect.
    pub effect: &'static str,
    /// Name of the term, that of its coefficient.
    pub term: Cow<'static, str>,
    /// Value per unit of the coefficient.
    pub value: f64,
    /// Sample, from 0, of a sampled motion.
    pub sample: Option<usize>,
    /// Time, s.
    pub t: f64,
    /// Joint angles, rad (m on a prismatic axis).
    pub q: PerAxis<f64>,
    /// Joint rates, rad/s (m/s on a prismatic axis).
    pub qd: PerAxis<f64>,
}

impl std::fmt::Display for LawFault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { effect, term, value, t, .. } = self;
        let sample = self.sample.map_or_else(String::new, |k| format!(" at sample {}", k + 1));
        write!(
            f,
            "effect `{effect}`, term `{term}`: the law gives {value}{sample} at t = {t:.6} s, q = ({}), dq/dt = ({}); \
             expected a finite number",
            listed(&self.q),
            listed(&self.qd)
        )
    }
}

fn listed(values: &[f64]) -> String {
    values.iter().map(|x| format!("{x:.4}")).collect::<Vec<_>>().join(", ")
}

impl Geometry {
    /// Elbow (middle of the ball pair) of `limb` with its drive at `q` (rad or m), inertial frame, m.
    ///
    /// # Panics
    /// If there is no `limb`.
    pub fn elbow(&self, limb: usize, q: f64) -> Vector3<f64> {
        Arm::new(&self.limbs[limb], q).elbow
    }

    /// How far a limb is from reaching a pose (position in m, inertial frame; ψ in rad): beyond ±1 its strut does not reach.
    ///
    /// For a revolute arm it is the cosine of the angle between the arm and the direction to the plate, as the closure
    /// of the limb requires it; for a carriage the distance of the ball pair from the guide over the strut's length.
    ///
    /// # Panics
    /// If there is no `limb`.
    pub fn elbow_cosine(&self, limb: usize, position: &Vector3<f64>, psi: f64) -> f64 {
        let limb = &self.limbs[limb];
        let ball = position + self.pair(limb, psi).offset;
        match limb.actuator {
            Actuator::Revolute => elbow_equation(limb, &ball)[2],
            Actuator::Prismatic { .. } => {
                let arm = Arm::new(limb, 0.0);
                arm.x.cross(&(ball - arm.elbow)).norm() / limb.strut_length
            }
        }
    }

    /// Arm angles (rad), or distances of the carriages (m), of all limbs for a pose (position in m, inertial frame; ψ in
    /// rad); joint limits are not checked. The position is taken as it is, also where a coupling of passive arms would
    /// displace it.
    ///
    /// Of the two solutions of a limb, a revolute arm has its elbow outward, and the strut of a carriage leads inward and
    /// down: along the guide if it falls by more than 45°, else against it.
    ///
    /// # Errors
    /// [`KinematicsError::OutOfReach`] if a strut does not reach the position.
    pub fn inverse(&self, position: &Vector3<f64>, psi: f64) -> Result<PerAxis<f64>, KinematicsError> {
        let mut q: PerAxis<f64> = each(0.0);
        for (i, limb) in self.limbs.iter().enumerate() {
            let ball = position + self.pair(limb, psi).offset;
            let reached = match limb.actuator {
                Actuator::Revolute => arm_angle(limb, &ball),
                Actuator::Prismatic { .. } => carriage(limb, &ball),
            };
            let (x, y, z) = (position.x, position.y, position.z);
            q[i] = reached.ok_or(KinematicsError::OutOfReach { limb: i, x, y, z })?;
        }
        Ok(q)
    }

    /// Platform position (m, inertial frame) for arm angles (rad): for three limbs the lower intersection of three spheres;
    /// limits are not checked.
    ///
    /// # Errors
    /// [`KinematicsError::NoClosure`] if the spheres do not intersect.
    ///
    /// # Panics
    /// If `q` has fewer elements than there are driven limbs.
    pub fn forward(&self, q: &[f64]) -> Result<Vector3<f64>, KinematicsError> {
        match self.has_platform_of_three() {
            true => self.forward_of([q[0], q[1], q[2]], &Arm::three(self, q)),
            false => Ok(self.closed(q, None)?.position),
        }
    }

    fn forward_of(&self, q: ThreeArms<f64>, arms: &ThreeArms<Arm>) -> Result<Vector3<f64>, KinematicsError> {
        let centre = |i: usize| arms[i].elbow - self.limbs[i].point;
        let (c0, c1, c2) = (centre(0), centre(1), centre(2));
        let [r0, r1, r2] = std::array::from_fn(|i| self.limbs[i].strut_length);
        // Sphere 0 minus sphere i gives a plane: 2(cᵢ − c₀)·p = r₀² − rᵢ² + cᵢ² − c₀².
        let (e1, e2) = (c1 - c0, c2 - c0);
        let k1 = 0.5 * (r0 * r0 - r1 * r1 + e1.norm_squared());
        let k2 = 0.5 * (r0 * r0 - r2 * r2 + e2.norm_squared());
        let n = e1.cross(&e2);
        let nn = n.norm_squared();
        // The point nearest to c₀ on the intersection line of both planes, then along the normal to the sphere.
        let foot = (e2.cross(&n) * k1 + n.cross(&e1) * k2) / nn;
        let height2 = (r0 * r0 - foot.norm_squared()) / nn;
        if height2.is_nan() || height2 < 0.0 {
            return Err(KinematicsError::NoClosure { q: q.into() });
        }
        let side = if n.z > 0.0 { -1.0 } else { 1.0 };
        Ok(c0 + foot + n * (side * height2.sqrt()))
    }

    /// Direction of the strut of `limb`, upper to lower ball, and the magnitude of the cosine between it and the motion of
    /// the elbow: the sine of the angle between strut and arm, zero where the drive does not move the plate.
    ///
    /// # Panics
    /// If there is no `limb`.
    pub fn transmission(&self, limb: usize, q: f64, platform: &PlatformState) -> (Vector3<f64>, f64) {
        let limb = &self.limbs[limb];
        let arm = Arm::new(limb, q);
        let strut = (platform.position + self.pair(limb, platform.psi[0]).offset - arm.elbow).normalize();
        (strut, strut.dot(&arm.slope.normalize()).abs())
    }

    /// Jacobian ∂ṗ/∂φ̇ (3×3, m/rad) of three limbs and a platform at a pose that closes the loops.
    ///
    /// # Errors
    /// [`KinematicsError::Singular`] if the three strut vectors are linearly dependent.
    ///
    /// # Panics
    /// If `q` has fewer than three elements.
    pub fn jacobian(&self, q: &[f64], position: &Vector3<f64>) -> Result<Matrix3<f64>, KinematicsError> {
        self.jacobian_of(&Arm::three(self, q), q, position)
    }

    /// [`Self::jacobian`] with the arms of a motion.
    ///
    /// # Errors
    /// As [`Self::jacobian`].
    pub(crate) fn jacobian_along(&self, motion: &Motion) -> Result<Matrix3<f64>, KinematicsError> {
        let arm = |i: usize| Arm::of(&self.limbs[i], &motion.bodies[bodies::arm(i)]);
        self.jacobian_of(&[arm(0), arm(1), arm(2)], &motion.q, &motion.bodies[bodies::PLATFORM].position)
    }

    fn jacobian_of(
        &self,
        arms: &ThreeArms<Arm>,
        q: &[f64],
        position: &Vector3<f64>,
    ) -> Result<Matrix3<f64>, KinematicsError> {
        // l·ṗ = (l·∂e/∂q) q̇
        let mut parallel = Matrix3::zeros();
        let mut serial = Vector3::zeros();
        for (i, arm) in arms.iter().enumerate() {
            let l = position + self.limbs[i].point - arm.elbow;
            parallel.set_row(i, &l.transpose());
            serial[i] = l.dot(&arm.slope);
        }
        let inverse = parallel.try_inverse().ok_or_else(|| KinematicsError::Singular { q: q[three_arms()].into() })?;
        Ok(inverse * Matrix3::from_diagonal(&serial))
    }

    /// Platform motion for a joint motion.
    ///
    /// # Errors
    /// [`KinematicsError::NoClosure`] as in [`Self::forward`], [`KinematicsError::Singular`] as in [`Self::jacobian`].
    pub fn forward_motion(&self, joints: &JointState) -> Result<PlatformState, KinematicsError> {
        if !self.has_platform_of_three() {
            return Ok(self.complete(joints)?.1);
        }
        let JointState { q, qd, qdd } = joints;
        let arms = Arm::three(self, q);
        let position = self.forward_of([q[0], q[1], q[2]], &arms)?;
        let struts: ThreeArms<Vector3<f64>> = std::array::from_fn(|i| position + self.limbs[i].point - arms[i].elbow);
        let mut parallel = Matrix3::zeros();
        let mut rate = Vector3::zeros();
        for (i, l) in struts.iter().enumerate() {
            parallel.set_row(i, &l.transpose());
            rate[i] = l.dot(&arms[i].slope) * qd[i];
        }
        let inverse = parallel.try_inverse().ok_or_else(|| KinematicsError::Singular { q: q[three_arms()].into() })?;
        let velocity = inverse * rate;
        let mut rate = Vector3::zeros();
        for (i, (l, arm)) in struts.iter().zip(&arms).enumerate() {
            // l·p̈ = −|l̇|² + l·(∂e/∂q q̈ + ∂²e/∂q² q̇²)
            let ld = velocity - arm.slope * qd[i];
            rate[i] = l.dot(&(arm.slope * qdd[i] + arm.curvature * (qd[i] * qd[i]))) - ld.norm_squared();
        }
        let psi = if self.has_telescope() { [q[3], qd[3], qdd[3]] } else { [0.0; 3] };
        Ok(PlatformState { position, velocity, acceleration: inverse * rate, psi })
    }

    /// Joint motion for a platform motion, elbows outward. A coupling of passive arms displaces the platform, see
    /// [`Self::settled`].
    ///
    /// # Errors
    /// [`KinematicsError::OutOfReach`] as in [`Self::inverse`]; [`KinematicsError::Singular`] if a strut is
    /// perpendicular to the motion of its elbow.
    pub fn inverse_motion(&self, platform: &PlatformState) -> Result<JointState, KinematicsError> {
        let platform = &self.settled(platform)?;
        let angles = self.inverse(&platform.position, platform.psi[0])?;
        let mut joints = JointState { q: angles, ..JointState::default() };
        for i in 0..self.limbs.len() {
            let step = self.limb_step(i, angles[i], platform);
            if step.serial.abs() < 1e-9 {
                return Err(KinematicsError::Singular { q: angles[..self.limbs.len()].into() });
            }
            (joints.qd[i], joints.qdd[i]) = (step.rate, step.acceleration);
        }
        if may_have_telescope(self.limbs.len()) {
            [joints.q[TELESCOPE_AXIS], joints.qd[TELESCOPE_AXIS], joints.qdd[TELESCOPE_AXIS]] = platform.psi;
        }
        Ok(joints)
    }

    /// Rate and acceleration of the drive of limb `i` at `q` for a platform motion.
    pub(super) fn limb_step(&self, i: usize, q: f64, platform: &PlatformState) -> LimbStep {
        let limb = &self.limbs[i];
        let arm = Arm::new(limb, q);
        let pair = self.pair(limb, platform.psi[0]);
        let [_, turning, turning_rate] = platform.psi;
        let l = platform.position + pair.offset - arm.elbow;
        let velocity = platform.velocity + pair.slope * turning;
        let acceleration = platform.acceleration + pair.slope * turning_rate + pair.curvature * (turning * turning);
        let serial = l.dot(&arm.slope);
        let rate = l.dot(&velocity) / serial;
        let ld = velocity - arm.slope * rate;
        let acceleration = (l.dot(&acceleration) + ld.norm_squared() - l.dot(&arm.curvature) * rate * rate) / serial;
        LimbStep { strut: l, serial, rate, acceleration }
    }

    /// Third derivatives of the coordinates (rad/s³ or m/s³) of all arms, and of an axis that turns the end effector, for the
    /// platform motion of [`Geometry::inverse_motion`], settled, with jerk `jerk` (m/s³) and ψ⃛ = `turning` (rad/s³).
    pub fn inverse_jerk(
        &self,
        platform: &PlatformState,
        joints: &JointState,
        jerk: &Vector3<f64>,
        turning: f64,
    ) -> PerAxis<f64> {
        let mut out: PerAxis<f64> = each(0.0);
        out[TELESCOPE_AXIS] = turning;
        let [psi, first, second] = platform.psi;
        for (i, limb) in self.limbs.iter().enumerate() {
            // d²/dt² of l·l̇ = 0: 3 l̇·l̈ + l·l⃛ = 0.
            let (rate, acceleration) = (joints.qd[i], joints.qdd[i]);
            let (arm, pair) = (Arm::new(limb, joints.q[i]), self.pair(limb, psi));
            let l = platform.position + pair.offset - arm.elbow;
            let ld = platform.velocity + pair.slope * first - arm.slope * rate;
            let ball = platform.acceleration + pair.slope * second + pair.curvature * (first * first);
            let ldd = ball - arm.slope * acceleration - arm.curvature * (rate * rate);
            let ball =
                jerk + pair.slope * turning + pair.curvature * (3.0 * first * second) + pair.third() * first.powi(3);
            let third = arm.third(limb.actuator);
            let rest = ball - arm.curvature * (3.0 * rate * acceleration) - third * rate.powi(3);
            out[i] = (3.0 * ld.dot(&ldd) + l.dot(&rest)) / l.dot(&arm.slope);
        }
        out
    }

    /// Vector (m) from the lower to the upper Hooke joint of the telescope for a platform position (m, inertial frame).
    pub fn telescope_bar(&self, position: &Vector3<f64>) -> Vector3<f64> {
        self.upper_hooke() - position - Vector3::z() * self.lower_hooke_height
    }

    /// Distance (m) between the telescope's Hooke joints for a platform position (m, inertial frame).
    pub fn telescope_length(&self, position: &Vector3<f64>) -> f64 {
        self.telescope_bar(position).norm()
    }

    /// Angle between the telescope and the vertical, rad, at a platform position (m): the angle of both Hooke joints as
    /// long as the platform is horizontal.
    pub fn telescope_tilt(&self, position: &Vector3<f64>) -> f64 {
        let bar = self.telescope_bar(position);
        bar.x.hypot(bar.y).atan2(bar.z)
    }

    /// Checks arm angles (rad) against their limits.
    ///
    /// # Errors
    /// [`KinematicsError::ArmLimit`] for the first arm outside its limits.
    pub fn check_arms(&self, q: &[f64]) -> Result<(), KinematicsError> {
        for (arm, (&angle, limb)) in q.iter().zip(self.limbs.iter()).enumerate() {
            let [min, max] = limb.limits;
            if !(min..=max).contains(&angle) {
                return Err(KinematicsError::ArmLimit { arm, angle, min, max });
            }
        }
        Ok(())
    }

    /// Checks arm angles (rad) and telescope length of a pose against their limits.
    ///
    /// # Errors
    /// [`KinematicsError::ArmLimit`] for the first arm outside its limits, else [`KinematicsError::TelescopeLimit`].
    ///
    /// # Panics
    /// If `q` has fewer elements than there are limbs.
    pub fn check_limits(&self, q: &[f64], position: &Vector3<f64>) -> Result<(), KinematicsError> {
        self.check_arms(&q[..self.limbs.len()])?;
        if !self.has_telescope() {
            return Ok(());
        }
        let length = self.telescope_length(position);
        let [min, max] = self.telescope_limits;
        if !(min..=max).contains(&length) {
            return Err(KinematicsError::TelescopeLimit { length, min, max });
        }
        Ok(())
    }
}

/// One limb along a platform motion.
pub(super) struct LimbStep {
    /// Strut vector l, upper to lower ball, m.
    pub strut: Vector3<f64>,
    /// l·∂e/∂q, m²/rad or m.
    pub serial: f64,
    /// Rate of the drive, rad/s or m/s.
    pub rate: f64,
    /// Acceleration of the drive, rad/s² or m/s².
    pub acceleration: f64,
}

/// Coefficients of the closure |d − l₁ x_A|² = l₂² of a revolute limb, a cos φ + b sin φ = c, that is cos(φ − atan2(b,
/// a)) = c/√(a² + b²), for the middle of its lower ball pair at `ball`: a and b (m²), and the right side.
fn elbow_equation(limb: &Limb, ball: &Vector3<f64>) -> [f64; 3] {
    let d = ball - limb.shaft();
    let (a, b) = (2.0 * limb.arm_length * d.dot(&limb.radial()), -2.0 * limb.arm_length * d.z);
    let c = d.norm_squared() + limb.arm_length.powi(2) - limb.strut_length.powi(2);
    [a, b, c / a.hypot(b)]
}

fn arm_angle(limb: &Limb, ball: &Vector3<f64>) -> Option<f64> {
    let [a, b, cosine] = elbow_equation(limb, ball);
    if cosine.is_nan() || cosine.abs() > 1.0 {
        return None;
    }
    let angle = b.atan2(a) - cosine.acos();
    Some(if angle < -std::f64::consts::PI { angle + std::f64::consts::TAU } else { angle })
}

/// Solution of |l₀ − q·x_A| = l₂ with l₀ the strut vector at q = 0: q = l₀·x_A ∓ √((l₀·x_A)² − l₀² + l₂²), where l·x_A
/// is ± the root.
fn carriage(limb: &Limb, ball: &Vector3<f64>) -> Option<f64> {
    let arm = Arm::new(limb, 0.0);
    let start = ball - arm.elbow;
    let along = start.dot(&arm.x);
    let square = along * along - start.norm_squared() + limb.strut_length.powi(2);
    if square.is_nan() || square < 0.0 {
        return None;
    }
    let is_steep = -arm.x.z > arm.x.dot(&limb.radial());
    Some(if is_steep { along - square.sqrt() } else { along + square.sqrt() })
}
