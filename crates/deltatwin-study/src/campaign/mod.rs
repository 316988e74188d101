//! Chunks of runs, their parts on the disk, and the table made of them.

mod chunk;
mod digest;
mod error;
mod folder;
mod journal;
mod making;
mod merge;
pub mod parquet;
mod table;
#[cfg(test)]
mod tests;

pub use chunk::Chunk;
pub(crate) use digest::unit;
pub use digest::{Digest, Draws};
pub use error::CampaignError;
pub use folder::{BUILD, Campaign, Held, TABLE};
pub use making::{Row, Steps, Watch};
pub use table::{Column, Heading, Kind, Table, Value};
