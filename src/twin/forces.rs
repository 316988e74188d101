//! Sum of the loads on the bodies apart from joints and drives.

use nalgebra::Vector3;

use super::wrench::{STILL, Twist};
use crate::dynamics::Plant;
use crate::effects::{ActiveEffect, GearSpring, Instant, Kind, Part, Wrenches};
use crate::kinematics::{JointState, KinematicsError, Motion, Reactions, Screw, SocketSet};
use crate::machine::bodies::{SLOTS, strut};
use crate::machine::{PerAxis, PerStrut, each, every_axis, every_strut, rate_place};
use crate::numerics::tanh;

/// Arguments of a force law besides plant, motion and reactions.
#[derive(Clone, Copy)]
pub(super) struct Scene<'a> {
    pub t: f64,
    /// Internal states of all effects.
    pub own: &'a [f64],
    pub torque: PerAxis<f64>,
    pub closed: SocketSet,
}

/// Arguments of an evaluation of the laws.
#[derive(Clone, Copy)]
pub(super) struct Evaluation<'a> {
    pub plant: &'a Plant,
    pub scene: &'a Scene<'a>,
    pub motion: &'a Motion,
    pub reactions: &'a Reactions,
}

/// Accumulators of an evaluation.
pub(super) struct Sums<'a> {
    /// Wrenches on the bodies, N and N·m.
    pub wrenches: &'a mut [Twist; SLOTS],
    /// Torques on the rotors of elastic gears, N·m.
    pub motors: &'a mut PerAxis<f64>,
    /// Power of each effect on the bodies, W.
    pub powers: &'a mut [f64],
}

/// The plant's effects and the layout of their internal states.
pub(super) struct Forces {
    starts: Vec<usize>,
    /// Whether each effect depends on the solution of the equations of motion.
    reads: Vec<bool>,
    /// Whether one of these depends on accelerations.
    accelerations: bool,
    /// Effects that damp the drives, and those that damp the strut spins, on the link side.
    damps: [Vec<usize>; 2],
    /// Effects that damp the rotors of elastic gears.
    motor_damps: Vec<usize>,
    /// Elastic gears, and the position of their deflections among the internal states; the rates follow.
    gears: Option<(usize, PerAxis<GearSpring>)>,
    /// Whether each effect acts on the rotors of elastic gears instead of the arms.
    at_motors: Vec<bool>,
    /// Torque of the brakes on all drives, N·m.
    pub brake: f64,
}

/// Steepness of the brakes' Coulomb friction at rest, s/rad.
const BRAKE_STEEPNESS: f64 = 100.0;

impl Forces {
    pub fn new(plant: &Plant) -> Self {
        let mut starts = vec![0];
        for active in &plant.effects {
            starts.push(starts[starts.len() - 1] + active.states());
        }
        let all: Vec<usize> = (0..plant.effects.len()).collect();
        let reads = plant
            .effects
            .iter()
            .map(|a| a.effect.spec().reads.reactions || a.effect.spec().reads.accelerations)
            .collect();
        let accelerations = plant.effects.iter().any(|a| a.effect.spec().reads.accelerations);
        let mut forces = Self {
            starts,
            reads,
            accelerations,
            damps: [all.clone(), all],
            gears: None,
            at_motors: vec![],
            motor_damps: vec![],
            brake: 0.0,
        };
        forces.gears = forces.elastic_gears(plant);
        forces.at_motors = forces.motor_effects(plant);
        forces.damps = forces.damping_effects(plant);
        let drives = &mut forces.damps[Freedom::Drives as usize];
        forces.motor_damps = drives.extract_if(.., |e| forces.at_motors[*e]).collect();
        forces
    }

    /// Number of internal states of all effects.
    pub fn states(&self) -> usize {
        self.starts[self.starts.len() - 1]
    }

    fn elastic_gears(&self, plant: &Plant) -> Option<(usize, PerAxis<GearSpring>)> {
        plant.effects.iter().zip(&self.starts).find_map(|(active, &start)| {
            let gears = active.gear_springs()?;
            gears.iter().any(GearSpring::is_elastic).then_some((start, gears))
        })
    }

