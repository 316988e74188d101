//! Sums what acts on the bodies apart from joints and drives.

use nalgebra::Vector3;

use super::wrench::{STILL, Twist};
use crate::dynamics::Plant;
use crate::effects::{GearSpring, Instant, Wrenches};
use crate::kinematics::{JointState, Motion, Reactions, SocketSet};
use crate::model::bodies::{BODIES, STRUT};
use crate::model::{ARMS, AXES, STRUTS};

/// What a force law may read besides plant, motion and reactions.
#[derive(Clone, Copy)]
pub(super) struct Scene<'a> {
    pub t: f64,
    /// Own states of all effects.
    pub own: &'a [f64],
    pub torque: [f64; AXES],
    pub closed: SocketSet,
}

/// The plant's effects and where their own states stand.
pub(super) struct Forces {
    starts: Vec<usize>,
    /// Which effects read what the equations solve for.
    reads: Vec<bool>,
    /// Whether one of them reads accelerations.
    accelerations: bool,
    /// Effects that damp drives and struts' spins.
    damps: [Vec<usize>; 2],
    /// Elastic gears, and where their deflections stand among the own states; the rates follow.
    gears: Option<(usize, [GearSpring; ARMS])>,
    /// Brakes on all drives, N·m.
    pub brake: f64,
}

/// Steepness of the brakes' Coulomb friction about rest, s/rad.
const BRAKE_STEEPNESS: f64 = 100.0;

impl Forces {
    pub fn new(plant: &Plant) -> Self {
        let mut starts = vec![0];
        for active in &plant.effects {
            starts.push(starts[starts.len() - 1] + active.states());
        }
        let all: Vec<usize> = (0..plant.effects.len()).collect();
        let reads =
            plant.effects.iter().map(|a| a.effect.reads_reactions() || a.effect.reads_accelerations()).collect();
        let accelerations = plant.effects.iter().any(|a| a.effect.reads_accelerations());
        let mut forces = Self { starts, reads, accelerations, damps: [all.clone(), all], gears: None, brake: 0.0 };
        forces.gears = forces.elastic_gears(plant);
        forces.damps = forces.damping_effects(plant);
        forces
    }

    /// Number of own states of all effects.
    pub fn states(&self) -> usize {
        self.starts[self.starts.len() - 1]
    }

    fn elastic_gears(&self, plant: &Plant) -> Option<(usize, [GearSpring; ARMS])> {
        plant.effects.iter().zip(&self.starts).find_map(|(active, &start)| {
            let [a, b, c, _] = active.effect.gear_springs(&active.values())?;
            [a, b, c].iter().any(GearSpring::is_elastic).then_some((start, [a, b, c]))
        })
    }

    /// Whether gears ring too fast for an explicit step; `g` is hγ.
    pub fn are_gears_steep(&self, g: f64) -> bool {
        self.gears.iter().flat_map(|(_, gears)| gears).any(|gear| is_steep(gear, g))
    }

