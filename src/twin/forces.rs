//! Sums what acts on the bodies apart from joints and drives.

use crate::dynamics::Plant;
use crate::effects::{Instant, Wrenches};
use crate::kinematics::{Motion, Reactions, SocketSet};
use crate::model::AXES;
use crate::model::bodies::BODIES;

use super::wrench::Twist;

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