    /// Whether each effect acts on the rotors: forces on the drives, if the gears have `friction_at_motor`.
    fn motor_effects(&self, plant: &Plant) -> Vec<bool> {
        let say_so = self.gears.iter().flat_map(|(_, gears)| gears).any(|g| g.is_elastic() && g.friction_at_motor);
        let on_drives = |a: &ActiveEffect| a.effect.acts_on() == Part::Drives && a.effect.kind() == Kind::Force;
        plant.effects.iter().map(|a| say_so && on_drives(a)).collect()
    }

    /// Arms with elastic gears: index, gear, deflection (rad) and deflection rate (rad/s).
    fn elastic<'a>(&'a self, own: &'a [f64]) -> impl Iterator<Item = (usize, &'a GearSpring, f64, f64)> + 'a {
        self.gears.iter().flat_map(move |(start, gears)| {
            let all = gears.iter().enumerate().filter(|(_, gear)| gear.is_elastic());
            all.map(move |(i, gear)| (i, gear, own[start + i], own[start + rate_place(i)]))
        })
    }

    /// The motion on the motor side: angles and rates of the motors, and their accelerations under the drive torques
    /// and `motors`, the other loads F on the rotors (N·m): J·q̈_m = τ + F − δ/c − d·δ̇.
    pub fn of_motors(&self, scene: &Scene, motion: &Motion, motors: &PerAxis<f64>) -> Motion {
        let mut out = *motion;
        for (i, gear, deflection, rate) in self.elastic(scene.own) {
            out.q[i] += deflection;
            out.qd[i] += rate;
            let transmitted = deflection / gear.compliance + gear.damping * rate;
            out.qdd[i] = (scene.torque[i] + motors[i] - transmitted) / gear.rotor_inertia;
        }
        out
    }

    /// Whether a gear oscillates too fast for an explicit step; `g` is hγ.
    pub fn are_gears_steep(&self, g: f64) -> bool {
        self.gears.iter().flat_map(|(_, gears)| gears).any(|gear| is_steep(gear, 0.0, g))
    }

    /// Implicit terms of a stage for stiff elastic gears: arm index, and inertia (kg·m²) and torque (N·m) to be added
    /// to the arm.
    ///
    /// Let P be the gear's torque one step ahead without the unknown change k of the rotor rate, κ = h²γ²/c + hγ·d, F
    /// the other loads on the rotor, D their damping and J′ = J + hγ·D. Then J′·(k + q̈) = τ + F − D·s − P − κ·k for
    /// the rotor and Θ·q̈ = … + P + κ·k for the arm, with s the stage's sum of the rotor rates; k is eliminated by the
    /// rotor's equation. Laws on the rotors that depend on accelerations or reactions enter F with their last values.
    pub fn gear_terms<'a>(
        &'a self,
        torque: &'a PerAxis<f64>,
        motors: &'a Motors,
        own: &'a [f64],
        sum: &'a [f64],
        g: f64,
    ) -> impl Iterator<Item = (usize, f64, f64)> + 'a {
        self.gears.iter().flat_map(move |(start, gears)| {
            let steep = move |(i, gear): &(usize, &GearSpring)| is_steep(gear, motors.damping[*i], g);
            gears.iter().enumerate().filter(steep).map(move |(i, gear)| {
                let (now, ahead, kappa) = gear_torques(gear, &own[start + i..], &sum[start + i..], g);
                let inertia = gear.rotor_inertia + g * motors.damping[i];
                let share = kappa / (inertia + kappa);
                let resisted = motors.damping[i] * (motors.sums[i] + sum[start + rate_place(i)]);
                let driving = torque[i] + motors.torque[i] - resisted;
                (i, inertia * share, ahead - now + share * (driving - ahead))
            })
        })
    }

    /// Stage derivatives of the states of stiff gears from their rates `k`; `drives` are the accelerations of the arms.
    ///
    /// `own` are the states, `sum` the stage's sums of these.
    pub fn gear_rates(
        &self,
        motors: &Motors,
        drives: &PerAxis<f64>,
        (own, sum): (&[f64], &[f64]),
        g: f64,
        k: &mut [f64],
    ) {
        let Some((start, gears)) = &self.gears else { return };
        for (i, gear) in gears.iter().enumerate().filter(|(i, gear)| is_steep(gear, motors.damping[*i], g)) {
            let (deflection, rate) = (start + i, start + rate_place(i));
            let (now, ahead, kappa) = gear_torques(gear, &own[deflection..], &sum[deflection..], g);
            let (j, d) = (gear.rotor_inertia, motors.damping[i]);
            let resisted = d * (motors.sums[i] + sum[rate] + g * drives[i]);
            k[rate] = (j * k[rate] + now - ahead - resisted) / (j + g * d + kappa);
            k[deflection] = own[rate] + sum[rate] + g * k[rate];
        }
    }

    /// Whether an effect depends on strut forces or accelerations.
    pub fn read_answer(&self) -> bool {
        self.reads.contains(&true)
    }

    /// Whether an effect depends on accelerations.
    pub fn read_accelerations(&self) -> bool {
        self.accelerations
    }

    fn instant<'a>(&self, k: usize, at: &Evaluation<'a>) -> Instant<'a> {
        let Evaluation { plant, scene, motion, reactions } = *at;
        let state = &scene.own[self.starts[k]..self.starts[k + 1]];
        Instant { reactions, torque: scene.torque, closed: scene.closed, ..plant.instant(scene.t, motion, state) }
    }

    /// Adds the wrenches of the effects that depend on the solution (`reading`), or of those that do not, and stores
    /// their powers, W.
    ///
    /// Loads on the rotors of elastic gears are added to `motors` (N·m) and do no work on a body.
    pub fn add(&self, at: &Evaluation, reading: bool, sums: Sums) {
        let Evaluation { plant, scene, motion, .. } = *at;
        let Sums { wrenches, motors, powers } = sums;
        let moved = self.at_motors.contains(&true).then(|| self.of_motors(scene, motion, motors));
        for (k, active) in plant.effects.iter().enumerate() {
            if self.reads[k] != reading {
                continue;
            }
            if let (true, Some(moved)) = (self.at_motors[k], &moved) {
                let mut own = [STILL; SLOTS];
                let mut out = Wrenches::sum(&active.values, motion, &mut own);
                let instant = self.instant(k, &Evaluation { motion: moved, ..*at });
                active.effect.wrenches(&active.values(), &instant, &mut out);
                powers[k] = out.power();
                for (i, ..) in self.elastic(scene.own) {
                    let (body, screw) = motion.drive(i);
                    let torque = screw.effort(&own[body]);
                    screw.push(&mut own[body], -torque);
                    powers[k] -= torque * screw.rate_of(&motion.bodies[body]);
                    motors[i] += torque;
                }
                for (sum, own) in wrenches.iter_mut().zip(own) {
                    sum.0 += own.0;
                    sum.1 += own.1;
                }
                continue;
            }
            let instant = self.instant(k, at);
            let mut out = Wrenches::sum(&active.values, motion, wrenches);
            active.effect.wrenches(&active.values(), &instant, &mut out);
            powers[k] = out.power();
        }
    }

    /// Adds the brake torques −T·tanh(k·q̇) and returns their power, W.
    pub fn add_brakes(&self, motion: &Motion, wrenches: &mut [Twist; SLOTS]) -> f64 {
        let mut power = 0.0;
        if self.brake > 0.0 {
            for axis in motion.drives() {
                let (body, screw) = motion.drive(axis);
                let torque = -self.brake * tanh(BRAKE_STEEPNESS * motion.qd[axis]);
                screw.push(&mut wrenches[body], torque);
                power += torque * motion.qd[axis];
            }
        }
        power
    }

    /// The law whose value was not finite at the last [`Forces::add`], found by its power.
    pub fn fault(&self, at: &Evaluation, powers: &[f64]) -> Option<KinematicsError> {
        let Evaluation { plant, motion, .. } = *at;
        let k = powers.iter().position(|p| !p.is_finite())?;
        // If the motion itself is not finite, the cause is not a law.
        let speed: f64 = motion.bodies.iter().map(|b| b.velocity.sum() + b.angular_velocity.sum()).sum();
        if !(speed + motion.q.iter().sum::<f64>()).is_finite() {
            return None;
        }
        plant.effects[k].fault(&self.instant(k, at), false)
    }

    /// Writes rates and slopes of all internal states; `motion` holds the accelerations, `motors` the loads on the
    /// rotors of elastic gears, N·m.
    pub fn state_rates(&self, at: &Evaluation, motors: &PerAxis<f64>, rates: &mut [f64], slopes: &mut [f64]) {
        let Evaluation { plant, scene, motion, .. } = *at;
        let moved = self.at_motors.contains(&true).then(|| self.of_motors(scene, motion, motors));
        for (k, active) in plant.effects.iter().enumerate() {
            let own = self.starts[k]..self.starts[k + 1];
            if !own.is_empty() {
                let motion = moved.as_ref().filter(|_| self.at_motors[k]).unwrap_or(motion);
                let mut instant = self.instant(k, &Evaluation { motion, ..*at });
                if self.gears.as_ref().is_some_and(|(start, _)| *start == own.start) {
                    instant.torque.iter_mut().zip(motors).for_each(|(torque, f)| *torque += f);
                }
                slopes[own.clone()].fill(0.0);
                active.state_rate(&instant, &mut rates[own.clone()], &mut slopes[own.clone()]);
            }
        }
    }

    /// Encoder angles (motor side) for joint angles `q`, rad.
    pub fn encoders(&self, plant: &Plant, own: &[f64], q: &PerAxis<f64>) -> PerAxis<f64> {
        let mut angles = *q;
        for (k, active) in plant.effects.iter().enumerate() {
            active.encoder(&own[self.starts[k]..self.starts[k + 1]], &mut angles);
        }
        angles
    }
}

