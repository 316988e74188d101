//! Rigid-body inertia: the ten parameters of a body and their physical consistency.

use nalgebra::{Matrix3, Matrix4, Vector3};

use super::layout::{ARMS, MAX_LIMBS, MAX_STRUTS, STRUTS};

/// Mass, first moment and inertia tensor of a rigid body about its frame origin, in body axes ([Gnad 2024], eq. 3–4).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inertia {
    /// Mass m, kg.
    pub mass: f64,
    /// First moment m·c, kg·m.
    pub first_moment: Vector3<f64>,
    /// Inertia tensor about the frame origin, kg·m².
    pub tensor: Matrix3<f64>,
}

impl Inertia {
    /// Zero mass, first moment and tensor.
    pub const ZERO: Self = Self {
        mass: 0.0,
        first_moment: Vector3::new(0.0, 0.0, 0.0),
        tensor: Matrix3::new(0., 0., 0., 0., 0., 0., 0., 0., 0.),
    };

    /// Inertia with a diagonal tensor: `mass` in kg, `first_moment` in kg·m, `moments` in kg·m² about the frame origin.
    pub fn diagonal(mass: f64, first_moment: [f64; 3], moments: [f64; 3]) -> Self {
        Self { mass, first_moment: first_moment.into(), tensor: Matrix3::from_diagonal(&moments.into()) }
    }

    /// Inertia of the moving part of a single axis: `moment` about the axis, kg·m² (kg on a prismatic axis).
    ///
    /// Only the moment about the axis enters the equation of motion; mass and the other moments are set equal to it.
    pub fn lone(moment: f64) -> Self {
        Self { mass: moment, first_moment: Vector3::zeros(), tensor: Matrix3::identity() * moment }
    }

    /// Inertia of a point mass (kg) at `position` (m, body frame).
    pub fn point(mass: f64, position: Vector3<f64>) -> Self {
        let x = position.cross_matrix();
        Self { mass, first_moment: mass * position, tensor: -mass * x * x }
    }

    /// The inertia about another reference point of the same body; `origin` (m) is the present frame origin seen from
    /// there.
    ///
    /// The axes keep their directions. With h the first moment and `x = [origin]×`: `h′ = h + m·origin` and `Θ′ = Θ −
    /// x[h]× − [h]×x − m·x²`.
    pub fn seen_from(&self, origin: &Vector3<f64>) -> Self {
        let (x, h) = (origin.cross_matrix(), self.first_moment.cross_matrix());
        Self {
            mass: self.mass,
            first_moment: self.first_moment + self.mass * origin,
            tensor: self.tensor - x * h - h * x - self.mass * x * x,
        }
    }

    /// Pseudo-inertia matrix `[[½tr(Θ)·1 − Θ, m·c], [m·cᵀ, m]]`; positive semidefinite for every physical body.
    pub fn pseudo_inertia(&self) -> Matrix4<f64> {
        let second = Matrix3::identity() * (0.5 * self.tensor.trace()) - self.tensor;
        let mut j = Matrix4::zeros();
        j.fixed_view_mut::<3, 3>(0, 0).copy_from(&second);
        j.fixed_view_mut::<3, 1>(0, 3).copy_from(&self.first_moment);
        j.fixed_view_mut::<1, 3>(3, 0).copy_from(&self.first_moment.transpose());
        j[(3, 3)] = self.mass;
        j
    }

    /// Smallest eigenvalue of [`Self::pseudo_inertia`]; negative if the inertia is not physically consistent.
    pub fn min_eigenvalue(&self) -> f64 {
        self.pseudo_inertia().symmetric_eigenvalues().min()
    }
}

impl std::ops::AddAssign for Inertia {
    fn add_assign(&mut self, other: Self) {
        self.mass += other.mass;
        self.first_moment += other.first_moment;
        self.tensor += other.tensor;
    }
}

impl std::ops::Mul<f64> for Inertia {
    type Output = Self;
    fn mul(self, k: f64) -> Self {
        Self { mass: k * self.mass, first_moment: k * self.first_moment, tensor: k * self.tensor }
    }
}

/// Number of moving bodies of an assembled robot with three limbs, the first of [`SLOTS`].
pub const BODIES: usize = 14;
/// Index of the first arm; the arms of three limbs are bodies 0 to 2.
pub const ARM: usize = 0;
/// Index of the first strut; the struts of three limbs are bodies 3 to 8, struts 2i and 2i+1 (from 0) belong to limb i.
pub const STRUT: usize = ARM + ARMS;
/// Index of the moving platform, or of the first part of a plate that carries limbs.
pub const PLATFORM: usize = STRUT + STRUTS;
/// Index of the end effector with payload.
pub const END_EFFECTOR: usize = PLATFORM + 1;
/// Index of the rotor of motor 4, with its inertia at the gear output.
pub const ROTOR: usize = PLATFORM + 2;
/// Index of the upper part of the telescope.
pub const TELESCOPE_UPPER: usize = PLATFORM + 3;
/// Index of the lower part of the telescope.
pub const TELESCOPE_LOWER: usize = PLATFORM + 4;
/// Arms and struts of the limbs after the third.
const MORE_ARMS: usize = BODIES;
const MORE_STRUTS: usize = MORE_ARMS + MAX_LIMBS - ARMS;
/// Index of the second part of a plate that carries limbs.
pub const SECOND_PLATFORM: usize = MORE_STRUTS + MAX_STRUTS - STRUTS;
/// Index of the part of a plate that carries neither limbs nor the end effector.
pub const LINK: usize = SECOND_PLATFORM + 1;
/// Number of bodies of all machines together; a machine has those that [`Mechanism::has_body`] states, the others are at
/// rest and without mass.
///
/// [`Mechanism::has_body`]: super::Mechanism::has_body
pub const SLOTS: usize = LINK + 1;

