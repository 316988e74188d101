//! [`Twin`]: the machine with its state, advanced step by step.

use nalgebra::Vector3;

use super::absolute::{Absolute, Joints};
use super::assembled::{self, Assembled, FrameCache};
use super::axes::{self, Axes};
use super::closed::Mechanism;
use super::constraints::ROWS;
use super::contacts::Contacts;
use super::context::{Answer, Context, Scratch};
use super::forces::{Damping, Forces};
use super::integrator::{RK4, ROS34PW2, Stepper, Tableau};
use super::layout::Layout;
use super::maximal::{MAX_ROWS, MaximalCoordinates, momentum};
use super::reactions::JointReactions;
use super::stops::{Hit, STOPS};
use super::torque::Torque;
use super::wrench::{Load, STILL, Twist};
use super::{SingularPose, energy};
use crate::dynamics::Plant;
use crate::kinematics::{BodyMotion, KinematicsError, Motion, Reactions, SocketSet};
use crate::machine::bodies::{END_EFFECTOR, SLOTS};
use crate::machine::{Inertia, PerAxis, PerSocket, axes_from, every_axis};
use crate::scenario::Formulation;

/// Solution of the equations of motion at one instant.
#[derive(Clone, Debug)]
pub struct Snapshot {
    /// Motion of all bodies with accelerations; the link side of elastic gears.
    pub motion: Motion,
    /// Rates of the axes on the motor side, rad/s.
    pub encoder_rate: PerAxis<f64>,
    /// Accelerations of the axes on the motor side, rad/s².
    pub encoder_acceleration: PerAxis<f64>,
    /// Axial strut forces, N.
    pub reactions: Reactions,
    /// Force on each strut at its sockets (six upper, six lower), N, inertial axes.
    pub sockets: PerSocket<Vector3<f64>>,
    /// Applied wrenches on all bodies, including the drive torques.
    wrenches: [Twist; SLOTS],
    /// Multiplier λ of every row; `None` in the eliminated formulation.
    multipliers: Option<[f64; MAX_ROWS]>,
}

impl Snapshot {
    /// Reactions of all joints: 74 independent numbers.
    pub fn joints(&self, plant: &Plant) -> JointReactions {
        JointReactions::new(plant, &self.motion, &self.wrenches, &self.sockets)
    }
}

/// The machine with its state.
pub struct Twin {
    context: Context,
    form: Form,
    /// Whether there is neither a force law nor elasticity: nothing is stiff, and the struts are not made to spin.
    smooth: bool,
    stepper: Stepper,
    /// Method and length (s) of the last step.
    last: Option<(&'static Tableau, f64)>,
    t: f64,
    y: Vec<f64>,
    /// Energy at the start, plus energy added or lost instantaneously since then, J.
    reference_energy: f64,
}

/// Form of the equations of motion.
enum Form {
    /// Rows of the assembled robot eliminated in closed form.
    Assembled(Box<Mechanism>, FrameCache),
    /// Independent axes: bearings only, eliminated.
    Axes(Box<axes::Work>),
    /// All bodies, all rows.
    Absolute(Box<Joints>),
}

/// A stored state, valid while no further socket opens.
#[derive(Clone, Debug, Default)]
pub struct Checkpoint {
    t: f64,
    y: Vec<f64>,
    answer: Answer,
    damping: Damping,
}

impl Twin {
    /// The machine at a motion at time 0 in the eliminated formulation; loops are closed exactly.
    ///
    /// # Errors
    /// [`SingularPose`] if the loops cannot be closed there.
    pub fn new(plant: Plant, motion: &Motion) -> Result<Self, SingularPose> {
        Self::formulated(plant, motion, Formulation::Eliminated)
    }

    /// The machine at a motion at time 0 in either formulation; loops are closed exactly.
    ///
    /// # Errors
    /// [`SingularPose`] if the loops cannot be closed there.
    pub fn formulated(plant: Plant, motion: &Motion, formulation: Formulation) -> Result<Self, SingularPose> {
        let mut twin = Self::eliminated(plant, motion)?;
        // Of plates with other limbs the eliminated form has rigid struts.
        let plant = twin.plant();
        let elastic = !plant.is_closed_delta() && plant.effects.iter().any(|a| a.strut_spring().is_some());
        if formulation == Formulation::Absolute || elastic {
            twin.go_absolute()?;
        }
        Ok(twin)
    }

