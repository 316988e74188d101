//! The machine in absolute coordinates as a system of differential equations: fourteen bodies, 84 velocities, every
//! closed joint as constraint rows.
//!
//! Used for a whole run on request, and from the first dislocation on. Poses and velocities of all bodies are
//! integrated, orientations as rotations exp(θ) of the orientation at the start of the step (Runge–Kutta–Munthe-Kaas
//! [Munthe-Kaas 1998]: θ̇ = dexp⁻¹(ω)); after each step the state is projected onto the rows. A disassembled robot has
//! the rows of its bearings only. Elastic struts have one additional velocity each, the rate of their elongation.

use nalgebra::{Quaternion, Rotation3, UnitQuaternion, Vector3};

use super::SingularPose;
use super::constraints::ROWS;
use super::contacts::{Contacts, Resistance};
use super::context::{Answer, Context};
use super::forces::spin_restraint;
use super::integrator::{Stage, System};
use super::maximal::{Added, Bearings, Extra, MaximalCoordinates, Solution as Constrained, Stretch, Stretches};
use super::rod::{self, Rod};
use super::state::BodyState;
use super::wrench::{Load, STILL, Twist};
use crate::dynamics::Plant;
use crate::effects::StrutSpring;
use crate::kinematics::motion::MAX_SOCKETS;
use crate::kinematics::{BodyMotion, JointState, Motion, Reactions, Screw, SocketSet, Telescope};
use crate::machine::bodies::{ARM, BODIES, PLATFORM, ROTOR, SLOTS, STRUT, TELESCOPE_LOWER};
use crate::machine::{ARMS, AXES, Actuator, STRUTS};

/// Per body: position, quaternion at the start of the step, rotation θ since then, velocity, angular velocity (inertial
/// axes).
const BODY: usize = 16;
const TURN: usize = 7;
const VELOCITY: usize = 10;
const OMEGA: usize = 13;
/// Axis angles including full turns, which the orientations of the bodies do not determine.
const ANGLES: usize = BODY * BODIES;
/// Elongations of the struts, followed by their rates.
const STRETCH: usize = ANGLES + AXES;
const STRETCH_RATE: usize = STRETCH + STRUTS;
/// Number of positions and velocities.
pub(super) const LENGTH: usize = STRETCH_RATE + STRUTS;

/// The joints of a machine in absolute coordinates.
pub(super) struct Joints {
    solver: Solver,
    rods: [Rod; STRUTS],
    /// Elastic struts; `None` if they are rigid.
    springs: Option<[StrutSpring; STRUTS]>,
}

enum Solver {
    /// All joints of an assembled robot, except open sockets.
    Loops(MaximalCoordinates),
    /// Bearings of arms and rotor.
    Bearings(Box<Bearings>),
}

impl Joints {
    /// Joints of a machine in its configuration.
    pub fn new(plant: &Plant) -> Self {
        Self {
            solver: if plant.assembled {
                Solver::Loops(MaximalCoordinates::new())
            } else {
                Solver::Bearings(Box::new(Bearings::new()))
            },
            rods: Rod::all(plant),
            springs: plant.effects.iter().find_map(|a| a.strut_spring()),
        }
    }

    /// Energy of a state in excess of that with rigid struts, J, without the energy of the springs.
    pub fn stretch_energy(&self, plant: &Plant, motion: &Motion, y: &[f64]) -> f64 {
        let rates = std::array::from_fn(|s| y[STRETCH_RATE + s]);
        self.springs.map_or(0.0, |_| rod::stretch_energy(&self.rods, plant, motion, &rates))
    }

    /// Elastic struts at a state, without implicit terms; `None` if they are rigid.
    fn stretches(&self, y: &[f64]) -> Option<Stretches> {
        self.springs.map(|springs| {
            std::array::from_fn(|s| {
                let (elongation, rate) = (y[STRETCH + s], y[STRETCH_RATE + s]);
                let force = -springs[s].stiffness * elongation - springs[s].damping * rate;
                Stretch { rod: self.rods[s], elongation, rate, force, added: 0.0 }
            })
        })
    }

