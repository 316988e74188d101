//! Sums what acts on the bodies apart from joints and drives.

use nalgebra::Vector3;

use super::wrench::{STILL, Twist};
use crate::dynamics::Plant;
use crate::effects::{Instant, Wrenches};
use crate::kinematics::{Motion, Reactions, SocketSet};
use crate::model::bodies::{BODIES, STRUT};
use crate::model::{AXES, STRUTS};

/// What a force law may read besides the plant.
#[derive(Clone, Copy)]
pub(super) struct Scene<'a> {
    pub t: f64,
    pub motion: &'a Motion,
    /// Own states of all effects.
    pub own: &'a [f64],
    pub torque: [f64; AXES],
    pub closed: SocketSet,
}

/// The plant's effects and where their own states stand.
pub(super) struct Forces {
    starts: Vec<usize>,
    reads: Vec<bool>,
}

impl Forces {
    pub fn new(plant: &Plant) -> Self {
        let mut starts = vec![0];
        for active in &plant.effects {
            starts.push(starts[starts.len() - 1] + active.states());
        }
        Self { starts, reads: plant.effects.iter().map(|a| a.effect.reads_reactions()).collect() }
    }

    /// Number of own states of all effects.
    pub fn states(&self) -> usize {
        self.starts[self.starts.len() - 1]
    }

    /// Whether an effect depends on the strut forces.
    pub fn read_reactions(&self) -> bool {
        self.reads.contains(&true)
    }

    fn instant<'a>(&self, plant: &'a Plant, k: usize, scene: &Scene<'a>, reactions: &'a Reactions) -> Instant<'a> {
        Instant {
            t: scene.t,
            motion: scene.motion,
            bodies: &plant.bodies,
            gravity: plant.gravity,
            reactions,
            state: &scene.own[self.starts[k]..self.starts[k + 1]],
            torque: scene.torque,
            closed: scene.closed,
        }
    }

    /// Adds the wrenches of the effects that read reactions (`reading`) or of those that do not, and stores their
    /// powers, W.
    pub fn add(
        &self,
        plant: &Plant,
        scene: &Scene,
        reactions: &Reactions,
        reading: bool,
        wrenches: &mut [Twist; BODIES],
        powers: &mut [f64],
    ) {
        for (k, active) in plant.effects.iter().enumerate() {
            if self.reads[k] != reading {
                continue;
            }
            let instant = self.instant(plant, k, scene, reactions);
            let mut power = 0.0;
            active.effect.forces(
                &active.values(),
                &instant,
                &mut Wrenches::new(&mut |p, body, force, moment| {
                    let (force, moment) = (force * active.values[p], moment * active.values[p]);
                    wrenches[body].0 += force;
                    wrenches[body].1 += moment;
                    let m = &scene.motion.bodies[body];
                    power += force.dot(&m.velocity) + moment.dot(&m.angular_velocity);
                }),
            );
            powers[k] = power;
        }
    }

    /// Rates of all own states and their slopes; `scene.motion` holds the accelerations of this instant.
    pub fn state_rates(
        &self,
        plant: &Plant,
        scene: &Scene,
        reactions: &Reactions,
        rates: &mut [f64],
        slopes: &mut [f64],
    ) {
        for (k, active) in plant.effects.iter().enumerate() {
            let own = self.starts[k]..self.starts[k + 1];
            if !own.is_empty() {
                let instant = self.instant(plant, k, scene, reactions);
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

/// Damping that effects put on the steep freedoms, N·m·s/rad.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Damping {
    /// Arms and rotor.
    pub drives: [f64; AXES],
    /// Struts about their own axes, with their restraint.
    pub spins: [f64; STRUTS],
}

/// Change of a rate by which the damping of effects is measured, rad/s.
const RATE: f64 = 1e-6;

impl Forces {
    /// Damping of drives and spins by one-sided differences of the effects' wrenches; never negative.
    pub fn damping(&self, plant: &Plant, scene: &Scene, reactions: &Reactions, idle: &mut [f64]) -> Damping {
        let mut wrenches = |motion: &Motion| {
            let mut out = [STILL; BODIES];
            let scene = Scene { motion, ..*scene };
            for reading in [false, true] {
                self.add(plant, &scene, reactions, reading, &mut out, idle);
            }
            out
        };
        let base = wrenches(scene.motion);
        let mut moved = *scene.motion;
        for a in 0..AXES {
            moved.qd[a] += RATE;
        }
        let driven = wrenches(&moved);
        moved.qd = scene.motion.qd;
        for s in 0..STRUTS {
            moved.bodies[STRUT + s].angular_velocity += moved.strut_axis[s] * RATE;
        }
        let spun = wrenches(&moved);
        let slope = |body: usize, axis: &Vector3<f64>, other: &[Twist; BODIES]| {
            ((base[body].1 - other[body].1).dot(axis) / RATE).max(0.0)
        };
        Damping {
            drives: std::array::from_fn(|a| {
                let (body, axis) = Motion::drive(a);
                slope(body, &axis, &driven)
            }),
            spins: std::array::from_fn(|s| plant.spin_damping + slope(STRUT + s, &scene.motion.strut_axis[s], &spun)),
        }
    }
}