    fn eliminated(plant: Plant, motion: &Motion) -> Result<Self, SingularPose> {
        let forces = Forces::new(&plant);
        let (loops, closed) = (plant.is_closed_delta(), plant.sockets());
        let length = if loops { assembled::LENGTH } else { axes::LENGTH };
        let layout = Layout::new(length, forces.states(), plant.effects.len());
        let mut y = vec![0.0; layout.len()];
        let mut elastic = false;
        let form = if loops {
            let mechanism = Mechanism::new(&plant);
            let (mut pose, mut nu, spin) = mechanism.pose(motion);
            mechanism.close(&mut pose, &mut nu)?;
            assembled::store(&mut y, &pose, &nu, &spin);
            elastic = mechanism.springs.is_some();
            Form::Assembled(Box::new(mechanism), FrameCache::default())
        } else {
            axes::store(&plant, &mut y, motion)?;
            Form::Axes(Box::new(axes::Work::new(&plant)))
        };
        let own = plant.steady_states(0.0, motion).concat();
        y[layout.own()].copy_from_slice(&own);
        let smooth = plant.effects.iter().all(|a| a.effect.kind() != crate::effects::Kind::Force);
        let mut twin = Self {
            stepper: Stepper::new(layout.len()),
            last: None,
            smooth: smooth && !elastic,
            form,
            context: Context {
                scratch: Scratch::new(&plant, &forces),
                plant,
                forces,
                layout,
                torque: Torque::default(),
                external: Load::NONE,
                closed,
            },
            t: 0.0,
            y,
            reference_energy: 0.0,
        };
        twin.reference_energy = twin.energy();
        Ok(twin)
    }

    /// Sets the initial deflections of elastic gears, rad; they are zero otherwise.
    pub fn deflect_gears(&mut self, deflection: &PerAxis<f64>) {
        let mut at = self.context.layout.own().start;
        for active in &self.context.plant.effects {
            if active.gear_springs().is_some() {
                self.y[axes_from(at)].copy_from_slice(deflection);
            }
            at += active.states();
        }
        self.reference_energy = self.energy();
    }

    /// Advances the state by `h` seconds under drive torques; on an error it is unchanged.
    ///
    /// # Errors
    /// [`SingularPose`] if the equations of motion cannot be solved in a stage or the state cannot be projected onto
    /// the constraints.
    pub fn step(&mut self, h: f64, torque: &Torque) -> Result<(), SingularPose> {
        self.advance(h, torque, None)
    }

