//! Inputs and outputs of force laws.

use nalgebra::Vector3;

use crate::kinematics::{Motion, Reactions, SocketSet};
use crate::machine::bodies::{SLOTS, TELESCOPE_LOWER, TELESCOPE_UPPER};
use crate::machine::{Bodies, Geometry, Joint, Payload, PerAxis};

/// Quantities on which a force law may depend.
#[derive(Clone, Copy)]
pub struct Instant<'a> {
    /// Time since the start of the run, s.
    pub t: f64,
    /// Motion of all bodies and joints; in the twin without accelerations, except for laws that declare them in
    /// `Reads`.
    pub motion: &'a Motion,
    /// Lengths and limbs of the machine.
    pub geometry: &'a Geometry,
    /// Total inertia of the bodies, with payload.
    pub bodies: &'a Bodies,
    /// Payload as stated in the setup.
    pub payload: &'a Payload,
    /// Gravitational acceleration, m/s².
    pub gravity: f64,
    /// Strut reactions.
    pub reactions: &'a Reactions,
    /// Internal states of the effect.
    pub state: &'a [f64],
    /// Drive torques at the gear output, N·m. Zero in inverse dynamics, unless the effect declares in `Reads` that it
    /// depends on them.
    pub torque: PerAxis<f64>,
    /// Load of a single axis that is known, measured or stated, against positive motion, N·m or N.
    pub load: Option<f64>,
    /// Ball sockets that are closed.
    pub closed: SocketSet,
}

impl Instant<'_> {
    /// What the gear of a drive transmits, N·m: the known load, else the drive torque.
    pub fn transmitted(&self, axis: usize) -> f64 {
        self.load.unwrap_or(self.torque[axis])
    }
}

/// Sink for wrenches per unit of each parameter: force and moment about the body's origin, inertial axes.
pub struct Wrenches<'a> {
    sink: Sink<'a>,
}

enum Sink<'a> {
    /// Passes on `(parameter, body, force, moment)` one by one.
    Each { motion: &'a Motion, read: &'a mut dyn FnMut(usize, usize, Vector3<f64>, Vector3<f64>) },
    /// Multiplies by the parameter values and sums over all laws, with the power.
    Sum { values: &'a [f64], motion: &'a Motion, total: &'a mut [(Vector3<f64>, Vector3<f64>); SLOTS], power: f64 },
}

impl<'a> Wrenches<'a> {
    /// Sink that passes every wrench at a motion to a function as `(parameter, body, force, moment)`.
    pub fn new(motion: &'a Motion, read: &'a mut dyn FnMut(usize, usize, Vector3<f64>, Vector3<f64>)) -> Self {
        Self { sink: Sink::Each { motion, read } }
    }

    /// Sink that adds every wrench times its parameter value to `total`.
    pub fn sum(values: &'a [f64], motion: &'a Motion, total: &'a mut [(Vector3<f64>, Vector3<f64>); SLOTS]) -> Self {
        Self { sink: Sink::Sum { values, motion, total, power: 0.0 } }
    }

    /// Power of the summed wrenches on the bodies, W; zero for a sink that does not sum.
    pub fn power(&self) -> f64 {
        if let Sink::Sum { power, .. } = &self.sink { *power } else { 0.0 }
    }

    /// Adds a force (N) and a moment (N·m) on `body` about its origin, per unit of parameter `k`.
    #[inline]
    pub fn wrench(&mut self, k: usize, body: usize, force: Vector3<f64>, moment: Vector3<f64>) {
        match &mut self.sink {
            Sink::Each { read, .. } => read(k, body, force, moment),
            Sink::Sum { values, motion, total, power } => {
                let (force, moment) = (force * values[k], moment * values[k]);
                let (body, sum) = (&motion.bodies[body], &mut total[body]);
                sum.0 += force;
                sum.1 += moment;
                *power += force.dot(&body.velocity) + moment.dot(&body.angular_velocity);
            }
        }
    }

    /// Adds a force (N) at the origin of `body`.
    #[inline]
    pub fn force(&mut self, k: usize, body: usize, force: Vector3<f64>) {
        match &mut self.sink {
            Sink::Each { read, .. } => read(k, body, force, Vector3::zeros()),
            Sink::Sum { values, motion, total, power } => {
                let force = force * values[k];
                total[body].0 += force;
                *power += force.dot(&motion.bodies[body].velocity);
            }
        }
    }

    /// Adds a moment (N·m) on `body`.
    #[inline]
    pub fn moment(&mut self, k: usize, body: usize, moment: Vector3<f64>) {
        match &mut self.sink {
            Sink::Each { read, .. } => read(k, body, Vector3::zeros(), moment),
            Sink::Sum { values, motion, total, power } => {
                let moment = moment * values[k];
                total[body].1 += moment;
                *power += moment.dot(&motion.bodies[body].angular_velocity);
            }
        }
    }

    /// Adds a torque (N·m, or N on a carriage) on drive `axis`, positive along its coordinate; the reaction acts on the
    /// base.
    #[inline]
    pub fn drive_torque(&mut self, k: usize, axis: usize, torque: f64) {
        let (Sink::Each { motion, .. } | Sink::Sum { motion, .. }) = &self.sink;
        let (body, screw) = motion.drive(axis);
        match motion.arms {
            Joint::Revolute => self.moment(k, body, screw.angular * torque),
            Joint::Prismatic => self.wrench(k, body, screw.linear * torque, screw.angular * torque),
        }
    }

    /// Adds a force (N) along the telescope, positive if it pushes the two parts apart.
    pub fn telescope_force(&mut self, k: usize, motion: &Motion, force: f64) {
        let force = motion.telescope.axis * force;
        self.force(k, TELESCOPE_UPPER, force);
        self.force(k, TELESCOPE_LOWER, -force);
    }

    /// Adds a moment (N·m) on the strut at `socket` and its reaction on the arm or the platform; `rate` is that of the strut
    /// relative to them, [`Motion::socket_rate`].
    #[inline]
    pub fn socket_moment(&mut self, k: usize, socket: usize, rate: &Vector3<f64>, moment: Vector3<f64>) {
        let (Sink::Each { motion, .. } | Sink::Sum { motion, .. }) = &self.sink;
        let (strut, partner) = motion.socket_bodies(socket);
        match &mut self.sink {
            Sink::Each { read, .. } => {
                read(k, strut, Vector3::zeros(), moment);
                read(k, partner, Vector3::zeros(), -moment);
            }
            Sink::Sum { values, total, power, .. } => {
                let moment = moment * values[k];
                total[strut].1 += moment;
                total[partner].1 -= moment;
                *power += moment.dot(rate);
            }
        }
    }
}
