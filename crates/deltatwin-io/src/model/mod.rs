//! Models as TOML: reading with the position of every error, writing with preserved comments.

mod limbs;
pub mod meshes;
mod read;
mod schema;
pub mod shipped;
mod table;
pub mod uncertainty;
mod write;

pub use read::{parse, read};
pub use write::{Note, fitted_text, full_text, noted_text, updated_text, write, write_fitted, write_noted};