/// Index of the arm of `limb` (from 0).
#[inline]
pub const fn arm(limb: usize) -> usize {
    if limb < ARMS { ARM + limb } else { MORE_ARMS + limb - ARMS }
}

/// Index of strut `s` (from 0); struts 2i and 2i+1 belong to limb i.
#[inline]
pub const fn strut(s: usize) -> usize {
    if s < STRUTS { STRUT + s } else { MORE_STRUTS + s - STRUTS }
}

/// What a body is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BodyKind {
    /// Arm of a limb (from 0).
    Arm(usize),
    /// Strut (from 0).
    Strut(usize),
    /// The platform, or a part of the plate (from 0) that carries limbs.
    Platform(usize),
    /// The end effector.
    EndEffector,
    /// The rotor of motor 4.
    Rotor,
    /// The upper part of the telescope.
    TelescopeUpper,
    /// The lower part of the telescope.
    TelescopeLower,
    /// A part of the plate that carries neither limbs nor the end effector.
    Link,
}

/// What body `b` is.
///
/// # Panics
/// If `b` is not below [`SLOTS`].
pub fn body_kind(b: usize) -> BodyKind {
    match b {
        ARM..STRUT => BodyKind::Arm(b - ARM),
        STRUT..PLATFORM => BodyKind::Strut(b - STRUT),
        PLATFORM => BodyKind::Platform(0),
        END_EFFECTOR => BodyKind::EndEffector,
        ROTOR => BodyKind::Rotor,
        TELESCOPE_UPPER => BodyKind::TelescopeUpper,
        TELESCOPE_LOWER => BodyKind::TelescopeLower,
        MORE_ARMS..MORE_STRUTS => BodyKind::Arm(b - MORE_ARMS + ARMS),
        MORE_STRUTS..SECOND_PLATFORM => BodyKind::Strut(b - MORE_STRUTS + STRUTS),
        SECOND_PLATFORM => BodyKind::Platform(1),
        LINK => BodyKind::Link,
        _ => panic!("body {b} of {SLOTS}"),
    }
}

/// Name of body `b`, e.g. `strut4` (numbered from 1).
///
/// # Panics
/// If `b` is not below [`SLOTS`].
pub fn body_name(b: usize) -> String {
    match body_kind(b) {
        BodyKind::Arm(limb) => format!("arm{}", limb + 1),
        BodyKind::Strut(s) => format!("strut{}", s + 1),
        BodyKind::Platform(0) => "platform".into(),
        BodyKind::Platform(part) => format!("platform{}", part + 1),
        BodyKind::EndEffector => "end_effector".into(),
        BodyKind::Rotor => "rotor".into(),
        BodyKind::TelescopeUpper => "telescope_upper".into(),
        BodyKind::TelescopeLower => "telescope_lower".into(),
        BodyKind::Link => "link".into(),
    }
}

/// Inertia of the moving bodies, each about the origin and in the axes of its own frame.
///
/// Frames: arm at the shaft, x to the elbow, y along the motor axis; strut at the upper ball, x to the platform ball;
/// platform at the centre of its ball plane, z up, parts of a plate where [`super::Plate`] places them; end effector at the flange centre; rotor and upper part of the
/// telescope at the upper Hooke joint, lower part of the telescope at the lower Hooke joint, z up along the bar.
#[derive(Clone, Debug, PartialEq)]
pub struct Bodies(pub [Inertia; SLOTS]);

impl std::ops::Index<usize> for Bodies {
    type Output = Inertia;
    fn index(&self, b: usize) -> &Inertia {
        &self.0[b]
    }
}

impl std::ops::IndexMut<usize> for Bodies {
    fn index_mut(&mut self, b: usize) -> &mut Inertia {
        &mut self.0[b]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inertia_about_another_point_is_that_of_the_shifted_masses() {
        let points = [(2.0, Vector3::new(0.1, -0.2, 0.3)), (0.5, Vector3::new(-0.4, 0.1, 0.2))];
        let origin = Vector3::new(0.3, 0.2, -0.5);
        let sum = |shift: Vector3<f64>| {
            let mut all = Inertia::ZERO;
            points.iter().for_each(|(m, p)| all += Inertia::point(*m, p + shift));
            all
        };
        let (seen, shifted) = (sum(Vector3::zeros()).seen_from(&origin), sum(origin));
        approx::assert_relative_eq!(seen.first_moment, shifted.first_moment, epsilon = 1e-15);
        approx::assert_relative_eq!(seen.tensor, shifted.tensor, epsilon = 1e-15);
    }
}
