//! Scenarios as TOML, with the look-up tables of their motions as CSV.

mod design;
pub(crate) mod read;
mod table;
mod write;

pub use design::{design_text, write_design, write_experiment};
pub use read::{ScenarioError, parse, parse_with, read, read_with};
pub use write::motion_text;
