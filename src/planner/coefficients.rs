//! Torques and constraint forces along a path as A s̈ + B ṡ² + C + D ṡ, (41) and (42) of the paper.
//!
//! Inertia gives A, inertia and velocity products give B, weight gives C, all exactly. Friction and all other force
//! laws are written as C + D ṡ at a reference speed: exact there for any law, exact everywhere for viscous friction,
//! and a tangent otherwise (Coulomb, saturating, quadratic, …). Laws that depend on torques or strut forces use those
//! of the reference motion.

use super::PathPoint;
use super::limits::{self, LOADS};
use crate::constraint_forces::{Detail, Multipliers, Statics, rigid_loads};
use crate::dynamics::{Output, Plant, add_effects, balance, reads_loads, steady_inverse_dynamics};
use crate::kinematics::{KinematicsError, Motion, STILL, Twist};
use crate::machine::bodies::SLOTS;

/// Coefficients of the four torques (N·m), λ_E (N·m, N), λ_P and λ_S (N) at a point of a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coefficients {
    /// Per s̈.
    pub a: [f64; LOADS],
    /// Per ṡ².
    pub b: [f64; LOADS],
    /// Constant.
    pub c: [f64; LOADS],
    /// Per ṡ.
    pub d: [f64; LOADS],
}

/// Motion at which force laws are linearised.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reference {
    /// ṡ, positive, 1/s.
    pub speed: f64,
    /// s̈, 1/s².
    pub acceleration: f64,
}

/// Dynamics as used by the planner: a plant, the same plant without gravity, and the detail of the constraint forces.
pub struct Machine<'a> {
    plant: &'a Plant,
    /// The plant without gravity.
    weightless: Plant,
    detail: Detail,
}

/// Relative step of the speed in the difference quotient of a force law.
const SPEED_STEP: f64 = 0.01;
/// Fixed-point iterations for laws that depend on loads.
const LOAD_ITERATIONS: usize = 4;

impl<'a> Machine<'a> {
    /// The dynamics of `plant` with constraint forces in `detail`.
    pub fn new(plant: &'a Plant, detail: Detail) -> Self {
        let weightless = Plant { gravity: 0.0, ..plant.clone() };
        Self { plant, weightless, detail }
    }

    /// The plant.
    pub fn plant(&self) -> &Plant {
        self.plant
    }

    /// Coefficients of torques and constraint forces at a point of the path.
    ///
    /// Force laws are linearised in the speed at `reference`; laws that depend on loads use those of the reference
    /// motion.
    ///
    /// # Errors
    ///
    /// The error of the kinematics where the constraint forces are indeterminate.
    pub fn coefficients(&self, point: &PathPoint, reference: Reference) -> Result<Coefficients, KinematicsError> {
        let geometry = &self.plant.geometry;
        let unit = point.unit_acceleration(geometry);
        let solver = Solver::new(self.plant, &unit, self.detail)?;
        let a = solver.rigid(&self.weightless, &unit)?;
        let pace = point.motion(geometry, 1.0, 0.0);
        let b = solver.rigid(&self.weightless, &pace)?;
        let with_weight = solver.rigid(self.plant, &unit)?;
        let mut c: [f64; LOADS] = std::array::from_fn(|k| with_weight[k] - a[k]);
        let mut d = [0.0; LOADS];
        if !self.plant.effects.is_empty() {
            let Reference { speed, acceleration } = reference;
            let step = SPEED_STEP * speed;
            let at = |speed: f64| Motion::along(&pace, &unit, speed, acceleration);
            let (here, ahead) = (at(speed), at(speed + step));
            let laws = |motion: &Motion, loads: Option<&Output>, mut wrenches| -> Result<_, KinematicsError> {
                let own = self.plant.steady_states(0.0, motion);
                let states: Vec<&[f64]> = own.iter().map(Vec::as_slice).collect();
                add_effects(self.plant, 0.0, motion, &states, None, &mut wrenches)?;
                if let Some(loads) = loads {
                    add_effects(self.plant, 0.0, motion, &states, Some(loads), &mut wrenches)?;
                }
                Ok(wrenches)
            };
            let mut loads = None;
            if self.plant.effects.iter().any(reads_loads) {
                let rigid = rigid_loads(self.plant, 0.0, &here, Detail::Complete);
                for _ in 0..LOAD_ITERATIONS {
                    let wrenches = laws(&here, loads.as_ref(), rigid)?;
                    loads = Some(solver.output(&here, &wrenches)?);
                }
            }
            let [now, next] =
                [&here, &ahead].map(|motion| solver.solve(motion, &laws(motion, loads.as_ref(), [STILL; SLOTS])?));
            let (now, next) = (now?, next?);
            for k in 0..LOADS {
                d[k] = (next[k] - now[k]) / step;
                c[k] += now[k] - d[k] * speed;
            }
        }
        Ok(Coefficients { a, b, c, d })
    }