/// Relative change of a rotor's rate by its gear within a step above which the gear is treated implicitly: explicit
/// steps that resolve the oscillation are more accurate.
const STEEP: f64 = 0.25;

/// Whether the gear or `friction` (damping of the rotor, N·m·s/rad) is stiff for a step with hγ = `g`.
fn is_steep(gear: &GearSpring, friction: f64, g: f64) -> bool {
    gear.is_elastic() && g * (g / gear.compliance + gear.damping + friction) > STEEP * gear.rotor_inertia
}

/// Loads on the rotors of elastic gears besides the drives.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Motors {
    /// Torque, N·m.
    pub torque: PerAxis<f64>,
    /// Damping, N·m·s/rad, as measured for the present step.
    pub damping: PerAxis<f64>,
    /// The stage's sums of the arms' rates, rad/s.
    pub sums: PerAxis<f64>,
}

/// Torque of a gear now and one step ahead without the rotor's own change of rate, and κ of that change; the slices of
/// states and sums start at the arm's deflection.
fn gear_torques(gear: &GearSpring, own: &[f64], sum: &[f64], g: f64) -> (f64, f64, f64) {
    let torque = |deflection: f64, rate: f64| deflection / gear.compliance + gear.damping * rate;
    let now = torque(own[0], own[rate_place(0)]);
    let ahead = now + torque(sum[0] + g * (own[rate_place(0)] + sum[rate_place(0)]), sum[rate_place(0)]);
    (now, ahead, g * (g / gear.compliance + gear.damping))
}

