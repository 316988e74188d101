//! Transformation of wrenches on the 14 bodies into loads on the reduced velocities.

use nalgebra::Vector3;

use super::{Loads, Multipliers, Statics};
use crate::dynamics::{Plant, borne, loaded_wrenches};
use crate::kinematics::{KinematicsError, Motion, Twist};
use crate::machine::bodies::{self, END_EFFECTOR, PLATFORM, ROTOR, SLOTS, TELESCOPE_LOWER, TELESCOPE_UPPER};
use crate::machine::six_struts;

/// Detail of the loads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Detail {
    /// Reduced model of the paper: struts loaded along their axes only, no telescope except the mass of its lower
    /// part at the platform. λ_TB is the torque on the end effector only.
    Reduced,
    /// All loads. Transverse loads on a strut are distributed to its two ends by the lever rule, loads on rotor and
    /// telescope are transmitted to the end effector through the lower Hooke joint. λ_A and λ_TB are then the drive
    /// torques of the inverse dynamics, and the multipliers those of the full multibody system including every
    /// effect.
    #[default]
    Complete,
}

/// Wrench on the end effector about the flange centre that is equivalent in power, for any twist of the end effector,
/// to `force` on the lower Hooke joint, `moment` on both telescope parts and `torque` on the rotor; N and N·m, inertial
/// axes.
fn handed_on(motion: &Motion, force: &Vector3<f64>, moment: &Vector3<f64>, torque: f64) -> Twist {
    let telescope = &motion.telescope;
    let [upper, lower] = motion.hooke_joints();
    // Rotor rate: ω_R z·n = ω_T·n at the upper joint; telescope spin: (ω_T − ω_E)·n = 0 at the lower one.
    let moment = moment + upper.normal * (torque / upper.normal.z);
    let passed = lower.passed(&moment, &telescope.axis);
    let force = force + telescope.axis.cross(&(moment - passed)) / telescope.length;
    let hooke = motion.bodies[TELESCOPE_LOWER].position - motion.bodies[END_EFFECTOR].position;
    (force, passed + hooke.cross(&force))
}

impl Statics {
    /// Equilibrium equations of `plant` for loads of the given detail. Without a telescope the end effector is fixed to the
    /// platform: λ_TB is the moment about its axis that the platform takes.
    ///
    /// # Errors
    /// [`KinematicsError::Singular`] if the struts do not determine the platform's pose.
    pub fn of(plant: &Plant, motion: &Motion, detail: Detail) -> Result<Self, KinematicsError> {
        let turns = detail == Detail::Complete && plant.mechanism.has_telescope();
        let drive = match turns {
            true => handed_on(motion, &Vector3::zeros(), &Vector3::zeros(), 1.0),
            false => (Vector3::zeros(), motion.bodies[END_EFFECTOR].rotation.column(2).into_owned()),
        };
        let mut statics = Self::new(motion, drive)?;
        (statics.detail, statics.turns) = (detail, turns);
        Ok(statics)
    }

    /// Loads of `wrenches` on the bodies (applied minus inertial, about their origins, inertial axes).
    ///
    /// In the reduced detail the wrenches on rotor and telescope are omitted.
    pub fn loads(&self, motion: &Motion, wrenches: &[Twist; SLOTS]) -> Loads {
        let mut loads = Loads {
            end_effector: wrenches[END_EFFECTOR],
            platform: wrenches[PLATFORM],
            struts: std::array::from_fn(|s| wrenches[bodies::strut(s)].0.dot(&motion.strut_axis[s])),
            arms: std::array::from_fn(|i| motion.drive(i).1.effort(&wrenches[bodies::arm(i)])),
        };
        if self.detail == Detail::Reduced {
            return loads;
        }
        for s in six_struts() {
            let (force, moment) = &wrenches[bodies::strut(s)];
            let (body, axis) = (&motion.bodies[bodies::strut(s)], &motion.strut_axis[s]);
            let lower = moment.cross(axis) / motion.strut_length[s];
            let upper = force - axis * loads.struts[s] - lower;
            let ball = body.position + axis * motion.strut_length[s] - motion.bodies[PLATFORM].position;
            loads.platform.0 += lower;
            loads.platform.1 += ball.cross(&lower);
            let lever = body.position - motion.bodies[bodies::arm(s / 2)].position;
            loads.arms[s / 2] += motion.drive(s / 2).1.effort(&(upper, lever.cross(&upper)));
        }
        if !self.turns {
            return loads;
        }
        let (force, moment) = wrenches[TELESCOPE_LOWER];
        let moment = moment + wrenches[TELESCOPE_UPPER].1;
        let (force, moment) = handed_on(motion, &force, &moment, wrenches[ROTOR].1.z);
        loads.end_effector.0 += force;
        loads.end_effector.1 += moment;
        loads
    }
}

/// Adds the weight and inertia of the lower telescope part to the platform, as in the reduced model.
fn telescope_on_platform(plant: &Plant, motion: &Motion, wrenches: &mut [Twist; SLOTS]) {
    let platform = &plant.bodies[PLATFORM];
    let centre = if platform.mass > 0.0 { platform.first_moment / platform.mass } else { Vector3::zeros() };
    let force = (plant.gravity_vector() - motion.bodies[PLATFORM].acceleration) * plant.bodies[TELESCOPE_LOWER].mass;
    wrenches[PLATFORM].0 += force;
    wrenches[PLATFORM].1 += (motion.bodies[PLATFORM].rotation * centre).cross(&force);
}

/// Weight minus inertial wrench of every body in the given detail.
pub(crate) fn rigid_loads(plant: &Plant, t: f64, motion: &Motion, detail: Detail) -> [Twist; SLOTS] {
    let mut wrenches = loaded_wrenches(plant, t, motion);
    if detail == Detail::Reduced {
        telescope_on_platform(plant, motion, &mut wrenches);
    }
    wrenches
}

/// Multipliers of an assembled robot for a motion, including all effects in the given detail.
///
/// `states` holds one slice of internal states per active effect (empty where the effect has none).
///
/// # Errors
/// [`KinematicsError::Singular`] if the struts do not determine the platform's pose, or the error of a force law.
pub fn constraint_forces(
    plant: &Plant,
    t: f64,
    motion: &Motion,
    states: &[&[f64]],
    detail: Detail,
) -> Result<Multipliers, KinematicsError> {
    let statics = Statics::of(plant, motion, detail)?;
    let solve = |wrenches: &[Twist; SLOTS]| statics.solve(&statics.loads(motion, wrenches));
    borne(plant, t, motion, states, rigid_loads(plant, t, motion, detail), solve)
}
