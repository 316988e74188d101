//! Common interface of all effects: parameters, inputs, outputs and properties.

mod acting;
mod active;
mod fault;
mod impact;
mod oscillator;
mod parameter;
mod presliding;
mod spec;
mod views;
mod wrenches;

pub use acting::Effects;
#[cfg(test)]
pub(super) use active::default_values;
pub use active::{ActiveEffect, Entry, Host, MachineView};
pub use impact::hunt_crossley;
pub use oscillator::{Oscillator, Sway};
pub use parameter::{Count, Layout, Param, Parameter, Role, Values};
pub use presliding::presliding;
pub use spec::{About, Kind, Reads, Search, Spec, Start};
pub use views::{Compliance, InternalStates, Sensor};
pub use wrenches::{Instant, Wrenches};
