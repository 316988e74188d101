//! Where the model would be: the motion that the measured torques give it.
//!
//! The model follows the measured motion under its own torques τ_model. Under the measured ones it gains
//!
//! `δq̈ = M(q)⁻¹·(τ_measured − τ_model)`, rad/s² (m/s²),
//!
//! M the inertia matrix of the model, N·m·s²/rad. From one release to the next, [`RELEASE`] s later, this adds up to the
//! deviation δq from the measured motion; then the model starts anew at the measured state. How the torques of the
//! model change along δq (gravity, damping) is left out: of second order in a time this short.

use nalgebra::{DMatrix, DVector, Isometry3};

use deltatwin::dynamics::{Plant, steady_inverse_dynamics};
use deltatwin::kinematics::{JointState, KinematicsError};
use deltatwin::machine::bodies::SLOTS;
use deltatwin::machine::{Joint, PerAxis, each};

/// Time after which the model is put back to the measured state, s.
pub const RELEASE: f64 = 0.2;
/// Factors by which deviations may be enlarged.
const FACTORS: [f64; 5] = [1.0, 2.0, 5.0, 10.0, 20.0];
/// Length of a lever that turns deviations into distances, m, and the largest distance that is shown, m.
const LEVER: f64 = 0.35;
const LARGEST: f64 = 0.08;

/// Inertia matrix of the model at a pose, N·m·s²/rad, column by column from its inverse dynamics.
fn inertia(plant: &Plant, t: f64, q: PerAxis<f64>) -> Result<DMatrix<f64>, KinematicsError> {
    let axes = plant.mechanism.axes();
    let torque = |qdd: PerAxis<f64>| {
        let motion = plant.motion(&JointState { q, qd: each(0.0), qdd })?;
        Ok(steady_inverse_dynamics(plant, t, &motion, false)?.tau)
    };
    let rest = torque(each(0.0))?;
    let mut matrix = DMatrix::zeros(axes, axes);
    for j in 0..axes {
        let with = torque(std::array::from_fn(|i| if i == j { 1.0 } else { 0.0 }))?;
        for i in 0..axes {
            matrix[(i, j)] = with[i] - rest[i];
        }
    }
    Ok(matrix)
}

/// Deviation of the model from the measured motion, rad (m), at every frame: times `t`, s, measured motion `joints`,
/// `residual` of the axes, N·m (N).
///
/// # Errors
/// If the inverse dynamics fail at a measured pose.
pub fn deviations(
    plant: &Plant,
    t: &[f64],
    joints: &[JointState],
    residual: &[PerAxis<f64>],
) -> Result<Vec<PerAxis<f64>>, KinematicsError> {
    let axes = plant.mechanism.axes();
    let mut all = Vec::with_capacity(t.len());
    let (mut moved, mut rate): (PerAxis<f64>, PerAxis<f64>) = Default::default();
    let mut released = t.first().copied().unwrap_or(0.0);
    for k in 0..t.len() {
        if t[k] - released >= RELEASE - 1e-9 {
            (moved, rate, released) = (each(0.0), each(0.0), t[k]);
        }
        all.push(moved);
        let h = t.get(k + 1).map_or(0.0, |next| next - t[k]);
        // A gap in the recording.
        if h > RELEASE {
            (moved, rate, released) = (each(0.0), each(0.0), t[k + 1]);
            continue;
        }
        let unbalanced = DVector::from_column_slice(&residual[k][..axes]);
        let Some(gained) = inertia(plant, t[k], joints[k].q)?.lu().solve(&unbalanced) else { continue };
        for i in 0..axes {
            moved[i] += h * rate[i] + 0.5 * h * h * gained[i];
            rate[i] += h * gained[i];
        }
    }
    Ok(all)
}

/// Factor by which `deviations` of the plant are shown: the largest that keeps them within a hand's breadth.
pub fn factor(plant: &Plant, deviations: &[PerAxis<f64>]) -> f64 {
    let length = if plant.mechanism.joint() == Joint::Prismatic { 1.0 } else { LEVER };
    let largest = deviations.iter().flatten().fold(0.0f64, |most, x| most.max(length * x.abs()));
    FACTORS.into_iter().rfind(|factor| factor * largest <= LARGEST).unwrap_or(FACTORS[0])
}

/// Poses of the model, its `deviations` times `factor` away from the measured motion `joints`; the measured one where it
/// cannot be.
///
/// # Errors
/// If the kinematics fail at a measured pose.
pub fn poses(
    plant: &Plant,
    joints: &[JointState],
    deviations: &[PerAxis<f64>],
    factor: f64,
) -> Result<Vec<[Isometry3<f64>; SLOTS]>, KinematicsError> {
    let one = |(measured, deviation): (&JointState, &PerAxis<f64>)| {
        let q = std::array::from_fn(|i| measured.q[i] + factor * deviation[i]);
        let motion = plant.motion(&JointState { q, ..*measured }).or_else(|_| plant.motion(measured))?;
        Ok(motion.shown(plant.mechanism))
    };
    joints.iter().zip(deviations).map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    use deltatwin::machine::Setup;

    fn servo() -> Plant {
        let model = deltatwin_io::model::read(Path::new("../../models/servo-axis.toml")).unwrap();
        Plant::new(&model, &Setup::default())
    }

    /// A constant force F on a lone mass m: ½ F/m t² until the release, then zero.
    #[test]
    fn a_constant_force_moves_a_mass_along_a_parabola() {
        let plant = servo();
        let mass = inertia(&plant, 0.0, each(0.0)).unwrap()[(0, 0)];
        let t: Vec<f64> = (0..30).map(|k| 0.01 * f64::from(k)).collect();
        let joints = vec![JointState::default(); t.len()];
        let force = vec![[3.0, 0.0, 0.0, 0.0]; t.len()];
        let moved = deviations(&plant, &t, &joints, &force).unwrap();
        for (t, moved) in t.iter().zip(&moved).take(20) {
            assert!((moved[0] - 0.5 * 3.0 / mass * t * t).abs() < 1e-12, "{t}: {}", moved[0]);
        }
        assert_eq!(moved[20], each(0.0), "released");
        assert!((moved[25][0] - moved[5][0]).abs() < 1e-12);
        let size = moved.iter().fold(0.0f64, |most, x| most.max(x[0]));
        let factor = factor(&plant, &moved);
        assert!(factor * size <= LARGEST || factor == 1.0);
    }
}
