//! What force laws read, and what they hand back.

use nalgebra::Vector3;

use crate::kinematics::{Motion, Reactions, SocketSet};
use crate::machine::bodies::{BODIES, TELESCOPE_LOWER, TELESCOPE_UPPER};
use crate::machine::{AXES, Bodies};

/// Everything a force law may read.
#[derive(Clone, Copy)]
pub struct Instant<'a> {
    /// Time since the start of the run, s.
    pub t: f64,
    /// Motion of all bodies and joints; in the twin without accelerations, but for laws that say they read them.
    pub motion: &'a Motion,
    /// Total inertia of the bodies, with payload.
    pub bodies: &'a Bodies,
    /// Gravitational acceleration, m/s².
    pub gravity: f64,
    /// Reactions in the struts.
    pub reactions: &'a Reactions,
    /// The effect's own states.
    pub state: &'a [f64],
    /// Torques of the drives at the gear output, N·m. Where they are what is asked for, zero, unless the effect says that
    /// it reads them.
    pub torque: [f64; AXES],
    /// Ball sockets that still hold.
    pub closed: SocketSet,
}

/// Receives wrenches per unit of each parameter: force and moment about the body's origin, world axes.
pub struct Wrenches<'a> {
    sink: Sink<'a>,
}

enum Sink<'a> {
    /// `(parameter, body, force, moment)` one by one.
    Each(&'a mut dyn FnMut(usize, usize, Vector3<f64>, Vector3<f64>)),
    /// Times the parameters' values, summed over all laws, with their power.
    Sum { values: &'a [f64], motion: &'a Motion, total: &'a mut [(Vector3<f64>, Vector3<f64>); BODIES], power: f64 },
}

impl<'a> Wrenches<'a> {
    /// Hands every wrench to a reader as `(parameter, body, force, moment)`.
    pub fn new(sink: &'a mut dyn FnMut(usize, usize, Vector3<f64>, Vector3<f64>)) -> Self {
        Self { sink: Sink::Each(sink) }
    }

    /// Adds every wrench times its parameter's value to `total`.
    pub fn sum(values: &'a [f64], motion: &'a Motion, total: &'a mut [(Vector3<f64>, Vector3<f64>); BODIES]) -> Self {
        Self { sink: Sink::Sum { values, motion, total, power: 0.0 } }
    }

    /// Power of the summed wrenches on the bodies, W.
    pub fn power(&self) -> f64 {
        if let Sink::Sum { power, .. } = &self.sink { *power } else { 0.0 }
    }

    /// Force and moment on `body` about its origin.
    #[inline]
    pub fn wrench(&mut self, k: usize, body: usize, force: Vector3<f64>, moment: Vector3<f64>) {
        match &mut self.sink {
            Sink::Each(read) => read(k, body, force, moment),
            Sink::Sum { values, motion, total, power } => {
                let force = force * values[k];
                total[body].0 += force;
                *power += force.dot(&motion.bodies[body].velocity);
                self.moment(k, body, moment);
            }
        }
    }

    /// Moment on `body`.
    #[inline]
    pub fn moment(&mut self, k: usize, body: usize, moment: Vector3<f64>) {
        match &mut self.sink {
            Sink::Each(read) => read(k, body, Vector3::zeros(), moment),
            Sink::Sum { values, motion, total, power } => {
                let moment = moment * values[k];
                total[body].1 += moment;
                *power += moment.dot(&motion.bodies[body].angular_velocity);
            }
        }
    }

    /// Torque on drive `axis`, positive along its joint angle; the reaction goes to the base.
    #[inline]
    pub fn drive_torque(&mut self, k: usize, axis: usize, torque: f64) {
        let (body, direction) = Motion::drive(axis);
        self.moment(k, body, direction * torque);
    }

    /// Force along the telescope, positive when it pushes the two parts apart.
    pub fn telescope_force(&mut self, k: usize, motion: &Motion, force: f64) {
        self.wrench(k, TELESCOPE_UPPER, motion.telescope.axis * force, Vector3::zeros());
        self.wrench(k, TELESCOPE_LOWER, -motion.telescope.axis * force, Vector3::zeros());
    }

    /// Moment on the strut at `socket` with its reaction on the arm or the platform.
    #[inline]
    pub fn socket_moment(&mut self, k: usize, socket: usize, moment: Vector3<f64>) {
        let (strut, partner) = Motion::socket_bodies(socket);
        self.moment(k, strut, moment);
        self.moment(k, partner, -moment);
    }
}