    /// Power of the elastic struts on the bodies, W.
    fn spring_power(&self, y: &[f64]) -> f64 {
        self.stretches(y).iter().flatten().map(|s| s.force * s.rate).sum()
    }

    fn solve(
        &mut self,
        plant: &Plant,
        motion: &Motion,
        closed: SocketSet,
        wrenches: &[Twist; SLOTS],
        extra: Extra,
    ) -> Result<Solution, SingularPose> {
        let bodies = &motion.bodies;
        let solution = |found: &Constrained| Solution {
            bodies: found.bodies,
            stretches: found.stretches,
            multipliers: found.multipliers,
            reactions: Reactions::default(),
            socket_force: [Vector3::zeros(); MAX_SOCKETS],
        };
        match &mut self.solver {
            Solver::Loops(maximal) => {
                let out = solution(maximal.solve_with(plant, bodies, closed, wrenches, extra)?);
                Ok(Solution { reactions: maximal.axial_forces(bodies), socket_force: maximal.socket_forces(), ..out })
            }
            Solver::Bearings(bearings) => Ok(solution(bearings.solve(plant, bodies, wrenches, extra.damping)?)),
        }
    }

    /// Projects a state onto the rows of the closed joints; returns the number of Newton corrections.
    pub fn close(&mut self, plant: &Plant, y: &mut [f64], closed: SocketSet) -> Result<usize, SingularPose> {
        let mut bodies: [BodyState; BODIES] = std::array::from_fn(|b| body_state(&y[BODY * b..BODY * (b + 1)]));
        let mut stretches = self.stretches(y);
        let corrections = match &mut self.solver {
            Solver::Loops(maximal) => maximal.project_elastic(plant, &mut bodies, closed, stretches.as_mut())?,
            Solver::Bearings(bearings) => bearings.project(plant, &mut bodies)?,
        };
        for (b, body) in bodies.iter().enumerate() {
            let orientation = UnitQuaternion::new_normalize(body.orientation);
            store_body(
                &mut y[BODY * b..BODY * (b + 1)],
                &body.position,
                &orientation,
                &body.velocity,
                &(orientation * body.angular_velocity),
            );
        }
        for (s, stretch) in stretches.iter().flatten().enumerate() {
            (y[STRETCH + s], y[STRETCH_RATE + s]) = (stretch.elongation, stretch.rate);
        }
        let q = motion(plant, y).q;
        y[ANGLES..STRETCH].copy_from_slice(&q);
        Ok(corrections)
    }

    /// Multipliers λ of all rows for a motion whose accelerations result from `wrenches` (drives included).
    pub fn multipliers(
        &mut self,
        plant: &Plant,
        motion: &Motion,
        closed: SocketSet,
        wrenches: &[Twist; SLOTS],
    ) -> Result<[f64; ROWS], SingularPose> {
        let mut y = vec![0.0; LENGTH];
        if self.springs.is_some() {
            store_stretches(&mut y, plant, motion);
        }
        let stretches = self.stretches(&y);
        Ok(self
            .solve(plant, motion, closed, wrenches, Extra { damping: None, stretches: stretches.as_ref() })?
            .multipliers)
    }
}

/// Writes poses and velocities of a motion, and the elongations of its struts.
pub(super) fn store(y: &mut [f64], plant: &Plant, motion: &Motion) {
    for (b, m) in motion.bodies[..BODIES].iter().enumerate() {
        let orientation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(m.rotation));
        store_body(&mut y[BODY * b..BODY * (b + 1)], &m.position, &orientation, &m.velocity, &m.angular_velocity);
    }
    y[ANGLES..STRETCH].copy_from_slice(&motion.q);
    if plant.assembled {
        store_stretches(y, plant, motion);
    }
}

