//! What the diagnosis says when no known effect explains the data.

mod library;
mod pursuit;
mod sight;

pub use sight::Sight;
