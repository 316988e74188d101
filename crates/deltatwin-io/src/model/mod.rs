//! Models as TOML: read with the place of every mistake, written with the user's comments.

mod read;
mod schema;
mod table;
mod write;

pub use read::{parse, read};
pub use write::{fitted_text, full_text, updated_text, write, write_fitted};