/// Damping of the stiff degrees of freedom by effects, N·m·s/rad.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Damping {
    /// Arms and rotor.
    pub drives: PerAxis<f64>,
    /// Rotors of elastic gears.
    pub motors: PerAxis<f64>,
    /// Struts about their own axes, including the restraint.
    pub spins: PerStrut<f64>,
    /// Remaining steps for which the damping of the spins is kept.
    keep: usize,
}

/// Damping of the spin of strut `s`, N·m·s/rad; zero once both its sockets are open.
pub(super) fn spin_restraint(plant: &Plant, closed: SocketSet, s: usize) -> f64 {
    let held = closed.contains(s) || closed.contains(plant.mechanism.struts() + s);
    if held { plant.spin_damping } else { 0.0 }
}

/// Increment of a rate for the measurement of damping, rad/s.
const RATE: f64 = 1e-6;
/// Steps without a new measurement if the restraint of the spins is ten times stronger than all friction.
const KEEP: usize = 32;

#[derive(Clone, Copy, PartialEq, Eq)]
enum Freedom {
    Drives,
    Spins,
}

impl Forces {
    /// Wrenches of `effects`, and the same with slightly higher rates of `freedom`; `motion` is unchanged on return.
    fn probe(
        &self,
        (plant, scene, reactions): (&Plant, &Scene, &Reactions),
        motion: &mut Motion,
        freedom: Freedom,
        effects: &[usize],
    ) -> [[Twist; SLOTS]; 2] {
        let (qd, bodies) = (
            motion.qd,
            std::array::from_fn::<_, { every_strut().end }, _>(|s| motion.bodies[strut(s)].angular_velocity),
        );
        [0.0, RATE].map(|rate| {
            match freedom {
                Freedom::Drives => motion.qd.iter_mut().for_each(|x| *x += rate),
                Freedom::Spins => {
                    for s in 0..motion.struts() {
                        motion.bodies[strut(s)].angular_velocity += motion.strut_axis[s] * rate;
                    }
                }
            }
            let mut out = [STILL; SLOTS];
            let moved = self.at_motors.contains(&true).then(|| self.of_motors(scene, motion, &each(0.0)));
            for &e in effects {
                let motion = moved.as_ref().filter(|_| self.at_motors[e]).unwrap_or(motion);
                let instant = self.instant(e, &Evaluation { plant, scene, motion, reactions });
                let active = &plant.effects[e];
                let mut sum = Wrenches::sum(&active.values, motion, &mut out);
                active.effect.wrenches(&active.values(), &instant, &mut sum);
            }
            motion.qd = qd;
            for (s, omega) in bodies.iter().enumerate() {
                motion.bodies[strut(s)].angular_velocity = *omega;
            }
            out
        })
    }