    /// Implicit terms of a stage for elastic gears that are steep: arm, inertia (kg·m²) and torque (N·m) to add to it.
    ///
    /// With P the gear's torque one step ahead but for the unknown k of the rotor's rate, and κ = h²γ²/c + hγ·d, rotor
    /// and arm have J·(k + q̈) = τ − P − κ·k and Θ·q̈ = … + P + κ·k; the rotor's row leaves k.
    pub fn gear_terms<'a>(
        &'a self,
        torque: &'a [f64; AXES],
        own: &'a [f64],
        sum: &'a [f64],
        g: f64,
    ) -> impl Iterator<Item = (usize, f64, f64)> + 'a {
        self.gears.iter().flat_map(move |(start, gears)| {
            gears.iter().enumerate().filter(move |(_, gear)| is_steep(gear, g)).map(move |(i, gear)| {
                let (now, ahead, kappa) = gear_torques(gear, &own[start + i..], &sum[start + i..], g);
                let share = kappa / (gear.rotor_inertia + kappa);
                (i, gear.rotor_inertia * share, ahead - now + share * (torque[i] - ahead))
            })
        })
    }

    /// Stage derivatives of steep gears' states from their rates `k`.
    pub fn gear_rates(&self, own: &[f64], sum: &[f64], g: f64, k: &mut [f64]) {
        let Some((start, gears)) = &self.gears else { return };
        for (i, gear) in gears.iter().enumerate().filter(|(_, gear)| is_steep(gear, g)) {
            let (deflection, rate) = (start + i, start + ARMS + i);
            let (now, ahead, kappa) = gear_torques(gear, &own[deflection..], &sum[deflection..], g);
            let j = gear.rotor_inertia;
            k[rate] = (j * k[rate] + now - ahead) / (j + kappa);
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

    fn instant<'a>(
        &self,
        plant: &'a Plant,
        k: usize,
        scene: &Scene<'a>,
        motion: &'a Motion,
        reactions: &'a Reactions,
    ) -> Instant<'a> {
        Instant {
            t: scene.t,
            motion,
            bodies: &plant.bodies,
            gravity: plant.gravity,
            reactions,
            state: &scene.own[self.starts[k]..self.starts[k + 1]],
            torque: scene.torque,
            closed: scene.closed,
        }
    }

    /// Adds the wrenches of the effects that read the equations' answer (`reading`) or of those that do not, and stores their
    /// powers, W.
    pub fn add(
        &self,
        plant: &Plant,
        scene: &Scene,
        motion: &Motion,
        reactions: &Reactions,
        reading: bool,
        wrenches: &mut [Twist; BODIES],
        powers: &mut [f64],
    ) {
        for (k, active) in plant.effects.iter().enumerate() {
            if self.reads[k] != reading {
                continue;
            }
            let instant = self.instant(plant, k, scene, motion, reactions);
            let mut out = Wrenches::sum(&active.values, motion, wrenches);
            active.effect.forces(&active.values(), &instant, &mut out);
            powers[k] = out.power();
        }
    }

    /// Adds the brakes' torques −T·tanh(k·q̇) and returns their power, W.
    pub fn add_brakes(&self, motion: &Motion, wrenches: &mut [Twist; BODIES]) -> f64 {
        let mut power = 0.0;
        if self.brake > 0.0 {
            for axis in 0..AXES {
                let (body, direction) = Motion::drive(axis);
                let torque = -self.brake * (BRAKE_STEEPNESS * motion.qd[axis]).tanh();
                wrenches[body].1 += direction * torque;
                power += torque * motion.qd[axis];
            }
        }
        power
    }

    /// Rates of all own states and their slopes; `motion` holds the accelerations of this instant.
    pub fn state_rates(
        &self,
        plant: &Plant,
        scene: &Scene,
        motion: &Motion,
        reactions: &Reactions,
        rates: &mut [f64],
        slopes: &mut [f64],
    ) {
        for (k, active) in plant.effects.iter().enumerate() {
            let own = self.starts[k]..self.starts[k + 1];
            if !own.is_empty() {
                let instant = self.instant(plant, k, scene, motion, reactions);
                slopes[own.clone()].fill(0.0);
                active.effect.state_rate(&active.values(), &instant, &mut rates[own.clone()], &mut slopes[own.clone()]);
            }
        }
    }

    /// Angles the motor-side encoders see for joint angles `q`.
    pub fn encoders(&self, plant: &Plant, own: &[f64], q: &[f64; AXES]) -> [f64; AXES] {
        let mut angles = *q;
        for (k, active) in plant.effects.iter().enumerate() {
            active.effect.encoder(&active.values(), &own[self.starts[k]..self.starts[k + 1]], &mut angles);
        }
        angles
    }
}

/// Change of a rotor's rate that its gear takes back within a step, beyond which the gear is solved implicitly: steps
/// that resolve the ringing are more accurate without.
const STEEP: f64 = 0.25;

fn is_steep(gear: &GearSpring, g: f64) -> bool {
    gear.is_elastic() && g * (g / gear.compliance + gear.damping) > STEEP * gear.rotor_inertia
}

/// Torque of a gear now and one step ahead but for the rotor's own change of rate, and κ of that; states and sums from
/// the arm's deflection on.
fn gear_torques(gear: &GearSpring, own: &[f64], sum: &[f64], g: f64) -> (f64, f64, f64) {
    let torque = |deflection: f64, rate: f64| deflection / gear.compliance + gear.damping * rate;
    let now = torque(own[0], own[ARMS]);
    let ahead = now + torque(sum[0] + g * (own[ARMS] + sum[ARMS]), sum[ARMS]);
    (now, ahead, g * (g / gear.compliance + gear.damping))
}

/// Damping that effects put on the steep freedoms, N·m·s/rad.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Damping {
    /// Arms and rotor.
    pub drives: [f64; AXES],
    /// Struts about their own axes, with their restraint.
    pub spins: [f64; STRUTS],
    /// Steps for which the damping of the spins may be kept.
    keep: usize,
}

/// Damping that keeps strut `s` from spinning, N·m·s/rad: none once it has left both its balls.
pub(super) fn spin_restraint(plant: &Plant, closed: SocketSet, s: usize) -> f64 {
    if closed.contains(s) || closed.contains(STRUTS + s) { plant.spin_damping } else { 0.0 }
}

/// Change of a rate by which the damping of effects is measured, rad/s.
const RATE: f64 = 1e-6;
/// Steps without a new measurement where the restraint of the spins is ten times stronger than all friction.
const KEEP: usize = 32;