    /// [`Self::step`] of a broken robot with wrenches of `contacts` at every stage; afterwards they are the external
    /// ones.
    ///
    /// # Errors
    /// As for [`Self::step`].
    pub(super) fn step_touching(
        &mut self,
        h: f64,
        torque: &Torque,
        contacts: &mut (dyn Contacts + 'static),
    ) -> Result<(), SingularPose> {
        self.advance(h, torque, Some(&mut *contacts))?;
        self.context.external = Load::constant(*contacts.wrenches(&self.motion(), self.context.closed));
        Ok(())
    }

    fn advance(
        &mut self,
        h: f64,
        torque: &Torque,
        contacts: Option<&mut (dyn Contacts + 'static)>,
    ) -> Result<(), SingularPose> {
        let Self { context, form, stepper, y, t, smooth, .. } = self;
        context.torque = *torque;
        let steep = context.forces.are_gears_steep(ROS34PW2.gamma * h);
        // Struts with an open socket may spin, and their restraint is stiff.
        let calm = *smooth && context.external.is_none() && context.closed == context.plant.sockets();
        let tableau: &'static Tableau = if calm && !steep { &RK4 } else { &ROS34PW2 };
        match form {
            Form::Assembled(mechanism, cache) => {
                stepper.step(tableau, &mut Assembled { context, mechanism, cache }, *t, y, h)?;
            }
            Form::Axes(work) => stepper.step(tableau, &mut Axes { context, work }, *t, y, h)?,
            Form::Absolute(joints) => stepper.step(tableau, &mut Absolute { context, joints, contacts }, *t, y, h)?,
        }
        self.t += h;
        self.last = Some((tableau, h));
        self.invalidate();
        Ok(())
    }

    /// Largest estimated error of a position or velocity in the last step: m, rad, m/s or rad/s. Zero for a method
    /// without an estimate.
    pub fn step_error(&self) -> f64 {
        self.last.map_or(0.0, |(tableau, h)| self.stepper.error(tableau, h, self.context.layout.own().start))
    }

    /// Accelerations, strut forces and joint forces now, under drive torques; the evaluation does not influence later
    /// results.
    ///
    /// # Errors
    /// [`SingularPose`] if the equations of motion cannot be solved.
    pub fn evaluate(&mut self, torque: &Torque) -> Result<Snapshot, SingularPose> {
        let guess = self.context.scratch.answer;
        let snapshot = self.snapshot(torque);
        self.context.scratch.answer = guess;
        snapshot
    }

    fn snapshot(&mut self, torque: &Torque) -> Result<Snapshot, SingularPose> {
        let Self { context, form, y, t, .. } = self;
        context.torque = *torque;
        let mut multipliers = None;
        let (mut motion, reactions, sockets) = match form {
            Form::Assembled(mechanism, cache) => {
                let (motion, solution) = Assembled { context, mechanism, cache }.evaluate(*t, y)?;
                (motion, solution.reactions, solution.socket_force)
            }
            Form::Absolute(joints) => {
                let (motion, solution) = Absolute { context, joints, contacts: None }.evaluate(*t, y)?;
                multipliers = Some(solution.multipliers);
                (motion, solution.reactions, solution.socket_force)
            }
            Form::Axes(work) => {
                let (motion, sockets) = Axes { context, work }.evaluate(*t, y)?;
                (motion, context.scratch.answer.reactions, sockets)
            }
        };
        let mut wrenches = *self.context.loads();
        for (axis, torque) in torque.at(self.t).into_iter().enumerate() {
            let (body, screw) = motion.drive(axis);
            motion.qdd[axis] = screw.rate(&motion.bodies[body].acceleration, &motion.bodies[body].angular_acceleration);
            screw.push(&mut wrenches[body], torque);
        }
        let [encoder_rate, encoder_acceleration] = self.context.of_encoders(self.t, &self.y, &motion);
        Ok(Snapshot { motion, encoder_rate, encoder_acceleration, reactions, sockets, wrenches, multipliers })
    }

    /// Invalidates the last evaluation.
    fn invalidate(&mut self) {
        match &mut self.form {
            Form::Assembled(_, cache) => cache.invalidate(),
            Form::Axes(work) => work.invalidate(),
            Form::Absolute(_) => {}
        }
    }

    /// Present motion of all bodies, without accelerations.
    pub fn motion(&self) -> Motion {
        match &self.form {
            Form::Assembled(mechanism, _) => assembled::motion(mechanism, &self.y),
            Form::Absolute(joints) => joints.motion(&self.context.plant, &self.y),
            Form::Axes(_) => self.context.in_drives(&self.y),
        }
    }

    /// Opens a ball socket: its rows are removed, and the run continues in absolute coordinates.
    ///
    /// # Errors
    /// [`SingularPose`] if the present pose is singular.
    pub fn open(&mut self, socket: usize) -> Result<(), SingularPose> {
        self.go_absolute()?;
        self.invalidate();
        self.context.closed = self.context.closed.without(socket);
        Ok(())
    }

    /// Changes to absolute coordinates.
    fn go_absolute(&mut self) -> Result<(), SingularPose> {
        let balance = self.energy_balance();
        let context = &mut self.context;
        let motion = match &self.form {
            Form::Assembled(mechanism, _) => assembled::motion(mechanism, &self.y),
            Form::Axes(_) => context.in_drives(&self.y),
            Form::Absolute(_) => return Ok(()),
        };
        let mut joints = Joints::new(&context.plant);
        let layout = Layout::new(joints.length(), context.forces.states(), context.plant.effects.len());
        let mut y = vec![0.0; layout.len()];
        joints.store(&mut y, &context.plant, &motion);
        y[layout.own().start..].copy_from_slice(&self.y[context.layout.own().start..]);
        joints.close(&context.plant, &mut y, context.closed)?;
        context.layout = layout;
        context.scratch.damping = Damping::default();
        self.stepper = Stepper::new(layout.len());
        self.last = None;
        self.y = y;
        self.form = Form::Absolute(Box::new(joints));
        self.reference_energy += self.energy_balance() - balance;
        Ok(())
    }

    /// Multipliers λ of all rows of a robot with three limbs at the instant of `snapshot`, which must be the last evaluation: N or N·m, in the
    /// order of [`constraints::rows`](super::constraints::rows), zero for open sockets. In the eliminated formulation
    /// they are computed here.
    ///
    /// # Errors
    /// [`SingularPose`] if the pose is singular.
    pub fn multipliers(&self, snapshot: &Snapshot) -> Result<[f64; ROWS], SingularPose> {
        let plant = &self.context.plant;
        let all = match snapshot.multipliers {
            Some(known) => known,
            None => Joints::new(plant).multipliers(plant, &snapshot.motion, self.context.closed, &snapshot.wrenches)?,
        };
        Ok(std::array::from_fn(|row| all[row]))
    }

    /// Whether all sockets are closed.
    pub fn is_whole(&self) -> bool {
        self.context.closed == self.context.plant.sockets()
    }

    /// Closed sockets.
    pub fn closed(&self) -> SocketSet {
        self.context.closed
    }

    /// Attaches a body to the end effector; the velocities change instantaneously such that momentum is conserved.
    ///
    /// `inertia` is in the end effector's frame; `twist` (inertial axes) is the velocity (m/s) of the body's material
    /// point at the end effector's origin, and the body's angular velocity (rad/s).
    ///
    /// # Errors
    /// [`SingularPose`] if the impulse equations cannot be solved or the loops cannot be closed.
    pub fn attach(&mut self, inertia: &Inertia, twist: &Twist) -> Result<(), SingularPose> {
        let balance = self.energy_balance();
        let motion = self.motion();
        let mut joined = self.context.plant.clone();
        let (carrier, inertia) = joined.carrier(END_EFFECTOR, *inertia);
        joined.bodies[carrier] += inertia;
        let mut impulses = [STILL; SLOTS];
        let lever = motion.bodies[carrier].position - motion.bodies[END_EFFECTOR].position;
        let velocity = twist.0 + twist.1.cross(&lever);
        let brought = BodyMotion { velocity, angular_velocity: twist.1, ..motion.bodies[carrier] };
        impulses[carrier] = momentum(&inertia, &brought);
        let mut solver = MaximalCoordinates::new(&joined);
        let before = &self.context.plant.bodies;
        let after = solver.impulse(&joined, before, &motion.bodies, self.context.closed, &impulses)?.clone();
        let mut moved = motion;
        for &b in solver.bodies() {
            (moved.bodies[b].velocity, moved.bodies[b].angular_velocity) = after.bodies[b];
        }
        for axis in every_axis() {
            let (body, screw) = moved.drive(axis);
            moved.qd[axis] = screw.rate_of(&moved.bodies[body]);
        }
        self.context.plant = joined;
        self.reload(Some(&moved))?;
        self.reference_energy += self.energy_balance() - balance;
        Ok(())
    }

    /// Detaches a body with this inertia; the velocities are unchanged.
    ///
    /// # Errors
    /// None at present: only a change of velocities can fail.
    pub fn detach(&mut self, inertia: &Inertia) -> Result<(), SingularPose> {
        let balance = self.energy_balance();
        let (carrier, inertia) = self.context.plant.carrier(END_EFFECTOR, *inertia);
        self.context.plant.bodies[carrier] += inertia * -1.0;
        self.reload(None)?;
        self.reference_energy += self.energy_balance() - balance;
        Ok(())
    }

    /// Stops all bodies where they are; the kinetic energy is lost instantaneously.
    pub fn halt(&mut self) {
        self.invalidate();
        let balance = self.energy_balance();
        let rates = match &self.form {
            Form::Assembled(..) => assembled::RATES,
            Form::Axes(_) => axes::RATES,
            Form::Absolute(joints) => {
                joints.stop(&mut self.y);
                0..0
            }
        };
        self.y[rates].fill(0.0);
        self.reference_energy += self.energy_balance() - balance;
    }

    fn reload(&mut self, moved: Option<&Motion>) -> Result<(), SingularPose> {
        self.invalidate();
        match &mut self.form {
            Form::Assembled(mechanism, _) => {
                **mechanism = Mechanism::new(&self.context.plant);
                if let Some(motion) = moved {
                    let (mut pose, ..) = assembled::pose(&self.y);
                    let (_, mut nu, spin) = mechanism.pose(motion);
                    mechanism.close(&mut pose, &mut nu)?;
                    assembled::store(&mut self.y, &pose, &nu, &spin);
                }
            }
            Form::Absolute(joints) => {
                **joints = Joints::new(&self.context.plant);
                if let Some(motion) = moved {
                    joints.store_velocities(&mut self.y, motion, self.context.closed);
                    joints.close(&self.context.plant, &mut self.y, self.context.closed)?;
                }
            }
            Form::Axes(_) => {
                if let Some(motion) = moved {
                    self.y[axes::RATES].copy_from_slice(&motion.qd);
                }
            }
        }
        Ok(())
    }

    /// The simulated machine.
    pub fn plant(&self) -> &Plant {
        &self.context.plant
    }

    /// Time, s.
    pub fn time(&self) -> f64 {
        self.t
    }

    /// Sets the time without changing the state.
    pub fn set_time(&mut self, t: f64) {
        if t != self.t {
            self.invalidate();
        }
        self.t = t;
    }

    /// Sets external wrenches on all bodies (about their origins, inertial axes), valid until the next call.
    pub fn set_external(&mut self, load: Load) {
        if !(self.context.external.is_none() && load.is_none()) {
            self.invalidate();
        }
        self.context.external = load;
    }

    /// Present external wrenches.
    pub fn external_now(&self) -> [Twist; SLOTS] {
        if self.context.external.is_none() { [STILL; SLOTS] } else { self.context.external.at(self.t) }
    }

    /// Applies brakes on all drives that resist motion with up to `torque` N·m.
    pub fn set_brake(&mut self, torque: f64) {
        self.invalidate();
        self.context.forces.brake = torque;
        self.smooth = false;
    }

    /// Encoder angles (motor side), rad.
    pub fn encoders(&self) -> PerAxis<f64> {
        let q = match &self.form {
            Form::Assembled(..) | Form::Axes(_) => [self.y[0], self.y[1], self.y[2], self.y[3]],
            Form::Absolute(joints) => joints.coordinates(&self.y),
        };
        self.context.forces.encoders(&self.context.plant, &self.y[self.context.layout.own()], &q)
    }

    /// Error of the first law whose value was not finite, if any.
    pub fn fault(&self) -> Option<KinematicsError> {
        self.context.scratch.fault.clone()
    }

    /// Kinetic plus potential energy of the bodies, J.
    pub fn energy(&self) -> f64 {
        self.energy_at(&self.motion())
    }

    /// Energy for the present motion, passed to avoid its computation.
    fn energy_at(&self, motion: &Motion) -> f64 {
        let stretch = match &self.form {
            Form::Assembled(mechanism, _) => mechanism.stretch_energy(&self.context.plant, motion),
            Form::Absolute(joints) => joints.stretch_energy(&self.context.plant, motion, &self.y),
            Form::Axes(_) => 0.0,
        };
        energy::total(&self.context.plant, motion) + stretch
    }

    /// Internal states of all effects, in order.
    pub fn internal_states(&self) -> &[f64] {
        &self.y[self.context.layout.own()]
    }

    /// Work on the bodies since the start, J: four drives, spin restraint and brakes, external wrenches, elastic
    /// struts, hard stops, each effect.
    pub fn work(&self) -> &[f64] {
        &self.y[self.context.layout.work()]
    }

    /// Energy minus initial energy minus work, J: zero except for the integration error.
    pub fn energy_balance(&self) -> f64 {
        self.energy_balance_at(&self.motion())
    }

    /// [`Self::energy_balance`] for the present motion, passed to avoid its computation.
    pub fn energy_balance_at(&self, motion: &Motion) -> f64 {
        self.energy_at(motion) - self.reference_energy - self.work().iter().sum::<f64>()
    }

    /// Joints beyond their hard stops at the last evaluation; a step ends with one.
    pub fn hits(&self) -> &[Option<Hit>; STOPS] {
        &self.context.scratch.hits
    }

    /// Largest change in the last iteration over laws that depend on the solution, of evaluations that did not
    /// converge, N, rad/s² or m/s²; zero if all converged.
    pub fn unconverged(&self) -> f64 {
        self.context.scratch.unconverged
    }

    /// Number of solutions of the equations of motion so far.
    pub fn solutions(&self) -> usize {
        self.context.scratch.solutions
    }

    /// Number of Newton corrections so far that project states onto the constraints after steps.
    pub fn corrections(&self) -> usize {
        self.context.scratch.corrections
    }

    /// Stores the state in `checkpoint`.
    pub fn save(&self, checkpoint: &mut Checkpoint) {
        checkpoint.t = self.t;
        checkpoint.y.clone_from(&self.y);
        checkpoint.answer = self.context.scratch.answer;
        checkpoint.damping = self.context.scratch.damping;
    }

    /// Restores a stored state; the set of closed sockets is not part of it.
    ///
    /// # Panics
    /// If the run has changed to absolute coordinates since.
    pub fn restore(&mut self, checkpoint: &Checkpoint) {
        self.invalidate();
        self.t = checkpoint.t;
        self.y.copy_from_slice(&checkpoint.y);
        self.context.scratch.answer = checkpoint.answer;
        self.context.scratch.damping = checkpoint.damping;
    }
}