/// Writes the velocities of a motion without changing the poses; struts with an open socket keep their elongation
/// rates.
pub(super) fn store_velocities(y: &mut [f64], plant: &Plant, motion: &Motion, closed: SocketSet) {
    for (b, m) in motion.bodies[..BODIES].iter().enumerate() {
        let at = &mut y[BODY * b..BODY * (b + 1)];
        at[VELOCITY..OMEGA].copy_from_slice(m.velocity.as_slice());
        at[OMEGA..].copy_from_slice(m.angular_velocity.as_slice());
    }
    let rates = rod::length_rates(plant, motion);
    for s in (0..STRUTS).filter(|&s| closed.contains(s) && closed.contains(STRUTS + s)) {
        y[STRETCH_RATE + s] = rates[s];
    }
}

/// Sets all velocities to zero.
pub(super) fn stop(y: &mut [f64]) {
    for b in 0..BODIES {
        y[BODY * b + VELOCITY..BODY * (b + 1)].fill(0.0);
    }
    y[STRETCH_RATE..LENGTH].fill(0.0);
}

fn store_stretches(y: &mut [f64], plant: &Plant, motion: &Motion) {
    let rates = rod::length_rates(plant, motion);
    for s in 0..STRUTS {
        y[STRETCH + s] = motion.strut_length[s] - plant.geometry.strut_length(s);
        y[STRETCH_RATE + s] = rates[s];
    }
}

fn store_body(
    at: &mut [f64],
    position: &Vector3<f64>,
    orientation: &UnitQuaternion<f64>,
    velocity: &Vector3<f64>,
    omega: &Vector3<f64>,
) {
    at[..3].copy_from_slice(position.as_slice());
    at[3..TURN].copy_from_slice(&[orientation.w, orientation.i, orientation.j, orientation.k]);
    at[TURN..VELOCITY].fill(0.0);
    at[VELOCITY..OMEGA].copy_from_slice(velocity.as_slice());
    at[OMEGA..].copy_from_slice(omega.as_slice());
}

fn vector(y: &[f64]) -> Vector3<f64> {
    Vector3::new(y[0], y[1], y[2])
}

/// Present orientation: that at the start of the step, rotated by θ.
fn orientation(at: &[f64]) -> UnitQuaternion<f64> {
    let start = UnitQuaternion::new_normalize(Quaternion::new(at[3], at[4], at[5], at[6]));
    UnitQuaternion::from_scaled_axis(vector(&at[TURN..])) * start
}

fn body_state(at: &[f64]) -> BodyState {
    let orientation = orientation(at);
    BodyState {
        position: vector(at),
        orientation: *orientation,
        velocity: vector(&at[VELOCITY..]),
        angular_velocity: orientation.inverse() * vector(&at[OMEGA..]),
    }
}

/// θ̇ of R = exp(θ)·R₀ for the angular velocity ω (inertial axes), up to third order in θ: dexp⁻¹(ω) = ω − ½·θ×ω +
/// 1/12·θ×(θ×ω).
fn turn_rate(turn: &Vector3<f64>, omega: &Vector3<f64>) -> Vector3<f64> {
    let once = turn.cross(omega);
    omega - once * 0.5 + turn.cross(&once) / 12.0
}

/// `angle` plus the full turns of `near`.
fn with_turns(angle: f64, near: f64) -> f64 {
    angle + std::f64::consts::TAU * ((near - angle) / std::f64::consts::TAU).round()
}

/// Axis angles including full turns, rad.
pub(super) fn angles(y: &[f64]) -> [f64; AXES] {
    std::array::from_fn(|i| y[ANGLES + i])
}

