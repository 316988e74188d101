//! What every law shares: its parameters, what it reads and hands back, and how it stands in a model.

mod acting;
mod active;
mod fault;
mod impact;
mod parameter;
mod wrenches;

pub use acting::Effects;
pub use active::{ActiveEffect, Entry, Host, MachineView};
pub use impact::hunt_crossley;
pub use parameter::{Count, Layout, Parameter, Role, Values};
pub use wrenches::{Instant, Wrenches};
