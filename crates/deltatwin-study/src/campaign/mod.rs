//! Chunks of runs, their parts on the disk, and the table made of them.

mod chunk;
mod digest;
mod engine;
mod journal;
pub mod parquet;
mod table;

pub use chunk::Chunk;
pub(crate) use digest::unit;
pub use digest::{Digest, Draws};
pub use engine::{Campaign, CampaignError, Held, Row, Steps, TABLE, Watch};
pub use table::{Column, Heading, Kind, Table, Value};
