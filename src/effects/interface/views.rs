//! What some effects have besides wrenches and inertia.

use super::{Instant, Values};
use crate::effects::{GearSpring, StrutSpring};
use crate::machine::{AXES, STRUTS};
use crate::recording::Signals;

/// Differential equations of an effect.
pub trait InternalStates {
    /// Initial values of the states.
    fn initial_state(&self, values: &Values) -> Vec<f64>;

    /// Time derivative of the states, and its derivative by each state itself where it is steep (`slope`, 1/s, zero on
    /// entry): the twin treats it implicitly.
    fn state_rate(&self, values: &Values, at: &Instant, rate: &mut [f64], slope: &mut [f64]);
}

/// What an effect changes of the sensors.
pub trait Sensor {
    /// What the motor-side encoders read beyond the joint angles: adds to `angles`, rad.
    fn encoder(&self, _values: &Values, _state: &[f64], _angles: &mut [f64; AXES]) {}

    /// Changes what the sensors report: the ideal signals become the reported ones.
    fn observe(&self, _values: &Values, _signals: &mut Signals) {}
}

/// What gives way elastically.
pub trait Compliance {
    /// Elastic gears between encoder and joint, whose compliances are the first parameters. The effect's own states are
    /// then the three arms' deflections and their rates, which the twin integrates; readers of a measured motion find
    /// them along it.
    fn gear_springs(&self, _values: &Values) -> Option<[GearSpring; AXES]> {
        None
    }

    /// Axial spring and damper of each strut per unit of compliance, see [`StrutSpring`].
    fn strut_spring(&self, _values: &Values) -> Option<[StrutSpring; STRUTS]> {
        None
    }
}