/// Motion of all bodies at a state, without accelerations.
pub(super) fn motion(plant: &Plant, y: &[f64]) -> Motion {
    let geometry = &plant.geometry;
    let mut out = Motion::disassembled(geometry, &JointState { q: angles(y), ..JointState::default() });
    let mounted = |b: usize| plant.assembled || b == ROTOR || (ARM..ARM + ARMS).contains(&b);
    for b in (0..BODIES).filter(|&b| mounted(b)) {
        let at = &y[BODY * b..BODY * (b + 1)];
        out.bodies[b] = BodyMotion {
            rotation: orientation(at).to_rotation_matrix().into_inner(),
            position: vector(at),
            velocity: vector(&at[VELOCITY..]),
            angular_velocity: vector(&at[OMEGA..]),
            ..BodyMotion::REST
        };
    }
    for i in 0..ARMS {
        let (arm, x) = (&out.bodies[ARM + i], out.bodies[ARM + i].rotation.column(0));
        out.q[i] = match geometry.limbs[i].actuator {
            Actuator::Revolute => with_turns((-x.z).atan2(x.dot(&geometry.limbs[i].radial())), out.q[i]),
            Actuator::Prismatic { .. } => x.dot(&(arm.position - geometry.limbs[i].shaft())),
        };
        out.qd[i] = out.drive(i).1.rate_of(&out.bodies[ARM + i]);
    }
    let rotor = &out.bodies[ROTOR];
    out.q[3] = with_turns(rotor.rotation[(1, 0)].atan2(rotor.rotation[(0, 0)]), out.q[3]);
    out.qd[3] = rotor.angular_velocity.z;
    if plant.assembled {
        for s in 0..STRUTS {
            out.strut_axis[s] = out.bodies[STRUT + s].rotation.column(0).into_owned();
            out.strut_length[s] = geometry.strut_length(s) + y[STRETCH + s];
        }
        let lower = &out.bodies[TELESCOPE_LOWER];
        out.telescope = Telescope::between(&lower.position, &lower.velocity, &geometry.upper_hooke());
    }
    out
}

/// Rate of a joint on `body`, rad/s or m/s, in a state-like vector.
fn rate_of(screw: &Screw, body: usize, y: &[f64]) -> f64 {
    screw.rate(&vector(&y[BODY * body + VELOCITY..]), &vector(&y[BODY * body + OMEGA..]))
}

fn rate_of_drive(motion: &Motion, axis: usize, y: &[f64]) -> f64 {
    let (body, screw) = motion.drive(axis);
    rate_of(&screw, body, y)
}

/// Accelerations of all bodies, and joint forces.
pub(super) struct Solution {
    pub bodies: [Twist; SLOTS],
    /// Second derivatives of the elongations, m/s².
    stretches: [f64; STRUTS],
    /// Multiplier λ of every row, N or N·m.
    pub multipliers: [f64; ROWS],
    pub reactions: Reactions,
    pub socket_force: [Vector3<f64>; MAX_SOCKETS],
}

/// Right-hand side for one step.
pub(super) struct Absolute<'a> {
    pub context: &'a mut Context,
    pub joints: &'a mut Joints,
    /// Contacts whose wrenches are taken at every stage.
    pub contacts: Option<&'a mut (dyn Contacts + 'static)>,
}

