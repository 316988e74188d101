//! Limits on a motion along a path, (35)–(37) of the paper.

use crate::constraint_forces::Detail;
use crate::dynamics::Output;
use crate::machine::{Drive, Mechanism, PerAxis, Unit, each, every_axis, struts_from};
use crate::model::Model;
use crate::recording::Channel;

/// Number of limited quantities affine in s̈: accelerations, torques, λ_E, λ_P, λ_S.
pub const QUANTITIES: usize = DYNAMIC + LOADS;
/// First of those from the dynamics, after the accelerations.
pub const DYNAMIC: usize = every_axis().end;
/// Number of those from the dynamics: torques, λ_E, λ_P, λ_S.
pub const LOADS: usize = struts_from(S).end;
/// First component of λ_E, λ_P and λ_S among those from the dynamics.
const E: usize = every_axis().end;
const P: usize = E + BEARING;
const S: usize = struts_from(P).end;
/// Number of components of λ_E.
const BEARING: usize = 5;

/// Limits on the motion, symmetric: |value| ≤ limit; infinite where there is none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Drive speeds, rad/s.
    pub speed: PerAxis<f64>,
    /// Drive accelerations, rad/s².
    pub acceleration: PerAxis<f64>,
    /// Drive jerks, rad/s³.
    pub jerk: PerAxis<f64>,
    /// Drive torques, N·m.
    pub torque: PerAxis<f64>,
    /// Each of the two moments of λ_E, N·m.
    pub bearing_moment: f64,
    /// Each of the three forces of λ_E, N.
    pub bearing_force: f64,
    /// Each λ_P, N.
    pub strut_lower: f64,
    /// Each λ_S, N.
    pub strut_upper: f64,
    /// Share of torque and constraint-force limits that is left unused.
    pub margin: f64,
    /// Which constraint forces are limited.
    pub detail: Detail,
}

impl Limits {
    /// No limits.
    pub const NONE: Self = Self {
        speed: each(f64::INFINITY),
        acceleration: each(f64::INFINITY),
        jerk: each(f64::INFINITY),
        torque: each(f64::INFINITY),
        bearing_moment: f64::INFINITY,
        bearing_force: f64::INFINITY,
        strut_lower: f64::INFINITY,
        strut_upper: f64::INFINITY,
        margin: 0.1,
        detail: Detail::Complete,
    };

    /// Limits of the drives of `model`; none on constraint forces, nor of an axis that the machine does not have.
    pub fn of(model: &Model) -> Self {
        let axes = model.mechanism.axes();
        let of = |limit: fn(&Drive) -> f64| {
            std::array::from_fn(|i| if i < axes { limit(&model.drives[i]) } else { f64::INFINITY })
        };
        Self {
            speed: of(|d| d.max_speed),
            acceleration: of(|d| d.max_acceleration),
            jerk: of(|d| d.max_jerk),
            torque: of(|d| d.max_torque),
            ..Self::NONE
        }
    }

    /// Whether any jerk is limited.
    pub fn has_jerk(&self) -> bool {
        self.jerk.iter().any(|j| j.is_finite())
    }

    /// Usable limit of each quantity affine in s̈.
    pub(super) fn usable(&self) -> [f64; QUANTITIES] {
        let share = 1.0 - self.margin;
        std::array::from_fn(|k| match Limit::affine(k) {
            limit @ Limit::Acceleration(_) => self.value(limit),
            limit => share * self.value(limit),
        })
    }

    /// Value of a limit, without the margin, in the unit of [`Limit::unit`].
    pub fn value(&self, limit: Limit) -> f64 {
        match limit {
            Limit::Speed(i) => self.speed[i],
            Limit::Acceleration(i) => self.acceleration[i],
            Limit::Jerk(i) => self.jerk[i],
            Limit::Torque(i) => self.torque[i],
            Limit::LambdaE(0 | 1) => self.bearing_moment,
            Limit::LambdaE(_) => self.bearing_force,
            Limit::LambdaP(_) => self.strut_lower,
            Limit::LambdaS(_) => self.strut_upper,
        }
    }
}

/// One limit; drives and components are counted from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Limit {
    /// Speed of a drive.
    Speed(usize),
    /// Acceleration of a drive.
    Acceleration(usize),
    /// Jerk of a drive.
    Jerk(usize),
    /// Torque of a drive.
    Torque(usize),
    /// Load on the end effector's bearing.
    LambdaE(usize),
    /// Strut force at the platform.
    LambdaP(usize),
    /// Strut force at the elbow.
    LambdaS(usize),
}

impl Limit {
    /// Limit of the affine quantity `k`.
    pub fn affine(k: usize) -> Self {
        match k.checked_sub(DYNAMIC) {
            None => Self::Acceleration(k),
            Some(k @ ..E) => Self::Torque(k),
            Some(k @ E..P) => Self::LambdaE(k - E),
            Some(k @ P..S) => Self::LambdaP(k - P),
            Some(k) => Self::LambdaS(k - S),
        }
    }

    /// Unit of the limited value on a machine.
    pub fn unit(self, machine: Mechanism) -> Unit {
        match self {
            Self::Speed(_) => machine.unit(Unit::RadPerS),
            Self::Acceleration(_) => machine.unit(Unit::RadPerS2),
            Self::Jerk(_) => machine.unit(Unit::RadPerS3),
            Self::Torque(_) => machine.unit(Unit::NM),
            Self::LambdaE(0 | 1) => Unit::NM,
            _ => Unit::N,
        }
    }

    /// Title in tables and figures. Its name in files is its [`Display`](std::fmt::Display).
    pub fn title(self, machine: Mechanism) -> String {
        const BEARING: [&str; 5] =
            ["moment about x", "moment about y", "force along x", "force along y", "force along z"];
        match self {
            Self::Speed(i) => format!("axis {} speed", i + 1),
            Self::Acceleration(i) => format!("axis {} acceleration", i + 1),
            Self::Jerk(i) => format!("axis {} jerk", i + 1),
            Self::Torque(i) => Channel::Torque(i).title(machine),
            Self::LambdaE(k) => format!("end effector {}", BEARING[k]),
            Self::LambdaP(s) => Channel::StrutLower(s).title(machine),
            Self::LambdaS(s) => Channel::StrutUpper(s).title(machine),
        }
    }
}

impl std::fmt::Display for Limit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (name, i) = match self {
            Self::Speed(i) => ("speed", i),
            Self::Acceleration(i) => ("acceleration", i),
            Self::Jerk(i) => ("jerk", i),
            Self::Torque(i) => ("torque", i),
            Self::LambdaE(i) => ("lambda_e", i),
            Self::LambdaP(i) => ("lambda_p", i),
            Self::LambdaS(i) => ("lambda_s", i),
        };
        write!(f, "{name}{}", i + 1)
    }
}

/// Torques, and of the `limited` loads λ_E, λ_P and λ_S, in the order of the quantities.
pub(super) fn loads(tau: &PerAxis<f64>, lambda_e: &[f64; BEARING], limited: &Output) -> [f64; LOADS] {
    let mut out = [0.0; LOADS];
    out[..E].copy_from_slice(tau);
    out[E..P].copy_from_slice(lambda_e);
    out[P..S].copy_from_slice(&limited.reactions.lower);
    out[S..].copy_from_slice(&limited.reactions.upper);
    out
}
