//! What the diagnosis says when no known effect explains the data.

mod sight;

pub use sight::Sight;