impl Absolute<'_> {
    /// Solves for accelerations and reactions at a motion; `implicit` holds the stage's sum and hγ (zero for an
    /// explicit method).
    fn solve(
        &mut self,
        t: f64,
        y: &[f64],
        motion: &Motion,
        implicit: Option<(&[f64], f64)>,
    ) -> Result<Solution, SingularPose> {
        self.context.prepare(t, y, motion);
        if let Some((sum, _)) = implicit {
            self.context.scratch.motors.sums = std::array::from_fn(|i| rate_of_drive(motion, i, sum));
        }
        let Context { plant, torque, closed, .. } = &*self.context;
        let (torque, closed) = (torque.at(t), *closed);
        let mut pushes = [STILL; SLOTS];
        for (axis, torque) in torque.into_iter().enumerate() {
            let (body, screw) = motion.drive(axis);
            screw.push(&mut pushes[body], torque);
        }
        let mut stretches = self.joints.stretches(y);
        let mut damping = None;
        match implicit {
            Some((sum, g)) if g > 0.0 => {
                damping = Some(self.implicit_terms((t, y, motion), (sum, g), &mut pushes, stretches.as_mut()));
            }
            Some(_) => {
                // An explicit method runs without loads on the spins; their stiff restraint is omitted, so that they
                // stay at rest.
                for s in 0..STRUTS {
                    let u = motion.strut_axis[s];
                    let spin = motion.bodies[STRUT + s].angular_velocity.dot(&u);
                    pushes[STRUT + s].1 += u * (spin_restraint(plant, closed, s) * spin);
                }
            }
            None => {}
        }
        let joints = &mut *self.joints;
        self.context.solve(t, y, motion, |plant, wrenches, answer| {
            let mut all = *wrenches;
            for (wrench, push) in all.iter_mut().zip(&pushes) {
                wrench.0 += push.0;
                wrench.1 += push.1;
            }
            let solution = joints.solve(
                plant,
                motion,
                closed,
                &all,
                Extra { damping: damping.as_ref(), stretches: stretches.as_ref() },
            )?;
            let drives = std::array::from_fn(|axis| {
                let (body, screw) = motion.drive(axis);
                screw.rate(&solution.bodies[body].0, &solution.bodies[body].1)
            });
            let (reactions, bodies) = (solution.reactions, solution.bodies);
            *answer = Answer { reactions, drives, platform: bodies[PLATFORM].0, bodies };
            Ok(solution)
        })
    }

    /// Adds the implicit terms of a Rosenbrock stage, forces, moments and predicted spring forces; returns the
    /// contribution of damping to the blocks of the mass matrix.
    fn implicit_terms(
        &self,
        (t, y, motion): (f64, &[f64], &Motion),
        (sum, g): (&[f64], f64),
        pushes: &mut [Twist; SLOTS],
        stretches: Option<&mut Stretches>,
    ) -> [Added; BODIES] {
        let Context { forces, layout, torque, scratch, .. } = &*self.context;
        let drives = torque.at(t);
        let mut blocks = [Added::NONE; BODIES];
        if scratch.resisted {
            for (b, contact) in scratch.resistances.iter().enumerate().filter(|(_, c)| **c != Resistance::NONE) {
                let (m, sum) = (&motion.bodies[b], &sum[BODY * b..BODY * (b + 1)]);
                resist(&mut pushes[b], contact, (m, sum), g);
                blocks[b].resisting(contact, g);
            }
        }
        let damped = &scratch.damping;
        let mut restrain = |body: usize, screw: Screw, d: f64| {
            screw.push(&mut pushes[body], -d * rate_of(&screw, body, sum));
            blocks[body].along(&screw, g * d);
        };
        for axis in 0..AXES {
            let (body, screw) = motion.drive(axis);
            restrain(body, screw, damped.drives[axis]);
        }
        for s in 0..STRUTS {
            restrain(STRUT + s, Screw::turning(motion.strut_axis[s]), damped.spins[s]);
        }
        let (own, moved) = (&y[layout.own()], &sum[layout.own()]);
        for (arm, inertia, torque) in forces.gear_terms(&drives, &scratch.motors, own, moved, g) {
            let (body, screw) = motion.drive(arm);
            screw.push(&mut pushes[body], torque);
            blocks[body].along(&screw, inertia);
        }
        for (s, stretch) in stretches.into_iter().flatten().enumerate() {
            let spring = &self.joints.springs.unwrap_or_default()[s];
            let (moved, changed) = (sum[STRETCH + s], sum[STRETCH_RATE + s]);
            stretch.force -= spring.damping * changed + spring.stiffness * (moved + g * (stretch.rate + changed));
            stretch.added = g * spring.damping + g * g * spring.stiffness;
        }
        blocks
    }

    /// Accelerations and forces at a state.
    pub fn evaluate(&mut self, t: f64, y: &[f64]) -> Result<(Motion, Solution), SingularPose> {
        let mut motion = motion(&self.context.plant, y);
        let solution = self.solve(t, y, &motion, None)?;
        for (body, (linear, angular)) in motion.bodies.iter_mut().zip(solution.bodies) {
            (body.acceleration, body.angular_acceleration) = (linear, angular);
        }
        Ok((motion, solution))
    }
}

