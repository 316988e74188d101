//! Optional parts of an effect besides wrenches and inertia.

use super::{Instant, Values};
use crate::effects::{GearSpring, StrutSpring};
use crate::kinematics::JointState;
use crate::machine::{PerAxis, PerStrut};
use crate::recording::Signals;

/// Differential equations of an effect's internal states.
pub trait InternalStates {
    /// Initial values of the states.
    fn initial_state(&self, values: &Values) -> Vec<f64>;

    /// Writes the time derivative of the states to `rate`. For stiff states `slope` (1/s, zero on entry) receives the
    /// derivative of each rate with respect to its own state, which the twin integrates implicitly.
    fn state_rate(&self, values: &Values, at: &Instant, rate: &mut [f64], slope: &mut [f64]);

    /// Whether the rates and the equilibrium depend on the strut forces, [`Instant::reactions`]; such states are known by
    /// [`Self::step_along`].
    fn reads_reactions(&self) -> bool {
        false
    }

    /// Internal states in equilibrium with the motion at an instant, whose own states are not used: those at the start
    /// of a run or a recording, and those of an instant without a past.
    fn steady_state(&self, values: &Values, _at: &Instant) -> Vec<f64> {
        self.initial_state(values)
    }

    /// Internal states at the end of a step along a measured motion, from those at its start, for equations whose
    /// solution is known; `None` leaves the step to a general method. Strut forces at both ends are those with the states at
    /// the start.
    fn step_along(&self, _values: &Values, _from: &Instant, _to: &Instant) -> Option<Vec<f64>> {
        None
    }
}

/// Effect on the sensors.
pub trait Sensor {
    /// Turns joint angles into motor-side encoder readings, rad.
    fn encoder(&self, _values: &Values, _state: &[f64], _angles: &mut PerAxis<f64>) {}

    /// Turns the motion of the encoders into that of the joints, with rates and accelerations: the inverse of
    /// [`Sensor::encoder`] with the internal states at rest.
    fn joint(&self, _values: &Values, _motion: &mut JointState) {}

    /// Turns the ideal signals into the reported ones.
    fn observe(&self, _values: &Values, _signals: &mut Signals) {}

    /// Whether the reported signals are an affine function of the ideal ones.
    fn is_affine(&self) -> bool {
        true
    }

    /// Time (s) over which earlier signals enter a reported one, beyond a few samples.
    fn memory(&self, _values: &Values) -> f64 {
        0.0
    }

    /// Time (s) by which a reported signal is later and earlier than the ideal one, at most.
    fn reach(&self, values: &Values) -> [f64; 2] {
        [self.memory(values), 0.0]
    }
}

/// Elastic elements of an effect.
pub trait Compliance {
    /// Elastic gears between encoder and joint, whose compliances are the first parameters.
    ///
    /// The internal states are then deflections and deflection rates of the three arms. The twin integrates them;
    /// evaluations along a measured motion derive them from that motion.
    fn gear_springs(&self, _values: &Values) -> Option<PerAxis<GearSpring>> {
        None
    }

    /// Axial spring and damper of each strut, see [`StrutSpring`].
    fn strut_spring(&self, _values: &Values) -> Option<PerStrut<StrutSpring>> {
        None
    }
}