    /// Effects whose wrenches depend on the rates of drives and of spins, determined by evaluation.
    fn damping_effects(&self, plant: &Plant) -> [Vec<usize>; 2] {
        let mut motion = Motion::disassembled(&plant.geometry, &JointState::default());
        motion.strut_axis.fill(Vector3::z());
        motion.telescope.length = 1.0;
        motion.qd = each(0.01);
        for s in 0..motion.struts() {
            motion.bodies[strut(s)].angular_velocity = Vector3::new(0.3, 0.2, 0.1);
        }
        let own: Vec<f64> = plant.effects.iter().flat_map(|a| a.initial_state()).collect();
        let pull: PerStrut<f64> = each(100.0);
        let reactions = Reactions::of(&pull, &pull);
        let scene = Scene { t: 0.0, own: &own, torque: each(1.0), closed: plant.sockets() };
        [Freedom::Drives, Freedom::Spins].map(|freedom| {
            (0..plant.effects.len())
                .filter(|&k| {
                    let [base, moved] = self.probe((plant, &scene, &reactions), &mut motion, freedom, &[k]);
                    base != moved
                })
                .collect()
        })
    }

    /// Measures the damping of drives and spins by one-sided differences of the effects' wrenches; negative values are
    /// set to zero.
    pub fn measure_damping(
        &self,
        plant: &Plant,
        scene: &Scene,
        motion: &mut Motion,
        reactions: &Reactions,
        damping: &mut Damping,
    ) {
        let slope = |[base, moved]: &[[Twist; SLOTS]; 2], body: usize, screw: &Screw| {
            ((screw.effort(&base[body]) - screw.effort(&moved[body])) / RATE).max(0.0)
        };
        (damping.drives, damping.motors) = (each(0.0), each(0.0));
        for (effects, on_rotors) in [(&self.damps[Freedom::Drives as usize], false), (&self.motor_damps, true)] {
            if effects.is_empty() {
                continue;
            }
            let probe = self.probe((plant, scene, reactions), motion, Freedom::Drives, effects);
            for a in every_axis() {
                let (body, screw) = motion.drive(a);
                let slope = slope(&probe, body, &screw);
                match damping.motors.get_mut(a) {
                    Some(motor) if on_rotors && self.elastic(scene.own).any(|(i, ..)| i == a) => *motor += slope,
                    _ => damping.drives[a] += slope,
                }
            }
        }
        if self.brake > 0.0 {
            for axis in motion.drives() {
                let rate = BRAKE_STEEPNESS * motion.qd[axis];
                damping.drives[axis] += self.brake * BRAKE_STEEPNESS / rate.cosh().powi(2);
            }
        }
        if damping.keep > 0 {
            damping.keep -= 1;
            return;
        }
        damping.spins = std::array::from_fn(|s| spin_restraint(plant, scene.closed, s));
        if !self.damps[Freedom::Spins as usize].is_empty() {
            let spins = &self.damps[Freedom::Spins as usize];
            let probe = self.probe((plant, scene, reactions), motion, Freedom::Spins, spins);
            let mut worst = 0f64;
            for s in 0..motion.struts() {
                let slope = slope(&probe, strut(s), &Screw::turning(motion.strut_axis[s]));
                damping.spins[s] += slope;
                worst = worst.max(slope);
            }
            if worst < 0.1 * plant.spin_damping {
                damping.keep = KEEP;
            }
        }
    }
}