/// Adds −K·(s_x + hγ·(v + s_v)) − D·s_v of the contacts of a body with the twist of `m` to its loads; s_x and s_v are
/// the stage's sums of its positions and velocities, `g` is hγ.
fn resist(load: &mut Twist, contacts: &Resistance, (m, sum): (&BodyMotion, &[f64]), g: f64) {
    let twist = [m.velocity, m.angular_velocity];
    let sums = |at: [usize; 2], k: usize| sum[at[k / 3] + k % 3];
    let changed: [f64; 6] = std::array::from_fn(|k| sums([VELOCITY, OMEGA], k));
    let moved: [f64; 6] = std::array::from_fn(|k| sums([0, TURN], k) + g * (twist[k / 3][k % 3] + changed[k]));
    let back = |k: usize| {
        let along = |(i, x): (usize, &f64)| contacts.stiffness[k][i] * x + contacts.damping[k][i] * changed[i];
        moved.iter().enumerate().map(along).sum::<f64>()
    };
    for k in 0..3 {
        load.0[k] -= back(k);
        load.1[k] -= back(3 + k);
    }
}

impl Absolute<'_> {
    /// Takes the wrenches of the contacts at a stage, and at the first one their resistance for the step.
    fn touch(&mut self, motion: &Motion, first: bool) {
        let Some(contacts) = &mut self.contacts else {
            self.context.scratch.resisted = false;
            return;
        };
        self.context.external = Load::constant(*contacts.wrenches(motion, self.context.closed));
        if first {
            let scratch = &mut self.context.scratch;
            let known = contacts.resistances(motion);
            scratch.resisted = known.is_some();
            if let Some(known) = known {
                scratch.resistances.copy_from_slice(known);
            }
        }
    }
}

impl System for Absolute<'_> {
    fn stage(&mut self, stage: &Stage, k: &mut [f64]) -> Result<(), SingularPose> {
        let Stage { t, y, sum, g, first } = *stage;
        let mut motion = motion(&self.context.plant, y);
        self.touch(&motion, first);
        if first && g > 0.0 {
            self.context.measure_damping(t, y, &mut motion);
        }
        let solution = self.solve(t, y, &motion, Some((sum, g)))?;
        // Position rates are the velocities; with elastic struts or contacts, whose stiffness is implicit, those one step
        // ahead.
        let ahead = (self.joints.springs.is_some() || self.context.scratch.resisted) && g > 0.0;
        let rate = |now: Vector3<f64>, at: usize, slope: Vector3<f64>| {
            if ahead { now + vector(&sum[at..]) + slope * g } else { now }
        };
        for b in 0..BODIES {
            let (m, (linear, angular)) = (&motion.bodies[b], solution.bodies[b]);
            let velocity = rate(m.velocity, BODY * b + VELOCITY, linear);
            let omega = rate(m.angular_velocity, BODY * b + OMEGA, angular);
            let turning = turn_rate(&vector(&y[BODY * b + TURN..]), &omega);
            let at = &mut k[BODY * b..BODY * (b + 1)];
            at[..3].copy_from_slice(velocity.as_slice());
            at[3..TURN].fill(0.0);
            at[TURN..VELOCITY].copy_from_slice(turning.as_slice());
            at[VELOCITY..OMEGA].copy_from_slice(linear.as_slice());
            at[OMEGA..].copy_from_slice(angular.as_slice());
        }
        k[ANGLES..STRETCH].copy_from_slice(&motion.qd);
        for s in 0..STRUTS {
            let slope = solution.stretches[s];
            let ahead = if ahead { sum[STRETCH_RATE + s] + g * slope } else { 0.0 };
            k[STRETCH + s] = y[STRETCH_RATE + s] + ahead;
            k[STRETCH_RATE + s] = slope;
        }
        for axis in 0..AXES {
            let (body, screw) = motion.drive(axis);
            motion.qdd[axis] = screw.rate(&solution.bodies[body].0, &solution.bodies[body].1);
        }
        let struts = self.joints.spring_power(y);
        self.context.rest_of_stage(stage, &motion, struts, k);
        Ok(())
    }

    fn project(&mut self, y: &mut [f64]) -> Result<(), SingularPose> {
        self.context.scratch.corrections += self.joints.close(&self.context.plant, y, self.context.closed)?;
        Ok(())
    }
}
