//! Constraint forces of the robot's joints and its drive torques for a given motion (section 4 of the paper).
//!
//! The motion of all bodies is known, so the Newton–Euler equations M V̇ + C M V + Gᵀλ = W (31) of the reduced
//! velocities V = (V_E, V_P, v_S, ω_A) ∈ R²¹ are linear in the 21 multipliers λ. [`Statics`] is this system at a
//! pose; it takes one of two sets of loads, see [`Detail`].

mod loads;
mod statics;
#[cfg(test)]
mod tests;

pub(crate) use loads::rigid_loads;
pub use loads::{Detail, constraint_forces};
pub use statics::{Loads, Statics};

use crate::dynamics::{Borne, Output};
use crate::kinematics::Reactions;
use crate::machine::{Mechanism, SixStruts, ThreeArms, Unit};

/// Number of multipliers and of reduced velocities.
pub const MULTIPLIERS: usize = 21;

/// Multipliers λ of the reduced constraints (32), named as in the paper.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Multipliers {
    /// λ_E: load of the end effector on the platform in the bearing between them: two moments about x and y (N·m,
    /// about the flange centre) and the force along x, y, z (N), in the axes of the end effector.
    pub lambda_e: [f64; 5],
    /// λ_TB: torque on the end effector about its axis, N·m; positive torque drives a positive rate.
    pub lambda_tb: f64,
    /// λ_P: axial force of each strut at the platform, N, tension positive.
    pub lambda_p: SixStruts<f64>,
    /// λ_S: axial force of each strut at the elbow, N, tension positive.
    pub lambda_s: SixStruts<f64>,
    /// λ_A: torque of the arms' drives at the gear output, N·m; positive torque drives a positive rate.
    pub lambda_a: ThreeArms<f64>,
}

impl Multipliers {
    /// All 21 multipliers in the order of (32): λ_E, λ_TB, λ_P, λ_S, λ_A.
    pub fn to_array(&self) -> [f64; MULTIPLIERS] {
        let mut all = [0.0; MULTIPLIERS];
        all[..5].copy_from_slice(&self.lambda_e);
        all[5] = self.lambda_tb;
        all[6..12].copy_from_slice(&self.lambda_p);
        all[12..18].copy_from_slice(&self.lambda_s);
        all[18..].copy_from_slice(&self.lambda_a);
        all
    }

    /// Names in the order of [`Multipliers::to_array`], e.g. `lambda_s3`.
    pub fn names() -> [String; MULTIPLIERS] {
        std::array::from_fn(|k| match k {
            0..5 => format!("lambda_e{}", k + 1),
            5 => "lambda_tb".into(),
            6..12 => format!("lambda_p{}", k - 5),
            12..18 => format!("lambda_s{}", k - 11),
            _ => format!("lambda_a{}", k - 17),
        })
    }

    /// Indices, in the order of [`Multipliers::to_array`], of those that a machine has: without a telescope nothing turns on
    /// the platform.
    pub fn of(machine: Mechanism) -> std::ops::Range<usize> {
        if machine.has_telescope() { 0..MULTIPLIERS } else { 6..MULTIPLIERS }
    }

    /// Unit of multiplier `k`, in the order of [`Multipliers::to_array`].
    pub fn unit(machine: Mechanism, k: usize) -> Unit {
        match k {
            0 | 1 | 5 => Unit::NM,
            2..18 => Unit::N,
            _ => machine.unit(Unit::NM),
        }
    }

    /// Drive torques and strut forces.
    pub fn output(&self) -> Output {
        let [a, b, c] = self.lambda_a;
        Output { tau: [a, b, c, self.lambda_tb], reactions: Reactions::of(&self.lambda_s, &self.lambda_p) }
    }
}

impl Borne for Multipliers {
    fn output(&self) -> Output {
        self.output()
    }
}