#[derive(Clone, Copy, PartialEq, Eq)]
enum Freedom {
    Drives,
    Spins,
}

impl Forces {
    /// Wrenches of the effects that damp a freedom (only of effect `only`, if given), and with that freedom's rates a
    /// little higher. `motion` is as before when it returns.
    fn probe(
        &self,
        plant: &Plant,
        scene: &Scene,
        motion: &mut Motion,
        reactions: &Reactions,
        freedom: Freedom,
        only: Option<usize>,
    ) -> [[Twist; BODIES]; 2] {
        let (qd, bodies) =
            (motion.qd, std::array::from_fn::<_, STRUTS, _>(|s| motion.bodies[STRUT + s].angular_velocity));
        [0.0, RATE].map(|rate| {
            match freedom {
                Freedom::Drives => motion.qd.iter_mut().for_each(|x| *x += rate),
                Freedom::Spins => {
                    for s in 0..STRUTS {
                        motion.bodies[STRUT + s].angular_velocity += motion.strut_axis[s] * rate;
                    }
                }
            }
            let mut out = [STILL; BODIES];
            for &e in &self.damps[freedom as usize] {
                if only.is_none_or(|k| k == e) {
                    let instant = self.instant(plant, e, scene, motion, reactions);
                    let active = &plant.effects[e];
                    let mut sum = Wrenches::sum(&active.values, motion, &mut out);
                    active.effect.forces(&active.values(), &instant, &mut sum);
                }
            }
            motion.qd = qd;
            for (s, omega) in bodies.iter().enumerate() {
                motion.bodies[STRUT + s].angular_velocity = *omega;
            }
            out
        })
    }

    /// Effects whose wrenches change with the rates of drives and of spins, found by trying.
    fn damping_effects(&self, plant: &Plant) -> [Vec<usize>; 2] {
        let mut motion = Motion::disassembled(&plant.geometry, &JointState::default());
        motion.strut_axis = [Vector3::z(); STRUTS];
        motion.telescope.length = 1.0;
        motion.qd = [0.01; AXES];
        for s in 0..STRUTS {
            motion.bodies[STRUT + s].angular_velocity = Vector3::new(0.3, 0.2, 0.1);
        }
        let own: Vec<f64> = plant.effects.iter().flat_map(|a| a.effect.initial_state(&a.values())).collect();
        let reactions = Reactions { upper: [100.0; STRUTS], lower: [100.0; STRUTS] };
        let scene = Scene { t: 0.0, own: &own, torque: [1.0; AXES], closed: SocketSet::ALL };
        [Freedom::Drives, Freedom::Spins].map(|freedom| {
            (0..plant.effects.len())
                .filter(|&k| {
                    let [base, moved] = self.probe(plant, &scene, &mut motion, &reactions, freedom, Some(k));
                    base != moved
                })
                .collect()
        })
    }

    /// Measures the damping of drives and spins by one-sided differences of the effects' wrenches; never negative.
    pub fn measure_damping(
        &self,
        plant: &Plant,
        scene: &Scene,
        motion: &mut Motion,
        reactions: &Reactions,
        damping: &mut Damping,
    ) {
        let slope = |[base, moved]: &[[Twist; BODIES]; 2], body: usize, axis: &Vector3<f64>| {
            ((base[body].1 - moved[body].1).dot(axis) / RATE).max(0.0)
        };
        damping.drives = [0.0; AXES];
        if !self.damps[Freedom::Drives as usize].is_empty() {
            let probe = self.probe(plant, scene, motion, reactions, Freedom::Drives, None);
            for a in 0..AXES {
                let (body, axis) = Motion::drive(a);
                damping.drives[a] = slope(&probe, body, &axis);
            }
        }
        if self.brake > 0.0 {
            for (drive, rate) in damping.drives.iter_mut().zip(motion.qd) {
                *drive += self.brake * BRAKE_STEEPNESS / (BRAKE_STEEPNESS * rate).cosh().powi(2);
            }
        }
        if damping.keep > 0 {
            damping.keep -= 1;
            return;
        }
        damping.spins = std::array::from_fn(|s| spin_restraint(plant, scene.closed, s));
        if !self.damps[Freedom::Spins as usize].is_empty() {
            let probe = self.probe(plant, scene, motion, reactions, Freedom::Spins, None);
            let mut worst = 0f64;
            for s in 0..STRUTS {
                let slope = slope(&probe, STRUT + s, &motion.strut_axis[s]);
                damping.spins[s] += slope;
                worst = worst.max(slope);
            }
            if worst < 0.1 * plant.spin_damping {
                damping.keep = KEEP;
            }
        }
    }
}
