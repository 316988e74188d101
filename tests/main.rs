//! Tests of the library on whole recordings, models and runs, in one binary: each binary links the library once more.

mod common;
#[path = "common/oracle.rs"]
mod oracle;
#[path = "common/snapshot.rs"]
mod snapshot;

/// What a file of the library's effects sees around it, for the example of the documentation.
mod effects {
    pub use deltatwin::effects::*;
    pub mod platform_damper;
}
mod machine {
    pub use deltatwin::machine::bodies;
}

mod allocation;
mod axes;
mod breaking;
mod compliance;

mod copp;
mod cost;
mod derivatives;
mod dislocation;
mod energy;
mod family;
mod formula;
mod formulations;
mod identification;
mod laws;
mod links;
mod loads;
mod r#loop;
mod machines;
mod model;
mod monitoring;
mod motions;
mod numerical;
mod payload;
mod planner;
mod random;
mod reference;
mod scenarios;
mod shapes;
mod slow;
mod stiff;
mod traps;
mod twin;
mod unknown;
mod walls;
