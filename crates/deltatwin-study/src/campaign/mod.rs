//! Chunks of runs, their parts on the disk, and the table made of them.

mod table;

pub use table::{Column, Kind, Value};
