//! Measured or simulated signals: joint angles, drive torques and optional channels over time.

mod channel;
mod context;
mod difference;
mod loads;
mod series;
mod signals;

pub use channel::{Channel, FAMILIES, Family, Field, ROWS, multiplier_names};
pub use context::{Attachment, Contact, Contacts, Context, Level, Note, Poses};
pub use difference::Difference;
pub use loads::Loads;
pub use series::Series;
pub use signals::{AxisRows, Rows, Signals, is_even, sample_time};

use crate::machine::Setup;

/// One run of the machine, sampled at increasing times.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// Name for reports, usually the file stem.
    pub name: String,
    /// Sampled signals.
    pub signals: Signals,
    /// Known conditions of the run.
    pub setup: Setup,
}
