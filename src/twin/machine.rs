//! [`Twin`]: the machine with its state, advanced step by step.

use super::assembled::{self, Assembled, Scratch};
use super::forces::Forces;
use super::integrator::{RK4, ROS34PW2, Stepper, Tableau};
use super::layout::Layout;
use super::mechanism::Mechanism;
use super::reactions::JointReactions;
use super::torque::Torque;
use super::wrench::{STILL, Twist};
use super::{SingularPose, energy};
use crate::dynamics::Plant;
use crate::kinematics::{Motion, Reactions};
use crate::model::AXES;
use crate::model::bodies::BODIES;

/// What the equations of motion yield at one instant.
#[derive(Clone, Debug)]
pub struct Snapshot {
    /// Motion of all bodies with accelerations.
    pub motion: Motion,
    /// Axial strut forces.
    pub reactions: Reactions,
    /// What all joints transmit.
    pub joints: JointReactions,
}

/// The machine in motion.
pub struct Twin {
    plant: Plant,
    forces: Forces,
    mechanism: Mechanism,
    layout: Layout,
    /// No force law and no elasticity: nothing is steep, nothing turns the struts.
    smooth: bool,
    stepper: Stepper,
    scratch: Scratch,
    t: f64,
    y: Vec<f64>,
    external: [Twist; BODIES],
    start_energy: f64,
}

/// A state to return to.
#[derive(Clone, Debug, Default)]
pub struct Mark {
    t: f64,
    y: Vec<f64>,
    reactions: Reactions,
}

impl Twin {
    /// The machine at a motion at time 0; loops are closed exactly.
    pub fn new(plant: Plant, motion: &Motion) -> Result<Self, SingularPose> {
        let forces = Forces::new(&plant);
        let mechanism = Mechanism::new(&plant);
        let layout = Layout::new(assembled::LENGTH, forces.states(), plant.effects.len());
        let mut y = vec![0.0; layout.len()];
        let (mut pose, mut nu, spin) = mechanism.pose(motion);
        mechanism.close(&mut pose, &mut nu)?;
        assembled::store(&mut y, &pose, &nu, &spin);
        let mut at = layout.own().start;
        for active in &plant.effects {
            for x in active.effect.initial_state(&active.values()) {
                y[at] = x;
                at += 1;
            }
        }
        let smooth = plant.effects.iter().all(|a| a.effect.kind() != crate::effects::Kind::Force);
        let mut twin = Self {
            scratch: Scratch::new(&plant, &forces),
            stepper: Stepper::new(layout.len()),
            smooth: smooth && mechanism.springs.is_none(),
            plant,
            forces,
            mechanism,
            layout,
            t: 0.0,
            y,
            external: [STILL; BODIES],
            start_energy: 0.0,
        };
        twin.start_energy = twin.energy();
        Ok(twin)
    }

    fn system(&mut self, torque: Torque) -> (Assembled<'_>, &mut Stepper, &mut Vec<f64>) {
        (
            Assembled {
                plant: &self.plant,
                forces: &self.forces,
                mechanism: &self.mechanism,
                layout: self.layout,
                torque,
                external: &self.external,
                scratch: &mut self.scratch,
            },
            &mut self.stepper,
            &mut self.y,
        )
    }

    /// Advances by `h` seconds under drive torques. On an error the state stays as it was.
    pub fn step(&mut self, h: f64, torque: &Torque) -> Result<(), SingularPose> {
        let t = self.t;
        let tableau: &Tableau = if self.smooth && self.external.iter().all(|w| *w == STILL) { &RK4 } else { &ROS34PW2 };
        let (mut system, stepper, y) = self.system(*torque);
        stepper.step(tableau, &mut system, t, y, h)?;
        self.t = t + h;
        Ok(())
    }

    /// Accelerations, strut and socket forces now, under drive torques.
    pub fn evaluate(&mut self, torque: &Torque) -> Result<Snapshot, SingularPose> {
        let t = self.t;
        let (mut system, _, y) = self.system(*torque);
        let (frame, solution) = system.evaluate(t, y)?;
        let mut motion = frame.motion;
        let accelerations = self.mechanism.accelerations(&frame, &solution);
        for (body, (linear, angular)) in motion.bodies.iter_mut().zip(accelerations) {
            (body.acceleration, body.angular_acceleration) = (linear, angular);
        }
        motion.qdd.copy_from_slice(&solution.nu_rate.as_slice()[..AXES]);
        let mut wrenches = *self.scratch.applied();
        for (axis, torque) in torque.at(t).into_iter().enumerate() {
            let (body, direction) = Motion::drive(axis);
            wrenches[body].1 += direction * torque;
        }
        let joints = JointReactions::new(&self.plant, &motion, &wrenches, &solution.socket_force);
        Ok(Snapshot { motion, reactions: solution.reactions, joints })
    }

    /// Motion of all bodies now, without accelerations.
    pub fn motion(&self) -> Motion {
        let (pose, nu, spin) = assembled::pose(&self.y);
        self.mechanism.frame(&pose, &nu, &spin).motion
    }

    /// Machine it runs.
    pub fn plant(&self) -> &Plant {
        &self.plant
    }

    /// Time, s.
    pub fn time(&self) -> f64 {
        self.t
    }

    /// Sets the clock without moving anything.
    pub fn set_time(&mut self, t: f64) {
        self.t = t;
    }

    /// Wrenches from outside on all bodies (about their origins, world axes), held until set again.
    pub fn set_external(&mut self, wrenches: &[Twist; BODIES]) {
        self.external = *wrenches;
    }

    /// Angles the motor-side encoders see, rad.
    pub fn encoders(&self) -> [f64; AXES] {
        let own = &self.y[self.layout.own()];
        self.forces.encoders(&self.plant, own, &[self.y[0], self.y[1], self.y[2], self.y[3]])
    }

    /// Kinetic plus potential energy of the bodies, J.
    pub fn energy(&self) -> f64 {
        energy::total(&self.plant, &self.motion())
    }

    /// Work done on the bodies since the start, J: four drives, spin restraint, outside, elastic struts, each effect.
    pub fn work(&self) -> &[f64] {
        &self.y[self.layout.work()]
    }

    /// Energy that no work accounts for, J: zero but for the integrator's error.
    pub fn energy_balance(&self) -> f64 {
        self.energy() - self.start_energy - self.work().iter().sum::<f64>()
    }

    /// Largest change in the last iteration over load-dependent friction that did not converge, N.
    pub fn unconverged(&self) -> f64 {
        self.scratch.unconverged
    }

    /// Remembers the state in `mark`.
    pub fn save(&self, mark: &mut Mark) {
        mark.t = self.t;
        mark.y.clone_from(&self.y);
        mark.reactions = self.scratch.reactions;
    }

    /// Returns to a state.
    pub fn restore(&mut self, mark: &Mark) {
        self.t = mark.t;
        self.y.copy_from_slice(&mark.y);
        self.scratch.reactions = mark.reactions;
    }
}