    /// Torques (N·m), λ_E (N·m, N), λ_P and λ_S (N) of a motion by the full nonlinear model.
    ///
    /// # Errors
    ///
    /// The error of the kinematics where the constraint forces are indeterminate.
    pub fn loads(&self, motion: &Motion) -> Result<[f64; LOADS], KinematicsError> {
        use crate::constraint_forces::constraint_forces;
        if !self.plant.is_closed_delta() {
            return Ok(of_plate(&steady_inverse_dynamics(self.plant, 0.0, motion, true)?));
        }
        let own = self.plant.steady_states(0.0, motion);
        let states: Vec<&[f64]> = own.iter().map(Vec::as_slice).collect();
        let complete = constraint_forces(self.plant, 0.0, motion, &states, Detail::Complete)?;
        Ok(match self.detail {
            Detail::Complete => join(&complete, &complete),
            detail => join(&complete, &constraint_forces(self.plant, 0.0, motion, &states, detail)?),
        })
    }
}

fn join(torques: &Multipliers, limited: &Multipliers) -> [f64; LOADS] {
    limits::loads(&torques.output().tau, &limited.lambda_e, &limited.output())
}

/// Loads of a machine whose end effector has no bearing of its own.
fn of_plate(output: &Output) -> [f64; LOADS] {
    limits::loads(&output.tau, &Default::default(), output)
}

/// Equilibrium equations: torques always from the complete loads, constraint forces from the requested detail.
enum Solver<'a> {
    /// Three limbs and one platform.
    Three { complete: Box<Statics>, reduced: Option<Box<Statics>> },
    /// Any plate.
    Plate(&'a Plant),
}

impl<'a> Solver<'a> {
    fn new(plant: &'a Plant, motion: &Motion, detail: Detail) -> Result<Self, KinematicsError> {
        if !plant.is_closed_delta() {
            return Ok(Self::Plate(plant));
        }
        let of = |detail: Detail| Statics::of(plant, motion, detail).map(Box::new);
        let reduced = (detail == Detail::Reduced).then(|| of(Detail::Reduced)).transpose()?;
        Ok(Self::Three { complete: of(Detail::Complete)?, reduced })
    }

    /// Torques and strut forces from the complete loads.
    fn output(&self, motion: &Motion, wrenches: &[Twist; SLOTS]) -> Result<Output, KinematicsError> {
        match self {
            Self::Plate(plant) => balance(plant, motion, wrenches),
            Self::Three { complete, .. } => Ok(complete.solve(&complete.loads(motion, wrenches)).output()),
        }
    }

    fn solve(&self, motion: &Motion, wrenches: &[Twist; SLOTS]) -> Result<[f64; LOADS], KinematicsError> {
        self.of_details(motion, wrenches, || *wrenches)
    }

    /// Torques and constraint forces due to inertia and weight alone.
    fn rigid(&self, plant: &Plant, motion: &Motion) -> Result<[f64; LOADS], KinematicsError> {
        let wrenches = rigid_loads(plant, 0.0, motion, Detail::Complete);
        self.of_details(motion, &wrenches, || rigid_loads(plant, 0.0, motion, Detail::Reduced))
    }

    fn of_details(
        &self,
        motion: &Motion,
        wrenches: &[Twist; SLOTS],
        fewer: impl Fn() -> [Twist; SLOTS],
    ) -> Result<[f64; LOADS], KinematicsError> {
        let Self::Three { complete, reduced } = self else { return Ok(of_plate(&self.output(motion, wrenches)?)) };
        let complete = complete.solve(&complete.loads(motion, wrenches));
        Ok(match reduced {
            None => join(&complete, &complete),
            Some(statics) => join(&complete, &statics.solve(&statics.loads(motion, &fewer()))),
        })
    }
}
